"""International Standard Atmosphere from below sea level to 32 km."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from structsel.errors import DomainError

G0 = 9.80665
"""Standard gravity, m/s^2."""
_R = 287.05287  # J/(kg K), the standard's own value
_KAPPA = 1.4
_LOWEST, _HIGHEST = -5000.0, 32_000.0
# Base of each layer: geopotential altitude m, temperature K, lapse rate K/m, pressure Pa.
_LAYERS = (
    (0.0, 288.15, -0.0065, 101_325.0),
    (11_000.0, 216.65, 0.0, 22_632.040),
    (20_000.0, 216.65, 0.001, 5_474.877),
)


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
    outside = np.atleast_1d(~((h >= _LOWEST) & (h <= _HIGHEST)))
    if outside.any():
        i = int(np.argmax(outside))
        raise DomainError(
            f"standard_atmosphere needs h between {_LOWEST:g} and {_HIGHEST:g} m; "
            f"sample {i} has h = {np.atleast_1d(h)[i]:g} m.\n"
            "Check the unit and the sign of h (metres, up), or give rho."
        )
    layer = np.clip(np.searchsorted([base[0] for base in _LAYERS], h, side="right") - 1, 0, None)
    h0, T0, lapse, p0 = (np.array(column)[layer] for column in zip(*_LAYERS))
    temperature = T0 + lapse * (h - h0)
    # Isothermal layers take the limit of the power law.
    safe = np.where(lapse == 0.0, 1.0, lapse)
    power = np.where(
        lapse == 0.0,
        np.exp(-G0 * (h - h0) / (_R * T0)),
        (temperature / T0) ** (-G0 / (safe * _R)),
    )
    pressure = p0 * power
    return temperature, pressure, pressure / (_R * temperature), np.sqrt(_KAPPA * _R * temperature)
