"""``structsel aircraft``: a commented aircraft file to fill in, or a check of one."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from structsel.cli.help_text import epilog, option
from structsel.cli.messages import print_json, say, stdout
from structsel.cli.recordings import Json, load_aircraft
from structsel.cli.tables import print_files, print_summary
from structsel.errors import DataError
from structsel.files import write_text

EPILOG = epilog(
    [
        ("A file to fill in", "structsel aircraft --template > aircraft.toml"),
        ("Check it", "structsel aircraft aircraft.toml"),
    ],
    """Units are SI and radians. name, S, b and cbar are required. Forces need mass; moments need the table inertia.""",
)
TEMPLATE = """\
# Aircraft file of structsel. Units are SI and radians; body axes are x forward, y right, z down.
# Lines that begin with # are comments: remove the # of what you know. The values are those of a light aircraft.

schema = "structsel.aircraft/1"
name = "my aircraft"
S = 23.23                       # reference area, m^2
b = 14.63                       # span, m
cbar = 1.5875                   # mean aerodynamic chord, m
mass = 2288.0                   # kg; leave it out if the recordings have a channel mass
# V0 = 45.0                     # reference airspeed of V_ratio, m/s; by default the mean V of the first recording

[inertia]                       # about the centre of gravity, kg m^2; needed for Cl, Cm and Cn
Ix = 5368.0
Iy = 6929.0
Iz = 11159.0
Ixz = 117.6                     # integral of x z over the mass; its sign in the inertia tensor is minus
# Ixy = 0.0
# Iyz = 0.0

# [thrust]                      # line of the total thrust
# offset = [0.0, 0.0, 0.0]      # a point of it, from the centre of gravity: x, y, z in m
# inclination = 0.0             # rad; positive tilts the thrust up

# [sensors.accelerometer]       # positions are from the centre of gravity: x, y, z in m
# position = [0.1, 0.0, 0.05]
# noise = { ax = 0.02, ay = 0.02, az = 0.05 }           # standard deviations, m/s^2

# [sensors.gyro]
# noise = { p = 0.002, q = 0.001, r = 0.001 }           # rad/s

# [sensors.vane]                # alpha, beta and V; tables alpha_vane, beta_vane and pitot if they are apart
# position = [2.0, 3.5, 0.0]
# noise = { alpha = 0.002, beta = 0.002, V = 0.2 }      # rad, rad, m/s
# angle = "sideslip"            # or "flank": a vane that reads atan(v/u)

# [tolerances]                  # standard deviations of the simulation that diagnose checks; "exact" or "free" too
# main = 0.05                   # main derivatives, relative
# secondary = 0.15              # other derivatives, relative
# mass = 0.01                   # relative
# inertia = 0.05                # relative
# cg = 0.005                    # centre of gravity, fraction of cbar
# thrust = 0.03                 # relative
# vane_scale = 0.015            # relative
# alignment = 0.005             # of vanes and inertial axes, rad
# delay = 0.005                 # between channels, s
# lever_arm = 0.15              # positions of the sensors, m
# form = 0.0                    # rms that the terms of the simulation leave, relative to the variation of each response

# [engine]
# angular_momentum = 0.0        # of rotating parts along body x, kg m^2/s

# [simulation]
# states = "reconstructed"      # or "raw": the states at which the coefficients of a simulated file were computed
"""


def run(
    file: Annotated[Path | None, typer.Argument(metavar="AIRCRAFT.TOML", help="File to be checked.")] = None,
    template: Annotated[bool, option("--template", "Print a commented file to fill in.")] = False,
    out: Annotated[
        Path | None, option("--out", "With --template: new file instead of printing.", metavar="FILE.TOML")
    ] = None,
    json: Json = False,
) -> None:
    """Print a commented aircraft file to fill in, or check one."""
    if template == (file is not None):
        raise typer.BadParameter("give --template, or an aircraft file to be checked.")
    if file is not None:
        aircraft = load_aircraft(file)
        if json:
            print_json(aircraft.to_dict())
        else:
            print_summary(stdout(), aircraft.summary())
    elif out is None:
        typer.echo(TEMPLATE, nl=False)
    else:
        if out.exists():
            raise DataError(f"--out '{out}' exists already and is not overwritten. Choose another name.")
        write_text(out, TEMPLATE)
        print_files(stdout(), str(out.parent), [out.name])
        say("note", f"fill it in, then: structsel aircraft {out}")
