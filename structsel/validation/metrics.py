"""Measures of fit and of whiteness.

Arrays in, one number or array out. ``measured`` and ``modelled`` are (n,) arrays of one response.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from statsmodels.stats.diagnostic import acorr_ljungbox

from structsel.errors import DataError, DomainError
from structsel.numerics import noise_models

Normaliser = Literal["rms", "std", "range"]


def r2(measured: Any, modelled: Any) -> float:
    """Share of the measured variance that the model explains::

        R^2 = 1 - sum (y - yhat)^2 / sum (y - ybar)^2

    One is perfect, zero no better than the mean; below zero is worse than the mean.

    Parameters
    ----------
    measured, modelled : (n,) array

    Returns
    -------
    float

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
    _varies(y, "R2", "measured response")
    return float(1.0 - np.sum((y - yhat) ** 2) / np.sum((y - y.mean()) ** 2))


def adjusted_r2(measured: Any, modelled: Any, n_terms: int) -> float:
    """R^2 corrected for the number of terms::

        1 - (1 - R^2) (n - 1) / (n - n_terms - 1)

    Parameters
    ----------
    measured, modelled : (n,) array
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


def rrmse(measured: Any, modelled: Any, normaliser: Normaliser = "rms") -> float:
    """Root mean squared error over a size of the measured response.

    Parameters
    ----------
    measured, modelled : (n,) array
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
        _varies(y, "RRMSE", "measured response")
    size = sizes[normaliser]()
    if not size > 0:
        raise DomainError("RRMSE needs a measured response that is not zero throughout; found only zeros.")
    return float(np.sqrt(np.mean((y - yhat) ** 2)) / size)


def tic(measured: Any, modelled: Any) -> float:
    """Theil's inequality coefficient, 0 perfect and 1 useless::

        TIC = rms(y - yhat) / (rms(y) + rms(yhat))

    Parameters
    ----------
    measured, modelled : (n,) array

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


def correlation(measured: Any, modelled: Any) -> float:
    """Pearson's correlation coefficient of measured and modelled response.

    Parameters
    ----------
    measured, modelled : (n,) array

    Raises
    ------
    DomainError
        Either is constant.
    DataError
        As `r2`.
    """
    y, yhat = _pair(measured, modelled)
    _varies(y, "Correlation", "measured response")
    _varies(yhat, "Correlation", "modelled response")
    y, yhat = y - y.mean(), yhat - yhat.mean()
    return float(y @ yhat / np.sqrt((y @ y) * (yhat @ yhat)))


def autocorrelation(residual: Any, lags: int) -> np.ndarray:
    """Autocorrelation of a residual::

        rho_l = sum_t e_t e_{t-l} / sum_t e_t^2,   e about its mean

    Parameters
    ----------
    residual : (n,) array
    lags : int
        Highest lag, below n.

    Returns
    -------
    (lags + 1,) array
        The first is 1. White residuals stay within `white_bound` at 19 lags of 20.

    Raises
    ------
    DomainError
        The residual is constant, or as short as the lags.
    DataError
        A value is not finite.
    """
    e = _one(residual, "residual")
    _reaches(e, lags, "Autocorrelation")
    return noise_models.autocorrelation(e, lags)


def white_bound(n: int) -> float:
    """95 % bound of the autocorrelation of n white samples, 1.96 / sqrt(n)."""
    return 1.959963984540054 / float(np.sqrt(n))


def ljung_box(residual: Any, lags: int, n_terms: int = 0) -> tuple[float, float]:
    """Ljung-Box statistic of a residual and its p value; a small p says that it is not white.

    Parameters
    ----------
    residual : (n,) array
    lags : int
    n_terms : int
        Taken off the degrees of freedom; autoregressive terms fitted to the residual, else 0.

    Returns
    -------
    statistic, p : float

    Raises
    ------
    DomainError, DataError
        As `autocorrelation`.
    """
    e = _one(residual, "residual")
    _reaches(e, lags, "Ljung-Box")
    table = acorr_ljungbox(e, lags=[lags], model_df=n_terms)
    return float(table["lb_stat"].iloc[0]), float(table["lb_pvalue"].iloc[0])


def durbin_watson(residual: Any) -> float:
    """Durbin-Watson statistic: 2 for white residuals, towards 0 for slowly varying ones::

        d = sum_t (e_t - e_{t-1})^2 / sum_t e_t^2

    Raises
    ------
    DomainError
        The residual is zero throughout.
    DataError
        A value is not finite.
    """
    e = _one(residual, "residual")
    if not np.any(e):
        raise DomainError("Durbin-Watson needs a residual that is not zero throughout.")
    return float(np.sum(np.diff(e) ** 2) / np.sum(e**2))


def _reaches(residual: np.ndarray, lags: int, measure: str) -> None:
    if not 1 <= lags < len(residual):
        least = max(lags, 1)
        raise DomainError(f"{measure} to lag {lags} needs more than {least} samples; found {len(residual)}.")
    _varies(residual, measure, "residual")


def _one(values: Any, what: str) -> np.ndarray:
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
    y, yhat = _one(measured, "measured response"), _one(modelled, "modelled response")
    if y.shape != yhat.shape:
        raise DataError(f"Measured and modelled response differ in length: {len(y)} and {len(yhat)} samples.")
    return y, yhat


def _varies(values: np.ndarray, measure: str, what: str) -> None:
    if np.ptp(values) == 0:
        raise DomainError(
            f"{measure} is not defined: the {what} is {values[0]:.6g} at all {len(values)} samples. "
            "Take samples in which it varies."
        )
