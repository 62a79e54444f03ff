"""Signals whose derivatives are known exactly."""

import numpy as np
from scipy.linalg import expm


def step_response(dt=0.04, seconds=20.0, width=0.7):
    """Time, angle of attack and pitch rate with their derivatives after a 3-2-1-1 of the elevator.

    A short period x' = A x + B u, solved over each constant segment of u by the matrix exponential, so that
    x is exact and x' follows from the state equation (just after an edge of u, its right-hand limit).
    """
    A = np.array([[-1.0, 1.0], [-6.0, -1.4]])
    B = np.array([-0.1, -8.0])
    edges = 2.0 + width * np.array([0, 3, 5, 6, 7])
    levels = 0.05 * np.array([0, 1, -1, 1, -1, 0])
    t = dt * np.arange(round(seconds / dt) + 1)
    x, u = np.zeros((t.size, 2)), levels[np.searchsorted(edges, t + 1e-9, side="right")]
    for k in range(1, t.size):
        now, state = t[k - 1], x[k - 1]
        while now < t[k] - 1e-9:
            level = levels[np.searchsorted(edges, now + 1e-9, side="right")]
            ahead = edges[edges > now + 1e-9]
            until = min(t[k], ahead[0]) if ahead.size else t[k]
            rest = np.linalg.solve(A, B * level)
            state = expm(A * (until - now)) @ (state + rest) - rest
            now = until
        x[k] = state
    return t, x, x @ A.T + u[:, None] * B


def sine(cycles_per_sample, dt=0.04, seconds=20.0):
    """Time, a sine and its derivative."""
    t = dt * np.arange(round(seconds / dt) + 1)
    w = 2 * np.pi * cycles_per_sample / dt
    return t, np.sin(w * t + 0.3), w * np.cos(w * t + 0.3)
