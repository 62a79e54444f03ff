"""``structsel explore``: a local page with the residuals of a model or a simulation."""

from __future__ import annotations

import json
import webbrowser
from collections.abc import Iterable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from structsel.candidates import Candidates
from structsel.cli.cutting import is_cut, set_cuts
from structsel.cli.dataclass_options import takes_dataclass
from structsel.cli.help_text import epilog
from structsel.cli.messages import ProgressBar, say
from structsel.cli.parsing import split_names
from structsel.cli.recordings import (
    OUTPUT,
    Map,
    expand,
    load_aircraft,
    option,
    read_files,
    read_flights,
    read_manoeuvres,
)
from structsel.errors import DataError
from structsel.files import path_text
from structsel.formatting import join_names
from structsel.model import AeroModel
from structsel.provenance import sha256_of
from structsel.recording.reading import files_read

if TYPE_CHECKING:
    from structsel.exploring.exploration import Exploration

EPILOG = epilog(
    [
        ("Residuals of a selection, with the recordings that it was made from", "structsel explore out/"),
        ("Of a diagnosis: what each effect would explain", "structsel explore diagnosis/"),
        (
            "A model with other recordings",
            "structsel explore out/model.json --recordings m07.csv \\\n    --map map.toml --aircraft aircraft.toml",
        ),
        ("A view that was saved", "structsel explore out/views/pitch.json"),
    ],
    """[bold]The page[/bold] shows the residual over time and over a channel, bin means with 95 % intervals, and the
    spectrum. A menu has terms, the best first: partial F, R2, PSE and cross-validated R2 with each. Score effects adds
    the effects of structsel diagnose. Points that are selected in one figure are marked in the other. Tab and the arrow
    keys reach every menu; the bin means are a table too.""",
    """[bold]Save view[/bold] writes NAME.json, which structsel explore opens again, NAME.html and NAME.png. The page
    needs no network, and the server answers this computer only. It runs until Ctrl-C.""",
)

_DEFAULT_MODEL = "model_stepwise.json"  # of the default method among those of select --method all


@dataclass(frozen=True)
class SourceOptions:
    """Recordings, in place of those that the folder was made from."""

    recordings: Annotated[
        list[Path] | None,
        option(
            "--recordings",
            "Files with one manoeuvre each, folders, or patterns in quotes; by default those of the folder's results.",
            metavar="FILES...",
        ),
    ] = None
    channel_map: Map = None
    aircraft: Annotated[
        Path | None,
        option(
            "--aircraft", "Geometry, mass, inertia, tolerances; with it effects can be added.", metavar="AIRCRAFT.TOML"
        ),
    ] = None


@dataclass(frozen=True)
class PageOptions:
    """The page and its files."""

    candidates: Annotated[
        str, option("--candidates", "Channels whose monomials may be added: alpha,q_hat,de", metavar="CHANNELS")
    ] = ""
    degree: Annotated[int, option("--degree", "Highest degree of these monomials.")] = 2
    views: Annotated[
        Path | None, option("--views", "Folder of the saved views; by default views in the folder.", OUTPUT, "DIR")
    ] = None
    port: Annotated[int, option("--port", "Port of the page; 0 for one that is free.", OUTPUT)] = 0
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Whether a browser is opened.", rich_help_panel=OUTPUT)
    ] = True


@takes_dataclass()
def run(
    place: Annotated[
        Path,
        typer.Argument(
            metavar="FOLDER",
            help="Folder that select, refine, diagnose or demo wrote; or a model file; or a saved view.",
        ),
    ],
    more_recordings: Annotated[list[Path] | None, typer.Argument(hidden=True)] = None,
    *,
    given: SourceOptions,
    page: PageOptions,
) -> None:
    """Show the residuals of a model or a simulation, and what one more term or effect would do, on a local page."""
    from structsel.exploring.server import make_server, require_bokeh, serve
    from structsel.exploring.view import View, read_view

    require_bokeh()
    view = View()
    if place.suffix == ".json" and _schema(place).startswith("structsel.view"):
        view, source = read_view(place)
        folder = place.parent
    else:
        source = source_of(place)
        folder = (place if place.is_dir() else place.parent) / "views"
    if more_recordings and not given.recordings:
        raise typer.BadParameter("further files belong to --recordings.")
    source = _replaced(source, given, more_recordings or [])
    exploration = _open(source, page)
    if view.kind == "effect":
        with ProgressBar("scoring effects"):
            exploration.trials["effect"].names(view.response)
    view = exploration.complete(view)
    server, address = make_server(exploration, view, source, page.views or folder, page.port)

    def started() -> None:
        print(f"{exploration.title}: {address}", flush=True)
        say("note", "the page answers this computer only. Ctrl-C ends it.")
        if page.browser:
            webbrowser.open(address)

    serve(server, started)


def source_of(place: Path) -> dict[str, Any]:
    """Where model and recordings of a result are from, as the result states.

    Raises
    ------
    DataError
        It is not a result of structsel.
    """
    diagnosis, model = place / "diagnosis.json", _model_in(place) if place.is_dir() else place
    found = diagnosis if diagnosis.is_file() else model
    if not found.is_file():
        there = ", ".join(sorted(one.name for one in place.iterdir())[:10]) if place.is_dir() else "no such folder"
        raise DataError(
            f"'{place}' has neither model.json nor diagnosis.json: {there}.\n"
            "Give a folder that structsel select, refine, diagnose or demo wrote, or a model file."
        )
    provenance = json.loads(found.read_text(encoding="utf-8")).get("provenance") or {}
    source = dict(provenance.get("request") or {})
    source["hashes"] = {one["file"]: one["sha256"] for one in provenance.get("inputs", ())}
    if found == model:
        source |= {"model": path_text(model)}
        source.pop("simulation", None)
    if "recordings" not in source and (place / "flights").is_dir():  # as structsel demo writes it
        source |= {"recordings": [path_text(place / "flights")], "aircraft": path_text(place / "aircraft.toml")}
    return source


def _model_in(folder: Path) -> Path:
    """Model of a folder; of several methods that of the default method, with a note about the others."""
    model = folder / "model.json"
    of_methods = sorted(folder.glob("model_*.json"))
    if model.is_file() or not of_methods:
        return model
    model = folder / _DEFAULT_MODEL if folder / _DEFAULT_MODEL in of_methods else of_methods[0]
    others = [path_text(one) for one in of_methods if one != model]
    if others:
        say("note", f"the model is {model.name}. Give {join_names(others, last='or')} for that of another method.")
    return model


def _path(source: Mapping[str, Any], name: str) -> Path | None:
    return Path(source[name]) if source.get(name) else None


def _report_changes(source: Mapping[str, Any], files: Iterable[Path]) -> None:
    """Print which files are not as they were when the result was made."""
    before = source.get("hashes", {})
    for path in files:
        for one in files_read(path) if path.is_dir() else [path]:
            known = before.get(path_text(one))
            if known is not None and sha256_of(one) != known:
                say("warning", f"'{one}' was changed since the result was made.")


def _schema(path: Path) -> str:
    try:
        return str(json.loads(path.read_text(encoding="utf-8")).get("schema", ""))
    except (OSError, ValueError, AttributeError):
        return ""


def _replaced(source: Mapping[str, Any], given: SourceOptions, more: list[Path]) -> dict[str, Any]:
    """Source with what the command line has in its place.

    Raises
    ------
    DataError
        There are no recordings.
    """
    named: dict[str, Any] = {
        "recordings": [path_text(one) for one in [*(given.recordings or []), *more]],
        "channel_map": given.channel_map and path_text(given.channel_map),
        "aircraft": given.aircraft and path_text(given.aircraft),
    }
    found = {**source, **{name: value for name, value in named.items() if value}}
    if not found.get("recordings"):
        raise DataError("the result does not say which recordings it was made from.\nGive --recordings FILES.")
    for name in found["recordings"]:
        if not Path(name).exists() and not any(mark in name for mark in "*?["):
            raise DataError(
                f"'{name}', which the result was made from, is not there.\n"
                "Run structsel explore in the folder of the first command, or give --recordings FILES."
            )
    return found


def _open(source: Mapping[str, Any], page: PageOptions) -> Exploration:
    """Read model and recordings, and compute the residuals."""
    from structsel.exploring.exploration import explore_model, explore_simulation

    files, channel_map = [Path(one) for one in source["recordings"]], _path(source, "channel_map")
    _report_changes(source, [*expand(files), *filter(None, [channel_map, _path(source, "aircraft")])])
    pool = Candidates.polynomial(split_names(page.candidates), page.degree) if page.candidates else None
    aircraft, aircraft_file = None, _path(source, "aircraft")
    with nullcontext() if is_cut() else set_cuts(source.get("cut", ())):
        if "simulation" in source:
            simulation = source["simulation"]
            aircraft = None if aircraft_file is None else load_aircraft(aircraft_file)
            evaluated = simulation.startswith(("jsbsim:", "python:")) or simulation.endswith(".json")
            recordings = (read_manoeuvres if evaluated else read_files)(files, channel_map)
            with ProgressBar("comparing"):
                return explore_simulation(simulation, recordings, aircraft, pool)
        reconstruct = bool(source.get("reconstruct"))
        recordings = read_flights(files, channel_map, aircraft_file, source.get("v0"), (), reconstruct)
    model = AeroModel.from_json(source["model"])
    if aircraft_file is not None:
        aircraft = load_aircraft(aircraft_file)
    with ProgressBar("computing residuals"):
        return explore_model(model, recordings, pool or Candidates.polynomial(model.channels, page.degree), aircraft)
