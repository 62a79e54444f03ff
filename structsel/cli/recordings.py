"""Recordings for the commands: read, split at gaps, with coefficients, some for validation."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from glob import glob
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import typer

from structsel.aircraft import Aircraft
from structsel.cli.cutting import cut, is_cut
from structsel.cli.help_text import option
from structsel.cli.messages import ProgressBar, say
from structsel.cli.parsing import split_names
from structsel.coefficients import compute_all
from structsel.errors import DataError, ReconstructionError, SelectionError
from structsel.formatting import count_of
from structsel.readers.channel_map import load_channel_map
from structsel.reconstruction import METHODS, Reconstructions, reconstruct_all
from structsel.recording import Recording, StoredRecording, read_recordings
from structsel.recording.sets import same_flights

MoreRecordings = Annotated[list[Path] | None, typer.Argument(hidden=True)]
"""Files after the first one of ``--recordings``."""
Flight = TypeVar("Flight", Recording, StoredRecording)

OUTPUT = "Output"
"""Panel of the help pages."""

Files = Annotated[
    list[Path],
    typer.Argument(
        metavar="FILES",
        help="Files with one manoeuvre each, or folders of them: text, Parquet, MATLAB, NumPy, HDF5, flight logs.",
    ),
]
Map = Annotated[
    Path | None,
    option(
        "--map",
        "Channel map: columns, units and signs of the channels. Without it columns keep their names.",
        metavar="MAP.TOML",
    ),
]
AircraftFile = Annotated[
    Path | None,
    option(
        "--aircraft",
        "Geometry, mass, inertia, thrust line, positions of the instruments. If given, coefficients are computed "
        "first; else the responses must be channels of the files.",
        metavar="AIRCRAFT.TOML",
    ),
]
V0 = Annotated[
    float | None,
    option("--v0", "Reference airspeed of V_ratio, in m/s. Default: that of the aircraft file, else the first mean V."),
]
Reconstruct = Annotated[
    bool,
    option(
        "--reconstruct",
        "Reconstruct the flight paths first, with the defaults of structsel reconstruct. Needs --aircraft.",
    ),
]
Plots = Annotated[bool, option("--plots/--no-plots", "Whether to write plots to --out.", OUTPUT)]
PlotFormat = Annotated[
    Literal["png", "svg", "pdf"], option("--plot-format", "Format of the plots, at print quality.", OUTPUT)
]
Before = Annotated[
    Path | None,
    option("--before", "JSON file of an earlier run: report.html shows the values that differ.", OUTPUT, "FILE.JSON"),
]
Json = Annotated[bool, option("--json", "Print JSON only.", OUTPUT)]
Overwrite = Annotated[bool, option("--overwrite", "Replace existing files.", OUTPUT)]


@dataclass(frozen=True)
class RecordingOptions:
    """Channel map, aircraft and preparation of recordings."""

    channel_map: Map = None
    aircraft: AircraftFile = None
    reconstruct: Reconstruct = False
    v0: V0 = None

    def read(self, files: Iterable[Path], wanted: Iterable[str] | None = None) -> list[Recording]:
        """Read the manoeuvres of these files; see `read_flights`."""
        return read_flights(files, self.channel_map, self.aircraft, self.v0, wanted, self.reconstruct)


@dataclass(frozen=True)
class OutputOptions:
    """Format of the output, and whether files are replaced."""

    overwrite: Overwrite = False
    plots: Plots = True
    plot_format: PlotFormat = "png"
    json: Json = False

    @property
    def figures(self) -> str:
        """Format of the plots; empty without plots."""
        return self.plot_format if self.plots else ""


def check_before(before: Path | None, schema: str) -> None:
    """Refuse a file that is no earlier result of this kind, before anything is computed.

    Raises
    ------
    DataError
    """
    if before is not None:
        from structsel.report.changes import read_result  # takes a while to load

        read_result(before, schema)


def expand(files: Iterable[Path]) -> list[Path]:
    """Files and folders, with patterns such as ``flights/m*.csv`` replaced by the files that match, in order of name.

    Raises
    ------
    DataError
        No file matches a pattern.
    """
    found: list[Path] = []
    for path in files:
        if path.exists() or not any(mark in str(path) for mark in "*?["):
            found.append(path)
            continue
        matches = [Path(name) for name in sorted(glob(str(path), recursive=True))]
        if not matches:
            raise DataError(f"no file matches '{path}'.\nCheck the folder and the ending of the name.")
        found += matches
    return found


def read_files(files: Iterable[Path], channel_map: Path | None) -> list[Recording]:
    """Every recording of files and folders, in the order given.

    Raises
    ------
    DataError
        Two recordings of one name, or whatever reading raises.
    """
    mapped = None if channel_map is None else load_channel_map(channel_map)
    found: list[Recording] = []
    for path in expand(files):
        for recording in read_recordings(path, mapped):
            if recording.name in {other.name for other in found}:
                raise DataError(
                    f"two recordings have the name '{recording.name}'; the second is in '{path}'.\n"
                    "Rename one, or give each file once."
                )
            found.append(recording)
    return found


def load_aircraft(path: Path) -> Aircraft:
    """Aircraft of a file; remarks about it are printed on stderr."""
    aircraft_model = Aircraft.from_toml(path)
    for remark in aircraft_model.remarks:
        say("warning", f"aircraft '{aircraft_model.name}': {remark}.")
    return aircraft_model


def read_manoeuvres(files: Iterable[Path], channel_map: Path | None, find: bool = False) -> list[Recording]:
    """Recordings cut as `--cut` states, or with `find` where controls move, and split at gaps in time.

    Raises
    ------
    DataError
        No control moves, or whatever reading raises.
    """
    recordings: list[Recording] = []
    for recording in read_files(files, channel_map):
        chosen = cut(recording, find)
        if find or is_cut():
            names = ", ".join(f"{p.name} ({p.t[0]:g} to {p.t[-1]:g} s)" for p in chosen) or "none"
            say("note", f"'{recording.name}' is cut into {count_of(len(chosen), 'part')}: {names}.")
        for part in chosen:
            parts = part.split()
            if len(parts) > 1:
                names = f"{parts[0].name} to {parts[-1].name}"
                say("note", f"'{part.name}' has gaps in time and is read as {len(parts)} manoeuvres, {names}.")
            recordings += parts
    if not recordings:
        raise DataError("--cut manoeuvres found no part in which controls move.\nLeave it out to use complete files.")
    return recordings


def read_flights(
    files: Iterable[Path],
    channel_map: Path | None,
    aircraft: Path | None,
    v0: float | None = None,
    wanted: Iterable[str] | None = None,
    reconstruct: bool = False,
) -> list[Recording]:
    """Manoeuvres of files, split at gaps in time, with coefficients, and reconstructed first if `reconstruct` is True.

    Warnings of the checks are printed on stderr, and notes on `wanted` channels (all if None).

    Raises
    ------
    BadParameter
        `reconstruct` without an aircraft.
    """
    if reconstruct and aircraft is None:
        raise typer.BadParameter("--reconstruct needs --aircraft, which gives the positions of the instruments.")
    aircraft_model = None if aircraft is None else load_aircraft(aircraft)
    recordings = read_manoeuvres(files, channel_map)
    if aircraft_model is not None:
        if reconstruct:
            recordings = reconstruct_paths(recordings, aircraft_model).recordings
        recordings = compute_all(recordings, aircraft_model, V0=v0)
    report_findings(recordings, None if wanted is None else set(wanted))
    return recordings


def reconstruct_paths(recordings: Sequence[Recording], aircraft_model: Aircraft, **options: Any) -> Reconstructions:
    """Reconstruct manoeuvres; those that fail or are not trusted are reported on stderr.

    Raises
    ------
    ReconstructionError
        No manoeuvre could be reconstructed.
    """
    with ProgressBar(f"reconstructing, {options.get('method', METHODS[0])}") as waiting:
        results = reconstruct_all(recordings, aircraft_model, progress=waiting, **options)
    by = f" by {options['method']}" if "method" in options else ""
    if not len(results):
        whys = (f"'{name}': {why}" for name, why in results.failed.items())
        raise ReconstructionError("\n".join([f"no manoeuvre could be reconstructed{by}.", *whys]))
    for name, why in results.failed.items():
        say("warning", f"'{name}' was not reconstructed{by}: {why}")
    for one in results:
        if not one.trusted:
            more = f" (and {len(one.distrust) - 1} more)" if len(one.distrust) > 1 else ""
            say(
                "warning",
                f"'{one.name}'{by} is {one.verdict}: {one.distrust[0].removeprefix(f'{one.verdict}: ')}{more}.",
            )
    return results


def report_findings(recordings: Sequence[Recording | StoredRecording], wanted: set[str] | None = None) -> None:
    """Print the findings of the checks on stderr, equal ones of several recordings once, and flights given twice."""
    unused = set() if wanted is None else {"V_ratio", "mach", "CT"} - wanted
    # Samples that are not numbers raise an error where a command needs them, and do not matter elsewhere.
    severities = {"warning"} if wanted is not None else {"warning", "error"}
    same: dict[tuple[str, str, str], list[tuple[str, str]]] = {}
    for recording in recordings:
        for f in recording.findings:
            if f.severity in severities or (f.kind in ("left-out", "assumed") and f.channel not in unused):
                kind = "note" if f.severity == "note" else "warning"
                text = str(f).removeprefix(f"{f.severity}: ")
                same.setdefault((kind, f.kind, f.channel), []).append((recording.name, text))
    for (kind, _, _), found in sorted(same.items(), reverse=True):
        name, text = found[0]
        more = f" (and in {len(found) - 1} more)" if len(found) > 1 else ""
        say(kind, f"{name}{more}: {text}")
    for text in same_flights(recordings):
        say("warning", text)


def hold_out(recordings: Sequence[Flight], names: str) -> tuple[list[Flight], list[Flight]]:
    """Recordings for the fit, and those of these names (or parts of them) for validation.

    Raises
    ------
    SelectionError
        No recording has one of the names, or none remains for the fit.
    """
    held: list[Flight] = []
    for name in split_names(names):
        mine = [r for r in recordings if r.name == name]
        mine = mine or [r for r in recordings if any(note.endswith(f" of '{name}'") for note in r.provenance)]
        if not mine:
            there = ", ".join(r.name for r in recordings)
            raise SelectionError(f"--held-out names '{name}', but no recording has this name. There are: {there}.")
        held += [r for r in mine if r not in held]
    used = [r for r in recordings if r not in held]
    if not used:
        raise SelectionError("--held-out leaves no recording for the fit. Name fewer recordings, or give more files.")
    return used, held
