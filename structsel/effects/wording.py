"""How findings name channels and give angles."""

from __future__ import annotations

import numpy as np

from structsel.effects.base import FittedEffect

INSTRUMENTS = {
    "V": "the airspeed", "alpha": "the angle of attack vane", "beta": "the sideslip vane",
    "ax": "the longitudinal accelerometer (ax)", "ay": "the lateral accelerometer (ay)",
    "az": "the normal accelerometer (az)", "p": "the roll gyro (p)", "q": "the pitch gyro (q)",
    "r": "the yaw gyro (r)", "phi": "the bank angle", "theta": "the pitch attitude", "psi": "the heading",
    "de": "the elevator's reading", "da": "the aileron's reading", "dr": "the rudder's reading",
}  # fmt: skip
"""Of a channel, what a reader calls its instrument."""
SURFACES = {"de": "elevator", "da": "aileron", "dr": "rudder", "df": "flap"}


def shown(found: FittedEffect, name: str) -> str:
    """A parameter with its standard deviation; angles in degrees."""
    unit = found.estimates[name].unit
    if unit == "rad" or unit.startswith("rad/"):
        return found.text(name, 180.0 / np.pi, "deg" + unit[3:])
    return found.text(name)


def percent(found: FittedEffect, name: str) -> str:
    """A fraction as "12 +- 1 %"."""
    return found.text(name, 100.0, "%")


def capital(text: str) -> str:
    """Text as the beginning of a sentence."""
    return text[:1].upper() + text[1:]


def subject(found: FittedEffect) -> str:
    """Description of a form as the subject of a sentence: an insertion that begins with a comma ends with one."""
    about = found.variant.about
    return about + "," * ("," in about)
