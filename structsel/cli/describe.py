"""``structsel describe``: channels of recordings, and faults in the data."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from structsel.cli.cutting import cut
from structsel.cli.help_text import epilog, option
from structsel.cli.messages import print_json, say, stdout
from structsel.cli.recordings import Files, Json, Map, read_files
from structsel.cli.tables import print_summary
from structsel.errors import DataError
from structsel.files import write_text
from structsel.formatting import count_of
from structsel.readers import read_table
from structsel.readers.channel_map import FileOptions, load_channel_map
from structsel.readers.column_guess import SURE, UNSURE
from structsel.readers.guess_map import GuessedMap, guess_map
from structsel.tables import Cell, Summary, Table, Tone, text_column

EPILOG = epilog(
    [
        ("Columns by their own names; a flight log by its standard map", "structsel describe flight.csv"),
        ("Guess a channel map, to be checked and edited", "structsel describe flight.csv --guess-map map.toml"),
        ("Channels of the map, in SI units and radians", "structsel describe flights/ --map map.toml"),
        ("With a record of every conversion, under provenance", "structsel describe flight.csv --json"),
    ],
    """The command reports gaps, time that repeats or runs backwards, samples that are not numbers, channels that are
    constant or frozen, and magnitudes that indicate a wrong unit or sign. The data are not changed.""",
)
GuessMap = Annotated[
    Path | None,
    option(
        "--guess-map",
        "Guess a channel map from names, units and values, rate the confidence of each line, and write it to this "
        "new file. The [file] table of --map, if given, states how to read the file.",
        metavar="MAP.TOML",
    ),
]
_TONES: dict[str, Tone] = {SURE: "good", UNSURE: "warning"}
_MAX_NAMES = 20  # unrecognised columns that are named; the map lists all


def run(files: Files, channel_map: Map = None, guess_map_file: GuessMap = None, json: Json = False) -> None:
    """Print the channels of recordings with units and ranges, and report faults in the data."""
    if guess_map_file is not None:
        guess(files, channel_map, guess_map_file, json)
        return
    recordings = [part for recording in read_files(files, channel_map) for part in cut(recording)]
    if json:
        print_json({"schema": "structsel.description/1", "recordings": [r.to_dict() for r in recordings]})
        return
    console = stdout()
    for recording in recordings:
        print_summary(console, recording.summary())


def guess(files: list[Path], channel_map: Path | None, target: Path, json: bool, option: str = "--guess-map") -> None:
    """Guess the channel map of a file, write it and print it.

    Raises
    ------
    BadParameter
        There are several files, or it is a folder.
    DataError
        The target exists, or cannot be written.
    """
    if len(files) != 1 or files[0].is_dir():
        verb = "structsel map" if option == "--out" else option
        raise typer.BadParameter(
            f"{verb} takes one file, neither several nor a folder. The map then applies to all files of that kind."
        )
    if target.exists():
        raise DataError(f"{option} '{target}' exists already and is not overwritten. Choose another name.")
    options = FileOptions() if channel_map is None else load_channel_map(channel_map).file
    guessed = guess_map(read_table(files[0], options), options)
    _write(guessed, target, option)
    if json:
        print_json({"schema": "structsel.guessed_map/1", "map": str(target), **guessed.to_dict()})
        return
    print_summary(stdout(), _summary(guessed))
    say("note", f"written to '{target}'. Check it, then: structsel describe {files[0]} --map {target}")


def _write(guessed: GuessedMap, target: Path, option: str) -> None:
    try:
        write_text(target, str(guessed))
    except OSError as error:
        raise DataError(f"{option} '{target}' cannot be written: {error.strerror or error}.") from error


def _summary(guessed: GuessedMap) -> Summary:
    columns = (text_column("channel"), text_column("sure"), text_column("column"), text_column("why"))
    rows = tuple((g.channel, Cell(g.sure, _TONES.get(g.sure, "")), " ".join(g.columns), g.why) for g in guessed.guesses)
    names = list(guessed.unplaced)
    more = f", ... ({len(names)} in all)" if len(names) > _MAX_NAMES else ""
    return Summary(
        Path(guessed.path).name,
        f"{count_of(len(guessed.guesses), 'channel')} guessed",
        tables=(Table(columns, rows),),
        notes=(f"not recognised: {', '.join(names[:_MAX_NAMES])}{more}",) if names else (),
    )
