"""Standard atmosphere to 32 km, Dryden turbulence, discrete gusts and wind shear.

Gusts are velocities [m/s] and rotations [rad/s] of the air in body axes: u forward, v right, w down, p, q, r as the
aircraft's rates. A gust that the aircraft meets head on is negative in u, one that lifts it is negative in w.
"""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from structsel.errors import DomainError
from structsel.numerics.compiling import njit
from structsel.numerics.dynamic_elements import first_order_noise
from structsel.numerics.linear_systems import discretise_noise

G0 = 9.80665
"""Standard gravity, m/s^2."""
_R = 287.05287  # J/(kg K), the standard's own value
_KAPPA = 1.4
LOWEST, HIGHEST = -5000.0, 32_000.0
"""Altitudes the table covers, m."""
# Base of each layer: geopotential altitude m, temperature K, lapse rate K/m, pressure Pa.
_LAYERS = (
    (0.0, 288.15, -0.0065, 101_325.0),
    (11_000.0, 216.65, 0.0, 22_632.040),
    (20_000.0, 216.65, 0.001, 5_474.877),
)
FOOT = 0.3048
_LOW, _HIGH = 1000.0 * FOOT, 2000.0 * FOOT
_HIGH_SCALE = 1750.0 * FOOT


def standard_atmosphere(h: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Temperature, pressure, density and speed of sound of the standard atmosphere.

    Parameters
    ----------
    h : float or (n,) array [m]
        Geopotential altitude, up. (Geometric altitude is larger by h^2 / 6357 km: 16 m at 10 km.)

    Returns
    -------
    temperature : array [K]
    pressure : array [Pa]
    rho : array [kg/m^3]
    speed_of_sound : array [m/s]

    Raises
    ------
    DomainError
        Below -5 km or above 32 km, or where h is not a number; the message gives the first such sample.

    References
    ----------
    ISO 2533:1975.
    """
    h = np.asarray(h, dtype=float)
    outside = np.atleast_1d(~((h >= LOWEST) & (h <= HIGHEST)))
    if outside.any():
        i = int(np.argmax(outside))
        raise DomainError(
            f"standard_atmosphere needs h between {LOWEST:g} and {HIGHEST:g} m; "
            f"sample {i} has h = {np.atleast_1d(h)[i]:g} m.\n"
            "Check the unit and the sign of h (metres, up), or give rho."
        )
    temperature, pressure, rho, sound = _many(h.ravel()).reshape(4, *h.shape)
    return temperature, pressure, rho, sound


def speed_of_sound(temperature: ArrayLike) -> NDArray[np.float64]:
    """Speed of sound [m/s] at a temperature [K]."""
    return np.sqrt(_KAPPA * _R * np.asarray(temperature, dtype=float))


@njit(cache=True)
def standard_air(h, offset):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Temperature, pressure, density and speed of sound at one altitude, `offset` [K] warmer; nan outside the table."""
    if not (h >= LOWEST and h <= HIGHEST):
        return np.nan, np.nan, np.nan, np.nan
    h0, T0, lapse, p0 = _LAYERS[0]
    if h >= _LAYERS[2][0]:
        h0, T0, lapse, p0 = _LAYERS[2]
    elif h >= _LAYERS[1][0]:
        h0, T0, lapse, p0 = _LAYERS[1]
    temperature = T0 + lapse * (h - h0)
    if lapse == 0.0:  # the limit of the power law
        pressure = p0 * np.exp(-G0 * (h - h0) / (_R * T0))
    else:
        pressure = p0 * (temperature / T0) ** (-G0 / (lapse * _R))
    temperature += offset
    return temperature, pressure, pressure / (_R * temperature), np.sqrt(_KAPPA * _R * temperature)


@njit(cache=True)
def _many(h):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    out = np.empty((4, h.size))
    for i in range(h.size):
        out[0, i], out[1, i], out[2, i], out[3, i] = standard_air(h[i], 0.0)
    return out


def dryden_scales(h: float, W20: float, high: float | None = None) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Length scales and intensities of Dryden turbulence.

    Up to 1000 ft, with h in feet::

        L_w = h    L_u = L_v = h / (0.177 + 0.000823 h)^1.2    sigma_w = 0.1 W20
        sigma_u = sigma_v = sigma_w / (0.177 + 0.000823 h)^0.4

    Above 2000 ft all lengths are 1750 ft and all intensities `high`; between, both are linear in h.

    Parameters
    ----------
    h : float [m]
        Height above ground; below 10 ft that of 10 ft is taken, where the formulas end.
    W20 : float [m/s]
        Wind at 20 ft: 7.7 is light, 15.4 moderate, 23.2 severe turbulence.
    high : float, optional [m/s]
        Intensity above 2000 ft; by default that at 1000 ft along w, 0.1 W20.

    Returns
    -------
    lengths, intensities : (3,) arrays [m, m/s]
        Of u, v, w.

    Raises
    ------
    DomainError
        A negative intensity.

    References
    ----------
    [MIL8785]; [MIL1797] writes the lengths of v and w as half of these and uses twice them, which is the same.
    """
    high = 0.1 * W20 if high is None else high
    if not (W20 >= 0.0 and high >= 0.0):
        raise DomainError(f"Turbulence needs intensities of 0 or more; W20 is {W20:g} m/s, high {high:g} m/s.")
    feet = min(max(h, 10.0 * FOOT), _LOW) / FOOT
    shape = 0.177 + 0.000823 * feet
    across = feet * FOOT / shape**1.2
    lengths = np.array([across, across, feet * FOOT])
    sigma = 0.1 * W20
    sigmas = np.array([sigma / shape**0.4, sigma / shape**0.4, sigma])
    part = min(max((h - _LOW) / (_HIGH - _LOW), 0.0), 1.0)
    return lengths + part * (_HIGH_SCALE - lengths), sigmas + part * (high - sigmas)


def dryden_spectra(omega: ArrayLike, V: float, b: float, lengths: ArrayLike, sigmas: ArrayLike) -> NDArray[np.float64]:
    """One-sided power spectra of u, v, w, p, q, r: the integral over omega from zero up is the variance::

        u: s^2 (2 L/pi V) / (1 + (L w/V)^2)            v, w: s^2 (L/pi V) (1 + 3 (L w/V)^2) / (1 + (L w/V)^2)^2
        p: (sw^2/V Lw) 0.8 (pi Lw/4b)^(1/3) / (1 + (4 b w/pi V)^2)
        q: (w/V)^2 / (1 + (4 b w/pi V)^2) Phi_w        r: (w/V)^2 / (1 + (3 b w/pi V)^2) Phi_v

    Parameters
    ----------
    omega : (k,) array [rad/s]
    V : float [m/s]
    b : float [m]
        Span.
    lengths, sigmas : (3,) arrays [m, m/s]
        As `dryden_scales` gives them.

    Returns
    -------
    (k, 6) array [(m/s)^2 s/rad or (rad/s)^2 s/rad]

    References
    ----------
    [MIL8785]
    """
    w = np.asarray(omega, dtype=float)
    L, s = np.asarray(lengths, dtype=float), np.asarray(sigmas, dtype=float)
    reduced = [(length * w / V) ** 2 for length in L]
    out = np.empty((w.size, 6))
    out[:, 0] = s[0] ** 2 * 2.0 * L[0] / (math.pi * V) / (1.0 + reduced[0])
    for j in (1, 2):
        out[:, j] = s[j] ** 2 * L[j] / (math.pi * V) * (1.0 + 3.0 * reduced[j]) / (1.0 + reduced[j]) ** 2
    roll = 0.8 * s[2] ** 2 / (V * L[2]) * (math.pi * L[2] / (4.0 * b)) ** (1.0 / 3.0)
    out[:, 3] = roll / (1.0 + (4.0 * b * w / (math.pi * V)) ** 2)
    out[:, 4] = (w / V) ** 2 / (1.0 + (4.0 * b * w / (math.pi * V)) ** 2) * out[:, 2]
    out[:, 5] = (w / V) ** 2 / (1.0 + (3.0 * b * w / (math.pi * V)) ** 2) * out[:, 1]
    return out


def dryden_gusts(
    t: ArrayLike, V: float, b: float, lengths: ArrayLike, sigmas: ArrayLike, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Turbulence along a flight of constant airspeed, with the spectra of `dryden_spectra`, stationary from the start.

    White noise through the forming filters, exact from sample to sample. The rates are those of a frozen field:
    q = -(dw/dt)/V and r = (dv/dt)/V, each after the lag of the span; p has an independent noise.

    Parameters
    ----------
    t : (n,) array [s]
        An even clock.
    V : float [m/s]
    b : float [m]
    lengths, sigmas : (3,) arrays [m, m/s]
    rng : numpy Generator

    Returns
    -------
    (n, 6) array
        u, v, w [m/s], p, q, r [rad/s].

    Raises
    ------
    DomainError
        V not above zero, or an uneven clock.
    """
    t = np.asarray(t, dtype=float)
    if not V > 0.0:
        raise DomainError(f"Turbulence needs an airspeed above zero; it is {V:g} m/s.")
    dt = float((t[-1] - t[0]) / (len(t) - 1))
    if np.abs(np.diff(t) - dt).max() > 1e-3 * dt:
        raise DomainError("Turbulence needs an even clock; this one's steps differ. Resample the inputs.")
    L, s = np.asarray(lengths, dtype=float), np.asarray(sigmas, dtype=float)
    lag = np.array([4.0, 4.0, 3.0]) * b / (math.pi * V)  # of p, q, r
    out = np.empty((len(t), 6))
    out[:, 0] = s[0] * _first_order(L[0] / V, dt, len(t), rng)
    roll = s[2] * math.sqrt(0.4 * math.pi / (L[2] * V) * (math.pi * L[2] / (4.0 * b)) ** (1.0 / 3.0) / lag[0])
    out[:, 3] = roll * _first_order(lag[0], dt, len(t), rng)
    for j, rate, sign in ((1, 5, 1.0), (2, 4, -1.0)):
        gust, slope = _transverse(L[j] / V, s[j], lag[rate - 3], dt, len(t), rng)
        out[:, j], out[:, rate] = gust, sign * slope / V
    return out


def one_minus_cosine(t: ArrayLike, start: float, duration: float, size: float) -> NDArray[np.float64]:
    """Discrete gust (size / 2)(1 - cos(2 pi (t - start)/duration)) from start to start + duration, else zero.

    Parameters
    ----------
    t : (n,) array [s]
    start, duration : float [s]
    size : float [m/s]

    Returns
    -------
    (n,) array [m/s]

    Raises
    ------
    DomainError
        A duration that is not above zero.

    References
    ----------
    [MIL8785]
    """
    if not duration > 0.0:
        raise DomainError(f"A gust needs a duration above zero; it is {duration:g} s.")
    part = (np.asarray(t, dtype=float) - start) / duration
    return np.where((part > 0.0) & (part < 1.0), 0.5 * size * (1.0 - np.cos(2.0 * math.pi * part)), 0.0)


def power_law(h: ArrayLike, speed: float, reference: float) -> NDArray[np.float64]:
    """Wind speed [m/s] at heights above ground [m]: speed (h / reference)^(1/7); zero at the ground."""
    return speed * (np.maximum(np.asarray(h, dtype=float), 0.0) / reference) ** (1.0 / 7.0)


def log_law(h: ArrayLike, speed: float, reference: float, roughness: float = 0.15 * FOOT) -> NDArray[np.float64]:
    """Wind speed [m/s] at heights above ground [m]: speed ln(h/z0)/ln(reference/z0); zero up to z0.

    References
    ----------
    [MIL8785], whose z0 is 0.15 ft for terminal flight and 2 ft otherwise.
    """
    return speed * np.log(np.maximum(np.asarray(h, dtype=float) / roughness, 1.0)) / math.log(reference / roughness)


def _first_order(lag: float, dt: float, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """Noise of unit variance and a time constant."""
    white = rng.standard_normal(n + 1)
    white[1] = white[0]
    return first_order_noise(white[1:], dt / lag)


def _transverse(
    T: float, sigma: float, lag: float, dt: float, n: int, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gust of spectrum (1 + 3 (T w)^2)/(1 + (T w)^2)^2, and its derivative after a first-order lag.

    States: the two of the forming filter in units of sigma, and the gust after the lag. The lagged derivative is the
    difference of gust and lagged gust over the time constant.
    """
    k = math.sqrt(1.0 / T)
    # The filter is sqrt(T)/(1 + T s) (sqrt(3) + (1 - sqrt(3))/(1 + T s)); the first state is the gust.
    A = np.array([[-1.0 / T, (1.0 - math.sqrt(3.0)) / T, 0.0], [0.0, -1.0 / T, 0.0], [1.0 / lag, 0.0, -1.0 / lag]])
    noise = np.array([k * math.sqrt(3.0), k, 0.0])
    step, gathered = (a[0] for a in discretise_noise(A[None], np.outer(noise, noise)[None], dt))
    steady = scipy.linalg.solve_continuous_lyapunov(A, -np.outer(noise, noise))
    start = _root(steady) @ rng.standard_normal(3)
    x = _march(step, _root(gathered), start, rng.standard_normal((n, 3)))
    return sigma * x[:, 0], sigma * (x[:, 0] - x[:, 2]) / lag


def _root(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Square root of a covariance that may be singular."""
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    return vectors * np.sqrt(np.maximum(values, 0.0))


@njit(cache=True)
def _march(A, root, start, white):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """States x[k] = A x[k-1] + root white[k] from a start; the first noise is not used."""
    out = np.empty((white.shape[0], start.size))
    out[0] = start
    for k in range(1, white.shape[0]):
        for i in range(start.size):
            total = 0.0
            for j in range(start.size):
                total += A[i, j] * out[k - 1, j] + root[i, j] * white[k, j]
            out[k, i] = total
    return out
