"""Two older optimal inputs, to compare with: Mehra's in the frequency domain, Schulz's in the time domain.

*Mehra-type*, implemented so: in steady state, a line of power P_l at frequency w_l adds P_l M_l to the information
matrix, M_l = Re S(jw_l)^H inv(R) S(jw_l) per unit, with S(jw) the transfer function of the sensitivities. The powers
that minimise ln det inv(M) for a given sum are found by the multiplicative rule P_l <- P_l tr(inv(M) M_l) / k, which
rises monotonically and ends where no tr(inv(M) M_l) exceeds k, the equivalence theorem's proof of the optimum [MR74].
The lines become a multisine with optimised phases.

*Schulz-type*, implemented so: the samples themselves are the unknowns, and trace(W M) is maximised under an energy
constraint. For a linear system that is a linear-quadratic two-point boundary value problem, whose non-trivial solution
(where the Riccati equation has its conjugate point at the final time) is the leading eigenfunction of the operator
sum_a w_a S_a* S_a; it is found by Lanczos iteration, each step one forward sweep of the sensitivities and one backward
sweep of their adjoints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import scipy

from structsel.errors import ModelError
from structsel.inputs.information import select_parameters, sensitivities
from structsel.inputs.multisine import phased
from structsel.inputs.signals import clock
from structsel.recording import Recording
from structsel.simulation.linear import LinearModel

_TOLERANCE, _ITERATIONS = 1e-6, 20000  # relative excess over the optimum, and most steps to it
_FRACTION = 1e-3  # of the total power: lines below are left out of the multisine


def sensitivity_response(
    model: LinearModel, names: tuple[str, ...], omega: np.ndarray, noise: Mapping[str, float]
) -> np.ndarray:
    """Transfer functions of the sensitivities over the noise, (l, outputs, k, inputs), at frequencies [rad/s]."""
    f, s = model.family.keep(names, model.theta), model.system
    jw = 1j * omega[:, None, None]
    G = np.linalg.inv(jw * np.eye(len(s.states)) - s.A)  # (l, ns, ns)
    X = G @ s.B
    Y = s.C @ X + s.D
    S = (s.C @ G)[:, None] @ (f.dA @ X[:, None] + f.dB) + f.dC @ X[:, None] + f.dD
    S = S - f.ddelay[None, :, None, None] * jw[..., None] * Y[:, None]
    columns = [model.outputs.index(o) for o in noise]
    S = S * np.exp(-jw * float(s.delay))[..., None]
    scaled = S[:, :, columns] / np.array(list(noise.values()))[:, None]
    return scaled.transpose(0, 2, 1, 3)


def mehra(
    model: LinearModel,
    *,
    noise: Mapping[str, float],
    energy: float,
    low: float,
    high: float,
    parameters: Sequence[str] | None = None,
    scales: Mapping[str, float] | None = None,
    duration: float = 20.0,
    dt: float = 0.02,
    seed: int = 0,
) -> Recording:
    """Mehra-type input: the line spectrum of least ln det of the covariance, phased for a low peak.

    Parameters
    ----------
    model : LinearModel
    noise, parameters
        As `information` takes them.
    energy : float
        As `structsel.inputs.energy` counts it.
    low, high : float [Hz]
        Band; its harmonics of 1 / duration are assigned to the inputs in turn.
    scales : mapping of str to float, optional
        Unit of each input in the energy.
    duration, dt : float [s]
    seed : int
        Of the phase search.

    Raises
    ------
    ModelError
        Too few lines in the band for the parameters.

    References
    ----------
    [M86], [MR74]
    """
    names = select_parameters(model, parameters)
    t = clock(duration, dt)
    n = len(t) - 1
    lines = np.arange(max(int(np.ceil(low * duration)), 1), int(np.floor(high * duration)) + 1)
    k, ni = len(names), len(model.inputs)
    if 2 * len(lines) * len(noise) < k or len(lines) < ni:
        raise ModelError(
            f"a Mehra-type input for {k} parameters needs more than the {len(lines)} harmonics of {1 / duration:g} Hz "
            f"between {low:g} and {high:g} Hz. Widen the band or lengthen the record."
        )
    S = sensitivity_response(model, names, 2.0 * np.pi * lines / duration, noise)
    which = np.arange(len(lines)) % ni
    weight = np.array([(scales or {}).get(c, 1.0) for c in model.inputs])[which]
    own = S[np.arange(len(lines)), :, :, which] * weight[:, None, None]
    M = np.einsum("lok,lom->lkm", own.conj(), own).real
    power = optimal_powers(M)
    made = {}
    for i, channel in enumerate(model.inputs):
        own_lines = (which == i) & (power > _FRACTION)
        wave = np.zeros(n)
        if own_lines.any():
            wave = phased(lines[own_lines], power[own_lines], n, seed=seed)
        made[channel] = np.append(wave, wave[0]) * (scales or {}).get(channel, 1.0)
    total = sum(float(((v / (scales or {}).get(c, 1.0)) ** 2).sum()) for c, v in made.items()) * dt
    made = {c: v * np.sqrt(energy / total) for c, v in made.items()}
    kept = ", ".join(f"{line / duration:.3g} Hz {p:.0%}" for line, p in zip(lines, power) if p > _FRACTION)
    return Recording("Mehra", t, made, provenance=(f"Mehra-type input: {kept}",))


def optimal_powers(M: np.ndarray) -> np.ndarray:
    """Powers (l,), adding to one, of least ln det inv(sum_l P_l M_l), for M (l, k, k).

    Raises
    ------
    ModelError
        All lines together leave the information singular.
    """
    lines, k = M.shape[:2]
    size = np.sqrt(np.einsum("lii->i", M))
    if not (size > 0.0).all() or np.linalg.cond(M.sum(axis=0) / np.outer(size, size)) > 1e12:
        raise ModelError(
            "no line spectrum in this band separates all the parameters. Hold one fixed or widen the band."
        )
    flat = (M / np.outer(size, size)).reshape(lines, k * k)
    power = np.full(lines, 1.0 / lines)
    for _ in range(_ITERATIONS):
        gain = flat @ np.linalg.inv((power @ flat).reshape(k, k)).ravel()
        if gain.max() <= k * (1.0 + _TOLERANCE):
            break
        power = power * gain / k
        power /= power.sum()
    return power


def schulz(
    model: LinearModel,
    *,
    noise: Mapping[str, float],
    energy: float,
    parameters: Sequence[str] | None = None,
    parameter_scales: Mapping[str, float] | None = None,
    scales: Mapping[str, float] | None = None,
    duration: float = 20.0,
    dt: float = 0.02,
) -> Recording:
    """Schulz-type input: sample by sample, the largest trace of the information about parameters.

    Parameters
    ----------
    model : LinearModel
    noise, parameters, scales, energy, duration, dt
        As `mehra` takes them.
    parameter_scales : mapping of str to float, optional
        Unit of the change of each parameter; its value by default.

    References
    ----------
    [M86]
    """
    names = select_parameters(model, parameters)
    t = clock(duration, dt)
    n, ni = len(t), len(model.inputs)
    size = np.array([(scales or {}).get(c, 1.0) for c in model.inputs])
    pulses = np.zeros((ni, n + 1, ni))  # the sample before, because an input has its first value before the record
    pulses[np.arange(ni), 1, np.arange(ni)] = size
    h = sensitivities(model, names, pulses, dt, noise, "hold")
    h = (h - sensitivities(model, names, 0.0 * pulses[:1], dt, noise, "hold"))[:, len(noise) :]
    h = h.reshape(ni, n, len(noise), len(names))
    h = h * np.array([(parameter_scales or {}).get(p, model.parameters[p]) for p in names])
    length = scipy.fft.next_fast_len(2 * n, real=True)
    H = scipy.fft.rfft(h.reshape(ni, n, -1), length, axis=1)

    def sweep(v: np.ndarray) -> np.ndarray:
        U = scipy.fft.rfft(v.reshape(n, ni).T, length, axis=1)
        forward = scipy.fft.irfft(np.einsum("if,ifr->fr", U, H), length, axis=0)[:n]
        F = scipy.fft.rfft(forward, length, axis=0)
        back = scipy.fft.irfft(np.einsum("ifr,fr->if", H.conj(), F), length, axis=1)[:, :n]
        return back.T.ravel()

    operator = scipy.sparse.linalg.LinearOperator((n * ni, n * ni), matvec=sweep, dtype=float)
    begin = np.sin(np.pi * np.repeat(np.arange(n), ni) / n)  # a fixed start, so that runs repeat
    _, vectors = scipy.sparse.linalg.eigsh(operator, k=1, which="LA", v0=begin, tol=1e-10)
    u = vectors[:, 0].reshape(n, ni)
    u *= np.sqrt(energy / (float((u**2).sum()) * dt)) * np.sign(u[np.abs(u).argmax() // ni].sum())
    made = {c: u[:, i] * size[i] for i, c in enumerate(model.inputs)}
    return Recording("Schulz", t, made, provenance=("Schulz-type input: largest trace of the information",))
