"""The flight-path filter beside filterpy's unscented Kalman filter, and an hour's flight.

    python benchmarks/reconstruction.py --out reconstruction.md        # about 3 minutes

One simulated flight, 18 states, 12 measurements at every sample, the same sigma points. filterpy is given the
equations twice: in Python as its user would write them (scalars, functions of the math module: the fastest way
without a compiler), and as structsel's own compiled step and observation. The estimates of all three must agree.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from math import asin, atan2, cos, sin, sqrt
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid
from timing import in_child, machine, measure, measure_once, one_blas_thread, peak_above_now, publish, say, table

from structsel.aircraft import Aircraft
from structsel.demo import demo_aircraft
from structsel.numerics.arrays import Array
from structsel.numerics.kinematics import INPUTS, MEASUREMENTS, STATES, observe_at, readings, slopes, step
from structsel.numerics.rotations import angles_of, cosines_of, cosines_of_angles, quaternion_of, turn
from structsel.reconstruction import reconstruct
from structsel.reconstruction.data_compatibility import check_data_compatibility
from structsel.reconstruction.kinematics_problem import KinematicsProblem
from structsel.reconstruction.ukf import ukf_filter, ukf_smoother
from structsel.recording import Recording

try:
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
except ImportError:
    UnscentedKalmanFilter = None

G = 9.80665
ACTIVE = np.array([*range(17), STATES.index("Cup")])
START_STD = np.array([2, 2, 2, 0.05, 0.05, 0.05, 3, 3, 3, 0.3, 0.3, 0.3, 0.02, 0.02, 0.02, 10, 10, 0.1])
READING_STD = np.array([0.1, 3e-3, 3e-3, 9e-3, 9e-3, 9e-3, 0.3, 1.0, 1.0, 0.05, 0.05, 0.05])
INPUT_STD = np.array([0.02, 0.02, 0.02, 2e-3, 2e-3, 2e-3])
SPREAD = 1.0
AGREED = 0.1  # in standard deviations, after the first 10 s
CONVERGED = 500  # samples


def simulated(samples: int, dt: float = 0.02, seed: int = 0) -> tuple[KinematicsProblem, Array]:
    """A flight in constant gentle manoeuvre, and its true path; attitude and air data are set, readings follow."""
    rng = np.random.default_rng(seed)
    t = np.arange(samples) * dt

    def waves(mean: float, *parts: tuple[float, float, float]) -> tuple[Array, Array]:
        value, slope = np.full(samples, mean), np.zeros(samples)
        for size, frequency, phase in parts:
            value += size * np.sin(frequency * t + phase)
            slope += size * frequency * np.cos(frequency * t + phase)
        return value, slope

    phi, phi_dot = waves(0.0, (0.4, 0.5, 0.0), (0.2, 1.7, 1.0))
    theta, theta_dot = waves(0.05, (0.08, 0.4, 0.5), (0.06, 1.9, 0.0))
    psi, psi_dot = waves(0.0, (0.5, 0.11, 0.0), (0.05, 1.3, 2.0))
    u, u_dot = waves(95.0, (6.0, 0.2, 0.0), (1.0, 1.1, 1.0))
    v, v_dot = waves(0.0, (4.0, 1.3, 0.3))
    w, w_dot = waves(6.0, (5.0, 1.9, 0.7), (2.0, 0.35, 0.0))
    sf, cf, st, ct = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta)
    rates = np.c_[phi_dot - psi_dot * st, theta_dot * cf + psi_dot * sf * ct, psi_dot * cf * ct - theta_dot * sf]
    p, q, r = rates.T
    force = np.c_[
        u_dot + G * st + q * w - r * v, v_dot - G * ct * sf + r * u - p * w, w_dot - G * ct * cf + p * v - q * u
    ]
    angular = np.gradient(rates, dt, axis=0)
    place = np.array([[0.5, 0.1, 0.2], [5, 0, 0], [5, 0.3, 0], [4.5, 0.3, 0], [1, 0, 0.5], [0, 0, -1]])
    force += np.cross(angular, place[0]) + np.cross(rates, np.cross(rates, place[0]))
    truth = np.zeros(34)
    truth[:9] = [u[0], v[0], w[0], phi[0], theta[0], psi[0], 0.0, 0.0, 1000.0]
    truth[9:17] = [0.1, -0.05, 0.08, 2e-3, -1e-3, 3e-3, 5.0, -3.0]
    truth[STATES.index("Cup")] = 0.03
    inputs = np.c_[force, rates, angular]
    inputs[:, :6] += truth[9:15]
    path = np.tile(truth, (samples, 1))
    # Over an hour dead reckoning would leave the path that was set; only the position is integrated.
    path[:, :6] = np.c_[u, v, w, phi, theta, psi]
    path[:, 6:9] += cumulative_trapezoid(slopes(path, inputs, place, G)[:, 6:9], t, axis=0, initial=0.0)
    y = readings(path, inputs, place, False) + READING_STD * rng.standard_normal((samples, 12))
    inputs[:, :6] += INPUT_STD * rng.standard_normal((samples, 6))
    start = truth.copy()
    start[ACTIVE] += START_STD * rng.standard_normal(ACTIVE.size)
    noise = np.tile(INPUT_STD, (samples, 1))
    still = np.zeros(34)
    return KinematicsProblem(t, inputs, noise, y, READING_STD, start, START_STD, ACTIVE, still, place, False, G), path


# ---------------------------------------------------------------- the equations as a user of filterpy writes them


def slope(x: list[float], a: Array, place: Array) -> list[float]:
    """Derivative of the 18 states under the readings a."""
    u, v, w, phi, theta, psi, _, _, _, bax, bay, baz, bp, bq, br, wn, we, _ = x
    p, q, r = a[3] - bp, a[4] - bq, a[5] - br
    pd, qd, rd = a[6], a[7], a[8]
    rx, ry, rz = place[0]
    fx = a[0] - bax - (qd * rz - rd * ry) + (q * q + r * r) * rx - p * q * ry - p * r * rz
    fy = a[1] - bay - (rd * rx - pd * rz) + (p * p + r * r) * ry - p * q * rx - q * r * rz
    fz = a[2] - baz - (pd * ry - qd * rx) + (p * p + q * q) * rz - p * r * rx - q * r * ry
    sf, cf, st, ct, sp, cp = sin(phi), cos(phi), sin(theta), cos(theta), sin(psi), cos(psi)
    turn = (q * sf + r * cf) / ct
    along, across = u * ct + (v * sf + w * cf) * st, v * cf - w * sf
    return [
        fx - G * st - q * w + r * v,
        fy + G * ct * sf - r * u + p * w,
        fz + G * ct * cf - p * v + q * u,
        p + turn * st,
        q * cf - r * sf,
        turn,
        along * cp - across * sp + wn,
        along * sp + across * cp + we,
        u * st - (v * sf + w * cf) * ct,
    ]


def python_step(x: Array, dt: float, a0: Array, a1: Array, place: Array) -> Array:
    """Runge-Kutta of fourth order."""
    start, fixed, middle = x[:9].tolist(), x[9:].tolist(), (0.5 * (a0 + a1)).tolist()
    a0, a1, arms = a0.tolist(), a1.tolist(), place.tolist()

    def at(k: list[float], h: float) -> list[float]:
        return [s + h * d for s, d in zip(start, k)] + fixed

    k1 = slope(start + fixed, a0, arms)
    k2 = slope(at(k1, 0.5 * dt), middle, arms)
    k3 = slope(at(k2, 0.5 * dt), middle, arms)
    k4 = slope(at(k3, dt), a1, arms)
    moved = [s + dt / 6.0 * (a + 2.0 * b + 2.0 * c + d) for s, a, b, c, d in zip(start, k1, k2, k3, k4)]
    return np.array(moved + fixed)


def python_observe(x: Array, a: Array, place: Array) -> Array:
    u, v, w, phi, theta, psi, north, east, h, _, _, _, bp, bq, br, wn, we, Cup = x.tolist()
    p, q, r = a[3] - bp, a[4] - bq, a[5] - br
    _, alpha_vane, beta_vane, pitot, static, gps = place.tolist()

    def moving(arm: list[float]) -> tuple[float, float, float]:
        return u + q * arm[2] - r * arm[1], v + r * arm[0] - p * arm[2], w + p * arm[1] - q * arm[0]

    sf, cf, st, ct, sp, cp = sin(phi), cos(phi), sin(theta), cos(theta), sin(psi), cos(psi)

    def earth(x: float, y: float, z: float) -> tuple[float, float, float]:
        along, across = x * ct + (y * sf + z * cf) * st, y * cf - z * sf
        return along * cp - across * sp, along * sp + across * cp, -x * st + (y * sf + z * cf) * ct

    ua, _, wa = moving(alpha_vane)
    ub, vb, wb = moving(beta_vane)
    um, vm, wm = moving(pitot)
    gn, ge, _ = earth(*gps)
    vn, ve, vd = earth(*moving(gps))
    return np.array(
        [
            sqrt(um * um + vm * vm + wm * wm),
            atan2(wa, ua) + Cup * atan2(w, u),
            asin(vb / sqrt(ub * ub + vb * vb + wb * wb)),
            *(phi, theta, psi),
            *(h - earth(*static)[2], north + gn, east + ge, vn + wn, ve + we, vd),
        ]
    )


def noise_gain(x: Array) -> Array:
    """(18, 6) effect of noise on accelerometers and gyros."""
    u, v, w, phi, theta = x[:5].tolist()
    gain = np.zeros((ACTIVE.size, 6))
    sf, cf, tt, ct = sin(phi), cos(phi), sin(theta) / cos(theta), cos(theta)
    gain[:3, :3] = np.eye(3)
    gain[:3, 3:] = [[0.0, -w, v], [w, 0.0, -u], [-v, u, 0.0]]
    gain[3:6, 3:] = [[1.0, sf * tt, cf * tt], [0.0, cf, -sf], [0.0, sf / ct, cf / ct]]
    return gain


# ---------------------------------------------------------------- the runs


def filterpy_run(p: KinematicsProblem, compiled: bool) -> tuple[Array, Array]:
    """Estimates and their standard deviations, (n, 18) each."""
    full, out, everything = p.start.copy(), np.empty(34), np.ones(12, dtype=bool)
    C, e = np.empty((3, 3)), np.empty(4)

    def compiled_step(x: Array, dt: float, a0: Array, a1: Array) -> Array:
        full[ACTIVE] = x
        e[:] = quaternion_of(*x[3:6])
        cosines_of(e, C)
        full[3:6] = 0.0
        step(full, C, a0, a1, dt, p.place, G, True, out)
        turn(e, *out[3:6], e)
        cosines_of(e, C)
        out[3:6] = x[3:6] + np.remainder(np.subtract(angles_of(C), x[3:6]) + np.pi, 2.0 * np.pi) - np.pi
        return out[ACTIVE]

    def compiled_observe(x: Array, a: Array) -> Array:
        read = np.empty(12)
        full[ACTIVE] = x
        cosines_of_angles(*x[3:6], C)
        observe_at(full, C, a, p.place, False, everything, read)
        return read

    if compiled:
        fx: Callable[..., Array] = compiled_step
        hx: Callable[..., Array] = compiled_observe
    else:

        def fx(x: Array, dt: float, a0: Array, a1: Array) -> Array:
            return python_step(x, dt, a0, a1, p.place)

        def hx(x: Array, a: Array) -> Array:
            return python_observe(x, a, p.place)

    L = ACTIVE.size
    ukf = UnscentedKalmanFilter(L, 12, 0.0, hx, fx, MerweScaledSigmaPoints(L, SPREAD, 2.0, 0.0))
    ukf.x, ukf.P, ukf.R = p.start[ACTIVE].copy(), np.diag(START_STD**2), np.diag(READING_STD**2)
    ukf.sigmas_f = ukf.points_fn.sigma_points(ukf.x, ukf.P)
    x, std = np.empty((len(p.t), L)), np.empty((len(p.t), L))
    for k in range(len(p.t)):
        if k:
            dt = p.t[k] - p.t[k - 1]
            gain = noise_gain(ukf.x)
            ukf.Q = (gain * (p.input_std[k] * dt) ** 2) @ gain.T
            ukf.predict(dt=dt, a0=p.inputs[k - 1], a1=p.inputs[k])
        ukf.update(p.measurements[k], a=p.inputs[k])
        x[k], std[k] = ukf.x, np.sqrt(np.diag(ukf.P))
    return x, std


def compared_with_filterpy(samples: int, repeats: int) -> str:
    """CPU time per sample, ratios and agreement."""
    short, _ = simulated(300)
    problem, path = simulated(samples)
    runs: dict[str, Callable[[], Any]] = {
        "structsel, unscented filter": lambda: ukf_filter(problem, spread=SPREAD),
        "structsel, filter and smoother": lambda: ukf_smoother(problem, spread=SPREAD),
        "structsel, extended filter": lambda: ukf_filter(problem, spread=0.0),
        "structsel, output error": lambda: check_data_compatibility(problem),
    }
    for run in (ukf_filter, ukf_smoother, check_data_compatibility):
        run(short)
    ours = ukf_filter(problem, spread=SPREAD)
    peers: dict[str, bool] = {}
    if UnscentedKalmanFilter is not None:
        peers = {"filterpy, equations in Python": False, "filterpy, structsel's compiled equations": True}
        filterpy_run(short, True)
    seconds, differences = {}, {}
    timed = measure(runs, repeats, warm=False)
    for name, compiled in peers.items():
        say(name)
        seconds[name], _, (x, std) = measure_once(lambda compiled=compiled: filterpy_run(problem, compiled))
        later = slice(CONVERGED, None)
        difference = np.abs((x - ours.x) / ours.std)[later].max()
        differences[name] = (difference, np.abs(std / ours.std - 1.0)[later].max())
        # Turn and turn about with the peer, so that the machine's mood is shared.
        again = measure(runs, repeats, warm=False)
        timed = {key: min(timed[key], again[key], key=lambda times: times.cpu_median) for key in timed}
    first = timed["structsel, unscented filter"].cpu_median
    rows = [
        [name, t.cpu_median, 1e6 * t.cpu_median / samples, t.cpu_median / first, "", ""] for name, t in timed.items()
    ]
    for name, value in seconds.items():
        rows.append([name, value, 1e6 * value / samples, value / first, *(f"{d:.1e}" for d in differences[name])])
    if not peers:
        rows.append(["filterpy", "not installed", "", "", "", ""])
    head = ["what", "CPU s", "us a sample", "over our filter", "estimates differ by (std)", "std differ by (relative)"]
    text = table(head, rows)
    for name, (estimates, deviations) in differences.items():
        agreed = "yes" if max(estimates, deviations) < AGREED else "NO"
        text += f"\n\n{name}: agrees to {AGREED:g}: {agreed}."
    rms = np.sqrt(np.mean(((ours.x - path[:, ACTIVE]) / ours.std) ** 2))
    return text + f"\n\nErrors of the filter over its own std, rms of all states: {rms:.2f}."


def long_flight(samples: int) -> dict[str, float]:
    """CPU seconds and peak memory above the recording's own arrays; runs in a process of its own."""
    with one_blas_thread():
        short, _ = simulated(300)
        ukf_smoother(short)
        problem, _ = simulated(samples)
        cpu, _, (filtered, smoothed) = measure_once(lambda: ukf_smoother(problem))
        failed = filtered.failed
        held = sum(
            getattr(part, name).nbytes
            for part in (filtered, smoothed)
            for name in part.__annotations__
            if isinstance(getattr(part, name), np.ndarray)
        )
        del filtered, smoothed
        alone = measure_once(lambda: ukf_filter(problem))[0]
        peak = peak_above_now(lambda: ukf_smoother(problem))
    return {"filter": alone, "smoother": cpu, "peak": peak, "results": held / 2**20, "failed": failed}


def recorded(samples: int) -> tuple[Recording, Aircraft]:
    """The same flight as a recording, and an aircraft with the positions and noise of its instruments."""
    p, _ = simulated(samples)
    channels = {name: p.inputs[:, j] for j, name in enumerate(INPUTS[:6])}
    channels |= {name: p.measurements[:, j] for j, name in enumerate(MEASUREMENTS)}
    noise = dict(zip(INPUTS, INPUT_STD.tolist())) | dict(zip(MEASUREMENTS, READING_STD.tolist()))
    sensors = {
        "accelerometer": (0, "ax ay az"), "gyro": (None, "p q r"), "alpha_vane": (1, "alpha"), "beta_vane": (2, "beta"),
        "pitot": (3, "V"), "attitude": (None, "phi theta psi"), "static": (4, "h"), "gps": (5, "x y vn ve vd"),
    }  # fmt: skip
    content = demo_aircraft().to_dict()
    content["sensors"] = {
        name: {"noise": {one: noise[one] for one in of.split()}}
        | ({} if row is None else {"position": p.place[row].tolist()})
        for name, (row, of) in sensors.items()
    }
    return Recording("long", p.t, channels), Aircraft.from_dict(content)


def public_verb(samples: int) -> float:
    """CPU seconds of `reconstruct` with its defaults; runs in a process of its own."""
    with one_blas_thread():
        reconstruct(*recorded(600))
        recording, aircraft = recorded(samples)
        return measure_once(lambda: reconstruct(recording, aircraft))[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=6000, help="of the comparison")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--hours", type=float, default=1.0, help="of the long flight, at 50 Hz; 0 skips it")
    parser.add_argument("--out", help="also write the report to this file")
    a = parser.parse_args()
    parts = [
        "# Reconstruction",
        f"{ACTIVE.size} states, 12 measurements at each sample. {machine()}",
        f"## {a.samples} samples",
    ]
    with one_blas_thread():
        parts.append(compared_with_filterpy(a.samples, a.repeats))
    if a.hours:
        say("long flight")
        long = in_child("reconstruction", "long_flight", {"samples": round(a.hours * 180_000)})
        verb = in_child("reconstruction", "public_verb", {"samples": round(a.hours * 180_000)})
        head = [
            "reconstruct, CPU s",
            "filter, CPU s",
            "filter and smoother, CPU s",
            "peak memory, MiB",
            "of it results, MiB",
        ]
        parts += [
            f"## {a.hours:g} h at 50 Hz" + (f": failed at sample {long['failed']}" if long["failed"] >= 0 else ""),
            table(head, [[verb, long["filter"], long["smoother"], long["peak"], long["results"]]]),
        ]
    publish("\n\n".join(parts), a.out)


if __name__ == "__main__":
    main()
