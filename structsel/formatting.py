"""Numbers, estimates, units and lists as tables and sentences show them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from structsel.nomenclature import UNKNOWN, unit_of

UNDEFINED = "-"
"""What stands in place of a number that is not known."""


def format_number(value: float | None, digits: int = 4) -> str:
    """Return a number with significant digits, without exponents from 0.0001 to 100000.

    >>> format_number(110.0, 2), format_number(0.012345, 2), format_number(3.2e-6, 2), format_number(None)
    ('110', '0.012', '3.2e-6', '-')
    """
    if value is None or not math.isfinite(value):
        return UNDEFINED
    if abs(value) >= 1e5 or (value != 0 and abs(value) < 1e-4):
        return f"{value:.{max(digits - 2, 1)}e}".replace("e-0", "e-").replace("e+0", "e")
    return f"{value:.{digits}g}" if abs(value) < 10**digits else f"{value:.0f}"


def format_decimals(value: float | None, decimals: int = 4) -> str:
    """Return a number with a fixed number of decimals."""
    return UNDEFINED if value is None or not math.isfinite(value) else f"{value:.{decimals}f}"


def format_percent(fraction: float | None, decimals: int = 0) -> str:
    """Return a fraction in percent."""
    if fraction is None or not math.isfinite(fraction):
        return UNDEFINED
    return f"{100.0 * fraction:.{decimals}f} %"


def format_explained(r2: float) -> str:
    """Return R2 as the percentage of the variance that is explained; never rounded up to 100 %."""
    percent = 100.0 * r2
    return f"{percent:.1f} %" if percent < 99.95 else f"{math.floor(100.0 * percent) / 100.0:.2f} %"


def format_probability(probability: float) -> str:
    """Return a probability in percent, with "< 1 %" and "> 99 %" at the ends."""
    if probability > 0.99:
        return "> 99 %"
    return "< 1 %" if probability < 0.01 else format_percent(probability)


def display_unit(unit: str) -> tuple[float, str]:
    """Return the factor to the unit that is displayed, and its name: degrees, percent, nothing for a pure number."""
    if unit == "rad" or unit.startswith(("rad/", "rad ")):
        return 180.0 / math.pi, "deg" + unit[3:]
    if unit == "relative":
        return 100.0, "%"
    return 1.0, "" if unit in ("-", UNKNOWN) else unit


def format_in_unit(value: float, unit: str, digits: int = 3) -> str:
    """Return a number with its displayed unit, angles in degrees."""
    factor, name = display_unit(unit)
    return f"{format_number(factor * value, digits)} {name}".strip()


def format_estimate(value: float, std: float, unit: str = "", sign: str = "+-") -> str:
    """Return an estimate and its standard deviation, rounded to what the deviation leaves certain; angles in degrees.

    >>> format_estimate(0.67643, 0.0142), format_estimate(0.1, 0.002, "rad")
    ('0.676 +- 0.014', '5.73 +- 0.11 deg')
    """
    factor, name = display_unit(unit)
    value, std = factor * value, factor * std
    shown = f" {name}" if name else ""
    if not (math.isfinite(std) and std > 0.0):
        return f"{value:.3g}{shown}"
    if not 1e-3 <= max(abs(value), std) < 1e5:
        return f"{value:.3g} {sign} {std:.1g}{shown}"
    # One digit of what is uncertain; two where the first is a 1.
    digits = max(-math.floor(math.log10(std)) + (f"{std:e}"[0] == "1"), 0)
    return f"{value:.{digits}f} {sign} {std:.{digits}f}{shown}"


def format_range(channel: str, limits: Sequence[float]) -> str:
    """Return the range of a channel, ``alpha 11.5 to 20.1 deg``; an infinite limit is open."""
    factor, unit = display_unit(unit_of(channel))
    low, high = (factor * x for x in limits)
    shown = f" {unit}" if unit else ""
    if not math.isfinite(low):
        return f"{channel} below {high:.3g}{shown}"
    return f"{channel} {low:.3g} to {high:.3g}{shown}" if math.isfinite(high) else f"{channel} above {low:.3g}{shown}"


def join_names(names: Iterable[Any], most: int | None = 6, last: str = "and") -> str:
    """Return names as a sentence lists them: "a, b and c"; beyond `most`, the first ones "and 4 more"."""
    texts = [str(name) for name in names]
    if most is not None and len(texts) > most:
        return f"{', '.join(texts[: most - 1])} and {len(texts) - most + 1} more"
    *head, tail = texts or [""]
    return f"{', '.join(head)} {last} {tail}" if head else tail


def count_of(count: int, noun: str) -> str:
    """Return a number of things, "1 recording" or "3 recordings"."""
    return f"{count} {noun}{'s' * (count != 1)}"


def finite_or_none(content: Any) -> Any:
    """Return nested lists and dicts with None for what is not a finite number, as JSON needs it."""
    if isinstance(content, dict):
        return {key: finite_or_none(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [finite_or_none(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content
