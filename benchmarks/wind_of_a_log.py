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
from real_recordings import as_simulation, in_still_air, mean_difference, moved, speed_over_ground

import structsel as ss
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


def simulations(parts: list[Recording]) -> tuple[dict[str, Mapping[str, Recording]], dict[str, float]]:
    """Simulations of the velocity over the ground, of the airspeed, and of the first in the mean wind; that wind."""
    still = {r.name: {c: x for c, x in in_still_air(r).items() if c in GROUND} for r in parts}
    wind = mean_difference(parts, still)
    made = {
        "velocity over the ground": still,
        "airspeed": {r.name: speed_over_ground(r) for r in parts},
        "with the mean wind": moved(still, wind),
    }
    return {what: as_simulation(parts, each) for what, each in made.items()}, wind


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
        stated_by, wind = simulations(chosen)
        print(f"mean difference: {wind['vn']:.1f} m/s north, {wind['ve']:.1f} m/s east")
        for what, simulated in stated_by.items():
            began = time.process_time()
            found = ss.diagnose(simulated, chosen)
            taken = time.process_time() - began
            names = ", then ".join(f"{f.effect} {f.probability:.2f}" for f in found.findings)
            first = found.findings[0].physics[0].says if found.findings else ""
            print(f"  {what}: {found.verdict} {names} ({taken:.0f} s). {first}", flush=True)


if __name__ == "__main__":
    main()
