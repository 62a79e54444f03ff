"""Time of a diagnosis: eight manoeuvres of 30 s at 50 Hz, all responses and hypotheses.

    python benchmarks/diagnosis.py --out diagnosis.md        # about 3 minutes

The demonstration aeroplane, with noise as of flight-test instruments; its simulation lacks the pitching
moment of sideslip. Each diagnosis runs in a fresh interpreter, as a command does, and is measured from the call on:
what it loads counts, what `import structsel` takes does not. In the same interpreter, afterwards, the floor: every
recorded channel smoothed once.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Sequence
from statistics import median

import numpy as np
from numpy.typing import NDArray
from timing import HERE, machine, publish, say, table

import structsel as ss
from structsel.demo.truth import TRUTH, demo_aircraft
from structsel.numerics.smoothing import smooth_spline
from structsel.simulation import Instruments, simulate, trim

SPEEDS = (42.0, 44.0, 46.0, 48.0, 50.0, 52.0, 54.0, 56.0)
T = np.arange(0.0, 30.0, 0.02)
NOISE = {
    "V": 0.1, **dict.fromkeys(("alpha", "beta", "phi", "theta", "psi"), 1e-3), **dict.fromkeys("pqr", 3e-4),
    **dict.fromkeys(("ax", "ay", "az"), 0.02),
}  # fmt: skip
LACKING = ("Cm", "beta^2")


def doublets(starts: Sequence[float], length: float, size: float) -> NDArray[np.float64]:
    """Departures of a control from trim."""
    made = np.zeros(len(T))
    for start in starts:
        made += size * ((start <= T) & (start + length > T)) - size * ((start + length <= T) & (start + 2 * length > T))
    return made


def model_of(truth: dict[str, dict[str, float]]) -> ss.AeroModel:
    """Model of response to term to value."""
    return ss.AeroModel(
        {
            name: ss.ResponseModel(tuple(map(ss.Term, terms)), np.array(list(terms.values())))
            for name, terms in truth.items()
        }
    )


def flown() -> tuple[ss.AeroModel, list[ss.Recording], ss.Aircraft]:
    """The simulation, the recordings and the aircraft."""
    craft, truth = demo_aircraft(), model_of(TRUTH)
    made = []
    for k, V in enumerate(SPEEDS):
        start = trim(truth, craft, V, 1000.0)
        moves = {
            "de": doublets((2.0 + 0.5 * k, 18.0 - k), 0.9, 0.05),
            "da": doublets((7.0 - 0.5 * k, 25.0 - k), 0.8, 0.05 * (-1.0) ** k),
            "dr": doublets((12.0 + 0.5 * k, 22.0 - 0.5 * k), 1.0, 0.04),
        }
        one = simulate(
            truth, craft, start.inputs(T, **moves), start=start, instruments=Instruments(noise=NOISE, seed=k),
            outside="ignore",
        )  # fmt: skip
        made.append(ss.Recording(f"m{k + 1:02d}", one.t, one.channels))
    response, term = LACKING
    lacking = {r: {t: x for t, x in terms.items() if (r, t) != (response, term)} for r, terms in TRUTH.items()}
    return model_of(lacking), made, craft


def once() -> None:
    """One diagnosis in this interpreter: seconds of wall and processor, of the floor, and what is said."""
    simulation, recordings, craft = flown()
    wall, processor = time.perf_counter(), time.process_time()
    found = ss.diagnose(simulation, recordings, craft)
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    floor = time.process_time()
    for r in recordings:
        for x in r.channels.values():
            smooth_spline(x, r.t, order=3)
    named = [f.physics[0].effect for f in found.findings]
    print(wall, processor, time.process_time() - floor, found.verdict, *named)


def main() -> None:
    """Run and report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--out")
    parser.add_argument("--once", action="store_true", help="one diagnosis, here")
    told = parser.parse_args()
    if told.once:
        once()
        return
    rows: list[list[object]] = []
    for k in range(told.repeats):
        done = subprocess.run(
            [sys.executable, str(HERE / "diagnosis.py"), "--once"], capture_output=True, text=True, check=True
        )
        wall, processor, floor, *said = done.stdout.split()
        rows.append([str(k + 1), float(wall), float(processor), float(processor) / float(floor), " ".join(said)])
        say(f"diagnosis {k + 1} of {told.repeats}: {float(wall):.1f} s")
    middle = [median(float(str(row[i])) for row in rows) for i in (1, 2, 3)]
    head = ("run", "wall [s]", "processor [s]", "times the smoothing of all channels", "said")
    text = table(head, [*rows, ["median", *middle, ""]])
    publish(f"# Time of a diagnosis\n\n{machine()}\n\n{text}\n", told.out)


if __name__ == "__main__":
    main()
