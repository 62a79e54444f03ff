"""The selectors as scikit-learn estimators: columns are the candidates, rows are samples in time order.

Thin: everything is `structsel.selection.select_arrays` on monomials of degree one. Use `structsel.select` for
recordings, named terms and the report; use these inside pipelines, grid searches and code that has a matrix already.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.feature_selection import SelectorMixin
from sklearn.utils.validation import check_consistent_length, check_is_fitted, column_or_1d, validate_data

from structsel.deprecation import renamed_arguments
from structsel.errors import SelectionError
from structsel.numerics.regressors import ArrayData
from structsel.selection.array_selection import ArraySelection
from structsel.selection.engine import select_arrays
from structsel.selection.settings import (
    RENAMED_ARGUMENTS,
    Components,
    Constants,
    Criterion,
    Estimate,
    InitialTerms,
    Noise,
    Parsimony,
    SelectOptions,
    StoppingRule,
)

_OF_ONE_METHOD = {
    **dict.fromkeys(("F_in", "F_out", "initial_terms", "stopping_rule", "min_r2_gain"), "stepwise"),
    "order": "orthogonal",
}
FEWEST = 4  # samples: more than the three that even white noise of unknown size asks for
ROUNDING = 1e-12  # of its size: a column that varies less is constant

__all__ = ["BestSubsetRegressor", "OrthogonalRegressor", "StepwiseRegressor"]


class _Selector(SelectorMixin, RegressorMixin, BaseEstimator):
    """Base of the three: their parameters, one call of the engine, and the model as coefficients of the columns."""

    _method: ClassVar[str]

    def __init__(
        self,
        *,
        F_in: float | Literal["auto", "fdr"] = "auto",
        F_out: float | None = None,
        noise: Noise = "ar",
        constants: Constants = "auto",
        parsimony: Parsimony = "one_se",
        include: Sequence[int] = (),
        initial_terms: InitialTerms = "empty",
        stopping_rule: StoppingRule = "F",
        min_r2_gain: float = 0.005,
        criterion: Criterion | None = None,
        sigma_max: Literal["response", "residual"] | float = "response",
        order: Literal["greedy", "given"] = "greedy",
        estimate: Estimate = "least_squares",
        components: Components = "variance",
        correlation_limit: float | None = None,
        max_terms: int | None = None,
        bootstrap: int = 0,
        max_ar_order: int = 24,
        seed: int = 0,
        workers: int | None = None,
    ):
        self.F_in = F_in
        self.F_out = F_out
        self.noise = noise
        self.constants = constants
        self.parsimony = parsimony
        self.include = include
        self.initial_terms = initial_terms
        self.stopping_rule = stopping_rule
        self.min_r2_gain = min_r2_gain
        self.criterion = criterion
        self.sigma_max = sigma_max
        self.order = order
        self.estimate = estimate
        self.components = components
        self.correlation_limit = correlation_limit
        self.max_terms = max_terms
        self.bootstrap = bootstrap
        self.max_ar_order = max_ar_order
        self.seed = seed
        self.workers = workers

    def fit(self, X: ArrayLike, y: ArrayLike, groups: ArrayLike | None = None) -> Self:
        """Choose columns and estimate them.

        Parameters
        ----------
        X : (n, p) array
            One candidate per column, rows in time order.
        y : (n,) array
        groups : (n,) array, optional
            Which manoeuvre each row belongs to; rows of one label are taken in the order they come. Lags do not
            cross from one to the next, and held-out errors and the bootstrap leave out whole ones.

        Returns
        -------
        self

        Raises
        ------
        SelectionError
            An option out of its range or of another method, an included column that is not there, or too few
            samples.
        """
        table, response = self._checked(X, y)
        p = table.shape[1]
        options, included, initial = self._options(p)
        # The constant is in the model, so moving the origin changes nothing but the digits that are lost.
        middle, level = table.mean(axis=0), float(response.mean())
        self.coef_ = np.zeros(p)
        self.intercept_ = level
        self.support_ = np.zeros(p, dtype=bool)
        self.support_[included] = True
        self.selection_: ArraySelection | None = None
        if np.ptp(response) <= ROUNDING * np.abs(response).max():
            return self  # a constant response: the constant describes all of it
        rows = np.ascontiguousarray((table - middle).T)
        rows[np.ptp(rows, axis=1) <= ROUNDING * np.abs(middle)] = 0.0
        recordings = [ArrayData(rows[:, i], (response[i] - level)[None]) for i in _manoeuvres(groups, table)]
        outcome = select_arrays(recordings, np.eye(p, dtype=np.int64), options, included, initial)[0]
        kept = list(outcome.search.selected)
        self.coef_[kept] = outcome.values[1:]
        self.intercept_ = level + float(outcome.values[0]) - float(self.coef_ @ middle)
        self.support_[:] = False
        self.support_[kept] = True
        self.selection_ = outcome
        return self

    def predict(self, X: ArrayLike) -> NDArray[np.float64]:
        """Response of these samples, (n,)."""
        check_is_fitted(self)
        table: NDArray[np.float64] = validate_data(self, X, dtype=np.float64, reset=False)
        return table @ self.coef_ + self.intercept_

    def _get_support_mask(self) -> NDArray[np.bool_]:
        check_is_fitted(self)
        return self.support_

    def _checked(self, X: ArrayLike, y: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        table, response = validate_data(self, X, y, dtype=np.float64, y_numeric=True, ensure_min_samples=FEWEST)
        return table, np.asarray(response, dtype=np.float64)

    def _options(self, p: int) -> tuple[SelectOptions, list[int], list[int]]:
        """Options, included columns and initial columns from the parameters."""
        given = self.get_params(deep=False)
        included = [int(j) for j in given.pop("include")]
        if any(not 0 <= j < p for j in included):
            raise SelectionError(
                f"{type(self).__name__} is to include columns {included}; X has columns 0 to {p - 1}. "
                "Give their numbers, counted from zero."
            )
        options = SelectOptions(method=self._method, **given)
        for field in fields(SelectOptions):
            own = _OF_ONE_METHOD.get(field.name, self._method)
            if own != self._method and given[field.name] != field.default:
                raise SelectionError(
                    f"{type(self).__name__} does not use {field.name}={given[field.name]!r}: it belongs to the method "
                    f"{own!r}. Leave it out."
                )
        return options, included, list(range(p)) if options.initial_terms != "empty" else []


@renamed_arguments(**RENAMED_ARGUMENTS)
class StepwiseRegressor(_Selector):
    """Modified stepwise regression by partial F, residual autocorrelation accounted for.

    Parameters
    ----------
    F_in, F_out : float, "auto" or "fdr"
        Partial F to enter and to stay (F_in where F_out is None); see `structsel.select`.
    noise : {"ar", "cluster", "white"}
        ``"ar"``: an autoregressive model of each manoeuvre's residual, order by BIC, prewhitens the rows before
        anything is tested; for rows in random order the model is white noise. ``"cluster"``: tests by the scatter
        between blocks of rows. ``"white"``: rows are independent.
    constants : {"auto", "shared", "own"}
        One constant, or one of each group of rows; ``intercept_`` is then their mean.
    parsimony : {"one_se", "none"}
        Without effect here: every column is of degree one.
    include : sequence of int
        Columns always in the model.
    initial_terms : {"empty", "all"}
    stopping_rule : {"F", "R2", "PSE"}
    min_r2_gain : float [-]
    criterion : {"PSE", "BIC", "EBIC", "AICc", "adj_R2", "cv"}, optional
    sigma_max : {"response", "residual"} or float
    estimate : {"least_squares", "principal_components", "ridge"}
        The latter two are biased.
    components : {"variance", "PSE", "cv"} or int
    correlation_limit : float, optional
    max_terms : int, optional
    bootstrap : int
    max_ar_order : int
    seed : int
    workers : int, optional
        All as in `structsel.select`.

    Attributes
    ----------
    coef_ : (p,) array [response per column]
        Zero for columns left out.
    intercept_ : float
    support_ : (p,) bool array
        Columns kept.
    selection_ : ArraySelection or None
        Result of the search: covariance, steps, noise models, aliases, held-out error, bootstrap. Terms in order of
        entry, columns about their means. None where the response is constant.
    n_features_in_ : int

    References
    ----------
    [C89], [TP1916], [KM16] ch. 5.

    Examples
    --------
    >>> import numpy as np
    >>> X = np.random.default_rng(0).normal(size=(200, 5))
    >>> StepwiseRegressor(F_in="auto").fit(X, 1.0 + 2.0 * X[:, 3]).get_support(indices=True)
    array([3])
    """

    _method = "stepwise"


@renamed_arguments(**RENAMED_ARGUMENTS)
class OrthogonalRegressor(_Selector):
    """Orthogonal functions of the columns, ranked by cost reduction; as many as give the least extended BIC.

    Parameters
    ----------
    sigma_max : {"response", "residual"} or float
        The bound on the prediction error where ``criterion="PSE"``; see `structsel.select`.
    order : {"greedy", "given"}
    noise, constants, parsimony, include, criterion, estimate, components, correlation_limit, max_terms, bootstrap, \
    max_ar_order, seed, workers
        As `StepwiseRegressor`.

    Attributes
    ----------
    coef_, intercept_, support_, selection_, n_features_in_
        As `StepwiseRegressor`.

    References
    ----------
    [H17], [M95].
    """

    _method = "orthogonal"


@renamed_arguments(**RENAMED_ARGUMENTS)
class BestSubsetRegressor(_Selector):
    """The best columns of every number, exactly, and of those the number with the least criterion.

    Parameters
    ----------
    criterion : {"PSE", "BIC", "EBIC", "AICc", "adj_R2", "cv"}, optional
        Extended BIC where absent.
    noise, constants, parsimony, include, sigma_max, estimate, components, correlation_limit, max_terms, bootstrap, \
    max_ar_order, seed, workers
        As `StepwiseRegressor`. With many columns give ``max_terms``, or use `StepwiseRegressor`.

    Attributes
    ----------
    coef_, intercept_, support_, selection_, n_features_in_
        As `StepwiseRegressor`.

    References
    ----------
    [FW74].
    """

    _method = "best_subset"


def _manoeuvres(groups: ArrayLike | None, X: Any) -> list[Any]:
    """Rows of each manoeuvre, in the order the labels first come."""
    if groups is None:
        return [slice(None)]
    labels = column_or_1d(groups)
    check_consistent_length(X, labels)
    _, first, which = np.unique(labels, return_index=True, return_inverse=True)
    return [np.flatnonzero(which == k) for k in np.argsort(first)]
