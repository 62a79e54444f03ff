"""diagnose(): what did the simulation leave out?"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from structsel.aircraft import Aircraft
from structsel.comparison.flight import Flight
from structsel.comparison.locating.ceiling import explainable
from structsel.comparison.locating.turbulence import (
    TurbulenceEstimate,
    find_turbulence,
    has_coloured_forces,
    turbulence_without_vanes,
)
from structsel.comparison.nuisance import Nuisance
from structsel.comparison.preparing import PreparedComparison, prepare
from structsel.comparison.simulations import require_simulation
from structsel.comparison.tolerances import tolerances_of
from structsel.deprecation import renamed_arguments
from structsel.diagnosis import judging
from structsel.diagnosis.assembling import make_findings
from structsel.diagnosis.detection import Detection, detect, detect_in_averages, isolated_residual
from structsel.diagnosis.material import find_material
from structsel.diagnosis.notes import notes
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.ranking import NAMED, Ranking, rank
from structsel.diagnosis.removed_delays import removed_delays
from structsel.diagnosis.residuals import residuals
from structsel.diagnosis.result import UNNAMED, Diagnosis, ToleranceDeviation, Verdict
from structsel.diagnosis.scoring import EffectScore
from structsel.diagnosis.selftest import self_test
from structsel.diagnosis.signatures import Library, work_out
from structsel.diagnosis.switching import with_proposals
from structsel.diagnosis.tracing import traces_of
from structsel.diagnosis.unattributed import detected, find_unknown, turbulent
from structsel.diagnosis.uncertain_names import less_probable, without_names
from structsel.diagnosis.weighing import CandidateEffect, unconfirmed_log_bayes
from structsel.effects import EFFECTS, Effect
from structsel.errors import DataError
from structsel.nomenclature import COEFFICIENTS, suggest
from structsel.recording import Recording
from structsel.recording.arguments import as_recordings, require_kind

Progress = Callable[[str, int, int], None]
_PARTS = 3  # of a single recording
_SHORTEST = 5.0  # s, of a part
_LISTED_DEVIATIONS = 8
_REPORTED = 3  # exceeded tolerances in the notes
_LISTED = 0.005  # fraction of the variance below which turbulence is not listed
_COLOURED = (
    "the residuals of all forces are coloured, and the response to the inputs does not confirm the effects that "
    "resemble them: noise of the instruments that lasts, or moving air that no vane feels. A small mismatch would not "
    "show"
)
_UNPREDICTED = 0.7  # residual over the measured rms, above which only a large effect would show


@renamed_arguments(hypotheses="effects")
@threadpool_limits.wrap(limits=1)  # many small products: threads of the linear algebra only wait for each other
def diagnose(
    simulation: Any,
    recordings: Sequence[Recording],
    aircraft: Aircraft | None = None,
    *,
    held_out: Sequence[str] = (),
    effects: Sequence[Effect] | None = None,
    without_effects: Sequence[str] = (),
    progress: Progress | None = None,
) -> Diagnosis:
    """Find the effects that a simulation lacks, with their times, probabilities and the gain on held-out recordings.

    Parameters
    ----------
    simulation : AeroModel, callable, str, Path or mapping
        In any of the five forms: see `structsel.comparison.simulations.open_simulation`.
    recordings : sequence of Recording
        One manoeuvre each.
    aircraft : Aircraft, optional
        With the tolerances of the simulation and the instruments. Not needed for plants, whose recordings have no
        channels of a flight.
    held_out : sequence of str
        Names of the validation recordings; by default each recording is held out in turn.
    effects : sequence of Effect, optional
        Effects that may be named; by default all of `structsel.effects.EFFECTS`.
    without_effects : sequence of str
        Names of effects that may not be named, to see the result without them.
    progress : callable, optional
        Called with the name of a step, the number of parts done, and the number of parts.

    Returns
    -------
    Diagnosis

    Raises
    ------
    DataError
        Names, clocks or channels do not match, there is nothing to compare, or an effect does not exist.
    ModelError
        The simulation cannot be opened.
    """
    begun = time.perf_counter()
    effects = but_without(effects, without_effects)
    call = "diagnose(simulation, recordings, aircraft)"
    recordings = as_recordings(recordings, call)
    require_simulation(simulation, call)
    if aircraft is not None:
        require_kind(aircraft, Aircraft, call)
    prepared = prepare(simulation, recordings, aircraft, progress, aligned=True, but_for=held_out)
    found = conclude(prepared, set_up(prepared.flights, effects, held_out, progress), held_out, progress)
    return replace(found, seconds=time.perf_counter() - begun)


def but_without(effects: Sequence[Effect] | None, names: Sequence[str]) -> tuple[Effect, ...]:
    """Effects, by default all, without the named ones.

    Raises
    ------
    DataError
        No effect has such a name.
    """
    effects = EFFECTS if effects is None else effects
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
    """Diagnosis of prepared flights and their problem (see `set_up`)."""
    # These import simulation, refinement and input design, which nothing before here needs.
    from structsel.diagnosis.held_out_simulation import simulate_held_out
    from structsel.diagnosis.modelling import corrected_model
    from structsel.diagnosis.separating import with_separation

    problem, library, turbulence = ready
    remarks = list(prepared.remarks)
    flights, responses = problem.flights, problem.judged_responses
    single, coloured = len(prepared.flights) == 1, False
    if single:
        remarks.append(
            f"there is one manoeuvre only: it was divided into {len(flights)} parts, and each was predicted from the "
            "others. A second manoeuvre would show whether the findings hold in other conditions"
        )

    def ask(scores: Sequence[EffectScore], candidates: Sequence[CandidateEffect]) -> Detection | None:
        """Detection of any mismatch; in averages, if turbulence or lasting noise causes motion and differences."""
        nonlocal turbulence, coloured
        if turbulence is None:
            left, unconfirmed = residuals(problem), unconfirmed_log_bayes(scores)
            turbulence = turbulence_without_vanes(flights, left, unconfirmed)
            coloured = turbulence is None and has_coloured_forces(flights, left, unconfirmed)
        moved = coloured or turbulence is not None
        return detect_in_averages(problem) if moved else detect(flights, problem, candidates)

    ranking = rank(problem, library, progress, ask)
    alone = isolated_residual(ranking.problem, ranking.start) if ranking.steps and turbulence is None else None
    if alone is not None and alone.probability > NAMED:
        ranking = without_names(ranking, alone)

    def ceiling(axes: Collection[str]) -> dict[str, float]:
        """Fraction of the mismatch that a regression model predicts, of those of the responses that are judged."""
        wanted = [c for c in responses if c in axes]
        return explainable(flights, [f.difference for f in flights], wanted) if wanted else {}

    findings = [with_separation(f, ranking) for f in make_findings(ranking, ceiling)]
    ranking = ranking.only({f.effect for f in findings})
    traces = traces_of(ranking)
    left = residuals(ranking.problem)
    if coloured:
        remarks.append(_COLOURED)
    elif turbulence is None:
        if findings:
            findings = find_material(ranking, findings)
        findings = less_probable(findings, alone) + find_unknown(ranking, left, responses, ceiling)
    if not findings:
        findings = detected(ranking, responses)
    if library.may_name("sensor-delay"):
        findings = [*removed_delays(prepared, responses), *findings]
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
    # In turbulence the deviations are those of the response to the inputs: gusts bias the others.
    seen = ranking.detection
    if seen is not None and (seen.averaged or not findings):
        deviations = _largest(seen.deviations)
    else:
        judged = (turbulence and ranking.input_only) or ranking.problem
        deviations = _largest(zip(judged.nuisances, *judged.deviations))
    remaining = _remaining(ranking, responses, {c for f in findings if f.effect == UNNAMED for c in f.axes})
    remarks += [*exceeded_notes(deviations), *notes(ranking), *unpredicted(remaining)]
    return Diagnosis(
        verdict,
        tuple(findings),
        dict(library.not_testable),
        remaining,
        deviations,
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
    """Problem of the flights or of the parts of a single one, the effects to test, and the turbulence."""
    parts = split_flight(flights[0]) if len(flights) == 1 else list(flights)
    groups = _groups([f.name for f in parts], held_out)
    tolerances = tolerances_of(parts)
    library = with_proposals(work_out(effects, parts, parts[0].responses, progress), parts, tolerances)
    problem = DiagnosisProblem.set_up(parts, library.signatures, groups, tolerances)
    return problem, library, find_turbulence(parts, residuals(problem))


def split_flight(flight: Flight) -> list[Flight]:
    """Parts of a single flight, which can be held out in turn.

    Raises
    ------
    DataError
        The flight is too short for two parts.
    """
    n = len(flight)
    parts = min(_PARTS, int(n * flight.dt / _SHORTEST)) if flight.simulated.keys() & set(COEFFICIENTS) else _PARTS
    if parts < 2:
        raise DataError(
            f"there is one manoeuvre, '{flight.name}', of {n * flight.dt:.1f} s: too short to "
            f"predict one part from another.\nGive several manoeuvres, or one of at least {2 * _SHORTEST:g} s."
        )
    edges = np.linspace(0, n, parts + 1).astype(int)
    names = [f"{flight.name}, part {k + 1}" for k in range(parts)]
    return [replace(flight.between(a, b, x), sequence=names[0]) for (a, b), x in zip(pairwise(edges), names)]


def _groups(names: Sequence[str], held_out: Sequence[str]) -> list[tuple[int, ...]] | None:
    if not held_out:
        return None
    missing = [h for h in held_out if h not in names]
    if missing:
        raise DataError(f"held-out recording '{missing[0]}' is not there; there are {', '.join(names)}.")
    if len(set(held_out)) == len(names):
        raise DataError("all recordings are held out; keep some to estimate parameters.")
    return [tuple(names.index(h) for h in dict.fromkeys(held_out))]


def _largest(deviations: Iterable[tuple[Nuisance, float, float]]) -> tuple[ToleranceDeviation, ...]:
    """Largest deviations of the parameters with a stated tolerance."""
    stated = [(n, float(x), float(std)) for n, x, std in deviations if n.effect]
    stated.sort(key=lambda one: -abs(one[1]))
    return tuple(
        ToleranceDeviation(n.name, x, x * n.sd, std * n.sd, n.unit) for n, x, std in stated[:_LISTED_DEVIATIONS]
    )


def _levels(problem: DiagnosisProblem, responses: Sequence[str]) -> dict[str, float]:
    """Constant part of the residual of each response, mean over the flights."""
    left_of = problem.held_out_residuals
    levels = {c: [x[r.part(c)][0] / r.weight[c][0] / np.sqrt(len(r.flight)) for r, x in left_of] for c in responses}
    return {c: float(np.mean(each)) for c, each in levels.items()}


def exceeded_notes(deviations: Sequence[ToleranceDeviation]) -> list[str]:
    """Notes on exceeded tolerances that no finding explains, the largest first."""
    return [
        f"'{p.name}' deviates by {p.deviations:+.1f} stated standard deviations, beyond its tolerance, and no "
        "effect is probable enough to explain this: check it first"
        for p in deviations[:_REPORTED]
        if p.is_exceeded
    ]


def unpredicted(remaining: Mapping[str, tuple[float, bool]]) -> list[str]:
    """Note on responses that are predicted badly: an effect in them would hardly show."""
    much = [f"{c} {left:.2f}" for c, (left, _) in remaining.items() if left > _UNPREDICTED]
    if not much:
        return []
    return [
        f"large residuals remain, relative to the measured rms: {', '.join(much)}. They are noise or differ between "
        "recordings; only an effect of similar size would show in these responses"
    ]


def _remaining(
    ranking: Ranking, responses: Sequence[str], unexplained: Collection[str]
) -> dict[str, tuple[float, bool]]:
    """Residual of each response over its measured rms, and whether it is white: not where a finding has no cause."""
    problem = ranking.problem
    after = judging.refitted(judging.held_out(problem.as_given), judging.held_out(problem))
    left = judging.fit(judging.measured(problem), after, responses)
    return {c: (left[c].rrmse, c not in unexplained and judging.is_noise(problem, c)) for c in responses if c in left}
