"""Effects whose proof case is declared as data with the effect: see `structsel.effects.TruthCase`.

The declaration reaches this package as data, from `proof.generate`, so that the generators of cases need not import
the effects. Formulas are products of powers of `VARIABLES` and of the declaration's own signals: one random signal, and
lags and delays of variables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from scipy.signal import butter, sosfilt

from proof.keys import COEFFICIENTS, Kind
from structsel.errors import DataError

VARIABLES = ("1", "alpha", "beta", "p_hat", "q_hat", "r_hat", "de", "da", "dr", "df", "CT", "CL", "abs_alpha",
             "abs_beta", "abs_de", "abs_da", "abs_dr")  # fmt: skip
"""What a formula may hold in either plant; CT is thrust over dynamic pressure and area."""
MAX_FACTORS = 4
"""Of one term, powers counted."""
MAX_FOLLOWING = 4
"""Lags and delays of one case."""
LIMITS = (0.02, 5.0)
"""Of a time constant or a delay [s]: two steps of the plants, and the time simulated before a recording begins."""
FLAP = "flap"
MANOEUVRES = {
    "elevator": ("elevator", "pitch"), "aileron": ("aileron", "lateral"), "rudder": ("rudder", "lateral"),
    "multisine": ("multisine", "multisine"), "turn": ("turns", "turn"), "throttle": ("throttle", "throttle"),
    "speed": ("speeds", "speed"), "pull-up": ("pull-up", "pull-up"), "stall": ("stall", "stall"),
    "low-pass": ("low-pass", "low"), "sideslip": ("sideslip", "lateral"), "large": ("large", "pitch"),
    FLAP: ("flap-extension", "df"),
}  # fmt: skip
"""Names that a declaration uses -> those of the polynomial plant and of JSBSim."""
Factors = tuple[tuple[str, int], ...]


@runtime_checkable
class Noise(Protocol):
    """Random forcing in a band of frequencies; see `structsel.effects.BandNoise`."""

    @property
    def low(self) -> float: ...  # noqa: D102

    @property
    def high(self) -> float: ...  # noqa: D102

    @property
    def beyond(self) -> str: ...  # noqa: D102

    @property
    def onset(self) -> float: ...  # noqa: D102


@runtime_checkable
class Lag(Protocol):
    """First-order lag of a variable; see `structsel.effects.Lag`."""

    @property
    def of(self) -> str: ...  # noqa: D102

    @property
    def time_constant(self) -> float: ...  # noqa: D102


@runtime_checkable
class Delayed(Protocol):
    """A variable some time ago; see `structsel.effects.Delayed`."""

    @property
    def of(self) -> str: ...  # noqa: D102

    @property
    def delay(self) -> float: ...  # noqa: D102


Signal = Noise | Lag | Delayed


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
class FollowingSignal:
    """A variable after a first-order lag or a delay.

    Attributes
    ----------
    name, of : str
        Its own name, and the variable that it follows.
    time_constant, delay : float [s]
        One of them is 0.
    """

    name: str
    of: str
    time_constant: float = 0.0
    delay: float = 0.0


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

    @property
    def noise(self) -> dict[str, Noise]:
        """The random signal by its name, if there is one."""
        return {name: signal for name, signal in self.truth.signals.items() if isinstance(signal, Noise)}

    @property
    def following(self) -> tuple[FollowingSignal, ...]:
        """Lags and delays."""
        return tuple(
            FollowingSignal(name, s.of, s.time_constant)
            if isinstance(s, Lag)
            else FollowingSignal(name, s.of, 0.0, s.delay)
            for name, s in self.truth.signals.items()
            if not isinstance(s, Noise)
        )

    @property
    def needs_flap(self) -> bool:
        """Whether only an aircraft with flaps can have it."""
        return FLAP in self.truth.manoeuvres

    def manoeuvres(self, plant: int) -> tuple[str, ...]:
        """Purposes of manoeuvres that show it: 0 in the polynomial plant, 1 in JSBSim."""
        return tuple(MANOEUVRES[name][plant] for name in self.truth.manoeuvres)


def declare(name: str, kind: Kind, truth: Truth) -> DeclaredEffect:
    """Read a declaration.

    Raises
    ------
    DataError
        A coefficient, variable or manoeuvre that is not known; too many signals or factors; a lag or delay beyond
        `LIMITS`; a flap that does not move.
    """
    signals = truth.signals.values()
    for what, given, known in (
        ("coefficient", truth.terms, COEFFICIENTS),
        ("manoeuvre", truth.manoeuvres, MANOEUVRES),
        ("limiting variable", [s.beyond for s in signals if isinstance(s, Noise) and s.beyond], VARIABLES),
        ("variable of a signal", [s.of for s in signals if not isinstance(s, Noise)], VARIABLES),
    ):
        if strange := [g for g in given if g not in known]:
            raise DataError(f"the proof case of '{name}' has the {what} '{strange[0]}'; known are {', '.join(known)}.")
    terms = tuple(
        (axis, factors_of(formula, (*VARIABLES, *truth.signals), name), value)
        for axis, held in truth.terms.items()
        for formula, value in held.items()
    )
    declared = DeclaredEffect(name, kind, truth, terms)
    _check_signals(declared)
    return declared


def _check_signals(declared: DeclaredEffect) -> None:
    """Refuse names that are taken, signals too many or too fast or too slow, and a flap that does not move."""
    name, signals = declared.name, declared.truth.signals
    if taken := [s for s in signals if s in VARIABLES or not s.isidentifier()]:
        raise DataError(f"the proof case of '{name}' has a signal '{taken[0]}'; its name must be a word of its own.")
    noises, following = len(declared.noise), declared.following
    if noises > 1 or len(following) > MAX_FOLLOWING:
        raise DataError(
            f"the proof case of '{name}' has {noises} random signals and {len(following)} lags and delays; "
            f"there is room for one and {MAX_FOLLOWING}."
        )
    low, high = LIMITS
    for s in following:
        if not low <= max(s.time_constant, s.delay) <= high:
            raise DataError(f"signal '{s.name}' of the proof case of '{name}' needs between {low} and {high} s.")
    moved = {s.of for s in following} | {f for _, factors, _ in declared.terms for f, _ in factors}
    if "df" in moved and not declared.needs_flap:
        raise DataError(f"the proof case of '{name}' uses df, which moves in the manoeuvre '{FLAP}' only.\nAdd it.")


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
    if (count := sum(power for _, power in factors)) > MAX_FACTORS:
        raise DataError(
            f"the proof case of '{name}' has the formula '{formula}' of {count} factors; {MAX_FACTORS} fit."
        )
    return tuple(factors)


def product(factors: Factors, values: Mapping[str, np.ndarray | float]) -> np.ndarray | float:
    """A term's factors multiplied."""
    made: np.ndarray | float = 1.0
    for variable, power in factors:
        made = made * values[variable] ** power
    return made


def band_noise(signal: Noise, t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(n,) noise of unit variance within the signal's band, at even times."""
    sos = butter(2, (signal.low, signal.high), "bandpass", fs=1.0 / float(t[1] - t[0]), output="sos")
    made = np.asarray(sosfilt(sos, rng.standard_normal(len(t) + 400)))[400:]
    return np.asarray(made / made.std())


def strength(signal: Noise, values: Mapping[str, np.ndarray | float]) -> np.ndarray | float:
    """Factor on a signal's noise: how far its variable is beyond the onset; 1 where nothing bounds it."""
    return np.maximum(values[signal.beyond] - signal.onset, 0.0) if signal.beyond else 1.0
