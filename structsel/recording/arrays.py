"""The arrays of a recording: time and channels as read-only float64 in the units of the nomenclature, or refused."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from structsel.errors import ChannelError, DataError
from structsel.nomenclature import UNKNOWN, find_channel, is_known
from structsel.readers.units import convert, is_convertible

if TYPE_CHECKING:
    import pandas as pd

_TIMES = ("datetime64", "datetime", "timedelta64", "timedelta")


def checked_time(t: Any, name: str) -> np.ndarray:
    """Time axis of the recording `name` in seconds, (n,); dates become seconds since the first sample.

    Raises
    ------
    DataError
        It is not a vector, or contains neither real numbers nor times.
    """
    import pandas as pd

    if _holds_times(t):
        index = pd.Index(np.asarray(t))
        t = np.asarray((index - index[0] if index.dtype.kind != "m" else index) / np.timedelta64(1, "s"))
    seconds = read_only(t, name, "t")
    if seconds.ndim != 1:
        raise DataError(f"'{name}': the time axis 't' must be a vector, not of shape {seconds.shape}.")
    return seconds


def checked_channels(
    channels: Mapping[str, Any], units: Mapping[str, str], t: np.ndarray, name: str
) -> tuple[Mapping[str, np.ndarray], Mapping[str, str]]:
    """Channels of the recording `name`, those of the nomenclature in its units, and the units of the other channels.

    Raises
    ------
    DataError
        A channel has the name or not the length of the time axis, or does not contain real numbers.
    ChannelError
        A unit is not of the quantity of its channel.
    """
    arrays, own_units = {}, {}
    for channel, values in channels.items():
        if channel in ("t", "dt"):
            raise DataError(f"'{name}': '{channel}' is the name of the time axis, not of a channel.")
        array = read_only(values, name, channel)
        if array.shape != t.shape:
            raise DataError(
                f"'{name}': channel '{channel}' has shape {array.shape}, the time axis {t.shape}.\n"
                "All channels of a recording have one time axis."
            )
        if channel in units:
            if is_known(channel):
                array = _in_nomenclature_unit(array, units[channel], name, channel)
            else:
                own_units[channel] = units[channel]
        arrays[channel] = array
    return MappingProxyType(arrays), MappingProxyType(own_units)


def read_only(values: Any, name: str, channel: str) -> np.ndarray:
    """Read-only float64 array, copied unless it is one already. Masked samples become NaN.

    Raises
    ------
    DataError
        The values are not real numbers.
    """
    if isinstance(values, np.ma.MaskedArray) and values.dtype.kind in "biuf":
        values = np.where(np.ma.getmaskarray(values), np.nan, np.asarray(values.data, dtype=np.float64))
    array = np.asarray(values)
    if array.dtype.kind == "c":
        raise DataError(
            f"'{name}': channel '{channel}' contains complex numbers; a channel has real numbers.\n"
            "Make two channels: real and imaginary part, or magnitude and phase."
        )
    if _holds_times(array):
        raise DataError(
            f"'{name}': channel '{channel}' contains times; only the time axis 't' may.\n"
            "Convert it to a number of seconds."
        )
    try:
        array = np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(
            f"'{name}': channel '{channel}' contains something other than numbers: {error}.\n"
            "Convert it to floats, with NaN for missing values."
        ) from error
    if array.flags.writeable or not array.flags.c_contiguous:
        array = np.array(array, dtype=np.float64)
        array.setflags(write=False)
    return array


def _holds_times(values: Any) -> bool:
    import pandas as pd

    array = np.asarray(values)
    if array.dtype.kind != "O":
        return array.dtype.kind in "mM"
    return array.ndim == 1 and pd.api.types.infer_dtype(array, skipna=True) in _TIMES


def _in_nomenclature_unit(values: np.ndarray, unit: str, name: str, channel: str) -> np.ndarray:
    row = find_channel(channel)
    if unit in (row.unit, UNKNOWN):
        return values
    if not is_convertible(unit, row.unit):
        raise ChannelError(
            f"'{name}': units gives channel '{channel}' the unit '{unit}', but {row.meaning} is measured in "
            f"[{row.unit}].\nCorrect the unit, or rename the channel."
        )
    return read_only(convert(values, unit, row.unit), name, channel)


def frame_channels(
    frame: pd.DataFrame, name: str, time: str, units: Mapping[str, str] | None
) -> tuple[Any, dict[str, Any], dict[str, str]]:
    """Time, columns and units of a data frame.

    Raises
    ------
    DataError
        There is no time, or a name in `time` or `units` is no column.
    """
    columns = {str(column): frame[column].to_numpy() for column in frame.columns}
    if units is None:  # the frame may have lost columns since its units were attached
        units = {column: unit for column, unit in dict(frame.attrs.get("units", {})).items() if column in columns}
    for wanted in ([time] if time else []) + list(units):
        if wanted not in columns:
            there = ", ".join(list(columns)[:10])
            raise DataError(f"'{name}': the data frame has no column '{wanted}'. It has: {there}.")
    if time or "t" in columns:
        t, unit = columns.pop(time or "t"), units.get(time or "t", "s")
        return t if unit == "s" else convert(t, unit, "s"), columns, dict(units)
    index = frame.index
    if index.dtype.kind in "mM" or index.name in ("t", "time"):
        return index.to_numpy(), columns, dict(units)
    raise DataError(
        f"'{name}': the data frame has no time. It has: {', '.join(list(columns)[:10])}.\n"
        'Name its column: Recording.from_frame(frame, time="Time").'
    )
