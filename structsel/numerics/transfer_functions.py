"""Transfer functions as products of factors, fitted to frequency responses. Arrays only.

::

    H(s) = K  product of numerator factors / product of denominator factors  exp(-tau s)

    first order   s + a                     second order  s^2 + 2 zeta omega s + omega^2
    quadratic     s^2 + c1 s + c0           integrator    s

The logarithm of H is a sum, so that magnitude, phase and their derivatives by the parameters are exact.

References
----------
[TR12], [H79].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from structsel.errors import DataError

FactorKind = Literal["first", "second", "quadratic", "integrator"]
DB = 20.0 / np.log(10.0)
"""Decibel per unit of ln |H|."""
DEG = 180.0 / np.pi
PHASE_WEIGHT = 0.01745
"""Squared degrees to squared decibels: 7.57 deg count as 1 dB [TR12], [H79]."""
SCALE = 20.0
"""The cost is that of 20 frequencies [H79]; below 100 a fit is usually acceptable, below 50 nearly perfect [TR12]."""
_STARTS = 20  # random start values; chosen, not critical
_SEED = 7


@dataclass(frozen=True)
class ModelFactor:
    """One factor; `places` are those of its parameters among all, `power` is 1 above and -1 below the line."""

    kind: FactorKind
    places: tuple[int, ...]
    power: int

    def value(self, s: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """(f,) complex value."""
        a = theta[list(self.places)]
        if self.kind == "first":
            return s + a[0]
        if self.kind == "second":
            return s**2 + 2.0 * a[0] * a[1] * s + a[1] ** 2
        if self.kind == "quadratic":
            return s**2 + a[0] * s + a[1]
        return s

    def slopes(self, s: np.ndarray, theta: np.ndarray) -> list[np.ndarray]:
        """Derivatives of the value by the factor's parameters."""
        if self.kind == "first":
            return [np.ones_like(s)]
        if self.kind == "second":
            zeta, omega = theta[list(self.places)]
            return [2.0 * omega * s, 2.0 * zeta * s + 2.0 * omega]
        return [s, np.ones_like(s)] if self.kind == "quadratic" else []

    def roots(self, theta: np.ndarray) -> np.ndarray:
        """Roots in s."""
        a = theta[list(self.places)]
        if self.kind == "first":
            return np.array([-a[0]], dtype=complex)
        if self.kind == "integrator":
            return np.zeros(1, dtype=complex)
        c1, c0 = (2.0 * a[0] * a[1], a[1] ** 2) if self.kind == "second" else (a[0], a[1])
        return np.asarray(np.roots([1.0, c1, c0]), dtype=complex)


@dataclass(frozen=True)
class FactoredModel:
    """One transfer function; `gain` and `delay` are places among the parameters, `delay` None for no delay."""

    factors: tuple[ModelFactor, ...]
    gain: int
    delay: int | None

    def evaluate(self, omega: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """(f,) complex response at s = i omega."""
        s = 1j * np.asarray(omega, dtype=float)
        value = np.full(s.shape, theta[self.gain], dtype=complex)
        for factor in self.factors:
            value = value * factor.value(s, theta) ** factor.power
        return value if self.delay is None else value * np.exp(-theta[self.delay] * s)

    def log_slopes(self, omega: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """(f, k) complex derivatives of ln H by the parameters."""
        s = 1j * np.asarray(omega, dtype=float)
        slopes = np.zeros((s.size, theta.size), dtype=complex)
        slopes[:, self.gain] += 1.0 / theta[self.gain]
        for factor in self.factors:
            value = factor.value(s, theta)
            for place, slope in zip(factor.places, factor.slopes(s, theta)):
                slopes[:, place] += factor.power * slope / value
        if self.delay is not None:
            slopes[:, self.delay] -= s
        return slopes


@dataclass(frozen=True)
class ResponseData:
    """A frequency response to fit: H at omega [rad/s], partial coherence, covariance of its relative errors (f, f)."""

    omega: np.ndarray
    response: np.ndarray
    coherence: np.ndarray
    covariance: np.ndarray

    @property
    def weight(self) -> np.ndarray:
        """(f,) weights of the coherence, (1.58 (1 - exp(-g^2)))^2 [TR12]: 1 at g^2 = 1."""
        return (1.58 * (1.0 - np.exp(-self.coherence))) ** 2


@dataclass(frozen=True)
class TransferFunctionFit:
    """Parameters, their covariance (k, k), the cost of each response, and the number of starts that ended there."""

    theta: np.ndarray
    covariance: np.ndarray
    costs: np.ndarray
    agreeing: int


def fit_factored(
    models: Sequence[FactoredModel],
    data: Sequence[ResponseData],
    held: np.ndarray,
    *,
    positive: np.ndarray,
    delays: np.ndarray,
) -> TransferFunctionFit:
    """Least squares of magnitude and phase of several responses, parameters in common.

    The cost of one response of n frequencies, W the weight of the coherence::

        J = 20 / n  sum W [ (|Hc| - |H|)^2  dB^2  +  0.01745 (arg Hc - arg H)^2  deg^2 ]

    The standard errors follow from the random errors of the response and their correlation from frequency to frequency,
    not from the size of the residuals: covariance (A'A)^-1 A' C A (A'A)^-1 with A the weighted slopes and C the
    weighted error covariance. They leave out the error of the form of the transfer function.

    Parameters
    ----------
    models : sequence of FactoredModel
    data : sequence of ResponseData
    held : (k,) array
        Values of parameters that are held; NaN for those to be estimated.
    positive : (k,) bool array
        Parameters that start above zero (frequencies); dampings start between 0.1 and 1.
    delays : (k,) bool array

    Raises
    ------
    DataError
        Fewer equations than parameters, or no start converges.
    """
    free = np.flatnonzero(np.isnan(held))
    equations = 2 * sum(one.omega.size for one in data)
    if equations <= free.size:
        raise DataError(f"{equations // 2} frequencies give {equations} equations for {free.size} parameters.")
    gains = np.array([model.gain for model in models])
    rng = np.random.default_rng(_SEED)
    low, high = (float(np.log(end([end(one.omega) for one in data]))) for end in (np.min, np.max))
    found = []
    for _ in range(_STARTS if free.size else 0):
        theta = np.where(positive, np.exp(rng.uniform(low, high, held.size)), rng.uniform(0.1, 1.0, held.size))
        theta[delays] = rng.uniform(0.0, 0.5 / np.exp(high), int(delays.sum()))
        theta = np.where(np.isnan(held), theta, held)
        theta = _with_gains(models, data, theta, gains, held)
        solved = scipy.optimize.least_squares(
            lambda x, t=theta: _residuals(models, data, _filled(t, free, x)),
            theta[free],
            lambda x, t=theta: _slopes(models, data, _filled(t, free, x))[:, free],
            x_scale=np.maximum(np.abs(theta[free]), 1e-3),
            max_nfev=200,
        )
        if np.isfinite(solved.cost):
            found.append((float(solved.cost), _filled(theta, free, solved.x)))
    if not free.size:
        found = [(0.0, held)]
    if not found:
        raise DataError("the fit of the transfer function converges from no start; use fewer factors.")
    least, theta = min(found, key=lambda one: one[0])
    agreeing = sum(cost <= least * 1.01 + 1e-9 for cost, _ in found) if free.size else _STARTS
    A = _slopes(models, data, theta)[:, free]
    C = _error_covariance(data)
    inverse = np.linalg.pinv(A)
    covariance = np.zeros((held.size, held.size))
    covariance[np.ix_(free, free)] = inverse @ C @ inverse.T
    ends = np.cumsum([2 * one.omega.size for one in data])
    residuals = np.split(_residuals(models, data, theta), ends[:-1])
    return TransferFunctionFit(theta, covariance, np.array([float(r @ r) for r in residuals]), agreeing)


def _filled(theta: np.ndarray, free: np.ndarray, values: np.ndarray) -> np.ndarray:
    made = theta.copy()
    made[free] = values
    return made


def _with_gains(
    models: Sequence[FactoredModel],
    data: Sequence[ResponseData],
    theta: np.ndarray,
    gains: np.ndarray,
    held: np.ndarray,
) -> np.ndarray:
    """Start values with the gain of each model that suits its magnitude and, by its sign, its phase."""
    made = theta.copy()
    made[gains] = np.where(np.isnan(held[gains]), 1.0, held[gains])
    for model, one in zip(models, data):
        if np.isnan(held[model.gain]):
            ratio = one.response / model.evaluate(one.omega, made)
            sign = 1.0 if np.sum(np.cos(np.angle(ratio))) >= 0.0 else -1.0
            made[model.gain] = sign * np.exp(np.mean(np.log(np.abs(ratio))))
    return made


def _scales(one: ResponseData) -> tuple[np.ndarray, np.ndarray]:
    """Square roots of the weights of decibels and degrees."""
    root = np.sqrt(SCALE / one.omega.size * one.weight)
    return root, root * np.sqrt(PHASE_WEIGHT)


def _residuals(models: Sequence[FactoredModel], data: Sequence[ResponseData], theta: np.ndarray) -> np.ndarray:
    parts = []
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for model, one in zip(models, data):
            ratio = np.log(model.evaluate(one.omega, theta) / one.response)  # the phase within half a turn
            dB, deg = _scales(one)
            parts += [dB * DB * ratio.real, deg * DEG * ratio.imag]
    return np.nan_to_num(np.concatenate(parts), nan=1e6, posinf=1e6, neginf=-1e6)


def _slopes(models: Sequence[FactoredModel], data: Sequence[ResponseData], theta: np.ndarray) -> np.ndarray:
    parts = []
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for model, one in zip(models, data):
            slopes = model.log_slopes(one.omega, theta)
            dB, deg = _scales(one)
            parts += [dB[:, None] * DB * slopes.real, deg[:, None] * DEG * slopes.imag]
    return np.nan_to_num(np.concatenate(parts), posinf=1e6, neginf=-1e6)


def _error_covariance(data: Sequence[ResponseData]) -> np.ndarray:
    """Covariance of the weighted residuals: magnitude and phase are independent and have equal relative errors."""
    size = 2 * sum(one.omega.size for one in data)
    made, at = np.zeros((size, size)), 0
    for one in data:
        for scale, unit in zip(_scales(one), (DB, DEG)):
            rows = slice(at, at + one.omega.size)
            made[rows, rows] = unit**2 * scale[:, None] * one.covariance * scale
            at += one.omega.size
    return made
