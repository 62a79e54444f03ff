"""Which manoeuvre would tell two effects apart that the recordings cannot.

Manoeuvres are flown with the simulation's stand-in: pulses of several widths on each control, all controls at once,
and the input that `design_inputs` finds for the derivatives of the axis. Along each, what one effect does is set
against all that the other, and stated tolerances, could make of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
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
from structsel.errors import StructselError
from structsel.inputs import design_inputs, multisine, name_derivatives, three_two_one_one
from structsel.model import AeroModel
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array
from structsel.numerics.evidence import NormalEquations, solve
from structsel.recording import Recording
from structsel.simulation import Instruments, Trim, linearise, simulate, trim

_DURATION = 20.0  # s
_WIDTHS = (0.3, 0.7, 1.6)  # s, of a pulse of one
_BAND = (0.1, 2.0)  # Hz
_SPEEDS = (0.1, 0.9)  # quantiles of what was flown, tried beside its median
_LARGEST = 0.95  # quantile of a control's departures that counts as its largest
_CLEAR = 3.0  # nats: twenty to one
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
"""Of a response, its control and the first letter of its derivatives."""


@dataclass(frozen=True, eq=False)
class Separation:
    """The manoeuvre, of those tried, that tells two effects apart best.

    Attributes
    ----------
    says : str
    inputs : Recording or None
        Departures of controls from trim; None where no manoeuvre tried tells them apart.
    V : float [m/s]
        At which it begins.
    nats : float
        Log likelihood that it is to give the one over the other, on average.
    flown : float
        The same of all recordings there are.
    """

    says: str
    inputs: Recording | None
    V: float
    nats: float
    flown: float


@dataclass(frozen=True, eq=False)
class _Question:
    """One effect, as it was found, or another."""

    problem: DiagnosisProblem
    one: EffectScore
    other: EffectScore

    def flown(self) -> float:
        """Nats of the recordings."""
        a, b = self.one.signature, self.other.signature
        each = zip(self.problem.rows, self.problem.base.given, a.spectra, b.spectra)
        return _told(self._products(r, given, x, y) for r, given, x, y in each)

    def along(self, flight: Flight) -> float:
        """Nats of one more flight."""
        own = as_spectra(side_by_side([(sd, x) for _, sd, x in biases_of(flight)], flight), flight)
        # The noise is that of the first recording.
        noisy = replace(flight, name=self.problem.flights[0].name)
        rows = Rows.of(noisy, self.problem.responses, self.problem.noise, own)
        allowed = as_spectra(side_by_side([(n.sd, n.columns[0]) for n in tolerances_of([flight])], flight), flight)
        made = [spectra_of(s.signature.variant, flight, self.problem.responses) for s in (self.one, self.other)]
        return _told([self._products(rows, rows.whiten(allowed), *made)]) if made[0] else 0.0

    def _products(
        self, rows: Rows, given: Array, does: Mapping[str, Array], like: Mapping[str, Array]
    ) -> NormalEquations:
        y = rows.whiten(does, self.one.signature.width) @ self.one.trial.theta
        return NormalEquations.of(np.column_stack([given, rows.whiten(like, self.other.signature.width)]), y)


def _told(each: Iterable[NormalEquations]) -> float:
    """Half of the squares that columns leave of y, their priors being standard normal."""
    products = reduce(add, each)
    return 0.5 * (products.c - float(products.b @ solve(products).mean))


def with_separation(finding: EffectFinding, ranking: Ranking) -> EffectFinding:
    """A finding that is tied, with the manoeuvre that tells its effect from the likeliest of the others."""
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
    """The manoeuvre that best tells one effect, as it was found, from another; None where none can be flown.

    Parameters
    ----------
    bench : Bench
        On which both were tried.
    one, other : EffectScore
    """
    flights = problem.flights
    stand_in, aircraft = flights[0].surrogate, flights[0].aircraft
    all_six = set(flights[0].simulated) == set(COEFFICIENTS)
    if stand_in is None or aircraft.inertia is None or not all_six or not set(COEFFICIENTS) <= set(stand_in.terms):
        return None
    question = _Question(problem, one, other)
    flown = question.flown()
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
        # Every input at the speed that is flown most, the best of them at others.
        tried = [best[1]] if best else list(_inputs(model, aircraft, start, flights, one.signature.responses))
        for inputs in tried:
            flight = _fly(model, start, inputs, flights[0])
            if flight is None:
                continue
            count += 1
            nats = question.along(flight)
            if best is None or nats > best[0]:
                best = nats, inputs, V
    if best is None:
        return None
    nats, inputs, V = best
    seconds = sum(float(f.t[-1] - f.t[0]) for f in flights)
    if nats < max(_CLEAR, flown * _DURATION / seconds):
        says = (
            f"Of {count} manoeuvres tried with this simulation none tells {one.effect} from {other.effect} better than "
            f"these recordings do, by {flown:.0f} nats in {seconds:.0f} s."
        )
        return Separation(says, None, V, nats, flown)
    says = (
        f"Of {count} manoeuvres tried with this simulation, {inputs.name} at {V:.0f} m/s tells most: {one.effect} from "
        f"{other.effect} by {nats:.0f} nats in {_DURATION:.0f} s, where these recordings do by {flown:.0f} in "
        f"{seconds:.0f} s."
    )
    return Separation(says, inputs, V, nats, flown)


def _inputs(
    model: AeroModel, aircraft: Aircraft, start: Trim, flights: Sequence[Flight], responses: Iterable[str]
) -> Iterator[Recording]:
    """Departures of controls from trim, as large as they were flown."""
    dt = flights[0].dt
    sizes = {
        c: float(np.quantile(np.abs(np.concatenate([f[c] - np.median(f[c]) for f in flights])), _LARGEST))
        for c in _MOVED
        if c in start.controls and all(c in f.recorded for f in flights)
    }
    sizes = {c: size for c, size in sizes.items() if size > 0.0}
    for c, size in sizes.items():
        for width in _WIDTHS:
            large = f"{size:.3g} N" if c == "thrust" else f"{np.rad2deg(size):.1f} deg"
            name = f"a 3-2-1-1 on the {_MOVED[c]}, {width:g} s and {large},"
            yield _named(three_two_one_one(c, size, width, duration=_DURATION, dt=dt), name)
    if sizes:
        low, high = _BAND
        moved = multisine(list(sizes), list(sizes.values()), low=low, high=high, period=_DURATION, dt=dt)
        yield _named(moved, f"{', '.join(_MOVED[c] for c in sizes)} moved at once at {low:g} to {high:g} Hz")
    clearest = next((r for r in _clearest(flights, responses) if _AXES[r][0] in sizes), None)
    if clearest is not None:
        control, letter = _AXES[clearest]
        if found := _designed(model, aircraft, start, control, letter, sizes[control], dt):
            yield _named(found, f"the input designed for the derivatives of {clearest} by the {_MOVED[control]}")


def _clearest(flights: Sequence[Flight], responses: Iterable[str]) -> list[str]:
    """Coefficients, the one whose differences are the largest share of what was measured first."""
    share = {
        r: sum(float(f.difference[r].var()) for f in flights) / sum(float(f.measured[r].var()) for f in flights)
        for r in responses
        if r in _AXES
    }
    return sorted(share, key=lambda r: -share[r])


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
    """The flight, with the channels that the recordings have; None where it cannot be flown."""
    try:
        moved = start.inputs(inputs.t, **inputs.channels)
        flown = simulate(model, like.aircraft, moved, start=start, instruments=Instruments(), outside="ignore")
        kept = {c: x for c, x in flown.channels.items() if c in like.recorded}
        still = {
            c: np.full(len(flown), float(np.mean(like[c]))) for c in like.recorded - set(kept) if c in like.channels
        }
        record = Recording("tried", flown.t, {**still, **kept})
        flight = prepare_flight(record, like.aircraft, {c: np.zeros(len(record)) for c in like.simulated})
    except StructselError:
        return None
    assert like.surrogate is not None
    flight = replace(flight, surrogate=like.surrogate, apart=like.apart)
    simulated = {c: like.surrogate.evaluate(flight, c) for c in like.simulated}
    measured = {c: flight.measured[c] for c in like.measured if c in flight.measured}
    return replace(flight, simulated=simulated, measured=measured) if set(measured) == set(like.measured) else None
