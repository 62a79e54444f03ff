"""Manoeuvre that separates two effects that the recordings cannot distinguish.

Manoeuvres are simulated with the surrogate of the simulation: pulses of several widths on each control, all controls at
once, and the input that `design_inputs` finds for the derivatives of the axis. For each, the contribution of one effect
is regressed on the other effect and on the parameters with a tolerance. The residual is the information.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial, reduce
from operator import add

import numpy as np

from structsel.aircraft import Aircraft
from structsel.comparison.flight import Flight, prepare_flight
from structsel.comparison.noise import Rows, as_spectra, side_by_side
from structsel.comparison.tolerances import biases_of, tolerances_of
from structsel.diagnosis.extending import as_models
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.ranking import Ranking
from structsel.diagnosis.result import EffectFinding
from structsel.diagnosis.scoring import EffectScore
from structsel.diagnosis.signatures import spectra_of
from structsel.effects.wording import SURFACES
from structsel.errors import DomainError, StructselError
from structsel.inputs import design_inputs, multisine, name_derivatives, three_two_one_one
from structsel.inputs.signals import whole_steps
from structsel.model import AeroModel
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array
from structsel.numerics.evidence import NormalEquations, solve
from structsel.recording import Recording
from structsel.simulation import Instruments, Trim, linearise, simulate, trim

_DURATION = 20.0  # s
_WIDTHS = (0.3, 0.7, 1.6)  # s, of one pulse
_BAND = (0.1, 2.0)  # Hz
_SPEEDS = (0.1, 0.9)  # quantiles of the recorded airspeed, in addition to its median
_LARGEST = 0.95  # quantile of the deflections of a control that counts as the largest
_CLEAR = 3.0  # log Bayes factor: odds of twenty to one
_FUNCTIONS, _COARSE = 8, 0.1  # of a designed input; s
_NOISE = {"u": 0.3, "v": 0.3, "w": 0.3, "p": 1e-3, "q": 1e-3, "r": 1e-3, "theta": 2e-3, "phi": 2e-3}
_MOVED = {c: SURFACES[c] for c in ("de", "da", "dr")} | {"thrust": "thrust"}
_AXES = {
    "Cm": ("de", "m"),
    "CZ": ("de", "z"),
    "CX": ("de", "x"),
    "Cl": ("da", "l"),
    "Cn": ("dr", "n"),
    "CY": ("dr", "y"),
}
"""Control of each response, and the first letter of its derivatives."""


@dataclass(frozen=True, eq=False)
class Separation:
    """The simulated manoeuvre that separates two effects best.

    Attributes
    ----------
    says : str
    inputs : Recording or None
        Deviations of controls from trim; None if no simulated manoeuvre separates them.
    V : float [m/s]
        Airspeed at its start.
    log_bayes : float
        Expected log Bayes factor of the one effect over the other.
    recorded : float
        The same for all recordings.
    """

    says: str
    inputs: Recording | None
    V: float
    log_bayes: float
    recorded: float


@dataclass(frozen=True, eq=False)
class _Question:
    """One effect as it was found, against another."""

    problem: DiagnosisProblem
    one: EffectScore
    other: EffectScore

    def recorded(self) -> float:
        """Expected log Bayes factor of the recordings."""
        a, b = self.one.signature, self.other.signature
        each = zip(self.problem.rows, self.problem.base.given, a.spectra, b.spectra)
        return _information(self._products(r, given, x, y) for r, given, x, y in each)

    def along(self, flight: Flight) -> float:
        """Expected log Bayes factor of one more flight."""
        own = as_spectra(side_by_side([(sd, x) for _, sd, x in biases_of(flight)], flight), flight)
        # The noise is that of the first recording.
        noisy = replace(flight, name=self.problem.flights[0].name)
        rows = Rows.of(noisy, self.problem.responses, self.problem.noise, own)
        allowed = as_spectra(side_by_side([(n.sd, n.columns[0]) for n in tolerances_of([flight])], flight), flight)
        made = spectra_of([s.signature.variant for s in (self.one, self.other)], flight, self.problem.responses)
        return _information([self._products(rows, rows.whiten(allowed), *made)]) if made[0] else 0.0

    def _products(
        self, rows: Rows, given: Array, does: Mapping[str, Array], like: Mapping[str, Array]
    ) -> NormalEquations:
        y = rows.whiten(does, self.one.signature.width) @ self.one.trial.theta
        return NormalEquations.of(np.column_stack([given, rows.whiten(like, self.other.signature.width)]), y)


def _information(each: Iterable[NormalEquations]) -> float:
    """Half of the residual sum of squares of y after a regression with standard normal priors."""
    products = reduce(add, each)
    return 0.5 * (products.c - float(products.b @ solve(products).mean))


def with_separation(finding: EffectFinding, ranking: Ranking) -> EffectFinding:
    """An ambiguous finding with the manoeuvre that separates its effect from the most probable alternative."""
    found_at = next((k for k, s in enumerate(ranking.steps) if s.score.effect == finding.effect), None)
    if found_at is None or not finding.ambiguous_with:
        return finding
    step = ranking.steps[found_at]
    other = next((s for s in step.others if s.effect in finding.ambiguous_with), None)
    before = ranking.steps[found_at - 1].problem if found_at else ranking.start
    found = find_separation(before, step.score, other) if other is not None else None
    if found is None:
        return finding
    return replace(finding, to_separate=f"{finding.to_separate} {found.says}".strip(), manoeuvre=found.inputs)


def find_separation(problem: DiagnosisProblem, one: EffectScore, other: EffectScore) -> Separation | None:
    """The manoeuvre that separates one effect, as it was found, best from another; None if none can be simulated.

    Parameters
    ----------
    problem : DiagnosisProblem
        In which both were tested.
    one, other : EffectScore
    """
    flights = problem.flights
    stand_in, aircraft = flights[0].surrogate, flights[0].aircraft
    all_six = set(flights[0].simulated) == set(COEFFICIENTS)
    if stand_in is None or aircraft.inertia is None or not all_six or not set(COEFFICIENTS) <= set(stand_in.terms):
        return None
    question = _Question(problem, one, other)
    recorded = question.recorded()
    model = AeroModel(as_models(stand_in, flights), "stand-in")
    speeds = np.quantile(np.concatenate([f["V"] for f in flights]), [0.5, *_SPEEDS])
    height = float(np.mean([f["h"].mean() for f in flights if "h" in f.channels] or [0.0]))
    best: tuple[float, Recording, float] | None = None
    count = 0
    for V in map(float, speeds):
        try:
            start = trim(model, aircraft, V, height)
        except StructselError:
            continue
        # Every input at the median speed, the best of them at the others.
        tried = [best[1]] if best else list(_inputs(model, aircraft, start, flights, one.signature.responses))
        for inputs in tried:
            flight = _fly(model, start, inputs, flights[0])
            if flight is None:
                continue
            count += 1
            gain = question.along(flight)
            if best is None or gain > best[0]:
                best = gain, inputs, V
    if best is None:
        return None
    gain, inputs, V = best
    seconds = sum(float(f.t[-1] - f.t[0]) for f in flights)
    if gain < max(_CLEAR, recorded * _DURATION / seconds):
        says = (
            f"None of {count} simulated manoeuvres separates {one.effect} from {other.effect} better than these "
            f"recordings (expected log Bayes factor {recorded:z.0f} in {seconds:.0f} s)."
        )
        return Separation(says, None, V, gain, recorded)
    says = (
        f"Of {count} simulated manoeuvres, {inputs.name} at {V:.0f} m/s separates {one.effect} from {other.effect} "
        f"best: expected log Bayes factor {gain:.0f} in {_DURATION:.0f} s; that of these recordings is {recorded:z.0f} "
        f"in {seconds:.0f} s."
    )
    return Separation(says, inputs, V, gain, recorded)


def _inputs(
    model: AeroModel, aircraft: Aircraft, start: Trim, flights: Sequence[Flight], responses: Iterable[str]
) -> Iterator[Recording]:
    """Deviations of controls from trim, as large as the recorded ones."""
    dt = flights[0].dt
    sizes = {
        c: float(np.quantile(np.abs(np.concatenate([f[c] - np.median(f[c]) for f in flights])), _LARGEST))
        for c in _MOVED
        if c in start.controls and all(c in f.recorded for f in flights)
    }
    sizes = {c: size for c, size in sizes.items() if size > 0.0}
    tried: list[tuple[Callable[[], Recording], str]] = []
    for c, size in sizes.items():
        for width in _WIDTHS:
            large = f"{size:.3g} N" if c == "thrust" else f"{np.rad2deg(size):.1f} deg"
            pulses = partial(three_two_one_one, c, size, width, duration=_DURATION, dt=dt)
            tried.append((pulses, f"a 3-2-1-1 on the {_MOVED[c]}, {width:g} s and {large},"))
    if sizes:
        low, high = _BAND
        period = whole_steps(_DURATION, dt)
        moved = partial(multisine, list(sizes), list(sizes.values()), low=low, high=high, period=period, dt=dt)
        tried.append((moved, f"{', '.join(_MOVED[c] for c in sizes)} moved at once at {low:g} to {high:g} Hz"))
    for make, name in tried:
        with suppress(DomainError):  # too fast for the sampling of the recordings
            yield _named(make(), name)
    clearest = next((r for r in _clearest(flights, responses) if _AXES[r][0] in sizes), None)
    if clearest is not None:
        control, letter = _AXES[clearest]
        if found := _designed(model, aircraft, start, control, letter, sizes[control], dt):
            yield _named(found, f"the input designed for the derivatives of {clearest} by the {_MOVED[control]}")


def _clearest(flights: Sequence[Flight], responses: Iterable[str]) -> list[str]:
    """Coefficients, the one with the largest fraction of unexplained variance first."""
    fraction = {
        r: sum(float(f.difference[r].var()) for f in flights) / sum(float(f.measured[r].var()) for f in flights)
        for r in responses
        if r in _AXES
    }
    return sorted(fraction, key=lambda r: -fraction[r])


def _designed(
    model: AeroModel, aircraft: Aircraft, start: Trim, control: str, letter: str, size: float, dt: float
) -> Recording | None:
    axis = "longitudinal" if control == "de" else "lateral"
    try:
        linear = name_derivatives(linearise(model, aircraft, start, axis=axis, inputs=(control,)))
        found = design_inputs(
            linear,
            noise={c: _NOISE[c] for c in linear.outputs},
            to_separate=[n for n in linear.parameters if n.startswith(letter)],
            limits={control: size},
            duration=_DURATION,
            dt=_COARSE,
            functions=_FUNCTIONS,
        )
    except StructselError:
        return None
    t = np.arange(0.0, _DURATION + 0.5 * dt, dt)
    return Recording("designed", t, {control: np.interp(t, found.inputs.t, found.inputs[control])}, {control: "rad"})


def _named(inputs: Recording, name: str) -> Recording:
    return Recording(name, inputs.t, inputs.channels, inputs.units)


def _fly(model: AeroModel, start: Trim, inputs: Recording, like: Flight) -> Flight | None:
    """The simulated flight with the channels of the recordings; None if it cannot be simulated."""
    try:
        moved = start.inputs(inputs.t, **inputs.channels)
        simulated = simulate(model, like.aircraft, moved, start=start, instruments=Instruments(), outside="ignore")
        kept = {c: x for c, x in simulated.channels.items() if c in like.recorded}
        still = {
            c: np.full(len(simulated), float(np.mean(like[c]))) for c in like.recorded - set(kept) if c in like.channels
        }
        record = Recording("tried", simulated.t, {**still, **kept})
        flight = prepare_flight(record, like.aircraft, {c: np.zeros(len(record)) for c in like.simulated})
    except StructselError:
        return None
    assert like.surrogate is not None
    flight = replace(flight, surrogate=like.surrogate, apart=like.apart)
    coefficients = {c: like.surrogate.evaluate(flight, c) for c in like.simulated}
    measured = {c: flight.measured[c] for c in like.measured if c in flight.measured}
    return replace(flight, simulated=coefficients, measured=measured) if set(measured) == set(like.measured) else None
