"""``structsel map``: a channel map that is guessed from a file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from structsel.cli.describe import guess
from structsel.cli.help_text import epilog, option
from structsel.cli.recordings import Json, Map

EPILOG = epilog(
    [
        (
            "Guess, check and use a channel map",
            "structsel map flight.csv\n  structsel describe flight.csv --map map.toml",
        )
    ],
    """The file has one commented line for each channel: column, unit, sign, and how sure the guess is. Columns that are
    not recognised are listed at its end. Check it before use.""",
)


def run(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="One recording; the map then applies to all of its kind.")
    ],
    out: Annotated[
        Path, option("--out", "New file to be written; an existing one is refused.", metavar="MAP.TOML")
    ] = Path("map.toml"),
    channel_map: Map = None,
    json: Json = False,
) -> None:
    """Guess the channel map of a file from names, units and values, and write it with comments."""
    guess([file], channel_map, out, json, "--out")
