"""Six residual noise models: structure recovery and coverage of the 95 % intervals.

    python benchmarks/interval_coverage.py --cases 10 --draws 500 --out coverage.md

Per noise model and case: exact recoveries, missed and false terms of the classical selection (white residuals,
F = 12), the orthogonal functions with PSE, and the prewhitened selection; whether any has a worse BIC than the
truth; and, the seven terms given, how often 95 % intervals cover the truth by three formulas. Goals A1 to A4
are judged at the end.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from cases import NOISE_MODELS, recovery_case
from conditioning import Conditioning, conditioning_cases, conditioning_goal
from methods import (
    CLASSICAL,
    PREWHITENED,
    PREWHITENED_AUTO,
    WHITE_PSE,
    Method,
    Tally,
    judge,
    signals_of,
    workers,
)
from numpy.typing import NDArray
from timing import machine, one_blas_thread, publish, say, table

from structsel.numerics.coloured_fit import streamed_coloured_covariance
from structsel.numerics.least_squares import fit_terms
from structsel.selection import SelectOptions, select_arrays

METHODS = (CLASSICAL, WHITE_PSE, PREWHITENED, PREWHITENED_AUTO)
FORMULAS = ("white formula", "sandwich", "prewhitened")
SLACK = 1e-6  # two fits of one structure differ by rounding
Selected = dict[str, NDArray[np.int64]]
NORMAL_95 = 1.959963984540054


@dataclass(frozen=True)
class Recovered:
    """One method over the cases of one noise model."""

    tally: Tally
    worse_bic: int


def one_case(noise_model: str, seed: int, samples: int, degree: int) -> list[tuple[tuple[bool, int, int], float]]:
    """Scores of all methods on one case."""
    with one_blas_thread():
        case = recovery_case(noise_model, seed, n=samples, degree=degree)
        return [judge(method, case) for method in METHODS]


def recover(cases: int, seed: int, samples: int, degree: int, jobs: int) -> dict[str, dict[str, Recovered]]:
    """By noise model and method."""
    work = [(noise_model, seed + k, samples, degree) for noise_model in NOISE_MODELS for k in range(cases)]
    answers: dict[str, list[list[tuple[tuple[bool, int, int], float]]]] = {
        noise_model: [] for noise_model in NOISE_MODELS
    }
    with workers(jobs) as over:
        for (noise_model, at, *_), answer in zip(work, over(one_case, work)):
            answers[noise_model].append(answer)
            say(f"degree {degree} {noise_model} seed {at}: " + "; ".join(str(s) for s, _ in answer))
    return {
        noise_model: {
            method.name: Recovered(Tally.of(row[m][0] for row in rows), sum(row[m][1] > SLACK for row in rows))
            for m, method in enumerate(METHODS)
        }
        for noise_model, rows in answers.items()
    }


# ---------------------------------------------------------------- intervals


def standard_errors(case: object, terms: list[int]) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Estimates and standard errors of the given terms by each of FORMULAS."""
    signals = signals_of(case)  # type: ignore[arg-type]
    exponents = case.exponents[terms]  # type: ignore[attr-defined]
    white = fit_terms(signals, exponents)
    sandwich = streamed_coloured_covariance(signals, exponents, white)
    options = SelectOptions(bootstrap=0, workers=1)
    whitened = select_arrays(signals, exponents, options, include=range(len(terms)))[0]
    place = [list(whitened.search.selected).index(j) + 1 for j in range(len(terms))]
    return [
        (white.theta[1:], np.sqrt(np.diag(white.covariance))[1:]),
        (white.theta[1:], np.sqrt(np.diag(sandwich))[1:]),
        (whitened.fit.theta[place], np.sqrt(np.diag(whitened.covariance))[place]),
    ]


def cover_case(
    noise_model: str, seed: int, samples: int, degree: int, draws: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(formulas, draws) fraction of the seven terms covered in each draw, and mean interval width (formulas, 7)."""
    with one_blas_thread():
        case = recovery_case(noise_model, seed, n=samples, degree=degree)
        covered = np.empty((len(FORMULAS), draws))
        width = np.zeros((len(FORMULAS), len(case.true)))
        for d in range(draws):
            fresh = case.redraw(1000 * seed + d)
            for f, (theta, se) in enumerate(standard_errors(fresh, list(case.true))):
                covered[f, d] = np.mean(np.abs(theta - case.theta) <= NORMAL_95 * se)
                width[f] += se / draws
        return covered, width


def after_selection(noise_model: str, seed: int, samples: int, degree: int, draws: int) -> tuple[int, int, int, int]:
    """Kept terms, those whose interval covers their true value (zero for a false one), missed terms, draws.

    Structure and values come from the same data; the interval's half width takes the larger of the refit's standard
    error and the spread over a bootstrap that repeats the selection, as `structsel.select` prints it.
    """
    with one_blas_thread():
        case = recovery_case(noise_model, seed, n=samples, degree=degree)
        truth = dict(zip(case.true, case.theta))
        kept = covered = missed = 0
        for d in range(draws):
            fresh = case.redraw(1000 * seed + d)
            options = SelectOptions(F_in=12.0, workers=1)
            outcome = select_arrays(signals_of(fresh), case.exponents, options)[0]
            errors = np.sqrt(np.diag(outcome.covariance))
            if outcome.bootstrap is not None:
                errors = np.fmax(errors, outcome.bootstrap.std)
            found = outcome.search.selected
            for j, value, error in zip(found, outcome.values[1:], errors[1:]):
                covered += abs(value - truth.get(j, 0.0)) <= NORMAL_95 * error
            kept += len(found)
            missed += len(set(truth) - set(found))
        return kept, int(covered), missed, draws


def selected_coverage(draws: int, flights: int, seed: int, samples: int, degree: int, jobs: int) -> Selected:
    """Counts of `after_selection` by noise model."""
    work = [
        (noise_model, seed + k, samples, degree, -(-draws // flights))
        for noise_model in NOISE_MODELS
        for k in range(flights)
    ]
    counts = {noise_model: np.zeros(4, dtype=int) for noise_model in NOISE_MODELS}
    with workers(jobs) as over:
        for (noise_model, at, *_), answer in zip(work, over(after_selection, work)):
            counts[noise_model] += answer
            say(f"after selection, {noise_model} seed {at}: {answer[1]} of {answer[0]} covered, {answer[2]} missed")
    return counts


@dataclass(frozen=True)
class Coverage:
    """Of one noise model: (formulas,) each; the standard error treats a draw's seven terms as one observation."""

    fraction: NDArray[np.float64]
    standard_error: NDArray[np.float64]
    width: NDArray[np.float64]


def coverage(draws: int, flights: int, seed: int, samples: int, degree: int, jobs: int) -> dict[str, Coverage]:
    """Coverage by noise model; the draws are divided among several flights and truths."""
    per_flight = -(-draws // flights)
    work = [
        (noise_model, seed + k, samples, degree, per_flight) for noise_model in NOISE_MODELS for k in range(flights)
    ]
    found: dict[str, list[tuple[NDArray[np.float64], NDArray[np.float64]]]] = {c: [] for c in NOISE_MODELS}
    with workers(jobs) as over:
        for (noise_model, at, *_), answer in zip(work, over(cover_case, work)):
            found[noise_model].append(answer)
            say(f"coverage {noise_model} seed {at}: " + ", ".join(f"{100 * c:.1f}%" for c in answer[0].mean(axis=1)))
    result = {}
    for noise_model, answers in found.items():
        covered = np.concatenate([a[0] for a in answers], axis=1)
        relative = np.mean([(a[1] / a[1][1]).mean(axis=1) for a in answers], axis=0)
        error = covered.std(axis=1, ddof=1) / np.sqrt(covered.shape[1])
        result[noise_model] = Coverage(covered.mean(axis=1), error, relative)
    return result


# ---------------------------------------------------------------- tables and goals


def recovery_table(found: dict[str, dict[str, Recovered]], cases: int) -> str:
    head = ["residual", *(method.name for method in METHODS)]
    rows = []
    for noise_model, of in found.items():
        cells = [f"{r.tally}" + (f" ({r.worse_bic} worse BIC)" if r.worse_bic else "") for r in of.values()]
        rows.append([noise_model, *cells])
    note = f"Exact of {cases} / missed / false terms per case; in brackets: cases with a worse BIC than the truth."
    return table(head, rows) + "\n\n" + note


def coverage_table(found: dict[str, Coverage]) -> str:
    rows = []
    for noise_model, c in found.items():
        cells = [
            f"{100 * fraction:.1f} ± {100 * error:.1f} % (width {width:.2f})"
            for fraction, error, width in zip(c.fraction, c.standard_error, c.width)
        ]
        rows.append([noise_model, *cells])
    return table(["residual", *FORMULAS], rows) + "\n\nWidths relative to the sandwich's."


def selected_table(found: Selected) -> str:
    rows = [
        [noise_model, f"{100 * covered / max(kept, 1):.1f} %", kept / draws, missed / draws, draws]
        for noise_model, (kept, covered, missed, draws) in found.items()
    ]
    return table(["residual", "covered", "kept terms a draw", "missed a draw", "draws"], rows)


def goals(
    found: dict[str, dict[str, Recovered]],
    covered: dict[str, Coverage],
    after: Selected,
    conditioning: list[Conditioning],
) -> str:
    rows: list[list[object]] = []

    def add(goal: str, what: str, figure: str, reached: bool) -> None:
        rows.append([goal, what, figure, "reached" if reached else "not reached"])

    def good(tally: Tally) -> bool:
        return tally.rate >= 0.8 and tally.per_case(tally.false) <= 0.2 + 1e-12

    def a1(method: Method) -> None:
        r = found["white"][method.name]
        ok = good(r.tally) and r.tally.per_case(r.tally.missed) <= 0.2 + 1e-12 and r.worse_bic == 0
        figure = f"{r.tally}, worse BIC in {r.worse_bic}"
        add(
            "A1",
            f"white, {method.name}: >= 80 % exact, <= 0.2 missed, <= 0.2 false, never a worse BIC",
            figure,
            ok,
        )

    for method in (CLASSICAL, PREWHITENED, PREWHITENED_AUTO):
        a1(method)
    for method in (PREWHITENED, PREWHITENED_AUTO):
        worst = [c for c in found if not good(found[c][method.name].tally)]
        figure = "; ".join(f"{c} {found[c][method.name].tally}" for c in worst) or "all six"
        add("A2", f"six noise models, {method.name}: >= 80 % exact each, <= 0.2 false", figure, not worst)
    if covered:
        for f in (2, 1):
            percentages = [100 * c.fraction[f] for c in covered.values()]
            figure = f"{min(percentages):.1f} to {max(percentages):.1f} %"
            add(
                "A3",
                f"95 % intervals ({FORMULAS[f]}) cover 93-97 % in all six",
                figure,
                93 <= min(percentages) <= max(percentages) <= 97,
            )
    if after:
        percentages = [100 * covered / max(kept, 1) for kept, covered, *_ in after.values()]
        figure = f"{min(percentages):.1f} to {max(percentages):.1f} %"
        add("A3", "95 % intervals after selection cover at least 90 %", figure, min(percentages) >= 90)
    for what, figure, reached in conditioning_goal(conditioning):
        add("A4", what, figure, reached)
    return table(["goal", "what", "found", ""], rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=10, help="cases per noise model")
    parser.add_argument("--draws", type=int, default=500, help="residual draws per model for coverage; 0 skips it")
    parser.add_argument("--selected-draws", type=int, default=84, help="per noise model, for coverage after selection")
    parser.add_argument("--flights", type=int, default=5, help="flights and truths among which the draws are divided")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--degree", type=int, default=3, help="3: 164 candidates, 4: 494")
    parser.add_argument("--samples", type=int, default=20_000)
    parser.add_argument("--conditioning", type=int, default=3, help="cases per level of near-dependence (A4); 0 skips")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", help="also write the report to this file")
    a = parser.parse_args()
    found = recover(a.cases, a.seed, a.samples, a.degree, a.jobs)
    covered = coverage(a.draws, a.flights, a.seed, a.samples, a.degree, a.jobs) if a.draws else {}
    n = a.selected_draws
    after = selected_coverage(n, a.flights, a.seed, a.samples, a.degree, a.jobs) if n else {}
    conditioning = conditioning_cases(a.conditioning, a.seed) if a.conditioning else []
    parts = [
        "# Residual autocorrelation",
        f"{a.samples} samples at 50 Hz, degree {a.degree}, seeds from {a.seed}. {machine()}",
        "## Structure",
        recovery_table(found, a.cases),
    ]
    if covered:
        parts += [
            f"## Coverage of 95 % intervals, seven known terms, {a.draws} draws",
            coverage_table(covered),
        ]
    if after:
        parts += ["## Coverage of 95 % intervals after selection, bootstrap of 200", selected_table(after)]
    if conditioning:
        head = [
            "near-copy",
            "cond",
            "coefficients / (eps cond)",
            "partial F, search",
            "partial F, printed",
            "same set as QR",
            "refused",
        ]
        parts += ["## Conditioning", table(head, [c.row() for c in conditioning])]
    parts += ["## Goals", goals(found, covered, after, conditioning)]
    publish("\n\n".join(parts), a.out)


if __name__ == "__main__":
    main()
