"""``structsel reconstruct``: errors of the instruments, and recordings without them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from structsel.aircraft import Aircraft
from structsel.cli.comparison_tables import summarise_reconstructions
from structsel.cli.dataclass_options import takes_dataclass
from structsel.cli.folders import names_in, output_folder, refuse_existing, save_figures
from structsel.cli.help_text import epilog, option
from structsel.cli.input_files import provenance
from structsel.cli.messages import by_method, explain, json_text, print_json, say, stdout
from structsel.cli.recordings import (
    OUTPUT,
    Before,
    Files,
    Json,
    Map,
    Overwrite,
    PlotFormat,
    Plots,
    check_before,
    load_aircraft,
    read_manoeuvres,
    reconstruct_paths,
)
from structsel.cli.tables import print_files, print_summary
from structsel.errors import ReconstructionError
from structsel.reconstruction import METHODS, Reconstructions, ReconstructOptions
from structsel.reconstruction.result import COLUMN_NOTES
from structsel.recording import Recording, write_recording
from structsel.tables import csv_of_frame

EPILOG = epilog(
    [
        (
            "Estimate the errors of the instruments",
            "structsel reconstruct flights/ --map map.toml --aircraft aircraft.toml",
        ),
        (
            "Write consistent recordings and plots; then select a model",
            "structsel reconstruct flights/ --map map.toml --aircraft aircraft.toml \\\n    --out path/\n"
            "  structsel select path/flights --aircraft aircraft.toml \\\n"
            "    --responses CZ,Cm --candidates alpha,q_hat,de --degree 3",
        ),
        (
            "One long recording; delays of channels are estimated and corrected",
            "structsel reconstruct flight.csv --aircraft aircraft.toml \\\n"
            "    --cut manoeuvres --delays estimate --out path/",
        ),
        (
            "Compare three methods",
            "structsel reconstruct m01.csv --aircraft aircraft.toml --method all",
        ),
    ],
    """[bold]Required[/bold] are V ax az q, for lateral motion also ay p r. Each of alpha beta phi theta psi h x y vn
    ve vd is used if recorded. The aircraft file gives the positions of the instruments and, under noise, their
    accuracy; noise levels that it does not state are estimated. Constants that the data cannot determine are named
    and not estimated.""",
    """[bold]NOT TRUSTED[/bold] means that the instruments contradict each other. The reasons are printed first, and on
    stderr; the files are written nevertheless. A manoeuvre that cannot be reconstructed is reported and skipped.""",
)

_AIRCRAFT = "Positions of the instruments and, if known, their noise."


@takes_dataclass(ReconstructOptions, without=("method",))
def run(
    files: Files,
    aircraft: Annotated[Path, option("--aircraft", _AIRCRAFT, metavar="AIRCRAFT.TOML")],
    channel_map: Map = None,
    method: Annotated[
        Literal["unscented", "extended", "output-error", "all"],
        option(
            "--method",
            "unscented or extended: Kalman filter and smoother; output-error: inertial readings without noise; "
            "all: compare these.",
            "What is estimated",
            "METHOD",
        ),
    ] = "unscented",
    *,
    options: dict[str, Any],
    find_manoeuvres: Annotated[
        bool,
        typer.Option("--find-manoeuvres", hidden=True),
    ] = False,
    out: Annotated[
        Path | None,
        option("--out", "Folder for the reconstructed recordings, tables, report and plots.", OUTPUT, "DIR"),
    ] = None,
    file_format: Annotated[
        Literal["csv", "parquet"], option("--format", "File format of the recordings.", OUTPUT)
    ] = "csv",
    overwrite: Overwrite = False,
    before: Before = None,
    plots: Plots = True,
    plot_format: PlotFormat = "png",
    json: Json = False,
    workers: Annotated[
        int | None, option("--workers", "Number of processes; by default the number of cores.", "Fine tuning", "N")
    ] = None,
) -> None:
    """Reconstruct flight paths: estimate sensor biases, wind and vane errors, and the states without these errors."""
    if find_manoeuvres:
        say("warning", "--find-manoeuvres is deprecated: use --cut manoeuvres.")
    refuse_existing(out, overwrite)
    check_before(before, "structsel.reconstructions")
    aircraft_model = load_aircraft(aircraft)
    recorded = read_manoeuvres(files, channel_map, find_manoeuvres)
    methods = METHODS if method == "all" else (method,)
    found = _reconstruct_by_each(methods, recorded, aircraft_model, {**options, "workers": workers})
    written = _write(out, found, file_format, plot_format if plots else "", before) if out is not None else []
    if json:
        print_json(_as_dict(found))
        return
    _print(found, recorded)
    if out is not None:
        print_files(stdout(), str(out), written)


def _reconstruct_by_each(
    methods: Sequence[str], recorded: Sequence[Recording], aircraft_model: Aircraft, options: Mapping[str, Any]
) -> dict[str, Reconstructions]:
    """Return the reconstructions by each method that succeeds."""
    found: dict[str, Reconstructions] = {}
    for method in methods:
        try:
            found[method] = reconstruct_paths(recorded, aircraft_model, method=method, **options)
        except ReconstructionError as error:
            if method == methods[-1] and not found:
                raise
            say("warning", error.cli_message)
    return found


def _print(found: Mapping[str, Reconstructions], recorded: Sequence[Recording]) -> None:
    console = stdout()
    if len(found) == 1:
        for result in next(iter(found.values())):
            print_summary(console, result.summary())
        explain(console, COLUMN_NOTES)
    else:
        for recording in recorded:
            mine = {method: one for method, results in found.items() for one in results if one.name == recording.name}
            if mine:
                print_summary(console, summarise_reconstructions(mine))
    if len(recorded) > 1:
        for method, results in found.items():
            print_summary(console, replace(results.summary(), title=f"All manoeuvres, {method}", parts=()))


def _as_dict(found: Mapping[str, Reconstructions]) -> dict[str, Any]:
    """Return one method's reconstructions, or all methods by name."""
    return by_method({method: results.to_dict() for method, results in found.items()})


def _write(
    out: Path, found: Mapping[str, Reconstructions], file_format: str, figures: str, before: Path | None
) -> list[str]:
    """Write everything, or nothing; return the names written, folders as one. Several methods get a folder each."""
    with output_folder(out) as folder:
        for method, results in found.items():
            _write_one(folder if len(found) == 1 else folder / method, results, method, file_format, figures, before)
        return names_in(folder)


def _write_one(
    folder: Path, results: Reconstructions, method: str, file_format: str, figures: str, before: Path | None
) -> None:
    import pandas as pd

    from structsel.report import write_report

    flights = folder / "flights"
    flights.mkdir(parents=True)
    for recording in results.recordings:
        write_recording(recording, flights / f"{recording.name}.{file_format}")
    (folder / "reconstruction.json").write_text(json_text(results.to_dict()), encoding="utf-8")
    (folder / "report.txt").write_text(f"{results}\n", encoding="utf-8")
    write_report(results, folder / "report.html", before=before, provenance=provenance())
    heads = [one.to_frame().assign(manoeuvre=one.name, method=method, trusted=one.trusted) for one in results]
    table = pd.concat(heads, ignore_index=True)
    first = ["manoeuvre", "method", "trusted"]
    csv_of_frame(table[[*first, *(name for name in table if name not in first)]], folder / "constants.csv")
    if figures:
        from structsel.plotting import draw_reconstructions  # matplotlib takes a while to load

        save_figures(folder / "plots", draw_reconstructions(results), figures, 4 * len(results) + 1)
