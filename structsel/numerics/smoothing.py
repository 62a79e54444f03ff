"""Smoothing spline of one channel, with derivatives of stated accuracy. Arrays only."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import factorial

import numpy as np
import scipy

from structsel.errors import DataError, StructselWarning
from structsel.numerics.arrays import Array
from structsel.numerics.smoothing_kernel import backward_sweep, forward_sweep

ORDERS = (2, 3, 4)
_SPLINE_SAMPLES = 12
_SPLINE_CUTOFFS = 14  # cut-offs tried before the search is refined
_FAINT = 1e-5  # of the signal; a residual below this is rounding and interpolation
_LINE = 0.25  # fraction of the residual's power on one spectral line above which it may be motion


@dataclass(frozen=True, eq=False)
class SmoothedSignal:
    """Smoothed channel, its derivatives, and their standard deviations. Arrays are read-only.

    Attributes
    ----------
    values, values_std : (n,) arrays [unit of x]
        The smooth signal and its standard deviation at each sample.
    derivative, derivative_std : (n,) arrays [unit of x / s]
    second, second_std : (n,) arrays [unit of x / s^2]
        Second derivative; NaN for order 2, which assumes that it is white noise.
    noise : float [unit of x]
        Standard deviation of the white noise that was removed.
    cutoff : float [Hz]
        Frequency at which the smoother passes half the amplitude.
    order : int
        Beyond the cut-off the amplitude of the signal is assumed to fall with this power of frequency.
    """

    values: Array
    values_std: Array
    derivative: Array
    derivative_std: Array
    second: Array
    second_std: Array
    noise: float
    cutoff: float
    order: int

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if isinstance(value, np.ndarray):
                value.setflags(write=False)

    def __str__(self) -> str:
        return (
            f"{self.values.size} samples, noise {self.noise:.3g}, cut-off {self.cutoff:.3g} Hz (order {self.order}); "
            f"median standard deviation {np.median(self.values_std):.3g} of the values, "
            f"{np.median(self.derivative_std):.3g} of the derivative"
        )


def smooth_spline(
    x: np.ndarray, t: np.ndarray, *, order: int | None = None, cutoff: float | None = None
) -> SmoothedSignal:
    """Smoothing spline of one channel, with its first two derivatives and their accuracy.

    The spline of order m minimises::

        sum_k (y_k - x(t_k))^2 / sigma^2  +  1/q  integral x^(m)(t)^2 dt

    which is the estimate of x when its m-th derivative is white noise of intensity q (splines of degree
    2m - 1; m = 2 is the cubic one). q / sigma^2, sigma and m are those of the largest likelihood of the samples,
    given four of them. Unlike cross-validation, the likelihood seldom undersmooths a short record, estimates the
    noise together with the smoothing, and compares orders. The order depends on how smooth the signal is: 2 for the
    pitch rate after a step of the elevator (its derivative jumps), 3 for the angle of attack, 4 for slow motion. The
    penalty is constant along the record: a variable one reduced the error of 3-2-1-1 responses by 5 to 15 %, but its
    standard deviations were wrong.

    Work and memory are O(n); scipy's make_smoothing_spline gives the same curve for m = 2 at the same penalty,
    but no standard deviations and no other order.

    Parameters
    ----------
    x : (n,) array
        NaN samples are missing; they are interpolated, with the standard deviation of the interpolation.
    t : (n,) array [s]
        Strictly increasing, not necessarily even.
    order : {2, 3, 4}, optional
        m; chosen by the likelihood if not given.
    cutoff : float, optional [Hz]
        Of a given order; chosen by the likelihood if not given.

    Returns
    -------
    SmoothedSignal
        In the interior the actual rms error of values and first derivative is 0.7 to 1.1 times the rms of
        the stated standard deviations (white noise of 1 % and more of the signal; 0.7 where the motion is a
        single sine). That does not hold where the noise is coloured or the channel is held over several
        samples, nor sample by sample: at a kink the error is larger than stated, in quiet flight smaller. With
        noise below a thousandth of the signal the error is that of interpolation, and is overstated.

    Raises
    ------
    DataError
        With fewer than 12 finite samples, or times that do not increase.

    Warns
    -----
    StructselWarning
        When the residual contains a steady oscillation: the spline treats one above about a sixth of the sampling
        rate as noise. smooth_fourier, which estimates the noise from the upper half of the spectrum, may follow it.

    References
    ----------
    G. Wahba, *Spline Models for Observational Data*, SIAM, 1990, for the model and its intervals; R. Kohn and
    C. F. Ansley, SIAM J. Sci. Stat. Comput. 8(1), 1987, for the state space form.
    """
    values, clock = np.asarray(x, dtype=float), np.asarray(t, dtype=float)
    finite = np.flatnonzero(np.isfinite(values))
    step = np.diff(clock)
    if values.shape != clock.shape or finite.size < _SPLINE_SAMPLES or not np.all(step > 0.0):
        raise DataError(
            f"smooth_spline needs at least {_SPLINE_SAMPLES} finite samples on an increasing clock of as many; there "
            f"are {finite.size} of {values.size}, on {clock.size} times.\nUse a longer segment."
        )
    y = np.where(np.isfinite(values), values - values[finite].mean(), np.nan)
    models = [_SplineModel(step, m) for m in (ORDERS if order is None else (order,))]
    fits = [_SplineFit(y, model, cutoff) for model in models]
    return _as_signal(values, min(fits, key=lambda fit: fit.misfit) if order is None else fits[0])


def smooth_splines(channels: Sequence[Array], t: Array, *, order: int) -> list[SmoothedSignal]:
    """Smoothing splines of several channels of one clock, each as by `smooth_spline`, in less time.

    Parameters
    ----------
    channels : sequence of (n,) array
        Finite, of at least 12 samples.
    t : (n,) array [s]
        Strictly increasing.
    order : {2, 3, 4}
    """
    if not channels:
        return []
    centred, model = [x - x.mean() for x in channels], _SplineModel(np.diff(t), order)
    y = np.column_stack(centred)
    likeliest = np.argmin(model.profiles(y, _least(y)), axis=0)
    return [_as_signal(x, _SplineFit(z, model, near=int(k))) for x, z, k in zip(channels, centred, likeliest)]


def _least(y: Array) -> Array:
    """Least residual sum of squares (c,) of channels (n, c): a perfect fit leaves the rounding of the samples."""
    count = np.isfinite(y[:, 0]).sum()
    return np.asarray(count * (np.finfo(float).eps * np.nanmax(np.abs(y), axis=0)) ** 2 + np.finfo(float).tiny)


def _as_signal(values: Array, best: _SplineFit) -> SmoothedSignal:
    """The channel smoothed by a fit."""
    finite = np.flatnonzero(np.isfinite(values))
    centre = float(values[finite].mean())
    states, stds = best.solve()
    residual = (best.y - states[:, 0])[finite]
    if residual.std() > _FAINT * values[finite].std():
        _look_for_a_line(residual)
    unknown = np.full(values.size, np.nan)
    return SmoothedSignal(
        values=states[:, 0] + centre,
        values_std=stds[:, 0].copy(),
        derivative=states[:, 1].copy(),
        derivative_std=stds[:, 1].copy(),
        second=states[:, 2].copy() if best.m > 2 else unknown,
        second_std=stds[:, 2].copy() if best.m > 2 else unknown.copy(),
        noise=float(np.sqrt(best.variance)),
        cutoff=best.cutoff,
        order=best.m,
    )


class _SplineModel:
    """Splines of one order on one clock, whatever their samples.

    Attributes
    ----------
    grid : (g,) array
        Logarithms of the cut-offs that are tried before the search is refined.
    """

    def __init__(self, step: Array, m: int):
        self.step, self.m = step, m
        i, j = np.indices((m, m))
        exponent = 2 * m - 1 - i - j
        powers = np.array([factorial(m - 1 - k) for k in range(m)], dtype=float)
        inverse = np.linalg.inv(np.linalg.cholesky(1.0 / (exponent * np.outer(powers, powers))))
        transition = np.array([[1.0 / factorial(b - a) if b >= a else 0.0 for b in range(m)] for a in range(m)])
        self.factors = inverse, inverse @ transition
        self.dt = float(np.median(step))
        self.grid = np.linspace(np.log(0.1 / step.sum()), np.log(5.0 / self.dt), _SPLINE_CUTOFFS)

    def _drive(self, log_cutoff: float) -> float:
        # White noise of variance s^2 has density s^2 dt, and x^(m) of intensity q gives x q / w^2m: equal at cut-off.
        return float(np.sqrt((2.0 * np.pi * np.exp(log_cutoff)) ** (2 * self.m) * self.dt))

    def sweep(self, y: Array, least: Array, log_cutoff: float, rows: Array | None = None) -> tuple[Array, float]:
        """Residual sums of squares (c,) of channels (n, c), at least those of `_least`, and log-determinant.

        The triangular rows of one channel are stored if there is storage for them.
        """
        keep, store = rows is not None, np.empty((1, 1, 1)) if rows is None else rows
        rss, logdet = forward_sweep(self.step, y, self._drive(log_cutoff), *self.factors, store, keep)
        return np.maximum(rss, least), logdet

    def profiles(self, y: Array, least: Array, log_cutoffs: Sequence[float] | None = None) -> Array:
        """-2 log likelihood (g, c), up to a constant, at cut-offs, by default those of the grid.

        With the most likely noise variance of each channel.
        """
        free = int(np.isfinite(y[:, 0]).sum()) - self.m
        swept = [self.sweep(y, least, x) for x in (self.grid if log_cutoffs is None else log_cutoffs)]
        return np.stack([free * np.log(rss / free) + 2.0 * logdet for rss, logdet in swept])


class _SplineFit:
    """The spline of one order at its most likely cut-off.

    Parameters
    ----------
    y : (n,) array
        Samples about their mean.
    model : _SplineModel
    cutoff : float, optional [Hz]
    near : int, optional
        The most likely cut-off of the grid, if it is known.

    Attributes
    ----------
    cutoff : float [Hz]
    variance : float
        Of the noise.
    profile : float
        -2 log likelihood at that cut-off, up to a constant.
    """

    def __init__(self, y: Array, model: _SplineModel, cutoff: float | None = None, near: int | None = None):
        self.y, self.model, self.m = y, model, model.m
        self.count = int(np.isfinite(y).sum())
        self.column = np.ascontiguousarray(y)[:, None]
        self.least = _least(self.column)
        self.rows = None if cutoff is None else self._empty_rows()  # of the only fit there is
        if cutoff is None:
            grid = model.grid
            k = int(np.argmin(model.profiles(self.column, self.least)[:, 0])) if near is None else near
            bounds = grid[max(k - 1, 0)], grid[min(k + 1, _SPLINE_CUTOFFS - 1)]
            found = scipy.optimize.minimize_scalar(
                lambda g: float(model.profiles(self.column, self.least, [g])[0, 0]), bounds=bounds, method="bounded",
                options={"xatol": 0.01},
            )  # fmt: skip
            cutoff = float(np.exp(found.x))
        self.cutoff = cutoff
        (rss,), logdet = model.sweep(self.column, self.least, float(np.log(cutoff)), self.rows)
        free = self.count - self.m
        self.profile = float(free * np.log(rss / free) + 2.0 * logdet)
        self.variance = float(rss) / free

    @property
    def misfit(self) -> float:
        """-2 log likelihood of the samples given four of them, which makes orders comparable."""
        return self.profile + (self.count - self.m) - self._likelihood_of_four()

    def _empty_rows(self) -> Array:
        """Storage for the triangular rows of every state."""
        return np.empty((self.y.size, self.m, 2 * self.m + 1))

    def _likelihood_of_four(self) -> float:
        """-2 log likelihood of four samples over the complete record; a spline of order 4 passes through them."""
        there = np.flatnonzero(np.isfinite(self.y))
        kept = there[np.linspace(0, there.size - 1, max(ORDERS)).round().astype(int)]
        alone = np.full((self.y.size, 1), np.nan)
        alone[kept, 0] = self.y[kept]
        (rss,), logdet = self.model.sweep(alone, self.least, float(np.log(self.cutoff)))
        return float(rss) / self.variance + 2.0 * logdet + (max(ORDERS) - self.m) * np.log(self.variance)

    def solve(self) -> tuple[Array, Array]:
        """States (n, m) and their standard deviations."""
        if self.rows is None:
            self.rows = self._empty_rows()
            self.model.sweep(self.column, self.least, float(np.log(self.cutoff)), self.rows)
        states, variances = np.empty((2, self.y.size, self.m))
        backward_sweep(self.rows, states, variances)
        return states, np.sqrt(variances * self.variance)


def _look_for_a_line(residual: Array) -> None:
    power = np.abs(np.fft.rfft(residual * np.hanning(residual.size)))[1:] ** 2
    total = float(power.sum())
    # A Hann window spreads a line over three bins.
    lines = np.convolve(power, np.ones(3), mode="same")
    if power.size > 40 and total > 0.0 and lines.max() > _LINE * total:
        warnings.warn(
            StructselWarning(
                f"smooth_spline: {lines.max() / total:.0%} of the power removed as noise (rms {residual.std():.3g}) "
                f"is one steady oscillation of {residual.size / (int(np.argmax(lines)) + 1):.1f} samples per cycle. "
                'If it is motion, use method "fourier", or a higher sampling rate.'
            ),
            stacklevel=3,
        )
