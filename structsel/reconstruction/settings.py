"""Options of `reconstruct`: one field for each of its keyword arguments, checked before data are read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from structsel.errors import DomainError
from structsel.nomenclature import suggest
from structsel.numerics import kinematics as fp
from structsel.numerics.atmosphere import G0
from structsel.options import option

Method: TypeAlias = Literal["unscented", "extended", "output-error"]
METHODS = ("unscented", "extended", "output-error")
INERTIAL = fp.INPUTS[:6]
"""The channels that drive the kinematics."""
BIASES = ("bax", "bay", "baz", "bp", "bq", "br")
ESTIMATED = (*BIASES, "wn", "we", "Cup", "Calpha0", "Csi")
"""Constants that are estimated by default, if the recording determines them."""
SCALES = tuple(fp.STATES[fp.SCALE : fp.GUST])
"""Scale errors that are estimated by default, if the recording determines them and they predict it better."""
PRIOR = {
    **dict.fromkeys(BIASES[:3], 0.5),
    **dict.fromkeys(BIASES[3:], 0.02),
    **dict.fromkeys(("wn", "we"), 15.0),
    "wd": 2.0,
    "Cup": 0.2,
    "Calpha0": 0.03,
    "Csi": 0.2,
    "Cbeta0": 0.03,
    "KV": 0.05,
    **dict.fromkeys(("Kphi", "Ktheta"), 0.05),
    # Gravity calibrates accelerometers, and a rate table gyros.
    **dict.fromkeys(("Kax", "Kay", "Kaz", "Kp", "Kq", "Kr"), 0.03),
}
"""Prior standard deviations of the constants about zero, in SI units; chosen for instruments without faults."""

_ESTIMATION, _FINE = "What is estimated", "Fine tuning"


@dataclass(frozen=True)
class ReconstructOptions:
    """Options of `reconstruct`: estimated quantities, method, and prior knowledge.

    Attributes
    ----------
    method : {"unscented", "extended", "output-error"}
        Square-root unscented filter and smoother; the extended Kalman filter and smoother; or the batch maximum-
        likelihood compatibility check, which takes the inertial readings as free of noise.
    estimate : iterable of str, optional
        Constants to estimate if the data determine them: bax bay baz bp bq br, wn we wd, Cup Calpha0 Csi, KV,
        and the scale errors Kphi Ktheta Kax Kay Kaz Kp Kq Kr. By default all but wd, KV and the scale errors. Cbeta0
        may be named, and is refused with the reason.
    scales : {"auto", "none"}
        Without `estimate`, also those scale errors that the data determine and that predict the readings better; or
        none.
    noise : mapping of str to float, optional
        Standard deviations by channel, in place of those of the aircraft's sensors. Others are estimated.
    prior : mapping of str to float, optional
        Standard deviation of a state before any reading: of a constant about zero, of motion about the first readings.
    drift : mapping of str to float, optional
        Random walk of a constant [its unit / sqrt(s)]; without, it is constant.
    gusts : "auto" or float [m/s]
        Standard deviation of turbulence along each axis, which vanes and pitot measure and the inertial instruments
        do not: estimated from the data; or this value, 0 for calm air. Output error has no turbulence.
    delays : {"report", "estimate"} or mapping of str to float [s]
        Only report the delay of each channel; estimate the delays and advance the channels; or advance by these.
    gate : float [-]
        Readings farther from their prediction, in standard deviations, are counted and not used; 0 uses all.
    spread : float [-]
        Of the sigma points, as in `structsel.reconstruction.ukf.ukf_smoother`.
    g : float [m/s^2]

    Raises
    ------
    DomainError
        An option out of range.
    """

    method: Method = option(
        "unscented",
        help="unscented or extended: Kalman filter and smoother; output-error: inertial readings free of noise.",
        group=_ESTIMATION,
    )
    estimate: Iterable[str] | None = option(
        None,
        help=f"Constants to estimate, of {' '.join(PRIOR)}; {' '.join(ESTIMATED)} if absent.",
        group=_ESTIMATION,
        metavar="NAMES",
    )
    scales: Literal["auto", "none"] = option(
        "none",
        help="auto: estimate scale errors of attitude, gyros and accelerometers that the data support; or none.",
        group=_ESTIMATION,
    )
    noise: Mapping[str, float] | None = option(
        None, help="Noise of channels, standard deviation in SI units.", group=_FINE, metavar="CHANNEL=STD,..."
    )
    prior: Mapping[str, float] | None = option(
        None, help="Standard deviation of a state before any reading.", group=_FINE, metavar="NAME=STD,..."
    )
    drift: Mapping[str, float] | None = option(
        None, help="Random walk of a constant, in its unit per root second.", group=_FINE, metavar="NAME=RATE,..."
    )
    gusts: float | Literal["auto"] = option(
        "auto",
        help="auto: estimate the turbulence; or its standard deviation in m/s, 0 for none.",
        group=_ESTIMATION,
        metavar="HOW",
    )
    delays: Literal["report", "estimate"] | Mapping[str, float] = option(
        "report",
        help="report; estimate: estimate and remove them; or seconds: alpha=0.12,beta=0.1.",
        group=_ESTIMATION,
        metavar="HOW",
    )
    gate: float = option(6.0)
    spread: float = option(1.0)
    g: float = option(G0, help="Acceleration of gravity, in m/s^2.", group=_FINE)

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise DomainError(f"reconstruct has no method {self.method!r}; it has {', '.join(METHODS)}.")
        if isinstance(self.delays, str) and self.delays not in ("report", "estimate"):
            raise DomainError(
                f"reconstruct: delays are 'report', 'estimate' or a table of seconds, not {self.delays!r}."
            )
        if self.gusts != "auto" and not (isinstance(self.gusts, int | float) and 0.0 <= self.gusts < np.inf):
            raise DomainError(
                f"reconstruct: gusts are 'auto' or a standard deviation of 0 or above [m/s], not {self.gusts!r}."
            )
        if not self.gate >= 0.0:
            raise DomainError(f"reconstruct: gate must be 0 or above; it is {self.gate!r}.")
        if self.estimate is not None:
            object.__setattr__(self, "estimate", tuple(self.estimate))
        _check_names("estimate", self.estimate or (), PRIOR)
        _check_numbers("prior", self.prior, fp.STATES)
        _check_numbers("drift", self.drift, PRIOR)
        _check_numbers("noise", self.noise, (*INERTIAL, *fp.MEASUREMENTS))

    @property
    def constants(self) -> tuple[str, ...]:
        """Constants to estimate."""
        return ESTIMATED if self.estimate is None else tuple(self.estimate)

    @property
    def filter_spread(self) -> float:
        """Spread of the sigma points, 0 for the extended filter."""
        return 0.0 if self.method == "extended" else self.spread


def _check_names(name: str, given: Iterable[str], known: Iterable[str]) -> None:
    for one in given:
        if one not in known:
            raise DomainError(
                f"reconstruct: {name} names '{one}', which is none of {', '.join(known)}.{suggest(one, known)}"
            )


def _check_numbers(name: str, given: Mapping[str, float] | None, known: Iterable[str]) -> None:
    _check_names(name, given or (), known)
    for key, value in (given or {}).items():
        if not (np.isfinite(value) and value > 0.0):
            raise DomainError(f"reconstruct: {name}['{key}'] must be above zero; it is {value!r}.")
