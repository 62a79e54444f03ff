"""Functions of the channels and of their recent past, whose sum is any smooth function: physics that has no name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from structsel.comparison.causal_rows import CausalRows, Null
from structsel.comparison.flight import Flight
from structsel.comparison.past_motion import DELAY, PLANT_PAST, delayed
from structsel.nomenclature import COEFFICIENTS, CONFIGURATION
from structsel.numerics.arrays import Array

_CHANNELS = (
    "alpha", "beta", "p_hat", "q_hat", "r_hat", "de", "da", "dr", "mach", "CT", "h_agl", *CONFIGURATION,
)  # fmt: skip
ATTITUDE = ("phi", "theta", "psi")
_MOTION = frozenset({"alpha", "beta", "p_hat", "q_hat", "r_hat", "mach", "CT", "h_agl", *ATTITUDE})
_PRODUCTS = (
    ("alpha", "beta"), ("alpha", "de"), ("alpha", "da"), ("alpha", "dr"), ("alpha", "q_hat"), ("alpha", "p_hat"),
    ("alpha", "r_hat"), ("CT", "de"), ("CT", "alpha"), ("CT", "beta"), ("alpha", "mach"), ("de", "mach"),
    ("beta", "mach"), ("da", "mach"), ("p_hat", "r_hat"), ("q_hat", "mach"), ("p_hat", "mach"), ("alpha", "h_agl"),
)  # fmt: skip
_PAST = ("alpha", "beta", "de", "da", "dr", "q_hat", "p_hat", "r_hat", "CT")
_DELAYS = (0.15, 0.4, 1.0)  # s
_ORDERS = 4  # cosines over the range of a channel
_SECOND = 0.7  # weight of products and of changes since before, relative to channels themselves
_CHANGES = 0.3  # rms change of a channel since before, relative to its own, below which it has little memory

_SIZES = np.array([0.003, 0.006, 0.012, 0.025, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.0])
"""Sizes of an unknown function of the channels, relative to the rms variation of the simulated response."""
FORM, _FORM_IDENTIFIED = 0.015, 0.05
"""Sizes within the tolerance `form`: for a simulation that states coefficients, and for one that was identified: its
coefficients from its own flights, or that of a plant."""
Signals = Sequence[Array]
"""One signal (n,) per flight."""


@dataclass
class _Functions:
    """Functions per flight, with their weights in the prior."""

    columns: list[Signals] = field(default_factory=list)
    weights: list[float] = field(default_factory=list)

    def add(self, x: Signals, weight: float, moved: bool, least: float = 0.0) -> None:
        """One function, of rms one or less where its own is below `least`; delayed by some samples if it is motion."""
        lagged = [delayed(one, DELAY) for one in x] if moved else x
        together = np.concatenate(lagged)
        size = max(float(together.std()), least)
        if size > 1e-9:
            self.columns.append([(one - together.mean()) / size for one in lagged])
            self.weights.append(weight)

    def add_channel(self, x: Signals, moved: bool) -> Signals:
        """A channel and cosines over its range; returns the channel about its mean, of rms one."""
        together = np.concatenate(x)
        low, high = np.quantile(together, [0.002, 0.998])
        along = [np.clip((one - low) / max(high - low, 1e-300), -0.05, 1.05) for one in x]
        unit = [(one - together.mean()) / together.std() for one in x]
        self.add(unit, 1.0, moved)
        for k in range(2, _ORDERS + 1):
            self.add([np.cos(np.pi * k * one) for one in along], 1.0 / (1.0 + (k / 4.0) ** 2), moved)
        return unit

    def add_product(self, one: Signals, other: Signals, moved: bool) -> None:
        """Product of two channels."""
        self.add([x * y for x, y in zip(one, other)], _SECOND, moved)

    def add_past(self, x: Signals, samples: Sequence[int], moved: bool) -> None:
        """Change of a channel since samples before; it keeps its size, as one that hardly changes has no memory."""
        self.add([delayed(one, max(1, k)) - one for one, k in zip(x, samples)], _SECOND, moved, _CHANGES)

    def stacked(self, flights: int) -> list[Array]:
        """(n, k) columns per flight, together of rms one."""
        w = np.array(self.weights) / np.linalg.norm(self.weights)
        return [np.column_stack([column[i] for column in self.columns]) * w for i in range(flights)]


def features(flights: Sequence[Flight], further: Sequence[str] = ()) -> list[Array]:
    """Functions of an aircraft's channels and of their recent past, per flight; each of the same rms, together of one.

    The motion is delayed by some samples, the inputs are not. Products of `further` channels are those with the angle
    of attack.
    """
    each: dict[str, Signals] = {}
    for c in (*_CHANNELS, *further):
        if all(c in f or c in f.channels for f in flights):
            x = [np.asarray(f[c], dtype=float) for f in flights]
            if _varies(x, 1.0):
                each[c] = [np.log(np.maximum(one, 0.0) + 2.0) for one in x] if c == "h_agl" else x
    made = _Functions()
    unit = {c: made.add_channel(x, c in _MOTION) for c, x in each.items()}
    for a, b in (*_PRODUCTS, *(("alpha", c) for c in further)):
        if a in unit and b in unit:
            made.add_product(unit[a], unit[b], a in _MOTION or b in _MOTION)
    for c in (c for c in _PAST if c in unit):
        for delay in _DELAYS:
            made.add_past(unit[c], [round(delay / f.dt) for f in flights], c in _MOTION)
    return made.stacked(len(flights))


def plant_features(flights: Sequence[Flight], responses: Sequence[str]) -> list[Array]:
    """Functions of what a plant's recordings contain besides its responses, and of some simulated responses.

    Which channels are inputs and which are motion is not known: all that is recorded is delayed by some samples.
    """
    simulated = flights[0].simulated
    recorded = [c for c in sorted(flights[0].channels) if c not in simulated and all(c in f.channels for f in flights)]
    signals = [([f.channels[c] for f in flights], True) for c in recorded]
    signals += [([f.simulated[c] for f in flights], False) for c in responses]
    shortest = min(map(len, flights))
    made = _Functions()
    unit = [(made.add_channel(x, moved), moved) for x, moved in signals if _varies(x)]
    for x, moved in unit:
        for part in PLANT_PAST:
            made.add_past(x, [round(part * shortest)] * len(flights), moved)
    for k, (x, moved) in enumerate(unit):
        for other, too in unit[k + 1 :]:
            made.add_product(x, other, moved or too)
    return made.stacked(len(flights))


def of_unit_size(F: Sequence[Array]) -> list[Array]:
    """Columns that vary, each with the standard deviation one over all flights."""
    size = np.concatenate(F).std(axis=0)
    return [x[:, size > 1e-9] / size[size > 1e-9] for x in F]


def _varies(x: Signals, least: float = 0.0) -> bool:
    together = np.concatenate(x)
    return bool(np.ptp(together) > 1e-9 * max(least, float(np.abs(together).max())))


def form_of(flights: Sequence[Flight], responses: Sequence[str]) -> dict[str, float]:
    """Error of the form of the simulation of each response, relative to the rms by which it varies."""
    exact = not flights[0].is_identified and any(c in COEFFICIENTS for c in responses)
    least = FORM if exact else _FORM_IDENTIFIED
    stated = [dict.fromkeys(responses, least), flights[0].form_error, flights[0].fit_error]
    return {c: max(one.get(c, 0.0) for one in stated) for c in responses}


def unknown_function(
    rows: CausalRows, null: Null, response: str, F: Sequence[Array], single: Sequence[Array], form: float
) -> float:
    """Log Bayes factor of an unknown function of the channels: of all features together, or of one of them alone.

    A prior that spreads over a hundred features has no evidence of a function that is one of them: of a moment that
    follows the square of the bank angle, 0.6 of the variance of Cm, -1 together and 163 alone. Alone, 13 correct
    simulations (development seeds) have -2 at most. None is larger than a form that leaves more than the response.
    """
    if not np.any(form < _SIZES):
        return -np.inf
    together = log_bayes_beyond_form(rows, null, response, [x * rows.size[response] for x in F], form)
    each = [x * rows.size[response] for x in single]
    by_itself = rows.single(null, response, dict(enumerate(each)), _SIZES[form < _SIZES])
    k = int(np.argmax(scipy.special.logsumexp(by_itself, axis=1)))  # the likeliest, with the noise of the null
    alone = log_bayes_beyond_form(rows, null, response, [x[:, [k]] for x in each], form) - np.log(each[0].shape[1])
    return float(np.logaddexp(together, alone) - np.log(2.0))


def log_bayes_beyond_form(rows: CausalRows, null: Null, response: str, F: Sequence[Array], form: float) -> float:
    """Log Bayes factor of an unknown function of the channels beyond the tolerance of the form."""
    within = form >= _SIZES
    beyond = rows.remainder(null, response, F, _SIZES[~within]).log_bayes
    return beyond if beyond < 0.0 else beyond - max(0.0, rows.remainder(null, response, F, _SIZES[within]).log_bayes)
