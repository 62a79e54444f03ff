"""``structsel select``: which terms belong in the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from structsel.candidates import Candidates
from structsel.cli.comparison_tables import summarise_methods
from structsel.cli.flights import (
    OUTPUT,
    V0,
    AircraftFile,
    Files,
    Json,
    Map,
    Overwrite,
    Plots,
    Reconstruct,
    hold_out,
    option,
    read_flights,
    words,
)
from structsel.cli.output import refuse_existing
from structsel.cli.pages import page
from structsel.cli.results import write_results
from structsel.cli.streaming import CheckpointFile, Stream, checkpoint_file, stream_flights, to_show, to_stream
from structsel.cli.tables import print_files, print_summary
from structsel.cli.terminal import Waiting, explain, print_json, say, stdout
from structsel.errors import SelectionError
from structsel.recording import Recording, StoredRecording
from structsel.selection import Selections, select
from structsel.selection.methods import METHODS
from structsel.selection.result import COLUMN_NOTES
from structsel.selection.settings import Criterion, Estimate, InitialTerms, Noise, StoppingRule
from structsel.validation import Validation, validate

EPILOG = page(
    [
        (
            "From raw recordings, two of them kept aside",
            "structsel select flights/ --map map.toml --aircraft aircraft.toml \\\n"
            "    --responses CZ,Cm --candidates alpha,q_hat,de --degree 3 \\\n"
            "    --held-out m05,m06 --out out/",
        ),
        (
            "Splines, included terms, an entry threshold fit for the pool, and why",
            "structsel select coefficients/ --responses Cm --candidates alpha,q_hat,de \\\n"
            "    --degree 2 --spline alpha:0.2,0.25 --include alpha,de --f-in auto --trace",
        ),
        (
            "Every method side by side",
            "structsel select coefficients/ --responses CX --candidates alpha,q_hat,de \\\n    --degree 3 --method all",
        ),
        (
            "A table for a paper",
            "structsel select coefficients/ --responses CX \\\n    --terms 'alpha,alpha^2,q_hat,de' --latex > CX.tex",
        ),
    ],
    """[bold]Terms[/bold] are products of powers, alpha^2*de, of channels, offsets (alpha - 0.1), splines
    (alpha - 0.2)+,
    and abs, sign, sqrt, sin, cos, tan, exp, log, tanh, step of formulas. The constant is always in the model.""",
    """[bold]Instruments[/bold] have biases, and vanes stand in disturbed air: --reconstruct takes that out first, with
    the defaults of structsel reconstruct, which shows what was found and should be run by itself once.""",
    """[bold]Doubts[/bold] stand under each table, marked !: read them before the numbers.""",
)

_POOL, _SEARCH, _JUDGE, _OUTPUT, _FINE = (
    "Candidate terms",
    "The search",
    "How sure it is",
    OUTPUT,
    "Fine tuning",
)


def run(
    files: Files,
    responses: Annotated[
        str, option("--responses", "What to model: CX to Cn, CL, CD, or any channel.", metavar="NAMES")
    ],
    channel_map: Map = None,
    aircraft: AircraftFile = None,
    reconstruct: Reconstruct = False,
    v0: V0 = None,
    candidates: Annotated[
        str, option("--candidates", "Channels whose monomials are the pool: alpha,q_hat,de", _POOL, "CHANNELS")
    ] = "",
    degree: Annotated[int, option("--degree", "Highest degree of the monomials, products included.", _POOL)] = 1,
    terms: Annotated[str, option("--terms", "Terms added to the pool: alpha,alpha*de", _POOL, "TERMS")] = "",
    spline: Annotated[
        list[str] | None,
        option("--spline", "Spline terms (alpha - knot)+, knots in SI; may be repeated.", _POOL, "CHANNEL:KNOTS"),
    ] = None,
    include: Annotated[str, option("--include", "Terms always in the model; they join the pool.", _POOL, "TERMS")] = "",
    method: Annotated[
        str,
        option(
            "--method",
            "stepwise: partial F; orthogonal: functions ranked by PSE; best_subset; all: compared.",
            _SEARCH,
            "METHOD",
        ),
    ] = "stepwise",
    noise: Annotated[
        Noise,
        option("--noise", "Model of the residuals: ar (autoregressive), cluster (any) or white.", _SEARCH, "MODEL"),
    ] = "ar",
    f_in: Annotated[
        str,
        option("--f-in", "Partial F to enter: a number (12 in the sources), auto (by pool size) or fdr.", _SEARCH, "F"),
    ] = "4",
    f_out: Annotated[
        float | None, option("--f-out", "Partial F to stay; that to enter if absent.", _SEARCH, "F")
    ] = None,
    criterion: Annotated[
        Criterion | None,
        option(
            "--criterion",
            "Choose among the models visited by PSE, BIC, AICc, adj_R2 or cv instead.",
            _SEARCH,
            "RULE",
        ),
    ] = None,
    max_terms: Annotated[int | None, option("--max-terms", "At most this many terms.", _SEARCH, "N")] = None,
    initial_terms: Annotated[
        InitialTerms, option("--initial-terms", "Terms a stepwise search starts from.", _SEARCH)
    ] = "empty",
    stopping_rule: Annotated[
        StoppingRule, option("--stopping-rule", "What besides F ends a stepwise search.", _SEARCH)
    ] = "F",
    correlation_limit: Annotated[
        float | None,
        option("--correlation-limit", "Drop the weaker of two terms whose parameters correlate above.", _SEARCH, "R"),
    ] = None,
    estimate: Annotated[
        Estimate, option("--estimate", "least_squares; or, biased, principal_components or ridge.", _SEARCH, "HOW")
    ] = "least_squares",
    components: Annotated[
        str,
        option("--components", "Principal components: variance, PSE, cv or a number.", _SEARCH, "RULE"),
    ] = "variance",
    bootstrap: Annotated[
        int, option("--bootstrap", "Selections repeated on resampled manoeuvres or blocks; 0: none.", _JUDGE, "N")
    ] = 200,
    held_out: Annotated[
        str, option("--held-out", "Recordings kept aside, and scored on afterwards.", _JUDGE, "NAMES")
    ] = "",
    seed: Annotated[int, option("--seed", "Of the bootstrap.", _JUDGE)] = 0,
    out: Annotated[
        Path | None, option("--out", "Folder for model.json, report.html, tables and plots.", _OUTPUT, "DIR")
    ] = None,
    overwrite: Overwrite = False,
    plots: Plots = True,
    json: Json = False,
    trace: Annotated[bool, option("--trace", "Also print every move of the search.", _OUTPUT)] = False,
    latex: Annotated[bool, option("--latex", "Print the model as a LaTeX table instead.", _OUTPUT)] = False,
    sigma_max: Annotated[
        str, option("--sigma-max", "PSE's bound: response, residual, or a number.", _FINE, "RULE")
    ] = "response",
    order: Annotated[Literal["greedy", "given"], option("--order", "Of the orthogonal functions.", _FINE)] = "greedy",
    min_r2_gain: Annotated[float, option("--min-r2-gain", "Least gain in R2, with --stopping-rule R2.", _FINE)] = 0.005,
    max_ar_order: Annotated[int, option("--max-ar-order", "Highest AR order of the residuals.", _FINE, "N")] = 24,
    workers: Annotated[int | None, option("--workers", "Threads; as many as the work is worth.", _FINE, "N")] = None,
    stream: Stream = None,
    checkpoint: CheckpointFile = None,
) -> None:
    """Choose which candidate terms belong in the model of each response, and say how sure that is."""
    if json and latex:
        raise typer.BadParameter("give one of --json and --latex, not both.")
    if method not in (*METHODS, "all"):
        raise typer.BadParameter(f"--method '{method}' is not one of {', '.join(METHODS)} or all.")
    wanted = words(responses)
    pool = build_pool(candidates, degree, terms, spline or [], include)
    if not wanted:
        raise typer.BadParameter("--responses names none.")
    asked = {
        "noise": noise,
        "F_in": _number_or("--f-in", f_in, ("auto", "fdr")),
        "F_out": f_out,
        "include": words(include),
        "initial_terms": initial_terms,
        "stopping_rule": stopping_rule,
        "min_r2_gain": min_r2_gain,
        "criterion": criterion,
        "sigma_max": _number_or("--sigma-max", sigma_max, ("response", "residual")),
        "order": order,
        "estimate": estimate,
        "components": _components(components),
        "correlation_limit": correlation_limit,
        "max_terms": max_terms,
        "bootstrap": bootstrap,
        "max_ar_order": max_ar_order,
        "seed": seed,
        "workers": workers,
    }
    refuse_existing(out, overwrite)
    streamed = to_stream(files, stream, reconstruct)
    needed = {*wanted, *pool.channels}
    used: Sequence[Recording | StoredRecording]
    if streamed:
        used, kept_aside = hold_out(stream_flights(files, channel_map, aircraft, v0, needed), held_out)
        held = [flight.read() for flight in kept_aside]
    else:
        used, held = hold_out(read_flights(files, channel_map, aircraft, v0, needed, reconstruct), held_out)
    found = _select_by(method, used, wanted, pool, asked, checkpoint_file(checkpoint, out, streamed))
    scores = {name: validate(s.model, held) for name, s in found.items()} if held else {}
    written = []
    if out is not None:
        shown = to_show(used)
        written = write_results(out, found, scores, [*shown, *held], held or shown, plots)
    if json:
        print_json(_as_dict(found, scores))
    elif latex:
        print("\n\n".join(f"% {name}\n{s.model.latex()}" for name, s in found.items()))
        for doubt in (d for s in found.values() for one in s.values() for d in one.doubts):
            say("warning", doubt)
    else:
        _print(found, scores, trace)
        if out is not None:
            print_files(stdout(), str(out), written)


def build_pool(candidates: str, degree: int, terms: str, splines: Sequence[str], include: str) -> Candidates:
    """Return the pool that the command line describes.

    Raises
    ------
    BadParameter
        It describes none, or a spline is not CHANNEL:KNOTS.
    TermError
        A term cannot be read.
    """
    pool = Candidates.polynomial(words(candidates), degree) if words(candidates) else Candidates()
    pool = pool + Candidates.parse([*words(terms), *words(include)])
    for text in splines:
        channel, _, places = text.partition(":")
        try:
            knots = [float(knot) for knot in words(places)]
        except ValueError:
            knots = []
        if not knots:
            raise typer.BadParameter(f"--spline '{text}' is not CHANNEL:KNOT,KNOT such as alpha:0.1,0.2.")
        pool = pool + Candidates.splines(channel.strip(), knots)
    if len(pool) == 0:
        raise typer.BadParameter("no candidate terms: give --candidates and --degree, --terms or --spline.")
    return pool


def _number_or(name: str, text: str, allowed: tuple[str, ...]) -> float | str:
    if text in allowed:
        return text
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(f"{name} '{text}' is neither a number nor one of {', '.join(allowed)}.") from None


def _components(text: str) -> int | str:
    return int(text) if text.isdigit() else text


def _select_by(
    method: str,
    used: Sequence[Recording | StoredRecording],
    responses: Sequence[str],
    pool: Candidates,
    asked: dict[str, Any],
    checkpoint: Path | None,
) -> dict[str, Selections]:
    """Return the selections by the method asked for, or by all that can be made."""
    found: dict[str, Selections] = {}
    tried = tuple(METHODS) if method == "all" else (method,)

    def kept(name: str) -> Path | None:
        if checkpoint is None or method != "all":
            return checkpoint
        return checkpoint.with_name(f"{checkpoint.name}.{name}")

    for name in tried:
        with Waiting(f"selecting, {name}") as waiting:
            try:
                told = {"progress": waiting, "checkpoint": kept(name), **asked}
                found[name] = select(used, responses, pool, method=name, **told)  # type: ignore[arg-type]
            except SelectionError as error:
                if method != "all" or name != "best_subset":
                    raise
                say("warning", f"best_subset is left out of the comparison: {error}")
    if method == "all" and asked["noise"] == "ar":
        with Waiting("selecting, white residuals") as waiting:
            told = {"progress": waiting, "checkpoint": kept("white"), **asked, "noise": "white"}
            found["stepwise, white"] = select(used, responses, pool, method="stepwise", **told)
    return found


def _as_dict(found: dict[str, Selections], scores: dict[str, Validation]) -> dict[str, Any]:
    """Return one method's selection with its scores, or all methods by name."""
    parts = {
        name: {**s.to_dict(), "validation": scores[name].to_dict() if name in scores else None}
        for name, s in found.items()
    }
    if len(parts) == 1:
        return next(iter(parts.values()))
    return {"schema": "structsel.comparison/1", "methods": parts}


def _print(found: dict[str, Selections], scores: dict[str, Validation], trace: bool) -> None:
    console = stdout()
    if len(found) > 1:
        for response in next(iter(found.values())):
            print_summary(console, summarise_methods(response, {name: s[response] for name, s in found.items()}))
    else:
        selections = next(iter(found.values()))
        for selection in selections.values():
            print_summary(console, selection.summary())
            if trace:
                print_summary(console, selection.search_summary())
        explain(console, COLUMN_NOTES)
    for name, validation in scores.items():
        title = f"Recordings held out, not used for the selection ({name})"
        print_summary(console, replace(validation.summary(), title=title, about=""))
