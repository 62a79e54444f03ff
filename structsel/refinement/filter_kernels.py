"""Filter error of linear models: the steady Kalman gain of many systems, and their predictions sample by sample.

Process noise w, for example turbulence, moves the states in addition to the inputs. The innovations v correct the
states through a steady Kalman gain K::

    x' = f(x, u) + w                        v[k] = z[k] - y(x[k], u[k])
    z  = y(x, u) + n                        x[k] <- x[k] + K v[k], then on to the next sample

With K = 0 this is the simulation in open loop. The innovations take the place of the residuals in
`structsel.numerics.output_error`.

References
----------
[KM16], filter error; [J15], filter error with a steady gain.
"""

from __future__ import annotations

import numpy as np

from structsel.numerics.compiling import njit
from structsel.numerics.linear_systems import discretise_noise

_DOUBLINGS = 60  # 2^60 samples: a gain that is not steady by then never is
_CONVERGED = 1e-12
_DIVERGED = 1e100


def diagonal(values: np.ndarray) -> np.ndarray:
    """(m, s, s) diagonal matrices of (m, s) values."""
    return values[:, :, None] * np.eye(values.shape[1])


def steady_gain(Phi: np.ndarray, C: np.ndarray, Q: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gain of the Kalman filter in its steady state, and the covariance of its predictions.

    ::

        P = Phi (P - K C P) Phi' + Q            K = P C' (C P C' + R)^-1

    solved by doubling: each step spans twice the samples of the last. All sets are solved at once. One
    ``scipy.linalg.solve_discrete_are`` for each set gives the same gains and took 4.1 s of a filter-error refinement of
    the HFB-320 record (3,945 sets, 24 s without it); this takes 0.24 s.

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
            if not (left > _CONVERGED).any():
                break
        H = np.where((left <= _CONVERGED)[:, None, None] & np.isfinite(H), H, np.nan)
        P[sound] = H / outer
    found = np.flatnonzero(np.isfinite(P).all(axis=(1, 2))[sound])
    if found.size:
        PC = P[sound][found] @ Ct[found]
        S = C[found] @ PC
        S[:, range(S.shape[1]), range(S.shape[1])] += R[found]
        K[sound[found]] = np.swapaxes(np.linalg.solve(S, np.swapaxes(PC, 1, 2)), 1, 2)
    return K, P


def predict_linear(
    Phi: np.ndarray, state_input: np.ndarray, C: np.ndarray, feedthrough: np.ndarray, x0: np.ndarray, gain: np.ndarray,
    measured: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Outputs predicted for each sample from the measurements before it.

    Parameters
    ----------
    Phi : (m, s, s) array
        From one sample to the next.
    state_input : (m, n - 1, s) array
        What inputs and drifts add over each interval.
    C : (m, c, s) array
    feedthrough : (m, n, c) array
        Outputs of a state of zero.
    x0 : (m, s) array
    gain : (m, s, c) array
    measured : (m, n, c) array
        NaN where not sampled: such a sample corrects nothing.

    Returns
    -------
    (m, n, c) array
        NaN from where a set diverged.
    """
    y = np.full(feedthrough.shape, np.nan)
    arrays = [np.ascontiguousarray(a, dtype=float) for a in (Phi, state_input, C, feedthrough, x0, gain, measured)]
    _predict(*arrays, y)  # type: ignore[call-arg]
    return y


def sampled_gain(
    A: np.ndarray, C: np.ndarray, process: np.ndarray, variances: np.ndarray, dt: float
) -> tuple[np.ndarray, np.ndarray]:
    """Steady gain (m, s, c) of continuous systems, and the variance (m, c) of their outputs from that of the states.

    Parameters
    ----------
    A : (m, s, s) array
    C : (m, c, s) array
    process : (m, s) array
        Intensities of the process noise, the square roots of its spectral densities.
    variances : (m, c) array
        Of the measurements.
    dt : float [s]
    """
    Phi, Q = discretise_noise(A, diagonal(process**2), dt)
    K, P = steady_gain(Phi, C, Q, variances)
    return K, np.einsum("mcs,mst,mct->mc", C, P, C)


@njit(cache=True, nogil=True, error_model="numpy")
def _predict(Phi, state_input, C, feedthrough, x0, gain, measured, y):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    m, n, c = feedthrough.shape
    s = x0.shape[1]
    x, moved = np.empty(s), np.empty(s)
    for j in range(m):
        x[:] = x0[j]
        for k in range(n):
            for a in range(c):
                total = feedthrough[j, k, a]
                for i in range(s):
                    total += C[j, a, i] * x[i]
                y[j, k, a] = total
            for a in range(c):
                v = measured[j, k, a] - y[j, k, a]
                if np.isfinite(v):
                    for i in range(s):
                        x[i] += gain[j, i, a] * v
            if k == n - 1:
                break
            lost = False
            for i in range(s):
                total = state_input[j, k, i]
                for l in range(s):
                    total += Phi[j, i, l] * x[l]
                moved[i] = total
                lost = lost or not abs(total) < _DIVERGED
            if lost:
                break
            x[:] = moved
