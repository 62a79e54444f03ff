"""Held-out recordings simulated in windows: the simulation as given, retuned, and with the missing effects.

The importance of differences of coefficients shows in the motion. Each manoeuvre is cut into windows that start from
the recorded state, and the rigid body is simulated with the coefficients that each stage predicts along the recorded
path; see `structsel.validation.coefficient_tables`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from structsel.aircraft import Aircraft, Inertia
from structsel.comparison.flight import AIRFRAME, Flight
from structsel.comparison.noise import edge_of
from structsel.comparison.responses import respond
from structsel.diagnosis import judging
from structsel.diagnosis.held_out_result import ChannelScores, ExampleWindows, HeldOutSimulation, WindowScore
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.ranking import Ranking
from structsel.diagnosis.residuals import contribution
from structsel.errors import DomainError
from structsel.metrics import compute_metrics, rms_error
from structsel.nomenclature import COEFFICIENTS, unit_of
from structsel.numerics.air_data import air_data_at_cg
from structsel.numerics.arrays import Array
from structsel.numerics.fourier_series import taper
from structsel.validation import BANDS
from structsel.validation.coefficient_tables import CoefficientTables, Windows

_SIMULATED = {"V": "CX", "alpha": "CZ", "beta": "CY", "p": "Cl", "q": "Cm", "r": "Cn", "phi": "Cl", "theta": "Cm"}
"""Channels that are simulated, in the order of the state, and the coefficient without which each is as recorded."""
_AIR = tuple(_SIMULATED)[:6]
_KINEMATIC = ("k_V", "k_alpha", "k_beta", "k_phi", "k_theta")
_RATES = (*COEFFICIENTS, *_KINEMATIC)
_PERIODS, _SHORTEST, _USUAL, _LONGEST = 2.0, 1.0, 2.0, 3.0  # short periods; s
_SIGMAS = 2.0
_LEAST_BAND = 0.01  # of the proof-of-match band
_DRAWN = 600  # samples


@dataclass(frozen=True, eq=False)
class PredictedCoefficients:
    """Coefficients that each stage predicts along one recording.

    Attributes
    ----------
    flight : Flight
    stages : mapping of stage to mapping of response to (n,) array
        Coefficients, and kinematic responses; those that are missing are taken as measured.
    """

    flight: Flight
    stages: Mapping[str, Mapping[str, Array]]


def simulate_held_out(ranking: Ranking) -> HeldOutSimulation:
    """Simulate the held-out recordings in windows, at all three stages.

    Parameters
    ----------
    ranking : Ranking

    Returns
    -------
    HeldOutSimulation
        Without rows and with the reason if there is nothing to simulate.
    """
    flights = ranking.problem.flights
    if not set(AIRFRAME) <= set(flights[0].channels) or not set(flights[0].simulated) & set(COEFFICIENTS):
        return HeldOutSimulation(
            reason="the simulation states no aerodynamic coefficients, from which the motion is computed"
        )
    predicted = list(predictions_by_stage(ranking))
    return simulate_stages(predicted, window_length([one.flight for one in predicted]))


def predictions_by_stage(ranking: Ranking) -> Iterator[PredictedCoefficients]:
    """Coefficients that each stage predicts for the held-out recordings, its parameters estimated on the others.

    A response is corrected if the correction predicts it better than the simulation as given. Mean values are those of
    the measurement at all stages, because biases differ between recordings. Without an effect there are two stages.
    """
    problem = ranking.problem
    plain, tuned = problem.as_given, problem.subset([])
    refitted = _better(judging.as_given(problem), judging.held_out(tuned))
    with_it = _better(judging.held_out(plain), judging.held_out(problem))
    for g, group in enumerate(problem.base.groups):
        for m in group:
            f = problem.flights[m]
            tuning = predicted_differences(tuned, g, m)
            added: dict[str, Mapping[str, Array]] = {
                "delivered": {},
                "refitted": {c: x for c, x in tuning.items() if c in refitted},
            }
            if problem.accepted:
                exact, tuned_too = predicted_differences(plain, g, m), predicted_differences(problem, g, m)
                added["physics"] = exact | {c: x for c, x in tuned_too.items() if c in with_it}
            yield PredictedCoefficients(f, {stage: _levelled(f, more) for stage, more in added.items()})


def _better(one: judging.Residuals, other: judging.Residuals) -> set[str]:
    """Responses whose residual is smaller in the other."""
    return {c for c in other[0] if judging.rms(other, c) < judging.rms(one, c)}


def predicted_differences(problem: DiagnosisProblem, g: int, m: int) -> dict[str, Array]:
    """Contribution of tolerances and effects to each response of flight m, estimated on the flights outside group g."""
    f = problem.flights[m]
    known = problem.base.scales[problem.base.chosen] * problem.base.solved[g + 1]
    parts = [{c: x * n.sd * column for c, column in n.columns[m].items()} for n, x in zip(problem.nuisances, known)]
    for k, s in enumerate(problem.accepted):
        theta = known[problem.place(k)] * np.array([p.sd for p in s.variant.parameters])
        parts.append(contribution(f, s.variant, theta))
    made: dict[str, Array] = {}
    for part in parts:
        for c, x in part.items():
            made[c] = made.get(c, 0.0) + x
    return made


def _levelled(flight: Flight, more: Mapping[str, Array]) -> dict[str, Array]:
    """Responses with additions, shifted to the mean of the measurement; the ends have little weight."""
    weight = taper(len(flight), edge_of(flight)) ** 2
    weight = weight / weight.sum()
    none = np.zeros(len(flight))
    predicted = {c: flight.simulated.get(c, none) + more.get(c, none) for c in flight.measured}
    return {c: x + weight @ (flight.measured[c] - x) for c, x in predicted.items()}


def window_length(flights: Sequence[Flight]) -> float:
    """Length of the windows [s]: two short periods of the simulation, at least 1 s and at most 3 s.

    The short period is that of the angle of attack alone, 2 pi (-qbar S cbar Cm_alpha / Iy)^-1/2 with the median of
    qbar Cm_alpha. Windows of 2 s are taken if it is unknown or unstable.
    """
    aircraft = flights[0].aircraft
    if aircraft.inertia is None:
        return _USUAL
    moment = np.concatenate([f["qbar"] * f.slope("Cm", "alpha") for f in flights])
    stiffness = -float(np.median(moment)) * aircraft.S * aircraft.cbar / aircraft.inertia.Iy
    if not stiffness > 0.0:
        return _USUAL
    return float(np.clip(_PERIODS * 2.0 * np.pi / np.sqrt(stiffness), _SHORTEST, _LONGEST))


def simulate_stages(predicted: Sequence[PredictedCoefficients], seconds: float) -> HeldOutSimulation:
    """Simulate windows of all recordings with the coefficients of each stage, from the smoothed recorded states.

    Parameters
    ----------
    predicted : sequence of PredictedCoefficients
        With the same stages and responses in all recordings.
    seconds : float
        Approximate length of a window; each recording is divided evenly.

    Returns
    -------
    HeldOutSimulation
        Without rows and with the reason if a window cannot be simulated to its end.
    """
    flights = [one.flight for one in predicted]
    windows = Windows.split([len(f) for f in flights], [f.dt for f in flights], seconds)
    aircraft = _with_inertia(flights[0])
    path = np.concatenate([[f.channels[c] for c in _SIMULATED] for f in flights], axis=1)
    read = np.concatenate([[f.raw.get(c, f.channels[c]) for c in _SIMULATED] for f in flights], axis=1)
    try:
        found = _tables(predicted, aircraft, path).simulate(windows)
    except DomainError as error:
        return HeldOutSimulation(reason=f"a window leaves the range of the equations of motion: {error}")
    if found is None:
        return HeldOutSimulation(reason="the simulation diverges within a window: its derivatives are unstable")
    stages = list(predicted[0].stages)
    sampled = np.arange(len(found)) <= windows.length[:, None]  # (windows, samples)
    sampled[:, 0] = False
    responses = set.intersection(*(set(one) for held in predicted for one in held.stages.values()))
    rows, errors = [], {}
    for j, (channel, own) in enumerate(_SIMULATED.items()):
        if own not in responses or not all(channel in f.recorded for f in flights):
            continue
        smoothed, readings = path[j, windows.sample], read[j, windows.sample]
        noise = rms_error(read[j], path[j])
        band = max(_SIGMAS * noise, _LEAST_BAND * BANDS[channel])
        start = found[0, j, 0][:, None]
        scores = {}
        for k, stage in enumerate(stages):
            simulated = found[:, j, k].T
            errors[channel, stage] = np.where(sampled, (simulated - smoothed) ** 2, 0.0).sum(axis=1)
            changes = (smoothed - start)[sampled], (simulated - start)[sampled]
            metrics = compute_metrics(*changes, undefined="nan")
            inside = float(np.mean(np.abs((simulated - readings)[sampled]) <= band))
            scores[stage] = WindowScore(metrics["rms_error"], metrics["tic"], inside)
        rows.append(ChannelScores(channel, unit_of(channel), noise, band, scores))
    made = HeldOutSimulation(tuple(rows), seconds, len(windows.start))
    if made.shown is None:
        return made
    best = made.shown.channel
    j = tuple(_SIMULATED).index(best)
    reduction = errors[best, stages[0]] - (errors[best, stages[-1]] if made.explains else 0.0)
    simulated_by_stage = {stage: found[:, j, k] for k, stage in enumerate(stages)}
    example = _example(flights, windows, (read[j], path[j]), simulated_by_stage, best, reduction)
    return replace(made, example=example)


def _with_inertia(flight: Flight) -> Aircraft:
    """The aircraft; if it has no moments of inertia, with arbitrary ones, which the recorded rotation does not need."""
    if flight.aircraft.inertia is not None:
        return flight.aircraft
    some = float(flight["mass"][0]) * flight.aircraft.b**2
    return flight.aircraft.model_copy(update={"inertia": Inertia(Ix=some, Iy=some, Iz=some)})


def _tables(predicted: Sequence[PredictedCoefficients], aircraft: Aircraft, path: Array) -> CoefficientTables:
    """Coefficients by stage, the recordings one behind another, along a path (8, n) as the instruments read it."""
    rates, environment, slopes = [], [], []
    for one in predicted:
        f, channels = one.flight, one.flight.channels
        missing = tuple(c for c in _RATES if not all(c in stage for stage in one.stages.values()))
        measured: dict[str, Array] = {}
        if missing:
            plain = {**channels, **f.raw, **{c: channels[c] for c in ("V", "alpha", "beta")}}
            plain |= {f"{c}_dot": f.rate(plain[c]) for c in "pqr"}
            measured = respond(plain, aircraft, f.dt, missing)
        rates.append(np.array([[measured.get(c, stage.get(c)) for stage in one.stages.values()] for c in _RATES]))
        environment.append([channels["rho"] * channels["qbar_ratio"], channels["mass"], channels["thrust"]])
        slopes.append([[np.broadcast_to(f.slope(c, x), len(f)) for x in _AIR] for c in COEFFICIENTS])
    joined = np.concatenate(rates, axis=2)
    V, alpha, beta, p, q, r = path[:6]
    at_cg = air_data_at_cg(V, alpha, beta, p, q, r, aircraft.position("vane"))
    return CoefficientTables(
        aircraft, joined[:6], joined[6:], np.concatenate(environment, axis=1), np.array([*at_cg, p, q, r]),
        path[6:], np.concatenate(slopes, axis=2),
    )  # fmt: skip


def _example(
    flights: Sequence[Flight],
    windows: Windows,
    recorded: tuple[Array, Array],
    simulated: Mapping[str, Array],
    channel: str,
    reduction: Array,
) -> ExampleWindows:
    """Windows of the recording in which the error of a channel decreases most, around the largest decrease.

    Without effects `reduction` is the error itself.
    """
    owner = int(np.argmax(np.bincount(windows.recording, reduction)))
    own = np.flatnonzero(windows.recording == owner)
    few = max(1, _DRAWN // int(windows.length.max()))
    first = int(np.argmax(reduction[own])) - few // 2
    own = own[max(0, min(first, len(own) - few)) :][:few]
    before = int(windows.start[windows.recording == owner][0])

    def joined(each: Sequence[Array], gap: bool = True) -> Array:
        return np.concatenate([np.append(x, np.nan if gap else x[-1]) for x in each])

    spans = [slice(windows.start[w], windows.start[w] + windows.length[w] + 1) for w in own]
    return ExampleWindows(
        flights[owner].name,
        channel,
        joined([flights[owner].t[s.start - before : s.stop - before] for s in spans], gap=False),
        joined([recorded[0][s] for s in spans]),
        joined([recorded[1][s] for s in spans]),
        {stage: joined([x[: windows.length[w] + 1, w] for w in own]) for stage, x in simulated.items()},
    )
