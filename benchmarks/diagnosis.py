"""Time of a diagnosis: eight manoeuvres of 30 s at 50 Hz, all responses and hypotheses.

    python benchmarks/diagnosis.py --out diagnosis.md        # about 3 minutes

The demonstration's flights in calm air; the simulation is their truth without the pitching moment of sideslip. Each
diagnosis runs in a fresh interpreter, as a command does. The time includes the modules it loads, not the time of
`import structsel`. The floor is measured afterwards in the same interpreter: every recorded channel smoothed once.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from timing import in_child, machine, measure_once, publish, say, table

import structsel as ss
from structsel.numerics.smoothing import smooth_spline

LACKING = ("Cm", "beta^2")


def once() -> dict[str, Any]:
    """One diagnosis in this interpreter: wall and CPU seconds, CPU seconds of the floor, and the result."""
    recordings, aircraft, truth = ss.demo_flights(8, turbulence=0.0)
    del truth[LACKING[0]][LACKING[1]]
    simulation = ss.AeroModel.from_terms(truth)
    cpu, wall, found = measure_once(lambda: ss.diagnose(simulation, recordings, aircraft))
    floor, _, _ = measure_once(
        lambda: [smooth_spline(x, r.t, order=3) for r in recordings for x in r.channels.values()]
    )
    named = [f.physics[0].effect for f in found.findings]
    return {"wall": wall, "cpu": cpu, "floor": floor, "said": " ".join([found.verdict, *named])}


def main() -> None:
    """Run and report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--out")
    stated = parser.parse_args()
    figures, said = [], []
    for k in range(stated.repeats):
        one = in_child("diagnosis", "once", {})
        figures.append((one["wall"], one["cpu"], one["cpu"] / one["floor"]))
        said.append(one["said"])
        say(f"diagnosis {k + 1} of {stated.repeats}: {one['wall']:.1f} s")
    rows: list[list[object]] = [[k + 1, *each, what] for k, (each, what) in enumerate(zip(figures, said))]
    rows.append(["median", *np.median(figures, axis=0), ""])
    head = ("run", "wall [s]", "CPU [s]", "times the smoothing of all channels", "said")
    publish(f"# Time of a diagnosis\n\n{machine()}\n\n{table(head, rows)}\n", stated.out)


if __name__ == "__main__":
    main()
