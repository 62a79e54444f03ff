"""``structsel refine``: parameters of a model, estimated by output error or filter error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from structsel.cli.dataclass_options import takes_dataclass
from structsel.cli.folders import names_in, output_folder, refuse_existing, save_figures
from structsel.cli.help_text import epilog, option
from structsel.cli.input_files import provenance
from structsel.cli.messages import ProgressBar, json_text, print_json, say, stdout
from structsel.cli.models import (
    MODEL_HELP,
    AircraftModelOptions,
    RecordingsOption,
    SimulationModel,
    read_inputs,
)
from structsel.cli.recordings import OUTPUT, Before, Map, MoreRecordings, OutputOptions, check_before, hold_out
from structsel.cli.tables import print_files, print_summary
from structsel.errors import RefinementError
from structsel.model import AeroModel
from structsel.recording import Recording
from structsel.refinement import Refinement, refine
from structsel.refinement.settings import RefineOptions
from structsel.simulation import LinearModel, PublishedAircraft
from structsel.tables import csv_of_frame
from structsel.validation import Resimulation, resimulate

EPILOG = epilog(
    [
        (
            "Pitching moment, on complete manoeuvres; two are for validation",
            "structsel refine out/model.json --aircraft aircraft.toml --recordings flights/ \\\n"
            "    --free Cm: --starts w,q,theta --biases az --held-out m05,m06 --out refined/",
        ),
        (
            "With poor start values: a global search between bounds first",
            "structsel refine out/model.json --aircraft aircraft.toml --recordings flights/ \\\n"
            "    --free Cm:alpha,Cm:q_hat,Cm:de --bounds Cm:alpha=-3,0 \\\n"
            "    --bounds Cm:q_hat=-60,0 --search global --seed 1",
        ),
        (
            "A linear model with delays of its inputs",
            "structsel refine builtin:as355:80kt --recordings heli.csv --references all --delay all",
        ),
    ],
    """[bold]Parameters[/bold] of a model file are named response:term, such as Cm:alpha and Cm:1; Cm: means all terms
    of Cm. Initial states of each recording (--starts), biases of the outputs, biases and scale factors common to all
    recordings, and delays of the inputs can be estimated as well.""",
    """[bold]Verdict[/bold], the first line: with --held-out the refined and the original model are simulated on these
    recordings in windows of 4 s. The refined model is better or worse if the mean difference of the relative errors
    exceeds its standard error, otherwise no better. Without --held-out it is not validated. Where it is worse,
    model.json is the original model, unless --keep-worse is given. refinement.json and the provenance in model.json
    contain the verdict.""",
    """[bold]std error[/bold] allows for coloured residuals; CRLB is the Cramer-Rao bound for white residuals.
    Parameters that are not estimated are marked (held) and keep their errors. If a search does not converge, a
    warning is printed and the best result is written with the mark NOT CONVERGED.""",
    """[bold]Exit code[/bold] 0 for every verdict; 1 if the recordings cannot be simulated, or do not determine a
    parameter. Its name is then printed, and the other results are written.""",
)


@takes_dataclass(RefineOptions)
def run(
    model: Annotated[str, typer.Argument(metavar="MODEL", help=MODEL_HELP)],
    source: AircraftModelOptions,
    output: OutputOptions,
    recordings: RecordingsOption = None,
    more_recordings: MoreRecordings = None,
    channel_map: Map = None,
    *,
    options: dict[str, Any],
    stable: Annotated[bool, option("--stable", "Allow no unstable mode of a linear model.", "Search")] = False,
    held_out: Annotated[
        str,
        option("--held-out", "Recordings that decide whether the refined model predicts better.", metavar="NAMES"),
    ] = "",
    out: Annotated[
        Path | None,
        option("--out", "Folder for model, report.html, tables and plots.", OUTPUT, "DIR"),
    ] = None,
    before: Before = None,
) -> None:
    """Estimate the parameters of a model by output error or filter error, from complete recorded manoeuvres."""
    refuse_existing(out, output.overwrite)
    check_before(before, "structsel.refinement")
    aircraft_model = source.open(model)
    if not recordings:
        raise typer.BadParameter("refine needs --recordings.")
    recordings = [*recordings, *(more_recordings or [])]
    training, validation = hold_out(read_inputs(recordings, channel_map, "--recordings"), held_out)
    can_validate = isinstance(aircraft_model, LinearModel) or (
        isinstance(aircraft_model, PublishedAircraft) and aircraft_model.model is not None
    )
    if validation and not can_validate:
        raise typer.BadParameter("--held-out is not available for aircraft of JSBSim; give a model file.")
    options |= {"free": _free(aircraft_model, options["free"]), "constraint": "stable" if stable else None}
    failed: RefinementError | None = None
    try:
        found = _refine(aircraft_model, training, validation, options)
    except RefinementError as error:
        if not isinstance(error.partial, Refinement):
            raise
        found, failed = error.partial, error
    if failed is None and not found.converged:
        say("warning", f"NOT CONVERGED: {found.message}. The best result is printed.")
    if failed is None and found.verdict == "worse":
        original = "The original model is kept; --keep-worse keeps the refined one."
        kept = "It is kept, as --keep-worse asks." if options["keep_worse"] else original
        say("warning", f"the refined model is {found.statement}. {kept}")
    replays = _validate(aircraft_model, found, validation) if failed is None else {}
    written = _write(out, found, training, replays, failed, output.figures, before) if out is not None else []
    if output.json:
        print_json(_as_dict(found, replays, failed))
    else:
        console = stdout()
        print_summary(console, found.summary())
        for name, one in replays.items():
            title = f"{name} the refinement, on the validation recordings"
            print_summary(console, replace(one.summary(), title=title, about=""))
        if out is not None:
            print_files(console, str(out), written)
    if failed is not None:
        raise failed


def _free(aircraft_model: SimulationModel, names: list[str] | Literal["all"]) -> list[str] | Literal["all"]:
    """Names of parameters; a name that ends in a colon becomes all terms of that response."""
    model = aircraft_model.model if isinstance(aircraft_model, PublishedAircraft) else None
    if names == "all" or model is None:
        return names
    every = [f"{response}:{term}" for response, one in model.responses.items() for term in one.terms]
    found: list[str] = []
    for name in names:
        found += [one for one in every if one.startswith(name)] if name.endswith(":") else [name]
    return found or list(names)


def _refine(
    aircraft_model: SimulationModel,
    training: Sequence[Recording],
    validation: Sequence[Recording],
    options: Mapping[str, Any],
) -> Refinement:
    """Refine a model file, a built-in aircraft or a linear model.

    Raises
    ------
    BadParameter
        The model is an aircraft of JSBSim.
    """
    with ProgressBar("refining") as bar:
        limits = {"evolution": options["generations"], "descent": options["iterations"]}

        def progress(stage: str, count: int, value: float) -> None:
            bar(f"{stage}, cost {value:.5g}" if stage not in limits else stage, count, limits.get(stage, count + 1))

        if isinstance(aircraft_model, LinearModel):
            return refine(aircraft_model, None, training, **options, held_out=validation, progress=progress)
        if not isinstance(aircraft_model, PublishedAircraft):
            raise typer.BadParameter("aircraft of JSBSim have no parameters to refine; give a model file.")
        assert aircraft_model.model is not None
        return refine(
            aircraft_model.model,
            aircraft_model.aircraft,
            training,
            **options,
            air=aircraft_model.air,
            definitions=aircraft_model.definitions,
            held_out=validation,
            progress=progress,
        )


def _validate(
    aircraft_model: SimulationModel, found: Refinement, validation: Sequence[Recording]
) -> dict[str, Resimulation]:
    """Simulate the validation recordings with the original and the refined model."""
    if not validation or not isinstance(aircraft_model, PublishedAircraft) or aircraft_model.aircraft is None:
        return {}
    environment: dict[str, Any] = {"air": aircraft_model.air, "definitions": aircraft_model.definitions}
    pair = {"before": found.original, "after": found.refined}
    return {name: resimulate(model, aircraft_model.aircraft, validation, **environment) for name, model in pair.items()}


def _as_dict(found: Refinement, replays: Mapping[str, Resimulation], failed: RefinementError | None) -> dict[str, Any]:
    more: dict[str, Any] = {"held_out": {name: one.to_dict() for name, one in replays.items()}}
    return {**found.to_dict(), **more, "error": None if failed is None else str(failed)}


def _write(
    out: Path,
    found: Refinement,
    recordings: Sequence[Recording],
    replays: Mapping[str, Resimulation],
    failed: RefinementError | None,
    figures: str,
    before: Path | None,
) -> list[str]:
    """Write everything, or nothing; return the names written."""
    from structsel.report import write_report

    with output_folder(out) as folder:
        if isinstance(found.model, AeroModel):
            _mark(found, failed).to_json(folder / "model.json", provenance=provenance())
        (folder / "refinement.json").write_text(json_text(_as_dict(found, replays, failed)), encoding="utf-8")
        csv_of_frame(found.to_frame(), folder / "parameters.csv")
        csv_of_frame(found.history(), folder / "history.csv")
        report = [str(found), *(f"{name} the refinement\n{one}" for name, one in replays.items())]
        (folder / "report.txt").write_text("\n\n".join(report) + "\n", encoding="utf-8")
        reasons = [] if failed is None else [str(failed)]
        write_report(
            found,
            folder / "report.html",
            recordings=recordings,
            judged=replays,
            reasons=reasons,
            before=before,
            provenance=provenance(),
        )
        if figures:
            from structsel.plotting import draw_refinement  # matplotlib takes a while to load

            save_figures(folder / "plots", draw_refinement(found, recordings), figures)
        return names_in(folder)


def _mark(found: Refinement, failed: RefinementError | None) -> AeroModel:
    """Model to write; a search that did not end well is stated as the method of the responses it estimated."""
    model: AeroModel = found.model
    if model is not found.refined or (found.converged and failed is None):
        return model
    mark = ", NOT CONVERGED" if failed is None else ", FAILED"
    estimated = {
        name: replace(one, method=one.method + mark)
        for name, one in model.responses.items()
        if set(one.held) != set(one.terms)
    }
    return replace(model, responses={**model.responses, **estimated})
