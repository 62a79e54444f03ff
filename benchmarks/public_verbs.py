"""Time of `select` and `reconstruct` as users call them.

    python benchmarks/public_verbs.py --out public_verbs.md        # about 4 minutes

`select` is given recordings and candidates by name: ten recordings of 20,000 samples, 164 or 494 candidates. With its
defaults residuals are autoregressive, there are hold-outs and 200 resamples, and it chooses the rows. The other call
has white residuals and no resamples. The floor is numpy's ``X.T @ X`` of the same candidates, with X given, column-
major; this is a symmetric product, half the operations of a general one. All run in turn in one process with one BLAS
thread and one worker. A ratio is the least seconds over the least seconds of ``X.T @ X``.

`reconstruct` with its defaults is given an hour's flight at 50 Hz with 12 measurements, in a process of its own.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import numpy as np
from cases import Case, recovery_case
from peers import candidate_matrix
from timing import in_child, machine, measure, one_blas_thread, publish, say, table

from structsel.candidates import Candidates
from structsel.recording import Recording
from structsel.selection import select

SAMPLES, MANOEUVRES, DT = 200_000, 10, 0.02
XTX = "X.T @ X"
DEFAULTS, WHITE = "select, defaults", "select, white residuals, no resamples"
AIMS = {(164, DEFAULTS): 3.0, (494, DEFAULTS): 1.5, (164, WHITE): 0.5, (494, WHITE): 0.2}
RECONSTRUCT_AIM = 5.0  # s, of an hour's flight


def recordings_of(case: Case) -> list[Recording]:
    """The manoeuvres of a case as recordings; its response is Cm."""
    return [
        Recording(f"m{k:02d}", np.arange(base.shape[1]) * DT, {**dict(zip(case.names, base)), "Cm": responses[0]})
        for k, (base, responses) in enumerate(case.manoeuvres)
    ]


def select_rows(degree: int, repeats: int) -> list[list[object]]:
    """Ratios and seconds of each call, by CPU and wall time."""
    coloured, white = (
        recovery_case(noise, 1, n=SAMPLES, degree=degree, n_manoeuvres=MANOEUVRES) for noise in ("ar1_0.92", "white")
    )
    candidates = Candidates.polynomial(list(coloured.names), degree)
    X = candidate_matrix(coloured.base, coloured.exponents)
    many, few = recordings_of(coloured), recordings_of(white)
    jobs: dict[str, Callable[[], Any]] = {
        XTX: lambda: X.T @ X,
        DEFAULTS: lambda: select(many, "Cm", candidates, workers=1),
        WHITE: lambda: select(few, "Cm", candidates, noise="white", bootstrap=0, workers=1),
    }
    with one_blas_thread():
        times = measure(jobs, repeats)
    least = {name: (min(t.cpu), min(t.wall)) for name, t in times.items()}
    rows: list[list[object]] = []
    for name, (cpu, wall) in least.items():
        ratio, aim = cpu / least[XTX][0], AIMS.get((len(candidates), name))
        verdict = "" if aim is None else "reached" if ratio <= aim else "not reached"
        rows.append([len(candidates), name, cpu, wall, ratio, wall / least[XTX][1], aim or "", verdict])
        say(f"p={len(candidates)}: {name} {ratio:.3g}")
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--degrees", default="3,4", help="3: 164 candidates, 4: 494")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--hours", type=float, default=1.0, help="of the flight that is reconstructed; 0 skips it")
    parser.add_argument("--out", help="also write the report to this file")
    a = parser.parse_args()
    rows = [row for degree in a.degrees.split(",") if degree for row in select_rows(int(degree), a.repeats)]
    head = ["candidates", "what", "CPU s", "wall s", "CPU ratio", "wall ratio", "aim", ""]
    parts = ["# What users call", machine()]
    if rows:
        parts += [f"## select, {SAMPLES:,} samples in {MANOEUVRES} recordings", table(head, rows)]
    if a.hours:
        say("reconstruct")
        samples = round(a.hours * 3600 / DT)
        seconds = min(in_child("reconstruction", "public_verb", {"samples": samples}) for _ in range(a.repeats))
        verdict = "reached" if seconds <= RECONSTRUCT_AIM * a.hours else "not reached"
        parts += [
            f"## reconstruct, {a.hours:g} h at 50 Hz",
            table(["CPU s", "aim, s", ""], [[seconds, RECONSTRUCT_AIM * a.hours, verdict]]),
        ]
    publish("\n\n".join(parts), a.out)


if __name__ == "__main__":
    main()
