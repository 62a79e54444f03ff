"""Units as files write them, converted to SI and radians by pint.

An angle counts as a dimension of its own here, so a deflection in percent or a throttle in
degrees is refused although pint calls both dimensionless.
"""

from __future__ import annotations

import re
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pint

_DIMENSIONLESS = {"", "-", "--", "1", "none", "n/d", "nd"}
_NAMED = {"kg/m/s^2": "Pa", "kg*m/s^2": "N", "kg*m^2/s^2": "N*m", "kg*m^2/s^3": "W", "kg*m^2/A/s^3": "V"}
_AVIATION = {
    "NM": "nautical_mile", "nm": "nautical_mile", "nmi": "nautical_mile", "NMI": "nautical_mile",
    "kt": "knot", "KT": "knot", "kts": "knot", "KTS": "knot", "ktas": "knot", "KTAS": "knot",
    "mil": "milliradian", "mils": "milliradian", "mb": "millibar",
}  # fmt: skip
"""Names that mean something else to pint (NM a nanometre, mb a millibarn) or nothing; a mil is that of a head-up
display, 1/1000 rad."""
_FACTORS = {
    ("deg", "rad"): np.pi / 180.0, ("deg/s", "rad/s"): np.pi / 180.0, ("kt", "m/s"): 1852.0 / 3600.0,
    ("ft/s", "m/s"): 0.3048, ("km/h", "m/s"): 1.0 / 3.6, ("g", "m/s^2"): 9.80665, ("ft", "m"): 0.3048,
    ("ms", "s"): 1e-3, ("us", "s"): 1e-6, ("min", "s"): 60.0,
}  # fmt: skip
"""Factors of units that a check tries on recordings that state none: pint takes half a second to load."""
_WORD = re.compile(r"[A-Za-z]+")
_BARE_POWER = re.compile(r"(?<=[A-Za-z])(-?\d)")


@cache
def _registry() -> pint.UnitRegistry:
    import pint

    registry: pint.UnitRegistry = pint.UnitRegistry(on_redefinition="raise")
    registry.define("pound_force_per_square_foot = force_pound / foot ** 2 = psf")
    return registry


@cache
def _parse(text: str, mass: bool = False) -> Any:
    """Pint unit of a text, or None. ``g`` is the acceleration unless a mass is wanted."""
    cleaned = text.strip()
    registry = _registry()
    if cleaned.lower() in _DIMENSIONLESS:
        return registry.dimensionless
    if cleaned in ("g", "G") and not mass:
        return registry.standard_gravity
    cleaned = _WORD.sub(lambda found: _AVIATION.get(found.group(), found.group()), cleaned).replace("Nm", "N*m")
    for attempt in (cleaned, _BARE_POWER.sub(r"^\1", cleaned), cleaned.lower()):
        try:
            return registry.parse_units(attempt)
        except Exception:  # pint raises a dozen kinds, some from the tokenizer it uses
            continue
    return None


def _base(unit: Any) -> Any:
    return _registry().get_base_units(unit)[1]


def is_unit(text: str) -> bool:
    """Whether a text can be read as a unit."""
    return _parse(text) is not None


def is_convertible(unit: str, target: str) -> bool:
    """Whether `unit` measures the same thing as `target`, angles being a thing of their own."""
    source, goal = _parse(unit, mass=target == "kg"), _parse(target)
    if source is None or goal is None:
        return False
    if _base(source) == _base(goal):
        return True
    # Rates and accelerations are often written 1/s and 1/s^2, and angles "-": the radian goes unsaid.
    # Hz and percent say something else.
    unsaid = {name for name, _ in source._units.items()} <= {"second"}
    return bool(unsaid and target != "rpm" and _base(source * _registry().radian) == _base(goal))


def convert(values: np.ndarray, unit: str, target: str) -> np.ndarray:
    """Values in `unit` as values in `target`.

    Parameters
    ----------
    values : (n,) array [unit]
    unit, target : str
        For which `is_convertible` holds.

    Returns
    -------
    (n,) array [target]
    """
    if (factor := _FACTORS.get((unit, target))) is not None:
        return factor * np.asarray(values, dtype=np.float64)
    source, goal = _parse(unit, mass=target == "kg"), _parse(target)
    registry = _registry()
    if _base(source) != _base(goal):
        source = source * registry.radian
    if source == goal:
        return np.array(values, dtype=np.float64)
    return np.asarray(registry.Quantity(values, source).to(goal).magnitude, dtype=np.float64)


def si_unit(unit: str) -> str:
    """SI and radian unit that measures the same thing as `unit`, as text: "deg/s" gives "rad/s"."""
    base = _base(_parse(unit))
    text = f"{base:~C}".replace("**", "^")
    return _NAMED.get(text, text) or "-"
