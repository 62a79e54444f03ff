"""``structsel select``: terms of the model of each response."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from structsel.candidates import Candidates
from structsel.cli.comparison_tables import summarise_methods
from structsel.cli.dataclass_options import takes_dataclass
from structsel.cli.folders import refuse_existing
from structsel.cli.help_text import epilog, option
from structsel.cli.messages import ProgressBar, by_method, explain, print_json, say, stdout
from structsel.cli.parsing import split_names
from structsel.cli.recordings import (
    OUTPUT,
    Before,
    Files,
    Json,
    Overwrite,
    PlotFormat,
    Plots,
    RecordingOptions,
    check_before,
    hold_out,
)
from structsel.cli.selection_files import write_results
from structsel.cli.streaming import StreamingOptions, report_sample, stream_flights
from structsel.cli.tables import print_files, print_summary
from structsel.errors import SelectionError
from structsel.files import path_text
from structsel.recording import DataWarning, Recording, StoredRecording
from structsel.selection import Selections, select
from structsel.selection.methods import METHODS
from structsel.selection.result import COLUMN_NOTES
from structsel.selection.settings import RENAMED_ARGUMENTS, SelectOptions
from structsel.validation import Validation, validate

EPILOG = epilog(
    [
        (
            "From raw recordings; two are for validation",
            "structsel select flights/ --map map.toml --aircraft aircraft.toml \\\n"
            "    --responses CZ,Cm --candidates alpha,q_hat,de --degree 3 \\\n"
            "    --held-out m05,m06 --out out/",
        ),
        (
            "Splines, included terms, automatic F_in, and each step of the search",
            "structsel select coefficients/ --responses Cm --candidates alpha,q_hat,de \\\n"
            "    --degree 2 --spline alpha:0.2,0.25 --include alpha,de --f-in auto --trace",
        ),
        (
            "Compare all methods",
            "structsel select coefficients/ --responses CX --candidates alpha,q_hat,de \\\n    --degree 3 --method all",
        ),
        (
            "A table for a paper",
            "structsel select coefficients/ --responses CX \\\n    --terms 'alpha,alpha^2,q_hat,de' --latex > CX.tex",
        ),
    ],
    """[bold]Terms[/bold] are products of powers, alpha^2*de, of channels, offsets (alpha - 0.1), splines
    (alpha - 0.2)+, and abs, sign, sqrt, sin, cos, tan, exp, log, tanh, step of formulas. The constant is always in the
    model.""",
    """[bold]Instruments[/bold] have biases, and flow disturbances affect vanes: --reconstruct corrects for both first,
    with the defaults of structsel reconstruct. Run structsel reconstruct once to see the corrections.""",
    """[bold]Warnings[/bold] are printed below each table and marked with !.""",
)

_POOL = "Candidate terms"


@dataclass(frozen=True)
class CandidateOptions:
    """Terms that may be in the model."""

    candidates: Annotated[
        str, option("--candidates", "Channels whose monomials are candidates: alpha,q_hat,de", _POOL, "CHANNELS")
    ] = ""
    degree: Annotated[int, option("--degree", "Highest degree of the monomials, products included.", _POOL)] = 1
    terms: Annotated[str, option("--terms", "Further candidate terms: alpha,alpha*de", _POOL, "TERMS")] = ""
    spline: Annotated[
        list[str] | None,
        option("--spline", "Spline terms (alpha - knot)+, knots in SI; may be repeated.", _POOL, "CHANNEL:KNOTS"),
    ] = None
    include: Annotated[str, option("--include", "Terms that are always in the model.", _POOL, "TERMS")] = ""
    force: Annotated[str, typer.Option("--force", hidden=True)] = ""

    @property
    def included(self) -> list[str]:
        """Terms that are always in the model; of the deprecated ``--force`` where that is given."""
        return split_names(self.force or self.include)

    def build(self) -> Candidates:
        """Return the candidate terms that the command line describes.

        Raises
        ------
        BadParameter
            It describes none, or a spline is not CHANNEL:KNOTS.
        TermError
            A term cannot be read.
        """
        channels = split_names(self.candidates)
        pool = Candidates.polynomial(channels, self.degree) if channels else Candidates()
        pool = pool + Candidates.parse([*split_names(self.terms), *self.included])
        for text in self.spline or ():
            channel, _, places = text.partition(":")
            try:
                knots = [float(knot) for knot in split_names(places)]
            except ValueError:
                knots = []
            if not knots:
                raise typer.BadParameter(f"--spline '{text}' is not CHANNEL:KNOT,KNOT such as alpha:0.1,0.2.")
            pool = pool + Candidates.splines(channel.strip(), knots)
        if len(pool) == 0:
            raise typer.BadParameter("no candidate terms: give --candidates and --degree, --terms or --spline.")
        return pool


@dataclass(frozen=True)
class SelectionOutputOptions:
    """Content of the printed text, and of the folder of ``--out``."""

    out: Annotated[
        Path | None, option("--out", "Folder for model.json, report.html, tables and plots.", OUTPUT, "DIR")
    ] = None
    overwrite: Overwrite = False
    before: Before = None
    plots: Plots = True
    plot_format: PlotFormat = "png"
    json: Json = False
    trace: Annotated[bool, option("--trace", "Also print every step of the search.", OUTPUT)] = False
    latex: Annotated[bool, option("--latex", "Print the model as a LaTeX table instead.", OUTPUT)] = False


@takes_dataclass(SelectOptions, without=("method",), renamed=RENAMED_ARGUMENTS)
def run(
    files: Files,
    responses: Annotated[
        str, option("--responses", "Responses to model: CX to Cn, CL, CD, or any channel.", metavar="NAMES")
    ],
    recorded: RecordingOptions,
    candidates: CandidateOptions,
    method: Annotated[
        str,
        option(
            "--method",
            "stepwise: partial F; orthogonal: functions ranked by PSE; best_subset; all: compared.",
            "The search",
            "METHOD",
        ),
    ] = "stepwise",
    *,
    options: dict[str, Any],
    held_out: Annotated[
        str,
        option(
            "--held-out",
            "Validation recordings: not used for the selection, and scored afterwards.",
            "Uncertainty of the result",
            "NAMES",
        ),
    ] = "",
    output: SelectionOutputOptions,
    streaming: StreamingOptions,
) -> None:
    """Select the terms of the model of each response from candidates, and estimate their uncertainty."""
    if output.json and output.latex:
        raise typer.BadParameter("give one of --json and --latex, not both.")
    if method not in (*METHODS, "all"):
        raise typer.BadParameter(f"--method '{method}' is not one of {', '.join(METHODS)} or all.")
    if candidates.force:
        say("warning", "--force is deprecated: use --include.")
    wanted = split_names(responses)
    pool = candidates.build()
    if not wanted:
        raise typer.BadParameter("--responses names none.")
    options = {**options, "include": candidates.included}
    refuse_existing(output.out, output.overwrite)
    check_before(output.before, "structsel.selection")
    needed = {*wanted, *pool.channels}
    streamed = streaming.use_for(files, recorded.reconstruct)
    used: Sequence[Recording | StoredRecording]
    if streamed:
        used, stored = hold_out(stream_flights(files, recorded, needed), held_out)
        held = [flight.read() for flight in stored]
    else:
        used, held = hold_out(recorded.read(files, needed), held_out)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DataWarning)  # printed when the recordings were read
        found = _select_by(method, used, wanted, pool, options, streaming.checkpoint_file(output.out, streamed))
    scores = {name: validate(s.model, held) for name, s in found.items()} if held else {}
    _show(found, scores, used, held, output)


def _show(
    found: dict[str, Selections],
    scores: dict[str, Validation],
    used: Sequence[Recording | StoredRecording],
    held: Sequence[Recording],
    output: SelectionOutputOptions,
) -> None:
    """Write and print the selections."""
    written = []
    if output.out is not None:
        shown = report_sample(used)
        written = write_results(
            output.out,
            found,
            scores,
            [*shown, *held],
            held or shown,
            output.plot_format if output.plots else "",
            output.before,
        )
    if output.json:
        print_json(_as_dict(found, scores))
    elif output.latex:
        print("\n\n".join(f"% {name}\n{s.model.latex()}" for name, s in found.items()))
        for warning in (w for s in found.values() for one in s.values() for w in one.doubts):
            say("warning", warning)
    else:
        _print(found, scores, output.trace)
        if output.out is not None:
            print_files(stdout(), path_text(output.out), written)


def _select_by(
    method: str,
    used: Sequence[Recording | StoredRecording],
    responses: Sequence[str],
    pool: Candidates,
    options: dict[str, Any],
    checkpoint: Path | None,
) -> dict[str, Selections]:
    """Return the selections by one method, or by all methods that can be used."""
    found: dict[str, Selections] = {}
    tried = tuple(METHODS) if method == "all" else (method,)

    def checkpoint_of(name: str) -> Path | None:
        if checkpoint is None or method != "all":
            return checkpoint
        return checkpoint.with_name(f"{checkpoint.name}.{name}")

    for name in tried:
        with ProgressBar(f"selecting, {name}") as waiting:
            try:
                given = {"progress": waiting, "checkpoint": checkpoint_of(name), **options}
                found[name] = select(used, responses, pool, method=name, **given)  # type: ignore[arg-type]
            except SelectionError as error:
                if method != "all" or name != "best_subset":
                    raise
                say("warning", f"best_subset is left out of the comparison: {error}")
    if method == "all" and options["noise"] == "ar":
        with ProgressBar("selecting, white residuals") as waiting:
            given = {"progress": waiting, "checkpoint": checkpoint_of("white"), **options, "noise": "white"}
            found["stepwise, white"] = select(used, responses, pool, method="stepwise", **given)
    return found


def _as_dict(found: dict[str, Selections], scores: dict[str, Validation]) -> dict[str, Any]:
    """Return one method's selection with its scores, or all methods by name."""
    return by_method(
        {
            name: {**s.to_dict(), "validation": scores[name].to_dict() if name in scores else None}
            for name, s in found.items()
        }
    )


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
        title = f"Validation recordings, not used for the selection ({name})"
        print_summary(console, replace(validation.summary(), title=title, about=""))
