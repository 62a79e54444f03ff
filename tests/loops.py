"""Flights through the vertical whose attitude scipy integrates: a loop, and a roll in a vertical climb."""

import numpy as np
from scipy.integrate import cumulative_trapezoid, solve_ivp
from scipy.spatial.transform import Rotation

from structsel.aircraft import Aircraft
from structsel.recording import Recording

G = 9.80665
DT = 0.02
NOISE = {
    **dict.fromkeys(("ax", "ay", "az"), 0.03),
    **dict.fromkeys(("p", "q", "r"), 1e-3),
    **{"V": 0.2, "alpha": 2e-3, "beta": 2e-3, "h": 0.5},
    **dict.fromkeys(("phi", "theta", "psi"), 4e-3),
}
BIASES = {"bax": 0.1, "bay": -0.06, "baz": 0.08, "bp": 3e-3, "bq": -2e-3, "br": 2e-3}


def aircraft():
    """Instruments at the centre of gravity."""
    content = {"name": "aerobat", "mass": 800.0, "S": 12.0, "b": 8.0, "cbar": 1.5}
    content["inertia"] = {"Ix": 900.0, "Iy": 1200.0, "Iz": 2000.0, "Ixz": 0.0}
    content["sensors"] = {
        "accelerometer": {"noise": {n: NOISE[n] for n in ("ax", "ay", "az")}},
        "gyro": {"noise": {n: NOISE[n] for n in ("p", "q", "r")}},
        "vane": {"noise": {n: NOISE[n] for n in ("V", "alpha", "beta")}},
        "attitude": {"noise": {n: NOISE[n] for n in ("phi", "theta", "psi")}},
        "static": {"noise": {"h": NOISE["h"]}},
    }
    return Aircraft.from_dict(content)


def _pulse(t, first, last, edge=0.5):
    """One between two times, with smooth edges."""
    return 0.5 * (np.tanh((t - first) / edge) - np.tanh((t - last) / edge))


def rates(kind, t):
    """Body rates [rad/s]: a quarter of a turn in pitch needs pi / 2 of the integral of q."""
    wobble = np.array([0.15 * np.sin(1.7 * t), 0.06 * np.sin(2.3 * t), 0.05 * np.sin(1.1 * t)])
    if kind == "loop":
        # The whole turn takes 15 s; the wobble ends before it.
        return wobble * _pulse(t, 1.0, 6.0) + np.array([0.0 * t, 2.0 * np.pi / 15.0 * _pulse(t, 8.0, 23.0), 0.0 * t])
    climb = 0.5 * np.pi / 5.0
    pitch = climb * (_pulse(t, 8.0, 13.0) + _pulse(t, 21.0, 26.0))
    return wobble * _pulse(t, 1.0, 6.0) + np.array([1.5 * _pulse(t, 15.0, 19.0), pitch, 0.0 * t])


def truth(kind, seconds=32.0):
    """Time, attitude, body velocity, rates and specific force; the attitude by scipy's integrator of quaternions."""
    t = np.arange(0.0, seconds, DT)

    def slope(time, e):
        p, q, r = rates(kind, time)
        a, b, c, d = e
        return 0.5 * np.array(
            [-b * p - c * q - d * r, a * p + c * r - d * q, a * q - b * r + d * p, a * r + b * q - c * p]
        )

    found = solve_ivp(slope, (0.0, t[-1]), [1.0, 0.0, 0.0, 0.0], t_eval=t, method="DOP853", rtol=1e-11, atol=1e-12)
    attitude = Rotation.from_quat(found.y[[1, 2, 3, 0]].T)
    omega = rates(kind, t).T
    velocity = np.c_[70.0 + 4.0 * np.sin(0.4 * t), 2.0 * np.sin(1.3 * t), 4.0 + 2.0 * np.sin(0.9 * t)]
    change = np.c_[1.6 * np.cos(0.4 * t), 2.6 * np.cos(1.3 * t), 1.8 * np.cos(0.9 * t)]
    weight = attitude.inv().apply([0.0, 0.0, G])
    return t, attitude, velocity, omega, change + np.cross(omega, velocity) - weight


def recording(kind, seed=0, seconds=32.0):
    """Recording of such a flight with noise and biases, its attitude and its body velocity.

    The noise of the attitude turns the aircraft about its body axes, as that of an inertial platform.
    """
    rng = np.random.default_rng(seed)
    t, attitude, velocity, omega, force = truth(kind, seconds)
    u, v, w = velocity.T
    ground = attitude.apply(velocity)
    read = attitude * Rotation.from_rotvec(NOISE["phi"] * rng.standard_normal((len(t), 3)))
    psi, theta, phi = read.as_euler("ZYX").T
    channels = dict(zip(("ax", "ay", "az"), force.T)) | dict(zip(("p", "q", "r"), omega.T))
    channels |= {"V": np.sqrt(u * u + v * v + w * w), "alpha": np.arctan2(w, u)}
    channels["beta"] = np.arcsin(v / channels["V"])
    channels["h"] = 1500.0 - cumulative_trapezoid(ground[:, 2], t, initial=0.0)
    for name, bias in BIASES.items():
        channels[name[1:]] = channels[name[1:]] + bias
    channels = {name: x + NOISE[name] * rng.standard_normal(len(t)) for name, x in channels.items()}
    channels |= {"phi": phi, "theta": theta, "psi": psi}
    return Recording(kind, t, channels), attitude, velocity


def attitude_of(made):
    """Attitude of a recording."""
    return Rotation.from_euler("ZYX", np.c_[made["psi"], made["theta"], made["phi"]])
