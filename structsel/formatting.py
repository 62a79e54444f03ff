"""Numbers, estimates, units and lists as text, the same in tables, sentences, reports and figures."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Iterable, Sequence
from typing import Any

from structsel.nomenclature import UNKNOWN, unit_of

UNDEFINED = "-"
"""Text of a number that is not known."""


def format_number(value: float | None, digits: int = 4, *, signed: bool = False) -> str:
    """Return a number with significant digits, without exponents from 0.0001 to 100000; `signed` writes a plus.

    >>> format_number(110.0, 2), format_number(99.7, 2), format_number(0.012345, 2), format_number(3.2e-6, 2)
    ('110', '100', '0.012', '3.2e-6')
    >>> format_number(110.0, 2, signed=True), format_number(None)
    ('+110', '-')
    """
    if value is None or not math.isfinite(value):
        return UNDEFINED
    sign = "+" if signed else ""
    if abs(value) >= 1e5 or (value != 0 and abs(value) < 1e-4):
        return _shorten_exponent(f"{value:{sign}.{max(digits - 2, 1)}e}")
    text = f"{value:{sign}z.{digits}g}"
    # Rounding may carry into one more digit than are kept: 99.7 is 1e+02 in two digits.
    return f"{value:{sign}.0f}" if abs(value) >= 10**digits or "e" in text else text


def _shorten_exponent(text: str) -> str:
    """Write 3.2e-6 for 3.2e-06."""
    return text.replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")


def format_decimals(value: float | None, decimals: int = 4) -> str:
    """Return a number with a fixed number of decimals."""
    return UNDEFINED if value is None or not math.isfinite(value) else f"{value:z.{decimals}f}"


def format_percent(fraction: float | None) -> str:
    """Return a fraction in percent."""
    if fraction is None or not math.isfinite(fraction):
        return UNDEFINED
    return f"{100.0 * fraction:z.0f} %"


def format_explained(r2: float) -> str:
    """Return R2 as the percentage of the variance that is explained; never rounded up to 100 %."""
    percent = 100.0 * r2
    return f"{percent:.1f} %" if percent < 99.95 else f"{math.floor(100.0 * percent) / 100.0:.2f} %"


def format_probability(probability: float) -> str:
    """Return a probability in percent, with "< 1 %" and "> 99 %" at the ends."""
    if probability > 0.99:
        return "> 99 %"
    return "< 1 %" if probability < 0.01 else format_percent(probability)


def format_probabilities(probabilities: Sequence[float]) -> tuple[list[str], str]:
    """Return probabilities of exclusive causes in percent, and that of all others, as whole numbers that add up to 100.

    Each is rounded for itself; the rest takes what rounding leaves. A rest below 0.5 % is empty.

    >>> format_probabilities([0.524, 0.414]), format_probabilities([0.996, 0.001])
    ((['52 %', '41 %'], '7 %'), (['> 99 %', '< 1 %'], ''))
    """
    rest = 1.0 - sum(probabilities)
    whole = 100 - sum(round(100.0 * p) for p in probabilities)
    remaining = "< 1 %" if whole < 1 else f"{whole} %"
    return [format_probability(p) for p in probabilities], remaining if rest >= 0.005 else ""


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
    """Return an estimate and its standard deviation, rounded to the first uncertain digit; angles in degrees.

    >>> format_estimate(0.67643, 0.0142), format_estimate(0.1, 0.002, "rad"), format_estimate(-5.4e-5, 4.1e-4, "V")
    ('0.676 +- 0.014', '5.73 +- 0.11 deg', '-0.0001 +- 0.0004 V')
    """
    factor, name = display_unit(unit)
    value, std = factor * value, factor * std
    shown = f" {name}" if name else ""
    if not (math.isfinite(std) and std > 0.0):
        return f"{format_number(value, 3)}{shown}"
    if not 1e-4 <= max(abs(value), std) < 1e5:
        return f"{_shorten_exponent(f'{value:.3g} {sign} {std:.1g}')}{shown}"
    # One uncertain digit; two where the first is a 1.
    digits = max(-math.floor(math.log10(std)) + (f"{std:e}"[0] == "1"), 0)
    return f"{value:z.{digits}f} {sign} {std:.{digits}f}{shown}"


def format_range(channel: str, limits: Sequence[float]) -> str:
    """Return the range of a channel, ``alpha 11.5 to 20.1 deg``; an infinite limit is open."""
    factor, unit = display_unit(unit_of(channel))
    low, high = (factor * x for x in limits)
    shown = f" {unit}" if unit else ""
    if not math.isfinite(low):
        return f"{channel} below {format_number(high, 3)}{shown}"
    if not math.isfinite(high):
        return f"{channel} above {format_number(low, 3)}{shown}"
    return f"{channel} {format_number(low, 3)} to {format_number(high, 3)}{shown}"


def join_names(names: Iterable[Any], maximum: int | None = 6, last: str = "and") -> str:
    """Return names as a list in a sentence, "a, b and c"; of more than `maximum` the first ones, "and 4 more"."""
    texts = [str(name) for name in names]
    if maximum is not None and len(texts) > maximum:
        return f"{', '.join(texts[: maximum - 1])} and {len(texts) - maximum + 1} more"
    *head, tail = texts or [""]
    return f"{', '.join(head)} {last} {tail}" if head else tail


def as_sentence(text: str) -> str:
    """Return text with a capital at its beginning and a full stop at its end; nothing for nothing.

    >>> as_sentence("steps of this control alone"), as_sentence("Is it rigid?"), as_sentence("")
    ('Steps of this control alone.', 'Is it rigid?', '')
    """
    return f"{text[:1].upper()}{text[1:]}" + ("." if text and text[-1] not in ".?!" else "")


def count_of(count: int, noun: str) -> str:
    """Return a number of things, "1 recording" or "3 recordings"."""
    return f"{count} {noun}{'s' * (count != 1)}"


def printable(text: str) -> str:
    r"""Return text for a terminal: control and format characters, such as escape codes, are shown as ``\x1b``.

    Line breaks and tabs are kept.

    >>> printable("m01\x1b[31m")
    'm01\\x1b[31m'
    """
    if text.isprintable():
        return text
    return "".join(c.encode("unicode_escape").decode() if _is_control(c) else c for c in text)


def _is_control(character: str) -> bool:
    return character not in "\n\t" and unicodedata.category(character) in ("Cc", "Cf", "Cs")


def csv_text(text: str) -> str:
    """Return text for a cell of a CSV file: a spreadsheet must not take it for a formula.

    An apostrophe precedes text that begins with ``=``, ``+``, ``-``, ``@``, a tab or a line break and is no number.

    >>> csv_text("=cmd()"), csv_text("Cm:alpha"), csv_text("-1.5")
    ("'=cmd()", 'Cm:alpha', '-1.5')
    """
    if not text.startswith(("=", "+", "-", "@", "\t", "\r", "\n")):
        return text
    try:
        float(text)
    except ValueError:
        return f"'{text}"
    return text


def finite_or_none(content: Any) -> Any:
    """Return nested lists and dicts with None in place of numbers that are not finite, as JSON needs it."""
    if isinstance(content, dict):
        return {key: finite_or_none(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [finite_or_none(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content
