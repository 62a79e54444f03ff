"""Recordings that stay in their files, for sets of recordings that are larger than the memory."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from structsel.cli.cutting import is_cut
from structsel.cli.help_text import option
from structsel.cli.messages import ProgressBar, say
from structsel.cli.recordings import RecordingOptions, expand, load_aircraft, report_findings
from structsel.coefficients import compute_coefficients
from structsel.errors import DataError
from structsel.readers.channel_map import load_channel_map
from structsel.recording import Recording, StoredRecording, read_recording, stream_recordings
from structsel.recording.reading import list_files

STREAM_ABOVE = 512 << 20
"""Files of more bytes than this are streamed, without --stream or --no-stream."""
REPORT_RECORDINGS = 3
"""Streamed recordings that a report and plots show, if there are no validation recordings."""

_PANEL = "More than fits in memory"


@dataclass(frozen=True)
class StreamingOptions:
    """Whether recordings stay in their files, and where an interrupted run is kept."""

    stream: Annotated[
        bool | None,
        option(
            "--stream/--no-stream",
            "Read recordings one by one, in every pass. By default where files have more than 512 MiB.",
            _PANEL,
        ),
    ] = None
    checkpoint: Annotated[
        Path | None,
        option(
            "--checkpoint",
            "File with the state of a streamed run, from which it continues if it was interrupted; next to --out if "
            "not given.",
            _PANEL,
            "FILE",
        ),
    ] = None

    def use_for(self, files: Sequence[Path], reconstruct: bool) -> bool:
        """Whether recordings stay in their files.

        Raises
        ------
        BadParameter
            --stream and --reconstruct are both given.
        """
        if self.stream and reconstruct:
            raise typer.BadParameter(
                "--stream reads recordings many times, and --reconstruct would be repeated each time: write "
                "reconstructed recordings with structsel reconstruct --out, and stream those."
            )
        if self.stream is not None or reconstruct or is_cut():
            return bool(self.stream)
        files = expand(files)
        return sum(path.stat().st_size for one in files if one.exists() for path in list_files(one)) > STREAM_ABOVE

    def checkpoint_file(self, out: Path | None, streamed: bool) -> Path | None:
        """File with the state of the run: the one given, or one next to the results of a streamed run."""
        if self.checkpoint is not None and self.checkpoint.is_dir():
            raise DataError(f"--checkpoint '{self.checkpoint}' is a folder; give a file.")
        if self.checkpoint is not None or out is None or not streamed:
            return self.checkpoint
        return out.resolve().with_name(f"{out.resolve().name}.checkpoint")


def stream_flights(files: Iterable[Path], recorded: RecordingOptions, wanted: set[str]) -> list[StoredRecording]:
    """Manoeuvres with coefficients, as `read_flights` gives them, but left in their files.

    Raises
    ------
    DataError
        Two recordings of one name, or whatever reading raises.
    """
    paths = [path for given in expand(files) for path in sorted(list_files(given), key=lambda path: path.stem)]
    mapped = None if recorded.channel_map is None else load_channel_map(recorded.channel_map)
    prepare = None
    if recorded.aircraft is not None:
        aircraft_model = load_aircraft(recorded.aircraft)
        speed = recorded.v0 if recorded.v0 is not None else aircraft_model.V0
        if speed is None:
            first = read_recording(paths[0], mapped).split()[0]
            speed = float(compute_coefficients(first, aircraft_model)["V"].mean())
            say("note", f"V0 = {speed:.4f} m/s is the mean V of '{first.name}'; give --v0, or V0 in aircraft.toml.")
        prepare = partial(compute_coefficients, aircraft=aircraft_model, V0=speed)
    with ProgressBar("looking through the files") as waiting:
        found = stream_recordings(paths, mapped, prepare=prepare, split=True, progress=partial(waiting, "files"))
    place = {path: i for i, path in enumerate(paths)}
    found.sort(key=lambda flight: place[flight.origin.path])  # the order of the command line, as without streaming
    for path, parts in Counter(flight.origin.path for flight in found).items():
        if parts > 1:
            say("note", f"'{path}' has gaps in time and is read as {parts} manoeuvres.")
    report_findings(found, wanted)
    return found


def report_sample(recordings: Sequence[Recording | StoredRecording]) -> list[Recording]:
    """Recordings for a report: all that are in memory, or the first few of those that are not."""
    return [
        flight.read() if isinstance(flight, StoredRecording) else flight
        for i, flight in enumerate(recordings)
        if isinstance(flight, Recording) or i < REPORT_RECORDINGS
    ]
