"""Metrics of fit, by name.

Arrays in, one number or array out. ``measured`` and ``modelled`` are (n,) arrays of one response.

A function decorated with `metric` is registered: `validate`, `resimulate` and `refine` compute it for every response,
and their tables, frames, JSON and reports show it. A metric may also be registered from outside the package::

    @metric(label="max error", best=0.0, unit="response")
    def largest_error(measured, modelled):
        return float(np.abs(measured - modelled).max())
"""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import numpy as np

from structsel.errors import DataError, DomainError

Normaliser = Literal["rms", "std", "range"]
_Function = TypeVar("_Function", bound=Callable[..., float])


@dataclass(frozen=True)
class Metric:
    """A registered metric.

    Attributes
    ----------
    name : str
        Of the function; the name in frames and JSON.
    function : callable
        Takes measured and modelled, and further arguments that it names.
    label : str
        Heading of its column in tables.
    best : float
        Value of a perfect model.
    unit : str
        Empty, or ``"response"``; a metric with a unit is in frames and JSON but in no table of several responses.
    brief : bool
        Whether it is in short tables too.
    """

    name: str
    function: Callable[..., float]
    label: str
    best: float
    unit: str
    brief: bool


_METRICS: dict[str, Metric] = {}


def metric(*, label: str, best: float, unit: str = "", brief: bool = True) -> Callable[[_Function], _Function]:
    """Register a function of measured and modelled response as a metric; see `Metric`.

    Raises
    ------
    DomainError
        Another metric has that name.
    """

    def register(function: _Function) -> _Function:
        name = function.__name__
        if name in _METRICS:
            raise DomainError(f"There is a metric '{name}' already. Give the function another name.")
        _METRICS[name] = Metric(name, function, label, best, unit, brief)
        return function

    return register


def in_tables(*, brief: bool = False) -> tuple[Metric, ...]:
    """Metrics with a column in tables; those of short tables only if `brief`."""
    return tuple(m for m in _METRICS.values() if not m.unit and (m.brief or not brief))


def remove_metric(name: str) -> None:
    """Remove a metric; nothing happens where there is none of that name."""
    _METRICS.pop(name, None)


def compute_metrics(
    measured: Any,
    modelled: Any,
    *,
    undefined: Literal["raise", "nan"] = "raise",
    skip: Collection[str] = (),
    **settings: Any,
) -> dict[str, float]:
    """Every registered metric of one response.

    Parameters
    ----------
    measured, modelled : (n,) array
    undefined : {"raise", "nan"}
        Whether to raise where a metric is not defined for these samples, or where there are none.
    skip : collection of str
        Metrics that are not computed; they are nan.
    **settings
        Arguments of some metrics, such as ``normaliser`` and ``n_terms``. A metric that needs one not given is left
        out.

    Returns
    -------
    dict of str to float

    Raises
    ------
    DomainError
        A metric is not defined, unless `undefined` is ``"nan"``.
    """
    found = {}
    for one in _METRICS.values():
        if one.name in skip:
            found[one.name] = math.nan
            continue
        needed, known = _settings_of(one.function)
        if not needed <= settings.keys():
            continue
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                given = {k: settings[k] for k in known & settings.keys()}
                found[one.name] = float(one.function(measured, modelled, **given))
        except (DomainError, DataError):
            if undefined == "raise":
                raise
            found[one.name] = math.nan
    return found


@dataclass(frozen=True, kw_only=True)
class MetricValues:
    """Base of scores: every metric is an attribute, ``score.tic``.

    Attributes
    ----------
    metrics : mapping of str to float
        By name; nan where a metric is not defined.
    """

    metrics: Mapping[str, float]

    def __getattr__(self, name: str) -> float:
        try:
            return self.__dict__["metrics"][name]
        except KeyError:
            raise AttributeError(f"'{type(self).__name__}' has no attribute or metric '{name}'", name=name) from None

    def cells(self) -> list[str]:
        """Text of each metric of the short tables; see `in_tables`."""
        return [_cell(self.metrics.get(m.name, math.nan)) for m in in_tables(brief=True)]


def _cell(value: float) -> str:
    if not math.isfinite(value):
        return "-"
    return f"{value:.4f}" if abs(value) < 100.0 else f"{value:.2g}"


@functools.cache
def _settings_of(function: Callable[..., float]) -> tuple[set[str], set[str]]:
    """Names of a metric's arguments after the two responses: those without a default, and all."""
    more = list(inspect.signature(function).parameters.values())[2:]
    return {p.name for p in more if p.default is p.empty}, {p.name for p in more}


@metric(label="R2", best=1.0)
def r2(measured: Any, modelled: Any) -> float:
    """Fraction of the measured variance that the model explains::

        R^2 = 1 - sum (y - yhat)^2 / sum (y - ybar)^2

    One is perfect, zero no better than the mean; below zero is worse than the mean.

    Raises
    ------
    DomainError
        The measured response is constant.
    DataError
        Lengths differ, or a value is not finite; names the first sample.

    References
    ----------
    [KM16], [H17]
    """
    y, yhat = _pair(measured, modelled)
    require_variation(y, "R2", "measured response")
    return float(1.0 - np.sum((y - yhat) ** 2) / np.sum((y - y.mean()) ** 2))


@metric(label="adj R2", best=1.0, brief=False)
def adjusted_r2(measured: Any, modelled: Any, n_terms: int) -> float:
    """R^2 corrected for the number of terms::

        1 - (1 - R^2) (n - 1) / (n - n_terms - 1)

    Parameters
    ----------
    n_terms : int
        Terms of the model, the constant not counted.

    Raises
    ------
    DomainError
        The measured response is constant, or there are no more samples than terms.
    DataError
        As `r2`.
    """
    y, yhat = _pair(measured, modelled)
    dof = len(y) - n_terms - 1
    if dof <= 0:
        raise DomainError(f"Adjusted R2 needs more than {n_terms + 1} samples for {n_terms} terms; found {len(y)}.")
    return 1.0 - (1.0 - r2(y, yhat)) * (len(y) - 1) / dof


@metric(label="RRMSE", best=0.0)
def rrmse(measured: Any, modelled: Any, normaliser: Normaliser = "rms") -> float:
    """Root mean squared error over a size of the measured response.

    Parameters
    ----------
    normaliser : {"rms", "std", "range"}
        ``rms`` of the measured response about zero, its standard deviation (divided by n), or its greatest
        less its least value.

    Raises
    ------
    DomainError
        The normaliser is zero.
    DataError
        As `r2`.
    """
    y, yhat = _pair(measured, modelled)
    sizes = {"rms": lambda: np.sqrt(np.mean(y**2)), "std": lambda: np.std(y), "range": lambda: np.ptp(y)}
    if normaliser not in sizes:
        raise DomainError(f"normaliser={normaliser!r} is not one of 'rms', 'std', 'range'.")
    if normaliser != "rms":
        require_variation(y, "RRMSE", "measured response")
    size = sizes[normaliser]()
    if not size > 0:
        raise DomainError("RRMSE needs a measured response that is not zero throughout; found only zeros.")
    return float(np.sqrt(np.mean((y - yhat) ** 2)) / size)


@metric(label="TIC", best=0.0)
def tic(measured: Any, modelled: Any) -> float:
    """Theil's inequality coefficient, 0 perfect and 1 useless::

        TIC = rms(y - yhat) / (rms(y) + rms(yhat))

    Raises
    ------
    DomainError
        Both are zero throughout.
    DataError
        As `r2`.

    References
    ----------
    [J15]
    """
    y, yhat = _pair(measured, modelled)
    size = np.sqrt(np.mean(y**2)) + np.sqrt(np.mean(yhat**2))
    if not size > 0:
        raise DomainError("TIC needs a response that is not zero throughout; measured and modelled are both zero.")
    return float(np.sqrt(np.mean((y - yhat) ** 2)) / size)


@metric(label="corr", best=1.0, brief=False)
def correlation(measured: Any, modelled: Any) -> float:
    """Pearson's correlation coefficient of measured and modelled response.

    Raises
    ------
    DomainError
        Either is constant.
    DataError
        As `r2`.
    """
    y, yhat = _pair(measured, modelled)
    require_variation(y, "Correlation", "measured response")
    require_variation(yhat, "Correlation", "modelled response")
    return float(np.corrcoef(y, yhat)[0, 1])


@metric(label="rms error", best=0.0, unit="response", brief=False)
def rms_error(measured: Any, modelled: Any) -> float:
    """Root mean squared error, in the unit of the response."""
    y, yhat = _pair(measured, modelled)
    with np.errstate(over="ignore"):
        return float(np.sqrt(np.mean((y - yhat) ** 2)))


@metric(label="bias", best=0.0, unit="response", brief=False)
def bias(measured: Any, modelled: Any) -> float:
    """Mean of measured less modelled, in the unit of the response."""
    y, yhat = _pair(measured, modelled)
    return float(np.mean(y - yhat))


def finite_vector(values: Any, what: str) -> np.ndarray:
    """Return values as a vector; refuse another shape, and values that are not finite."""
    array = np.asarray(values, dtype=float)
    if array.ndim != 1 or len(array) == 0:
        raise DataError(f"A {what} is a vector of at least one sample; found shape {array.shape}.")
    finite = np.isfinite(array)
    if not finite.all():
        i = int(np.argmin(finite))
        raise DataError(
            f"A {what} must be finite; found {array[i]} at sample {i} ({int(np.sum(~finite))} such in all)."
        )
    return array


def _pair(measured: Any, modelled: Any) -> tuple[np.ndarray, np.ndarray]:
    y, yhat = finite_vector(measured, "measured response"), finite_vector(modelled, "modelled response")
    if y.shape != yhat.shape:
        raise DataError(f"Measured and modelled response differ in length: {len(y)} and {len(yhat)} samples.")
    return y, yhat


def require_variation(values: np.ndarray, measure: str, what: str) -> None:
    """Refuse a response that is constant."""
    if np.ptp(values) == 0:
        raise DomainError(
            f"{measure} is not defined: the {what} is {values[0]:.6g} at all {len(values)} samples. "
            "Take samples in which it varies."
        )
