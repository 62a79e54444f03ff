"""Arrays given to a Recording: converted to the nomenclature's units and to seconds, or refused."""

from __future__ import annotations

import datetime

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from structsel.errors import ChannelError, DataError
from structsel.recording import Recording

T = np.arange(50) * 0.02
MICROSECONDS = (1e6 * T).round().astype("int64")
START = np.datetime64("2024-05-01T12:00:00", "us")


# --- units -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("channel", "unit", "factor"),
    [("alpha", "deg", np.pi / 180.0), ("V", "kt", 1852.0 / 3600.0), ("h", "ft", 0.3048), ("q", "deg/s", np.pi / 180.0)],
)
def test_a_stated_unit_converts_the_channel_and_is_not_kept(channel, unit, factor):
    values = 3.0 + np.sin(T)
    made = Recording("m", T, {channel: values}, units={channel: unit})
    assert_allclose(made[channel], factor * values, rtol=1e-14)
    assert not made.units
    # Results of it are not converted a second time.
    assert_array_equal(made.check()[channel], made[channel])
    again = made.with_channels(n1=90.0 + T, units={channel: unit, "n1": "%"})
    assert_array_equal(again[channel], made[channel])
    assert again.units == {"n1": "%"}


def test_a_unit_of_another_quantity_is_refused_with_channel_and_both_units():
    with pytest.raises(ChannelError, match=r"'m': units gives channel 'alpha' the unit 'kt'.*\[rad\]"):
        Recording("m", T, {"alpha": T}, units={"alpha": "kt"})


# --- clocks ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "clock",
    [
        START + MICROSECONDS.astype("timedelta64[us]"),
        MICROSECONDS.astype("timedelta64[us]"),
        pd.Series(pd.to_datetime(MICROSECONDS, unit="us", utc=True)),
        [datetime.datetime(2024, 5, 1) + datetime.timedelta(microseconds=int(m)) for m in MICROSECONDS],
        [datetime.timedelta(microseconds=int(m)) for m in MICROSECONDS],
    ],
    ids=["datetime64", "timedelta64", "with a time zone", "datetime", "timedelta"],
)
def test_dates_and_time_differences_become_seconds(clock):
    assert_allclose(Recording("m", clock, {"alpha": T}).t, T, atol=1e-9)


def test_a_time_difference_keeps_its_origin_and_a_missing_date_is_refused():
    recent = (5_000_000 + MICROSECONDS).astype("timedelta64[us]")
    assert Recording("m", recent, {"alpha": T}).t[0] == 5.0
    clock = START + MICROSECONDS.astype("timedelta64[us]")
    clock[7] = np.datetime64("NaT")
    with pytest.raises(DataError, match=r"'m': channel 't' is nan at sample 7"):
        Recording("m", clock, {"alpha": T})


# --- channels --------------------------------------------------------------------------------------


def test_masked_samples_are_nan_and_a_masked_clock_is_refused():
    masked = np.ma.masked_greater(T, 0.5)
    made = Recording("m", T, {"alpha": masked})
    assert_array_equal(np.isnan(made["alpha"]), T > 0.5)
    counts = np.ma.MaskedArray(np.arange(50), mask=np.arange(50) == 3)
    assert np.isnan(Recording("m", T, {"n": counts})["n"][3])
    with pytest.raises(DataError, match=r"'m': channel 't' is nan at sample 26"):
        Recording("m", masked, {"alpha": T})


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (T + 1j, r"'m': channel 'alpha' contains complex numbers; a channel has real numbers"),
        (
            START + MICROSECONDS.astype("timedelta64[us]"),
            r"'m': channel 'alpha' contains times; only the time axis 't' may",
        ),
        (["up"] * 50, r"'m': channel 'alpha' contains something other than numbers: could not convert"),
        ([{}] * 50, r"'m': channel 'alpha' contains something other than numbers"),
    ],
    ids=["complex", "dates", "text", "objects"],
)
def test_what_is_no_real_number_is_refused_with_recording_and_channel(values, words):
    with pytest.raises(DataError, match=words):
        Recording("m", T, {"alpha": values})
    if np.asarray(values).dtype.kind != "M":
        with pytest.raises(DataError, match="'m': channel 't' contains"):
            Recording("m", values, {"alpha": T})
