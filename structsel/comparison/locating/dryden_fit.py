"""Dryden spectra fitted to the power of one gust component in bands of frequency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from structsel.numerics.arrays import Array
from structsel.numerics.atmosphere import dryden_spectra

_BETWEEN_FLIGHTS = 0.7  # standard deviation of the logarithm of the power
_FROM_NOISE = 1.0  # standard deviation of the logarithm of the noise about what the readings show


@dataclass(frozen=True)
class PowerBands:
    """Power spectrum [unit^2/Hz], one-sided, of one axis in bands, all flights."""

    f: Array
    V: Array
    flight: Array
    count: Array
    power: Array
    floor: float
    input_fraction: float


@dataclass(frozen=True)
class DrydenFit:
    """A fit: minus log likelihood, size of the gust [m/s], and its spectrum and that of all parts in each band."""

    cost: float
    sigma: float
    air: Array
    total: Array


def fraction_of_air(b: PowerBands, fit: DrydenFit) -> float:
    """Fraction of the variance of a vane's readings that is moving air; the bands are of its rate."""
    weight = b.count / b.f**2
    return float(weight @ fit.air / (weight @ fit.total))


def fit_spectrum(b: PowerBands, axis: str, length: float | None, tau: float | None) -> DrydenFit:
    """Likeliest spectrum: noise, and air of one scale, or noise that keeps for one time, or neither.

    The noise of a vane is that of an angle: in metres per second it grows with the speed, from flight to flight.
    """
    omega = 2.0 * np.pi * b.f
    white = omega**2
    noise = white if axis == "u" else white * (b.V / b.V.mean()) ** 2
    if length is not None:
        shape = np.empty(len(omega))
        for V in np.unique(b.V):
            mine = b.V == V
            shape[mine] = _dryden(omega[mine], V, length, axis)
        shape *= white
    elif tau is not None:
        shape = 4.0 * tau / (1.0 + (omega * tau) ** 2) * noise
    else:
        shape = np.zeros(len(b.f))
    high, middle = b.f > 0.6 * b.f.max(), b.f < 0.5 * b.f.max()
    start = float(np.average(b.power[high] / noise[high], weights=b.count[high]))
    size = float(np.median(b.power[middle] / np.where(shape[middle] > 0.0, shape[middle], 1.0)))
    floor = np.full(len(b.f), b.floor)
    flights = int(b.flight.max()) + 1
    spread = np.array([0.0, _FROM_NOISE, 0.0] + [_BETWEEN_FLIGHTS] * flights)
    held = np.divide(1.0, spread, out=np.zeros(len(spread)), where=spread > 0.0) ** 2

    def parts(x: Array) -> tuple[Array, Array, Array]:
        return np.exp(x[0]) * noise, np.exp(x[1]) * floor, np.exp(x[2] + x[3:][b.flight]) * shape

    def cost(x: Array) -> tuple[float, Array]:
        own, rates, air = parts(x)
        S = own + rates + air
        slope = 0.5 * b.count * (1.0 / S - b.power / S**2)
        each = np.bincount(b.flight, slope * air, flights)
        gradient = np.concatenate([[slope @ own, slope @ rates, slope @ air], each]) + held * x_about(x)
        return float(0.5 * (b.count @ (np.log(S) + b.power / S))) + 0.5 * float(held @ x_about(x) ** 2), gradient

    def x_about(x: Array) -> Array:
        return np.concatenate([[0.0], x[1:2], [0.0], x[3:]])

    x = np.array([np.log(start), 0.0, np.log(size), *np.zeros(flights)])
    bounds = [(x[0] - 9.0, x[0] + 3.0), (-4.0, 4.0), (x[2] - 12.0, x[2] + 5.0), *[(-3.0, 3.0)] * flights]
    found = scipy.optimize.minimize(cost, x, jac=True, method="L-BFGS-B", bounds=bounds)
    sigma = float(np.sqrt(np.mean(np.exp(found.x[2] + found.x[3:])))) if length else 0.0
    each = parts(found.x)
    return DrydenFit(float(found.fun), sigma, each[2], np.sum(each, axis=0))


def _dryden(omega: Array, V: float, length: float, axis: str) -> Array:
    """One-sided spectrum [(m/s)^2/Hz] of a gust of 1 m/s."""
    spectra = dryden_spectra(omega, V, 1.0, np.full(3, length), np.ones(3))
    return 2.0 * np.pi * spectra[:, "uvw".index(axis)]


def dispersion(b: PowerBands, total: Array) -> float:
    """Scatter of the bands about a spectrum, over that expected."""
    return float(np.mean(0.5 * b.count * (b.power / total - 1.0) ** 2))


def largest_peak(b: PowerBands, total: Array) -> float:
    """Largest ratio of power to the fitted spectrum at one frequency, over all flights."""
    ratios = []
    for f in np.unique(np.round(np.log(b.f), 1)):
        near = np.abs(np.log(b.f) - f) < 0.08
        ratios.append(float(b.count[near] @ (b.power[near] / total[near]) / b.count[near].sum()))
    return max(ratios)
