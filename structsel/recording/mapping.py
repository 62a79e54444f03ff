"""From the columns of a file to named SI channels on one clock, every conversion written down."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from structsel.errors import ChannelError, DataError, MapError
from structsel.nomenclature import find_channel, is_known
from structsel.readers.channel_map import ChannelEntry, ChannelMap, check_unit
from structsel.readers.table import FileTable, as_float, split_header
from structsel.readers.units import convert, is_convertible, is_unit, si_unit
from structsel.recording.checks import Finding, require_clock
from structsel.recording.resampling import Topic, resample_all


@dataclass
class Channels:
    """What a file gives once names, units and signs are ours.

    Attributes
    ----------
    t : (n,) array [s]
    values : dict of str to (n,) array
        In the nomenclature's units; channels it does not hold in the SI unit of `units`.
    units : dict of str to str
        Of channels the nomenclature does not hold and whose unit is known.
    notes : list of str
        One line per conversion made or column left out.
    findings : list of Finding
        What the header and the map do not agree on, and what was done to bring channels to one clock.
    clocks : dict of str to (str, bool)
        In a log of many rates: the column that holds each channel's times, and whether the channel is held.
    """

    t: np.ndarray
    values: dict[str, np.ndarray]
    units: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    findings: list[Finding] = field(default_factory=list)
    clocks: dict[str, tuple[str, bool]] = field(default_factory=dict)


def to_channels(table: FileTable, channel_map: ChannelMap | None) -> Channels:
    """Apply a channel map to a table; without a map, names are taken as they are, or as the format's own map says.

    Raises
    ------
    MapError
        When the map names a column the file does not have, or a unit does not fit.
    ChannelError
        When a header's own unit does not fit its channel and there is no map.
    DataError
        When there is no clock, or columns differ in length.
    """
    made = Channels(np.empty(0), {}, notes=list(table.notes))
    made.findings += [Finding("file", "t", fault) for fault in table.faults]
    used: set[str] = set()
    standard = table.standard_map
    if channel_map is None and standard is not None:
        channel_map = standard
        made.notes.append(f"no map given: columns taken as {standard.source} has them")
        made.findings += _assumed(table)
    elif channel_map is not None and standard is not None and channel_map.file.dt is None:
        clock = {"t": standard.channels["t"]} if "t" in standard.channels else {}
        channel_map = channel_map.model_copy(update={"channels": clock | channel_map.channels})
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
        made.notes.append(f"left out, not in the map: {_listed(left)}")
    _align(made, table, channel_map)
    if not made.values:
        raise DataError(f"'{table.path}' holds time and nothing else.")
    return made


def _assumed(table: FileTable) -> list[Finding]:
    """What a standard map takes on trust, each said once of the first channel it holds for."""
    alike: dict[str, list[str]] = {}
    for name, why in table.assumptions.items():
        alike.setdefault(why, []).append(name)
    return [
        Finding("assumed", first, why + (f"; so of {', '.join(more)}" if more else ""), severity="note")
        for why, (first, *more) in alike.items()
    ]


def _add_mapped(made: Channels, table: FileTable, name: str, entry: ChannelEntry, source: str, used: set[str]) -> None:
    weights: list[tuple[str, float]]
    if entry.columns:
        weights = [(table.resolve(column, name), weight) for column, weight in entry.columns.items()]
    else:
        assert entry.column is not None
        weights = [(table.resolve(entry.column, name), 1.0)]
    used.update(column for column, _ in weights)
    lengths = {len(table.columns[column]) for column, _ in weights}
    if len(lengths) > 1:
        raise DataError(
            f"channel '{name}' adds columns of '{table.path}' that differ in length: "
            + ", ".join(f"{column} ({len(table.columns[column])})" for column, _ in weights)
        )
    if entry.columns:
        _require_one_clock(table, name, [column for column, _ in weights])
        values = np.sum([weight * as_float(table.columns[column]) for column, weight in weights], axis=0)
        origin = " ".join(f"{weight:+g}*'{column}'" for column, weight in weights)
    else:
        values = as_float(table.columns[weights[0][0]])
        origin = f"'{weights[0][0]}'"
    if weights[0][0] in table.clocks:
        made.clocks[name] = (table.clocks[weights[0][0]], entry.hold)
        if not np.isfinite(values).any():
            raise DataError(
                f"channel '{name}' of '{table.path}': column {origin} holds no number at all, as when its instrument "
                f"was not there.\nTake '{name}' out of the map, or name another column."
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
        steps.append("sign turned")
    stated = {table.units[column] for column, _ in weights if column in table.units}
    unit = entry.unit
    if unit is None and len(stated) > 1:
        raise MapError(
            f"the map gives channel '{name}' columns of '{table.path}' in different units "
            f"({', '.join(sorted(stated))}).\nBring them to one unit by their weights and state it."
        )
    if unit is None and stated:
        unit = stated.pop()
        check_unit(name, unit, f"the header of '{table.path}'")
    elif unit is not None and stated and not _same(unit, stated):
        made.findings.append(
            Finding(
                "header",
                name,
                f"the file says [{', '.join(sorted(stated))}], the map [{unit}]; the map was followed",
                severity="warning",
                remedy=f"make sure of the unit of {origin}",
            )
        )
    _store(made, name, values, unit, f"column {origin}", steps, source)


def _same(unit: str, stated: set[str]) -> bool:
    return all(
        is_convertible(other, unit) and np.isclose(convert(np.ones(1), other, unit)[0], 1.0, rtol=1e-9)
        for other in stated
    )


def _add_others(made: Channels, table: FileTable, used: set[str]) -> None:
    times = set(table.clocks.values()) - {"t"}
    for column in table.columns:
        if column in used or column in times:
            continue
        name = split_header(column)[0] if column in table.units else column
        if name == "dt":
            made.notes.append("column 'dt' left out: that name is kept for the sampling interval")
            continue
        if name in made.values:
            raise DataError(
                f"'{table.path}' has more than one column for channel '{name}'.\n"
                f"It has: {table.describe()}.\nSay in a channel map which is meant."
            )
        used.add(column)
        _add_named(made, table, column, name)
    for column, reason in table.unusable.items():
        made.notes.append(f"column '{column}' left out: {reason}")
        if reason.startswith("sample"):
            message = f"left out, because not every sample is a number: {reason}"
            remedy = "mend the file if the column is wanted"
            made.findings.append(Finding("text", column, message, remedy=remedy))


def _add_named(made: Channels, table: FileTable, column: str, name: str) -> None:
    unit = table.units.get(column)
    if unit is not None and is_known(name) and not is_convertible(unit, find_channel(name).unit):
        row = find_channel(name)
        raise ChannelError(
            f"the header of '{table.path}' gives channel '{name}' the unit '{unit}', but {row.meaning} is "
            f"measured in [{row.unit}].\nCorrect the header, or say in a channel map what the column is."
        )
    base, _, tail = column.partition("[")
    if unit is None and tail and is_known(base.strip()) and not is_unit(tail.rstrip("] ")):
        made.findings.append(
            Finding(
                "header",
                column,
                f"'{tail.rstrip('] ')}' is no unit that can be read, so this is not '{base.strip()}'",
                severity="warning",
                remedy="correct the header, or use a channel map",
            )
        )
    origin = f"column '{column}'" if column != name else "own name"
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
    if name in made.values:
        raise MapError(f"'{source}' gives channel '{name}' twice.")
    if is_known(name):
        target = find_channel(name).unit
        if unit is None:
            steps.append(f"taken as [{target}], no unit stated" if target != "-" else "as it stands")
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
    """Take the clock out of the channels, and hold every channel to its length."""
    clock = made.values.pop("t", None)
    dt = channel_map.file.dt if channel_map is not None else None
    if clock is not None:
        if table.clocks:
            clock = _to_one_clock(made, table, clock)
        length = len(clock)
        if dt is not None:
            raise MapError(
                f"'{table.path}' has a time column 't', and the map a dt.\n"
                "Leave dt out, or leave 't' out by listing the channels wanted."
            )
    elif dt is not None:
        length = Counter(len(values) for values in made.values.values()).most_common(1)[0][0]
        clock = np.arange(length) * dt
        made.notes.append(f"t: made from dt = {dt:g} s, no time column")
    else:
        raise DataError(_no_clock(table, channel_map))
    unequal = [name for name, values in made.values.items() if len(values) != length]
    mapped = set(channel_map.channels) if channel_map is not None else set()
    for name in unequal:
        if name in mapped:
            raise DataError(
                f"channel '{name}' of '{table.path}' has {len(made.values[name])} samples, "
                f"its clock {length}.\nAll channels of a recording share one clock: "
                "map columns of one length, or resample first."
            )
        made.notes.append(f"{name} left out: {len(made.values[name])} values against {length} on the clock")
        del made.values[name]
    if channel_map is not None and channel_map.file.rows is not None:
        first, last = channel_map.file.rows
        if last > length:
            raise MapError(f"the map keeps rows {first} to {last} of '{table.path}', which has {length} samples.")
        clock = clock[first - 1 : last]
        made.values = {name: values[first - 1 : last] for name, values in made.values.items()}
        made.notes.append(f"rows {first} to {last} of {length} kept")
    if channel_map is not None and channel_map.file.time_offset:
        clock = clock + channel_map.file.time_offset
        made.notes.append(f"t: {channel_map.file.time_offset:+g} s added")
    made.t = clock


def _require_one_clock(table: FileTable, name: str, columns: list[str]) -> None:
    clocks = {table.clocks[column] for column in columns if column in table.clocks}
    if len(clocks) > 1:
        raise DataError(
            f"channel '{name}' adds columns of '{table.path}' that were not sampled together: "
            f"{', '.join(sorted(clocks))}.\nMap each to a channel of its own."
        )


def _to_one_clock(made: Channels, table: FileTable, clock: np.ndarray) -> np.ndarray:
    """Bring every channel to the clock's samples; return those that are left of the clock."""
    own = made.clocks.pop("t", ("", False))[0]
    if not own:
        raise MapError(f"the clock 't' of '{table.path}' is no column of sample times.\nName one of them.")
    topics = {
        column: Topic.of(column, convert(as_float(table.columns[column]), table.units.get(column, "s"), "s"))
        for column in {own: False, **dict(made.clocks.values())}
    }
    for name in [name for name, (column, _) in made.clocks.items() if len(topics[column].times) < 2]:
        made.notes.append(f"{name} left out: '{made.clocks.pop(name)[0]}' has fewer than two times")
        del made.values[name]
    met = {name: (topics[column], hold) for name, (column, hold) in made.clocks.items()}
    require_clock(topics[own].times, f"{table.path}, {own}")
    samples, made.values, told, notes = resample_all(topics[own], met, made.values)
    made.findings += told
    made.notes += notes
    return clock[samples]


def _no_clock(table: FileTable, channel_map: ChannelMap | None) -> str:
    message = f"'{table.path}' has no channel 't' [s].\nIt has: {table.describe()}.\n"
    if "t" in table.unusable:
        return message + f"Its column 't' holds something else than numbers: {table.unusable['t']}. Correct the file."
    times = re.compile(r"(t|time.*|t_.*|clock|sec.*|date.*)", re.IGNORECASE)
    if text := [name for name in table.unusable if times.fullmatch(name)]:
        why = f"Its column '{text[0]}' holds no numbers: {table.unusable[text[0]]}."
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


def _listed(names: list[str]) -> str:
    return ", ".join(names[:20]) + (f", ... ({len(names)} in all)" if len(names) > 20 else "")
