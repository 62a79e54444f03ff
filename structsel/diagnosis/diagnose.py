"""diagnose(): what did the simulation leave out?"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from structsel.aircraft import Aircraft
from structsel.comparison.flight import Flight
from structsel.comparison.locating.ceiling import explainable
from structsel.comparison.locating.turbulence import TurbulenceEstimate, find_turbulence, turbulence_without_vanes
from structsel.comparison.preparing import PreparedComparison, prepare
from structsel.comparison.simulations import require_simulation
from structsel.comparison.tolerances import Nuisance
from structsel.deprecation import renamed_arguments
from structsel.diagnosis import judging
from structsel.diagnosis.assembling import make_findings
from structsel.diagnosis.detection import Detection, detect
from structsel.diagnosis.notes import notes
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.ranking import Ranking, rank
from structsel.diagnosis.residuals import residuals
from structsel.diagnosis.result import Diagnosis, Pull, Verdict
from structsel.diagnosis.scoring import EffectScore
from structsel.diagnosis.selftest import self_test
from structsel.diagnosis.signatures import Library, work_out
from structsel.diagnosis.tracing import traces_of
from structsel.diagnosis.unattributed import detected, find_unknown, turbulent
from structsel.diagnosis.weighing import unconfirmed_log_bayes
from structsel.effects import EFFECTS, Effect
from structsel.errors import DataError
from structsel.nomenclature import COEFFICIENTS, suggest
from structsel.recording import Recording
from structsel.recording.arguments import as_recordings, require_kind

Progress = Callable[[str, int, int], None]
_PARTS = 3
_SHORTEST = 5.0  # s, of a part
_HARDEST = 8  # tolerances listed
_SAID = 3  # of tolerances pulled further than any is, in remarks
_LISTED = 0.005  # share of the variance, below which turbulence explains nothing
_DROWNED = 0.7  # of the rms measured, that is left: what a simulation lacks would have to be large to show


@renamed_arguments(hypotheses="effects")
@threadpool_limits.wrap(limits=1)  # many small products: threads of the linear algebra only wait for each other
def diagnose(
    simulation: Any,
    recordings: Sequence[Recording],
    aircraft: Aircraft | None = None,
    *,
    held_out: Sequence[str] = (),
    effects: Sequence[Effect] = EFFECTS,
    without_effects: Sequence[str] = (),
    progress: Progress | None = None,
) -> Diagnosis:
    """Locate what a simulation leaves out, say which physics it is, and show the gain on other recordings.

    Parameters
    ----------
    simulation : AeroModel, callable, str, Path or mapping
        In any of the five forms: see `structsel.comparison.simulations.open_simulation`.
    recordings : sequence of Recording
        One manoeuvre each.
    aircraft : Aircraft, optional
        Not needed for plants, whose recordings have no channels of a flight.
        With the tolerances of the simulation and the instruments.
    held_out : sequence of str
        Names of recordings to judge by; by default each is held out in turn.
    effects : sequence of Effect
        The physics that may be named.
    without_effects : sequence of str
        Names of effects that may not be named, for one to ask what would be said if the library lacked them.
    progress : callable, optional
        Called with what is done, how much of it, and of how much.

    Returns
    -------
    Diagnosis

    Raises
    ------
    DataError
        Names, clocks or channels that do not match, or nothing to compare; an effect that is not there.
    ModelError
        A simulation that cannot be opened.
    """
    begun = time.perf_counter()
    effects = but_without(effects, without_effects)
    call = "diagnose(simulation, recordings, aircraft)"
    recordings = as_recordings(recordings, call)
    require_simulation(simulation, call)
    if aircraft is not None:
        require_kind(aircraft, Aircraft, call)
    prepared = prepare(simulation, recordings, aircraft, progress)
    found = conclude(prepared, set_up(prepared.flights, effects, held_out, progress), held_out, progress)
    return replace(found, seconds=time.perf_counter() - begun)


def but_without(effects: Sequence[Effect], names: Sequence[str]) -> tuple[Effect, ...]:
    """Effects except the named ones.

    Raises
    ------
    DataError
        No effect has such a name.
    """
    known = [e.name for e in effects]
    if unknown := [name for name in names if name not in known]:
        raise DataError(f"there is no effect '{unknown[0]}' to leave out.{suggest(unknown[0], known)}")
    return tuple(e for e in effects if e.name not in names)


@threadpool_limits.wrap(limits=1)
def conclude(
    prepared: PreparedComparison,
    ready: tuple[DiagnosisProblem, Library, TurbulenceEstimate | None],
    held_out: Sequence[str] = (),
    progress: Progress | None = None,
) -> Diagnosis:
    """Diagnosis of flights that are prepared and set up (see `set_up`)."""
    # These import simulation, refinement and input design, which nothing before here needs.
    from structsel.diagnosis.held_out_simulation import simulate_held_out
    from structsel.diagnosis.modelling import corrected_model
    from structsel.diagnosis.separating import with_separation

    problem, library, turbulence = ready
    remarks = list(prepared.remarks)
    flights, responses = problem.flights, problem.judged_responses
    single = len(prepared.flights) == 1
    if single:
        remarks.append(
            f"there is one manoeuvre only: it was judged by its {len(flights)} parts, which share its conditions. What "
            "is found may hold here alone; a second manoeuvre would show"
        )

    def ask(scores: Sequence[EffectScore]) -> Detection | None:
        """A mismatch of any kind, in calm air: in rough air the differences move the aircraft."""
        nonlocal turbulence
        if turbulence is None:
            turbulence = turbulence_without_vanes(flights, residuals(problem), unconfirmed_log_bayes(scores))
        return None if turbulence is not None else detect(flights, problem, prepared.simulation.form == "free")

    ranking = rank(problem, library, progress, ask)
    # The learners take a second, and a simulation that lacks nothing does not need them.
    ceiling = cache(lambda: explainable(flights, [{c: f.difference[c] for c in responses} for f in flights]))
    traces = traces_of(ranking)
    left = residuals(ranking.problem)
    findings = [with_separation(f, ranking) for f in make_findings(ranking, ceiling() if ranking.steps else {})]
    if turbulence is None:
        findings += find_unknown(ranking, left, responses, ceiling)
        if not findings:
            findings += detected(ranking, responses)
    verdict: Verdict = "mismatch" if findings else "consistent"
    if single and findings:
        verdict = "undecidable"
    if ranking.steps:
        turbulence = find_turbulence(flights, left)
    if turbulence is not None and turbulence.explained > _LISTED:
        findings.append(turbulent(turbulence, ranking, responses))
    replayed = simulate_held_out(ranking)
    corrected = corrected_model(prepared, ranking) if ranking.steps else None
    remarks += corrected.remarks if corrected is not None else ()
    # Where gusts push the aircraft about, tolerances are pulled by what follows its motion; not by what inputs drive.
    if ranking.detection is not None and not findings:
        pulls = _pulls(ranking.detection.deviations)
    else:
        judged = (turbulence and ranking.input_only) or ranking.problem
        pulls = _pulls(zip(judged.nuisances, *judged.deviations))
    remaining = _remaining(ranking, responses)
    remarks += [*strained(pulls), *notes(ranking), *unpredicted(remaining)]
    return Diagnosis(
        verdict,
        tuple(findings),
        dict(library.not_testable),
        remaining,
        pulls,
        tuple(remarks),
        prepared.simulation.form,
        tuple(responses),
        tuple(f.name for f in prepared.flights),
        tuple(held_out),
        prepared.simulation.model if corrected is None else corrected,
        traces,
        self_test(ranking.start, library),
        replayed=replayed,
        considered=1.0 - dict(ranking.considered)["nothing"],
        levels=_levels(ranking.problem, responses),
    )


def set_up(
    flights: Sequence[Flight],
    effects: Sequence[Effect] = EFFECTS,
    held_out: Sequence[str] = (),
    progress: Progress | None = None,
) -> tuple[DiagnosisProblem, Library, TurbulenceEstimate | None]:
    """Bench of flights, or of the parts of a single one; what can be tried there; and whether the air was rough."""
    parts = split_flight(flights[0]) if len(flights) == 1 else list(flights)
    groups = _groups([f.name for f in parts], held_out)
    library = work_out(effects, parts, parts[0].responses, progress)
    problem = DiagnosisProblem.set_up(parts, library.signatures, groups)
    return problem, library, find_turbulence(parts, residuals(problem))


def split_flight(flight: Flight) -> list[Flight]:
    """Parts of a single flight, so that some of it can be held out.

    Raises
    ------
    DataError
        It is too short for two parts.
    """
    n = len(flight)
    parts = min(_PARTS, int(n * flight.dt / _SHORTEST)) if flight.simulated.keys() & set(COEFFICIENTS) else _PARTS
    if parts < 2:
        raise DataError(
            f"there is one manoeuvre, '{flight.name}', of {n * flight.dt:.1f} s: too short to judge one part by "
            f"another.\nGive several manoeuvres, or one of at least {2 * _SHORTEST:g} s."
        )
    edges = np.linspace(0, n, parts + 1).astype(int)
    return [flight.between(a, b, f"{flight.name}, part {k}") for k, (a, b) in enumerate(pairwise(edges), 1)]


def _groups(names: Sequence[str], held_out: Sequence[str]) -> list[tuple[int, ...]] | None:
    if not held_out:
        return None
    missing = [h for h in held_out if h not in names]
    if missing:
        raise DataError(f"held-out recording '{missing[0]}' is not there; there are {', '.join(names)}.")
    if len(set(held_out)) == len(names):
        raise DataError("all recordings are held out; leave some to find parameters from.")
    return [tuple(names.index(h) for h in dict.fromkeys(held_out))]


def _pulls(deviations: Iterable[tuple[Nuisance, float, float]]) -> tuple[Pull, ...]:
    """The largest deviations from stated values; what no tolerance is stated for is not among them."""
    stated = [(n, float(x), float(std)) for n, x, std in deviations if n.effect]
    stated.sort(key=lambda one: -abs(one[1]))
    return tuple(Pull(n.name, x, x * n.sd, std * n.sd, n.unit) for n, x, std in stated[:_HARDEST])


def _levels(problem: DiagnosisProblem, responses: Sequence[str]) -> dict[str, float]:
    """Constant part of what is left of each response, mean over the flights."""
    left_of = problem.held_out_residuals
    levels = {c: [x[r.part(c)][0] / r.weight[c][0] / np.sqrt(len(r.flight)) for r, x in left_of] for c in responses}
    return {c: float(np.mean(each)) for c, each in levels.items()}


def strained(pulls: Sequence[Pull]) -> list[str]:
    """Remarks on tolerances pulled further than any is, hardest first: what was found does not account for them."""
    return [
        f"'{p.name}' is pulled {p.deviations:+.1f} of its stated standard deviations, which is more than a tolerance; "
        "no effect was likely enough to be named for it; look there first"
        for p in pulls[:_SAID]
        if p.is_strained
    ]


def unpredicted(remaining: Mapping[str, tuple[float, bool]]) -> list[str]:
    """A remark on responses of which little was foretold: in them hardly anything could be seen to be missing."""
    much = [f"{c} {left:.2f}" for c, (left, _) in remaining.items() if left > _DROWNED]
    if not much:
        return []
    return [
        f"most of what was measured is not foretold, of its rms {', '.join(much)} is left: noise, or what does not "
        "come back on other recordings. What the simulation lacks there would have to be as large to show"
    ]


def _remaining(ranking: Ranking, responses: Sequence[str]) -> dict[str, tuple[float, bool]]:
    problem = ranking.problem
    after = judging.refitted(judging.held_out(problem.as_given), judging.held_out(problem))
    left = judging.fit(judging.measured(problem), after, responses)
    return {c: (left[c].rrmse, judging.is_noise(problem, c)) for c in responses if c in left}
