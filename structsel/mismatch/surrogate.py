"""A stand-in for the simulation: few terms of the states, so that slopes and single terms can be had.

Whatever form a simulation comes in, its coefficients along the recorded paths are regressed on polynomials of the
recorded states. The stand-in is used for what wrong states would have done to the simulation, and for what its stated
tolerances allow, never for the difference itself (but for a free simulation, which says nothing at recorded states).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from structsel.mismatch.flight import Flight
from structsel.mismatch.responses import COEFFICIENTS
from structsel.numerics.smoothing.result import Array

_LINEAR = (
    "alpha",
    "beta",
    "abs(beta)",
    "p_hat",
    "q_hat",
    "r_hat",
    "de",
    "da",
    "dr",
    "df",
    "gear",
    "CT",
    "V",
    "alpha_dot_hat",
)
_SECOND = (
    ("alpha", "alpha"), ("beta", "beta"), ("alpha", "beta"), ("alpha", "p_hat"), ("alpha", "r_hat"),
    ("alpha", "q_hat"), ("alpha", "de"), ("alpha", "da"), ("alpha", "dr"), ("de", "de"), ("alpha", "V"), ("de", "V"),
    ("beta", "V"), ("alpha", "df"), ("alpha", "CT"), ("de", "CT"), ("V", "V"), ("alpha", "alpha", "alpha"),
    ("beta", "beta", "beta"), ("da", "V"), ("dr", "V"), ("p_hat", "V"), ("dr", "CT"), ("beta", "CT"),
)  # fmt: skip
_HATS = {"p_hat": "p", "q_hat": "q", "r_hat": "r"}
_TINY = 1e-9
_RATE_WORTH, _SPEED_WORTH, _WRONG_SIDE = 0.05, 0.2, 0.05
_SIDEWAYS = {"beta", "p_hat", "r_hat", "da", "dr"}
_OF_SIDES = ("CY", "Cl", "Cn")


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
    """

    centre: Mapping[str, float]
    scale: Mapping[str, float]
    terms: Mapping[str, tuple[tuple[str, ...], ...]]
    values: Mapping[str, Array]
    constant: Mapping[str, float]
    r2: Mapping[str, float]

    def unit(self, flight: Flight, channel: str) -> Array:
        """Channel, centred and scaled."""
        return (flight[channel] - self.centre[channel]) / self.scale[channel]

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
        if factor == channel:
            return 1.0
        if factor == "abs(beta)" and channel == "beta":
            return np.sign(flight["beta"])
        length = flight.craft.cbar if factor == "q_hat" else flight.craft.b
        if _HATS.get(factor) == channel:
            return length / (2.0 * flight["V"])
        if channel == "V" and factor in _HATS:
            return -flight[factor] / flight["V"]
        if channel == "V" and factor == "CT":
            return -2.0 * flight["CT"] / flight["V"]
        return None


def identify(
    flights: Sequence[Flight], simulated: Sequence[Mapping[str, Array]], responses: Sequence[str]
) -> Surrogate:
    """Stand-in for what a simulation says of `responses`.

    Orthogonal functions, each of which must carry its share of the variance, all flights together.

    Parameters
    ----------
    flights : sequence of Flight
        Whose channels the simulation answers to.
    simulated : sequence of mapping of response to (n,) array
    responses : sequence of str
    """
    linear = [c for c in _LINEAR if all(c in f or c in f.channels for f in flights) and _moves(flights, c)]
    together = {c: np.concatenate([f[c] for f in flights]) for c in linear}
    centre = {c: float(x.mean()) for c, x in together.items()}
    scale = {c: float(x.std()) for c, x in together.items()}
    units = {c: (together[c] - centre[c]) / scale[c] for c in linear}
    pool = [(c,) for c in linear] + [s for s in _SECOND if set(s) <= set(linear)]
    X = np.column_stack([np.prod([units[c] for c in term], axis=0) for term in pool]) if pool else np.empty((0, 0))
    step = max(1, len(X) // 4000)
    X = X[::step]
    # The rate of incidence is nearly the pitch rate, and noisier; trimmed flight ties airspeed to incidence.
    liking = np.array([_RATE_WORTH if "alpha_dot_hat" in t else _SPEED_WORTH if "V" in t else 1.0 for t in pool])
    terms, values, constant, r2 = {}, {}, {}, {}
    # An aircraft is nearly the same on both sides: what is odd in one of its halves is not even in the other.
    odd = np.array([sum(c in _SIDEWAYS for c in term) % 2 == 1 for term in pool])
    for response in responses:
        y = np.concatenate([s[response] for s in simulated])[::step]
        alike = (odd == (response in _OF_SIDES)) if response in COEFFICIENTS else np.ones(len(pool), dtype=bool)
        kept = _choose(X, y, np.where(alike, liking, _WRONG_SIDE * liking))
        basis = np.column_stack([np.ones(len(y)), X[:, kept]])
        # A touch of ridge: columns that nearly coincide share their effect instead of cancelling it.
        rows = np.vstack([basis, np.diag([0.0] + [np.sqrt(1e-4 * len(y))] * len(kept))])
        fit = np.linalg.lstsq(rows, np.concatenate([y, np.zeros(len(kept) + 1)]), rcond=None)[0]
        total = float(((y - y.mean()) ** 2).sum())
        left = float(((y - basis @ fit) ** 2).sum())
        terms[response] = tuple(pool[j] for j in kept)
        values[response] = fit[1:]
        constant[response] = float(fit[0])
        r2[response] = 1.0 - left / total if total > 0.0 else 1.0
    return Surrogate(centre, scale, terms, values, constant, r2)


def _moves(flights: Sequence[Flight], channel: str) -> bool:
    x = np.concatenate([f[channel] for f in flights])
    return float(x.std()) > _TINY * max(1.0, float(np.abs(x).max()))


def _choose(X: Array, y: Array, liking: Array) -> list[int]:
    """Columns that carry their share of the variance, largest gain first."""
    left = y - y.mean()
    total = float(left @ left)
    if not X.size or total <= 0.0:
        return []
    Q = X - X.mean(axis=0)
    size = (Q**2).sum(axis=0)
    kept: list[int] = []
    # Residuals of a stand-in are what its form misses, not noise: a term must carry its share of the variance.
    while len(kept) < min(X.shape[1], 20):
        norms = (Q**2).sum(axis=0)
        open_ = norms > 1e-6 * size
        gains = np.where(open_, (Q.T @ left) ** 2 / np.where(open_, norms, 1.0), 0.0)
        j = int(np.argmax(gains * liking))
        if gains[j] * liking[j] < 1e-5 * total:
            break
        kept.append(j)
        q = Q[:, j] / np.sqrt(norms[j])
        left = left - q * (q @ left)
        Q = Q - np.outer(q, q @ Q)
        Q[:, j] = 0.0
    return kept
