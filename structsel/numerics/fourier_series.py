"""Sine and cosine series of a record: smoothing with derivatives, and a spectrum with tapered ends. Arrays only."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy

from structsel.errors import DataError
from structsel.numerics.arrays import Array
from structsel.numerics.signal_quality import MEDIAN_SQUARE, noise_level
from structsel.numerics.smoothing import ORDERS, SmoothedSignal

_SERIES_SAMPLES = 32
_SERIES_CUTOFFS = 40  # cut-offs tried before the search is refined
_CLEAR = 2.5  # times the cut-off; above it coefficients are noise alone
_ROUNDS = 2
_GAIN = 0.1  # least relative reduction of the expected error by another order than 3; less is within its scatter


# ---------------------------------------------------------------- smoothing by a sine series


def smooth_fourier(x: np.ndarray, dt: float) -> SmoothedSignal:
    """Smooth one channel on an even clock, with its first two derivatives and their accuracy.

    Without the linear trend between its ends, and reflected to an odd periodic signal, a smooth record has a sine
    series whose amplitudes fall as k^-3; the amplitudes of white noise are constant. The coefficients are multiplied
    by the Wiener filter 1 / (1 + (k / k_c)^(2 order)). The trend is then added; derivatives are those of the series.

    - The trend does not pass through the noisy end samples: it is estimated by generalised least squares from
      all coefficients. Those beyond the cut-off have the largest weight: an error of the trend adds 1/k to them.
    - The noise is first `noise_level`, then the median of the coefficients above 2.5 times the cut-off, if there are
      enough of them.
    - The cut-off is that of the least expected squared error (Stein's unbiased estimate: residual sum of squares
      + 2 noise^2 degrees of freedom), which needs no model of the signal below it. It lies at the Nyquist frequency
      or beyond if smoothing does not reduce the error.
    - The order is 3; 2 (the derivative jumps) or 4 is chosen if its expected squared error is less by a tenth.

    Parameters
    ----------
    x : (n,) array
        Finite.
    dt : float [s]

    Returns
    -------
    SmoothedSignal
        In the interior the actual rms error of values and first derivative is 0.75 to 1.3 times the rms of
        the stated standard deviations (white noise, signals without kinks). The stated one is too small, by
        up to two and a half times, for the derivative of a signal whose derivative jumps (that of the order-2 spline
        is right). It is also too small within about two periods of the cut-off from either end if the second
        derivative is not small there, because the series assumes that it is zero.

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
            "Use smooth_spline, which interpolates over missing samples, or another segment."
        )
    series = _Series(values, dt)
    noise = noise_level(values, dt)
    for _ in range(_ROUNDS):
        risks = {m: series.least_risk(noise, m) for m in ORDERS}
        chosen = 3
        best = min(risks, key=lambda m: risks[m][0])
        if risks[best][0] < (1.0 - _GAIN) * risks[chosen][0]:
            chosen = best
        noise = series.noise_above(_CLEAR * risks[chosen][1], risks[chosen][1], chosen, noise)
    return series.smoothed(risks[chosen][1], chosen, noise)


class _Series:
    """Orthonormal sine series of one record and of its linear trend; white noise has white coefficients.

    Attributes
    ----------
    d : (n - 2,) array
        Coefficients of the interior samples.
    X : (n - 2, 2) array
        Coefficients of a trend that is one at the first sample and zero at the last, and of the reverse.
    """

    def __init__(self, x: Array, dt: float):
        self.n = x.size
        self.length = float((self.n - 1) * dt)
        self.ends = x[[0, -1]]
        rise = np.arange(self.n) / (self.n - 1)
        self.line = np.column_stack([1.0 - rise, rise])
        self.d = scipy.fft.dst(x[1:-1], type=1, norm="ortho")
        self.X = scipy.fft.dst(self.line[1:-1], type=1, norm="ortho", axis=0)
        self.k = np.arange(1.0, self.n - 1)

    def _passed(self, k_c: float, order: int) -> Array:
        return 1.0 / (1.0 + (self.k / k_c) ** (2 * order))

    def _line(self, passed: Array) -> tuple[Array, Array, Array]:
        """Ends of the trend, the coefficients without it, and the normal matrix (noise variance one)."""
        # Signal and noise together have variance noise^2 / (1 - passed) in a coefficient.
        weight = 1.0 - passed
        normal = (self.X * weight[:, None]).T @ self.X + np.eye(2)
        ends = np.linalg.solve(normal, self.X.T @ (weight * self.d) + self.ends)
        return ends, self.d - self.X @ ends, normal

    def risk(self, k_c: float, order: int, noise: float) -> float:
        """Expected sum of squared errors, up to a constant."""
        passed = self._passed(k_c, order)
        ends, rest, normal = self._line(passed)
        stopped = 1.0 - passed
        residual = np.sum((stopped * rest) ** 2) + np.sum((self.ends - ends) ** 2)
        by_line = np.linalg.solve(normal, (self.X * (stopped**2)[:, None]).T @ self.X + np.eye(2))
        degrees = passed.sum() + np.trace(by_line)
        return float(residual + noise**2 * (2.0 * degrees - self.n))

    def least_risk(self, noise: float, order: int) -> tuple[float, float]:
        """Least risk and its cut-off k_c."""
        grid = np.linspace(np.log(1.0), np.log(3.0 * self.n), _SERIES_CUTOFFS)
        at = int(np.argmin([self.risk(float(np.exp(g)), order, noise) for g in grid]))
        bounds = grid[max(at - 1, 0)], grid[min(at + 1, _SERIES_CUTOFFS - 1)]
        found = scipy.optimize.minimize_scalar(
            lambda g: self.risk(float(np.exp(g)), order, noise), bounds=bounds, method="bounded"
        )
        return float(found.fun), float(np.exp(found.x))

    def noise_above(self, lowest: float, k_c: float, order: int, otherwise: float) -> float:
        """Noise from the coefficients above `lowest`, or `otherwise` if these are too few."""
        _, rest, _ = self._line(self._passed(k_c, order))
        beyond = rest[self.k > lowest]
        return float(np.sqrt(np.median(beyond**2) / MEDIAN_SQUARE)) if beyond.size > 0.2 * self.n else otherwise

    def smoothed(self, k_c: float, order: int, noise: float) -> SmoothedSignal:
        passed = self._passed(k_c, order)
        ends, rest, normal = self._line(passed)
        w = np.pi * self.k / self.length
        # Effect of an error of one end at each sample: its trend minus the part that the filter passes as signal.
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
        made[1:-1] = scipy.fft.dst(a, type=1, norm="ortho", axis=0)
        return made

    def _cosines(self, a: Array) -> Array:
        padded = np.zeros((self.n, *a.shape[1:]))
        padded[1:-1] = a
        return scipy.fft.dct(padded, type=1, axis=0) / np.sqrt(2.0 * (self.n - 1))

    def _double(self, a: Array, sign: float) -> Array:
        """sum_k a_k (2/N) cos^2(pi k j / N) for sign 1, sin^2 for -1."""
        doubled = scipy.fft.fft(np.concatenate(([0.0], a))).real
        return (a.sum() + sign * np.append(doubled, doubled[0])) / (self.n - 1)


# ---------------------------------------------------------------- cosine spectrum


def spectrum(x: Array, bins: int, edge: int = 0) -> Array:
    """Mean level and first cosine coefficients of each column, tapered at both ends.

    The orthonormal cosine transform (type II) of a stationary process has nearly independent coefficients whose
    variances are its two-sided spectrum, and no leakage from a step between its ends; a relation that holds sample by
    sample holds coefficient by coefficient. The taper is needed for differentiated signals, where the noise of the
    first and the last sample would enter every coefficient. A tapered constant would leak into the coefficients:
    it is removed, and is the first entry of the result.

    Parameters
    ----------
    x : (n,) or (n, k) array
    bins : int
        Coefficient j has the frequency j / (2 `fast_length(n)` dt).
    edge : int
        Samples over which each end is tapered.

    Returns
    -------
    (1 + bins,) or (1 + bins, k) array
        The level (times the root of the weighted number of samples) and coefficients 1 to `bins`; each column is
        contiguous in memory.
    """
    n = fast_length(len(x))
    weight = taper(n, edge)
    # Columns contiguous in memory: the transform of interleaved columns takes longer.
    tapered = np.multiply(np.asarray(x, dtype=float)[:n].T, weight, order="C")
    level = tapered @ weight / (weight @ weight)
    coefficients = scipy.fft.dct(tapered, norm="ortho", overwrite_x=True)[..., : bins + 1]
    coefficients = coefficients - np.multiply.outer(level, _constant_coefficients(n, edge)[: bins + 1])
    coefficients[..., 0] = level * np.sqrt(weight @ weight)
    return np.asarray(coefficients.T)


@lru_cache(maxsize=256)
def _constant_coefficients(n: int, edge: int) -> Array:
    """(n,) coefficients of a tapered constant; not to be written to."""
    return np.asarray(scipy.fft.dct(taper(n, edge), norm="ortho"))


@lru_cache(maxsize=256)
def fast_length(n: int) -> int:
    """Number of samples that a spectrum of n samples uses: it leaves out a few at the end for a fast transform."""
    return int(scipy.fft.prev_fast_len(n, real=True))


@lru_cache(maxsize=256)
def taper(n: int, edge: int) -> Array:
    """(n,) weights that rise from 0 to 1 over `edge` samples and fall again (cosine squared); not to be written to."""
    weight = np.ones(n)
    if edge > 0:
        rise = np.sin(0.5 * np.pi * (np.arange(edge) + 0.5) / edge) ** 2
        weight[:edge] = rise
        weight[n - edge :] = rise[::-1]
    weight.setflags(write=False)
    return weight
