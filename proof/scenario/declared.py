"""Effects whose proof case is declared as data with the effect: see `structsel.effects.TruthCase`.

The declaration reaches this package as data, from `proof.generate`, so that the generators of cases need not import
the effects. Formulas are products of powers of `VARIABLES` and of the declaration's own signals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.signal import butter, sosfilt

from proof.keys import COEFFICIENTS, Kind
from structsel.errors import DataError

VARIABLES = ("1", "alpha", "beta", "p_hat", "q_hat", "r_hat", "de", "da", "dr", "CT", "CL", "abs_alpha", "abs_beta",
             "abs_de", "abs_da", "abs_dr")  # fmt: skip
"""What a formula may hold in either plant; CT is thrust over dynamic pressure and area."""
MANOEUVRES = {
    "elevator": ("elevator", "pitch"), "aileron": ("aileron", "lateral"), "rudder": ("rudder", "lateral"),
    "multisine": ("multisine", "multisine"), "turn": ("turns", "turn"), "throttle": ("throttle", "throttle"),
    "speed": ("speeds", "speed"), "pull-up": ("pull-up", "pull-up"), "stall": ("stall", "stall"),
    "low-pass": ("low-pass", "low"), "sideslip": ("sideslip", "lateral"), "large": ("large", "pitch"),
}  # fmt: skip
"""Names that a declaration uses -> those of the polynomial plant and of JSBSim."""
Factors = tuple[tuple[str, int], ...]


class Signal(Protocol):
    """Random forcing in a band of frequencies; see `structsel.effects.BandNoise`."""

    @property
    def low(self) -> float: ...  # noqa: D102

    @property
    def high(self) -> float: ...  # noqa: D102

    @property
    def beyond(self) -> str: ...  # noqa: D102

    @property
    def onset(self) -> float: ...  # noqa: D102


class Truth(Protocol):
    """As `structsel.effects.TruthCase`."""

    @property
    def terms(self) -> Mapping[str, Mapping[str, float]]: ...  # noqa: D102

    @property
    def signals(self) -> Mapping[str, Signal]: ...  # noqa: D102

    @property
    def sizes(self) -> tuple[float, float]: ...  # noqa: D102

    @property
    def manoeuvres(self) -> tuple[str, ...]: ...  # noqa: D102

    @property
    def ties(self) -> tuple[str, ...]: ...  # noqa: D102


@dataclass(frozen=True)
class DeclaredEffect:
    """An effect whose case is declared.

    Attributes
    ----------
    name, kind : str
    truth : Truth
    terms : tuple of (coefficient, factors, value)
        Factors are (variable or signal, power).
    """

    name: str
    kind: Kind
    truth: Truth
    terms: tuple[tuple[str, Factors, float], ...]

    @property
    def axes(self) -> tuple[str, ...]:
        """Coefficients that it touches."""
        return tuple(self.truth.terms)

    def manoeuvres(self, plant: int) -> tuple[str, ...]:
        """Purposes of manoeuvres that show it: 0 in the polynomial plant, 1 in JSBSim."""
        return tuple(MANOEUVRES[name][plant] for name in self.truth.manoeuvres)


def declare(name: str, kind: Kind, truth: Truth) -> DeclaredEffect:
    """Read a declaration.

    Raises
    ------
    DataError
        A coefficient, variable or manoeuvre that is not known, or more than one signal.
    """
    if len(truth.signals) > 1:
        raise DataError(f"the proof case of '{name}' has {len(truth.signals)} signals; there is room for one.")
    for what, given, known in (
        ("coefficient", truth.terms, COEFFICIENTS),
        ("manoeuvre", truth.manoeuvres, MANOEUVRES),
        ("limiting variable", [s.beyond for s in truth.signals.values() if s.beyond], VARIABLES),
    ):
        if strange := [g for g in given if g not in known]:
            raise DataError(f"the proof case of '{name}' has the {what} '{strange[0]}'; known are {', '.join(known)}.")
    terms = tuple(
        (axis, factors_of(formula, (*VARIABLES, *truth.signals), name), value)
        for axis, held in truth.terms.items()
        for formula, value in held.items()
    )
    return DeclaredEffect(name, kind, truth, terms)


def factors_of(formula: str, known: Sequence[str], name: str) -> Factors:
    """(variable, power) of each factor of a product such as "CT*de" or "alpha^2*beta"."""
    factors = []
    for part in formula.replace(" ", "").split("*"):
        variable, _, power = part.partition("^")
        if variable not in known or (power and not power.isdigit()):
            raise DataError(
                f"the proof case of '{name}' has the formula '{formula}', which is no product of powers of "
                f"{', '.join(known)}."
            )
        factors.append((variable, int(power or 1)))
    return tuple(factors)


def product(factors: Factors, values: Mapping[str, np.ndarray | float]) -> np.ndarray | float:
    """A term's factors multiplied."""
    made: np.ndarray | float = 1.0
    for variable, power in factors:
        made = made * values[variable] ** power
    return made


def band_noise(signal: Signal, t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(n,) noise of unit variance within the signal's band, at even times."""
    sos = butter(2, (signal.low, signal.high), "bandpass", fs=1.0 / float(t[1] - t[0]), output="sos")
    made = np.asarray(sosfilt(sos, rng.standard_normal(len(t) + 400)))[400:]
    return np.asarray(made / made.std())


def strength(signal: Signal, values: Mapping[str, np.ndarray | float]) -> np.ndarray | float:
    """Factor on a signal's noise: how far its variable is beyond the onset; 1 where nothing bounds it."""
    return np.maximum(values[signal.beyond] - signal.onset, 0.0) if signal.beyond else 1.0
