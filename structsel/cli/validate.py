"""``structsel validate``: predictions of a model against recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import typer

from structsel.aircraft import Aircraft
from structsel.cli.dataclass_options import takes_dataclass
from structsel.cli.folders import names_in, output_folder, refuse_existing, save_figures
from structsel.cli.help_text import epilog, option
from structsel.cli.messages import ProgressBar, json_text, print_json, stdout
from structsel.cli.models import Define, Rho, read_definitions
from structsel.cli.parsing import read_texts, split_names
from structsel.cli.qualification import qualify_and_show
from structsel.cli.recordings import (
    OUTPUT,
    Files,
    OutputOptions,
    RecordingOptions,
    load_aircraft,
    read_manoeuvres,
    reconstruct_paths,
)
from structsel.cli.tables import print_files, print_summary
from structsel.formatting import count_of
from structsel.model import AeroModel
from structsel.recording import Recording
from structsel.simulation.atmosphere import Atmosphere
from structsel.tables import csv_of_frame
from structsel.validation import Resimulation, resimulate, validate

EPILOG = epilog(
    [
        (
            "Recordings that were not used for the fit",
            "structsel validate out/model.json m05.csv m06.csv --map map.toml \\\n    --aircraft aircraft.toml",
        ),
        ("Files with coefficients", "structsel validate model.json coefficients/ --responses Cm"),
        (
            "Simulation with the recorded inputs, from the recorded initial state",
            "structsel validate out/model.json flights/ --aircraft aircraft.toml \\\n    --replay --out resimulated/",
        ),
        (
            "Proof of match, before and after the correction of a diagnosis",
            "structsel validate simulation.json flights/ --aircraft aircraft.toml \\\n"
            "    --replay --qtg --corrected out/model.json --out qtg/",
        ),
    ],
    """Use complete manoeuvres that were not used to identify the model.""",
    """[bold]--replay[/bold] simulates the model with the recorded inputs and scores every output. Each recording is
    simulated over its complete length, and in consecutive windows that each start from the recorded state. Use the
    windows for an aircraft that is unstable without its pilot. The time at which a simulation diverges is printed.""",
)
_REPLAY = "With --replay"


@dataclass(frozen=True)
class ReplayOptions:
    """Simulation of a model with the recorded inputs."""

    replay: Annotated[bool, option("--replay", "Simulate the model with the recorded inputs. Needs --aircraft.")] = (
        False
    )
    outputs: Annotated[str, option("--outputs", "Channels to compare.", _REPLAY, "NAMES")] = ""
    window: Annotated[float, option("--window", "Length of a window, in s.", _REPLAY)] = 4.0
    define: Define = None
    rho: Rho = None
    qtg: Annotated[
        bool,
        option("--qtg", "Proof of match with the tolerances of 14 CFR 60: qtg.html and qtg.pdf in --out.", _REPLAY),
    ] = False
    corrected: Annotated[
        Path | None,
        option("--corrected", "With --qtg: the model after a correction, for before and after.", _REPLAY, "MODEL.JSON"),
    ] = None
    kind: Annotated[
        list[str] | None,
        option("--kind", "With --qtg: test of a manoeuvre, if not the one that is found.", _REPLAY, "NAME=KIND"),
    ] = None


@takes_dataclass()
def run(
    model: Annotated[Path, typer.Argument(metavar="MODEL.JSON", help="Model file of select or refine.")],
    files: Files,
    recorded: RecordingOptions,
    replay: ReplayOptions,
    output: OutputOptions,
    responses: Annotated[str, option("--responses", "Responses to score; by default all responses of the model.")] = "",
    constants: Annotated[
        Literal["auto", "model", "own"],
        option("--constants", "Compare levels too (model), or about each recording's mean (own)."),
    ] = "auto",
    normaliser: Annotated[Literal["rms", "std", "range"], option("--normaliser", "Denominator of RRMSE.")] = "rms",
    out: Annotated[
        Path | None,
        option("--out", "With --replay: folder for table and plots.", OUTPUT, "DIR"),
    ] = None,
) -> None:
    """Score the predictions of a model on recordings: R2, relative rms error, Theil's coefficient, whiteness."""
    loaded = AeroModel.from_json(model)
    if replay.replay:
        if responses or recorded.v0 is not None:
            raise typer.BadParameter("--responses and --v0 do not apply to --replay, which compares --outputs.")
        refuse_existing(out, output.overwrite)
        if replay.qtg:
            _qualify(model, files, recorded, replay, out, output.json)
            return
        if replay.corrected is not None or replay.kind:
            raise typer.BadParameter("--corrected and --kind need --qtg.")
        found = _resimulate(loaded, files, recorded, replay, normaliser)
        _show(found, model.name, out, output)
        return
    if out is not None or replay.outputs or replay.define or replay.rho is not None or replay.qtg:
        raise typer.BadParameter("--out, --outputs, --define, --rho and --qtg need --replay.")
    recordings = recorded.read(files, {*loaded, *loaded.channels})
    result = validate(
        loaded, recordings, responses=split_names(responses) or None, constants=constants, normaliser=normaliser
    )
    if output.json:
        print_json(result.to_dict())
    else:
        about = f"compared with {count_of(len(recordings), 'recording')}"
        print_summary(stdout(), replace(result.summary(), title=model.name, about=about))


def _resimulate(
    model: AeroModel,
    files: Sequence[Path],
    recorded: RecordingOptions,
    replay: ReplayOptions,
    normaliser: Literal["rms", "std", "range"],
) -> Resimulation:
    """Simulate the model with the inputs of the files."""
    aircraft, flights = _read(files, recorded)
    with ProgressBar("simulating") as waiting:
        return resimulate(
            model, aircraft, flights, outputs=split_names(replay.outputs) or None, window=replay.window,
            normaliser=normaliser, air=Atmosphere(rho=replay.rho), definitions=read_definitions(replay.define),
            progress=waiting,
        )  # fmt: skip


def _read(files: Sequence[Path], recorded: RecordingOptions) -> tuple[Aircraft, Sequence[Recording]]:
    """Aircraft and manoeuvres.

    Raises
    ------
    BadParameter
        There is no aircraft.
    """
    if recorded.aircraft is None:
        raise typer.BadParameter("--replay needs --aircraft: mass, inertia and positions of the instruments.")
    aircraft = load_aircraft(recorded.aircraft)
    flights = read_manoeuvres(files, recorded.channel_map)
    return aircraft, reconstruct_paths(flights, aircraft).recordings if recorded.reconstruct else flights


def _qualify(
    model: Path,
    files: Sequence[Path],
    recorded: RecordingOptions,
    replay: ReplayOptions,
    out: Path | None,
    json: bool,
) -> None:
    """Proof of match; see `structsel.cli.qualification`."""
    if replay.outputs:
        raise typer.BadParameter("--outputs does not apply to --qtg: the tests state what is compared.")
    kinds = read_texts("--kind", replay.kind or [], "MANOEUVRE=KIND, as m01=phugoid")
    aircraft, flights = _read(files, recorded)
    qualify_and_show(
        model, replay.corrected, files, out, json, aircraft=aircraft, recordings=flights, kinds=kinds,
        air=Atmosphere(rho=replay.rho), definitions=read_definitions(replay.define),
    )  # fmt: skip


def _show(found: Resimulation, model: str, out: Path | None, output: OutputOptions) -> None:
    written = _write(out, found, output.figures) if out is not None else []
    if output.json:
        print_json(found.to_dict())
        return
    print_summary(stdout(), replace(found.summary(), title=model))
    if out is not None:
        print_files(stdout(), str(out), written)


def _write(out: Path, found: Resimulation, figures: str) -> list[str]:
    """Write everything, or nothing; return the names written."""
    with output_folder(out) as folder:
        (folder / "replay.json").write_text(json_text(found.to_dict()), encoding="utf-8")
        csv_of_frame(found.to_frame(), folder / "replay.csv")
        if figures:
            from structsel.plotting import draw_resimulation  # matplotlib takes a while to load

            save_figures(folder / "plots", draw_resimulation(found), figures)
        return names_in(folder)
