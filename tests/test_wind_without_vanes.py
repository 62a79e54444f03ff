"""Steady wind of a small unmanned aircraft without vanes: airspeed, attitude, inertial readings, satellite velocity."""

import numpy as np
import pytest

from structsel.aircraft import Aircraft
from structsel.reconstruction import reconstruct
from structsel.recording import Recording

G = 9.80665
DT = 0.04
WIND = {"wn": 4.0, "we": -3.0}
NOISE = {
    **dict.fromkeys(("ax", "ay", "az"), 0.05),
    **dict.fromkeys(("p", "q", "r"), 2e-3),
    **dict.fromkeys(("phi", "theta", "psi"), 5e-3),
    **{"V": 0.3, "h": 0.5, "vn": 0.1, "ve": 0.1, "vd": 0.1},
}


def small_aircraft():
    return Aircraft.from_dict({"name": "uav", "mass": 3.0, "S": 0.5, "b": 1.6, "cbar": 0.3})


def flight(turning, seconds=50.0, seed=1):
    """Log of level flight at 18 m/s with changes of speed and pitch; or of turns with 25 deg of bank."""
    t = np.arange(0.0, seconds, DT)
    phi = turning * (0.45 * np.sin(2.0 * np.pi * t / seconds) + 0.01 * np.sin(1.3 * t))
    theta = 0.06 + 0.02 * np.sin(0.9 * t)
    psi = 0.7 + np.concatenate([[0.0], np.cumsum(0.5 * DT * (np.tan(phi[1:]) + np.tan(phi[:-1])) * G / 18.0)])
    u, v, w = 18.0 + 0.5 * np.sin(0.5 * t), 0.2 * turning * np.sin(0.8 * t), 1.1 + 0.2 * np.sin(0.9 * t)
    du, dv, dw, dphi, dtheta, dpsi = (np.gradient(x, DT, edge_order=2) for x in (u, v, w, phi, theta, psi))
    sf, cf, st, ct, sp, cp = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta), np.sin(psi), np.cos(psi)
    p, q, r = dphi - dpsi * st, dtheta * cf + dpsi * sf * ct, dpsi * cf * ct - dtheta * sf
    along, across = u * ct + (v * sf + w * cf) * st, v * cf - w * sf
    channels = {
        "ax": du + G * st + q * w - r * v, "ay": dv - G * ct * sf + r * u - p * w,
        "az": dw - G * ct * cf + p * v - q * u,
        "p": p, "q": q, "r": r, "phi": phi, "theta": theta, "psi": psi, "V": np.sqrt(u * u + v * v + w * w),
        "vn": along * cp - across * sp + WIND["wn"], "ve": along * sp + across * cp + WIND["we"],
        "vd": -u * st + (v * sf + w * cf) * ct,
    }  # fmt: skip
    channels["h"] = 100.0 + np.concatenate([[0.0], -np.cumsum(0.5 * DT * (channels["vd"][1:] + channels["vd"][:-1]))])
    rng = np.random.default_rng(seed)
    return Recording("uav", t, {name: x + NOISE[name] * rng.standard_normal(t.size) for name, x in channels.items()})


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow), pytest.param(3, marks=pytest.mark.slow)])
def test_turns_determine_the_wind(seed):
    found = reconstruct(flight(True, seed=seed), small_aircraft())
    for name, value in WIND.items():
        assert abs(found[name].value - value) < 3.0 * found[name].std < 2.0, found[name]
    assert found.trusted, found.distrust


def test_straight_flight_does_not_determine_the_wind_and_says_so():
    # The noise of the gyros is no turn: a constant heading separates no steady sideslip from a crosswind.
    found = reconstruct(flight(False), small_aircraft())
    assert {"wn", "we"} <= set(found.fixed)
    assert "turn through all headings" in found.fixed["wn"]
    # The ground velocity is then not used: with a wrong wind it would be a wrong motion through the air.
    assert not {"vn", "ve"} & set(found.residuals)
