"""HFB-320 Hansa Jet, and the Citation II of [H17]."""

from __future__ import annotations

import math

from structsel.aircraft import Aircraft
from structsel.model import AeroModel

_HFB_TERMS = {
    "CD": {"1": 0.1226, "V_ratio": -0.0645, "alpha": 0.3200},
    "CL": {"1": -0.0929, "V_ratio": 0.1489, "alpha": 4.3278},
    "Cm": {"1": 0.1119, "V_ratio": 0.0039, "alpha": -0.9678, "q_ratio": -34.707, "de": -1.5294},
}
# Published with q cbar/V as it is usual at Delft; our q_hat has the 2 in it.
_CITATION_TERMS = {
    "CX": {"1": -0.051, "alpha": 0.862, "q_hat": 2 * -4.465, "de": -0.172},
    "CY": {"1": 0.004, "beta": -0.794, "beta^2": 2.754, "p_hat": -0.159, "r_hat": 1.958, "da": -0.180, "dr": 0.839},
    "CZ": {"1": -0.213, "alpha": -4.037, "q_hat": 2 * -57.77, "de": -0.836},
    "Cl": {"1": -0.002, "beta": -0.073, "p_hat": -0.494, "r_hat": 0.376, "da": -0.178, "dr": 0.102},
    "Cm": {"1": 0.021, "alpha": -0.488, "q_hat": 2 * -11.935, "de": -1.250},
    "Cn": {"1": 0.000, "beta": 0.079, "p_hat": -0.142, "r_hat": -0.295, "da": -0.025, "dr": -0.065},
}
HFB_V0, HFB_RHO = 104.67, 0.792
HFB_RATE = f"q*1.215/{HFB_V0}"
"""Pitch rate over V0 and half the chord, as the published estimates have it."""


def hfb320_model() -> AeroModel:
    """Longitudinal aerodynamics of the HFB-320, wind axes: published output-error estimates."""
    return AeroModel.from_terms(_HFB_TERMS, "HFB-320", method="published")


def hfb320_aircraft() -> Aircraft:
    """Constants of the HFB-320.

    S and mass give the published S/m, and with Iy the published S cbar / Iy; the arm of the thrust gives the
    published pitching moment of -7.0153e-6 Iy per newton. Ix and Iz are not published: those here serve only to make
    a body of it, since the longitudinal motion does not use them.
    """
    mass, chord, inclination = 7472.0, 2.43, 0.0524
    S = 4.028e-3 * mass
    Iy = S * chord / 8.0027e-4
    return Aircraft(
        name="HFB-320",
        mass=mass,
        S=S,
        b=14.5,
        cbar=chord,
        V0=HFB_V0,
        inertia={"Ix": 0.5 * Iy, "Iy": Iy, "Iz": 1.4 * Iy},
        thrust={"offset": (0.0, 0.0, -7.0153e-6 * Iy / math.cos(inclination)), "inclination": inclination},
    )


def citation_model() -> AeroModel:
    """Aerodynamics of the Citation II: means of [H17] over its manoeuvres."""
    return AeroModel.from_terms(_CITATION_TERMS, "Citation II", method="published")


def citation_aircraft() -> Aircraft:
    """Constants of the Citation II."""
    return Aircraft(
        name="Citation II",
        mass=4500.0,
        S=24.99,
        b=13.325,
        cbar=1.991,
        inertia={"Ix": 11187.8, "Iy": 22854.8, "Iz": 31974.8, "Ixz": 1930.1},
    )
