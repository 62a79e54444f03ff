"""Result of a reader: the columns of one file, unchanged."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from structsel.errors import DataError, MapError
from structsel.nomenclature import find_channel, is_known, suggest
from structsel.readers.channel_map import ChannelMap
from structsel.readers.units import is_convertible, is_unit

_WITH_UNIT = re.compile(r"^\s*(?P<name>.*?\S)\s*(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>[^()]*)\))\s*$")

_SHOWN = 40  # characters of a wrong unit that a note repeats

UNIT_SUFFIXES = {
    "deg": "deg", "rad": "rad", "deg_s": "deg/s", "dps": "deg/s", "degps": "deg/s", "rad_s": "rad/s", "radps": "rad/s",
    "deg_s2": "deg/s^2", "rad_s2": "rad/s^2", "m": "m", "ft": "ft", "km": "km", "m_s": "m/s", "mps": "m/s",
    "ft_s": "ft/s", "fps": "ft/s", "kt": "kt", "kts": "kt", "kn": "kt", "knots": "kt", "kmh": "km/h", "kph": "km/h",
    "mph": "mph", "fpm": "ft/min", "m_s2": "m/s^2", "mps2": "m/s^2", "ft_s2": "ft/s^2", "fps2": "ft/s^2", "g": "g",
    "s": "s", "sec": "s", "ms": "ms", "us": "us", "Pa": "Pa", "hPa": "hPa", "kPa": "kPa", "mbar": "mbar", "psf": "psf",
    "psi": "psi", "K": "K", "degC": "degC", "degF": "degF", "kg": "kg", "lb": "lb", "lbs": "lb", "slug": "slug",
    "slugs": "slug", "N": "N", "kN": "kN", "lbf": "lbf", "rpm": "rpm", "pct": "%", "percent": "%", "kg_m3": "kg/m^3",
}  # fmt: skip
"""Units as suffixes of a name, ``alpha_deg``; a list, because most suffixes are not units."""


def split_header(text: str) -> tuple[str, str | None]:
    """Name and unit of a header such as ``"alpha [deg]"``, ``"V (kt)"`` or ``"alpha_deg"``.

    Text in brackets is a unit if it can be read as one. A suffix after an underscore is a unit if the name before it is
    a channel of the nomenclature that is measured in such a unit (``h_agl`` and ``alpha_left`` are names). Otherwise
    the complete text is the name and the unit is None.
    """
    match = _WITH_UNIT.match(text)
    if match:
        unit = match["square"] if match["square"] is not None else match["round"]
        if not unit.strip().isdigit() and is_unit(unit):  # "acc[1]" is an index
            return match["name"].strip(), unit.strip()
    complete = text.strip()
    at = complete.find("_")
    while at > 0 and not is_known(complete):
        name, suffix = complete[:at], UNIT_SUFFIXES.get(complete[at + 1 :])
        if suffix is not None and is_known(name) and is_convertible(suffix, find_channel(name).unit):
            return name, suffix
        at = complete.find("_", at + 1)
    return complete, None


SCHEMA = "structsel.recording/1"
"""Schema of the CSV and Parquet files of `write_recording`, which have the provenance of the recording."""


def require_schema(path: str, schema: str) -> None:
    """Refuse a recording of another schema.

    Raises
    ------
    DataError
        When it is not `SCHEMA`.
    """
    if schema == SCHEMA:
        return
    known, _, ours = SCHEMA.partition("/")
    kind, _, number = schema.partition("/")
    if kind == known and number.isdecimal() and (len(number) > len(ours) or number > ours):
        raise DataError(
            f"'{path}' was written by a newer structsel, as {schema}; this one reads {SCHEMA}.\n"
            "Update structsel, or write the file again with this one."
        )
    raise DataError(f"'{path}' has the schema {schema!r}; the only such files read are {SCHEMA}.\nWrite it again.")


MOVED_TO_CG = "carried to the centre of gravity: "
"""Begins the provenance note that names the channels moved to the centre of gravity."""


def channels_at_cg(provenance: Iterable[str]) -> frozenset[str]:
    """Channels at the centre of gravity by the provenance of a file of structsel 0.1.0, which has no list of them."""
    lists = (note.removeprefix(MOVED_TO_CG).split(";")[0] for note in provenance if note.startswith(MOVED_TO_CG))
    return frozenset(name.strip() for listed in lists for name in listed.split(","))


@dataclass(frozen=True)
class FileTable:
    """Columns of one file before any name, unit or sign is given to them.

    Attributes
    ----------
    path : str
        The file, for messages.
    columns : mapping of str to array
        Columns of numbers or truth values in the file's order and type, each (n,); lengths may differ where the
        format lets them.
    units : dict of str to str
        Units the file itself states.
    numbers : dict of int to str
        Column name of each 1-based number; empty where the format has no order.
    named : bool
        False for a file without a header, whose columns are called "1", "2", ...
    first_row : int
        Line of the file that holds the first sample, 1-based; 0 where lines mean nothing.
    unusable : dict of str to str
        Columns that hold no numbers, and why.
    notes : tuple of str
        Changes and omissions in reading.
    provenance : tuple of str
        Provenance that the file states; see `require_schema`.
    at_cg : frozenset of str
        Channels that the file states to be at the centre of gravity already.
    clocks : mapping of str to str
        Name of the time column of each column, in a log with several sample rates; empty if there is one time column.
    standard_map : ChannelMap or None
        How columns become channels in a format whose names mean the same in every file; used where no map is given.
    assumptions : mapping of str to str
        Assumptions about channels of `standard_map`.
    faults : tuple of str
        Faults of the file, which can be read nevertheless.
    """

    path: str
    columns: Mapping[str, np.ndarray]
    units: dict[str, str] = field(default_factory=dict)
    numbers: dict[int, str] = field(default_factory=dict)
    named: bool = True
    first_row: int = 0
    unusable: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    provenance: tuple[str, ...] = ()
    at_cg: frozenset[str] = frozenset()
    clocks: Mapping[str, str] = field(default_factory=dict)
    standard_map: ChannelMap | None = None
    assumptions: Mapping[str, str] = field(default_factory=dict)
    faults: tuple[str, ...] = ()

    def describe(self) -> str:
        """Columns of the file for messages: their names, or their number."""
        if not self.named:
            return f"columns 1 to {len(self.columns)}"
        names = list(self.columns)
        return ", ".join(names[:40]) + (f", ... ({len(names)} in all)" if len(names) > 40 else "")

    def resolve(self, wanted: str | int, channel: str) -> str:
        """Column a map means by a name or a 1-based number.

        Raises
        ------
        MapError
            When the file has no such column, or the column holds no numbers.
        """
        if isinstance(wanted, int):
            if wanted in self.numbers:
                return self._usable(self.numbers[wanted], channel)
            if not self.numbers:
                raise MapError(
                    f"the map gives channel '{channel}' column {wanted} of '{self.path}', but its columns "
                    f"have no order.\nIt has: {self.describe()}.\nName the column instead of numbering it."
                )
            raise MapError(
                f"the map gives channel '{channel}' column {wanted} of '{self.path}', which has "
                f"{len(self.numbers)} (numbered from 1)."
            )
        if wanted in self.columns or wanted in self.unusable:
            return self._usable(wanted, channel)
        short = [name for name in self.columns if split_header(name)[0] == wanted]
        if len(short) == 1:
            return short[0]
        if wanted.isdigit() and int(wanted) in self.numbers:
            return self._usable(self.numbers[int(wanted)], channel)
        raise MapError(
            f"the map gives channel '{channel}' column '{wanted}', which '{self.path}' does not have.\n"
            f"It has: {self.describe()}.\nCorrect the column in the map."
            + (suggest(wanted, self.columns) if self.named else "")
        )

    def _usable(self, name: str, channel: str) -> str:
        if name in self.unusable:
            raise MapError(
                f"the map gives channel '{channel}' column '{name}' of '{self.path}', which holds no "
                f"numbers: {self.unusable[name]}."
            )
        return name


def table_from_matrix(path: str, matrix: np.ndarray, *, transpose: bool = False) -> FileTable:
    """Table of a 2-D array: one column per signal, numbered from 1."""
    matrix = np.asarray(matrix)
    if matrix.ndim == 1:
        matrix = matrix[:, None]
    if matrix.ndim != 2:
        raise DataError(
            f"'{path}' holds an array of {matrix.ndim} dimensions {matrix.shape}; "
            "a recording needs samples by signals. Choose a 2-D array with [file] variable."
        )
    if transpose:
        matrix = matrix.T
    if not is_numeric(matrix):
        raise DataError(f"'{path}' holds an array of type {matrix.dtype}, not of numbers.")
    columns = {str(j + 1): as_float(matrix[:, j]) for j in range(matrix.shape[1])}
    return FileTable(path, columns, numbers={j + 1: str(j + 1) for j in range(matrix.shape[1])}, named=False)


def table_from_arrays(
    path: str,
    arrays: Mapping[str, object],
    *,
    units: Mapping[str, object] | None = None,
    numbered: bool = False,
) -> FileTable:
    """Table of named arrays, as .mat, .npz and .h5 files hold them.

    A 1-D array is one column; an (n, k) array becomes the k columns ``name[1]`` ... ``name[k]``.
    Scalars, text and lists of unequal rows are no signals: they are listed as unusable.

    Parameters
    ----------
    path : str
        The file, for messages.
    arrays : mapping of str to array
        Arrays or lists of numbers, in the order of the file.
    units : mapping of str to str, optional
        Units by name, where the file states them elsewhere than in the names. They precede those of the names; a note
        lists those that cannot be read.
    numbered : bool
        Whether the order of the columns is that of the file, so that a map may state their numbers.

    Raises
    ------
    DataError
        The arrays or the units have no names.
    """
    for what, named in (("columns", arrays), ("units", {} if units is None else units)):
        if not isinstance(named, Mapping):
            raise DataError(f"'{path}' holds {type(named).__name__} where {what} by name are needed: it is damaged.")
    columns: dict[str, np.ndarray] = {}
    unusable: dict[str, str] = {}
    notes: tuple[str, ...] = ()
    source: dict[str, str] = {}  # name in the file of each column
    for name, value in arrays.items():
        made, reason = _columns_of(name, value)
        columns |= made
        unusable |= {name: reason} if reason else {}
        source |= dict.fromkeys(made or (name,), name)
    stated = {column: unit for column in columns if (unit := split_header(column)[1]) is not None}
    for column, name in source.items():
        given = (units or {}).get(name)
        if isinstance(given, str) and is_unit(given):
            stated[column] = given
        elif given is not None:
            notes = (*notes, f"the unit of '{name}' cannot be read: {str(given)[:_SHOWN]!r}")
    numbers = dict(enumerate(source, 1)) if numbered else {}
    return FileTable(path, columns, units=stated, numbers=numbers, unusable=unusable, notes=notes)


def _columns_of(name: str, value: object) -> tuple[dict[str, np.ndarray], str]:
    """Columns of a named value, and the reason where there are none."""
    try:
        array = np.asarray(value)
    except ValueError:  # NumPy makes no array of rows of several lengths
        return {}, "rows of different lengths"
    if array.ndim == 2 and 1 in array.shape:
        array = array.reshape(-1)
    if not is_numeric(array):
        return {}, "text or objects"
    if array.ndim == 1 and array.size:
        return {name: as_float(array)}, ""
    if array.ndim == 2 and array.size:
        return {f"{name}[{j + 1}]": as_float(array[:, j]) for j in range(array.shape[1])}, ""
    return {}, "one value" if array.size == 1 else f"an array of shape {array.shape}"


def is_numeric(array: np.ndarray) -> bool:
    """Whether an array holds real numbers or truth values."""
    return bool(array.dtype.kind in "biuf")


def as_float(array: np.ndarray) -> np.ndarray:
    """(n,) contiguous float64 copy."""
    with np.errstate(invalid="ignore"):  # a damaged file may hold NaN of the kind that signals; it is NaN all the same
        return np.array(array, dtype=np.float64)
