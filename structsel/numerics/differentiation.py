"""Derivatives of evenly sampled signals: finite differences, local polynomials, and smoothers.

Arrays only. The derivatives a flight-test coefficient needs (p', q', r') are differences of noisy
signals: a difference of order h^4 follows fast motion best and amplifies noise most, a local
polynomial is a compromise, and the smoothers determine the compromise from the samples.
"""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
from math import factorial

import numpy as np
import scipy

from structsel.errors import DataError, DomainError
from structsel.numerics.fourier_series import smooth_fourier
from structsel.numerics.smoothing import smooth_spline

SMOOTHERS = ("spline", "fourier")
METHODS = ("central", "forward", "backward", "local-polynomial", *SMOOTHERS)
_ORDERS = {"central": (2, 4), "forward": (1, 2, 4), "backward": (1, 2, 4)}
_HIGHEST_DERIVATIVE = 4


def differentiate(
    x: np.ndarray,
    dt: float,
    method: str = "central",
    order: int = 4,
    *,
    derivative: int = 1,
    window: int | None = None,
    axis: int = 0,
) -> np.ndarray:
    """Derivative of a signal on an even clock.

    Parameters
    ----------
    x : (n, ...) array
    dt : float [s]
    method : {"central", "forward", "backward", "local-polynomial", "spline", "fourier"}
        Near an end, where the stencil of a difference would extend beyond the record, the nearest stencil inside
        with the same truncation order is used. "local-polynomial" fits a polynomial to `window` samples around
        each sample (Savitzky-Golay) and so smooths as well. "spline" and "fourier" estimate the noise and smooth
        accordingly; `smoothing.smooth_spline` and `fourier_series.smooth_fourier` have the method and give the
        accuracy of the first two derivatives. "spline" interpolates over NaN samples.
    order : int
        Truncation order of a difference, the error being O(dt^order): 2 or 4 for central, 1, 2 or 4 for
        the others. For "local-polynomial" the degree of the polynomial. The smoothers do not use it.
    derivative : int
        First (1) to fourth (4); of the smoothers first or second.
    window : int, optional
        Samples of a local polynomial, odd and above `order`; 2 order + 3 if not given.
    axis : int
        Along which time runs.

    Returns
    -------
    derivative : array of x's shape [unit of x / s^derivative]
        A difference of order a is exact on polynomials of degree up to ``derivative + a - 1``.

    Raises
    ------
    DataError
        When the signal has fewer samples than one stencil or window.
    DomainError
        When dt is not above zero, or an option is none of those above.

    References
    ----------
    [C89] for the differences; A. Savitzky, M. J. E. Golay, Analytical Chemistry 36(8), 1964.
    """
    if not dt > 0.0:
        raise DomainError(f"differentiate needs dt above zero; it is {dt:g} s.")
    if method not in METHODS:
        raise DomainError(f"differentiate has no method {method!r}; it has {', '.join(METHODS)}.")
    if derivative not in range(1, _HIGHEST_DERIVATIVE + 1):
        raise DomainError(f"differentiate gives derivatives 1 to {_HIGHEST_DERIVATIVE}, not {derivative}.")
    values = np.moveaxis(np.asarray(x, dtype=float), axis, 0)
    if method in SMOOTHERS:
        made = smooth_derivative(values, dt * np.arange(len(values)), method, derivative)
    elif method == "local-polynomial":
        made = _local_polynomial(values, dt, order, derivative, window)
    else:
        if order not in _ORDERS[method]:
            allowed = ", ".join(map(str, _ORDERS[method]))
            raise DomainError(f"{method} differences have truncation order {allowed}, not {order}.")
        made = _difference(values, method, order, derivative) / dt**derivative
    return np.moveaxis(made, 0, axis)


def smooth_derivative(x: np.ndarray, t: np.ndarray, method: str = "spline", derivative: int = 1) -> np.ndarray:
    """First or second derivative by a smoother; the spline takes any clock.

    Parameters
    ----------
    x : (n, ...) array
        Time along the first axis.
    t : (n,) array [s]
        Even for "fourier".
    method : {"spline", "fourier"}
    derivative : {1, 2}

    Raises
    ------
    DataError
        As `smoothing.smooth_spline` and `fourier_series.smooth_fourier`.
    DomainError
        For a higher derivative.
    """
    if derivative not in (1, 2):
        raise DomainError(
            f"{method} gives the first and the second derivative, not number {derivative}: higher ones depend "
            'on the penalty more than on the samples. Take differences ("central") of a smooth derivative.'
        )
    columns = x.reshape(len(x), -1)
    made = np.empty(columns.shape)
    for j, column in enumerate(columns.T):
        if method == "fourier":
            smooth = smooth_fourier(column, (t[-1] - t[0]) / (len(t) - 1))
        else:
            smooth = smooth_spline(column, t)
            if derivative == 2 and smooth.order == 2:
                # Order 2 assumes that the second derivative is white noise and has no estimate of it.
                smooth = smooth_spline(column, t, order=3)
        made[:, j] = smooth.derivative if derivative == 1 else smooth.second
    return made.reshape(x.shape)


@lru_cache(maxsize=256)
def difference_weights(offsets: tuple[int, ...], derivative: int = 1) -> tuple[float, ...]:
    """Weights w with sum w_k x(t + k dt) = dt^m x^(m)(t), exact on polynomials of degree len(offsets) - 1.

    Parameters
    ----------
    offsets : tuple of int
        The samples used, counted from the one whose derivative is wanted.
    derivative : int
        m.
    """
    # The Lagrange polynomial of each offset, in exact fractions, so that the weights have no rounding error.
    weights = []
    for k in offsets:
        poly = [Fraction(1)]
        for j in offsets:
            if j != k:
                raised, lowered = [Fraction(0), *poly], [*poly, Fraction(0)]
                poly = [(a - j * b) / (k - j) for a, b in zip(raised, lowered)]
        weights.append(float(poly[derivative] * factorial(derivative)))
    return tuple(weights)


@lru_cache(maxsize=64)
def _stencils(method: str, order: int, derivative: int) -> tuple[tuple[int, ...], int]:
    """Offsets of the interior stencil, and the width of those near an end."""
    width = derivative + order
    if method == "forward":
        return tuple(range(width)), width
    if method == "backward":
        return tuple(range(1 - width, 1)), width
    # By symmetry a central stencil of an even derivative has one order more.
    half = (derivative + 1) // 2 - 1 + order // 2
    return tuple(range(-half, half + 1)), width


def _difference(x: np.ndarray, method: str, order: int, derivative: int) -> np.ndarray:
    interior, width = _stencils(method, order, derivative)
    n, before, after = len(x), -interior[0], interior[-1]
    if n < max(width, len(interior)):
        raise DataError(
            f"a {method} difference of order {order} needs at least {max(width, len(interior))} samples; "
            f"there are {n}.\nAsk for a lower order, or a longer recording."
        )
    out = np.zeros_like(x)
    middle = slice(before, n - after)
    for k, weight in zip(interior, difference_weights(interior, derivative)):
        if weight:
            out[middle] += weight * x[before + k : n - after + k]
    for i in (*range(before), *range(n - after, n)):
        first = 0 if i < before else n - width
        offsets = tuple(range(first - i, first - i + width))
        out[i] = np.tensordot(difference_weights(offsets, derivative), x[first : first + width], axes=(0, 0))
    return out


def _local_polynomial(x: np.ndarray, dt: float, degree: int, derivative: int, window: int | None) -> np.ndarray:
    samples = 2 * degree + 3 if window is None else window
    if samples % 2 == 0 or samples <= degree or degree < derivative:
        raise DomainError(
            f"a local polynomial of degree {degree} over {samples} samples gives no derivative {derivative}: "
            "the window must be odd and above the degree, the degree not below the derivative."
        )
    if len(x) < samples:
        raise DataError(
            f"a local polynomial over {samples} samples needs as many; there are {len(x)}.\n"
            "Give a smaller window, or a longer recording."
        )
    return scipy.signal.savgol_filter(x, samples, degree, deriv=derivative, delta=dt, axis=0, mode="interp")
