"""Finding of flow angles that were delayed, and whose delay was removed before the search for effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from structsel.comparison.flow_angle_delays import FlowAngleDelay
from structsel.comparison.preparing import PreparedComparison
from structsel.diagnosis import judging
from structsel.diagnosis.ranking import NAMED
from structsel.diagnosis.result import Bars, EffectFinding, Physics
from structsel.effects.base import ParameterEstimate
from structsel.effects.wording import INSTRUMENTS
from structsel.formatting import as_sentence, format_estimate, join_names
from structsel.numerics.arrays import Array

_SHOWN = 0.01  # fraction by which the rms of the differences of a listed response decreases


def removed_delays(prepared: PreparedComparison, responses: Sequence[str]) -> list[EffectFinding]:
    """The delays that were removed, as one finding.

    Empty if there are none, if none probably exceeds what sampling leaves open, or if the simulation fits as well with
    them.

    Parameters
    ----------
    prepared : PreparedComparison
    responses : sequence of str
        Responses by which effects are judged.
    """
    found = [one for one in prepared.delays if one.beyond_sampling >= NAMED]
    if not found:
        return []
    before, after = (_varying([f.difference for f in x], responses) for x in (prepared.as_recorded, prepared.flights))
    gained = judging.gains(before, after, responses)
    axes = tuple(sorted((c for c, x in gained.items() if x > _SHOWN), key=lambda c: -gained[c]))
    if not axes:
        return []
    measured = _varying([f.measured for f in prepared.flights], axes)
    fits = [judging.fit(measured, left, axes) for left in (before, after)]
    bars = {c: Bars(fits[0][c], fits[0][c], fits[1][c]) for c in axes if c in fits[0]}
    explained = judging.explained(before, after, axes)
    each = join_names([_says(one) for one in found])
    physics = Physics(
        "sensor-delay",
        max(one.beyond_sampling for one in found),
        as_sentence(f"{each}, by accelerometers and gyros; the delay was removed before the other effects were sought"),
        {f"delay of {one.channel}": ParameterEstimate(one.delay, one.std, "s") for one in found},
    )
    return [EffectFinding(axes, "sensor", (physics,), {}, {}, (), "", bars, explained, explained, explained)]


def _says(one: FlowAngleDelay) -> str:
    return f"{INSTRUMENTS[one.channel]} is delayed by {format_estimate(one.delay, one.std, 's')}"


def _varying(signals: Sequence[Mapping[str, Array]], responses: Sequence[str]) -> judging.Residuals:
    """Signals of each flight without the constant part."""
    return [{c: one[c] - one[c].mean() for c in responses} for one in signals]
