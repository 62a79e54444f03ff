"""Sensitivity of the measurements of a flight to its initial motion and to the constants.

The sensitivities are computed along the *recorded* path: biases would degrade an integrated one within a minute. With X
the active states and x the motion among them, the variational equations and measurements

    dx' = (df/dX) dX,    dy = (dh/dX) dX

are integrated over segments of at most a minute [M86].
"""

from __future__ import annotations

import numpy as np
import scipy

from structsel.errors import DomainError
from structsel.numerics.air_data import body_velocity
from structsel.numerics.arrays import UNCOUNTED
from structsel.numerics.compiling import njit
from structsel.numerics.kinematics import MEASUREMENTS, MOTION, observe_at, slopes_at
from structsel.numerics.rotations import cosines_of_angles
from structsel.reconstruction.kinematics_problem import KinematicsProblem

_LONGEST = 60.0  # s of a segment; over more time the effect of the initial motion is lost
_GAP = 0.5  # s without a sample, and five samples: not integrated across
_INTEGRATED = 20_000  # samples of a recording at which the sensitivities are integrated; chosen, not critical
_KEPT = 600  # samples of each channel in a segment; their weight replaces that of the others
_FEWEST_KEPT = 100  # the same in a long recording, whose segments have so many samples in proportion
_STEEPEST = 1.5  # rad of pitch attitude; beyond it the rates of the Euler angles are singular
_P_NOISE = 1e-3  # probability that a cosine of noise is kept, in a channel and segment
_WINDOW = 1.0  # s to either side, over which the direction of gravity is averaged
# Central differences of readings and slopes, in the states' own units; small against any curvature.
_STEP = np.array([1e-2] * 3 + [1e-4] * 3 + [1e-2] * 3 + [1e-3] * 3 + [1e-4] * 3 + [1e-2] * 3 + [1e-4] * 13 + [1e-2] * 3)


def recorded_path(problem: KinematicsProblem, segments: list[slice]) -> tuple[np.ndarray, tuple[str, ...]]:
    """(n, 34) path for the linearisation, as recorded; and notes on the channels that are assumed."""
    t, start, notes = problem.t, problem.start, []
    held = {
        "V": float(np.linalg.norm(start[:3])),
        "alpha": np.arctan2(start[2], start[0]),
        "beta": np.arctan2(start[1], np.hypot(start[0], start[2])),
    }
    if held["V"] == 0.0 and not np.isfinite(problem.measurements[:, 0]).any():
        raise DomainError(
            "reconstructibility needs an airspeed: V was not sampled, and u, v, w of the start are zero. Set them."
        )
    found = {}
    for name in ("V", "alpha", "beta", "phi", "theta", "psi"):
        column = problem.measurements[:, MEASUREMENTS.index(name)]
        seen = np.isfinite(column)
        if seen.any():
            values = np.unwrap(column[seen]) if name in ("phi", "psi") else column[seen].copy()
            before = np.cumsum(seen) - seen  # samples seen before each
            for segment in segments:
                part = slice(before[segment.start], before[segment.stop - 1] + seen[segment.stop - 1])
                values[part] = _without_noise(values[part], problem.measurement_std[MEASUREMENTS.index(name)])
            found[name] = np.interp(t, t[seen], values)
        elif name in held:
            found[name] = np.full(len(t), held[name])
            notes.append(f"{name} was not sampled: it is assumed constant at {held[name]:.3g}.")
    path = np.tile(start, (len(t), 1))
    path[:, :3] = np.column_stack(body_velocity(found["V"], found["alpha"], found["beta"]))
    # A vane ahead of the centre of gravity reads the pitch rate as angle of attack, which is no excitation.
    for j, row in enumerate((3, 2, 1)):
        path[:, j] -= np.cross(problem.inputs[:, 3:6] - start[12:15], problem.place[row])[:, j]
    missing = [name for name in ("phi", "theta") if name not in found]
    if missing:
        for name, values in zip(("phi", "theta"), _attitude(problem, path[:, :3])):
            found.setdefault(name, values)
        notes.append(f"{' and '.join(missing)} not sampled: computed from accelerometers and air data.")
    steep = np.abs(found["theta"]) > _STEEPEST
    if steep.any():
        notes.append(
            f"theta is beyond {_STEEPEST} rad in {int(steep.sum())} samples, the first at {t[steep][0]:.2f} s; "
            f"the analysis uses {_STEEPEST} rad there."
        )
    path[:, 3], path[:, 4] = found["phi"], np.clip(found["theta"], -_STEEPEST, _STEEPEST)
    if "psi" not in found:
        found["psi"] = problem.integrated_heading(path)
    path[:, 5] = found["psi"]
    return path, tuple(notes)


def recorded_inputs(problem: KinematicsProblem, segments: list[slice]) -> np.ndarray:
    """(n, 9) inputs for the linearisation, without the noise of accelerometers and gyros."""
    inputs, std = problem.inputs.copy(), np.median(problem.input_std, axis=0)
    for segment in segments:
        for j, level in enumerate(std):
            inputs[segment, j] = _without_noise(inputs[segment, j], level)
    return inputs


def _without_noise(values: np.ndarray, std: float) -> np.ndarray:
    """Signal of the cosines above the level of white noise, because noise in the path is no excitation."""
    if not values.size or std == 0.0:
        return values
    waves = scipy.fft.dct(values, norm="ortho")
    waves[1:][np.abs(waves[1:]) < std * np.sqrt(2.0 * np.log(values.size / _P_NOISE))] = 0.0
    return scipy.fft.idct(waves, norm="ortho")


def _attitude(problem: KinematicsProblem, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Roll and pitch attitude from gravity in body axes, v' + omega x v - f, averaged over two seconds."""
    n, half = len(problem.t), max(1, round(_WINDOW / float(np.median(np.diff(problem.t)))))
    free = problem.inputs[:, :6] - problem.start[9:15]
    without = np.cross(free[:, 3:], velocity) - free[:, :3]
    total = np.concatenate([np.zeros((1, 3)), np.cumsum(without, axis=0)])
    first, last = np.maximum(np.arange(n) - half, 0), np.minimum(np.arange(n) + half, n - 1)
    gained = (velocity[last] - velocity[first]) / (problem.t[last] - problem.t[first])[:, None]
    gx, gy, gz = (gained + (total[last + 1] - total[first]) / (last + 1 - first)[:, None]).T
    return np.unwrap(np.arctan2(gy, gz)), np.arctan2(-gx, np.hypot(gy, gz))


def segments_of(t: np.ndarray) -> list[slice]:
    """Equal segments of at most a minute, without gaps."""
    segments = []
    steps = np.diff(t)
    edges = np.flatnonzero(steps > max(_GAP, 5.0 * float(np.median(steps)))) + 1 if len(t) > 1 else np.zeros(0, int)
    for part in np.split(np.arange(len(t)), edges):
        count = max(1, int(np.ceil((t[part[-1]] - t[part[0]]) / _LONGEST)))
        segments += [slice(piece[0], piece[-1] + 1) for piece in np.array_split(part, count) if len(piece) > 1]
    if not segments:
        raise DomainError("reconstructibility needs two samples without a gap between them; there are none.")
    return segments


@njit(**UNCOUNTED)
def _set_cosines(x, state, C, out):  # type: ignore[no-untyped-def]
    """Direction cosines where this state of x was changed: C, those before, unless it is an angle of the attitude."""
    if 3 <= state <= 5:
        cosines_of_angles(x[3], x[4], x[5], out)
    else:
        for i in range(3):
            out[i, 0], out[i, 1], out[i, 2] = C[i, 0], C[i, 1], C[i, 2]


@njit(cache=True)
def _slope_changes(path, inputs, place, g, active, m, step):  # type: ignore[no-untyped-def]
    """(n, m, L) derivatives of the slopes of the motion with the active states, by central differences."""
    changes = np.empty((path.shape[0], m, active.size))
    x, C, turned = np.empty(path.shape[1]), np.empty((3, 3)), np.empty((3, 3))
    up, down = np.empty(MOTION), np.empty(MOTION)
    for k in range(path.shape[0]):
        x[:] = path[k]
        cosines_of_angles(x[3], x[4], x[5], C)
        for j in range(active.size):
            state = active[j]
            x[state] = path[k, state] + step[state]
            _set_cosines(x, state, C, turned)
            slopes_at(x, turned, inputs[k], place, g, up)
            x[state] = path[k, state] - step[state]
            _set_cosines(x, state, C, turned)
            slopes_at(x, turned, inputs[k], place, g, down)
            x[state] = path[k, state]
            for i in range(m):
                changes[k, i, j] = (up[active[i]] - down[active[i]]) / (2.0 * step[state])
    return changes


@njit(cache=True)
def _reading_changes(path, inputs, place, flank, active, step):  # type: ignore[no-untyped-def]
    """(n, 12, L) derivatives of the readings with the active states, by central differences."""
    count = len(MEASUREMENTS)
    changes = np.empty((path.shape[0], count, active.size))
    x, C, turned = np.empty(path.shape[1]), np.empty((3, 3)), np.empty((3, 3))
    up, down, wanted = np.empty(count), np.empty(count), np.ones(count, dtype=np.bool_)
    for k in range(path.shape[0]):
        x[:] = path[k]
        cosines_of_angles(x[3], x[4], x[5], C)
        for j in range(active.size):
            state = active[j]
            x[state] = path[k, state] + step[state]
            _set_cosines(x, state, C, turned)
            observe_at(x, turned, inputs[k], place, flank, wanted, up)
            x[state] = path[k, state] - step[state]
            _set_cosines(x, state, C, turned)
            observe_at(x, turned, inputs[k], place, flank, wanted, down)
            x[state] = path[k, state]
            for i in range(count):
                changes[k, i, j] = (up[i] - down[i]) / (2.0 * step[state])
    return changes


@njit(cache=True)
def _rate(A, Z, out):  # type: ignore[no-untyped-def]
    """A [Z; 0 I]: the constants do not change."""
    m, L = A.shape
    for i in range(m):
        for j in range(L):
            out[i, j] = A[i, j] if j >= m else 0.0
        for c in range(m):
            factor = A[i, c]
            if factor != 0.0:
                for j in range(L):
                    out[i, j] += factor * Z[c, j]


@njit(cache=True)
def _sensitivities(t, A):  # type: ignore[no-untyped-def]
    """(n, m, L) change of the motion with motion at the first sample and constants, by Heun's rule."""
    n, m, L = A.shape
    Z = np.zeros((n, m, L))
    first, second = np.empty((m, L)), np.empty((m, L))
    for i in range(m):
        Z[0, i, i] = 1.0
    for k in range(1, n):
        dt = t[k] - t[k - 1]
        _rate(A[k - 1], Z[k - 1], first)
        _rate(A[k], Z[k - 1] + dt * first, second)
        Z[k] = Z[k - 1] + 0.5 * dt * (first + second)
    return Z


def sensitivity_factor(
    problem: KinematicsProblem,
    path: np.ndarray,
    inputs: np.ndarray,
    segment: slice,
    active: np.ndarray,
    std: np.ndarray,
) -> np.ndarray:
    """(L, L) triangular factor of the scaled sensitivities of a segment: initial motion, then constants."""
    L, m = len(active), int(np.sum(active < MOTION))
    t, path, inputs = problem.t[segment], np.ascontiguousarray(path[segment]), np.ascontiguousarray(inputs[segment])
    # Of a long recording every few samples: the sensitivities change as slowly as the motion.
    grid = np.unique(np.append(np.arange(0, len(t), max(1, len(problem.t) // _INTEGRATED)), len(t) - 1))
    Z = _sensitivities(t[grid], _slope_changes(path[grid], inputs[grid], problem.place, problem.g, active, m, _STEP))
    sampled = np.isfinite(problem.measurements[segment])
    if not problem.located:
        sampled[:, 7:9] = False  # a position that is not a state explains no measurement
    chosen, limit = [], max(_FEWEST_KEPT, min(_KEPT, _INTEGRATED * len(t) // len(problem.t)))
    for column in sampled.T:
        seen = np.flatnonzero(column)
        chosen.append(seen[np.unique(np.linspace(0, len(seen) - 1, min(len(seen), limit)).astype(int))])
    at = np.unique(np.concatenate(chosen))
    dh = _reading_changes(path[at], inputs[at], problem.place, problem.flank, active, _STEP)
    J = dh[:, :, :m] @ _between(Z, t[grid], t[at])
    J[:, :, m:] += dh[:, :, m:]
    rows = []
    for c, kept in enumerate(chosen):
        if len(kept):
            weight = np.sqrt(sampled[:, c].sum() / len(kept)) / problem.measurement_std[c]
            rows.append(weight * J[np.searchsorted(at, kept), c] * std)
    factor: np.ndarray = np.linalg.qr(np.concatenate([*rows, np.zeros((L, L))]), mode="r")  # type: ignore[assignment]
    return factor


def _between(values: np.ndarray, t: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Linear interpolation of arrays along the first axis; those at the samples themselves are not changed."""
    later = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    weight = ((at - t[later - 1]) / (t[later] - t[later - 1]))[:, None, None]
    interpolated: np.ndarray = (1.0 - weight) * values[later - 1] + weight * values[later]
    return interpolated
