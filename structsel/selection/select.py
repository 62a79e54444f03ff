"""`select`: recordings and candidates in, a defended structure out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from structsel.candidates import Candidates, Term
from structsel.cluster import runner_of
from structsel.errors import SelectionError
from structsel.numerics import criteria
from structsel.numerics.passes import Passes
from structsel.recording import Recording, StoredRecording
from structsel.selection.checkpoint import Checkpoint
from structsel.selection.doubts import find_doubts
from structsel.selection.engine import Outcome, Progress, select_arrays
from structsel.selection.flown import Flight, Flown, look_over
from structsel.selection.identifiability import Alias, to_separate
from structsel.selection.options import (
    Components,
    Criterion,
    Estimate,
    Method,
    Options,
    Residuals,
    Start,
    Stop,
)
from structsel.selection.result import HeldOutPart, Selection, Selections, TraceStep

SPELLED_OUT = 12  # recordings of a part held out whose names are all given


def select(
    recordings: Flight | Sequence[Flight],
    responses: str | Sequence[str],
    candidates: Candidates,
    *,
    method: Method = "stepwise",
    residuals: Residuals = "coloured",
    F_in: float | Literal["auto", "fdr"] = 4.0,
    F_out: float | None = None,
    force: Iterable[Term | str] = (),
    start: Start = "empty",
    stop: Stop = "F",
    r2_change: float = 0.005,
    criterion: Criterion | None = None,
    sigma_max: Literal["response", "residual"] | float = "response",
    order: Literal["greedy", "given"] = "greedy",
    estimate: Estimate = "least_squares",
    components: Components = "variance",
    correlation_limit: float | None = None,
    max_terms: int | None = None,
    bootstrap: int = 200,
    max_order: int = 24,
    seed: int = 0,
    workers: int | None = None,
    progress: Progress | None = None,
    checkpoint: str | Path | None = None,
    client: Any = None,
) -> Selections:
    """Choose which candidate terms belong in the model of each response.

    Parameters
    ----------
    recordings : Recording or sequence of Recording
        One manoeuvre each, with the candidates' channels and the responses. Never joined: lags do not cross from
        one to the next, and each has its own residual colour. Those that `stream_recordings` lists are read one at a
        time, several times over: all of them need not fit in memory.
    responses : str or sequence of str
        ``"CZ"``, or several; all share one pass over the data.
    candidates : Candidates
        The pool. The constant is always in the model.
    method : {"stepwise", "orthogonal", "best_subset"}
        Modified stepwise regression by partial F [C89], [TP1916]; orthogonal functions minimising PSE [H17],
        [M95]; or the best model of every size, by branch and bound [FW74], for small pools.
    residuals : {"coloured", "robust", "white"}
        What tests and errors take the residuals to be. ``"coloured"``: noise that resembles its neighbours, an AR
        model for each recording, order by BIC, re-estimated until the structure settles; where that predicts
        unseen recordings clearly worse (so that the residual is misfit, not noise), ``"robust"`` is used instead,
        and said. ``"robust"``: anything; plain weighting, partial F from the scatter over blocks. ``"white"``: the
        rule of the sources. A disagreement with the last is always reported.
    F_in, F_out : float, "auto" or "fdr"
        Partial F to enter and to stay (F_in where F_out is absent). 12 is the sources' value [C89]; ``"auto"``
        keeps the chance of any false term near 5 % for this number of candidates; ``"fdr"`` keeps the share of
        false terms near 5 % [BG09].
    force : iterable of Term or str
        Terms always in.
    start : {"empty", "linear", "all"}
        What a stepwise search starts from: nothing, the linear terms [TP1916], or all terms [C89].
    stop : {"F", "R2", "PSE"}
        What besides F_in ends a stepwise search: a gain in R2 under ``r2_change``, or PSE no longer falling.
    criterion : {"PSE", "BIC", "AICc", "adj_R2", "manoeuvre"}, optional
        Choose, among the models the search visited, the one with the least PSE, BIC or AICc, the largest
        adjusted R2, or the least error in predicting left-out manoeuvres. By default F-tests decide for stepwise,
        PSE for orthogonal and BIC for best subset.
    sigma_max : {"response", "residual"} or float
        PSE's bound on the prediction error: the response's standard deviation [H17], five times the residual's,
        or a number in the response's units [M95]. Applied to the whitened response where residuals are coloured.
    order : {"greedy", "given"}
        Orthogonalise the most useful candidate next [M95], or in the order given and then rank [H17].
    estimate : {"least_squares", "principal_components", "ridge"}
        How the kept terms are estimated; the latter two are biased, labelled so, and meant for collinear terms.
    components : {"variance", "PSE", "manoeuvre"} or int
        Principal components used: enough for 99 % of the candidates' variance, those of least PSE, those that
        predict left-out manoeuvres best, or a number. Ridge's k is chosen by generalised cross-validation, or by
        left-out manoeuvres where ``"manoeuvre"``.
    correlation_limit : float, optional
        Drop the weaker of two kept terms whose parameters correlate above this [H17].
    max_terms : int, optional
    bootstrap : int
        Selections repeated on reweighted manoeuvres (from eight on) or blocks; 0 for none.
    max_order : int
        Highest AR order offered to the residual colour.
    seed, workers : int
        Of the bootstrap; threads, by default as many as the work is worth.
    progress : callable, optional
        Called with a stage's name, steps done and steps in all.
    checkpoint : str or Path, optional
        File in which results are kept as they come, and removed when all are there. A run that was broken off goes
        on where it was, if data and options are the same.
    client : distributed.Client, optional
        Of a Dask cluster, whose workers go through the recordings, one part each at a time; they must be able to
        read the files of `stream_recordings`. The answer is the one this process would give.

    Returns
    -------
    Selections
        A mapping from response to `Selection`; ``.model`` is the AeroModel.

    Raises
    ------
    ChannelError, DataError
        A channel is missing, not finite, or a response does not vary.
        The checkpoint belongs to something else, or cannot be read or written.
    SelectionError
        An option that cannot be meant, a forced term outside the pool, or more forced terms than samples; a cluster
        that lost every worker.

    References
    ----------
    [C89], [TP1916], [H17], [M95], [KM16] ch. 5.
    """
    given = locals()
    options = Options(**{f.name: given[f.name] for f in fields(Options)})
    flights = [recordings] if isinstance(recordings, Recording | StoredRecording) else list(recordings)
    wanted = [responses] if isinstance(responses, str) else list(responses)
    runner = runner_of(client)
    stored = any(isinstance(flight, StoredRecording) for flight in flights)
    told = (lambda done, of: progress("looking over", done, of)) if stored and progress is not None else None
    flown = look_over(flights, candidates, wanted, runner, (workers or 2) if stored else 1, told)
    forced = _positions(candidates, force)
    began = _start(candidates, start)
    signals = flown.signals(candidates, wanted)
    with _kept(checkpoint, flown, candidates.names, wanted, forced, replace(options, workers=None)) as memory:
        passes = Passes(runner, memory)
        outcomes = select_arrays(
            signals, candidates.exponents, options, forced, began, progress, scales=flown.scales, passes=passes
        )
    return Selections({r: _named(r, o, candidates, flown, options) for r, o in zip(wanted, outcomes)})


@contextmanager
def _kept(path: str | Path | None, flown: Flown, *asked: object) -> Iterator[Checkpoint | None]:
    """What remembers the passes within; its file is removed at the end, and left where there is an error."""
    if path is None:
        yield None
        return
    memory = Checkpoint(Path(path), flown.identity(*asked))
    try:
        yield memory
        memory.remove()
    finally:
        memory.release()


def _positions(candidates: Candidates, terms: Iterable[Term | str]) -> list[int]:
    found = []
    for term in [terms] if isinstance(terms, str | Term) else terms:
        value = Term(term) if isinstance(term, str) else term
        if value.is_constant:
            continue
        if value not in candidates:
            raise SelectionError(
                f"select is to force {value}, which is not among the {len(candidates)} candidates. "
                f"Add it: candidates + Candidates.parse(['{value}'])."
            )
        found.append(candidates.index(value))
    return found


def _start(candidates: Candidates, start: Start) -> list[int]:
    if start == "empty":
        return []
    return [i for i, t in enumerate(candidates) if start == "all" or t.degree == 1]


def _trace(outcome: Outcome, candidates: Candidates) -> tuple[TraceStep, ...]:
    found = outcome.found
    n = found.dof + 1.0
    steps = []
    for s in found.steps:
        rss = max(s.rss, 1e-28 * found.tss)
        steps.append(
            TraceStep(
                action=s.action,
                term=candidates[s.index],
                other=candidates[s.other] if s.other >= 0 else None,
                F=s.F,
                partial_r=s.partial_r,
                n_terms=s.n_terms,
                R2=1.0 - s.rss / found.tss,
                PSE=float(criteria.pse(rss, found.tss, n, s.n_terms)) / (found.tss / n),
                BIC=float(criteria.bic(rss, n, s.n_terms)),
            )
        )
    return tuple(steps)


def _held_out(outcome: Outcome, names: Sequence[str]) -> dict[str, Any]:
    held = outcome.held_out
    if held is None:
        return {"held_out": (), "held_out_r2": np.nan, "held_out_rms": np.nan}
    parts = []
    for i, (members, sse, tss, n) in enumerate(zip(held.parts, held.sse, held.tss, held.n)):
        if held.within:
            name = f"{names[0]}, part {i + 1} of {len(held.parts)}"
        elif len(members) > SPELLED_OUT:
            name = f"{names[members[0]]} to {names[members[-1]]}, {len(members)} recordings"
        else:
            name = ", ".join(names[k] for k in members)
        r2 = 1.0 - sse / tss if tss > 0 else np.nan
        parts.append(HeldOutPart(name, float(r2), float(np.sqrt(sse / n)), int(n)))
    return {"held_out": tuple(parts), "held_out_r2": held.r2, "held_out_rms": held.rms}


def _named(
    response: str,
    outcome: Outcome,
    candidates: Candidates,
    flown: Flown,
    options: Options,
) -> Selection:
    kept = list(outcome.found.selected)
    terms = tuple(candidates[i] for i in kept)
    aliases = tuple(
        Alias(
            candidates[a.kept],
            candidates[a.rival],
            a.loss,
            a.correlation,
            to_separate(candidates[a.kept], candidates[a.rival], flown),
        )
        for a in outcome.rivals
    )
    conditional = np.sqrt(np.maximum(np.diag(outcome.covariance), 0.0))
    errors, inclusion = conditional, {}
    if outcome.bootstrap is not None:
        errors = np.fmax(conditional, outcome.bootstrap.spread)
        inclusion = dict(zip(candidates.names, outcome.bootstrap.inclusion.tolist()))
    dof = max(outcome.n - len(kept) - 1, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        partial_F = outcome.values**2 / np.diag(outcome.covariance)
    used = {c for t in terms for c in t.channels}
    return Selection(
        response=response,
        terms=terms,
        values=outcome.values,
        covariance=outcome.covariance,
        textbook_errors=np.sqrt(np.maximum(np.diag(outcome.textbook), 0.0)),
        standard_errors=errors,
        inclusion=inclusion,
        partial_F=partial_F,
        vif=outcome.vif,
        conditioning=outcome.conditioning,
        condition=outcome.fit.condition,
        r2=outcome.r2,
        adjusted_r2=1.0 - (1.0 - outcome.r2) * (outcome.n - 1) / dof,
        rms=outcome.rms,
        n=outcome.n,
        **_held_out(outcome, flown.names),
        colours=outcome.colours,
        by_blocks=outcome.by_blocks,
        classical=tuple(candidates[i] for i in outcome.classical.selected),
        aliases=aliases,
        dependent=tuple(candidates[i] for i in outcome.dependent),
        trace=_trace(outcome, candidates),
        stopped=outcome.found.stopped,
        biased=bool(outcome.biased),
        estimated=outcome.biased or "least squares",
        pool=candidates,
        options=options,
        doubts=find_doubts(outcome, candidates, options, aliases),
        region={c: (flown.spread(c).low, flown.spread(c).high) for c in sorted(used)},
        recordings=flown.names,
        dt=flown.dt,
    )
