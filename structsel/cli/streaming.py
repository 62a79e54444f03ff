"""Flights that stay in their files, for commands that go through more of them than memory holds."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from structsel.cli.messages import Waiting, say
from structsel.cli.recordings import load_aircraft, option, say_findings
from structsel.coefficients import compute_coefficients
from structsel.errors import DataError
from structsel.readers.channel_map import load_channel_map
from structsel.recording import Recording, StoredRecording, read_recording, stream_recordings
from structsel.recording.reading import list_files

MANY_BYTES = 512 << 20
"""Files of more than this are streamed, if nothing else is asked for."""
SHOWN = 3
"""Streamed flights that a report and plots show, if none is held out."""

_PANEL = "More than fits in memory"
Stream = Annotated[
    bool | None,
    typer.Option(
        "--stream/--no-stream",
        help="Read recordings one at a time, at every pass. By default where files hold more than 512 MiB.",
        rich_help_panel=_PANEL,
    ),
]
CheckpointFile = Annotated[
    Path | None,
    option(
        "--checkpoint",
        "Where a streamed run keeps what it has, to go on if it is broken off; beside --out if not given.",
        _PANEL,
        "FILE",
    ),
]


def to_stream(files: Sequence[Path], asked: bool | None, reconstruct: bool) -> bool:
    """Whether to leave recordings in their files.

    Raises
    ------
    BadParameter
        Streaming and reconstructing are both asked for.
    """
    if asked and reconstruct:
        raise typer.BadParameter(
            "--stream reads flights many times, and --reconstruct would be done each time: write reconstructed "
            "flights with structsel reconstruct --out, and stream those."
        )
    if asked is not None or reconstruct:
        return bool(asked)
    return sum(path.stat().st_size for given in files if given.exists() for path in list_files(given)) > MANY_BYTES


def stream_flights(
    files: Iterable[Path], channel_map: Path | None, aircraft: Path | None, v0: float | None, wanted: set[str]
) -> list[StoredRecording]:
    """Manoeuvres ready to be modelled, as `read_flights` gives them, but left in their files.

    Raises
    ------
    DataError
        Two recordings of one name, or whatever reading raises.
    """
    paths = [path for given in files for path in sorted(list_files(given), key=lambda path: path.stem)]
    mapped = None if channel_map is None else load_channel_map(channel_map)
    prepare = None
    if aircraft is not None:
        aircraft_model = load_aircraft(aircraft)
        speed = v0 if v0 is not None else aircraft_model.V0
        if speed is None:
            first = read_recording(paths[0], mapped).split()[0]
            speed = float(compute_coefficients(first, aircraft_model)["V"].mean())
            say("note", f"V0 = {speed:.4f} m/s is the mean V of '{first.name}'; give --v0, or V0 in aircraft.toml.")
        prepare = partial(compute_coefficients, aircraft=aircraft_model, V0=speed)
    with Waiting("looking through the files") as waiting:
        flown = stream_recordings(paths, mapped, prepare=prepare, split=True, progress=partial(waiting, "files"))
    place = {path: i for i, path in enumerate(paths)}
    flown.sort(key=lambda flight: place[flight.origin.path])  # as given: what is held out together goes by it
    for path, parts in Counter(flight.origin.path for flight in flown).items():
        if parts > 1:
            say("note", f"'{path}' has gaps in time: taken as {parts} manoeuvres.")
    say_findings(flown, wanted)
    return flown


def checkpoint_file(asked: Path | None, out: Path | None, streamed: bool) -> Path | None:
    """Where to keep what a run has: where asked for, or beside the results."""
    if asked is not None and asked.is_dir():
        raise DataError(f"--checkpoint '{asked}' is a folder; give a file.")
    if asked is not None or out is None or not streamed:
        return asked
    return out.resolve().with_name(f"{out.resolve().name}.checkpoint")


def to_show(flown: Sequence[Recording | StoredRecording]) -> list[Recording]:
    """Recordings for a report: all that are in memory, or the first few of those that are not."""
    return [
        flight.read() if isinstance(flight, StoredRecording) else flight
        for i, flight in enumerate(flown)
        if isinstance(flight, Recording) or i < SHOWN
    ]
