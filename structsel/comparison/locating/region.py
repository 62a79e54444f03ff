"""The part of the envelope in which an effect acts, as limits of the few channels that bound it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from structsel.comparison.flight import Flight
from structsel.comparison.locating.windows import Contributions, Flags, acting
from structsel.nomenclature import CONFIGURATION
from structsel.numerics.arrays import Array

CHANNELS = (
    "h_agl",
    "alpha",
    "mach",
    "qbar",
    "beta",
    *CONFIGURATION,
    "de",
    "da",
    "dr",
    "CT",
    "throttle",
    "V",
    "q",
    "p",
    "r",
)
"""Channels that may bound an effect."""

_MAX_CHANNELS = 2
_OFTEN = 0.6  # fraction of the samples, above which an effect is not bounded
_SEPARATES = 0.7  # fraction of acting samples inside less that of the others
_FURTHER = 0.03  # by which a second channel must better the first, and by half of what that lacks
_TAIL = 0.005  # of the acting samples beyond each limit
_TIMINGS = 99
_SIGNIFICANCE = 0.05
_SAMPLES = 4000
_FEW = 20


@dataclass(frozen=True)
class Bound:
    """Limits of one channel.

    Attributes
    ----------
    low, high : float
    separates : float
        Fraction of the acting samples between the limits less that of the others; 1 is perfect.
    p : float
        Probability of as much without relation: of the best channel, acting segments moved to other times.
    coverage : float
        Fraction of all recorded samples that lie between the limits.
    """

    low: float
    high: float
    separates: float
    p: float
    coverage: float


def find_region(
    flights: Sequence[Flight], contributions: Contributions, noise_rms: Mapping[str, float] | None = None
) -> dict[str, tuple[float, float]]:
    """Limits of the channels that bound where an effect acts; empty where it acts everywhere flown."""
    return {c: (b.low, b.high) for c, b in bounds_of(flights, contributions, noise_rms).items()}


def bounds_of(
    flights: Sequence[Flight], contributions: Contributions, noise_rms: Mapping[str, float] | None = None, seed: int = 0
) -> dict[str, Bound]:
    """Channels that separate acting from other samples, at most two.

    A channel is tried as the range it has while the effect acts. It bounds the effect if that range holds 0.7 more of
    the acting samples than of the others, and if no channel does as well in 95 of 100 other timings of the same
    segments (moved round in each flight by a random time, flights exchanged): the best channel is compared with the
    best, which allows for the number tried.

    Parameters
    ----------
    flights : sequence of Flight
    contributions : sequence of mapping of response to (n,) array
        Per flight: what the fitted effect adds to measured less simulated.
    noise_rms : mapping of response to float, optional
        By default responses count by the size of their differences.
    seed : int
        Of the random timings.
    """
    responses = flights[0].responses
    size = noise_rms or {c: float(np.std(np.concatenate([f.difference[c] for f in flights]))) for c in responses}
    on = [a if len(a) else np.zeros(len(f), dtype=bool) for f, a in zip(flights, acting(contributions, size))]
    return bounds_of_flags(flights, on, seed)


def bounds_of_flags(flights: Sequence[Flight], flags: Sequence[Flags], seed: int = 0) -> dict[str, Bound]:
    """The same for (n,) bool arrays that say when something acts."""
    step = max(1, sum(len(f) for f in flights) // _SAMPLES)
    on = [flag[::step] for flag in flags]
    together = np.concatenate(on)
    names = [c for c in CHANNELS if all(_has(f, c) for f in flights)]
    values = {c: np.concatenate([f[c][::step] for f in flights]) for c in names}
    names = [c for c in names if np.ptp(values[c]) > 0.0]
    if not names or together.sum() < _FEW or together.mean() > _OFTEN:
        return {}
    reached = {c: _separation(values[c], together) for c in names}
    first = max(names, key=lambda c: reached[c])
    if reached[first] < _SEPARATES:
        return {}
    rng = np.random.default_rng(seed)
    at_random = []
    for _ in range(_TIMINGS):
        other = _retimed(on, rng)
        at_random.append(max(_separation(values[c], other) for c in names))
    p = (1.0 + sum(x >= reached[first] for x in at_random)) / (_TIMINGS + 1.0)
    if p > _SIGNIFICANCE:
        return {}
    made = {first: _bound(values[first], together, reached[first], p)}
    inside = _inside(values[first], together)
    while len(made) < _MAX_CHANNELS and (~together & inside).sum() >= _FEW:
        rest = [c for c in names if c not in made]
        gains = {c: _separation(values[c], together, inside) - _separation(values[first], together) for c in rest}
        further = max(rest, key=lambda c: gains[c], default="")
        if not further or gains[further] < max(_FURTHER, 0.5 * (1.0 - reached[first])):
            break
        made[further] = _bound(values[further], together, gains[further] + reached[first], p)
        inside &= _inside(values[further], together)
        reached[first] += gains[further]
    return made


def _has(f: Flight, channel: str) -> bool:
    try:
        f[channel]
    except (KeyError, ValueError):
        return False
    return True


def _limits(x: Array, on: Flags) -> tuple[float, float]:
    low, high = np.quantile(x[on], [_TAIL, 1.0 - _TAIL])
    return float(low), float(high)


def _inside(x: Array, on: Flags) -> Flags:
    low, high = _limits(x, on)
    return np.asarray((x >= low) & (x <= high))


def _separation(x: Array, on: Flags, within: Flags | None = None) -> float:
    if not on.any() or on.all():
        return 0.0
    inside = _inside(x, on) if within is None else _inside(x, on) & within
    return float(inside[on].mean() - inside[~on].mean())


def _bound(x: Array, on: Flags, separates: float, p: float) -> Bound:
    low, high = _limits(x, on)
    return Bound(low, high, separates, p, float(_inside(x, on).mean()))


def _retimed(on: Sequence[Flags], rng: np.random.Generator) -> Flags:
    """The same segments at other times of other flights."""
    made = []
    for k, j in enumerate(rng.permutation(len(on))):
        moved = np.roll(on[j], rng.integers(len(on[j])))
        made.append(np.resize(moved, len(on[k])))
    return np.concatenate(made)
