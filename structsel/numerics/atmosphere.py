"""International Standard Atmosphere from below sea level to 32 km."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from structsel.errors import DomainError

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


def standard_atmosphere(h: ArrayLike, offset: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Temperature, pressure, density and speed of sound of the standard atmosphere.

    Parameters
    ----------
    h : float or (n,) array [m]
        Geopotential altitude, up. (Geometric altitude is larger by h^2 / 6357 km: 16 m at 10 km.)
    offset : float [K]
        The air is warmer than standard by this at the same pressure altitude.

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
    temperature, pressure, rho, sound = _many(h.ravel(), offset).reshape(4, *h.shape)
    return temperature, pressure, rho, sound


@njit(cache=True)
def standard_air(h, offset):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Temperature, pressure, density and speed of sound at one altitude; nan outside the table."""
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
def _many(h, offset):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    out = np.empty((4, h.size))
    for i in range(h.size):
        out[0, i], out[1, i], out[2, i], out[3, i] = standard_air(h[i], offset)
    return out
