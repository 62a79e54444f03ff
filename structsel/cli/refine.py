"""``structsel refine``: parameters whose simulated flights come nearest the recorded ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from structsel.cli.dataclass_options import takes_dataclass
from structsel.cli.folders import output_folder, refuse_existing
from structsel.cli.help_text import page
from structsel.cli.input_files import provenance
from structsel.cli.messages import Waiting, json_text, print_json, say, stdout
from structsel.cli.models import (
    MODEL_HELP,
    AircraftModelOptions,
    RecordingsOption,
    SimulationModel,
    read_schedules,
)
from structsel.cli.recordings import OUTPUT, Map, OutputOptions, hold_out, option
from structsel.cli.tables import print_files, print_summary
from structsel.errors import RefinementError
from structsel.model import AeroModel
from structsel.recording import Recording
from structsel.refinement import Refinement, refine
from structsel.refinement.settings import RefineOptions
from structsel.report import write_report
from structsel.simulation import LinearModel, PublishedAircraft
from structsel.validation import Resimulation, resimulate

EPILOG = page(
    [
        (
            "Pitching moment, on whole manoeuvres; two validate the result",
            "structsel refine out/model.json --aircraft aircraft.toml --recordings flights/ \\\n"
            "    --free Cm: --starts w,q,theta --biases az --held-out m05,m06 --out refined/",
        ),
        (
            "Far from the truth: between bounds, evolution first",
            "structsel refine out/model.json --aircraft aircraft.toml --recordings flights/ \\\n"
            "    --free Cm:alpha,Cm:q_hat,Cm:de --bounds Cm:alpha=-3,0 \\\n"
            "    --bounds Cm:q_hat=-60,0 --search global --seed 1",
        ),
        (
            "A linear model with the delay of its input",
            "structsel refine ready:as355:80kt --recordings heli.csv --references all --delay all",
        ),
    ],
    """[bold]Parameters[/bold] of a model file are called response:term, as Cm:alpha and Cm:1; Cm: alone stands for all
    of them. Besides, each recording's first states (--starts), biases of outputs, their references and scale factors
    over all recordings, and a delay of the inputs can be estimated.""",
    """[bold]std error[/bold] allows for coloured residuals, CRLB is the Cramer-Rao bound of white ones. A search that
    did not converge says so, and its best is written with that mark. What the flights do not determine is named, the
    rest is written, and the exit code is 1.""",
)


@takes_dataclass(RefineOptions)
def run(
    model: Annotated[str, typer.Argument(metavar="MODEL", help=MODEL_HELP)],
    source: AircraftModelOptions,
    output: OutputOptions,
    recordings: RecordingsOption = None,
    channel_map: Map = None,
    *,
    options: dict[str, Any],
    stable: Annotated[bool, option("--stable", "No mode of a linear model may be unstable.", "Search")] = False,
    held_out: Annotated[
        str, option("--held-out", "Validation recordings: simulated with the model before and after.", metavar="NAMES")
    ] = "",
    out: Annotated[
        Path | None,
        option("--out", "Folder for model, report.html, tables and plots.", OUTPUT, "DIR"),
    ] = None,
) -> None:
    """Estimate the parameters of a model by output error: its simulated outputs come nearest the recorded ones."""
    refuse_existing(out, output.overwrite)
    aircraft_model = source.open(model)
    if not recordings:
        raise typer.BadParameter("refine needs --recordings.")
    flown, judges = hold_out(read_schedules(recordings, channel_map, "--recordings"), held_out)
    options |= {"free": _free(aircraft_model, options["free"]), "constraint": "stable" if stable else None}
    failed: RefinementError | None = None
    try:
        found = _refine(aircraft_model, flown, options)
    except RefinementError as error:
        if not isinstance(error.partial, Refinement):
            raise
        found, failed = error.partial, error
    if failed is None and not found.converged:
        say("warning", f"NOT CONVERGED: {found.message}. What follows is the best found.")
    judged = _judge(aircraft_model, found, judges) if failed is None else {}
    written = _write(out, found, flown, judged, failed, output.plots) if out is not None else []
    if output.json:
        print_json(_as_dict(found, judged, failed))
    else:
        console = stdout()
        print_summary(console, found.summary())
        for name, one in judged.items():
            title = f"{name} the refinement, on the recordings held out"
            print_summary(console, replace(one.summary(), title=title, about=""))
        if out is not None:
            print_files(console, str(out), written)
    if failed is not None:
        raise failed


def _free(aircraft_model: SimulationModel, names: list[str] | Literal["all"]) -> list[str] | Literal["all"]:
    """Names, those that end in a colon spelled out."""
    model = aircraft_model.model if isinstance(aircraft_model, PublishedAircraft) else None
    if names == "all" or model is None:
        return names
    every = [f"{response}:{term}" for response, held in model.responses.items() for term in held.terms]
    found: list[str] = []
    for name in names:
        found += [one for one in every if one.startswith(name)] if name.endswith(":") else [name]
    return found or list(names)


def _refine(aircraft_model: SimulationModel, flown: Sequence[Recording], options: Mapping[str, Any]) -> Refinement:
    """The refinement of what can be refined.

    Raises
    ------
    BadParameter
        JSBSim's aircraft have no parameters of ours.
    """
    with Waiting("refining") as waiting:
        limits = {"evolution": options["generations"], "descent": options["iterations"]}

        def progress(stage: str, count: int, value: float) -> None:
            waiting(f"{stage}, cost {value:.5g}" if stage not in limits else stage, count, limits.get(stage, count + 1))

        if isinstance(aircraft_model, LinearModel):
            return refine(aircraft_model, None, flown, **options, progress=progress)
        if not isinstance(aircraft_model, PublishedAircraft):
            raise typer.BadParameter("JSBSim's aircraft have no parameters to refine; give a model file.")
        assert aircraft_model.model is not None
        return refine(
            aircraft_model.model,
            aircraft_model.aircraft,
            flown,
            **options,
            air=aircraft_model.air,
            definitions=aircraft_model.definitions,
            progress=progress,
        )


def _judge(aircraft_model: SimulationModel, found: Refinement, judges: Sequence[Recording]) -> dict[str, Resimulation]:
    """Replays of what was held out, before and after.

    Raises
    ------
    BadParameter
        A linear model, which has no start to be replayed from.
    """
    if not judges:
        return {}
    if (
        not isinstance(aircraft_model, PublishedAircraft)
        or aircraft_model.model is None
        or aircraft_model.aircraft is None
    ):
        raise typer.BadParameter("--held-out is judged by replay, which flies model files and ready aircraft only.")
    flies = {"air": aircraft_model.air, "definitions": aircraft_model.definitions}
    pair = {"before": aircraft_model.model, "after": found.model}
    return {name: resimulate(model, aircraft_model.aircraft, judges, **flies) for name, model in pair.items()}  # type: ignore[arg-type]


def _as_dict(found: Refinement, judged: Mapping[str, Resimulation], failed: RefinementError | None) -> dict[str, Any]:
    more: dict[str, Any] = {"held_out": {name: one.to_dict() for name, one in judged.items()}}
    return {**found.to_dict(), **more, "error": None if failed is None else str(failed)}


def _write(
    out: Path,
    found: Refinement,
    recordings: Sequence[Recording],
    judged: Mapping[str, Resimulation],
    failed: RefinementError | None,
    plots: bool,
) -> list[str]:
    """Write everything, or nothing; return the names written."""
    with output_folder(out) as folder:
        if isinstance(found.model, AeroModel):
            mark = "" if found.converged and failed is None else ", NOT CONVERGED" if failed is None else ", FAILED"
            marked = {name: replace(one, method=one.method + mark) for name, one in found.model.responses.items()}
            flown = tuple(r.name for r in found.simulated)
            refined = AeroModel(marked, found.model.name, flown)
            refined.to_json(folder / "model.json", provenance=provenance())
        (folder / "refinement.json").write_text(json_text(_as_dict(found, judged, failed)), encoding="utf-8")
        found.to_frame().to_csv(folder / "parameters.csv", index=False)
        found.history().to_csv(folder / "history.csv", index=False)
        report = [str(found), *(f"{name} the refinement\n{one}" for name, one in judged.items())]
        (folder / "report.txt").write_text("\n\n".join(report) + "\n", encoding="utf-8")
        reasons = [] if failed is None else [str(failed)]
        write_report(
            found,
            folder / "report.html",
            recordings=recordings,
            judged=judged,
            reasons=reasons,
            provenance=provenance(),
        )
        if plots:
            _draw(folder / "plots", found, recordings)
        return [p.name + "/" * p.is_dir() for p in sorted(folder.iterdir())]


def _draw(folder: Path, found: Refinement, recordings: Sequence[Recording]) -> None:
    from structsel.plotting import draw_refinement  # matplotlib takes a while to load

    folder.mkdir()
    for name, figure in draw_refinement(found, recordings):
        figure.savefig(folder / f"{name}.png", dpi=110)
