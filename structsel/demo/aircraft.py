"""The truth of the demonstration flights: aerodynamic terms, and the aeroplane that carries them."""

from __future__ import annotations

import numpy as np

from structsel.aircraft import Aircraft
from structsel.numerics.air_data import nondimensional_rates
from structsel.simulation.library.beaver import BEAVER_TERMS, beaver_aircraft

_LEFT_OUT = ("df", "dpt", "beta_dot_hat")
TRUTH: dict[str, dict[str, float]] = {
    response: {term: value for term, value in terms.items() if not any(name in term for name in _LEFT_OUT)}
    for response, terms in BEAVER_TERMS.items()
}
"""Response -> term -> value: the Beaver without flaps, slipstream and sideslip rate."""

RESPONSES = tuple(TRUTH)
_TERMS = (
    *("1", "alpha", "alpha^2", "alpha^3", "beta", "beta^2", "beta^3", "p_hat", "q_hat", "r_hat"),
    *("de", "da", "dr", "alpha*da", "alpha*dr", "beta^2*de"),
)
_TABLE = np.array([[TRUTH[response].get(term, 0.0) for term in _TERMS] for response in RESPONSES])


def demo_aircraft() -> Aircraft:
    """Return the aeroplane of the demonstration flights."""
    return Aircraft.from_dict(
        beaver_aircraft().to_dict()
        | {
            "name": "demonstration aeroplane (DHC-2 Beaver without slipstream)",
            "V0": 45.0,
            "thrust": {"offset": (1.8, 0.0, -0.15), "inclination": 0.03},
            "sensors": {
                "accelerometer": {"position": (0.35, 0.0, 0.2)},
                "vane": {"position": (1.0, -4.5, 0.1)},
            },
        }
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
