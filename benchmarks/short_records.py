"""Short records: how often 95 % intervals contain the truth, and how often a false term is kept.

    python benchmarks/short_records.py --runs 100 --selected-runs 50 --out short_records.md
    python benchmarks/short_records.py --manoeuvres 1 --lengths 500,1000,2000 --seed 6000 --runs 40 --selected-runs 0

By default three manoeuvres of 500, 1,500 and 5,000 samples with seven true terms, by residual noise model. With the
true terms given and after selection among 164 candidates, the intervals are those that `structsel.select` prints.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from cases import DT, NOISE_MODELS, SUM_MODEL, Case, recovery_case
from methods import workers
from timing import machine, one_blas_thread, publish, say, table

import structsel as ss

LENGTHS = (500, 1500, 5000)
DRAWS = 4  # of the residual for each flight and truth


@dataclass(frozen=True)
class Run:
    """Intervals of one run, those that contain the truth, missed and false terms."""

    intervals: int
    covered: int
    missed: int
    false: int


def drawn(noise_model: str, length: int, manoeuvres: int, seed: int, runs: int) -> Iterator[Case]:
    """Cases of several flights, each with several draws of the residual."""
    while runs > 0:
        try:
            case = recovery_case(noise_model, seed, n=manoeuvres * length, n_manoeuvres=manoeuvres)
        except ValueError:  # no seven terms that so short a record can separate
            seed += 1
            continue
        for draw in range(min(DRAWS, runs)):
            yield case.redraw(1000 * seed + draw)
        runs, seed = runs - DRAWS, seed + 1


def recordings_of(case: Case) -> list[ss.Recording]:
    """The manoeuvres, with the response as CZ."""
    found = []
    for k, (base, responses) in enumerate(case.manoeuvres):
        channels = dict(zip(case.names, base, strict=True)) | {"CZ": responses[0]}
        found.append(ss.Recording(f"m{k}", DT * np.arange(base.shape[1]), channels))
    return found


def run_given(case: Case) -> Run:
    """The true terms given."""
    names = [case.term_names[j] for j in case.true]
    found = ss.select(
        recordings_of(case), "CZ", ss.Candidates.parse(names), include=names, parsimony="none", bootstrap=0
    )
    return judge(found, case)


def run_selected(case: Case) -> Run:
    """Selection among all candidates by default."""
    return judge(ss.select(recordings_of(case), "CZ", ss.Candidates.parse(case.term_names)), case)


def judge(found: ss.Selection, case: Case) -> Run:
    """Compare a selection with the truth; a false term has the value zero."""
    truth = {str(ss.Term(case.term_names[j])): v for j, v in zip(case.true, case.theta, strict=True)}
    kept = list(map(str, found.terms))
    inside = [low < truth.get(t, 0.0) < high for t, (low, high) in zip(kept, found.intervals()[1:], strict=True)]
    false, missed = set(kept) - set(truth), set(truth) - set(kept)
    return Run(len(kept), sum(inside), len(missed), len(false))


def runs_of(noise_model: str, length: int, manoeuvres: int, seed: int, runs: int, selected: bool) -> list[Run]:
    """All runs of a cell."""
    warnings.simplefilter("ignore")
    with one_blas_thread():
        return [
            (run_selected if selected else run_given)(case)
            for case in drawn(noise_model, length, manoeuvres, seed, runs)
        ]


def row(noise_model: str, length: int, manoeuvres: int, runs: list[Run], selected: bool) -> list[object]:
    """One line of the table."""
    each = np.array([run.covered / run.intervals for run in runs if run.intervals])
    covered = sum(run.covered for run in runs) / max(sum(run.intervals for run in runs), 1)
    error = each.std(ddof=1) / np.sqrt(each.size)
    cells = [noise_model, f"{manoeuvres} x {length}", len(runs), f"{100 * covered:.1f} ± {100 * error:.1f} %"]
    if selected:
        false, alone = ([r.false > 0 and (n or not r.missed) for r in runs] for n in (True, False))
        cells += [f"{100 * np.mean(false):.0f} %", f"{100 * np.mean(alone):.0f} %"]
        cells.append(f"{np.mean([r.missed for r in runs]):.2f}")
    return cells


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=100, help="with the true terms given")
    parser.add_argument("--selected-runs", type=int, default=50, help="with selection; 0 skips it")
    parser.add_argument("--manoeuvres", type=int, default=3)
    parser.add_argument("--lengths", default=",".join(map(str, LENGTHS)))
    parser.add_argument("--noise-models", default=";".join((*NOISE_MODELS, SUM_MODEL)))
    parser.add_argument("--seed", type=int, default=5000)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", help="also write the report to this file")
    a = parser.parse_args()
    cells = [(m, int(n), a.manoeuvres) for m in a.noise_models.split(";") for n in a.lengths.split(",")]
    parts = ["# Short records", f"Seeds from {a.seed}. {machine()}"]
    for selected, runs in ((False, a.runs), (True, a.selected_runs)):
        if not runs:
            continue
        rows = []
        with workers(a.jobs) as over:
            work = [(*cell, a.seed, runs, selected) for cell in cells]
            for cell, answer in zip(cells, over(runs_of, work), strict=True):
                rows.append(row(*cell, answer, selected))
                say(str(rows[-1]))
        head = ["residual", "samples", "runs", "95 % intervals that contain the truth"]
        head += ["runs with a false term", "and none missed", "missed a run"] if selected else []
        parts += [f"## {'After selection' if selected else 'True terms given'}", table(head, rows)]
    publish("\n\n".join(parts), a.out)


if __name__ == "__main__":
    main()
