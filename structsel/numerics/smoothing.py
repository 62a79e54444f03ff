"""Smoothing of one channel, with derivatives of stated accuracy: a spline and a Fourier series. Arrays only."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, fields
from math import factorial

import numpy as np
from scipy import fft
from scipy.optimize import minimize_scalar

from structsel.errors import DataError, StructselWarning
from structsel.numerics.arrays import Array
from structsel.numerics.signal_quality import noise_level
from structsel.numerics.smoothing_kernel import eliminate, solve_back

ORDERS = (2, 3, 4)
_SPLINE_SAMPLES = 12
_SPLINE_CUTOFFS = 14  # cut-offs tried before the search is refined
_FAINT = 1e-5  # of the signal, below which a residual is rounding and interpolation
_LINE = 0.25  # share of the residual's power on one spectral line at which a motion was taken for noise
_SERIES_SAMPLES = 32
_SERIES_CUTOFFS = 40  # cut-offs tried before the search is refined
_CLEAR = 2.5  # times the cut-off, from where a coefficient is noise alone
_ROUNDS = 2
_GAIN = 0.1  # of the expected error that another order than 3 must bring; less is within its scatter


@dataclass(frozen=True, eq=False)
class SmoothedSignal:
    """One channel without its noise, its derivatives, and how sure they are. Arrays are read-only.

    Attributes
    ----------
    values, values_std : (n,) arrays [unit of x]
        The smooth signal and its standard deviation at each sample.
    derivative, derivative_std : (n,) arrays [unit of x / s]
    second, second_std : (n,) arrays [unit of x / s^2]
        Second derivative; NaN where the smoother assumes no more than that it is white (order 2).
    noise : float [unit of x]
        Standard deviation of the white noise that was taken off.
    cutoff : float [Hz]
        Frequency of which half the amplitude passes.
    order : int
        Sharpness that was assumed: beyond the cut-off the signal's amplitude falls with this power of frequency.
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


def smooth_spline(x: np.ndarray, t: np.ndarray, *, order: int | None = None) -> SmoothedSignal:
    """Smoothing spline of one channel, with its first two derivatives and their accuracy.

    The spline of order m minimises::

        sum_k (y_k - x(t_k))^2 / sigma^2  +  1/q  integral x^(m)(t)^2 dt

    which is the estimate of x when its m-th derivative is white noise of intensity q (splines of degree
    2m - 1; m = 2 is the cubic one). q / sigma^2, sigma and m are those of the largest likelihood of the samples,
    given four of them: unlike cross-validation it seldom undersmooths a short record, gives the noise with the
    smoothing, and compares orders. The order says how sharply the signal moves: the pitch rate after a step of
    the elevator calls for 2 (its derivative jumps), angle of attack for 3, slow motion for 4. No penalty that varies
    along the record is used: on 3-2-1-1 responses it gained 5 to 15 % of the error and cost the calibration
    of the standard deviation.

    Work and memory are O(n); scipy's make_smoothing_spline gives the same curve for m = 2 at the same penalty,
    but no standard deviations and no other order.

    Parameters
    ----------
    x : (n,) array
        NaN samples are missing: they are bridged, with the standard deviation that bridging deserves.
    t : (n,) array [s]
        Strictly increasing, not necessarily even.
    order : {2, 3, 4}, optional
        m; chosen by the likelihood if not given.

    Returns
    -------
    SmoothedSignal
        In the interior the actual rms error of values and first derivative is 0.7 to 1.1 times the rms of
        the stated standard deviations (white noise of 1 % and more of the signal; 0.7 where the motion is a
        single sine). That does not hold where the noise is coloured or the channel is held over several
        samples, nor sample by sample: at a kink the error is larger than stated, in quiet flight smaller. With
        noise below a thousandth of the signal what is left is interpolation, whose error is overstated.

    Raises
    ------
    DataError
        With fewer than 12 finite samples, or a clock that does not increase.

    Warns
    -----
    StructselWarning
        When a steady oscillation is left in the residual: one faster than about a sixth of the sampling rate looks
        like noise to a spline. smooth_fourier, which has the noise from the spectrum's floor, may follow it.

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
            f"are {finite.size} of {values.size}, on {clock.size} times.\nTake a longer stretch."
        )
    centre = float(values[finite].mean())
    y = np.where(np.isfinite(values), values - centre, np.nan)
    fits = [_SplineFit(y, step, m) for m in (ORDERS if order is None else (order,))]
    best = min(fits, key=lambda fit: fit.misfit) if order is None else fits[0]
    states, stds = best.solve()
    residual = (y - states[:, 0])[finite]
    if residual.std() > _FAINT * values[finite].std():
        _look_for_a_line(residual)
    lacking = np.full(values.size, np.nan)
    return SmoothedSignal(
        values=states[:, 0] + centre,
        values_std=stds[:, 0].copy(),
        derivative=states[:, 1].copy(),
        derivative_std=stds[:, 1].copy(),
        second=states[:, 2].copy() if best.m > 2 else lacking,
        second_std=stds[:, 2].copy() if best.m > 2 else lacking.copy(),
        noise=float(np.sqrt(best.variance)),
        cutoff=best.cutoff,
        order=best.m,
    )


class _SplineFit:
    """The spline of one order at its most likely cut-off.

    Attributes
    ----------
    cutoff : float [Hz]
    variance : float
        Of the noise.
    profile : float
        -2 log likelihood at that, less constants.
    """

    def __init__(self, y: Array, step: Array, m: int):
        self.y, self.step, self.m = y, step, m
        i, j = np.indices((m, m))
        exponent = 2 * m - 1 - i - j
        powers = np.array([factorial(m - 1 - k) for k in range(m)], dtype=float)
        inverse = np.linalg.inv(np.linalg.cholesky(1.0 / (exponent * np.outer(powers, powers))))
        transition = np.array([[1.0 / factorial(b - a) if b >= a else 0.0 for b in range(m)] for a in range(m)])
        self.factors = inverse, inverse @ transition
        self.count = int(np.isfinite(y).sum())
        # Rounding of the samples themselves: a perfect fit has this much noise, not none.
        self.least = self.count * (np.finfo(float).eps * float(np.nanmax(np.abs(y)))) ** 2 + np.finfo(float).tiny
        self.dt = float(np.median(step))
        lowest, highest = np.log(0.1 / step.sum()), np.log(5.0 / self.dt)
        grid = np.linspace(lowest, highest, _SPLINE_CUTOFFS)
        k = int(np.argmin([self._profile(g) for g in grid]))
        bounds = grid[max(k - 1, 0)], grid[min(k + 1, _SPLINE_CUTOFFS - 1)]
        found = minimize_scalar(self._profile, bounds=bounds, method="bounded", options={"xatol": 0.01})
        self.cutoff = float(np.exp(found.x))
        self.profile = float(found.fun)
        self.variance = self._sweep(y, step, found.x)[0] / (self.count - m)

    @property
    def misfit(self) -> float:
        """-2 log likelihood of the samples given four of them, which makes orders comparable."""
        return self.profile + (self.count - self.m) - self._spent()

    def _drive(self, log_cutoff: float) -> float:
        # White noise of variance s^2 has density s^2 dt, and x^(m) of intensity q gives x q / w^2m: equal at cut-off.
        return float(np.sqrt((2.0 * np.pi * np.exp(log_cutoff)) ** (2 * self.m) * self.dt))

    def _sweep(self, y: Array, step: Array, log_cutoff: float) -> tuple[float, float]:
        rss, logdet = eliminate(step, y, self._drive(log_cutoff), *self.factors, np.empty((1, 1, 1)), False)
        return max(rss, self.least), logdet

    def _profile(self, log_cutoff: float) -> float:
        """-2 log likelihood, less constants, with the noise variance at its best."""
        rss, logdet = self._sweep(self.y, self.step, log_cutoff)
        free = self.count - self.m
        return free * np.log(rss / free) + 2.0 * logdet

    def _spent(self) -> float:
        """-2 log likelihood of four samples, spread so that none has to be extrapolated; order 4 uses them up."""
        there = np.flatnonzero(np.isfinite(self.y))
        kept = there[np.linspace(0, there.size - 1, max(ORDERS)).round().astype(int)]
        alone = np.full(self.y.size, np.nan)
        alone[kept] = self.y[kept]
        rss, logdet = self._sweep(alone, self.step, float(np.log(self.cutoff)))
        return rss / self.variance + 2.0 * logdet + (max(ORDERS) - self.m) * np.log(self.variance)

    def solve(self) -> tuple[Array, Array]:
        """States (n, m) and their standard deviations."""
        n = self.y.size
        store = np.empty((n, self.m, 2 * self.m + 1))
        eliminate(self.step, self.y, self._drive(np.log(self.cutoff)), *self.factors, store, True)
        states, variances = np.empty((n, self.m)), np.empty((n, self.m))
        solve_back(store, states, variances)
        return states, np.sqrt(variances * self.variance)


def _look_for_a_line(residual: Array) -> None:
    power = np.abs(np.fft.rfft(residual * np.hanning(residual.size)))[1:] ** 2
    total = float(power.sum())
    # A Hann window spreads a line over three bins.
    lines = np.convolve(power, np.ones(3), mode="same")
    if power.size > 40 and total > 0.0 and lines.max() > _LINE * total:
        warnings.warn(
            StructselWarning(
                f"smooth_spline: {lines.max() / total:.0%} of what was taken for noise (rms {residual.std():.3g}) "
                f"is one steady oscillation of {residual.size / (int(np.argmax(lines)) + 1):.1f} samples a cycle. "
                'If that is motion, use method "fourier", or sample faster.'
            ),
            stacklevel=3,
        )


def smooth_fourier(x: np.ndarray, dt: float, *, order: int | None = None) -> SmoothedSignal:
    """Smooth one channel on an even clock, with its first two derivatives and their accuracy.

    Less the straight line through its ends and reflected to an odd periodic signal, a smooth record has a sine
    series whose amplitudes fall as k^-3, whereas white noise has a flat one. The coefficients pass through the Wiener
    filter 1 / (1 + (k / k_c)^(2 order)); the line comes back, and derivatives are those of the series.

    - The line is not drawn through the noisy end samples: it is estimated by generalised least squares from
      all coefficients, those beyond the cut-off counting most, because a wrong line adds 1/k to them.
    - The noise is first `noise_level`, then the median of the coefficients above 2.5 times the cut-off, where enough
      are left.
    - The cut-off is that of the least expected squared error (Stein's unbiased estimate: residual sum of squares
      + 2 noise^2 degrees of freedom), which needs no law for the signal below it. It goes to
      the Nyquist frequency and beyond when nothing is to be gained by smoothing.
    - The order is 3; 2 (the derivative jumps) or 4 is taken where its expected squared error is less by a tenth.

    Parameters
    ----------
    x : (n,) array
        Finite.
    dt : float [s]
    order : {2, 3, 4}, optional
        Power with which amplitudes fall; chosen as above if not given.

    Returns
    -------
    SmoothedSignal
        In the interior the actual rms error of values and first derivative is 0.75 to 1.3 times the rms of
        the stated standard deviations (white noise, signals without kinks). The stated one is too small, by
        up to two and a half times, for the derivative of a signal whose derivative jumps (the order-2 spline has
        that one right), and within about two periods of the cut-off from either end where the signal's
        second derivative is not small there: the series takes it for zero.

    Raises
    ------
    DataError
        With fewer than 32 samples, or one that is not finite.

    References
    ----------
    C. Lanczos, *Applied Analysis*, Prentice-Hall, 1956; E. A. Morelli, *Estimating noise characteristics from flight
    test data using optimal Fourier smoothing*, Journal of Aircraft 32(4), 1995; [KM16].
    """
    values = np.asarray(x, dtype=float)
    lost = np.flatnonzero(~np.isfinite(values))
    if values.size < _SERIES_SAMPLES or lost.size:
        what = f"sample {lost[0]} is {values[lost[0]]}" if lost.size else f"there are {values.size}"
        raise DataError(
            f"smooth_fourier needs at least {_SERIES_SAMPLES} samples, all finite and on an even clock; {what}.\n"
            "Use smooth_spline, which bridges missing samples, or take another stretch."
        )
    series = _Series(values, dt)
    noise = noise_level(values, dt)
    for _ in range(_ROUNDS):
        risks = {m: series.least_risk(noise, m) for m in (ORDERS if order is None else (order,))}
        chosen = 3 if order is None else order
        best = min(risks, key=lambda m: risks[m][0])
        if risks[best][0] < (1.0 - _GAIN) * risks[chosen][0]:
            chosen = best
        noise = series.noise_above(_CLEAR * risks[chosen][1], risks[chosen][1], chosen, noise)
    return series.smoothed(risks[chosen][1], chosen, noise)


class _Series:
    """Sine series of one record and of the two ends of a straight line, orthonormal so that noise stays white.

    Attributes
    ----------
    d : (n - 2,) array
        Coefficients of the interior samples.
    X : (n - 2, 2) array
        Coefficients of a line that is one at the first sample and zero at the last, and the reverse.
    """

    def __init__(self, x: Array, dt: float):
        self.n = x.size
        self.length = float((self.n - 1) * dt)
        self.ends = x[[0, -1]]
        rise = np.arange(self.n) / (self.n - 1)
        self.line = np.column_stack([1.0 - rise, rise])
        self.d = fft.dst(x[1:-1], type=1, norm="ortho")
        self.X = fft.dst(self.line[1:-1], type=1, norm="ortho", axis=0)
        self.k = np.arange(1.0, self.n - 1)

    def _passed(self, k_c: float, order: int) -> Array:
        return 1.0 / (1.0 + (self.k / k_c) ** (2 * order))

    def _line(self, passed: Array) -> tuple[Array, Array, Array]:
        """Ends of the line, the coefficients less it, and the normal matrix (noise variance one)."""
        # Signal and noise together have variance noise^2 / (1 - passed) in a coefficient.
        weight = 1.0 - passed
        normal = (self.X * weight[:, None]).T @ self.X + np.eye(2)
        ends = np.linalg.solve(normal, self.X.T @ (weight * self.d) + self.ends)
        return ends, self.d - self.X @ ends, normal

    def risk(self, k_c: float, order: int, noise: float) -> float:
        """Expected sum of squared errors, less a constant."""
        passed = self._passed(k_c, order)
        ends, rest, normal = self._line(passed)
        stopped = 1.0 - passed
        residual = np.sum((stopped * rest) ** 2) + np.sum((self.ends - ends) ** 2)
        by_line = np.linalg.solve(normal, (self.X * (stopped**2)[:, None]).T @ self.X + np.eye(2))
        degrees = passed.sum() + np.trace(by_line)
        return float(residual + noise**2 * (2.0 * degrees - self.n))

    def least_risk(self, noise: float, order: int) -> tuple[float, float]:
        """Least risk and the cut-off k_c that has it."""
        grid = np.linspace(np.log(1.0), np.log(3.0 * self.n), _SERIES_CUTOFFS)
        at = int(np.argmin([self.risk(float(np.exp(g)), order, noise) for g in grid]))
        bounds = grid[max(at - 1, 0)], grid[min(at + 1, _SERIES_CUTOFFS - 1)]
        found = minimize_scalar(lambda g: self.risk(float(np.exp(g)), order, noise), bounds=bounds, method="bounded")
        return float(found.fun), float(np.exp(found.x))

    def noise_above(self, lowest: float, k_c: float, order: int, otherwise: float) -> float:
        """Noise from the coefficients above `lowest`, or what it was where they are too few to judge by."""
        _, rest, _ = self._line(self._passed(k_c, order))
        beyond = rest[self.k > lowest]
        # The square of a normal variable has its median at 0.4549.
        return float(np.sqrt(np.median(beyond**2) / 0.4549)) if beyond.size > 0.2 * self.n else otherwise

    def smoothed(self, k_c: float, order: int, noise: float) -> SmoothedSignal:
        passed = self._passed(k_c, order)
        ends, rest, normal = self._line(passed)
        w = np.pi * self.k / self.length
        # What an uncertain end moves at each sample: its line less what the filter takes of that for signal.
        per_end = -passed[:, None] * self.X
        spread = np.linalg.inv(normal)
        slope = np.array([-1.0, 1.0]) / self.length

        def std(of_line: Array, powers: Array, sign: float) -> Array:
            own = (self._double(powers, sign) + np.einsum("ij,jk,ik->i", of_line, spread, of_line)).clip(0.0)
            return noise * np.sqrt(own)

        coefficients = passed * rest
        return SmoothedSignal(
            values=self.line @ ends + self._sines(coefficients),
            values_std=std(self.line + self._sines(per_end), passed, -1.0),
            derivative=self._cosines(w * coefficients) + slope @ ends,
            derivative_std=std(self._cosines(w[:, None] * per_end) + slope, passed * w**2, 1.0),
            second=self._sines(-(w**2) * coefficients),
            second_std=std(self._sines(-(w**2)[:, None] * per_end), passed * w**4, -1.0),
            noise=noise,
            cutoff=k_c / (2.0 * self.length),
            order=order,
        )

    def _sines(self, a: Array) -> Array:
        """sum_k a_k sqrt(2/N) sin(pi k j / N) at j = 0 ... N = n - 1."""
        made = np.zeros((self.n, *a.shape[1:]))
        made[1:-1] = fft.dst(a, type=1, norm="ortho", axis=0)
        return made

    def _cosines(self, a: Array) -> Array:
        padded = np.zeros((self.n, *a.shape[1:]))
        padded[1:-1] = a
        return fft.dct(padded, type=1, axis=0) / np.sqrt(2.0 * (self.n - 1))

    def _double(self, a: Array, sign: float) -> Array:
        """sum_k a_k (2/N) cos^2(pi k j / N) for sign 1, sin^2 for -1."""
        doubled = fft.fft(np.concatenate(([0.0], a))).real
        return (a.sum() + sign * np.append(doubled, doubled[0])) / (self.n - 1)
