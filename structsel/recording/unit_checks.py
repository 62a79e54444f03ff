"""Units and signs that several channels show together: rates and attitude, airspeed and dynamic pressure, gravity."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from structsel.recording.finding import Finding

_UNIT_REMEDY = "state the unit in the channel map"


def find_unit_errors(channels: Mapping[str, np.ndarray]) -> list[Finding]:
    """Findings about units and signs from relations between channels; channels that are not finite are not used."""
    compared = dict.fromkeys(["az", *(name for relation in _RELATIONS for name in relation.needs)])
    usable = {name: channels[name] for name in compared if name in channels and np.isfinite(channels[name]).all()}
    found: list[Finding] = []
    if "az" in usable:
        found += _check_gravity(usable["az"])
    for relation in _RELATIONS:
        if all(name in usable for name in relation.needs):
            found += _check_relation(relation, usable)
    return found


def _check_gravity(az: np.ndarray) -> list[Finding]:
    """The mean of az is near -9.8 m/s^2, because a flight is mostly near a load factor of 1."""
    mean, peak = float(az.mean()), float(np.abs(az).max())
    if -2.0 < mean < -0.5 and peak < 9.0 and np.mean(az < 0.0) > 0.9:
        message = f"its mean is {mean:.3g} m/s^2, as if g were fed as m/s^2"
        return [Finding("unit", "az", message, "warning", 'state unit = "g" in the channel map')]
    if 0.8 < mean < 1.2 or 8.0 < mean < 12.0:
        message = f"its mean is {mean:+.3g}; body z is down, so it should be negative"
        return [Finding("sign", "az", message, "warning", "give it sign = -1 in the channel map")]
    return []


@dataclass(frozen=True)
class _Relation:
    """A ratio of channels that is 1 where their units are right.

    Attributes
    ----------
    channel : str
        To which the finding belongs.
    needs : tuple of str
        Channels of the ratio.
    ratio : callable
    errors : dict of float to str
        The ratio that a wrong unit gives, and the wrong unit.
    message : str
    """

    channel: str
    needs: tuple[str, ...]
    ratio: Callable[..., np.ndarray]
    errors: dict[float, str]
    message: str


def _check_relation(relation: _Relation, channels: Mapping[str, np.ndarray]) -> list[Finding]:
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = relation.ratio(*(channels[name] for name in relation.needs))
    ratios = ratios[np.isfinite(ratios)]
    return [
        Finding("unit", relation.channel, f"{relation.message}, as if {error}", "warning", _UNIT_REMEDY)
        for factor, error in relation.errors.items()
        if ratios.size and abs(float(np.median(ratios)) / factor - 1.0) < 0.1
    ]


def _standard_height(rho: np.ndarray) -> np.ndarray:
    """Altitude [m] at which the standard atmosphere's troposphere has density `rho`."""
    return (1.0 - (rho / 1.225) ** (1.0 / 4.25588)) / 2.25577e-5


_RELATIONS = (
    _Relation(
        "V",
        ("V", "rho", "qbar"),
        lambda V, rho, qbar: V / np.sqrt(2.0 * qbar / rho),
        {1.94384: "knots were fed as m/s", 3.28084: "ft/s were fed as m/s", 3.6: "km/h were fed as m/s"},
        "does not agree with qbar and rho",
    ),
    _Relation(
        "V",
        ("V", "mach"),
        lambda V, mach: V / mach / 318.0,  # m/s, speed of sound of the mid troposphere
        {1.94384: "knots were fed as m/s", 3.28084: "ft/s were fed as m/s"},
        "V / mach is no speed of sound",
    ),
    _Relation(
        "h",
        ("h", "rho"),
        lambda h, rho: h / np.where(rho < 1.15, _standard_height(rho), np.nan),
        {3.28084: "feet were fed as metres"},
        "does not agree with the air density",
    ),
)
