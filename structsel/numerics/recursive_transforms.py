"""Finite Fourier transforms that grow sample by sample, and equation error on them. Arrays only.

Sample n adds x_n exp(-i w t_n) to a transform; a forgetting factor L weights the sample of k steps ago with L^k::

    x~(w) = dt sum_k L^k x_(n-k) exp(-i w t_(n-k)),      first and last sample half (trapezoidal rule)

The linear trend of the weighted samples is removed, from sums that grow in the same manner. With L = 1 the result is
that of `structsel.numerics.spectra.transform` on all samples.

References
----------
[M00], [KM16].
"""

from __future__ import annotations

import numpy as np

from structsel.errors import DataError
from structsel.numerics.frequency_regression import FrequencyFit, regress_transforms


class RecursiveTransforms:
    """Transforms of c signals at f frequencies [Hz], and what their detrending and their noise need.

    Sums over samples, with the age s = t_n - t of each: `transforms` of the signals, `lines` of 1 and s, `products` of
    signals and lines, `line_products` of the lines; with squared weights `gram`, `crossed` and `squared` of the
    phasors and lines, for the covariance of white noise.
    """

    def __init__(self, signals: int, frequencies: np.ndarray, dt: float, forgetting: float = 1.0) -> None:
        f = len(frequencies)
        self.omega, self.dt, self.forgetting = 2.0 * np.pi * np.asarray(frequencies, dtype=float), dt, forgetting
        self.count, self.t = 0, 0.0
        self.first, self.last = np.zeros(signals), np.zeros(signals)
        self.transforms, self.lines = np.zeros((f, signals), dtype=complex), np.zeros((f, 2), dtype=complex)
        self.products, self.line_products = np.zeros((2, signals)), np.zeros((2, 2))
        self.gram, self.crossed, self.squared = np.zeros((2 * f, 2 * f)), np.zeros((2, 2 * f)), np.zeros((2, 2))

    def add(self, x: np.ndarray) -> None:
        """Add one sample (c,), one interval after the last."""
        if self.count:
            self.t += self.dt
            self._age()
        else:
            self.first = x.copy()
        phasor = np.exp(-1j * self.omega * self.t)
        parts = np.concatenate([phasor.real, phasor.imag])
        self.transforms += phasor[:, None] * x
        self.lines[:, 0] += phasor  # the newest sample has the age zero
        self.products[0] += x
        self.line_products[0, 0] += 1.0
        self.gram += np.outer(parts, parts)
        self.crossed[0] += parts
        self.squared[0, 0] += 1.0
        self.last, self.count = x.copy(), self.count + 1

    def _age(self) -> None:
        """Make all sums one interval older, and forget."""
        shift = np.array([[1.0, 0.0], [self.dt, 1.0]])  # of (1, s)
        self.transforms *= self.forgetting
        self.lines = self.forgetting * self.lines @ shift.T
        self.products = self.forgetting * shift @ self.products
        self.line_products = self.forgetting * shift @ self.line_products @ shift.T
        self.gram *= self.forgetting**2
        self.crossed = self.forgetting**2 * shift @ self.crossed
        self.squared = self.forgetting**2 * shift @ self.squared @ shift.T

    def _ends(self) -> tuple[np.ndarray, np.ndarray, float]:
        """Phasors of the newest and the oldest sample, and the weight of the oldest."""
        return np.exp(-1j * self.omega * self.t), np.ones(self.omega.size), self.forgetting ** (self.count - 1)

    def _trapezoidal(self) -> tuple[np.ndarray, np.ndarray]:
        """(f, c) transforms of the signals and (f, 2) of the lines, first and last sample half."""
        new, old, weight = self._ends()
        halves = 0.5 * (new[:, None] * self.last + weight * old[:, None] * self.first)
        lines = self.lines - 0.5 * np.outer(new, [1.0, 0.0]) - 0.5 * weight * np.outer(old, [1.0, self.t])
        return self.dt * (self.transforms - halves), self.dt * lines

    def detrended(self, derivative: int | None = None) -> np.ndarray:
        """(f, c) transforms of the detrended signals; that of signal `derivative` is that of its time derivative.

        By parts, with a = -ln L / dt and W the weight of the oldest sample::

            x'~ = (i w - a) x~ + x(T) exp(-i w T) - W x(0)
        """
        signals, lines = self._trapezoidal()
        products = self.products.copy()
        if derivative is not None:
            new, old, weight = self._ends()
            j, rate = derivative, -np.log(self.forgetting) / self.dt
            x0, xT, integral = self.first[j], self.last[j], self.products[:, j].copy()
            integral -= 0.5 * np.array([xT + weight * x0, weight * self.t * x0])
            integral *= self.dt  # of x and s x, weighted
            signals[:, j] = (1j * self.omega - rate) * signals[:, j] + xT * new - weight * x0 * old
            means = np.array([xT - weight * x0 - rate * integral[0],
                              -weight * self.t * x0 + integral[0] - rate * integral[1]])  # fmt: skip
            products[:, j] = means / self.dt
        return np.asarray(signals - lines @ np.linalg.solve(self.line_products, products))

    def noise(self) -> np.ndarray:
        """(2 f, 2 f) covariance of the parts of the detrended transform of white noise of variance one."""
        new, old, weight = self._ends()
        gram, crossed = self.gram.copy(), self.crossed.copy()
        for phasor, age, w in ((new, 0.0, 1.0), (old, self.t, weight)):
            parts = np.concatenate([phasor.real, phasor.imag])
            gram -= 0.75 * w**2 * np.outer(parts, parts)
            crossed -= 0.5 * w**2 * np.outer([1.0, age], parts)
        lines = self._trapezoidal()[1]
        C = np.vstack([lines.real, lines.imag]) @ np.linalg.inv(self.line_products)
        mixed = self.dt * C @ crossed
        return np.asarray(self.dt**2 * gram - mixed - mixed.T + C @ self.squared @ C.T)

    def regress(self, derivative: bool = False) -> FrequencyFit:
        """Equation error: the last signal, or its derivative, on the others.

        Raises
        ------
        DataError
            Too few samples, or regressors that depend on each other so far.
        """
        k = self.first.size - 1
        if self.count < max(2 * self.omega.size, k + 3):
            raise DataError(f"{self.count} samples are too few for {self.omega.size} frequencies.")
        found = self.detrended(k if derivative else None)
        return regress_transforms([found[:, :k]], [found[:, k]], self.noise())
