"""The steady Kalman gain of many linear systems at once."""

from __future__ import annotations

import numpy as np
from scipy import linalg

_DOUBLINGS = 60  # 2^60 samples: what has not settled by then never does
_SETTLED = 1e-12


def sampled(A: np.ndarray, noise: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Transition and covariance over one sample of x' = A x + w, w white.

    Parameters
    ----------
    A : (m, s, s) array [1/s]
    noise : (m, s) array [unit of the state / sqrt(s)]
        Standard deviations of w per root of a second.
    dt : float [s]

    Returns
    -------
    Phi, Q : (m, s, s) array
        NaN where A is not finite or too fast for its exponential.
    """
    m, s = noise.shape
    block = np.zeros((m, 2 * s, 2 * s))
    block[:, :s, :s], block[:, s:, s:] = -A * dt, np.swapaxes(A, 1, 2) * dt
    block[:, range(s), range(s, 2 * s)] = noise**2 * dt
    sound = np.isfinite(block).all(axis=(1, 2))
    step = np.full_like(block, np.nan)
    with np.errstate(all="ignore"):
        step[sound] = linalg.expm(block[sound]) if sound.any() else step[sound]
        Phi = np.swapaxes(step[:, s:, s:], 1, 2)
        Q = Phi @ step[:, :s, s:]
    return Phi, 0.5 * (Q + np.swapaxes(Q, 1, 2))


def steady_gain(Phi: np.ndarray, C: np.ndarray, Q: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gain of the Kalman filter once it has settled, and the covariance of its predictions.

    ::

        P = Phi (P - K C P) Phi' + Q            K = P C' (C P C' + R)^-1

    solved by doubling: each step spans twice the samples of the last.

    Parameters
    ----------
    Phi, Q : (m, s, s) array
    C : (m, c, s) array
    R : (m, c) array
        Variances of the measurements, above zero.

    Returns
    -------
    K : (m, s, c) array
        NaN where there is no steady gain, as for a growing motion that no output shows.
    P : (m, s, s) array
        Covariance of the state before its sample is let in.
    """
    m, s = Phi.shape[:2]
    eye = np.eye(s)
    K, P = np.full((m, s, C.shape[1]), np.nan), np.full((m, s, s), np.nan)
    sound = np.flatnonzero(np.isfinite(sum(a.reshape(m, -1).sum(axis=1) for a in (Phi, C, Q, R))))
    if not sound.size:
        return K, P
    C, R = C[sound], R[sound]
    Ct = np.swapaxes(C, 1, 2)
    G = (Ct / R[:, None, :]) @ C
    size = np.sqrt(np.diagonal(G, axis1=1, axis2=2))
    size = np.where(size > 0.0, size, 1.0)  # in these units the measurements say as much of every state
    outer = size[:, :, None] * size[:, None, :]
    G, H = G / outer, Q[sound] * outer
    A = np.swapaxes(Phi[sound] * size[:, :, None] / size[:, None, :], 1, 2)
    with np.errstate(all="ignore"):
        for _ in range(_DOUBLINGS):
            W = eye + G @ H
            try:
                WA, WG = np.linalg.solve(W, A), np.linalg.solve(W, G)
            except np.linalg.LinAlgError:
                return K, P
            At = np.swapaxes(A, 1, 2)
            more = At @ H @ WA
            G, H, A = G + A @ WG @ At, H + 0.5 * (more + np.swapaxes(more, 1, 2)), A @ WA
            left = np.abs(more).max(axis=(1, 2)) / np.abs(H).max(axis=(1, 2))
            if not (left > _SETTLED).any():
                break
        H = np.where((left <= _SETTLED)[:, None, None] & np.isfinite(H), H, np.nan)
        P[sound] = H / outer
    found = np.flatnonzero(np.isfinite(P).all(axis=(1, 2))[sound])
    if found.size:
        PC = P[sound][found] @ Ct[found]
        S = C[found] @ PC
        S[:, range(S.shape[1]), range(S.shape[1])] += R[found]
        K[sound[found]] = np.swapaxes(np.linalg.solve(S, np.swapaxes(PC, 1, 2)), 1, 2)
    return K, P
