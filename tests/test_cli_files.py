"""Which recordings a command reads: files, folders, patterns, parts of them; and files to fill in."""

import json
import tomllib

import numpy as np
import pytest

from structsel import AeroModel, Aircraft, Recording, demo_flights, read_recording, write_recording
from structsel.cli import diagnose as diagnose_command
from structsel.cli.aircraft import TEMPLATE
from structsel.diagnosis.result import Diagnosis, ToleranceDeviation
from tests.commands import run

SELECT = ("--responses", "Cm", "--terms", "alpha,de", "--bootstrap", "0", "--json")


@pytest.fixture(autouse=True)
def flights(tmp_path, monkeypatch):
    """A folder of three flights of 500 samples, 0.04 s apart, in the current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "flights").mkdir()
    for k in range(3):
        t = 0.04 * np.arange(500)
        alpha, de = 0.1 + 0.03 * np.sin(0.7 * t + k), 0.05 * np.sign(np.sin(1.1 * t + k))
        Cm = 0.02 - 0.5 * alpha - 1.5 * de + 0.001 * np.random.default_rng(k).standard_normal(t.size)
        write_recording(Recording(f"m{k}", t, {"alpha": alpha, "de": de, "Cm": Cm}), tmp_path / f"flights/m{k}.csv")
    return tmp_path / "flights"


def used(*arguments):
    """Number of samples of a selection from these files, and what is said."""
    printed = run("select", *arguments, *SELECT)
    return json.loads(printed.stdout)["responses"]["Cm"]["n"], printed.stderr


@pytest.mark.parametrize(
    ("given", "count"), [(["flights"], 3), (["flights/m[01].csv"], 2), (["flights/m0.csv", "flights/m2*"], 2)]
)
def test_files_folders_and_patterns_are_read(given, count):
    assert used(*given)[0] == 500 * count


def test_a_pattern_that_nothing_matches_is_refused():
    assert "no file matches 'flights/x*.csv'" in run("select", "flights/x*.csv", *SELECT, code=1).stderr


@pytest.mark.parametrize(
    ("cut", "samples"),
    [
        (["4:8"], 101),  # both ends are samples
        (["rows=100:300"], 200),
        ([":2"], 51),
        (["18:"], 50),
        (["0:4", "8:12"], 202),
    ],
)
def test_parts_of_recordings_are_cut_by_times_and_rows(cut, samples):
    options = [word for part in cut for word in ("--cut", part)]
    found, said = used("flights/m0.csv", *options)
    assert found == samples
    assert f"'m0' is cut into {len(cut)} part" in said


def test_each_command_that_reads_recordings_has_the_option():
    for command in ("describe", "reconstruct", "coefficients", "select", "validate", "simulate", "refine", "diagnose"):
        assert "--cut" in run(command, "--help").stdout, command
    for command in ("export", "inputs", "demo"):
        assert "--cut" not in run(command, "--help").stdout, command


def test_parts_can_be_held_out_by_the_name_of_their_recording():
    printed = run("select", "flights", "--cut", "0:8", "--cut", "8:16", "--held-out", "m2", *SELECT)
    assert json.loads(printed.stdout)["responses"]["Cm"]["n"] == 2 * (201 + 201)


def test_manoeuvres_that_are_found_are_parts_too():
    t = 0.02 * np.arange(6000)
    de = np.where((t > 20) & (t < 22), 0.1, 0.0) + np.where((t > 80) & (t < 82), -0.1, 0.0)
    de += 1e-4 * np.random.default_rng(0).standard_normal(t.size)
    write_recording(Recording("long", t, {"de": de, "Cm": -1.5 * de}), "long.csv")
    listed = json.loads(run("describe", "long.csv", "--cut", "manoeuvres", "--json").stdout)["recordings"]
    assert [one["name"] for one in listed] == ["long_m01", "long_m02"]


@pytest.mark.parametrize("text", ["4", "a:b", ":", "rows=1.5:3", "manoeuvre"])
def test_a_part_that_cannot_be_read_is_refused_with_the_forms(text):
    assert "START:END" in run("select", "flights", "--cut", text, *SELECT, code=2).stderr


def test_a_part_without_samples_is_refused():
    assert "runs from 0 to 19.96 s" in run("select", "flights", "--cut", "30:40", *SELECT, code=1).stderr
    assert "has 500" in run("select", "flights", "--cut", "rows=600:700", *SELECT, code=1).stderr


# --- diagnose ------------------------------------------------------------------------------------------


def consistent(*deviations):
    return Diagnosis("consistent", (), {}, {}, deviations, (), "forced", ("y",), ("m0",))


@pytest.mark.parametrize(("sigmas", "code"), [(1.0, 0), (-6.0, 3)])
def test_exit_code_and_json_tell_whether_a_consistent_simulation_is_within_its_tolerances(sigmas, code, monkeypatch):
    found = consistent(ToleranceDeviation("main Cm:alpha", sigmas, 1.0, 0.05, "-"))
    monkeypatch.setattr(diagnose_command, "_diagnose", lambda *given: found)
    said = run("diagnose", "--recordings", "flights", "--simulation", "flights", "--json", code=code)
    assert json.loads(said.stdout)["within_tolerances"] is (code == 0)


def test_recordings_are_several_files_and_a_plant_needs_no_aircraft(monkeypatch):
    asked = {}

    def note(simulation, recorded, aircraft, validation):
        asked.update(names=[one.name for one in recorded], aircraft=aircraft)
        return consistent()

    monkeypatch.setattr(diagnose_command, "_diagnose", note)
    run("diagnose", "--simulation", "s", "--recordings", "flights/m0.csv", "flights/m1.csv", "--json")
    assert asked == {"names": ["m0", "m1"], "aircraft": None}


def test_recordings_of_an_aircraft_need_its_file(tmp_path):
    recordings, _, _ = demo_flights(1, duration=4.0)
    write_recording(recordings[0], tmp_path / "real.csv")
    said = run("diagnose", "--recordings", "real.csv", "--simulation", "flights", code=1).stderr
    assert "it is of an aircraft" in said
    assert "structsel aircraft --template" in said


# --- files to fill in ----------------------------------------------------------------------------------


def test_the_template_is_an_aircraft_as_it_stands_and_with_every_line_in_use(tmp_path):
    printed = run("aircraft", "--template").stdout
    assert printed == TEMPLATE
    complete = "\n".join(
        line.removeprefix("# ") if "=" in line or "[" in line else line for line in printed.split("\n")
    )
    for text in (printed, complete):
        (tmp_path / "aircraft.toml").write_text(text)
        aircraft = Aircraft.from_toml(tmp_path / "aircraft.toml")
        assert aircraft.remarks == ()
        assert "my aircraft" in run("aircraft", "aircraft.toml").stdout
    tables = tomllib.loads(complete)
    assert set(tables) == {"V0", *(set(Aircraft.model_fields) - {"schema_name"}), "schema"}
    for name in ("inertia", "thrust", "tolerances", "engine", "simulation"):
        assert set(tables[name]) == set(type(getattr(aircraft, name)).model_fields), name


def test_a_template_is_written_to_a_new_file_only(tmp_path):
    run("aircraft", "--template", "--out", "mine.toml")
    assert (tmp_path / "mine.toml").read_text() == TEMPLATE
    assert "exists already" in run("aircraft", "--template", "--out", "mine.toml", code=1).stderr
    assert "--template" in run("aircraft", code=2).stderr


def test_a_guessed_map_is_written_with_comments_and_reads_the_file(tmp_path):
    (tmp_path / "raw.csv").write_text(
        "Time,AoA_deg,Elev_deg\n" + "".join(f"{0.1 * k},{k % 7},{-k % 5}\n" for k in range(50))
    )
    run("map", "raw.csv", "--out", "my.toml")
    text = (tmp_path / "my.toml").read_text()
    assert "#" in text
    recording = read_recording("raw.csv", "my.toml")
    np.testing.assert_allclose(recording["alpha"], np.deg2rad([k % 7 for k in range(50)]))
    assert "exists already" in run("map", "raw.csv", "--out", "my.toml", code=1).stderr


# --- what is left out -----------------------------------------------------------------------------------


def test_an_input_that_no_term_uses_is_reported(tmp_path):
    t = 0.02 * np.arange(100)
    inputs = Recording("in", t, {"de": 0.01 * np.sin(t), "aux": 0.0 * t})
    write_recording(inputs, tmp_path / "in.csv")
    said = run("simulate", "builtin:beaver", "--trim", "45,600", "--inputs", "in.csv", "--no-plots").stderr
    assert "'in': aux left out; no term of the model depends on it" in said


def test_a_replay_of_a_model_without_axial_force_says_so(tmp_path):
    recordings, aircraft, _ = demo_flights(1, duration=4.0)
    write_recording(recordings[0], tmp_path / "m.csv")
    aircraft.to_toml(tmp_path / "a.toml")
    AeroModel.from_terms({"CZ": {"1": -0.3, "alpha": -4.0}, "Cm": {"alpha": -0.5, "de": -1.0}}).to_json("m.json")
    said = run("validate", "m.json", "m.csv", "--aircraft", "a.toml", "--replay")
    assert "The model has no CX: its motion is computed with zero axial force" in " ".join(said.stdout.split())
