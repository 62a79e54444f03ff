"""Recordings of plants and vehicles beside simulations that state channels, not coefficients, and lack one effect."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from structsel.numerics.air_data import body_to_earth
from structsel.recording import Recording

UNITS = "?"


def wandering(rng, n, dt, time):
    """A random signal of unit variance that changes within some time [s]."""
    x = rng.standard_normal(n + 500)
    a = np.exp(-dt / time)
    for _ in range(2):
        x = lfilter([1.0 - a], [1.0, -a], x)
    return x[500:] / x[500:].std()


def _pair(name, t, recorded, simulated, noise, rng, plant=False):
    units = dict.fromkeys(recorded, UNITS) if plant else {}
    read = {c: x + noise.get(c, 0.0) * rng.standard_normal(len(t)) for c, x in recorded.items()}
    stated = {c: x for c, x in units.items() if c in simulated}
    return Recording(name, t, read, units=units), Recording(name, t, dict(simulated), units=stated)


def _together(pairs):
    return {r.name: s for r, s in pairs}, [r for r, _ in pairs]


def joint(stated, friction=0.6, angle=True, count=3):
    """Joint of a robot with inertia 0.2, damping 0.3, weight 1.5 and dry friction, driven by the current of its motor.

    The simulation without friction states the current that the recorded motion needs, or the acceleration.
    """
    dt, n, pairs = 0.01, 1200, []
    t = dt * np.arange(n)
    for k in range(count):
        rng = np.random.default_rng(k)
        u = 6.0 * wandering(rng, n, dt, 0.15)

        def force(x, w):
            return 0.3 * w + 1.5 * np.sin(x) + friction * np.tanh(w / 0.1)

        def move(s, x, u=u):
            return [x[1], (np.interp(s, t, u) - force(*x)) / 0.2]

        x, w = solve_ivp(move, (0.0, t[-1]), [0.0, 0.0], t_eval=t, max_step=dt).y
        a = (u - force(x, w)) / 0.2
        without = 0.3 * w + 1.5 * np.sin(x)
        recorded = {"rate": w, "acceleration": a, "current": u} | ({"angle": x} if angle else {})
        simulated = {"current": 0.2 * a + without} if stated == "current" else {"acceleration": (u - without) / 0.2}
        noise = {"angle": 1e-3, "rate": 0.02, "acceleration": 0.3, "current": 0.03}
        pairs.append(_pair(f"m{k}", t, recorded, simulated, noise, rng, plant=True))
    return _together(pairs)


def ship(cross_flow=3.0, count=3):
    """Ship in plane motion; the simulation states its yawing moment without the drag of its hull across the flow."""
    dt, n, pairs = 0.1, 2400, []
    t = dt * np.arange(n)
    for k in range(count):
        rng = np.random.default_rng(k)
        rudder, surge = 0.25 * wandering(rng, n, dt, 8.0), 5.0 + 0.6 * wandering(rng, n, dt, 40.0)
        sway, rate, moment, linear = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
        for i in range(n):
            linear[i] = (-0.02 * sway[i] - 0.06 * rate[i]) * surge[i] / 5.0 - 0.004 * rudder[i] * (surge[i] / 5.0) ** 2
            moment[i] = linear[i] - cross_flow * rate[i] * abs(rate[i])
            if i < n - 1:
                rate[i + 1] = rate[i] + dt * moment[i]
                sway[i + 1] = sway[i] + dt * (-0.08 * sway[i] - 0.3 * rate[i] + 0.02 * rudder[i])
        recorded = {"surge": surge, "sway": sway, "yaw_rate": rate, "rudder": rudder, "yaw_moment": moment}
        noise = {c: 0.01 * float(x.std()) for c, x in recorded.items()}
        pairs.append(_pair(f"m{k}", t, recorded, {"yaw_moment": linear}, noise, rng, plant=True))
    return _together(pairs)


def quadrotor(wind, count=3):
    """Quadrotor with drag of its rotors; the simulation in still air states what its accelerometers read.

    `wind` gives the velocity of the air [m/s] from the time [s] and the number of the recording, (n, 3).
    """
    dt, n, pairs = 0.02, 1500, []
    t = dt * np.arange(n)
    drag = np.array([0.35, 0.45, 0.2])
    for k in range(count):
        rng = np.random.default_rng(k + 10)
        phi, theta = (0.15 * wandering(rng, n, dt, 0.5) for _ in range(2))
        psi = 0.8 * k + wandering(rng, n, dt, 3.0)
        lift = 9.81 + wandering(rng, n, dt, 0.4)
        frame, air = body_to_earth(phi, theta, psi), wind(t, k)
        velocity, read = np.zeros((n, 3)), np.zeros((n, 3))
        for i in range(n):
            read[i] = -drag * (frame[i].T @ (velocity[i] - air[i])) - [0.0, 0.0, lift[i]]
            if i < n - 1:
                held = np.array([0.15, 0.15, 0.8]) * velocity[i]  # by a pilot
                velocity[i + 1] = velocity[i] + dt * (frame[i] @ read[i] + [0.0, 0.0, 9.81] - held)
        still = -drag * np.einsum("nji,nj->ni", frame, velocity) - np.outer(lift, [0.0, 0.0, 1.0])
        recorded = {
            **dict(zip(("vn", "ve", "vd"), velocity.T)), "phi": phi, "theta": theta, "psi": psi,
            **dict(zip(("ax", "ay", "az"), read.T)), "throttle": lift / 20.0,
        }  # fmt: skip
        noise = {**dict.fromkeys(("vn", "ve", "vd"), 0.03), **dict.fromkeys(("phi", "theta", "psi"), 0.002)}
        noise |= dict.fromkeys(("ax", "ay", "az"), 0.05)
        pairs.append(_pair(f"m{k}", t, recorded, dict(zip(("ax", "ay", "az"), still.T)), noise, rng))
    return _together(pairs)


def fixed_wing(stated, wind, count=3):
    """Log with airspeed, ground velocity, attitude and accelerometers.

    The simulation in still air states the airspeed from the ground velocity, or the ground velocity from the airspeed.
    """
    dt, n, pairs = 0.05, 1600, []
    t = dt * np.arange(n)
    for k in range(count):
        rng = np.random.default_rng(k + 20)
        phi, V = 0.4 * wandering(rng, n, dt, 3.0), 18.0 + 1.5 * wandering(rng, n, dt, 4.0)
        psi = 1.5 * k + dt * np.cumsum(9.81 * np.tan(phi) / V)
        alpha = 0.08 + 0.02 * wandering(rng, n, dt, 1.0)
        theta = 0.06 * wandering(rng, n, dt, 4.0) + alpha * np.cos(phi)
        frame = body_to_earth(phi, theta, psi)
        body = np.column_stack([V * np.cos(alpha), 0.0 * V, V * np.sin(alpha)])
        still = np.einsum("nij,nj->ni", frame, body)
        velocity = still + wind(t, k)
        gains = np.gradient(velocity, dt, axis=0) - [0.0, 0.0, 9.80665]
        recorded = {
            "V": V, **dict(zip(("vn", "ve", "vd"), velocity.T)), "phi": phi, "theta": theta, "psi": psi,
            **dict(zip(("ax", "ay", "az"), np.einsum("nji,nj->in", frame, gains))),
        }  # fmt: skip
        noise = {"V": 0.2, **dict.fromkeys(("vn", "ve", "vd", "ax", "ay", "az"), 0.1)}
        noise |= dict.fromkeys(("phi", "theta", "psi"), 0.003)
        simulated = {"V": np.linalg.norm(velocity, axis=1)} if stated == "V" else {"vn": still[:, 0], "ve": still[:, 1]}
        pairs.append(_pair(f"m{k}", t, recorded, simulated, noise, rng))
    return _together(pairs)
