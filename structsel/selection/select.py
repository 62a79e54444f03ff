"""`select`: recordings and candidates in, a defended structure out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from structsel.candidates import Candidates, Term
from structsel.deprecation import renamed_arguments
from structsel.errors import ArgumentError, SelectionError
from structsel.nomenclature import BODY_RATES, COEFFICIENTS, CONTROL_SURFACES, FLOW_ANGLES
from structsel.numerics import criteria
from structsel.numerics.blocks import JobRunner
from structsel.numerics.past_data import SIGNAL_LAGS
from structsel.options import takes_options
from structsel.recording import StoredRecording, warn_of_entry_errors
from structsel.recording.arguments import as_recordings, require_names
from structsel.selection.array_selection import ArraySelection
from structsel.selection.causal import LONGEST_LAG
from structsel.selection.checkpoint import Checkpoint
from structsel.selection.choices import NO_FLOW_ANGLES, FlowAngles
from structsel.selection.data import AnyRecording, DataSummary, RecordingData, summarise_recordings
from structsel.selection.diagnostics import Alias, find_warnings, to_separate
from structsel.selection.engine import Progress, select_arrays
from structsel.selection.result import Selection
from structsel.selection.selections import Selections
from structsel.selection.settings import RENAMED_ARGUMENTS, InitialTerms, SelectOptions
from structsel.selection.trace import HeldOutPart, TraceStep

if TYPE_CHECKING:
    import pandas as pd

_CALL = "select(recordings, responses, candidates)"
_MOTION = (*FLOW_ANGLES, *BODY_RATES, *CONTROL_SURFACES)
SPELLED_OUT = 12  # recordings of a part held out whose names are all given


@renamed_arguments(**RENAMED_ARGUMENTS)
@takes_options(SelectOptions)
def select(
    recordings: AnyRecording | pd.DataFrame | Sequence[AnyRecording | pd.DataFrame],
    responses: str | Sequence[str],
    candidates: Candidates | Iterable[Term | str],
    *,
    options: SelectOptions,
    include: Iterable[Term | str] = (),
    progress: Progress | None = None,
    checkpoint: str | Path | None = None,
    client: Any = None,
) -> Any:
    """Choose which candidate terms belong in the model of each response.

    Parameters
    ----------
    recordings : Recording, DataFrame, or sequence of these
        One manoeuvre each, with the candidates' channels and the responses. Never joined: lags do not cross from
        one to the next, and each has its own noise model. Those that `stream_recordings` lists are read one at a
        time, several times over: all of them need not fit in memory. A DataFrame has a column ``t`` and is in SI units
        and radians; see `Recording.from_frame` for others.
    responses : str or sequence of str
        ``"CZ"``, or several; all need one pass over the data.
    candidates : Candidates, or iterable of Term or str
        The pool; ``["alpha", "alpha^2", "de"]`` is read as by `Candidates.parse`. The constant is always in the model.
    options : SelectOptions, optional
        Every field may be given as a keyword of its own instead: ``select(..., method="orthogonal", bootstrap=0)``.
    include : iterable of Term or str
        Terms always in the model.
    progress : callable, optional
        Called with a stage's name, steps done and steps in all.
    checkpoint : str or Path, optional
        File for the results of the passes over the data; removed when the selection is complete. An interrupted
        run continues after its last complete pass, if data and options are the same.
    client : distributed.Client, optional
        Of a Dask cluster, whose workers read the recordings part by part; they must be able to read the files of
        `stream_recordings`. The result is that of this process.

    Returns
    -------
    Selection or Selections
        The `Selection` of one response given as text; for a sequence of responses, a mapping from each to its
        `Selection`. ``.model`` is the AeroModel.

    Raises
    ------
    ArgumentError
        The recordings, responses or candidates are objects of another type.
    ChannelError, DataError
        A channel is missing, not finite, or a response does not vary.
        The checkpoint belongs to something else, or cannot be read or written.
    SelectionError
        An invalid option, an included term outside the pool, more included terms than samples, or a cluster that
        lost every worker.

    References
    ----------
    [C89], [TP1916], [H17], [M95], [KM16] ch. 5.
    """
    given = as_recordings(recordings, _CALL)
    candidates = _as_candidates(candidates)
    wanted = require_names(responses, _CALL)
    warn_of_entry_errors(given, stacklevel=5)
    stored = any(isinstance(recording, StoredRecording) for recording in given)
    checking = (lambda done, of: progress("checking", done, of)) if stored and progress is not None else None
    workers = (options.workers or 2) if stored else 1
    data = summarise_recordings(given, candidates, wanted, JobRunner(client), workers, checking)
    included = _positions(candidates, include)
    asked = (candidates.names, wanted, included, replace(options, workers=None))
    with _checkpoint(checkpoint, data, *asked) as store:
        found = select_arrays(
            data.sources(candidates, wanted),
            candidates.exponents,
            options,
            included,
            _initial(candidates, options.initial_terms),
            progress,
            scales=data.scales,
            runner=JobRunner(client, store),
            companions=_companions(data, candidates, wanted) if options.rows_may_be_causal else [],
            flow_angles=_flow_angles(data, candidates, wanted) if options.rows_may_be_causal else NO_FLOW_ANGLES,
        )
    named = {r: _named(r, one, candidates, data, options, tuple(given)) for r, one in zip(wanted, found)}
    return named[responses] if isinstance(responses, str) else Selections(named)


def _as_candidates(given: Any) -> Candidates:
    """Candidates, also from terms or their names.

    Raises
    ------
    ArgumentError
        It is something else.
    """
    if isinstance(given, Candidates):
        return given
    terms = list(given) if isinstance(given, Iterable) and not isinstance(given, str | bytes) else [None]
    if not all(isinstance(term, str | Term) for term in terms):
        raise ArgumentError(
            f"select needs candidate terms, and was given {given!r:.60}.",
            remedy='Pass Candidates.polynomial(["alpha", "de"], 2), or a list such as ["alpha", "alpha^2", "de"].',
        )
    return Candidates.parse([str(term) for term in terms])


@contextmanager
def _checkpoint(path: str | Path | None, data: DataSummary, *asked: object) -> Iterator[Checkpoint | None]:
    """The file with the results of passes; removed at the end, and left where there is an error."""
    if path is None:
        yield None
        return
    checkpoint = Checkpoint(Path(path), data.fingerprint(*asked))
    try:
        yield checkpoint
        checkpoint.remove()
    finally:
        checkpoint.release()


def _companions(data: DataSummary, candidates: Candidates, wanted: Sequence[str]) -> list[RecordingData]:
    """The recordings with the other coefficients, where all have them; empty where there are none."""
    others = [name for name in COEFFICIENTS if name not in wanted and name not in candidates.channels]
    others = data.complete(others)
    return data.sources(candidates, others) if others else []


def _flow_angles(data: DataSummary, candidates: Candidates, wanted: Sequence[str]) -> FlowAngles:
    """The recordings with the flow angles that they have, and the rates and surfaces whose past predicts these.

    None where the instruments' lags are long for the aircraft.
    """
    if SIGNAL_LAGS[0] * data.dt > LONGEST_LAG:
        return NO_FLOW_ANGLES
    further = data.complete([name for name in _MOTION if name not in candidates.channels])
    signals = candidates + Candidates.parse(further) if further else candidates
    positions = tuple(i for i, factor in enumerate(signals.base) if str(factor) in FLOW_ANGLES)
    return FlowAngles(data.sources(signals, wanted[:1]), positions, None if further else data.scales)


def _positions(candidates: Candidates, terms: Iterable[Term | str]) -> list[int]:
    found = []
    for term in [terms] if isinstance(terms, str | Term) else terms:
        value = Term(term) if isinstance(term, str) else term
        if value.is_constant:
            continue
        if value not in candidates:
            raise SelectionError(
                f"select is to include {value}, which is not among the {len(candidates)} candidates. "
                f"Add it: candidates + Candidates.parse(['{value}'])."
            )
        found.append(candidates.index(value))
    return found


def _initial(candidates: Candidates, initial_terms: InitialTerms) -> list[int]:
    if initial_terms == "empty":
        return []
    return [i for i, t in enumerate(candidates) if initial_terms == "all" or t.degree == 1]


def _trace(found: ArraySelection, candidates: Candidates) -> tuple[TraceStep, ...]:
    search = found.search
    n = search.dof + 1.0
    steps = []
    for s in search.steps:
        rss = max(s.rss, 1e-28 * search.tss)
        steps.append(
            TraceStep(
                action=s.action,
                term=candidates[s.index],
                other=candidates[s.other] if s.other >= 0 else None,
                F=s.F,
                partial_r=s.partial_r,
                n_terms=s.n_terms,
                R2=1.0 - s.rss / search.tss,
                PSE=float(criteria.pse(rss, search.tss, n, s.n_terms)) / (search.tss / n),
                BIC=float(criteria.bic(rss, n, s.n_terms)),
            )
        )
    return tuple(steps)


def _held_out(found: ArraySelection, names: Sequence[str]) -> dict[str, Any]:
    held = found.cross_validation
    if held is None:
        return {"held_out": (), "held_out_r2": np.nan, "held_out_rms": np.nan}
    parts = []
    for i, (members, sse, tss, n) in enumerate(zip(held.folds, held.sse, held.tss, held.n)):
        if held.within:
            name = f"{names[0]}, part {i + 1} of {len(held.folds)}"
        elif len(members) > SPELLED_OUT:
            name = f"{names[members[0]]} to {names[members[-1]]}, {len(members)} recordings"
        else:
            name = ", ".join(names[k] for k in members)
        r2 = 1.0 - sse / tss if tss > 0 else np.nan
        parts.append(HeldOutPart(name, float(r2), float(np.sqrt(sse / n)), int(n)))
    return {"held_out": tuple(parts), "held_out_r2": held.r2, "held_out_rms": held.rms}


def _standard_errors(found: ArraySelection) -> tuple[np.ndarray, np.ndarray]:
    """Standard errors (1 + k,), and the degrees of freedom of each.

    Those given the terms are widened by disagreement between manoeuvres; they are at least the scatter of the resampled
    values. A constant that is a mean of the manoeuvres' own has the standard error of such a mean. What is added is
    known from as many values as there are manoeuvres, or resampled units; by Satterthwaite's approximation::

        dof = (v + w)^2 / (v^2 / (n - k) + w^2 / (u - 1)),    v given the terms, w added, u manoeuvres or units
    """
    given = np.maximum(np.diag(found.covariance), 0.0)
    added, units = np.zeros(given.size), np.full(given.size, 2.0)
    if found.heterogeneity is not None:
        added[1:] = found.heterogeneity.added_variance
        units[:] = found.heterogeneity.deviation.shape[1]
    if found.bootstrap is not None:
        scatter = np.nan_to_num(found.bootstrap.std**2 - given)
        units = np.where(scatter > added, found.bootstrap.units, units)
        added = np.maximum(added, scatter)
    if found.constants.size > 1:
        between = float(np.var(found.constants, ddof=1)) / found.constants.size - given[0]
        if between > added[0]:
            added[0], units[0] = between, found.constants.size
    total = given + added
    free = max(found.n - given.size + 1 - max(found.constants.size, 1), 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        dof = total**2 / (given**2 / free + added**2 / np.maximum(units - 1.0, 1.0))
    return np.sqrt(total), np.where(total > 0.0, dof, free)


def _named(
    response: str,
    found: ArraySelection,
    candidates: Candidates,
    data: DataSummary,
    options: SelectOptions,
    recordings: tuple[AnyRecording, ...],
) -> Selection:
    kept = list(found.search.selected)
    terms = tuple(candidates[i] for i in kept)
    aliases = tuple(
        Alias(
            candidates[a.kept],
            candidates[a.other],
            a.loss,
            a.correlation,
            to_separate(candidates[a.kept], candidates[a.other], data),
        )
        for a in found.aliases
    )
    (errors, error_dof), inclusion, probability = _standard_errors(found), {}, {}
    if found.bootstrap is not None:
        inclusion = dict(zip(candidates.names, found.bootstrap.inclusion.tolist()))
        probability = dict(zip(candidates.names, found.bootstrap.probability.tolist()))
    dof = max(found.n - len(kept) - max(found.constants.size, 1), 1)
    textbook_errors = np.sqrt(np.maximum(np.diag(found.white_noise_covariance), 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        partial_F = (found.values / errors) ** 2
    if found.biased:  # both are those of least squares
        textbook_errors, partial_F = np.full((2, errors.size), np.nan)
    used = {c for t in terms for c in t.channels}
    return Selection(
        response=response,
        terms=terms,
        values=found.values,
        covariance=found.covariance,
        textbook_errors=textbook_errors,
        standard_errors=errors,
        error_dof=error_dof,
        inclusion=inclusion,
        probability=probability,
        partial_F=partial_F,
        vif=found.vif,
        conditioning=found.conditioning,
        condition=found.fit.condition,
        r2=found.r2,
        adjusted_r2=1.0 - (1.0 - found.r2) * (found.n - 1) / dof,
        rms=found.rms,
        n=found.n,
        **_held_out(found, data.names),
        linear_held_out_r2=found.linear.r2 if found.linear is not None else np.nan,
        constants=dict(zip(data.names, found.constants.tolist())),
        noise_models=found.noise,
        cluster_robust=found.cluster_robust,
        rows="causal" if found.causal else "sampled",
        classical=tuple(candidates[i] for i in found.white_noise.selected),
        aliases=aliases,
        dependent=tuple(candidates[i] for i in found.dependent),
        trace=_trace(found, candidates),
        stop_reason=found.search.stop_reason,
        biased=bool(found.biased),
        estimator=found.biased or "least squares",
        pool=candidates,
        options=options,
        doubts=find_warnings(found, candidates, options, aliases, data.names),
        region={c: (data.statistics(c).low, data.statistics(c).high) for c in sorted(used)},
        recordings=data.names,
        dt=data.dt,
        data=recordings,
    )
