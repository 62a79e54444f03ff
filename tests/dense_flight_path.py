"""The flight-path problem a second time, as [M86] prints it, and flights to try both on.

Vectors and whole matrices where structsel's kernel has loops; written for complex numbers too, so that Jacobians
come from complex steps.
"""

import numpy as np

from structsel.numerics.kinematics import MEASUREMENTS, fly, readings
from structsel.reconstruction.kinematics_problem import KinematicsProblem

G = 9.80665
ANGLES = [MEASUREMENTS.index("phi"), MEASUREMENTS.index("psi")]


def rotation(phi, theta, psi):
    """Body axes to north, east, down."""
    one, zero = 1.0 + 0.0 * phi, 0.0 * phi
    sf, cf, st, ct, sp, cp = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta), np.sin(psi), np.cos(psi)
    yaw = np.array([[cp, -sp, zero], [sp, cp, zero], [zero, zero, one]])
    pitch = np.array([[ct, zero, st], [zero, one, zero], [-st, zero, ct]])
    roll = np.array([[one, zero, zero], [zero, cf, -sf], [zero, sf, cf]])
    return yaw @ pitch @ roll


def wrapped(angle):
    """An angle within half a turn; the number of turns is that of the real part."""
    return angle - 2.0 * np.pi * np.round(np.real(angle) / (2.0 * np.pi))


def dense_slope(x, a, p):
    omega, arm = (a[3:6] - x[12:15]) / (1.0 + x[28:31]), p.place[0]
    force = (a[:3] - x[9:12]) / (1.0 + x[25:28])
    force = force - np.cross(a[6:9] / (1.0 + x[28:31]), arm) - np.cross(omega, np.cross(omega, arm))
    turn = rotation(*x[3:6])
    phi, theta = x[3], x[4]
    euler = np.array(
        [
            [1.0, np.sin(phi) * np.tan(theta), np.cos(phi) * np.tan(theta)],
            [0.0, np.cos(phi), -np.sin(phi)],
            [0.0, np.sin(phi) / np.cos(theta), np.cos(phi) / np.cos(theta)],
        ]
    )
    ground = turn @ x[:3] + x[15:18]
    velocity = force + turn.T @ np.array([0.0, 0.0, p.g]) - np.cross(omega, x[:3])
    return np.concatenate([velocity, euler @ omega, ground[:2], -ground[2:], np.zeros(25)])


def dense_step(x, k, p):
    a0, a1, dt = p.inputs[k - 1], p.inputs[k], p.t[k] - p.t[k - 1]
    k1 = dense_slope(x, a0, p)
    k2 = dense_slope(x + 0.5 * dt * k1, 0.5 * (a0 + a1), p)
    k3 = dense_slope(x + 0.5 * dt * k2, 0.5 * (a0 + a1), p)
    k4 = dense_slope(x + dt * k3, a1, p)
    later = x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return np.concatenate([later[:31], x[31:] * np.exp(-dt / p.gust_time)])


def dense_observe(x, k, p):
    omega, turn = (p.inputs[k, 3:6] - x[12:15]) / (1.0 + x[28:31]), rotation(*x[3:6])

    air = x[:3] + x[31:]

    def at(row, velocity=air):
        return velocity + np.cross(omega, p.place[row])

    def size(v):
        return np.sqrt(v @ v)

    vane = at(2)
    here = np.arctan(vane[1] / vane[0]) if p.flank else np.arcsin(vane[1] / size(vane))
    return np.concatenate(
        [
            [
                (1.0 + x[22]) * size(at(3)),
                np.arctan(at(1)[2] / at(1)[0]) + x[18] * np.arctan(x[2] / x[0]) + x[19],
                here + x[20] * np.arcsin(x[1] / size(x[:3])) + x[21],
            ],
            [x[3] + x[23] * wrapped(x[3]), (1.0 + x[24]) * x[4], x[5]],
            [x[8] - (turn @ p.place[4])[2]],
            x[6:8] + (turn @ p.place[5])[:2],
            turn @ at(5, x[:3]) + x[15:18],
        ]
    )


def jacobian(function, x, active):
    columns = []
    for j in active:
        z = x.astype(complex)
        z[j] += 1e-30j
        columns.append(function(z).imag / 1e-30)
    return np.array(columns).T


def flight(n, seed=0, held=(17, 21), flank=False, drift=False, gusts=False, dt=0.05, noisy_inputs=True, scales=()):
    """A manoeuvring flight on an uneven clock, every instrument on its own arm and at its own rate."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(dt * rng.uniform(0.7, 1.3, n))
    t[n // 2 :] += 4.0 * dt
    a = np.zeros((n, 9))
    a[:, 0] = 0.8 + 0.3 * np.sin(0.3 * t)
    a[:, 1] = 0.5 * np.sin(0.9 * t)
    a[:, 2] = -9.8 + np.sin(1.1 * t)
    for j, (size, frequency, phase) in enumerate([(0.2, 0.7, 0.0), (0.05, 1.1, 1.0), (0.08, 0.5, 1.5)]):
        a[:, 3 + j] = size * np.sin(frequency * t + phase)
        a[:, 6 + j] = size * frequency * np.cos(frequency * t + phase)
    place = rng.normal(0.0, [3.0, 0.5, 0.5], (6, 3))
    truth = np.zeros(34)
    truth[:9] = [100.0, 1.0, 5.0, 0.05, 0.05, 3.0, 20.0, -30.0, 1000.0]
    truth[15:23] = [5.0, -3.0, 0.4, 0.03, 0.004, 0.02, 0.003, 0.01]
    scale = np.zeros(8)
    scale[[i - 23 for i in scales]] = rng.normal(0.0, 0.03, len(scales))
    bias = np.array([0.1, -0.05, 0.08, 2e-3, -1e-3, 3e-3])
    path = fly(t, a, truth, place, G, True)
    input_std = np.tile([0.02, 0.02, 0.02, 5e-4, 5e-4, 5e-4], (n, 1)) * rng.uniform(0.5, 2.0, (n, 1))
    noise = np.array([0.2, 2e-3, 2e-3, 2e-3, 2e-3, 2e-3, 0.5, 1.0, 1.0, 0.05, 0.05, 0.05])
    measured = a.copy()
    measured[:, :6] *= 1.0 + scale[2:]
    measured[:, 6:] *= 1.0 + scale[5:]
    biased = np.c_[measured[:, :6] + bias, measured[:, 6:]]
    measured[:, :6] += bias + noisy_inputs * input_std * rng.standard_normal((n, 6))
    path[:, 9:15], path[:, 23:31] = bias, scale
    y = readings(path, biased, place, flank) + noise * rng.standard_normal((n, 12))
    y[:, ANGLES] = np.angle(np.exp(1j * y[:, ANGLES]))
    for channel, every in enumerate([1, 1, 2, 3, 3, 3, 5, 10, 10, 4, 4, 4]):
        missing = np.ones(n, dtype=bool)
        missing[channel % every :: every] = False
        y[missing, channel] = np.nan
    y[n // 3 : n // 3 + 4] = np.nan
    y[n // 4 : n // 2, 6] = np.nan
    std = np.array([2, 2, 2, 0.05, 0.05, 0.05, 3, 3, 3, 0.3, 0.3, 0.3, 0.02, 0.02, 0.02, 10, 10, 2, 0.1, 0.02, 0.1])
    std = np.r_[std, 0.02, 0.02, np.full(8, 0.05), 0.5, 0.5, 0.5]
    start = truth.copy()
    active = np.setdiff1d(np.r_[:23, scales, 31:34] if gusts else np.r_[:23, scales], held).astype(int)
    start[active] += 0.5 * std[active] * rng.standard_normal(active.size)
    walk = np.zeros(34)
    if drift:
        walk[[9, 11, 13, 18]] = [2e-3, 3e-3, 1e-4, 1e-3]
    if gusts:
        walk[31:] = 0.4
    problem = KinematicsProblem(
        t, measured, input_std, y, noise, start, std[active], active, walk, place, flank, G, 1.5
    )
    return problem, path
