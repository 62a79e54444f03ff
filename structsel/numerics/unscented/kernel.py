"""The passes forward and backward, compiled; the equations stand in the package's docstring."""

from __future__ import annotations

import numpy as np
from numba import njit

from structsel.numerics.kinematics import GUST, MOTION, STATES, noise_gain, observe, step
from structsel.numerics.unscented.triangular import gain_of, triangularise

_BETA = 2.0
_WIND = STATES.index("wn")  # from here on, constants that leave velocity and attitude alone
_LINEAR = 1e-3  # step of the central differences, in standard deviations
_MOST_REJECTED = 25  # in a row, of one channel: after that the filter, not the channel, may be wrong
STEEPEST = 1.55
"""Pitch attitude [rad] beyond which a run breaks down."""


@njit(cache=True)
def forward(  # type: ignore[no-untyped-def]
    first,
    last,
    t,
    inputs,
    input_std,
    measurements,
    measurement_std,
    circular,
    full,
    S,
    active,
    drift,
    place,
    flank,
    g,
    gust_time,
    located,
    spread,
    gate,
    waiting,
    x_out,
    std_out,
    innovations,
    innovation_std,
    nis,
    used,
    rejected,
    predicted,
    gains,
    lefts,
    store,
):
    """Filter samples first to last - 1; `full` and S are the state before and are left as the state after.

    Returns the log-likelihood, the sample that failed or -1, and why (1 steep, 2 not finite).
    """
    L, F, M = active.shape[0], full.shape[0], 12
    linear = spread == 0.0
    reach = _LINEAR if linear else spread * np.sqrt(L)
    w0 = 0.0 if linear else 1.0 - 1.0 / (spread * spread)
    wi = 0.5 if linear else 1.0 / (2.0 * spread * spread * L)
    centre = 0.0 if linear else np.sqrt(max(w0 + 1.0 - spread * spread + _BETA, 0.0))
    odd = 1.0 / (2.0 * reach) if linear else np.sqrt(0.5 * wi)
    drifting = 0
    for i in range(L):
        if drift[active[i]] > 0.0:
            drifting += 1
    noisy = L if linear else 2 * L + 1  # where the columns of process noise begin
    width = noisy + 6 + drifting
    A, B = np.empty((L, width)), np.empty((L, width))
    up, down, mid = np.empty((L, F)), np.empty((L, F)), np.empty(F)
    at, work = np.empty(F), np.empty((6, F))
    gain, level = np.empty((F, 6)), np.empty(6)
    y0, y_up, y_down = np.zeros(M), np.zeros((L, M)), np.zeros((L, M))
    mean, y_mean = np.empty(L), np.empty(M)
    O_y, Re, nu = np.empty((M, L)), np.empty((M, L + 1 + M)), np.empty(M)
    U = np.empty((M + L, M + L))
    wanted, kept = np.zeros(M, dtype=np.bool_), np.empty(M, dtype=np.int64)
    D = np.empty((L, width))
    total = 0.0
    for k in range(first, last):
        if k > 0:
            # ------------------------------------------------ prediction from k - 1
            dt = t[k] - t[k - 1]
            step(full, inputs[k - 1], inputs[k], dt, place, g, located, work, mid)
            fade = np.exp(-dt / gust_time)
            mid[GUST:] *= fade
            for i in range(L):
                for sign in range(2):
                    at[:] = full
                    way = reach if sign == 0 else -reach
                    for j in range(i, L):
                        at[active[j]] += way * S[j, i]
                    target = up[i] if sign == 0 else down[i]
                    if active[i] < _WIND:
                        step(at, inputs[k - 1], inputs[k], dt, place, g, located, work, target)
                        continue
                    # What moves only wind and instruments moves no motion but the position, and that linearly.
                    target[:MOTION] = mid[:MOTION]
                    target[MOTION:] = at[MOTION:]
                    target[8] -= dt * (at[17] - full[17])
                    if located:
                        target[6] += dt * (at[15] - full[15])
                        target[7] += dt * (at[16] - full[16])
            noise_gain(full, inputs[k], gain)
            for i in range(6):
                level[i] = dt * np.sqrt(0.5 * (input_std[k - 1, i] ** 2 + input_std[k, i] ** 2))
            A[:, :] = 0.0
            for j in range(L):
                a = active[j]
                mean[j] = mid[a]
                if a >= MOTION:  # constants stay where they are, to the last digit, and gusts die away
                    A[j, :L] = S[j] if a < GUST else fade * S[j]
                else:
                    for i in range(L):
                        A[j, i] = odd * (up[i, a] - down[i, a])
                        mean[j] += 0.0 if linear else wi * ((up[i, a] - mid[a]) + (down[i, a] - mid[a]))
                    if not linear:
                        for i in range(L):
                            A[j, L + i] = odd * ((up[i, a] - mean[j]) + (down[i, a] - mean[j]))
                        A[j, 2 * L] = centre * (mid[a] - mean[j])
                    for i in range(6):
                        A[j, noisy + i] = gain[a, i] * level[i]
                c = noisy + 6
                for i in range(L):
                    if drift[active[i]] > 0.0:
                        if i == j:
                            A[j, c] = drift[active[i]] * np.sqrt(dt)
                        c += 1
            B[:, :] = A
            triangularise(A, L, width)
            # States that are held move all the same: as the centre does.
            full[:] = mid
            for j in range(L):
                full[active[j]] = mean[j]
            if store:
                predicted[k - first] = mean
                # G = S O' (S- S-')^-1
                G = gains[k - first]
                for i in range(L):
                    for j in range(L):
                        sum_ = 0.0
                        for m in range(i + 1):
                            sum_ += S[i, m] * B[j, m]
                        G[i, j] = sum_
                gain_of(G, A, L, L)
                for i in range(L):
                    for c in range(width):
                        D[i, c] = S[i, c] if c < L else 0.0
                    for m in range(L):
                        weight = G[i, m]
                        for c in range(width):
                            D[i, c] -= weight * B[m, c]
                triangularise(D, L, width)
                lefts[k - first] = D[:, :L]
            for i in range(L):
                for j in range(L):
                    S[i, j] = A[i, j] if j <= i else 0.0
            if not np.isfinite(full[4]) or not np.isfinite(S[L - 1, L - 1]):
                return total, k, 2
            if abs(full[4]) > STEEPEST:
                return total, k, 1
        # ---------------------------------------------------- update with what was measured at k
        m = 0
        for c in range(M):
            wanted[c] = np.isfinite(measurements[k, c])
            if wanted[c]:
                kept[m] = c
                m += 1
        if m > 0:
            observe(full, inputs[k], place, flank, wanted, y0)
            for i in range(L):
                at[:] = full
                for j in range(i, L):
                    at[active[j]] += reach * S[j, i]
                observe(at, inputs[k], place, flank, wanted, y_up[i])
                for j in range(i, L):
                    at[active[j]] = full[active[j]] - reach * S[j, i]
                observe(at, inputs[k], place, flank, wanted, y_down[i])
            count = 0
            for b in range(m):
                c = kept[b]
                y_mean[c] = y0[c]
                if not linear:
                    sum_ = 0.0
                    for i in range(L):
                        sum_ += (y_up[i, c] - y0[c]) + (y_down[i, c] - y0[c])
                    y_mean[c] = y0[c] + wi * sum_
                difference = measurements[k, c] - y_mean[c]
                if circular[c]:
                    difference -= 2.0 * np.pi * np.round(difference / (2.0 * np.pi))
                variance = measurement_std[c] ** 2
                for i in range(L):
                    O_y[count, i] = odd * (y_up[i, c] - y_down[i, c])
                    variance += O_y[count, i] ** 2
                    Re[count, i] = 0.0
                    if not linear:
                        Re[count, i] = odd * ((y_up[i, c] - y_mean[c]) + (y_down[i, c] - y_mean[c]))
                        variance += Re[count, i] ** 2
                Re[count, L] = centre * (y0[c] - y_mean[c])
                variance += Re[count, L] ** 2
                innovations[k, c] = difference
                innovation_std[k, c] = np.sqrt(variance)
                if gate > 0.0 and abs(difference) > gate * np.sqrt(variance) and waiting[c] < _MOST_REJECTED:
                    rejected[k, c] = True
                    waiting[c] += 1
                    continue
                waiting[c] = 0
                nu[count] = difference
                kept[count] = c
                count += 1
            m = count
        used[k] = m
        if m > 0:
            for b in range(m):
                for c in range(m):
                    Re[b, L + 1 + c] = measurement_std[kept[b]] if b == c else 0.0
            if linear:
                for b in range(m):
                    for c in range(m):
                        Re[b, c] = Re[b, L + 1 + c]
            else:
                triangularise(Re, m, L + 1 + m)
            for b in range(m):
                for c in range(m):
                    U[b, c] = Re[b, c]
                for i in range(L):
                    U[b, m + i] = O_y[b, i]
            for i in range(L):
                for c in range(m):
                    U[m + i, c] = 0.0
                for j in range(L):
                    U[m + i, m + j] = S[i, j]
            triangularise(U, m + L, m + L)
            square = 0.0
            for b in range(m):
                value = nu[b]
                for c in range(b):
                    value -= U[b, c] * nu[c]
                value /= U[b, b]
                nu[b] = value
                square += value * value
                total -= np.log(abs(U[b, b]))
            for i in range(L):
                move = 0.0
                for b in range(m):
                    move += U[m + i, b] * nu[b]
                full[active[i]] += move
                for j in range(i + 1):
                    S[i, j] = U[m + i, m + j]
            nis[k] = square
            total -= 0.5 * (square + m * np.log(2.0 * np.pi))
        for j in range(L):
            x_out[k, j] = full[active[j]]
            sum_ = 0.0
            for i in range(j + 1):
                sum_ += S[j, i] * S[j, i]
            std_out[k, j] = np.sqrt(sum_)
    return total, -1, 0


@njit(cache=True)
def backward(first, last, x, S, x_filtered, predicted, gains, lefts, x_out, std_out, cov_out, stride):  # type: ignore[no-untyped-def]
    """Smooth samples last - 2 to first - 1; x and S are those of sample last - 1 and are left as of first - 1."""
    L = x.shape[0]
    A, later = np.empty((L, 2 * L)), np.empty(L)
    for k in range(last - 1, first - 1, -1):
        G = gains[k - first]
        for j in range(L):
            later[j] = x[j] - predicted[k - first, j]
        for i in range(L):
            move = 0.0
            for j in range(L):
                move += G[i, j] * later[j]
                A[i, j] = lefts[k - first, i, j] if j <= i else 0.0
                A[i, L + j] = 0.0
            for c in range(L):
                weight = G[i, c]
                for j in range(c + 1):
                    A[i, L + j] += weight * S[c, j]
            x[i] = x_filtered[k - 1, i] + move
        triangularise(A, L, 2 * L)
        for i in range(L):
            for j in range(L):
                S[i, j] = A[i, j] if j <= i else 0.0
        keep(k - 1, x, S, x_out, std_out, cov_out, stride)


@njit(cache=True)
def keep(k, x, S, x_out, std_out, cov_out, stride):  # type: ignore[no-untyped-def]
    """Write down one smoothed sample; its covariance, where it is one of those handed out."""
    L = x.shape[0]
    x_out[k] = x
    for i in range(L):
        sum_ = 0.0
        for j in range(i + 1):
            sum_ += S[i, j] * S[i, j]
        std_out[k, i] = np.sqrt(sum_)
    if k % stride == 0:
        cov_out[k // stride] = S @ S.T
