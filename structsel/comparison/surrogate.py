"""A stand-in for the simulation: few terms of the states, so that slopes and single terms can be had.

Whatever form a simulation comes in, its coefficients along the recorded paths are regressed on polynomials of the
recorded states. The stand-in is used for what wrong states would have done to the simulation, and for what its stated
tolerances allow, never for the difference itself, except for a free simulation, which has no coefficients at
recorded states.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from structsel.comparison.flight import Flight
from structsel.nomenclature import COEFFICIENTS, CONFIGURATION, INPUTS, LATERAL_COEFFICIENTS
from structsel.numerics.arrays import Array
from structsel.numerics.stepwise import forward_selection

_LINEAR = (
    "alpha", "beta", "abs(beta)", "p_hat", "q_hat", "r_hat", "de", "da", "dr", *CONFIGURATION, "CT", "V",
    "alpha_dot_hat",
)  # fmt: skip
_SECOND = (
    ("alpha", "alpha"), ("beta", "beta"), ("alpha", "beta"), ("alpha", "p_hat"), ("alpha", "r_hat"),
    ("alpha", "q_hat"), ("alpha", "de"), ("alpha", "da"), ("alpha", "dr"), ("de", "de"), ("alpha", "V"), ("de", "V"),
    ("beta", "V"), ("alpha", "df"), ("alpha", "CT"), ("de", "CT"), ("V", "V"), ("alpha", "alpha", "alpha"),
    ("beta", "beta", "beta"), ("beta", "beta", "de"), ("alpha", "alpha", "CT"), ("CT", "CT"),
    ("da", "V"), ("dr", "V"), ("p_hat", "V"), ("dr", "CT"), ("beta", "CT"),
)  # fmt: skip
_KNOTS, _TAIL = 7, 0.01
"""Breakpoints in the angle of attack, at even distances between its quantiles: tables bend near a stall."""
_BENDS = 0.85  # of the squared error of a polynomial in blocks left out, below which splines follow a bend
_BLOCK, _FOLDS = 2.0, 6  # s; and parts of the blocks, each left out in turn
_ROUNDING = 1e-12  # of a sum of squares
_WITH_KNOT: tuple[tuple[str, ...], ...] = ((), ("beta",))
_ZERO = 0.002
"""Standard deviation of the zero of a vane [rad], over which the slope of ``abs(beta)`` is averaged. A table that bends
at zero sideslip, read with a bias of 0.002 rad, left 0.21 of the rms of Cl with the slope at the reading; with its mean
over 0.001 to 0.003 rad it leaves 0.16 to 0.17, which is white."""
_HATS = {"p_hat": "p", "q_hat": "q", "r_hat": "r"}
_TINY = 1e-9
_VANES = ("alpha", "beta")
_STATES = ("V", "alpha", "beta", "p", "q", "r")
_ENOUGH = 4000  # samples
_ROUNDS = 3
_LEAST = 0.02  # of what samples count, that flights' levels count at least
_RIDGE = 1e-2  # of each column
_LEAST_FRACTION, _CLEAR = 1e-5, 20.0
"""What a term must carry: of the variance, and of the mean square that is left."""
_RATE_WORTH, _SPEED_WORTH, _WRONG_SIDE = 0.002, 0.2, 0.05
_SIDEWAYS = {"beta", "p_hat", "r_hat", "da", "dr"}
_BY_POWER = {"Cl", "Cn"}


@dataclass(frozen=True, eq=False)
class Surrogate:
    """Terms and values by response.

    Attributes
    ----------
    centre, scale : mapping of channel to float
        Channels enter as (x - centre) / scale.
    terms : mapping of response to tuple of tuple of str
        Each a product of channels.
    values : mapping of response to (k,) array
    constant : mapping of response to float
    r2 : mapping of response to float
        Of the simulation's variance.
    at_cg : bool
        alpha and beta are those at the centre of gravity, not as read at the vanes.
    knots : mapping of spline to float [rad]
        Splines of the angle of attack, ``(alpha - knot)+``, that terms may contain.
    without_splines : Surrogate, optional
        The same without splines, where it is another one: stated tolerances are of the terms of a polynomial.
    """

    centre: Mapping[str, float]
    scale: Mapping[str, float]
    terms: Mapping[str, tuple[tuple[str, ...], ...]]
    values: Mapping[str, Array]
    constant: Mapping[str, float]
    r2: Mapping[str, float]
    at_cg: bool = False
    knots: Mapping[str, float] = field(default_factory=dict)
    without_splines: Surrogate | None = None

    @property
    def polynomial(self) -> Surrogate:
        """The stand-in without splines."""
        return self.without_splines or self

    @property
    def misfit(self) -> float:
        """Log of the fraction of the variance that it leaves, summed over the responses."""
        return float(sum(np.log(max(1.0 - r2, _TINY)) for r2 in self.r2.values()))

    def channel_of(self, factor: str) -> str:
        """Channel that a factor of a term depends on."""
        return "alpha" if factor in self.knots else factor

    def unit(self, flight: Flight, factor: str) -> Array:
        """Channel, or a spline of it, centred and scaled."""
        channel = self.channel_of(factor)
        x = flight.at_cg[channel] if self.at_cg and channel in _VANES else flight[channel]
        if factor in self.knots:
            x = np.maximum(x - self.knots[factor], 0.0)
        return (x - self.centre[factor]) / self.scale[factor]

    def column(self, flight: Flight, term: Sequence[str]) -> Array:
        """One term along a flight."""
        made = np.ones(len(flight))
        for channel in term:
            made = made * self.unit(flight, channel)
        return made

    def evaluate(self, flight: Flight, response: str) -> Array:
        """Response along a flight."""
        made = np.full(len(flight), self.constant[response])
        for term, value in zip(self.terms[response], self.values[response]):
            made = made + value * self.column(flight, term)
        return made

    def slope(self, flight: Flight, response: str, channel: str) -> Array:
        """Derivative by a recorded channel (of V: rates in their hats and all)."""
        made = np.zeros(len(flight))
        if response not in self.terms:
            return made
        for term, value in zip(self.terms[response], self.values[response]):
            for i, factor in enumerate(term):
                inner = self._inner(flight, factor, channel)
                if inner is not None:
                    rest = [*term[:i], *term[i + 1 :]]
                    made = made + value * self.column(flight, rest) * inner / self.scale[factor]
        return made

    def _inner(self, flight: Flight, factor: str, channel: str) -> Array | float | None:
        if factor in self.knots:
            inner = self._inner(flight, "alpha", channel)
            above = (flight.at_cg if self.at_cg else flight)["alpha"] > self.knots[factor]
            return None if inner is None else np.asarray(inner * above)
        if factor == channel:
            return 1.0
        if self.at_cg and (arm := _arm(flight, factor, channel)):
            return arm / flight["V"]
        if factor == "abs(beta)" and channel == "beta":
            return np.asarray(scipy.special.erf(flight["beta"] / (np.sqrt(2.0) * _ZERO)))
        length = flight.aircraft.cbar if factor == "q_hat" else flight.aircraft.b
        if _HATS.get(factor) == channel:
            return length / (2.0 * flight["V"])
        if channel == "V" and factor in _HATS:
            return -flight[factor] / flight["V"]
        if channel == "V" and factor == "CT":
            return -2.0 * flight["CT"] / flight["V"]
        return None


def _arm(flight: Flight, factor: str, channel: str) -> float:
    """Metres by which an angle at the centre of gravity is off the vane's, for a turning rate over the airspeed."""
    x, y, z = flight.aircraft.position("vane")
    return float(
        {("alpha", "q"): x, ("alpha", "p"): -y, ("beta", "r"): -x, ("beta", "p"): z}.get((factor, channel), 0.0)
    )


def find_surrogate(flights: Sequence[Flight], responses: Sequence[str]) -> Surrogate:
    """Stand-in for the flights' simulation of `responses`, by the states at which it was most likely evaluated.

    These are the channels smoothed, or with the gusts that stand out of the noise, or as read, at the vanes or carried
    to the centre of gravity: whichever leave least of what the simulation says.

    Parameters
    ----------
    flights : sequence of Flight
        Of one aircraft, with what the simulation says.
    responses : sequence of str

    Returns
    -------
    Surrogate
    """
    simulated_responses = [f.simulated for f in flights]
    # Controls jump, and their noise is small compared with their motion: smoothing would round them.
    inputs = [{c: f.raw[c] for c in INPUTS if c in f.raw} for f in flights]
    gusty = [{**f.air, **m} for f, m in zip(flights, inputs)]
    read = [{**m, **{c: f.raw[c] for c in _STATES if c in f.raw}} for f, m in zip(flights, inputs)]
    tried = []
    for more in (inputs, gusty, read):
        asked = [replace(f, channels={**f.channels, **m}) for f, m in zip(flights, more)]
        tried.append(identify(asked, simulated_responses, responses))
        if np.any(flights[0].aircraft.position("vane")):
            tried.append(identify(asked, simulated_responses, responses, at_cg=True))
    return min(tried, key=lambda s: s.misfit)


def identify(
    flights: Sequence[Flight],
    simulated: Sequence[Mapping[str, Array]],
    responses: Sequence[str],
    *,
    at_cg: bool = False,
) -> Surrogate:
    """Stand-in for what a simulation says of `responses`.

    Orthogonal functions; each must carry a least fraction of the variance of all flights together.

    Parameters
    ----------
    flights : sequence of Flight
        Whose channels the simulation answers to.
    simulated : sequence of mapping of response to (n,) array
    responses : sequence of str
    at_cg : bool
        Of alpha and beta at the centre of gravity, not of those as read.
    """
    if at_cg:
        flights = [replace(f, channels={**f.channels, **f.at_cg}) for f in flights]
    linear = [c for c in _LINEAR if all(c in f or c in f.channels for f in flights) and _moves(flights, c)]
    together = {c: np.concatenate([f[c] for f in flights]) for c in linear}
    centre = {c: float(x.mean()) for c, x in together.items()}
    scale = {c: float(x.std()) for c, x in together.items()}
    knots = _knots(together["alpha"]) if "alpha" in linear else {}
    centre |= dict.fromkeys(knots, 0.0)
    scale |= {name: float(np.maximum(together["alpha"] - knot, 0.0).std()) for name, knot in knots.items()}
    pool: list[tuple[str, ...]] = [(c,) for c in linear]
    pool += [s for s in _SECOND if set(s) <= set(linear)]
    polynomial = len(pool)
    pool += [(name, name, *others) for others in _WITH_KNOT if set(others) <= set(linear) for name in knots]
    step = max(1, sum(map(len, flights)) // _ENOUGH)
    counts = [len(range(0, len(f), step)) for f in flights]
    ends = np.cumsum(counts)[:-1]
    bare = Surrogate(centre, scale, {}, {}, {}, {}, knots=knots)
    columns = [np.concatenate([bare.column(f, term)[::step] for f in flights]) for term in pool]
    X = np.reshape(columns, (len(pool), sum(counts))).T
    simulated_responses = {c: np.concatenate([s[c][::step] for s in simulated]) for c in responses}
    products = _Products.of(np.column_stack([np.ones(len(X)), X, *simulated_responses.values()]), ends)
    # The rate of angle of attack is the pitch rate and what CZ makes of it: with it, anything would fit. In trimmed
    # flight airspeed and angle of attack are collinear.
    liking = np.array([_RATE_WORTH if "alpha_dot_hat" in t else _SPEED_WORTH if "V" in t else 1.0 for t in pool])
    # An aircraft is nearly symmetric: products that are odd in lateral motion belong to lateral responses. Those of
    # thrust may belong to lateral moments too: a propeller's torque, swirl and inclined disc roll and yaw the aircraft.
    odd = np.array([sum(c in _SIDEWAYS for c in term) % 2 == 1 for term in pool])
    powered = np.array(["CT" in term for term in pool])

    def fitted(count: int) -> Surrogate:
        """By the first of the pool."""
        terms, values, constant, r2 = {}, {}, {}, {}
        for i, (response, y) in enumerate(simulated_responses.items(), 1 + len(pool)):
            alike = odd == (response in LATERAL_COEFFICIENTS) if response in COEFFICIENTS else np.ones_like(odd)
            alike = alike | (powered & (response in _BY_POWER))
            weights = np.where(alike, liking, _WRONG_SIDE * liking)[:count]
            kept, fit = _fit(X[:, :count], y, products.of_columns([*range(1 + count), i]), ends, weights)
            left = y - fit[0] - X[:, kept] @ fit[1:]
            total = float(((y - y.mean()) ** 2).sum())
            terms[response] = tuple(pool[j] for j in kept)
            values[response] = fit[1:]
            constant[response] = float(fit[0])
            r2[response] = 1.0 - float(left @ left) / total if total > 0.0 else 1.0
        return replace(bare, terms=terms, values=values, constant=constant, r2=r2, at_cg=at_cg)

    plain, bent = fitted(polynomial), fitted(len(pool))
    starts = np.concatenate([100_000 * k + f.t[::step] // _BLOCK for k, f in enumerate(flights)])
    blocks = np.unique(starts, return_inverse=True)[1]
    place = {term: j for j, term in enumerate(pool)}

    def error(of: Surrogate, response: str) -> float:
        kept = [place[term] for term in of.terms[response]]
        return _error_left_out(X[:, kept], simulated_responses[response], ends, blocks)

    bends = [c for c in responses if bent.terms[c] != plain.terms[c] and error(bent, c) < _BENDS * error(plain, c)]
    if not bends:
        return plain
    best = {c: bent if c in bends else plain for c in responses}
    return replace(
        plain, terms={c: s.terms[c] for c, s in best.items()}, values={c: s.values[c] for c, s in best.items()},
        constant={c: s.constant[c] for c, s in best.items()}, r2={c: s.r2[c] for c, s in best.items()},
        without_splines=plain,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Products:
    """Sums of products of columns: of what moves in each flight, and of its levels, (k, k) each; and of how many."""

    moving: Array
    levels: Array
    samples: int

    @classmethod
    def of(cls, columns: Array, ends: NDArray[np.intp]) -> _Products:
        parts = np.split(columns, ends)
        means = np.stack([part.mean(axis=0) for part in parts])
        moving = sum((part - mean).T @ (part - mean) for part, mean in zip(parts, means))
        count = np.array([len(part) for part in parts])
        return cls(np.asarray(moving), (means * count[:, None]).T @ means, len(columns) + len(parts))

    def of_columns(self, some: Sequence[int]) -> _Products:
        """Of some of the columns."""
        return replace(self, moving=self.moving[np.ix_(some, some)], levels=self.levels[np.ix_(some, some)])


def _fit(X: Array, y: Array, products: _Products, ends: NDArray[np.intp], liking: Array) -> tuple[list[int], Array]:
    """Columns kept, and the constant with their values, by least squares with levels weighted by their residuals.

    A simulation evaluated at states with other biases than the readings leaves a level in each flight. Taken for noise
    of independent samples, levels let false columns in, and give wrong values to columns that are alike.
    """
    level = 1.0
    for _ in range(_ROUNDS):
        S = products.moving + level * products.levels  # of the constant, the columns, and y
        kept = _choose((S - np.outer(S[0], S[0]) / S[0, 0])[1:, 1:], products.samples, liking)
        basis = [0, *(1 + j for j in kept)]
        # A touch of ridge: columns that nearly coincide have nearly equal values instead of cancelling.
        ridge = _RIDGE**2 * np.diag(S)[basis] * (np.arange(len(basis)) > 0)
        fit = np.linalg.solve(S[np.ix_(basis, basis)] + np.diag(ridge), S[basis, -1])
        left = np.split(y - fit[0] - X[:, kept] @ fit[1:], ends)
        levels = sum(len(x) * x.mean() ** 2 for x in left) / len(left)
        moving = sum(float(x.var()) * len(x) for x in left) / len(y)
        level = float(np.clip(moving / levels, _LEAST, 1.0)) if levels > 0.0 else 1.0
    return kept, np.asarray(fit, dtype=float)


def _knots(alpha: Array) -> dict[str, float]:
    """Splines of the angle of attack, with their knots."""
    low, high = np.quantile(alpha, [_TAIL, 1.0 - _TAIL])
    inside = np.linspace(low, high, _KNOTS + 2)[1:-1]
    return {
        f"(alpha - {knot:.4g})+" if knot >= 0.0 else f"(alpha + {-knot:.4g})+": float(f"{knot:.4g}") for knot in inside
    }


def _error_left_out(X: Array, y: Array, ends: NDArray[np.intp], block: NDArray[np.intp]) -> float:
    """Sum of squared errors in blocks left out, with a constant for each flight: its own level tells nothing."""
    flight = np.repeat(np.arange(len(ends) + 1), np.diff([0, *ends, len(y)]))
    columns = np.column_stack([X, flight[:, None] == np.arange(len(ends) + 1)])
    columns = columns / np.maximum(np.sqrt((columns**2).sum(axis=0)), 1e-300)
    parts = [(columns[block % _FOLDS == fold], y[block % _FOLDS == fold]) for fold in range(_FOLDS)]
    squares, products = np.stack([C.T @ C for C, _ in parts]), np.stack([C.T @ z for C, z in parts])
    total = 0.0
    for (C, z), own, with_z in zip(parts, squares, products):
        # The least ridge: a flight may be left out completely.
        known = squares.sum(axis=0) - own + _ROUNDING * np.eye(len(own))
        values = np.linalg.solve(known, products.sum(axis=0) - with_z)
        total += float(((z - C @ values) ** 2).sum())
    return total


def _moves(flights: Sequence[Flight], channel: str) -> bool:
    x = np.concatenate([f[channel] for f in flights])
    return float(x.std()) > _TINY * max(1.0, float(np.abs(x).max()))


def _choose(S: Array, samples: int, liking: Array) -> list[int]:
    """Columns that carry a least fraction of the variance of y, largest gain first; S has products with y last."""
    if len(S) < 2 or S[-1, -1] <= 0.0:
        return []
    # Most of the residual of a stand-in is error of form, not noise: a term must also carry a least fraction.
    path = forward_selection(
        S, float(samples), _CLEAR / samples, max_terms=20, min_gain=_LEAST_FRACTION, weights=liking, min_tolerance=1e-6
    )
    return list(path.selected)
