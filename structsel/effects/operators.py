"""What systems make of a signal, and where in a flight something happens.

Arrays in, arrays out; time runs along the first axis on an even clock. Every operator starts at rest.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import scipy

from structsel.comparison.flight import Flight
from structsel.numerics.arrays import Array

__all__ = [
    "more_and_more",
    "oscillate",
    "peaks",
    "pulse",
    "pulses",
    "shape_of",
    "shared_pulses",
    "spaced",
]

_BINS = 256
_ROUNDING = 1e-9  # of the rms of a response: differences below are rounding, and their spectrum has peaks of its own
_EDGE = 0.08  # of a manoeuvre at either end, where a step cannot be separated from the free mean and trend


def spaced(low: float, high: float, count: int) -> list[float]:
    """Values evenly apart by ratio."""
    return [float(x) for x in np.geomspace(low, high, count)] if high > low else [float(low)]


def oscillate(x: Array, dt: float, frequency: float, damping: float) -> Array:
    """Second-order system of unit gain at rest, for a signal that is linear between samples.

    ::

        y'' + 2 damping w y' + w^2 y = w^2 x,   w = 2 pi frequency

    Parameters
    ----------
    x : (n,) array
    dt : float [s]
    frequency : float [Hz]
    damping : float
        Fraction of the critical, below 1.
    """
    b, a = _second_order(2.0 * np.pi * frequency * dt, damping)
    return x[0] + scipy.signal.lfilter(b, a, x - x[0])


def _second_order(w: float, damping: float) -> tuple[Array, Array]:
    # Ramp invariance: the response to a ramp, sampled, differenced twice.
    root = w * complex(-damping, np.sqrt(1.0 - damping**2))
    z = np.exp(root)
    a = np.array([1.0, -2.0 * z.real, abs(z) ** 2])
    k = np.arange(1, 4)
    # Ramp response: k - 2 damping / w + Re(c z^k), with y(0) = y'(0) = 0.
    offset = 2.0 * damping / w
    c = complex(offset, (1.0 + root.real * offset) / root.imag)
    ramp = k - offset + (c * z**k).real
    return np.convolve(np.convolve(ramp, [1.0, -2.0, 1.0])[:3], a)[:3], a


def pulse(t: Array, when: float, length: float) -> Array:
    """One minus cosine, of height 1, about `when`."""
    phase = np.clip((t - when) / length, -0.5, 0.5)
    return 0.5 * (1.0 + np.cos(2.0 * np.pi * phase))


def more_and_more(clearest: Sequence[tuple[str, float]]) -> list[dict[str, float]]:
    """Times [s] by manoeuvre: each of the clearest alone, then more and more of them together."""
    return [{where: when} for where, when in clearest] + [dict(clearest[:n]) for n in range(2, len(clearest) + 1)]


def shape_of(times: Mapping[str, float]) -> dict[str, float]:
    """As the shape of a variant."""
    return {f"time in {where}": when for where, when in times.items()}


def pulses(flights: Sequence[Flight], responses: Sequence[str], length: float, count: int) -> list[tuple[str, float]]:
    """Where the differences have a pulse of `length` [s] most clearly: manoeuvre and time, the clearest first."""
    return _clearest(flights, responses, count, lambda x, dt: np.abs(_matched(x, dt, length)))


def shared_pulses(flights: Sequence[Flight], responses: Sequence[str], length: float, count: int) -> list[float]:
    """Times [s] from the start at which all manoeuvres together have a pulse of `length` [s] and of one sign."""
    n = min(len(f) for f in flights)
    total = np.zeros(n)
    for r in responses:
        there = [f for f in flights if r in f.measured]
        spread = float(np.concatenate([f.difference[r] - f.difference[r].mean() for f in there] or [np.zeros(1)]).std())
        if spread > 0.0:
            total = np.maximum(total, np.abs(sum(_matched(f.difference[r], f.dt, length)[:n] for f in there)) / spread)
    found: list[float] = []
    edge = int(_EDGE * n) + 1
    for i in edge + np.argsort(-total[edge:-edge]):
        when = float(i) * flights[0].dt
        if len(found) < count and all(abs(when - x) > length for x in found):
            found.append(when)
    return found if total.any() else []


def _matched(x: Array, dt: float, length: float) -> Array:
    """Correlation with a pulse of a length [s] about each sample, over the size of the pulse."""
    half = max(2, round(0.5 * length / dt))
    form = pulse(dt * np.arange(-2.0 * half, 2.0 * half + 1.0), 0.0, length)
    form -= form.mean()
    if len(form) >= len(x):
        return np.zeros(len(x))
    return np.convolve(x - x.mean(), form, mode="same") / np.sqrt((form**2).sum())


def peaks(flights: Sequence[Flight], responses: Sequence[str], count: int, low: float, high: float) -> list[float]:
    """Frequencies [Hz] between `low` and `high` where the differences stand highest above their own broad spectrum."""
    if high <= low:
        return []
    grid = np.geomspace(low, high, _BINS)
    heights = np.zeros(_BINS)
    for r in responses:
        power, rounding = np.zeros(_BINS), 0.0
        for f in flights:
            if r in f.measured:
                rounding += _ROUNDING**2 * float(f.measured[r] @ f.measured[r]) / len(f)
                coefficients = scipy.fft.dct(f.difference[r], norm="ortho")[1:]
                at = np.arange(1, len(f)) / (2.0 * len(f) * f.dt)
                power += np.interp(grid, at, scipy.ndimage.uniform_filter1d(coefficients**2, 5))
        if power.max() > rounding:
            level = np.log(power + 1e-12 * power.max() + rounding)
            heights = np.maximum(heights, level - scipy.ndimage.median_filter(level, _BINS // 6))
    found: list[float] = []
    for i in np.argsort(heights)[::-1]:
        if len(found) < count and all(abs(np.log(grid[i] / x)) > 0.12 for x in found):
            found.append(float(grid[i]))
    return found


def _clearest(
    flights: Sequence[Flight], responses: Sequence[str], count: int, score: Callable[[Array, float], Array]
) -> list[tuple[str, float]]:
    spreads = {}
    for r in responses:
        centred = [f.difference[r] - f.difference[r].mean() for f in flights if r in f.measured]
        if centred:
            spreads[r] = float(np.concatenate(centred).std())
    found = []
    for f in flights:
        scores = [score(f.difference[r] / s, f.dt) for r, s in spreads.items() if s > 0.0 and r in f.measured]
        if not scores:
            continue
        total = np.max(scores, axis=0)
        edge = int(_EDGE * len(total)) + 1
        i = edge + int(np.argmax(total[edge:-edge]))
        found.append((float(total[i]), f.name, float(f.t[i])))
    return [(name, when) for _, name, when in sorted(found, reverse=True)[:count]]
