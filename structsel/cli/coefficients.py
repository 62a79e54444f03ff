"""``structsel coefficients``: files with aerodynamic coefficients and candidate channels of recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from structsel.cli.folders import output_folder, refuse_existing
from structsel.cli.help_text import epilog, option
from structsel.cli.messages import print_json, stdout
from structsel.cli.recordings import V0, Files, Json, Map, Overwrite, Reconstruct, read_flights
from structsel.cli.tables import print_files, print_summary
from structsel.recording import write_recording

EPILOG = epilog(
    [
        (
            "One file per manoeuvre",
            "structsel coefficients flights/ --map map.toml \\\n    --aircraft aircraft.toml --out coefficients/",
        )
    ],
    """The command adds CX CY CZ Cl Cm Cn, CL CD, CT, and the channels p_hat q_hat r_hat alpha_dot_hat beta_dot_hat
    V_ratio qbar mach for candidate terms. A channel is left out if the recording lacks data for it. Channels that are
    left out, and inputs that are assumed to be zero, are reported. All commands read these files without a channel
    map.""",
)

_AIRCRAFT = "Geometry, mass, inertia, thrust line, positions of the instruments."


def run(
    files: Files,
    aircraft: Annotated[Path, option("--aircraft", _AIRCRAFT, metavar="AIRCRAFT.TOML")],
    out: Annotated[Path, option("--out", "Folder for one file per manoeuvre.", metavar="DIR")],
    channel_map: Map = None,
    file_format: Annotated[Literal["csv", "parquet"], option("--format", "File format.")] = "csv",
    reconstruct: Reconstruct = False,
    v0: V0 = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Compute the aerodynamic coefficients of recordings, and write them with the channels of candidate terms."""
    refuse_existing(out, overwrite)
    recordings = read_flights(files, channel_map, aircraft, v0, reconstruct=reconstruct)
    names = [f"{r.name}.{file_format}" for r in recordings]
    with output_folder(out) as folder:
        for recording, name in zip(recordings, names):
            write_recording(recording, folder / name)
    if json:
        print_json({"schema": "structsel.description/1", "recordings": [r.to_dict() for r in recordings]})
        return
    console = stdout()
    for recording in recordings:
        print_summary(console, recording.summary())
    print_files(console, str(out), names)
