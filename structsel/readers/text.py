"""Text files: any separator, with or without a header, units in the header or in a line below it."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import re
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import islice
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, cast

import numpy as np

from structsel.errors import DataError, MapError
from structsel.nomenclature import is_known
from structsel.readers.channel_map import FileOptions
from structsel.readers.compressed import BoundedGzip
from structsel.readers.table import FileTable, as_float, channels_at_cg, require_schema, split_header
from structsel.readers.time_stamps import is_time_stamp, seconds_of
from structsel.readers.units import is_unit

if TYPE_CHECKING:
    import pandas as pd

PROVENANCE = "# provenance: "
"""Begins a line above the table in which `write_recording` stores one note of the provenance, as a JSON string."""
AT_CG = "# at_cg: "
"""Begins the line in which `write_recording` lists, as JSON, the channels that are at the centre of gravity."""
_HEAD_LINES = 200
_MAX_COLUMNS = 200_000  # read in 0.23 ms each with 50 rows: 23 s and 0.4 GiB for 100,000 (2026-11-24, one core)
_SEPARATORS = {"tab": "\t", "\\t": "\t", "whitespace": r"\s+", " ": r"\s+", "space": r"\s+", "comma": ","}
_MISSING = {"", "nan", "na", "n/a", "null", "none", "inf", "-inf", "+inf", "true", "false"}
_DECIMAL_COMMA = re.compile(r"^[+-]?\d+,\d+(?:[eE][+-]?\d+)?$")


@cache
def _exact_floats() -> Any:
    """Option of pandas before 3.1 that reads numbers to the last bit; later versions do so without."""
    import pandas as pd

    old = tuple(int(part) for part in pd.__version__.split(".")[:2]) < (3, 1)
    return {"float_precision": "round_trip"} if old else {}


def read_text(path: Path, options: FileOptions) -> FileTable:
    """Table of a text file.

    Separator, header and units are detected; ``[file]`` may state ``separator``,
    ``decimal`` and ``skip_rows``.

    Raises
    ------
    DataError
        When the file holds no samples, or its lines do not have the same number of fields.
    """
    import pandas as pd

    encoding, own, lines = _head(path, options.skip_rows)
    (provenance, at_cg), skipped = _own_notes(path, own), options.skip_rows + len(own)
    body = [line for line in lines if line.strip()]
    if not body:
        raise DataError(f"'{path}' is empty" + (" after skip_rows." if options.skip_rows else "."))
    separator, width = _layout(body, options)
    decimal = options.decimal or _decimal(body, separator)
    names_first = 1 if own else 0  # `write_recording` puts names above the samples, and a name may be a number
    start = next(
        (i for i, line in enumerate(lines) if i >= names_first and width and _is_data(_fields(line, separator), width)),
        None,
    )
    if start is None:
        raise DataError(
            f"'{path}' has no samples: none of its first {len(lines)} lines has numbers.\n"
            "Check that it is the right file; [file] separator and skip_rows state how to read it."
        )
    if width > _MAX_COLUMNS:
        raise DataError(f"'{path}' has {width} columns; at most {_MAX_COLUMNS} are read. Is the separator right?")
    names, units, named, notes = _header(lines[:start], separator, width)
    try:
        with _bytes(path) as stream:
            frame = pd.read_csv(
                stream,
                sep=separator,
                header=None,
                names=list(range(width)),
                index_col=False,
                skiprows=skipped + start,
                decimal=decimal,
                encoding=encoding,
                skipinitialspace=True,
                low_memory=False,
                **_exact_floats(),
            )
    except (pd.errors.ParserError, UnicodeDecodeError, ValueError, OSError, EOFError, zlib.error) as error:
        reason = str(error).removeprefix("Error tokenizing data. C error: ").strip()
        raise DataError(
            f"'{path}' cannot be read as text in {width} columns: {reason}.\n"
            "Correct the line, or state [file] separator and skip_rows in a channel map."
        ) from error
    table = _table(path, frame, names, units, named, skipped + start + 1, notes)
    return replace(table, provenance=provenance, at_cg=at_cg)


def _bytes(path: Path) -> IO[bytes]:
    return cast(IO[bytes], BoundedGzip(path)) if path.suffix == ".gz" else path.open("rb")


def _head(path: Path, skip: int) -> tuple[str, list[str], list[str]]:
    """Encoding, the lines `write_recording` put above the table (none in other files), and the next ones."""
    for encoding in ("utf-8-sig", "latin-1"):
        try:
            with _bytes(path) as content, io.TextIOWrapper(content, encoding) as stream:
                own, lines = _parted(line.rstrip("\r\n") for line in islice(stream, skip, None))
        except UnicodeDecodeError:
            continue
        except (OSError, EOFError, zlib.error) as error:
            raise DataError(f"'{path}' cannot be read: {getattr(error, 'strerror', None) or error}.") from error
        if any("\0" in line for line in lines):
            raise DataError(f"'{path}' is not text: it holds zero bytes. Is the suffix right?")
        return encoding, own, lines
    raise DataError(f"'{path}' is not text that can be decoded.")


def _parted(rows: Iterator[str]) -> tuple[list[str], list[str]]:
    own: list[str] = []
    for line in rows:
        if not line.startswith("# structsel." if not own else "#"):
            return own, [line, *islice(rows, _HEAD_LINES - 1)]
        own.append(line)
    return own, []


def _own_notes(path: Path, own: list[str]) -> tuple[tuple[str, ...], frozenset[str]]:
    """Provenance, and channels at the centre of gravity, of a file that `write_recording` wrote."""
    if not own:
        return (), frozenset()
    require_schema(str(path), own[0].removeprefix("# "))
    notes = []
    at_cg = None
    for line in own[1:]:
        try:
            if line.startswith(PROVENANCE):
                notes.append(str(json.loads(line.removeprefix(PROVENANCE))))
            elif line.startswith(AT_CG):
                at_cg = frozenset(map(str, json.loads(line.removeprefix(AT_CG))))
        except (ValueError, TypeError, RecursionError) as error:
            raise DataError(
                f"'{path}': a line above the table cannot be read: {line!r}.\nIt should hold one note in double "
                "quotes. Correct it, or write the file again; without it the provenance of the recording is lost."
            ) from error
    return tuple(notes), channels_at_cg(notes) if at_cg is None else at_cg


def _fields(line: str, separator: str) -> list[str]:
    if separator == r"\s+":
        return line.split()
    if '"' in line:  # a name may hold the separator
        with contextlib.suppress(csv.Error):
            return [field.strip() for field in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]
    return [field.strip().strip('"') for field in line.split(separator)]


def _layout(lines: list[str], options: FileOptions) -> tuple[str, int]:
    """Separator and number of columns: those by which most lines are rows of numbers.

    First lines of nothing but numbers count, then, for files that hold text columns, lines of
    mostly numbers. A width of 0 says that there are none.
    """
    candidates = ["\t", ";", ",", "|", r"\s+"]
    if options.separator is not None:
        candidates = [_SEPARATORS.get(options.separator, options.separator)]
        if len(candidates[0]) != 1 and candidates[0] != r"\s+":
            raise MapError(f"[file] separator = {options.separator!r}: one character, 'tab' or 'whitespace' is wanted.")
    for fraction in (1.0, 0.5):
        best = (0, "", 0)
        for separator in candidates:
            rows = [_fields(line, separator) for line in lines]
            widths = Counter(len(row) for row in rows if _is_data(row, len(row), fraction))
            for width, count in widths.items():
                # One column is what remains when nothing separates.
                score = count if width > 1 else min(count, 1)
                if score > best[0]:
                    best = (score, separator, width)
        if best[0]:
            return best[1], best[2]
    return candidates[0], 0


def _decimal(lines: list[str], separator: str) -> str:
    if separator == ",":
        return "."
    cells = [cell for line in lines[-20:] for cell in _fields(line, separator)]
    commas = sum(bool(_DECIMAL_COMMA.match(cell)) for cell in cells)
    return "," if commas > sum("." in cell for cell in cells) else "."


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return bool(_DECIMAL_COMMA.match(cell)) or is_time_stamp(cell)
    return True


def _is_data(cells: list[str], width: int, fraction: float = 0.5) -> bool:
    """Whether a line has `width` cells, and at least a `fraction` of those that are not missing are numbers."""
    if len(cells) != width:
        return False
    given = [cell for cell in cells if cell.lower() not in _MISSING]
    numbers = sum(map(_is_number, given))
    return numbers > 0 and numbers >= fraction * len(given)


def _header(lines: list[str], separator: str, width: int) -> tuple[list[str], dict[str, str], bool, tuple[str, ...]]:
    """Column names and units from the lines above the first sample."""
    rows = []
    for line in lines:
        cells = _fields(line.strip().lstrip("#%!").strip(), separator)
        if separator == r"\s+":  # "alpha [deg]" was taken apart
            joined: list[str] = []
            for cell in cells:
                if joined and cell[:1] in "[(" and cell[-1:] in "])":
                    joined[-1] += f" {cell}"
                else:
                    joined.append(cell)
            cells = joined if len(joined) == width else cells
        if len(cells) == width and any(cells):
            rows.append(cells)
    if not rows:
        return [str(j + 1) for j in range(width)], {}, False, ()
    below = [cell.strip("[]()") for cell in rows[-1]]
    # "t" and "V" are units too (tonne, volt), but a line of channels only is a line of names.
    has_units = len(rows) > 1 and all(map(is_unit, below)) and not all(map(is_known, below))
    names, notes, taken = [], [], set()
    for j, cell in enumerate(rows[-2] if has_units else rows[-1]):
        name = cell or f"column {j + 1}"
        if name in taken:
            name = f"{name} (column {j + 1})"
            notes.append(f"column {j + 1} repeats the header '{cell}' and is called '{name}'")
        names.append(name)
        taken.add(name)
    units = {name: unit for name in names if (unit := split_header(name)[1]) is not None}
    if has_units:
        units.update({name: unit for name, unit in zip(names, below) if unit})
    return names, units, True, tuple(notes)


def _table(
    path: Path,
    frame: pd.DataFrame,
    names: list[str],
    units: dict[str, str],
    named: bool,
    first_row: int,
    notes: tuple[str, ...],
) -> FileTable:
    import pandas as pd

    columns: dict[str, np.ndarray] = {}
    unusable: dict[str, str] = {}
    times: dict[str, str] = {}
    # One array for all columns of numbers: a series for each would take most of the time if columns are many.
    numeric = np.array([dtype.kind in "biuf" for dtype in frame.dtypes])
    matrix = frame.loc[:, numeric].to_numpy(dtype=np.float64)
    place = np.cumsum(numeric) - 1
    for j, name in enumerate(names):
        if numeric[j]:
            values = matrix[:, place[j]]
            if name in ("", f"column {j + 1}") and np.isnan(values).all():
                unusable[name] = "empty"
            else:
                columns[name] = as_float(values)
        else:
            series = frame[j]
            numbers = pd.to_numeric(series, errors="coerce")
            wrong = np.flatnonzero(numbers.isna().to_numpy() & series.notna().to_numpy())
            if wrong.size == 0:
                columns[name] = as_float(numbers.to_numpy())
            elif (found := seconds_of(series)) is not None:
                columns[name], times[name] = found
            else:
                cell = str(series.iloc[int(wrong[0])])
                if numbers.notna().any():
                    unusable[name] = f"sample {wrong[0]} (line {first_row + wrong[0]}) reads {cell!r}"
                else:
                    unusable[name] = f"text, such as {cell!r}"
    return FileTable(
        str(path),
        columns,
        units=units | dict.fromkeys(times, "s"),
        numbers={j + 1: name for j, name in enumerate(names)},
        named=named,
        first_row=first_row,
        unusable=unusable,
        notes=(*notes, *(f"column '{name}': {how}" for name, how in times.items())),
    )
