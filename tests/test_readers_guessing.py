"""Channel maps guessed from names, units and values, and `describe --guess-map` that writes them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose
from typer.testing import CliRunner

from structsel.cli import app
from structsel.errors import DataError
from structsel.readers import read_table
from structsel.readers.aliases import AMBIGUOUS, BY_NAME, SIGN_REVERSED
from structsel.readers.channel_map import FileOptions
from structsel.readers.guess_map import guess_map
from structsel.recording import read_recording

T = np.arange(200) * 0.02
G = 9.80665
DEG = np.pi / 180.0


def write(path, columns):
    names = ",".join(columns)
    rows = np.column_stack([np.broadcast_to(values, T.shape) for values in columns.values()])
    path.write_text(names + "\n" + "\n".join(",".join(repr(float(x)) for x in row) for row in rows) + "\n")
    return path


def guess(path, **options):
    guessed = guess_map(read_table(path, FileOptions(**options)))
    return guessed, {g.channel: g for g in guessed.guesses}


def describe(*words, code=0):
    done = CliRunner().invoke(app, ["describe", *map(str, words)], env={"COLUMNS": "100"})
    assert done.exit_code == code, done.output
    return done


FOREIGN = {
    "Time": 1000.0 * T, "AoA [deg]": 5.0 + np.sin(T), "SSA_deg": 2.0 * np.sin(T), "Roll": 20.0 * np.sin(T),
    "Pitch": 0.9 * np.cos(T), "RollRate (deg/s)": 10.0 * np.cos(T), "gyro_y": 8.0 * np.sin(T),
    "gyro_z": 0.5 * np.sin(T),
    "Nx": 0.1, "Nz": 1.0 + 0.1 * np.sin(T), "TAS [kt]": 100.0 + T, "elev": 3.0 * np.sin(T), "rud": 0.7 * np.cos(T),
    "LeftAil": 2.0 * np.sin(T), "RightAil": -2.0 * np.sin(T), "Climb rate [ft/min]": 300.0, "Throttle": 65.0,
    "fuel": 500.0 - T,
}  # fmt: skip


@pytest.fixture
def foreign(tmp_path):
    return write(tmp_path / "flight.csv", FOREIGN)


def test_no_name_means_two_channels():
    assert not set(BY_NAME) & set(AMBIGUOUS)
    assert not set(BY_NAME) & set(SIGN_REVERSED)
    assert not set(AMBIGUOUS) & set(SIGN_REVERSED)


def test_the_guessed_map_reads_the_file_as_it_was_meant(foreign, tmp_path):
    guessed, _ = guess(foreign)
    (tmp_path / "map.toml").write_text(str(guessed))
    recording = read_recording(foreign, tmp_path / "map.toml")
    for channel, value in {
        "t": T, "alpha": (5.0 + np.sin(T)) * DEG, "beta": 2.0 * np.sin(T) * DEG, "phi": 20.0 * np.sin(T) * DEG,
        "p": 10.0 * np.cos(T) * DEG, "q": 8.0 * np.sin(T) * DEG, "az": -(1.0 + 0.1 * np.sin(T)) * G,
        "V": (100.0 + T) * 1852.0 / 3600.0, "de": 3.0 * np.sin(T) * DEG, "da": -2.0 * np.sin(T) * DEG,
        "vd": -300.0 * 0.3048 / 60.0, "throttle": 0.65,
    }.items():  # fmt: skip
        assert_allclose(recording[channel], value, rtol=1e-12, atol=1e-12, err_msg=channel)


def test_a_unit_that_is_not_stated_is_that_of_its_kind(foreign):
    # 0.9 and 0.7 could be radians, but the bank reaches 20 and the elevator 3; Nz is about 1, so Nx is in g too.
    _, found = guess(foreign)
    for channel, unit in {"theta": "deg", "dr": "deg", "r": "deg/s", "ax": "g"}.items():
        assert found[channel].entry.unit == unit, channel
        assert found[channel].sure == "unsure"


def test_how_sure_a_line_is_follows_from_what_is_known_of_it(foreign):
    _, found = guess(foreign)
    assert {name: found[name].sure for name in ("alpha", "V", "p", "phi", "de", "az", "da", "vd", "t")} == {
        "alpha": "sure", "V": "sure", "p": "sure",  # name and stated unit
        "phi": "likely", "t": "likely",  # unit by size
        "de": "likely", "az": "likely", "vd": "likely",  # a sign to check
        "da": "unsure",  # combined from two
    }  # fmt: skip
    assert "is a positive one a negative moment?" in found["de"].why
    assert "up to 20, so degrees" in found["phi"].why


def test_indicated_airspeed_is_never_taken_for_true_without_a_word(tmp_path):
    _, found = guess(write(tmp_path / "m.csv", {"t": T, "IAS_kt": 90.0 + T}))
    assert found["V"].sure == "unsure"
    assert "V is true" in found["V"].why
    _, both = guess(write(tmp_path / "n.csv", {"t": T, "IAS_kt": 90.0 + T, "TAS_kt": 100.0 + T}))
    assert both["V"].entry.column == "TAS_kt"


def test_two_columns_for_one_channel_make_it_unsure_and_are_both_named(tmp_path):
    _, found = guess(write(tmp_path / "m.csv", {"t": T, "AoA [deg]": T, "alpha_vane [deg]": T}))
    assert found["alpha"].sure == "unsure"
    assert found["alpha"].why.endswith("or 'alpha_vane [deg]'")


def test_a_unit_that_measures_something_else_speaks_against_the_name(tmp_path):
    guessed, found = guess(write(tmp_path / "m.csv", {"t": T, "pitch [m]": T, "AoA [deg]": T}))
    assert "theta" not in found
    assert guessed.unplaced["pitch [m]"] == "may be theta, but [m] measures something else than [rad]"


def test_values_out_of_what_is_plausible_make_a_line_unsure(tmp_path):
    _, found = guess(write(tmp_path / "m.csv", {"t": T, "alpha [rad]": 5.0 + T}))
    assert found["alpha"].sure == "unsure"
    assert "degrees fed as radians" in found["alpha"].why


def test_a_file_without_headers_gives_its_clock_and_the_ranges_of_the_others(tmp_path):
    np.savetxt(tmp_path / "m.txt", np.column_stack([np.sin(T), T, 5.0 + T]))
    guessed, found = guess(tmp_path / "m.txt")
    assert found["t"].entry.column == 2
    assert guessed.unplaced["3"] == "5 to 8.98"
    assert "t = { column = 2 }  # unsure: it increases evenly, by 0.02" in str(guessed)


def test_a_file_that_says_nothing_is_refused(tmp_path):
    path = write(tmp_path / "m.csv", {"foo": np.sin(T), "bar": np.cos(T)})
    with pytest.raises(DataError, match=r"no column of .*m\.csv' is recognised by its name\.\nIt has: foo, bar"):
        guess(path)


def test_how_the_file_is_read_is_part_of_the_map(tmp_path):
    path = write(tmp_path / "m.csv", {"t": T, "alpha_deg": T})
    path.write_text("1,2\n3,4\n" + path.read_text())
    options = FileOptions(skip_rows=2)
    guessed = guess_map(read_table(path, options), options)
    assert "[file]\nskip_rows = 2\n" in str(guessed)
    (tmp_path / "map.toml").write_text(str(guessed))
    assert_allclose(read_recording(path, tmp_path / "map.toml")["alpha"], T * DEG, rtol=1e-12)


# --- the command ---------------------------------------------------------------------------------


def test_describe_writes_the_map_and_says_what_it_could_not_place(foreign, tmp_path):
    done = describe(foreign, "--guess-map", tmp_path / "map.toml")
    assert "alpha" in done.stdout
    assert "not recognised: fuel" in done.stdout
    assert "written to" in done.stderr
    assert '#   "fuel": 496 to 500' in (tmp_path / "map.toml").read_text()
    assert "alpha" in describe(foreign, "--map", tmp_path / "map.toml").stdout


def test_describe_gives_the_guesses_as_json(foreign, tmp_path):
    held = json.loads(describe(foreign, "--guess-map", tmp_path / "map.toml", "--json").stdout)
    assert held["schema"] == "structsel.guessed_map/1"
    assert held["channels"]["az"]["sign"] == -1
    assert list(held["unplaced"]) == ["fuel"]


def test_a_map_that_is_there_is_never_overwritten(foreign, tmp_path):
    (tmp_path / "map.toml").write_text("mine\n")
    done = describe(foreign, "--guess-map", tmp_path / "map.toml", code=1)
    assert "exists already and is not overwritten" in done.stderr
    assert (tmp_path / "map.toml").read_text() == "mine\n"


def test_a_map_is_guessed_for_one_file_only(foreign, tmp_path):
    write(tmp_path / "other.csv", FOREIGN)
    for files in ([foreign, tmp_path / "other.csv"], [tmp_path]):
        assert "takes one file" in describe(*files, "--guess-map", tmp_path / "map.toml", code=2).output
    assert not (tmp_path / "map.toml").exists()
    done = describe(foreign, "--guess-map", tmp_path / "none" / "map.toml", code=1)
    assert "cannot be written: No such file or directory" in done.stderr


def test_a_column_that_is_placed_is_not_taken_for_time_and_a_time_of_day_is(tmp_path):
    n = 300
    rows = [f"12:00:{0.02 * k:06.3f},{1.0 + 0.01 * k:.4f},{np.sin(0.3 * k):.4f}" for k in range(n)]
    path = tmp_path / "times.csv"
    path.write_text("Time,AoA,de\n" + "\n".join(rows) + "\n")
    guessed = guess_map(read_table(path, FileOptions()))
    columns = {guess.channel: guess.columns for guess in guessed.guesses}
    assert columns == {"t": ["Time"], "alpha": ["AoA"], "de": ["de"]}
