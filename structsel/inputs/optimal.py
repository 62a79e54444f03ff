"""Optimal inputs of [M86]: a finite sum of orthonormal functions, of fixed energy, with the best criterion.

The energy sum_i a_i^2 = E is kept by construction: the coefficients a are given by angles in spherical coordinates,
and Newton-Raphson works on these. To avoid their poles the frame is rotated at each step so that every angle of the
current a is pi/2. There, with Q an orthonormal basis of the space normal to a,

    da/dangle = -sqrt(E) Q,    d2a/dangle_i dangle_j = -a delta_ij

so with the criteria's own (see `structsel.inputs.criteria`) slope and curvature by the angles are exact.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy

from structsel.errors import DomainError
from structsel.inputs.criteria import DesignProblem

Basis = Literal["sines", "fourier", "legendre"]

_STEPS, _GENERATIONS = 200, 60  # maxima of Newton-Raphson and of the direct search; chosen, not critical
_GRADIENT = 1e-8  # length of the gradient by the angles, over 1 + |criterion|, at which Newton-Raphson has converged
_LONGEST_STEP = 0.5  # rad
_PENALTIES = (1e0, 1e2, 1e4)
_LARGEST_ENERGY = 10.0
_ENERGIES = 10  # tried between that at which a limit is reached and the given one


def orthonormal_functions(kind: Basis, count: int, n: int, dt: float) -> np.ndarray:
    """(count, n) functions with sum_k phi_i phi_j dt = delta_ij on samples 0 to n - 1.

    ``"sines"`` begin and end at zero, half a wave apart; ``"fourier"`` are complete cosines and sines without the
    constant; ``"legendre"`` are polynomials of rising degree, the constant first.

    Raises
    ------
    DomainError
        More functions than the samples can distinguish.
    """
    if not 1 <= count <= (n - 2) // 2:
        raise DomainError(f"{count} orthonormal functions on {n} samples: from 1 to {(n - 2) // 2} are possible.")
    x = np.arange(n) / (n - 1)
    order = np.arange(1, count + 1)[:, None]
    if kind == "sines":
        raw = np.sin(np.pi * order * x)
    elif kind == "fourier":
        cycles = (order + 1) // 2
        raw = np.where(order % 2 == 1, np.sin(2 * np.pi * cycles * x), np.cos(2 * np.pi * cycles * x))
    elif kind == "legendre":
        raw = np.polynomial.legendre.legvander(2.0 * x - 1.0, count - 1).T
    else:
        raise DomainError(f"orthonormal functions are 'sines', 'fourier' or 'legendre'; found {kind!r}.")
    Q, R = np.linalg.qr(raw.T)
    return np.ascontiguousarray((Q * np.sign(np.diag(R))).T) / np.sqrt(dt)


def spherical(angles: np.ndarray) -> np.ndarray:
    """Unit vector (b,) of spherical angles (b - 1,): cos x1, sin x1 cos x2, ..., sin x1 ... sin x(b-1)."""
    sines = np.concatenate([[1.0], np.cumprod(np.sin(angles))])
    return sines * np.concatenate([np.cos(angles), [1.0]])


def frame(direction: np.ndarray) -> np.ndarray:
    """Orthonormal (b, b) whose last column is a unit vector."""
    b = len(direction)
    sign = 1.0 if direction[-1] <= 0.0 else -1.0
    mirror = direction.copy()
    mirror[-1] -= sign  # away from zero, whichever way the vector points
    H = np.eye(b) - 2.0 * np.outer(mirror, mirror) / (mirror @ mirror)
    H[:, -1] *= sign
    return H


@dataclass(frozen=True)
class Optimum:
    """An optimum, and the course of its search.

    Attributes
    ----------
    a : (b,) array
    value : float
        Of the criterion, without the penalty.
    history : tuple of (float, float)
        Criterion with penalty, and length of the slope by the angles, at each Newton step.
    converged : bool
    """

    a: np.ndarray
    value: float
    history: tuple[tuple[float, float], ...]
    converged: bool


def newton(problem: DesignProblem, a: np.ndarray, weight: float = 0.0) -> Optimum:
    """Newton-Raphson on the spherical angles, from a (b,) of the problem's energy.

    Where the curvature is not positive the magnitudes of its eigenvalues are used, so that every step descends; it is
    halved until the criterion decreases.

    Parameters
    ----------
    problem : DesignProblem
    a : (b,) array
    weight : float
        Of the penalty on limits, over the criterion's magnitude at the start.
    """
    root = np.sqrt(problem.energy)
    a = root * a / np.linalg.norm(a)
    scale = weight * (1.0 if problem.criterion == "D" else abs(float(problem.values(a[None])[0])))

    def total(a: np.ndarray) -> float:
        value = float(problem.values(a[None])[0])
        return value + scale * problem.penalty(a)[0] if weight else value

    history, converged, value = [], False, total(a)
    for _ in range(_STEPS):
        _, g, H = problem.derivatives(a)
        if not np.isfinite(g).all():
            break
        if weight:
            _, slope, curvature = problem.penalty(a)
            g, H = g + scale * slope, H + scale * curvature
        rotated = frame(a / root)
        Q = rotated[:, :-1]
        slope = -root * Q.T @ g
        curvature = problem.energy * Q.T @ H @ Q - (a @ g) * np.eye(len(a) - 1)
        size = float(np.linalg.norm(slope))
        history.append((value, size))
        if size <= _GRADIENT * (abs(value) if problem.criterion != "D" else 1.0 + abs(value)):
            converged = True
            break
        w, Z = np.linalg.eigh(curvature)
        move = -Z @ ((Z.T @ slope) / np.maximum(np.abs(w), 1e-8 * np.abs(w).max()))
        move *= min(1.0, _LONGEST_STEP / np.linalg.norm(move))
        for _ in range(40):
            trial = root * rotated @ spherical(0.5 * np.pi + move)
            if (reached := total(trial)) < value:
                break
            move = 0.5 * move
        else:
            # No step descends any more: rounding decides, not the gradient.
            converged = size <= 1e-4 * (1.0 + abs(value))
            break
        a, value = trial, reached
    return Optimum(a, float(problem.values(a[None])[0]), tuple(history), converged)


def search(problem: DesignProblem, starts: np.ndarray, *, seed: int) -> np.ndarray:
    """Direct search: differential evolution over directions, from given starts and random ones.

    Parameters
    ----------
    problem : DesignProblem
    starts : (m, b) array
    seed : int

    Returns
    -------
    (m, b) array
        Start directions for Newton-Raphson, the best first, of the problem's energy.
    """
    b = starts.shape[1]
    root = np.sqrt(problem.energy)
    rng = np.random.default_rng(seed)
    pool = np.concatenate([starts, rng.standard_normal((max(8 * b, 40), b))])
    pool /= np.linalg.norm(pool, axis=1, keepdims=True)

    def cost(columns: np.ndarray) -> np.ndarray:
        size = np.linalg.norm(columns, axis=0)
        rows = root * (columns / np.where(size > 0.0, size, 1.0)).T
        value = problem.values(rows)
        return np.where(np.isfinite(value), value, 1e300)

    bounds = [(-1.0, 1.0)] * b
    evolved = scipy.optimize.differential_evolution(
        cost,
        bounds,
        init=pool,
        maxiter=_GENERATIONS,
        polish=False,
        vectorized=True,
        updating="deferred",
        rng=seed,
        tol=0.0,
    ).x
    candidates = np.concatenate([[evolved / np.linalg.norm(evolved)], pool[np.argsort(cost(pool.T))[:3]]])
    return root * candidates


def optimise(problem: DesignProblem, starts: np.ndarray, *, seed: int = 0) -> Optimum:
    """Best input of the problem's energy, without limits.

    Raises
    ------
    DomainError
        The information is singular for every input tried.
    """
    best: Optimum | None = None
    for a in search(problem, starts, seed=seed):
        if np.isfinite(problem.values(a[None])[0]):
            found = newton(problem, a)
            best = found if best is None or found.value < best.value else best
    if best is None:
        raise DomainError("the information matrix is singular for every input tried.")
    return best


def within_limits(problem: DesignProblem, free: Optimum, largest_energy: float | None) -> Optimum:
    """Best input within the limits and an energy.

    The free input is scaled until it reaches a limit. From there the energy rises in steps to `largest_energy`, each
    with increasing penalties on the excess; the remaining excess is scaled away. The best is kept.

    Parameters
    ----------
    problem : DesignProblem
    free : Optimum
        The best input without limits.
    largest_energy : float, optional
        Ten times that at which the free input reaches a limit by default.
    """

    def worst(a: np.ndarray) -> float:
        return float(np.abs(problem.limits @ a).max())

    if not len(problem.limits):
        return free
    over = worst(free.a)
    if largest_energy is None:
        largest_energy = _LARGEST_ENERGY * float(free.a @ free.a) / over**2
    if over * np.sqrt(largest_energy / (free.a @ free.a)) <= 1.0:
        return free
    a = free.a / over
    touching = float(a @ a)
    best = Optimum(a, float(problem.values(a[None])[0]), free.history, free.converged)
    worse = 0
    for energy in np.geomspace(touching, largest_energy, _ENERGIES + 1)[1:]:
        limited = replace(problem, energy=float(energy))
        for weight in _PENALTIES:
            found = newton(limited, a, weight)
            a = found.a
        inside = a / max(worst(a), 1.0)
        value = float(problem.values(inside[None])[0])
        if value < best.value:
            best, worse = Optimum(inside, value, found.history, found.converged), 0
        elif (worse := worse + 1) == 3:
            break
    return best
