"""How the proof of the diagnosis puts an effect into a truth, as data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class BandNoise:
    """Random forcing of unit variance in a band of frequencies, for a `TruthCase`.

    Attributes
    ----------
    low, high : float [Hz]
    beyond : str
        Variable that makes it stronger; empty where nothing does.
    onset : float
        Value of that variable above which it begins; the noise is multiplied by the excess.
    """

    low: float
    high: float
    beyond: str = ""
    onset: float = 0.0


@dataclass(frozen=True)
class Lag:
    """First-order lag y of a variable x, for a `TruthCase`: time_constant y' + y = x, in equilibrium at the start.

    Attributes
    ----------
    of : str
        Variable of the formulas.
    time_constant : float [s]
        Between 0.02 and 5.
    """

    of: str
    time_constant: float


@dataclass(frozen=True)
class Delayed:
    """A variable x as it was some time ago, for a `TruthCase`: y(t) = x(t - delay).

    Attributes
    ----------
    of : str
        Variable of the formulas.
    delay : float [s]
        Between 0.02 and 5.
    """

    of: str
    delay: float


@dataclass(frozen=True)
class TruthCase:
    """How the proof of the diagnosis puts the effect into a truth. Data only; the package ``proof`` picks it up.

    Write it from the literature, with another formula, other states or another parametrisation than the effect's own
    variants: a diagnosis that is proved against its own formula proves nothing. A test refuses a term, or a sum of
    terms, that equals a column of the effect, unless the effect is a plain term by nature (kinds ``parameter`` and
    ``sensor``).

    Attributes
    ----------
    terms : mapping of coefficient to mapping of formula to value
        Increments of the six coefficients by a truth of size 1. A formula is a product of at most four factors, powers
        counted: "CT*de" or "alpha^2*beta". Factors are the signals and these variables, in SI units: 1, alpha, beta,
        p_hat, q_hat, r_hat, de, da, dr (of the surfaces), df, CT (thrust over dynamic pressure and area), CL,
        abs_alpha, abs_beta, abs_de, abs_da, abs_dr.
    sizes : (low, high)
        Between which the proof seeks the size that shows as much as it wants.
    manoeuvres : tuple of str
        That show it: elevator, aileron, rudder, multisine, turn, throttle, speed, pull-up, stall, low-pass, sideslip,
        large, flap (it extends and retracts). A name given twice is simulated twice. Cases with flap or df are drawn
        of aircraft with flaps only, and record df.
    ties : tuple of str
        Effects that may be declared ambiguous with it.
    signals : mapping of name to Lag, Delayed or BandNoise
        At most four lags and delays, and one noise. A name is a word that no variable has.
    """

    terms: Mapping[str, Mapping[str, float]]
    sizes: tuple[float, float] = (0.02, 5.0)
    manoeuvres: tuple[str, ...] = ()
    ties: tuple[str, ...] = ()
    signals: Mapping[str, BandNoise | Lag | Delayed] = field(default_factory=dict)
