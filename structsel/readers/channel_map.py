"""Channel map: how the columns of a file become our channels.

A map is a TOML file::

    [channels]
    alpha = { column = "AoA", unit = "deg" }
    ay    = { column = 12 }                                  # 1-based, for files without a header
    az    = { column = 11, sign = -1 }
    da    = { columns = { 28 = -0.5, 29 = 0.5 }, unit = "deg" }   # weighted sum of columns
    V     = "TAS"                                            # short for { column = "TAS" }
    de    = { column = "servo.out", unit = "deg", hold = true }   # a command, in a log with several sample rates
    [file]
    dt = 0.04                                                # s, if there is no time column

A channel is ``sign * (scale * column + offset)`` in `unit`, then brought to SI and radians.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    PositiveFloat,
    PositiveInt,
    StrictInt,
    StrictStr,
    ValidationError,
    model_validator,
)

from structsel.errors import MapError
from structsel.nomenclature import find_channel, is_known, suggest
from structsel.readers.toml import load_toml
from structsel.readers.units import is_convertible, is_unit

_Positive = Annotated[StrictInt, Field(ge=1)]
_SHOWN = 200  # characters of a wrong value that a message repeats


class ChannelEntry(BaseModel):
    """One line of ``[channels]``.

    Attributes
    ----------
    column : str or int
        Header, or 1-based number.
    columns : dict of str to float
        In place of `column`: weights of the columns that are added up; keys are headers or numbers.
    unit : str
        Of the column, after `scale` and `offset`. Without it the file's own unit, else ours.
    sign : 1 or -1
    scale, offset : float
    hold : bool
        In a log with several sample rates: a command, which stays constant until the next one (zero-order hold). Other
        channels are interpolated linearly.
    """

    model_config = ConfigDict(defer_build=True, extra="forbid", frozen=True)

    column: StrictStr | _Positive | None = None
    columns: dict[str, FiniteFloat] | None = None
    unit: str | None = None
    sign: Literal[1, -1] = 1
    scale: FiniteFloat = 1.0
    offset: FiniteFloat = 0.0
    hold: bool = False

    @model_validator(mode="before")
    @classmethod
    def _expand_short_form(cls, value: Any) -> Any:
        return {"column": value} if isinstance(value, str | int) and not isinstance(value, bool) else value

    @model_validator(mode="after")
    def _has_one_source(self) -> ChannelEntry:
        if (self.column is None) == (not self.columns):
            raise ValueError("needs either 'column' or 'columns'")
        if self.scale == 0.0:
            raise ValueError("'scale' is 0, which would erase the channel")
        if self.unit is not None and not is_unit(self.unit):
            raise ValueError(f"unit '{self.unit}' is not one that can be read")
        return self


class FileOptions(BaseModel):
    """The ``[file]`` table: how to read the file itself.

    Attributes
    ----------
    dt : float [s]
        Sampling interval, if there is no time column.
    time_offset : float [s]
        Added to time.
    rows : (first, last)
        1-based and inclusive: the samples to keep, for a file that holds more than one manoeuvre.
    others : {"leave", "keep"}
        Whether columns the map does not list are left out, or kept under their own names.
    variable : str
        .mat, .npz, .h5: the variable or struct that holds the signals; dots lead into structs.
    transpose : bool
        Signals run along the rows of a matrix.
    separator : str
        Text: detected if not given; may be "whitespace" or "tab".
    decimal : str
        Text: "." or ",".
    skip_rows : int
        Text: lines before the header.
    """

    model_config = ConfigDict(defer_build=True, extra="forbid", frozen=True)

    dt: PositiveFloat | None = None
    time_offset: FiniteFloat = 0.0
    rows: tuple[PositiveInt, PositiveInt] | None = None
    others: Literal["leave", "keep"] = "leave"
    variable: str | None = None
    transpose: bool = False
    separator: str | None = None
    decimal: Literal[".", ","] | None = None
    skip_rows: Annotated[int, Field(ge=0)] = 0

    @model_validator(mode="after")
    def _rows_in_order(self) -> FileOptions:
        if self.rows is not None and self.rows[1] <= self.rows[0]:
            raise ValueError(f"rows = {list(self.rows)} must run from a first to a later last row")
        return self


class ChannelMap(BaseModel):
    """A complete map; the docstring of the module has its form.

    Attributes
    ----------
    channels : dict of str to ChannelEntry
    file : FileOptions
    source : str
        Where it came from, for messages and provenance.
    """

    model_config = ConfigDict(defer_build=True, extra="forbid", frozen=True, populate_by_name=True)

    schema_name: Literal["structsel.map/1"] = Field(default="structsel.map/1", alias="schema")
    channels: dict[str, ChannelEntry] = Field(default_factory=dict)
    file: FileOptions = Field(default_factory=FileOptions)
    source: str = "channel map"


def load_channel_map(source: str | Path | Mapping[str, Any] | ChannelMap) -> ChannelMap:
    """Channel map from a TOML file, a mapping of the same form, or a map already made.

    Raises
    ------
    MapError
        When the file is missing or no TOML, a key is unknown, a value is wrong, or a unit does not
        measure what its channel is; the message names file and key.
    """
    if isinstance(source, ChannelMap):
        return source
    if isinstance(source, Mapping):
        return _validate(dict(source), "channel map")
    path = Path(source)
    return _validate(load_toml(path, "channel map", MapError), str(path))


def describe_problems(error: ValidationError, known: Mapping[str, tuple[str, ...]]) -> str:
    """One line per problem pydantic found: the key as written in TOML, and what is wrong.

    Parameters
    ----------
    error : ValidationError
    known : mapping
        Keys each table takes, to suggest one for a misspelt key; "" is the top.
    """
    lines = []
    for problem in error.errors():
        # Members of unions add parts such as "constrained-int" that nobody wrote.
        parts = [str(part) for part in problem["loc"] if not str(part).startswith(("constrained-", "str"))]
        parts = [part for part in parts if part not in ("int", "float", "is-instance[str]") and "[" not in part]
        key = ".".join(parts) or "the file"
        if problem["type"] == "extra_forbidden":
            table = parts[0] if len(parts) > 1 else ""
            allowed = known.get(table, ())
            lines.append(
                f"{key}: no such key.{suggest(str(problem['loc'][-1]), allowed)}"
                + (f" Keys here: {', '.join(allowed)}." if allowed else "")
            )
        elif problem["type"] == "missing":
            lines.append(f"{key}: missing.")
        else:
            message = problem["msg"].removeprefix("Value error, ")
            text = repr(problem["input"])
            shown = text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
            given = "" if isinstance(problem["input"], dict | BaseModel) else f" (it is {shown})"
            lines.append(f"{key}: {message[0].lower()}{message[1:]}{given}.")
    return "\n".join(dict.fromkeys(lines))


_KEYS = {
    "": ("schema", "channels", "file"),
    "channels": tuple(ChannelEntry.model_fields),
    "file": tuple(FileOptions.model_fields),
}


def _validate(content: dict[str, Any], source: str) -> ChannelMap:
    if "source" in content:
        raise MapError(f"{source}: source: no such key. Keys here: {', '.join(_KEYS[''])}.")
    try:
        made = ChannelMap(**{**content, "source": source})
    except ValidationError as error:
        raise MapError(f"channel map '{source}' cannot be used.\n{describe_problems(error, _KEYS)}") from error
    if not made.channels and made.file.others == "leave":
        raise MapError(
            f"channel map '{source}' lists no channels, so nothing would be read.\n"
            'Add a [channels] table, or [file] others = "keep" to take every column by its own name.'
        )
    for name, entry in made.channels.items():
        check_name(name, source)
        if entry.unit is not None:
            check_unit(name, entry.unit, f"channel map '{source}'")
    if "t" in made.channels and made.file.dt is not None:
        raise MapError(
            f"channel map '{source}' gives both a time column (channels.t) and file.dt.\n"
            "Keep dt only for a file without a time column."
        )
    return made


def check_name(name: str, source: str) -> None:
    """Refuse a channel called ``dt``: steps of time are the clock's, and flap is ``df``."""
    if name == "dt":
        raise MapError(
            f"channel map '{source}' makes a channel 'dt', which is kept for the sampling interval.\n"
            "Give it as [file] dt, or choose another name."
        )


def check_unit(name: str, unit: str, where: str) -> None:
    """Refuse a unit that measures something else than the channel does.

    Raises
    ------
    MapError
        Naming the channel and both units.
    """
    if is_known(name) and not is_convertible(unit, find_channel(name).unit):
        row = find_channel(name)
        raise MapError(
            f"{where} gives channel '{name}' the unit '{unit}', but {row.meaning} is measured in "
            f"[{row.unit}].\nCorrect the unit, or the column it was meant for."
        )
