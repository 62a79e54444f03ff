"""``structsel describe``: what is in the files, and what looks wrong."""

from __future__ import annotations

from structsel.cli.flights import Files, Json, Map, read_files
from structsel.cli.pages import page
from structsel.cli.tables import print_recording
from structsel.cli.terminal import print_json, stdout

EPILOG = page(
    [
        ("Columns under their own names", "structsel describe flight.csv"),
        ("As the map makes them, SI and radians", "structsel describe flights/ --map map.toml"),
        ("With every conversion made, under provenance", "structsel describe flight.csv --json"),
    ],
    """[bold]Found[/bold] are gaps, repeated or backward time, samples that are no numbers, channels that never move or
    hang, and magnitudes that betray a wrong unit or sign. Nothing is mended.""",
)


def run(files: Files, channel_map: Map = None, json: Json = False) -> None:
    """Show the channels of recordings, their units and ranges, and what looks wrong."""
    recordings = read_files(files, channel_map)
    if json:
        print_json({"schema": "structsel.description/1", "recordings": [r.to_dict() for r in recordings]})
        return
    console = stdout()
    for recording in recordings:
        print_recording(console, recording)
