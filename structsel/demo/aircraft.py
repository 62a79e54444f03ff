"""The truth of the demonstration flights: aerodynamic terms, and the aeroplane that carries them."""

from __future__ import annotations

import numpy as np

from structsel.aircraft import Aircraft
from structsel.numerics.air_data import nondimensional_rates

TRUTH: dict[str, dict[str, float]] = {
    "CX": {
        "1": -0.03554,
        "alpha": 0.002920,
        "alpha^2": 5.459,
        "alpha^3": -5.162,
        "q_hat": 2 * -0.6748,
        "dr": 0.03412,
    },
    "CY": {
        "1": -0.002226,
        "beta": -0.7678,
        "p_hat": -0.1240,
        "r_hat": 0.3666,
        "da": -0.02956,
        "dr": 0.1158,
        "alpha*dr": 0.5238,
    },
    "CZ": {
        "1": -0.05504,
        "alpha": -5.578,
        "alpha^3": 3.442,
        "q_hat": 2 * -2.988,
        "de": -0.3980,
        "beta^2*de": -15.93,
    },
    "Cl": {
        "1": 0.0005910,
        "beta": -0.06180,
        "p_hat": -0.5045,
        "r_hat": 0.1695,
        "da": -0.09917,
        "dr": 0.006934,
        "alpha*da": -0.08269,
    },
    "Cm": {
        "1": 0.09448,
        "alpha": -0.6028,
        "alpha^2": -2.140,
        "q_hat": 2 * -15.56,
        "de": -1.921,
        "beta^2": 0.6921,
        "r_hat": -0.3118,
    },
    "Cn": {
        "1": -0.003117,
        "beta": 0.006719,
        "p_hat": -0.1585,
        "r_hat": -0.1112,
        "da": -0.003872,
        "dr": -0.08265,
        "q_hat": 2 * 0.1595,
        "beta^3": 0.1373,
    },
}
"""Response -> term -> value. Beaver: Tjee and Mulder, Delft report LR-556, 1988."""

RESPONSES = tuple(TRUTH)
_TERMS = (
    *("1", "alpha", "alpha^2", "alpha^3", "beta", "beta^2", "beta^3", "p_hat", "q_hat", "r_hat"),
    *("de", "da", "dr", "alpha*da", "alpha*dr", "beta^2*de"),
)
_TABLE = np.array([[TRUTH[response].get(term, 0.0) for term in _TERMS] for response in RESPONSES])


def demo_aircraft() -> Aircraft:
    """Return the aeroplane of the demonstration flights."""
    return Aircraft(
        name="demonstration aeroplane (DHC-2 Beaver without slipstream)",
        mass=2288.231,
        S=23.23,
        b=14.63,
        cbar=1.5875,
        V0=45.0,
        inertia={"Ix": 5368.39, "Iy": 6928.93, "Iz": 11158.75, "Ixz": 117.64},
        thrust={"offset": (1.8, 0.0, -0.15), "inclination": 0.03},
        sensors={
            "accelerometer": {"position": (0.35, 0.0, 0.2)},
            "vane": {"position": (1.0, -4.5, 0.1)},
        },
    )


def aerodynamics(
    V: np.ndarray, alpha: np.ndarray, beta: np.ndarray, rates: np.ndarray, surfaces: np.ndarray, aircraft: Aircraft
) -> np.ndarray:
    """(6, m) coefficients CX to Cn of the truth."""
    p_hat, q_hat, r_hat = nondimensional_rates(V, rates[0], rates[1], rates[2], aircraft.b, aircraft.cbar)
    de, da, dr = surfaces
    b2 = beta * beta
    terms = (
        *(np.ones_like(V), alpha, alpha**2, alpha**3, beta, b2, b2 * beta, p_hat, q_hat, r_hat),
        *(de, da, dr, alpha * da, alpha * dr, b2 * de),
    )
    return _TABLE @ np.array(terms)
