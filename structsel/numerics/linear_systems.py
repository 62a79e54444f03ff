"""Linear systems with a delay, simulated exactly and many at once.

::

    x'(t) = A x(t) + B u(t - delay) + bias          y(t) = C x(t) + D u(t - delay) + y_ref

Between samples the input is held or linear, and the solution over one interval is a matrix exponential. A delay of
d + s intervals, d an integer and s a fraction, moves the corner of the input to the fraction s of the interval. The
interval is solved in two parts, and

    x[k+1] = Phi x[k] + G0 u[k-d-1] + G1 u[k-d] + G2 u[k-d+1] + g

holds exactly, with G2 zero for held inputs. ``scipy.signal.lsim`` and ``control.forced_response`` have neither a delay
of a fraction of a sample nor a batch of systems, and are loops in Python.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import scipy

from structsel.errors import DomainError
from structsel.numerics.compiling import njit

Hold = Literal["hold", "linear"]

_DIVERGED = 1e100
"""A state beyond this has diverged; its square would overflow."""


def discretise(A: np.ndarray, B: np.ndarray, h: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Exact step of x' = A x + B u over h, the input running linearly from u0 to u1.

    ::

        x(h) = Phi x(0) + held u0 + ramp (u1 - u0)

    With the input held at u0 the last term is zero.

    Parameters
    ----------
    A : (m, ns, ns) array
    B : (m, ns, ni) array
    h : (m,) array [s]
        Zero is allowed.

    Returns
    -------
    Phi : (m, ns, ns) array
    held, ramp : (m, ns, ni) array
    """
    m, ns, ni = B.shape
    block = np.zeros((m, ns + 2 * ni, ns + 2 * ni))
    h = h[:, None, None]
    block[:, :ns, :ns] = A * h
    block[:, :ns, ns : ns + ni] = B * h
    block[:, ns : ns + ni, ns + ni :] = np.eye(ni)  # the ramp reaches one at the end of the step
    step = _exponential(block)
    return step[:, :ns, :ns], step[:, :ns, ns : ns + ni], step[:, :ns, ns + ni :]


def discretise_noise(A: np.ndarray, intensity: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Transition and covariance over one sample of x' = A x + w, w white, by Van Loan's block exponential.

    Parameters
    ----------
    A : (m, s, s) array [1/s]
    intensity : (m, s, s) array
        Covariance of w per second.
    dt : float [s]

    Returns
    -------
    Phi, Q : (m, s, s) array
        NaN where A is not finite or too fast for its exponential.
    """
    s = A.shape[-1]
    zero = np.zeros_like(A)
    block = np.block([[-A * dt, intensity * dt], [zero, np.swapaxes(A, 1, 2) * dt]])
    with np.errstate(all="ignore"):
        step = _exponential(block)
        Phi = np.swapaxes(step[:, s:, s:], 1, 2)
        Q = Phi @ step[:, :s, s:]
    return Phi, 0.5 * (Q + np.swapaxes(Q, 1, 2))


def _exponential(block: np.ndarray) -> np.ndarray:
    """(m, k, k) exponentials; NaN where a matrix is not finite or its exponential overflows."""
    finite = np.isfinite(block).all(axis=(1, 2))
    step = np.full_like(block, np.nan)
    with np.errstate(all="ignore"):
        step[finite] = scipy.linalg.expm(block[finite]) if finite.any() else step[finite]
    return step


def interval(
    A: np.ndarray, B: np.ndarray, dt: float, part: np.ndarray, hold: Hold
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Step over one sampling interval whose input has its corner after the fraction `part` of it.

    Parameters
    ----------
    A : (m, ns, ns) array
    B : (m, ns, ni) array
    dt : float [s]
    part : (m,) array [-]
        From 0 to below 1.
    hold : {"hold", "linear"}

    Returns
    -------
    Phi : (m, ns, ns) array
    after : (m, ns, ns) array
        The step from the corner to the end.
    G : (3, m, ns, ni) array
        Weights of u[k-d-1], u[k-d], u[k-d+1].
    """
    G = np.zeros((3, *B.shape))
    s = part[:, None, None]
    after, held_b, ramp_b = discretise(A, B, (1.0 - part) * dt)
    if (part == 0.0).all():
        before, held_a, ramp_a = np.broadcast_to(np.eye(A.shape[-1]), A.shape), np.zeros_like(B), np.zeros_like(B)
    else:
        before, held_a, ramp_a = discretise(A, B, part * dt)
    with np.errstate(all="ignore"):
        first_held, first_ramp = after @ held_a, after @ ramp_a
        if hold == "hold":
            G[0], G[1] = first_held, held_b
        else:  # up to the corner from s u[k-d-1] + (1-s) u[k-d] to u[k-d]; then to s u[k-d] + (1-s) u[k-d+1]
            G[0] = s * (first_held - first_ramp)
            G[1] = (1.0 - s) * first_held + s * first_ramp + held_b - (1.0 - s) * ramp_b
            G[2] = (1.0 - s) * ramp_b
        return after @ before, after, G


def split_delay(delay: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Complete intervals of a delay, and the remaining fraction of one; integers have a tolerance of 1e-9."""
    intervals = np.asarray(delay, dtype=float) / dt
    delay_steps = np.floor(intervals + 1e-9)
    return delay_steps.astype(np.int64), np.clip(intervals - delay_steps, 0.0, None)


def previous_input(u: np.ndarray, dt: float, delay: float, hold: Hold = "hold") -> np.ndarray:
    """Delayed input u(t - delay) at the samples, (n, ni).

    Before the record every input has its first value. At an edge of a held input the later value is used.
    """
    d, s = split_delay(np.asarray(delay), dt)
    k = np.arange(len(u)) - int(d)
    now, before = u[np.clip(k, 0, None)], u[np.clip(k - 1, 0, None)]
    if s == 0.0:
        return now
    return before if hold == "hold" else (1.0 - s) * now + s * before


def simulate_linear(
    A: np.ndarray,
    B: np.ndarray,
    C: np.ndarray,
    D: np.ndarray,
    u: np.ndarray,
    dt: float,
    *,
    delay: np.ndarray | float = 0.0,
    bias: np.ndarray | float = 0.0,
    y_ref: np.ndarray | float = 0.0,
    x0: np.ndarray | float = 0.0,
    hold: Hold = "hold",
    return_states: bool = False,
) -> np.ndarray | tuple[np.ndarray, np.ndarray]:
    """Outputs at the samples of x' = A x + B u(t - delay) + bias, y = C x + D u(t - delay) + y_ref.

    Every array may carry a leading axis of m members (parameter sets); those that do not are common to all. Exact
    for inputs held ("hold") or linear ("linear") between samples and for any delay; before the record each input has
    its first value. A member that diverges, |x| beyond 1e100 or no longer a number, is nan from there on.

    Parameters
    ----------
    A, B, C, D : arrays
        (ns, ns), (ns, ni), (no, ns), (no, ni), or (m, ...).
    u : (n, ni) or (m, n, ni) array
    dt : float [s]
    delay : float or (m,) array [s]
    bias, x0 : (ns,) or (m, ns) array
    y_ref : (no,) or (m, no) array
    hold : {"hold", "linear"}
    return_states : bool
        Return the states as well.

    Returns
    -------
    y : (n, no) array, or (m, n, no) where anything had a leading axis
    x : (n, ns) or (m, n, ns) array
        Only where `return_states`.

    Raises
    ------
    DomainError
        An input that is not finite, a step that is not above zero, a delay below zero or longer than the record.
    """
    A, B, C, D, u = (np.asarray(a, dtype=float) for a in (A, B, C, D, u))
    ns, no = A.shape[-1], C.shape[-2]
    given = {"A": (A, 2), "B": (B, 2), "C": (C, 2), "D": (D, 2), "u": (u, 2), "delay": (np.asarray(delay, float), 0)}
    for name, value, size in (("bias", bias, ns), ("x0", x0, ns), ("y_ref", y_ref, no)):
        array = np.asarray(value, dtype=float)
        given[name] = (np.full(size, array) if array.ndim == 0 else array, 1)
    sizes = {name: a.shape[0] for name, (a, plain) in given.items() if a.ndim > plain}
    if len(set(sizes.values())) > 1:
        raise DomainError(f"simulate_linear: leading axes differ: {sizes}. Give all the same number of members.")
    m = next(iter(sizes.values()), 1)
    n = u.shape[-2]
    _check(u, n, dt, given["delay"][0])

    def members(name: str) -> np.ndarray:
        a, plain = given[name]
        return a if a.ndim > plain else a[None]

    # Steps are computed once if A, B and the delay are common to all members.
    step_from = [members(name) for name in ("A", "B", "delay", "bias")]
    k = max(a.shape[0] for a in step_from)
    A_, B_, delay_, bias_ = (np.broadcast_to(a, (k, *a.shape[1:])) for a in step_from)
    delay_steps, part = split_delay(delay_, dt)
    Phi, _, G = interval(A_, B_, float(dt), part, hold)
    drift = np.zeros((k, ns))
    if (bias_ != 0.0).any():
        drift = discretise(A_, bias_[:, :, None], np.full(k, float(dt)))[1][:, :, 0]
    x = np.empty((m, n, ns))
    start, inputs = members("x0"), members("u")
    advance(Phi, G, drift, delay_steps, np.ascontiguousarray(inputs), np.ascontiguousarray(start), x)
    y = read_outputs(x, members("C"), members("D"), members("y_ref"), inputs, delay_steps, part, hold)
    if not sizes:
        y, x = y[0], x[0]
    return (y, x) if return_states else y


def _check(u: np.ndarray, n: int, dt: float, delay: np.ndarray) -> None:
    if not dt > 0.0:
        raise DomainError(f"simulate_linear needs a time step above zero; found dt = {dt} s.")
    if not np.isfinite(u).all():
        i = int(np.argwhere(~np.isfinite(u))[0][-2])
        raise DomainError(
            f"simulate_linear needs finite inputs; sample {i} (t = {i * dt:g} s) is not. Interpolate it, or split the "
            "recording there."
        )
    bad = np.atleast_1d((~np.isfinite(delay)) | (delay < 0.0) | (delay >= n * dt))
    if bad.any():
        value = np.atleast_1d(delay)[bad][0]
        raise DomainError(
            f"simulate_linear was given a delay of {value:g} s; the record lasts {(n - 1) * dt:g} s. A delay lies "
            "between zero and the record's length: bound it, or check its unit (seconds)."
        )


def read_outputs(
    x: np.ndarray,
    C: np.ndarray,
    D: np.ndarray,
    y_ref: np.ndarray,
    u: np.ndarray,
    delay_steps: np.ndarray,
    part: np.ndarray,
    hold: Hold,
) -> np.ndarray:
    """Outputs (m, n, no) of states (m, n, ns); any other array's leading axis may be one."""
    y = x @ np.swapaxes(C, -1, -2)
    y += y_ref[:, None, :]
    if (D != 0.0).any():
        k = np.arange(u.shape[1])[None, :] - delay_steps[:, None]
        rows = np.arange(max(len(u), len(k)))[:, None]
        which = rows if len(u) > 1 else 0
        now = u[which, np.clip(k, 0, None)]
        if (part > 0.0).any():
            before = u[which, np.clip(k - 1, 0, None)]
            s = part[:, None, None]
            weight = (s > 0.0).astype(float) if hold == "hold" else s
            now = (1.0 - weight) * now + weight * before
        y += now @ np.swapaxes(D, -1, -2)
    return y


@njit(nogil=True, cache=True, error_model="numpy")
def advance(
    Phi: np.ndarray,
    G: np.ndarray,
    drift: np.ndarray,
    delay_steps: np.ndarray,
    u: np.ndarray,
    x0: np.ndarray,
    x: np.ndarray,
) -> None:
    """Fill x (m, n, ns); arrays with a leading axis of one are common to all members."""
    m, n, ns = x.shape
    ni = u.shape[2]
    for j in range(m):
        a = j if Phi.shape[0] > 1 else 0
        b = j if u.shape[0] > 1 else 0
        c = j if x0.shape[0] > 1 else 0
        d = delay_steps[a]
        for i in range(ns):
            x[j, 0, i] = x0[c, i]
        for k in range(n - 1):
            k0 = max(k - d - 1, 0)
            k1 = max(k - d, 0)
            k2 = max(k - d + 1, 0)
            lost = False
            for i in range(ns):
                total = drift[a, i]
                for l in range(ns):
                    total += Phi[a, i, l] * x[j, k, l]
                for l in range(ni):
                    total += G[0, a, i, l] * u[b, k0, l] + G[1, a, i, l] * u[b, k1, l] + G[2, a, i, l] * u[b, k2, l]
                x[j, k + 1, i] = total
                lost = lost or not abs(total) < _DIVERGED
            if lost:
                x[j, k + 1 :, :] = np.nan
                break
