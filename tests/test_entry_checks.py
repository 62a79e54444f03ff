"""Wrong clocks, units, signs and exchanged channels are found on every path by which data enter."""

from __future__ import annotations

import contextlib
import re
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import structsel as ss
from structsel import demo
from structsel.recording import DataWarning, Recording, stream_recordings, write_recording
from structsel.recording.checks import find_unit_and_sign_errors
from structsel.recording.kinematic_checks import Closure
from structsel.recording.sets import find_entry_errors, same_flights

ROOT = Path(__file__).parents[1]
DATA = ROOT.parent / "shared" / "data"
DEGREES = 180.0 / np.pi


@pytest.fixture(scope="module")
def flights():
    """An elevator, an aileron and a rudder manoeuvre in turbulence."""
    return demo.demo_flights(3, 5)[0]


def scaled(flight, factors, clock=1.0):
    return Recording(flight.name, clock * flight.t, {n: factors.get(n, 1.0) * x for n, x in flight.channels.items()})


def exchanged(flight, a, b):
    return Recording(flight.name, flight.t, {**flight.channels, a: flight[b], b: flight[a]})


FAULTS = {
    "t in ms": (lambda f: scaled(f, {}, 1000.0), 't looks like milliseconds.*Set unit = "ms" for t'),
    "t in us": (lambda f: scaled(f, {}, 1e6), "t looks like microseconds"),
    "clock twice as slow": (lambda f: scaled(f, {}, 2.0), r"t seems to be wrong by a factor of (2|2\.0\d|1\.9\d)\b"),
    "q in deg/s": (lambda f: scaled(f, {"q": DEGREES}), 'q looks like degrees per second.*unit = "deg/s" for q'),
    "all rates in deg/s": (
        lambda f: scaled(f, dict.fromkeys("pqr", DEGREES)),
        "p, q and r look like degrees per second",
    ),
    "theta in degrees": (lambda f: scaled(f, {"theta": DEGREES}), "theta looks like degrees"),
    "all angles in degrees": (
        lambda f: scaled(f, dict.fromkeys(("phi", "theta", "psi"), DEGREES)),
        "phi, theta and psi look like degrees",
    ),
    "p and r exchanged": (lambda f: exchanged(f, "p", "r"), "p and r seem to be exchanged"),
    "q reversed": (lambda f: scaled(f, {"q": -1.0}), "q (or theta )?seems to have the wrong sign"),
    "az in g": (lambda f: scaled(f, {"az": 1.0 / 9.80665}), 'az.*unit = "g"'),
    "az upward": (lambda f: scaled(f, {"az": -1.0}), "sign = -1"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_found_with_its_cause_and_remedy_in_every_flight(flights, fault):
    make, words = FAULTS[fault]
    for flight in flights:
        found = find_unit_and_sign_errors(make(flight).t, make(flight).channels)
        assert found
        assert any(re.search(words, str(f)) for f in found), [str(f) for f in found]


def test_a_climb_in_feet_and_an_airspeed_in_knots_are_found_by_the_climb_rate():
    # Level turn-free climb: h' = V sin(gamma), with gamma of +-3 deg; by arithmetic, no instrument errors.
    t = np.arange(0.0, 60.0, 0.1)
    gamma = 0.05 * np.sin(0.3 * t)
    V = np.full_like(t, 60.0)
    h = 1000.0 + np.concatenate(([0.0], np.cumsum(0.1 * 60.0 * 0.5 * (np.sin(gamma[1:]) + np.sin(gamma[:-1])))))
    base = {"V": V, "alpha": 0.05 + 0.0 * t, "theta": gamma + 0.05, "h": h}
    assert not find_unit_and_sign_errors(t, base)
    assert "h looks like feet" in str(find_unit_and_sign_errors(t, {**base, "h": h / 0.3048})[0])
    (found,) = find_unit_and_sign_errors(t, {**base, "V": V * 3600.0 / 1852.0})
    assert re.search('V looks like knots.*"kt"', str(found))


def test_the_bounds_of_a_scale_widen_with_fewer_windows_and_lower_correlation():
    # Twice is a contradiction in 60 windows with a correlation of 0.98; not in 10 with 0.92, where it may be noise.
    assert Closure(2.0, 0.98, 60.0).contradicted
    assert not Closure(2.0, 0.92, 10.0).contradicted
    assert Closure(1.1, 0.99, 60.0).closed
    assert not Closure(1.1, 0.99, 60.0).contradicted
    assert Closure(1.0, -0.99, 60.0).contradicted
    # The twin-otter's attitude moves by 0.885 of the integrated rate: an instrument, not a unit.
    assert not Closure(1.0 / 0.885, 0.995, 25.0).contradicted


@pytest.mark.parametrize("turbulence", [0.0, 1.0, 3.0])
def test_healthy_flights_raise_no_alarm_in_calm_air_and_in_turbulence(turbulence):
    for flight in demo.demo_flights(8, 11, turbulence=turbulence)[0]:
        assert not find_unit_and_sign_errors(flight.t, flight.channels)


@pytest.mark.slow
@pytest.mark.skipif(not DATA.is_dir(), reason="the real recordings (../shared/data) are not here")
@pytest.mark.parametrize(
    ("folder", "files", "channel_map"),
    [
        ("hfb320", "*.asc", ROOT / "examples" / "hfb320_map.toml"),
        ("attas-manoeuvres", "*.mat", ROOT / "examples" / "attas_map.toml"),
        ("attas-stall", "*.gz", DATA / "attas-stall" / "map.toml"),
        ("twin-otter", "totter_lon_0202*.mat", DATA / "twin-otter" / "map.toml"),
        ("f18-harv", "compat_lat*.mat", DATA / "f18-harv" / "map_lat.toml"),
        ("citation-flight", "*.gz", DATA / "citation-flight" / "map.toml"),
    ],
)
def test_real_recordings_raise_no_alarm_and_a_clock_in_ms_does(folder, files, channel_map):
    for path in sorted((DATA / folder).glob(files)):
        for part in ss.read_recording(path, channel_map).split():
            assert not find_unit_and_sign_errors(part.t, part.channels)
            found = find_unit_and_sign_errors(1000.0 * part.t, part.channels)
            assert any(f.channel == "t" and "t " in f.message for f in found), part.name


# --- the paths -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def wrong(flights):
    """Flights whose pitch rate is in deg/s, made without any file."""
    return [scaled(flight, {"q": DEGREES}) for flight in flights]


WORDS = "q looks like degrees per second"


def test_check_and_read_recording_report_it(wrong, tmp_path):
    assert any(WORDS in str(f) for f in wrong[0].check().findings)
    path = tmp_path / "m.csv"
    write_recording(wrong[0], path)
    assert any(WORDS in str(f) for f in ss.read_recording(path).findings)


def test_select_warns_once_for_all_recordings_and_not_without_a_fault(wrong, flights):
    pool = ss.Candidates.parse(["alpha", "de"])
    with pytest.warns(DataWarning, match=rf"^{wrong[0].name} \(and in 2 more\): q: {WORDS}") as caught:
        ss.select(wrong, "az", pool, bootstrap=0)
    assert len([w for w in caught if issubclass(w.category, DataWarning)]) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error", DataWarning)
        ss.select(flights, "az", pool, bootstrap=0)


def test_compute_coefficients_adds_the_finding_to_an_unchecked_recording(wrong):
    made = ss.compute_coefficients(wrong[0], demo.demo_aircraft())
    assert any(WORDS in str(f) for f in made.findings)


def test_compare_warns_before_it_compares(wrong):
    aircraft = demo.demo_aircraft()
    model = ss.AeroModel.from_terms({"CZ": {"alpha": -4.0}})
    # With such a pitch rate a comparison may also be refused.
    with pytest.warns(DataWarning, match=WORDS), contextlib.suppress(ss.errors.StructselError):
        ss.compare(model, wrong, aircraft)


def test_an_angle_whose_typical_value_is_no_angle_is_reported_for_a_recording_made_from_arrays(flights):
    found = find_entry_errors(scaled(flights[0], {"alpha": DEGREES}))
    assert any(f.channel == "alpha" and "degrees" in str(f) for f in found)


# --- one flight under two names ----------------------------------------------------------------------


def test_a_checked_recording_is_not_checked_again_and_a_changed_one_is(flights, monkeypatch):
    checked = scaled(flights[0], {}).check()
    monkeypatch.setattr("structsel.recording.sets.find_unit_and_sign_errors", lambda t, channels: [*channels])
    assert find_entry_errors(checked) == []
    assert find_entry_errors(replace(checked, channels={"q": checked["q"]}, units={})) == ["q"]


def test_one_flight_under_two_names_is_reported_whatever_the_time_of_day(flights):
    again = replace(flights[1], name="again", t=flights[1].t + 3600.0)
    assert not same_flights(flights)
    (text,) = same_flights([*flights, again])
    assert text.startswith(f"'again' and '{flights[1].name}' contain the same samples")
    other = again.with_channels(q=flights[1]["q"] + 1e-9)
    assert not same_flights([*flights, other])
    (text,) = same_flights([*flights, again, replace(again, name="and again")])
    assert "contain the same samples (and 1 more copies): one flight under two names. Leave them out" in text
    with pytest.warns(DataWarning, match="one flight under two names"):
        ss.select([*flights, again], "az", ss.Candidates.parse(["alpha"]), bootstrap=0)


def test_streamed_recordings_are_compared_without_reading_them_again(flights, tmp_path):
    for name, flight in {"a": flights[0], "b": flights[1], "c": flights[0]}.items():
        write_recording(replace(flight, name=name), tmp_path / f"{name}.csv")
    (text,) = same_flights(stream_recordings(tmp_path))
    assert text.startswith("'c' and 'a'")


def test_an_infinite_sample_is_no_kinematic_error_and_no_warning_of_numpy():
    t = np.arange(60) * 0.02
    theta = 0.1 + 0.1 * np.sin(t)
    channels = {"alpha": theta.copy(), "theta": theta, "q": 0.1 * np.cos(t), "V": 50.0 + t}
    before = find_unit_and_sign_errors(t, channels)
    channels["alpha"][0] = np.inf
    assert find_unit_and_sign_errors(t, channels) == before
