"""Wrong clocks, units and signs, found by kinematic closure: the instruments of a recording contradict one another.

The two sides of each equation of `kinematic_closure` are compared over windows of several lengths in samples, so that
no clock is presumed. The ratio of their standard deviations is the *scale*, 1 for instruments without faults, and
their correlation rho bounds it: whichever side has the noise, the true scale is between rho times and 1 / rho times
the measured one. An equation with a correlation above 0.9 is *closed* if its scale is near 1, and *contradicted* if
none of the scales within the bounds is. Corrections are tried only if an equation is contradicted, or if attitude and
rates are not correlated. A finding names the correction that closes the most equations and opens none.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from structsel.nomenclature import BODY_RATES, EULER_ANGLES
from structsel.numerics.atmosphere import G0
from structsel.numerics.kinematic_closure import NEEDS, USES, closure_sides
from structsel.recording.finding import Finding
from structsel.recording.kinematic_corrections import (
    ChannelCorrection,
    cause,
    clock,
    remedy,
    scaled,
    sign,
    swapped,
    unit,
)

_EQUATIONS = ("p", "q", "r", "az", "h")
"""Forces along x and y are left out: turbulence and vanes far from the centre of gravity affect them too much."""
_WINDOWS = (4, 8, 16, 32, 64)  # samples; 0.1 to 6 s for the usual 10 to 50 Hz
_FEWEST = 10  # windows without overlap
_PART, _PARTS = 1000, 10  # samples of a part, and number of parts, of a long recording
# The healthy scale ends half way (in ratio) to the nearest wrong unit, m/s for knots (1.944).
_HEALTHY = 1.944**0.5
_CORRELATED, _LOCKED = 0.9, 0.95  # least correlation of a scale; of an equation that only a correction makes correlated
_SIGMAS = 3.0  # of the bound of the correlation
_MAX_CORRECTIONS = 3  # corrections of one recording
# Standard deviation of the left side below which only noise and drift of an instrument are compared.
_QUIET = {**dict.fromkeys(BODY_RATES, 1e-3), "az": 0.05, "h": 0.1}  # rad/s, m/s^2, m/s
_MISFIT = 0.01  # least misfit that counts: scale errors of 10 %
_EQUAL = np.log(1.5)  # misfit ratio below which corrections are equally likely
_LINEAR = {"p": ("p", "phi"), "q": ("q", "theta"), "r": ("r", "psi"), "az": ("az", "V"), "h": ("h", "V")}
"""Equation: channels of its left and right side to which the side is proportional."""
_SIDES = {
    **{rate: (f"the rate {rate}", f"the rate of change of {angle}") for rate, angle in zip(BODY_RATES, EULER_ANGLES)},
    "az": ("az", "what V, alpha, q and gravity give"),
    "h": ("the rate of change of h", "the climb rate from V, theta and alpha"),
}


@dataclass(frozen=True)
class Closure:
    """Agreement of the two sides of an equation.

    Attributes
    ----------
    scale : float
        Standard deviation of the left side over that of the right side.
    rho : float
        Their correlation.
    windows : float
        Number of windows without overlap.
    """

    scale: float
    rho: float
    windows: float

    @property
    def bound(self) -> float:
        """Lower bound of the correlation, by Fisher's transformation; 0 if it is not significant."""
        size = min(abs(self.rho), 1.0 - 1e-12)
        return max(float(np.tanh(np.arctanh(size) - _SIGMAS / np.sqrt(self.windows - 3.0))), 0.0)

    @property
    def closed(self) -> bool:
        """Whether the sides agree."""
        return self.rho >= _CORRELATED and 1.0 / _HEALTHY < self.scale < _HEALTHY

    @property
    def contradicted(self) -> bool:
        """Whether no scale within the bounds is that of healthy instruments."""
        if abs(self.rho) < _CORRELATED or self.bound == 0.0:
            return False
        return self.rho < 0.0 or self.scale * self.bound > _HEALTHY or self.scale / self.bound < 1.0 / _HEALTHY

    @property
    def misfit(self) -> float:
        """Variance of the difference over that of both sides: 0 if they agree, 1 if they are unrelated."""
        return 1.0 - 2.0 * self.rho * self.scale / (1.0 + self.scale**2)


def find_kinematic_errors(t: np.ndarray, channels: Mapping[str, np.ndarray]) -> list[Finding]:
    """Findings of kind "unit", "sign", "swap" or "scale", each with the likely correction.

    Parameters
    ----------
    t : (n,) array [s]
    channels : mapping of str to (n,) array
        In the units and signs of the nomenclature, if they are right.
    """
    if not any(all(name in channels for name in NEEDS[e]) for e in _EQUATIONS):
        return []
    parts = _representative_parts(t, channels)
    found: list[Finding] = []
    now = _closures(parts)
    while len(found) < _MAX_CORRECTIONS and (doubtful := _doubtful(now)):
        best = _best_correction(parts, now, doubtful)
        if not best:
            break
        found.append(_finding(best, now))
        parts = [best[0].apply(part) for part in parts]
        now = _closures(parts)
    return found


def _representative_parts(t: np.ndarray, channels: Mapping[str, np.ndarray]) -> list[dict[str, np.ndarray]]:
    """Channels of the equations, with their time as ``t``; of a long recording some parts of equal length."""
    used = {name: channels[name] for name in dict.fromkeys(c for e in _EQUATIONS for c in USES[e]) if name in channels}
    finite = {name: np.where(np.isfinite(values), values, np.nan) for name, values in used.items()}
    used = {name: values for name, values in finite.items() if not np.isnan(values).all()} | {"t": t}
    step = np.diff(t)
    edges = [0, *(np.flatnonzero(step > 3.0 * np.median(step)) + 1).tolist(), len(t)]
    slices = [slice(a, b) for a, b in pairwise(edges) if b - a > 2 * _WINDOWS[0]]
    if len(t) > _PART * _PARTS:
        starts = [a for part in slices for a in range(part.start, part.stop - _PART + 1, _PART)]
        if starts:
            chosen = np.unique(np.linspace(0, len(starts) - 1, _PARTS).round().astype(int))
            slices = [slice(starts[i], starts[i] + _PART) for i in chosen]
    return [{name: values[part] for name, values in used.items()} for part in slices]


def _closures(parts: Sequence[Mapping[str, np.ndarray]], of: Iterable[str] | None = None) -> dict[str, Closure]:
    """Closure of each equation at the window with the largest correlation; without `of`, of those with motion."""
    if not parts:
        return {}
    known = _EQUATIONS if of is None else tuple(of)
    equations = [e for e in known if all(name in parts[0] for name in NEEDS[e])]
    best: dict[str, Closure] = {}
    if not equations:
        return best
    turned = [{**part, **{name: _unwrapped(part[name]) for name in ("phi", "psi") if name in part}} for part in parts]
    sides = [(len(part["t"]), closure_sides(part["t"], part, equations, g=G0)) for part in turned]
    for samples in _WINDOWS:
        long = [one for n, one in sides if n > 2 * samples]
        for name in equations:
            left, right = (np.concatenate([np.empty(0), *(one[name][k](samples) for one in long)]) for k in range(2))
            made = _closure(left, right, samples, _QUIET[name] if of is None else 0.0)
            if made is not None and (name not in best or abs(made.rho) > abs(best[name].rho)):
                best[name] = made
    return best


def _closure(left: np.ndarray, right: np.ndarray, samples: int, quiet: float) -> Closure | None:
    """Closure of one equation; None if the windows are too few, or the motion is too small."""
    good = np.isfinite(left) & np.isfinite(right)
    windows = float(good.sum()) / samples
    if windows < _FEWEST:
        return None
    left, right = left[good] - left[good].mean(), right[good] - right[good].mean()
    sizes = float(left.std()), float(right.std())
    if max(sizes) < quiet or min(sizes) == 0.0:
        return None
    return Closure(sizes[0] / sizes[1], float(np.mean(left * right)) / (sizes[0] * sizes[1]), windows)


def _unwrapped(angle: np.ndarray) -> np.ndarray:
    finite = np.isfinite(angle)
    made = np.array(angle, dtype=np.float64)
    made[finite] = np.unwrap(made[finite])
    return made


def _doubtful(now: Mapping[str, Closure]) -> list[str]:
    """Equations that are contradicted, and those of the rates that are not correlated."""
    return [e for e, c in now.items() if c.contradicted or (e in BODY_RATES and abs(c.rho) < _CORRELATED)]


def _candidates(now: Mapping[str, Closure], doubtful: Iterable[str], there: Iterable[str]) -> list[ChannelCorrection]:
    """Corrections that could close the doubtful equations."""
    have = set(there)
    made: list[ChannelCorrection] = []
    for e in doubtful:
        if now[e].contradicted:
            left, right = _LINEAR[e]
            made += scaled(left, 1.0 / now[e].scale) + scaled(right, now[e].scale)
    made += [unit(name, "deg") for name in EULER_ANGLES] + [unit(name, "deg/s") for name in BODY_RATES]
    made += [unit("V", name) for name in ("kt", "ft/s", "km/h")] + [unit("az", "g"), unit("h", "ft")]
    made += [sign(name) for name in (*BODY_RATES, *EULER_ANGLES, "az", "alpha", "h")] + [sign(*BODY_RATES)]
    made += [unit("p", "deg/s", "q", "r"), unit("phi", "deg", "theta", "psi"), unit("phi", "deg", "theta")]
    made += [swapped(a, b) for group in (BODY_RATES, EULER_ANGLES) for a, b in combinations(group, 2)]
    made += [unit("t", name) for name in ("ms", "us", "min")]
    made += clock([1.0 / now[e].scale for e in doubtful if e in BODY_RATES and now[e].contradicted])
    made += clock([now[e].scale for e in doubtful if e == "h" and now[e].contradicted])
    return [one for one in dict.fromkeys(made) if set(one.channels) - {"t"} <= have]


def _best_correction(
    parts: Sequence[dict[str, np.ndarray]], now: Mapping[str, Closure], doubtful: Sequence[str]
) -> list[ChannelCorrection]:
    """The correction that closes the most equations and opens none, or those that are equally likely."""
    tried = []
    for one in _candidates(now, doubtful, parts[0]):
        moved = [e for e in now if {"t", *USES[e]} & set(one.channels)]
        if not set(moved) & set(doubtful):
            continue
        then = {e: c for e, c in now.items() if e not in moved}
        then |= _closures([one.apply(part) for part in parts], moved)
        if any(_is_opened(e, c, then.get(e)) for e, c in now.items()):
            continue
        won = [e for e in doubtful if e in then and _is_won(now[e], then[e])]
        if won:
            misfit = sum(np.log(max(c.misfit, _MISFIT)) for c in then.values() if c.closed or c.contradicted)
            tried.append((len(won), one, misfit))
    if not tried:
        return []
    largest = max(count for count, _, _ in tried)
    left = [(one.rank, len(one.channels), misfit, one) for count, one, misfit in tried if count == largest]
    first = min((rank, size) for rank, size, _, _ in left)
    left = [row for row in left if row[:2] == first]
    least = min(misfit for _, _, misfit, _ in left)
    return [one for _, _, misfit, one in sorted(left, key=lambda row: row[2]) if misfit < least + _EQUAL]


def _is_opened(equation: str, before: Closure, after: Closure | None) -> bool:
    """Whether a correction makes an equation contradicted, or uncorrelates rates and attitude."""
    if after is None:
        return before.closed
    return (after.contradicted and not before.contradicted) or (
        equation in BODY_RATES and before.closed and not after.closed
    )


def _is_won(before: Closure, after: Closure) -> bool:
    """Whether a correction closes an equation that was contradicted, or makes one agree that was uncorrelated."""
    return after.closed and (before.contradicted or (after.rho >= _LOCKED and after.bound > _CORRELATED))


def _finding(best: Sequence[ChannelCorrection], now: Mapping[str, Closure]) -> Finding:
    """Finding with the likely cause, the observation and the remedy."""
    first = best[0]
    return Finding(first.kind, first.channels[0], f"{cause(best)}: {_observation(first, now)}", "warning", remedy(best))


def _observation(first: ChannelCorrection, now: Mapping[str, Closure]) -> str:
    """The contradiction in numbers: of the contradicted equation with the largest misfit, if one is."""
    names = [e for e, c in now.items() if c.contradicted and (set(USES[e]) | {"t"}) & set(first.channels)]
    if not names:
        return "rates and attitude are not correlated as recorded, and agree with this correction"
    e = max(names, key=lambda e: now[e].misfit)
    c = now[e]
    if e in BODY_RATES and "t" in first.channels and c.rho > 0.0:
        slower, times = ("slower", c.scale) if c.scale > 1.0 else ("faster", 1.0 / c.scale)
        return f"attitude changes {float(f'{times:.3g}'):g} times {slower} than the integrated rates"
    left, right = _SIDES[e]
    if c.rho < 0.0 and 1.0 / _HEALTHY < c.scale < _HEALTHY:
        return f"{left} has the opposite sign of {right} (correlation {c.rho:.2f})"
    times = c.scale if c.scale >= 1.0 else 1.0 / c.scale
    larger, smaller = (left, right) if c.scale >= 1.0 else (right, left)
    return f"{larger} is {float(f'{times:.3g}'):g} times {smaller} (correlation {c.rho:.2f})"
