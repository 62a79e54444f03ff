"""How often 95 % intervals contain the truth on the demonstration flights, by turbulence: the true terms are given.

    python benchmarks/turbulence.py --seeds 20 --out turbulence.md

Turbulence makes the aircraft move, so that candidates and residual are correlated and estimates biased. The flights are
those of `structsel.demo_flights`, under its augmentation (closed loop) or without it (open loop). "Fixed values" are
the intervals without the variance between manoeuvres, from the covariance for autocorrelated residuals alone.
"""

from __future__ import annotations

import argparse
import warnings
from collections import defaultdict

import numpy as np
from scipy import stats
from timing import machine, publish, table

import structsel as ss

LEVELS = {0.0: "calm", 0.5: "0.4 m/s", 1.0: "0.8 m/s", 2.0: "1.6 m/s"}


def errors_of(level: float, seed: int, flights: int, augmentation: float) -> list[tuple[str, float, float, bool, bool]]:
    """For every parameter: name, truth, estimate, and whether each of two intervals contains the truth."""
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
                rows.append((f"{response}: {term}", true, value, low < true < high, abs(value - true) < plain[i]))
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
        inside, plain = (100.0 * np.mean([row[i] for row in rows]) for i in (3, 4))
        covered.append([name, len(rows), f"{inside:.1f} %", f"{plain:.1f} %"])
        for parameter in dict.fromkeys(row[0] for row in rows):
            deviation = [100.0 * (value / true - 1.0) for who, true, value, *_ in rows if who == parameter]
            bias[parameter][name] = f"{np.mean(deviation):+.1f} ± {np.std(deviation) / np.sqrt(len(deviation)):.1f}"
    parts = [
        "# Coverage of 95 % intervals in turbulence",
        f"{a.flights} flights, {a.seeds} seeds from {a.seed}, {loop} loop, true terms given. {machine()}",
        table(["gusts", "intervals", "contain the truth", "fixed values"], covered),
        "Mean deviation from the truth, % of the value, and its standard error:",
        table(["parameter", *LEVELS.values()], [[who, *levels.values()] for who, levels in bias.items()]),
    ]
    publish("\n\n".join(parts), a.out)


if __name__ == "__main__":
    main()
