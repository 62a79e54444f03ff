"""How often a term printed with a probability belongs in the model: a reliability table.

    python benchmarks/inclusion.py --seeds 160 --out inclusion.md

Two generators of records with known terms, with no common code beyond the selection. *Flights* are those of `cases.py`:
a closed-loop aeroplane, 164 candidates, seven true terms, six residual noise models, 2,000, 6,000 or 20,000 samples.
*Signals* are mixtures of filtered noise with their absolute values and splines, three manoeuvres, 62 candidates, two to
eight true terms, residuals of random autoregressions, 900 to 12,000 samples. Weak terms have any size: their true
value is 0 to 14 standard errors (flights), or normally distributed with 8 standard errors (signals).

A line of the table has all candidates whose probability is in a bin, and the fraction of them that is true. That
of resampled selections, `inclusion`, is tabulated in the same way.
"""

from __future__ import annotations

import argparse
from itertools import pairwise
from math import sqrt

import numpy as np
from cases import NOISE_MODELS, monomials, recovery_case
from methods import signals_of, workers
from scipy.optimize import minimize
from scipy.signal import lfilter
from scipy.special import logit
from timing import machine, one_blas_thread, publish, say, table

from structsel.numerics.regressors import ArrayData
from structsel.selection import SelectOptions, select_arrays

EDGES = (0.02, 0.2, 0.5, 0.8, 0.95, 0.99, 1.0)
Problem = tuple[list[ArrayData], np.ndarray, tuple[int, ...]]
"""Manoeuvres, exponents and the true terms."""


def flights(seed: int) -> Problem:
    """A case of `cases.py` with weak terms of any size."""
    rng = np.random.default_rng([seed, 5])
    n = int(rng.choice([2_000, 6_000, 20_000]))
    case = recovery_case(
        NOISE_MODELS[seed % 6], seed, n=n, n_manoeuvres=int(rng.choice([1, 4])), weak_t=tuple(rng.uniform(0.0, 14.0, 3))
    )
    return signals_of(case), case.exponents, case.true


def signals(seed: int) -> Problem:
    """Filtered noise, its absolute values and splines; see the head of this file."""
    rng = np.random.default_rng([seed, 6])
    lengths = [int(rng.choice([300, 1_000, 4_000]))] * 3
    exponents = monomials(10, 2)
    exponents = exponents[(exponents[:, 5:8] < 2).all(axis=1)]  # abs(x)^2 is x^2
    mix, poles = rng.normal(size=(5, 5)) + 2.0 * np.eye(5), rng.uniform(0.9, 0.99, 5)
    phi, white = rng.uniform(0.0, 0.97), rng.uniform(0.0, 0.5)
    true = tuple(int(j) for j in rng.choice(len(exponents), int(rng.integers(2, 9)), replace=False))
    bases = []
    for n in lengths:
        x = mix @ np.array([lfilter([1.0], [1.0, -2 * a, a * a], rng.normal(size=n + 500))[500:] for a in poles])
        x /= x.std(axis=1, keepdims=True)
        bases.append(np.concatenate([x, np.abs(x[:3]), np.maximum(x[3:] - 0.3, 0.0)]))
    columns = [np.prod(b[:, None] ** exponents.T[:, list(true), None], axis=0).T for b in bases]
    # Standard errors by generalised least squares with the autoregressive part of the residual.
    whitened = np.concatenate([lfilter([1.0, -phi], [1.0], c - c.mean(axis=0), axis=0)[1:] for c in columns])
    errors = np.sqrt(np.diag(np.linalg.inv(whitened.T @ whitened)))
    theta = rng.normal(0.0, 8.0, len(true)) * errors
    data = []
    for base, X in zip(bases, columns, strict=True):
        e = lfilter([1.0], [1.0, -phi], rng.normal(size=len(X) + 300))[300:] + white * rng.normal(size=len(X))
        data.append(ArrayData(base, (X @ theta + e)[None]))
    return data, exponents, true


STATED = ("probability", "its mean before calibration", "fraction of selections")
GENERATORS = {"flights": flights, "signals": signals}


def one(generator: str, seed: int, bootstrap: int) -> tuple[np.ndarray, np.ndarray]:
    """Probabilities of every candidate, (3, p), in the order of STATED, and the truth."""
    with one_blas_thread():
        data, exponents, true = GENERATORS[generator](seed)
        found = select_arrays(data, exponents, SelectOptions(bootstrap=bootstrap, workers=1))[0]
        resampled = found.bootstrap
        assert resampled is not None
        stated = np.array([resampled.probability, resampled.posterior, resampled.inclusion])
        return stated, np.isin(np.arange(len(exponents)), true)


def reliability(stated: np.ndarray, true: np.ndarray) -> list[tuple[str, int, float, float, float]]:
    """By bin: candidates, mean of what is stated, fraction true and its standard error."""
    rows = []
    for low, high in pairwise(EDGES):
        inside = (stated > low) & ((stated <= high) if high < 1.0 else (stated <= 1.0))
        count, hits = int(inside.sum()), int(true[inside].sum())
        if count:
            likely = (hits + 1) / (count + 2)
            rows.append((f"{low:g} to {high:g}", count, float(stated[inside].mean()), hits / count,
                         sqrt(likely * (1 - likely) / (count + 3))))  # fmt: skip
    return rows


def calibration(posterior: np.ndarray, true: np.ndarray) -> str:
    """Shift and slope of the logistic regression of truth on the logit of the posterior above 0.02."""
    inside = posterior > EDGES[0]
    z, sign = logit(np.clip(posterior[inside], 1e-4, 1.0 - 1e-4)), 2.0 * true[inside] - 1.0
    fit = minimize(lambda c: np.sum(np.logaddexp(0.0, -sign * (c[0] + c[1] * z))), [0.0, 1.0])
    error = np.sqrt(np.diag(fit.hess_inv))
    return f"Calibration on these: shift {fit.x[0]:.2f} ± {error[0]:.2f}, slope {fit.x[1]:.2f} ± {error[1]:.2f}."


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=160)
    parser.add_argument("--replicates", type=int, default=80)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", help="also write the report to this file")
    a = parser.parse_args()
    parts = ["# Reliability of inclusion probabilities", machine()]
    with workers(a.jobs) as over:
        for generator in GENERATORS:
            work = [(generator, seed, a.replicates) for seed in range(a.seeds)]
            answers = []
            for (_, seed, _), answer in zip(work, over(one, work)):
                answers.append(answer)
                if seed % 20 == 19:
                    say(f"{generator}: {seed + 1} of {a.seeds}")
            stated, true = (np.concatenate([x[i] for x in answers], axis=-1) for i in (0, 1))
            rows = [[name, *row] for name, of in zip(STATED, stated, strict=True) for row in reliability(of, true)]
            head = ["stated as", "bin", "candidates", "mean stated", "true", "±"]
            parts += [f"## {generator}, {a.seeds} records", table(head, rows), calibration(stated[1], true)]
    publish("\n\n".join(parts), a.out)


if __name__ == "__main__":
    main()
