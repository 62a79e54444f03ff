"""`select`: recordings and candidates in, a defended structure out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from structsel.candidates import Candidates, Term
from structsel.cluster import runner_of
from structsel.deprecation import renamed_arguments
from structsel.errors import SelectionError
from structsel.numerics import criteria
from structsel.numerics.passes import Passes
from structsel.options import takes_options
from structsel.recording import Recording, StoredRecording
from structsel.selection.checkpoint import Checkpoint
from structsel.selection.doubts import find_doubts
from structsel.selection.engine import Outcome, Progress, select_arrays
from structsel.selection.flown import Flight, Flown, look_over
from structsel.selection.identifiability import Alias, to_separate
from structsel.selection.result import HeldOutPart, Selection, Selections, TraceStep
from structsel.selection.settings import RENAMED_ARGUMENTS, InitialTerms, SelectOptions

SPELLED_OUT = 12  # recordings of a part held out whose names are all given


@renamed_arguments(**RENAMED_ARGUMENTS)
@takes_options(SelectOptions)
def select(
    recordings: Flight | Sequence[Flight],
    responses: str | Sequence[str],
    candidates: Candidates,
    *,
    options: SelectOptions,
    include: Iterable[Term | str] = (),
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
        Of a Dask cluster, whose workers read the recordings, one part each at a time; they must be able to read the
        files of `stream_recordings`. The result is that of this process.

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
        An invalid option, an included term outside the pool, more included terms than samples, or a cluster that
        lost every worker.

    References
    ----------
    [C89], [TP1916], [H17], [M95], [KM16] ch. 5.
    """
    flights = [recordings] if isinstance(recordings, Recording | StoredRecording) else list(recordings)
    wanted = [responses] if isinstance(responses, str) else list(responses)
    runner = runner_of(client)
    stored = any(isinstance(flight, StoredRecording) for flight in flights)
    told = (lambda done, of: progress("looking over", done, of)) if stored and progress is not None else None
    flown = look_over(flights, candidates, wanted, runner, (options.workers or 2) if stored else 1, told)
    forced = _positions(candidates, include)
    began = _start(candidates, options.initial_terms)
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
                f"select is to include {value}, which is not among the {len(candidates)} candidates. "
                f"Add it: candidates + Candidates.parse(['{value}'])."
            )
        found.append(candidates.index(value))
    return found


def _start(candidates: Candidates, start: InitialTerms) -> list[int]:
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
    options: SelectOptions,
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
