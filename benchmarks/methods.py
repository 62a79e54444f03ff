"""structsel's own methods as the benchmarks call them, and how a chosen structure is judged.

Everything goes through the array-level engine, which `structsel.select` puts names on, so that what is measured here
is what a user gets.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import get_context
from typing import Any

import numpy as np
from cases import Case, design_matrix, score
from numpy.typing import NDArray
from scipy.signal import lfilter

from structsel.numerics.cross_products import CrossProducts, cross_products
from structsel.numerics.least_squares import LeastSquaresFit, fit_terms
from structsel.numerics.regressors import ArrayData, DataSource
from structsel.selection import SelectOptions, select_arrays
from structsel.selection.array_selection import ArraySelection
from structsel.selection.methods import SearchConstraints
from structsel.selection.search import Search
from structsel.selection.search_result import SearchResult


@dataclass(frozen=True)
class Method:
    """One way of selecting.

    Attributes
    ----------
    name : str
        As printed.
    options : mapping
        Of `structsel.select`; the bootstrap is left out, one worker does the work.
    """

    name: str
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def settings(self) -> SelectOptions:
        return SelectOptions(**{"bootstrap": 0, "workers": 1, **self.options})

    def run(self, case: Case) -> ArraySelection:
        """Select for the case's first response."""
        return select_arrays(signals_of(case), case.exponents, self.settings)[0]

    def choose(self, case: Case) -> tuple[int, ...]:
        """Indices of the candidates kept."""
        return self.run(case).search.selected


CLASSICAL = Method("stepwise F=12, white", {"noise": "white", "F_in": 12.0})
WHITE_PSE = Method("orthogonal PSE, white", {"noise": "white", "method": "orthogonal", "criterion": "PSE"})
PREWHITENED = Method("stepwise F=12, prewhitened", {"F_in": 12.0})
PREWHITENED_AUTO = Method("stepwise F auto, prewhitened", {"F_in": "auto"})
METHODS: tuple[Method, ...] = (
    CLASSICAL,
    WHITE_PSE,
    PREWHITENED,
    PREWHITENED_AUTO,
    Method("stepwise F=12, by blocks", {"noise": "cluster", "F_in": 12.0}),
    Method("stepwise F auto, white", {"noise": "white", "F_in": "auto"}),
    Method("orthogonal BIC, white", {"noise": "white", "method": "orthogonal", "criterion": "BIC"}),
    Method("stepwise F=4, prewhitened", {"F_in": 4.0}),
    Method("stepwise fdr, prewhitened", {"F_in": "fdr"}),
    Method("stepwise BIC, prewhitened", {"F_in": 4.0, "criterion": "BIC"}),
    Method("orthogonal PSE, prewhitened", {"method": "orthogonal", "criterion": "PSE"}),
    Method("orthogonal EBIC, prewhitened", {"method": "orthogonal"}),
    Method("orthogonal BIC, prewhitened", {"method": "orthogonal", "criterion": "BIC"}),
)


def signals_of(case: Case) -> list[ArrayData]:
    """The case's manoeuvres as the engine takes them."""
    return [ArrayData(base, np.atleast_2d(responses)) for base, responses in case.manoeuvres]


# ---------------------------------------------------------------- judging a structure


@dataclass(frozen=True)
class Tally:
    """Scores of one method over cases."""

    cases: int
    exact: int
    missed: int
    false: int

    @classmethod
    def of(cls, scores: Iterable[tuple[bool, int, int]]) -> Tally:
        rows = list(scores)
        return cls(len(rows), *(int(sum(row[k] for row in rows)) for k in range(3)))

    def per_case(self, total: int) -> float:
        return total / self.cases if self.cases else float("nan")

    @property
    def rate(self) -> float:
        """Fraction of cases whose structure was recovered exactly."""
        return self.per_case(self.exact)

    def __str__(self) -> str:
        return f"{self.exact} / {self.per_case(self.missed):.2g} / {self.per_case(self.false):.2g}"


def bic_above_truth(case: Case, chosen: Sequence[int]) -> float:
    """BIC of the chosen model less that of the true one, both whitened with the true residual noise model.

    Computed by a dense least squares that has nothing to do with the engine. Above zero the search missed a
    better model: the true one.
    """
    union = sorted(set(chosen) | set(case.true))
    whiten, lag = np.concatenate([[1.0], -case.ar]), len(case.ar)
    rows, response = [], []
    for base, responses in case.manoeuvres:
        X = np.column_stack([np.ones(base.shape[1]), design_matrix(base, case.exponents[union])])
        rows.append(lfilter(whiten, 1.0, X, axis=0)[lag:])
        response.append(lfilter(whiten, 1.0, responses[0])[lag:])
    X, y = np.concatenate(rows), np.concatenate(response)
    X /= np.linalg.norm(X, axis=0)

    def bic(terms: Iterable[int]) -> float:
        columns = [0, *(1 + union.index(j) for j in sorted(terms))]
        theta = np.linalg.lstsq(X[:, columns], y, rcond=None)[0]
        rss = float(np.sum((y - X[:, columns] @ theta) ** 2))
        return float(len(y) * np.log(rss / len(y)) + len(columns) * np.log(len(y)))

    return bic(chosen) - bic(case.true)


def judge(method: Method, case: Case) -> tuple[tuple[bool, int, int], float]:
    """Score of one method on one case, and its BIC above the truth's."""
    chosen = method.choose(case)
    return score(case, chosen), bic_above_truth(case, chosen)


# ---------------------------------------------------------------- parts of a fit, for timing


def cross_products_of(
    manoeuvres: Sequence[DataSource], exponents: NDArray[np.integer], workers: int = 1
) -> CrossProducts:
    """Cross-products of all candidates and responses, one pass."""
    return cross_products(manoeuvres, exponents, workers=workers)


def search_in(
    products: CrossProducts,
    exponents: NDArray[np.integer],
    response: int = 0,
    options: SelectOptions = CLASSICAL.settings,
    without: int | None = None,
) -> SearchResult:
    """One search on stored cross-products; `without` leaves one block out."""
    one = products.of_response(response)
    weights = None if without is None else (np.arange(one.n_blocks) != without).astype(float)
    return Search(one, options, SearchConstraints(exponents.sum(axis=1)), ()).run(weights)


def complete_fit(
    manoeuvres: Sequence[DataSource], exponents: NDArray[np.integer], workers: int = 1
) -> list[LeastSquaresFit]:
    """From signals to coefficients with standard errors, white residuals, every response: pass, search, refit."""
    products = cross_products_of(manoeuvres, exponents, workers)
    fits = []
    for r in range(products.n_responses):
        kept = list(search_in(products, exponents, r).selected)
        fits.append(fit_terms(manoeuvres, exponents[kept], response=r))
    return fits


def select_all(
    manoeuvres: Sequence[DataSource], exponents: NDArray[np.integer], **options: Any
) -> list[ArraySelection]:
    """Everything `structsel.select` does with arrays: also cross-validation, aliases and covariances."""
    asked = {"bootstrap": 0, "workers": 1, "F_in": 12.0, **options}
    return select_arrays(manoeuvres, exponents, SelectOptions(**asked))


# ---------------------------------------------------------------- many cases


@contextmanager
def workers(jobs: int) -> Iterator[Callable[[Callable[..., Any], Sequence[tuple[Any, ...]]], Iterator[Any]]]:
    """A function giving the results of ``function(*arguments[i])`` in order, over `jobs` processes.

    With one job the work is done here, without another process.
    """
    if jobs == 1:
        yield lambda function, arguments: (function(*each) for each in arguments)
        return
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:

        def over(function: Callable[..., Any], arguments: Sequence[tuple[Any, ...]]) -> Iterator[Any]:
            futures = [pool.submit(function, *each) for each in arguments]
            return (future.result() for future in futures)

        yield over
