"""Wind in a flight log: simulations in still air of the velocity over the ground, and of the airspeed.

Every part of a log in which the airspeed stays above a limit is a recording. The simulation lets the air flow along the
body axis x, so that the velocity over the ground follows from airspeed and attitude, and is wrong by the wind; with the
mean difference added it is correct.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np

import structsel as ss
from structsel.numerics.air_data import body_to_earth
from structsel.numerics.arrays import Array
from structsel.recording import Recording

CHANNELS = ("p", "q", "r", "ax", "ay", "az", "phi", "theta", "psi", "V", "vn", "ve", "vd")
GROUND = ("vn", "ve")


def flown(log: Recording, seconds: float, least: float) -> list[Recording]:
    """Parts of a log that last some seconds, with an airspeed above the least."""
    parts, start = [], float(log.t[0])
    while start + seconds < log.t[-1]:
        part = log.between(start, start + seconds)
        slow = np.flatnonzero(~(part["V"] > least))
        if slow.size:
            start = float(part.t[slow[-1]]) + float(np.median(np.diff(part.t)))
            continue
        parts.append(Recording(f"part{len(parts) + 1:02d}", part.t, {c: part[c] for c in CHANNELS}))
        start += seconds
    return parts


def in_still_air(part: Recording) -> dict[str, Array]:
    """Velocity over the ground, north and east."""
    along = np.column_stack([part["V"], 0.0 * part["V"], 0.0 * part["V"]])
    north, east, _ = np.einsum("nij,nj->in", body_to_earth(part["phi"], part["theta"], part["psi"]), along)
    return {"vn": north, "ve": east}


def simulations(parts: list[Recording]) -> dict[str, Mapping[str, Recording]]:
    """Three simulations: of the velocity over the ground, of the airspeed, and the first with the mean wind."""
    still = {r.name: in_still_air(r) for r in parts}
    wind = {c: float(np.mean(np.concatenate([r[c] - still[r.name][c] for r in parts]))) for c in GROUND}
    print(f"mean difference: {wind['vn']:.1f} m/s north, {wind['ve']:.1f} m/s east")
    made = {
        "velocity over the ground": still,
        "airspeed": {r.name: {"V": np.sqrt(sum(r[c] ** 2 for c in (*GROUND, "vd")))} for r in parts},
        "with the mean wind": {name: {c: x + wind[c] for c, x in one.items()} for name, one in still.items()},
    }
    return {
        what: {r.name: Recording(r.name, r.t, each[r.name], dict.fromkeys(each[r.name], "m/s")) for r in parts}
        for what, each in made.items()
    }


def main() -> None:
    """Diagnose the three simulations on groups of parts, and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("log", type=Path, help="a log with airspeed, attitude and velocity over the ground")
    parser.add_argument("--seconds", type=float, default=40.0, help="length of a part")
    parser.add_argument("--least", type=float, default=8.0, help="least airspeed [m/s]")
    parser.add_argument("--group", type=int, default=6, help="parts that are diagnosed together")
    stated = parser.parse_args()
    warnings.simplefilter("ignore")
    parts = flown(ss.read_recording(stated.log), stated.seconds, stated.least)
    for start in range(0, len(parts) - stated.group + 1, stated.group):
        chosen = parts[start : start + stated.group]
        print(f"{chosen[0].name} to {chosen[-1].name}, {chosen[0].t[0]:.0f} to {chosen[-1].t[-1]:.0f} s")
        for what, simulated in simulations(chosen).items():
            began = time.process_time()
            found = ss.diagnose(simulated, chosen)
            taken = time.process_time() - began
            names = ", then ".join(f"{f.effect} {f.probability:.2f}" for f in found.findings)
            first = found.findings[0].physics[0].says if found.findings else ""
            print(f"  {what}: {found.verdict} {names} ({taken:.0f} s). {first}", flush=True)


if __name__ == "__main__":
    main()
