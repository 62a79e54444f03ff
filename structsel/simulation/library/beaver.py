"""DHC-2 Beaver with its slipstream."""

from __future__ import annotations

from structsel.aircraft import Aircraft
from structsel.model import AeroModel

# Published with q cbar/V; our q_hat has the 2 in it, so its coefficients are twice those.
BEAVER_TERMS: dict[str, dict[str, float]] = {
    "CX": {
        "1": -0.03554, "alpha": 0.002920, "alpha^2": 5.459, "alpha^3": -5.162, "q_hat": 2 * -0.6748, "dr": 0.03412,
        "df": -0.09447, "alpha*df": 1.106, "dpt": 0.1161, "alpha*dpt^2": 0.1453,
    },
    "CY": {
        "1": -0.002226, "beta": -0.7678, "p_hat": -0.1240, "r_hat": 0.3666, "da": -0.02956, "dr": 0.1158,
        "alpha*dr": 0.5238, "beta_dot_hat": -0.1600,
    },
    "CZ": {
        "1": -0.05504, "alpha": -5.578, "alpha^3": 3.442, "q_hat": 2 * -2.988, "de": -0.3980, "beta^2*de": -15.93,
        "df": -1.377, "alpha*df": -1.261, "dpt": -0.1563,
    },
    "Cl": {
        "1": 0.0005910, "beta": -0.06180, "p_hat": -0.5045, "r_hat": 0.1695, "da": -0.09917, "dr": 0.006934,
        "alpha*da": -0.08269, "alpha^2*dpt": -0.01406,
    },
    "Cm": {
        "1": 0.09448, "alpha": -0.6028, "alpha^2": -2.140, "q_hat": 2 * -15.56, "de": -1.921, "beta^2": 0.6921,
        "r_hat": -0.3118, "df": 0.4072, "dpt": -0.07895,
    },
    "Cn": {
        "1": -0.003117, "beta": 0.006719, "p_hat": -0.1585, "r_hat": -0.1112, "da": -0.003872, "dr": -0.08265,
        "q_hat": 2 * 0.1595, "beta^3": 0.1373, "dpt^3": -0.003026,
    },
}  # fmt: skip
"""Response -> term -> value: Tjee and Mulder, Delft report LR-556, 1988."""
POWER = "0.7355*(-326.5 + 0.00412*(manifold_pressure + 7.4)*(rpm + 2010) + (408 - 0.0965*rpm)*(1 - rho/1.225))"
"""Engine power [kW] of the manifold pressure [inHg], the engine speed [rpm] and the density."""
SLIPSTREAM = "0.08696 + 191.18*power/(0.5*rho*V^3)"
"""Rise of total pressure in the slipstream, over the dynamic pressure, of the power [kW]."""


def beaver_model() -> AeroModel:
    """Aerodynamics of the Beaver; CX, CZ, ... hold the propulsion by the slipstream ``dpt``."""
    return AeroModel.from_terms(BEAVER_TERMS, "DHC-2 Beaver", method="published")


def beaver_aircraft() -> Aircraft:
    """Constants of the Beaver."""
    return Aircraft(
        name="DHC-2 Beaver",
        mass=2288.231,
        S=23.23,
        b=14.63,
        cbar=1.5875,
        inertia={"Ix": 5368.39, "Iy": 6928.93, "Iz": 11158.75, "Ixz": 117.64},
    )
