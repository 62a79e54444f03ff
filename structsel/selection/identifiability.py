"""Terms these data cannot tell apart, and the flying that would."""

from __future__ import annotations

from dataclasses import dataclass

from structsel.candidates import Term
from structsel.nomenclature import UNKNOWN
from structsel.selection.flown import Flown

EXCITATION = {
    "V_ratio": "fly the same inputs at other speeds",
    "V": "fly the same inputs at other speeds",
    "qbar": "fly the same inputs at other speeds or heights",
    "mach": "fly the same inputs at another Mach number",
    "CT": "fly the same inputs at other power options",
    "thrust": "fly the same inputs at other power options",
    "throttle": "fly the same inputs at other power options",
    "alpha": "fly the same inputs about other trim incidences, or larger pitch inputs",
    "beta": "add rudder inputs or steady sideslips",
    "p_hat": "add aileron inputs (bank to bank)",
    "q_hat": "add sharp elevator inputs (a doublet or 3-2-1-1)",
    "r_hat": "add rudder inputs",
    "alpha_dot_hat": "add motion in which incidence and pitch rate part: steady pull-ups and turns, or plunging",
    "beta_dot_hat": "add motion in which sideslip and yaw rate part: steady turns, flat sideslips",
    "de": "move the elevator independently of the motion (an unaugmented doublet or a multisine)",
    "da": "move the ailerons independently of the rudder and the motion",
    "dr": "move the rudder independently of the ailerons and the motion",
    "df": "repeat at other flap options",
}


@dataclass(frozen=True)
class Alias:
    """Two terms between which these data do not decide.

    Attributes
    ----------
    kept, other : Term
        The one in the model, and the one that could stand in its place.
    loss : float [-]
        Rise of the residual sum of squares on the exchange, in units of its variance (4 is twice a likelihood
        ratio of e^2); below zero the other even fits better.
    correlation : float [-]
        Of the two, the model's other terms removed.
    to_separate : str
        The flying that would tell them apart.
    """

    kept: Term
    other: Term
    loss: float
    correlation: float
    to_separate: str

    def __str__(self) -> str:
        return (
            f"{self.kept} or {self.other} (correlation {self.correlation:+.3f}, loss {self.loss:.1f} s^2): "
            f"{self.to_separate}"
        )


def describe_spread(name: str, flown: Flown) -> str:
    """Mean, standard deviation and unit of a channel over recordings, in words."""
    spread = flown.spread(name)
    unit = "" if flown.unit(name) in ("-", UNKNOWN) else f" {flown.unit(name)}"
    return f"{name} = {spread.mean:.4g} +- {spread.std:.2g}{unit}"


def to_separate(kept: Term, other: Term, flown: Flown) -> str:
    """The excitation that would separate two terms: what they differ in must move by itself."""
    only_kept, only_other = _difference(kept, other), _difference(other, kept)
    differing = sorted({c for side in (only_kept, only_other) for f in side for c in f})
    if not differing:
        differing = sorted({*kept.channels, *other.channels})
    if bool(only_kept) != bool(only_other):
        name = differing[0]
        advice = EXCITATION.get(name, f"vary {name}")
        return f"they differ only by {describe_spread(name, flown)}, which hardly varies: {advice}"
    advice = "; ".join(dict.fromkeys(EXCITATION.get(name, f"vary {name} by itself") for name in differing))
    return f"{' and '.join(differing)} move together here: {advice}"


def _difference(a: Term, b: Term) -> list[tuple[str, ...]]:
    """Channels of each factor that ``a`` has more of than ``b``."""
    powers = dict(b.factors)
    return [tuple(f.channels) for f, power in a.factors if power > powers.get(f, 0)]
