"""How often 95 % intervals contain the truth on the demonstration flights, by turbulence: the true terms are given.

    python benchmarks/turbulence.py --seeds 20 --out turbulence.md

Turbulence makes the aircraft move, so that candidates and residual are correlated and estimates biased. The flights are
those of `structsel.demo_flights`, under its augmentation (closed loop) or without it (open loop). "Fixed values" are
the intervals without the variance between manoeuvres, from the covariance for autocorrelated residuals alone. The bias
of each parameter is given in standard errors as `select` prints them, and in per cent of the value.
"""

from __future__ import annotations

import argparse
import warnings
from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from scipy import stats
from timing import machine, publish, table

import structsel as ss

LEVELS = {0.0: "calm", 0.5: "0.4 m/s", 1.0: "0.8 m/s", 2.0: "1.6 m/s"}


@dataclass(frozen=True)
class Estimated:
    """One parameter of one seed, and whether each of two intervals contains the truth."""

    parameter: str
    truth: float
    value: float
    standard_error: float
    inside: bool
    inside_fixed: bool


def errors_of(level: float, seed: int, flights: int, augmentation: float) -> list[Estimated]:
    """Every parameter of the six models."""
    recordings, aircraft, truth = ss.demo_flights(flights, seed, turbulence=level, augmentation=augmentation)
    manoeuvres = ss.compute_all(recordings, aircraft)
    rows = []
    for response, terms in truth.items():
        names = [name for name in terms if name != "1"]
        pool = ss.Candidates.parse(names)
        found = ss.select(manoeuvres, response, pool, include=names, parsimony="none", bootstrap=0)
        plain = stats.t.ppf(0.975, found.dof) * np.sqrt(np.diag(found.covariance))
        for i, (term, (low, high)) in enumerate(zip(["1", *map(str, found.terms)], found.intervals(), strict=True)):
            if term != "1":
                value, true = float(found.values[i]), terms[term]
                inside = low < true < high, abs(value - true) < plain[i]
                rows.append(Estimated(f"{response}: {term}", true, value, float(found.standard_errors[i]), *inside))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--seed", type=int, default=101, help="the first one")
    parser.add_argument("--flights", type=int, default=7)
    parser.add_argument("--open-loop", action="store_true", help="without augmentation")
    parser.add_argument("--out", help="also write the report to this file")
    a = parser.parse_args()
    warnings.simplefilter("ignore")
    covered: list[list[object]] = []
    bias: dict[str, dict[str, str]] = defaultdict(dict)
    gain, loop = (0.0, "open") if a.open_loop else (1.0, "closed")
    for level, name in LEVELS.items():
        rows = [row for seed in range(a.seed, a.seed + a.seeds) for row in errors_of(level, seed, a.flights, gain)]
        of = {
            who: [row for row in rows if row.parameter == who] for who in dict.fromkeys(row.parameter for row in rows)
        }
        sizes = []
        for who, each in of.items():
            deviation = np.array([row.value - row.truth for row in each])
            errors = float(np.mean(deviation / [row.standard_error for row in each]))
            relative = 100.0 * deviation / each[0].truth
            bias[who][name] = f"{errors:+.2f} ({relative.mean():+.1f} %)"
            sizes.append(abs(errors))
        inside, fixed = (100.0 * np.mean([getattr(row, x) for row in rows]) for x in ("inside", "inside_fixed"))
        above = sum(size > 1.0 for size in sizes)
        covered.append([name, len(rows), f"{inside:.1f} %", f"{fixed:.1f} %", f"{max(sizes):.2f}", above])
    parts = [
        "# Coverage of 95 % intervals in turbulence",
        f"{a.flights} flights, {a.seeds} seeds from {a.seed}, {loop} loop, true terms given. {machine()}",
        table(["gusts", "intervals", "contain the truth", "fixed values", "largest bias", "above one"], covered),
        "Mean deviation from the truth in standard errors, and in % of the value:",
        table(["parameter", *LEVELS.values()], [[who, *levels.values()] for who, levels in bias.items()]),
    ]
    publish("\n\n".join(parts), a.out)


if __name__ == "__main__":
    main()
