"""Tests of the whiteness of a residual: autocorrelation, Ljung-Box, Durbin-Watson."""

from __future__ import annotations

from typing import Any

import numpy as np

from structsel.errors import DomainError
from structsel.metrics import finite_vector, require_variation
from structsel.numerics import noise_models


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
    e = finite_vector(residual, "residual")
    _require_samples(e, lags, "Autocorrelation")
    return noise_models.autocorrelation(e, lags)


def white_bound(n: int) -> float:
    """95 % bound of the autocorrelation of n white samples, 1.96 / sqrt(n)."""
    return 1.959963984540054 / float(np.sqrt(n))


def ljung_box(residual: Any, lags: int) -> tuple[float, float]:
    """Ljung-Box statistic of a residual and its p value; a small p says that it is not white.

    Parameters
    ----------
    residual : (n,) array
    lags : int

    Returns
    -------
    statistic, p : float

    Raises
    ------
    DomainError, DataError
        As `autocorrelation`.
    """
    from statsmodels.stats.diagnostic import acorr_ljungbox

    e = finite_vector(residual, "residual")
    _require_samples(e, lags, "Ljung-Box")
    table = acorr_ljungbox(e, lags=[lags])
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
    from statsmodels.stats.stattools import durbin_watson as durbin_watson_of

    e = finite_vector(residual, "residual")
    if not np.any(e):
        raise DomainError("Durbin-Watson needs a residual that is not zero throughout.")
    return float(durbin_watson_of(e))


def _require_samples(residual: np.ndarray, lags: int, measure: str) -> None:
    if not 1 <= lags < len(residual):
        least = max(lags, 1)
        raise DomainError(f"{measure} to lag {lags} needs more than {least} samples; found {len(residual)}.")
    require_variation(residual, measure, "residual")
