"""From the columns of a file to named SI channels on one time axis, with a note for every conversion."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from structsel.errors import ChannelError, DataError, MapError
from structsel.formatting import join_names
from structsel.nomenclature import find_channel, is_known
from structsel.readers.channel_map import ChannelEntry, ChannelMap, check_unit
from structsel.readers.table import FileTable, as_float, split_header
from structsel.readers.units import convert, is_convertible, is_unit, si_unit
from structsel.recording.checks import require_time
from structsel.recording.finding import Finding
from structsel.recording.resampling import Topic, resample_all


@dataclass
class Channels:
    """Content of a file with the names, units and signs of the nomenclature.

    Attributes
    ----------
    t : (n,) array [s]
    values : dict of str to (n,) array
        In the units of the nomenclature; other channels in the SI unit given in `units`.
    units : dict of str to str
        Of channels that are not in the nomenclature and whose unit is known.
    notes : list of str
        One line for each conversion and for each column that was left out.
    findings : list of Finding
        Contradictions between the header and the map, and the resampling to one time axis.
    clocks : dict of str to (str, bool)
        In a log of several rates: the column with each channel's times, and whether the channel is held.
    """

    t: np.ndarray
    values: dict[str, np.ndarray]
    units: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    clocks: dict[str, tuple[str, bool]] = field(default_factory=dict)


def to_channels(table: FileTable, channel_map: ChannelMap | None) -> Channels:
    """Apply a channel map to a table; without one, the standard map of the format, or the names as they are.

    Raises
    ------
    MapError
        If the map names a column that is not in the file, or a unit does not fit.
    ChannelError
        If the unit in a header does not fit its channel and there is no map.
    DataError
        If there is no time column, or columns differ in length.
    """
    made = Channels(np.empty(0), {}, notes=list(table.notes))
    made.findings += [Finding("file", "t", fault) for fault in table.faults]
    used: set[str] = set()
    standard = table.standard_map
    if channel_map is None and standard is not None:
        channel_map = standard
        made.notes.append(f"no map given: columns are read with {standard.source}")
        made.findings += _assumed(table)
    elif channel_map is not None and standard is not None and channel_map.file.dt is None:
        time = {"t": standard.channels["t"]} if "t" in standard.channels else {}
        channel_map = channel_map.model_copy(update={"channels": time | channel_map.channels})
    if channel_map is not None:
        for name, entry in channel_map.channels.items():
            _add_mapped(made, table, name, entry, channel_map.source, used)
    if channel_map is None or channel_map.file.others == "keep":
        _add_others(made, table, used)
    elif "t" not in made.values and "t" in table.columns and channel_map.file.dt is None:
        _add_named(made, table, "t", "t")
        used.add("t")
    left = [name for name in table.columns if name not in used]
    if left and channel_map is not None and channel_map.file.others == "leave":
        made.notes.append(f"left out, not in the map: {join_names(left, 20)}")
    _align(made, table, channel_map)
    if not made.values:
        raise DataError(f"'{table.path}' has a time axis and no channels.")
    return made


def _assumed(table: FileTable) -> list[Finding]:
    """Assumptions of a standard map: one finding each, for the first channel that it concerns."""
    alike: dict[str, list[str]] = {}
    for name, why in table.assumptions.items():
        alike.setdefault(why, []).append(name)
    return [
        Finding("assumed", first, why + (f"; also for {', '.join(more)}" if more else ""), severity="note")
        for why, (first, *more) in alike.items()
    ]


def _add_mapped(made: Channels, table: FileTable, name: str, entry: ChannelEntry, source: str, used: set[str]) -> None:
    """Add one channel of the map: a column, or a weighted sum of columns, with scale, offset, sign and unit."""
    weights = [(table.resolve(column, name), weight) for column, weight in (entry.columns or {}).items()]
    if entry.column is not None:
        weights = [(table.resolve(entry.column, name), 1.0)]
    columns = [column for column, _ in weights]
    used.update(columns)
    if entry.columns:
        _require_same_times(table, name, columns)
        values = np.sum([weight * as_float(table.columns[column]) for column, weight in weights], axis=0)
        origin = " ".join(f"{weight:+g}*'{column}'" for column, weight in weights)
    else:
        values = as_float(table.columns[columns[0]])
        origin = f"'{columns[0]}'"
    if columns[0] in table.clocks:
        made.clocks[name] = (table.clocks[columns[0]], entry.hold)
        if not np.isfinite(values).any():
            raise DataError(
                f"channel '{name}' of '{table.path}': column {origin} contains no numbers; perhaps the instrument was "
                f"not installed.\nRemove '{name}' from the map, or name another column."
            )
    steps = []
    if entry.scale != 1.0:
        values = values * entry.scale
        steps.append(f"times {entry.scale:g}")
    if entry.offset != 0.0:
        values = values + entry.offset
        steps.append(f"plus {entry.offset:g}")
    if entry.sign == -1:
        values = -values
        steps.append("sign reversed")
    stated = {table.units[column] for column in columns if column in table.units}
    unit = _unit_of(made, table, name, entry.unit, stated, origin)
    _store(made, name, values, unit, f"column {origin}", steps, source)


def _unit_of(
    made: Channels, table: FileTable, name: str, unit: str | None, stated: set[str], origin: str
) -> str | None:
    """Unit of a mapped channel: that of the map, else the one stated in the header of its columns."""
    if unit is None and len(stated) > 1:
        raise MapError(
            f"the map gives channel '{name}' columns of '{table.path}' in different units "
            f"({', '.join(sorted(stated))}).\nConvert them to one unit with their weights, and state that unit."
        )
    if unit is None and stated:
        unit = stated.pop()
        check_unit(name, unit, f"the header of '{table.path}'")
    elif unit is not None and stated and not _same(unit, stated):
        listed = ", ".join(sorted(stated))
        message = f"the unit is [{listed}] in the file and [{unit}] in the map; that of the map is used"
        made.findings.append(Finding("header", name, message, remedy=f"check the unit of {origin}"))
    return unit


def _same(unit: str, stated: set[str]) -> bool:
    """Whether other units are different names of this unit."""
    return all(
        is_convertible(other, unit) and np.isclose(convert(np.ones(1), other, unit)[0], 1.0, rtol=1e-9)
        for other in stated
    )


def _add_others(made: Channels, table: FileTable, used: set[str]) -> None:
    """Add the columns that the map does not name, and a note for each that has no numbers."""
    times = set(table.clocks.values()) - {"t"}
    for column in table.columns:
        if column in used or column in times:
            continue
        name = split_header(column)[0] if column in table.units else column
        if name == "dt":
            made.notes.append("column 'dt' left out: this name is reserved for the sampling interval")
            continue
        if name in made.values:
            raise DataError(
                f"'{table.path}' has more than one column for channel '{name}'.\n"
                f"It has: {table.describe()}.\nName one of them in a channel map."
            )
        used.add(column)
        _add_named(made, table, column, name)
    for column, reason in table.unusable.items():
        made.notes.append(f"column '{column}' left out: {reason}")
        if reason.startswith("sample"):
            message = f"left out, because not all samples are numbers: {reason}"
            remedy = "correct the file if the column is needed"
            made.findings.append(Finding("text", column, message, remedy=remedy))


def _add_named(made: Channels, table: FileTable, column: str, name: str) -> None:
    """Add a column as the channel of its name, in the unit of its header."""
    unit = table.units.get(column)
    if unit is not None and is_known(name) and not is_convertible(unit, find_channel(name).unit):
        row = find_channel(name)
        raise ChannelError(
            f"the header of '{table.path}' gives channel '{name}' the unit '{unit}', but {row.meaning} is "
            f"measured in [{row.unit}].\nCorrect the header, or map the column in a channel map."
        )
    base, _, tail = column.partition("[")
    if unit is None and tail and is_known(base.strip()) and not is_unit(tail.rstrip("] ")):
        made.findings.append(
            Finding(
                "header",
                column,
                f"'{tail.rstrip('] ')}' is not a known unit, so the column is not read as '{base.strip()}'",
                severity="warning",
                remedy="correct the header, or use a channel map",
            )
        )
    origin = f"column '{column}'" if column != name else "column of the same name"
    if column in table.clocks:
        made.clocks[name] = (table.clocks[column], False)
    _store(made, name, as_float(table.columns[column]), unit, origin, [], table.path)


def _store(
    made: Channels,
    name: str,
    values: np.ndarray,
    unit: str | None,
    origin: str,
    steps: list[str],
    source: str,
) -> None:
    """Convert a channel to the unit of the nomenclature, or to SI, and add it with its note."""
    if name in made.values:
        raise MapError(f"'{source}' gives channel '{name}' twice.")
    if is_known(name):
        target = find_channel(name).unit
        if unit is None:
            steps.append(f"taken as [{target}], no unit stated" if target != "-" else "unchanged")
        elif not _same(unit, {target}):
            steps.append(f"[{unit}] to [{target}]")
            values = convert(values, unit, target)
        else:
            steps.append(f"in [{target}]")
    elif unit is not None:
        target = si_unit(unit)
        if not _same(unit, {target}):
            steps.append(f"[{unit}] to [{target}]")
            values = convert(values, unit, target)
        made.units[name] = target
    else:
        steps.append("unit unknown")
    made.values[name] = values
    made.notes.append(f"{name}: {origin}" + "".join(f", {step}" for step in steps))


def _align(made: Channels, table: FileTable, channel_map: ChannelMap | None) -> None:
    """Separate the time axis from the channels, which must all have its length."""
    t = made.values.pop("t", None)
    dt = channel_map.file.dt if channel_map is not None else None
    if t is not None:
        if table.clocks:
            t = _resample(made, table, t)
        length = len(t)
        if dt is not None:
            raise MapError(
                f"'{table.path}' has a time column 't', and the map a dt.\n"
                "Remove dt from the map, or list the channels in the map without 't'."
            )
    elif dt is not None:
        length = Counter(len(values) for values in made.values.values()).most_common(1)[0][0]
        t = np.arange(length) * dt
        made.notes.append(f"t: computed from dt = {dt:g} s, no time column")
    else:
        raise DataError(_no_time(table, channel_map))
    unequal = [name for name, values in made.values.items() if len(values) != length]
    mapped = set(channel_map.channels) if channel_map is not None else set()
    for name in unequal:
        if name in mapped:
            raise DataError(
                f"channel '{name}' of '{table.path}' has {len(made.values[name])} samples, "
                f"the time axis {length}.\nAll channels of a recording have one time axis: "
                "map columns of one length, or resample first."
            )
        made.notes.append(f"{name} left out: {len(made.values[name])} values, the time axis has {length}")
        del made.values[name]
    if channel_map is not None and channel_map.file.rows is not None:
        first, last = channel_map.file.rows
        if last > length:
            raise MapError(f"the map keeps rows {first} to {last} of '{table.path}', which has {length} samples.")
        t = t[first - 1 : last]
        made.values = {name: values[first - 1 : last] for name, values in made.values.items()}
        made.notes.append(f"rows {first} to {last} of {length} kept")
    if channel_map is not None and channel_map.file.time_offset:
        t = t + channel_map.file.time_offset
        made.notes.append(f"t: {channel_map.file.time_offset:+g} s added")
    made.t = t


def _require_same_times(table: FileTable, name: str, columns: list[str]) -> None:
    """Refuse a sum of columns that differ in length or in sample times."""
    lengths = [len(table.columns[column]) for column in columns]
    if len(set(lengths)) > 1:
        raise DataError(
            f"channel '{name}' adds columns of '{table.path}' that differ in length: "
            + ", ".join(f"{column} ({length})" for column, length in zip(columns, lengths))
        )
    times = {table.clocks[column] for column in columns if column in table.clocks}
    if len(times) > 1:
        raise DataError(
            f"channel '{name}' adds columns of '{table.path}' that were not sampled together: "
            f"{', '.join(sorted(times))}.\nMap each to its own channel."
        )


def _resample(made: Channels, table: FileTable, t: np.ndarray) -> np.ndarray:
    """Resample every channel to the time axis; return the samples of the time axis that all topics cover."""
    own = made.clocks.pop("t", ("", False))[0]
    if not own:
        raise MapError(f"the time axis 't' of '{table.path}' is not a column of sample times.\nName one of them.")
    topics = {
        column: Topic.from_times(column, convert(as_float(table.columns[column]), table.units.get(column, "s"), "s"))
        for column in {own: False, **dict(made.clocks.values())}
    }
    for name in [name for name, (column, _) in made.clocks.items() if len(topics[column].times) < 2]:
        made.notes.append(f"{name} left out: '{made.clocks.pop(name)[0]}' has fewer than two times")
        del made.values[name]
    channels = {name: (topics[column], hold) for name, (column, hold) in made.clocks.items()}
    require_time(topics[own].times, f"{table.path}, {own}")
    samples, made.values, findings, notes = resample_all(topics[own], channels, made.values)
    made.findings += findings
    made.notes += notes
    return t[samples]


def _no_time(table: FileTable, channel_map: ChannelMap | None) -> str:
    """Message for a file without a time axis, with the most likely remedy."""
    message = f"'{table.path}' has no channel 't' [s].\nIt has: {table.describe()}.\n"
    if "t" in table.unusable:
        return (
            message + f"Its column 't' contains something other than numbers: {table.unusable['t']}. Correct the file."
        )
    times = re.compile(r"(t|time.*|t_.*|clock|sec.*|date.*)", re.IGNORECASE)
    if text := [name for name in table.unusable if times.fullmatch(name)]:
        why = f"Its column '{text[0]}' contains no numbers: {table.unusable[text[0]]}."
        return message + f"{why} Convert it to seconds, or give [file] dt = ... in a channel map."
    likely = [name for name in table.columns if times.fullmatch(name)]
    nested = [name.rpartition(".")[0] for name in table.columns if name.rpartition(".")[2] in ("t", "time")]
    if not table.named:
        message += "Write a channel map with t = { column = 1 }, or [file] dt = ... if there is none."
    elif nested and channel_map is None:
        message += f"Write a channel map with [file] variable = '{nested[0]}' to read one struct."
    else:
        where = "a channel map with" if channel_map is None else "to the map's [channels]"
        column = likely[0] if likely else "..."
        verb = "Write" if channel_map is None else "Add"
        message += f'{verb} {where} t = {{ column = "{column}" }}, or [file] dt = ... if there is no time column.'
    return message
