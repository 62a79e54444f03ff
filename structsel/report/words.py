"""Numbers and lists as sentences and tables have them."""

from __future__ import annotations

import math
from collections.abc import Iterable

from structsel.diagnosis.story import displayed, estimate_text
from structsel.effects.base import Estimate


def figure(value: float | None, digits: int = 4) -> str:
    """Return a number in few digits; a dash for one that is not known."""
    if value is None or not math.isfinite(value):
        return "-"
    if abs(value) >= 1e5 or (value != 0 and abs(value) < 1e-4):
        return f"{value:.{max(digits - 2, 1)}e}".replace("e-0", "e-").replace("e+0", "e")
    return f"{value:.{digits}g}" if abs(value) < 10**digits else f"{value:.0f}"


def fixed(value: float, digits: int = 4) -> str:
    """Return a ratio with so many decimals; a dash for one that is not known."""
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


def three_digits(value: float) -> str:
    """Return a ratio with three decimals; a dash for one that is not known."""
    return fixed(value, 3)


def percent(share: float) -> str:
    """Return a share in whole percent; a dash for one that is not known."""
    return f"{100.0 * share:.0f} %" if math.isfinite(share) else "-"


def explained(r2: float) -> str:
    """Return R2 as the share of the variance that is explained."""
    share = 100.0 * r2
    return f"{share:.1f} %" if share < 99.95 else f"{math.floor(1000.0 * share) / 1000.0:.2f} %"


def sized(value: float, std: float, unit: str) -> str:
    """Return an estimate as people read it: digits as it is known to, angles in degrees."""
    return estimate_text(Estimate(value, std, unit), "±")


def in_unit(value: float, unit: str, digits: int = 3) -> str:
    """Return a number as people read it, angles in degrees."""
    factor, shown = displayed(unit)
    return f"{figure(factor * value, digits)} {shown}".strip()


def listed(words: Iterable[str], most: int = 6) -> str:
    """Return names as a sentence has them; the first few of many."""
    names = list(words)
    if len(names) > most:
        return f"{', '.join(names[: most - 1])} and {len(names) - most + 1} more"
    *head, tail = names or [""]
    return f"{', '.join(head)} and {tail}" if head else tail


def counted(count: int, what: str) -> str:
    """Return a number of things, with the plural it asks for."""
    return f"{count} {what}{'s' * (count != 1)}"
