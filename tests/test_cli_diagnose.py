"""The command: what it reads, prints, writes and refuses."""

import hashlib
import json
import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pandas as pd
import pytest

from structsel import AeroModel
from structsel.errors import DataError
from tests.commands import run
from tests.diagnoses import diagnosis, model

EXAMPLES = Path(__file__).parents[2] / "shared" / "data" / "diagnose-examples"
AIRCRAFT = 'name = "testbed"\nmass = 850.0\nS = 16.0\nb = 11.0\ncbar = 1.5\n[tolerances]\nmain = 0.01\n'


def run_diagnose(*arguments, code=0):
    return run("diagnose", *arguments, code=code)


@pytest.fixture
def case(tmp_path):
    """A case folder: two recordings, their simulation, the aircraft."""
    for folder in ("recordings", "simulated"):
        (tmp_path / folder).mkdir()
    for name in ("m01", "m02"):
        t = np.arange(0.0, 4.0, 0.04)
        pd.DataFrame({"t": t, "alpha": 0.1 + 0.02 * np.sin(t), "V": 40.0}).to_csv(
            tmp_path / "recordings" / f"{name}.csv", index=False
        )
        pd.DataFrame({"t": t, "CZ": -0.4 + 0.0 * t}).to_csv(tmp_path / "simulated" / f"{name}.csv", index=False)
    (tmp_path / "aircraft.toml").write_text(AIRCRAFT)
    return tmp_path


@pytest.fixture
def asked(monkeypatch):
    """Replaces the diagnosis by a prepared one, and keeps its arguments."""
    kept = {"answer": diagnosis()}

    def diagnose(simulation, recordings, aircraft, *, held_out=(), progress=None):
        kept.update(simulation=simulation, recordings=list(recordings), aircraft=aircraft, held_out=tuple(held_out))
        if progress is not None:
            progress("ranking", 1, 4)
        if isinstance(kept["answer"], Exception):
            raise kept["answer"]
        return kept["answer"]

    module = ModuleType("structsel.diagnosis.diagnose")
    module.diagnose = diagnose
    monkeypatch.setitem(sys.modules, "structsel.diagnosis.diagnose", module)
    return kept


def given(case, simulation="simulated"):
    where = case / simulation if (case / simulation).exists() else simulation
    return ("--aircraft", case / "aircraft.toml", "--recordings", case / "recordings", "--simulation", where)


# --- what it does -----------------------------------------------------------------------------


def test_the_text_is_printed_and_three_files_are_written(case, asked):
    result = run_diagnose(*given(case), "--out", case / "out")
    text = str(asked["answer"])
    assert result.stdout.startswith(text)
    written = " ".join(result.stdout[len(text) :].split())
    assert written == f"Written to {case / 'out'}: diagnosis.json, model.json, report.html."
    assert result.stderr == ""
    assert sorted(p.name for p in (case / "out").iterdir()) == ["diagnosis.json", "model.json", "report.html"]
    assert json.loads((case / "out" / "diagnosis.json").read_text())["verdict"] == "mismatch"
    assert "ground-effect" in (case / "out" / "report.html").read_text(encoding="utf-8")
    assert set(AeroModel.from_json(case / "out" / "model.json")) == set(model())


def test_arguments_are_passed_as_given(case, asked):
    run_diagnose(*given(case), "--held-out", "m02")
    assert asked["simulation"] == str(case / "simulated")
    assert [r.name for r in asked["recordings"]] == ["m01", "m02"]
    assert asked["held_out"] == ("m02",)
    assert asked["aircraft"].tolerances.main == 0.01


@pytest.mark.parametrize("simulation", ["model.json", "jsbsim:c172p", "python:mysim:coefficients"])
def test_a_simulation_of_any_form_is_passed_on(case, asked, simulation):
    run_diagnose(*given(case, simulation))
    assert asked["simulation"] == simulation


def test_json_is_all_that_is_printed_and_the_same_as_in_the_file(case, asked):
    result = run_diagnose(*given(case), "--json", "--out", case / "out")
    assert json.loads(result.stdout) == json.loads((case / "out" / "diagnosis.json").read_text())
    assert json.loads(result.stdout)["schema"] == "structsel.diagnosis/2"
    assert result.stderr == ""


def test_figures_that_are_not_known_are_null_in_the_json(case, asked):
    asked["answer"] = diagnosis(verdict="consistent", remaining={"CZ": (float("nan"), True)})
    assert json.loads(run_diagnose(*given(case), "--json").stdout)["remaining"]["CZ"]["rrmse"] is None


@pytest.mark.parametrize("verdict", ["mismatch", "consistent", "undecidable"])
def test_every_verdict_ends_well(case, asked, verdict):
    asked["answer"] = diagnosis(verdict=verdict)
    assert run_diagnose(*given(case)).stdout.startswith(verdict.upper())


def test_quiet_prints_nothing_but_writes(case, asked):
    result = run_diagnose(*given(case), "--quiet", "--out", case / "out")
    assert result.output == ""
    assert (case / "out" / "report.html").exists()


def test_quiet_with_nowhere_to_write_prints_the_verdict_alone(case, asked):
    printed = run_diagnose(*given(case), "--quiet").stdout
    assert printed.startswith("MISMATCH")
    assert printed.strip() == str(asked["answer"]).splitlines()[0]


def test_the_files_that_went_in_are_named_with_their_hashes(case, asked):
    run_diagnose(*given(case), "--out", case / "out")
    held = json.loads((case / "out" / "diagnosis.json").read_text())["provenance"]
    files = {Path(one["file"]): one["sha256"] for one in held["inputs"]}
    went_in = [case / "aircraft.toml", *(case / "recordings").iterdir(), *(case / "simulated").iterdir()]
    assert files == {path: hashlib.sha256(path.read_bytes()).hexdigest() for path in went_in}
    assert held["versions"].keys() == {"structsel", "python", "numpy", "scipy"}
    assert json.loads((case / "out" / "model.json").read_text())["provenance"] == held
    page = (case / "out" / "report.html").read_text(encoding="utf-8")
    assert all(digest in page for digest in files.values())


def test_a_channel_map_is_for_the_recordings(case, asked):
    for path in (case / "recordings").iterdir():
        table = pd.read_csv(path)
        table["AoA"] = np.rad2deg(table.pop("alpha"))
        table.to_csv(path, index=False)
    (case / "map.toml").write_text('[channels]\nt = {column = "t"}\nV = {column = "V"}\n'
                                   'alpha = {column = "AoA", unit = "deg"}\n')  # fmt: skip
    run_diagnose(*given(case), "--map", case / "map.toml")
    assert 0.07 < asked["recordings"][0]["alpha"].min() < asked["recordings"][0]["alpha"].max() < 0.13


def test_a_recording_with_a_gap_is_cut_only_for_a_simulation_that_can_be_asked_anywhere(case, asked):
    path = case / "recordings" / "m02.csv"
    table = pd.read_csv(path)
    table.loc[50:, "t"] += 3.0
    table.to_csv(path, index=False)
    run_diagnose(*given(case))
    assert [r.name for r in asked["recordings"]] == ["m01", "m02"]
    run_diagnose(*given(case, "jsbsim:c172p"))
    assert len(asked["recordings"]) == 3


def test_without_a_model_the_text_gives_the_reason_and_an_older_one_is_removed(case, asked):
    run_diagnose(*given(case), "--out", case / "out")
    asked["answer"] = diagnosis(model=None, responses=("thrust",))
    result = run_diagnose(*given(case), "--out", case / "out", "--overwrite")
    assert "thrust is none" in " ".join(result.stdout.split())
    assert "diagnosis.json, report.html." in " ".join(result.stdout.split())
    assert "it is not a result of this diagnosis" in " ".join(result.stderr.split())


def test_the_help_page_holds_the_command_and_fits_80_columns():
    printed = run_diagnose("--help").stdout
    assert "structsel diagnose --aircraft aircraft.toml --recordings recordings/" in printed
    for option in ("--map", "--held-out", "--out", "--overwrite", "--quiet", "--json"):
        assert option in printed
    assert "[tolerances]" in printed
    assert max(map(len, printed.splitlines())) <= 80


# --- what it refuses --------------------------------------------------------------------------


def test_an_error_of_the_data_is_one_clear_sentence_and_nothing_is_written(case, asked):
    asked["answer"] = DataError("the simulation of 'm01' gives CZ = nan at sample 3.")
    result = run_diagnose(*given(case), "--out", case / "out", "--json", code=1)
    assert result.stdout == ""
    assert result.stderr.strip() == "error: the simulation of 'm01' gives CZ = nan at sample 3."
    assert not (case / "out").exists()


def test_a_file_that_cannot_be_written_leaves_none_of_them(case, asked, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("structsel.report.write_report", full)
    result = run_diagnose(*given(case), "--out", case / "out", code=1)
    assert "cannot be written: No space left on device" in result.stderr
    assert [p.name for p in case.iterdir() if "out" in p.name] == []


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("--held-out", "m09"), r"m09.*There are: m01, m02"),
        (("--held-out", "m01,m02"), r"--held-out leaves no recording"),
        (("--recordings", "nowhere"), r"nowhere"),
        (("--aircraft", "nowhere.toml"), r"nowhere\.toml"),
        (("--map", "nowhere.toml"), r"nowhere\.toml"),
    ],
)
def test_what_is_not_there_is_named(case, asked, change, says):
    result = run_diagnose(*given(case), *change, code=1)
    assert re.search(says, " ".join(result.stderr.split()))


def test_files_that_exist_are_kept_unless_stated_otherwise(case, asked):
    (case / "out").mkdir()
    (case / "out" / "notes.txt").write_text("mine")
    assert "pass --overwrite" in run_diagnose(*given(case), "--out", case / "out", code=1).stderr
    run_diagnose(*given(case), "--out", case / "out", "--overwrite")
    assert (case / "out" / "notes.txt").read_text() == "mine"


def test_the_simulation_itself_is_never_overwritten(case, asked):
    model().to_json(case / "model.json")
    before = (case / "model.json").read_text()
    result = run_diagnose(*given(case, "model.json"), "--out", case, "--overwrite", code=1)
    assert "would overwrite the simulation" in result.stderr
    assert (case / "model.json").read_text() == before


# --- the real one -----------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.skipif(not EXAMPLES.exists(), reason="the example cases are not there")
def test_an_example_case_is_diagnosed_end_to_end(tmp_path):
    case, names = EXAMPLES / "ground-effect", ("m01", "m05", "m06", "m08")
    several = [x for name in names for x in ("--recordings", case / "recordings" / f"{name}.csv")]
    where = ("--aircraft", case / "aircraft.toml", *several, "--simulation", case / "simulated")
    result = run_diagnose(*where, "--out", tmp_path / "out")
    held = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    accepted = json.loads((case / "answer.json").read_text())["effects"][0]["accept"]
    assert held["verdict"] == "mismatch"
    assert held["findings"][0]["physics"][0]["effect"] in accepted
    assert result.stdout.startswith("MISMATCH")
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert len(page) < 5_000_000
    assert all(f'"{name}"' in page for name in names)


@pytest.mark.skipif(not EXAMPLES.exists(), reason="the example cases are not there")
@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (lambda folder: (folder / "m02.csv").unlink(), r"no file for m02"),
        (lambda folder: _delayed(folder / "m02.csv"), r"clocks do not match"),
        (lambda folder: _diverge(folder / "m02.csv"), r"diverged"),
    ],
)
def test_a_simulation_that_does_not_fit_the_recordings_ends_with_a_sentence(tmp_path, damage, says):
    case = EXAMPLES / "ground-effect"
    simulated = tmp_path / "simulated"
    simulated.mkdir()
    for name in ("m01", "m02", "m03"):
        (simulated / f"{name}.csv").write_bytes((case / "simulated" / f"{name}.csv").read_bytes())
    damage(simulated)
    several = [x for name in ("m01", "m02", "m03") for x in ("--recordings", case / "recordings" / f"{name}.csv")]
    result = run_diagnose(
        "--aircraft", case / "aircraft.toml", *several, "--simulation", simulated, "--out", tmp_path / "out", code=1
    )
    assert re.search(says, " ".join(result.stderr.split()))
    assert not (tmp_path / "out").exists()


def _delayed(path):
    table = pd.read_csv(path)
    table["t"] += 100.0
    table.to_csv(path, index=False)


def _diverge(path):
    table = pd.read_csv(path)
    table.loc[20:, "CZ"] = np.nan
    table.to_csv(path, index=False)
