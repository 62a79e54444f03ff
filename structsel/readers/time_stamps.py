"""Time stamps as text: ISO 8601 dates with times, and times of day, in seconds."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

_DATE = re.compile(r"\d{4}-?\d{2}-?\d{2}[T ]\d{2}:?\d{2}(?::?\d{2}(?:[.,]\d+)?)?(?:Z|[+-]\d{2}(?::?\d{2})?)?")
_TIME_OF_DAY = re.compile(r"\d{1,2}:[0-5]\d:[0-5]\d(?:[.,]\d+)?")
_DAY = 86400.0  # s


def is_time_stamp(text: str) -> bool:
    """Whether a cell is a date with a time, or a time of day with seconds."""
    return bool(_DATE.fullmatch(text) or _TIME_OF_DAY.fullmatch(text))


def seconds_of(cells: pd.Series) -> tuple[np.ndarray, str] | None:
    """Time stamps in seconds, and how they were converted; None if a cell is no time stamp.

    Dates become seconds since the first one. Times of day become seconds since midnight of the first day: a time that
    is more than half a day before the one above it is of the next day.

    Parameters
    ----------
    cells : (n,) Series of text
        A missing cell becomes NaN.
    """
    import pandas as pd

    given = cells.notna().to_numpy()
    text = cells[given].astype(str).str.strip()
    if not len(text):
        return None
    seconds = np.full(len(cells), np.nan)
    if all(map(_DATE.fullmatch, text)):
        dates = pd.to_datetime(text.str.replace(",", "."), format="ISO8601", utc=True, errors="coerce")
        if dates.isna().any():
            return None
        first = dates.iloc[0]
        seconds[given] = ((dates - first) / pd.Timedelta(seconds=1)).to_numpy()
        return seconds, f"dates in seconds since {first.isoformat()}"
    if all(map(_TIME_OF_DAY.fullmatch, text)):
        parts = text.str.replace(",", ".").str.split(":", expand=True).astype(float).to_numpy()
        times = parts @ np.array([3600.0, 60.0, 1.0])
        days = np.concatenate(([0.0], np.cumsum(np.diff(times) < -0.5 * _DAY)))
        seconds[given] = times + _DAY * days
        return seconds, "times of day in seconds since midnight"
    return None
