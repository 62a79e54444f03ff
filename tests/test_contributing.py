"""The recipes of CONTRIBUTING.md work as they are written, in the files that they name."""

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.candidates import Candidates, Term
from structsel.diagnosis import diagnose
from structsel.effects import EFFECTS
from structsel.errors import DataError, MapError
from structsel.metrics import compute_metrics, remove_metric
from structsel.model import Quantity, State
from structsel.readers import READERS
from structsel.readers.channel_map import load_channel_map
from structsel.recording import Recording, read_recording
from structsel.selection import select
from structsel.selection.methods import METHODS
from tests import test_fuzzing
from tests.effect_fits import best, check_all
from tests.flights import fly as simulated_flights
from tests.noisy_flights import AIRCRAFT, T, flights_with, fly
from tests.package_source import ROOT

TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL)
RECIPES = dict(re.findall(r"File\s`([\w/]+\.py)`:\n\n```python\n(.*?)^```$", TEXT, re.MULTILINE | re.DOTALL))
NAMED = re.compile(r"`([\w/]+\.py)`|^```diff\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def edits_of_the_text():
    """Each edit with the file that the text names last before it."""
    path, made = "", []
    for named, edit in NAMED.findall(TEXT):
        path = named or path
        if edit:
            made.append((path, edit))
    return made


EDITS = edits_of_the_text()
WAKE = {"wake": State("delay", "da", {"tau": Quantity(0.14, unit="s")})}
NEW = ("elevator_wash", "aileron_wake", "tail_buffet")


def edited(text, edit):
    """A file's text after an edit: lines with a plus come after the lines before them."""
    lines = [(line[:1], line[1:]) for line in edit.splitlines()]
    before = "".join(f"{line}\n" for sign, line in lines if sign == " ")
    after = "".join(f"{line}\n" for _, line in lines)
    assert text.count(f"\n{before}") == 1, f"not one place for: {before}"
    return text.replace(f"\n{before}", f"\n{after}")


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    """Folder with a copy of the package and the proof, and with every file and edit of the recipes."""
    folder = tmp_path_factory.mktemp("copy")
    for name in ("structsel", "proof"):
        shutil.copytree(ROOT / name, folder / name)  # with what is compiled, which saves seconds
    shutil.copy(ROOT / "pyproject.toml", folder)
    for path, block in RECIPES.items():
        assert not (folder / path).exists(), path
        (folder / path).write_text(block, encoding="utf-8")
    for path, edit in EDITS:
        if path.startswith("structsel/"):
            text = edited((folder / path).read_text(encoding="utf-8"), edit)
            (folder / path).write_text(text, encoding="utf-8")
    return folder


def run(folder, *arguments):
    """Output of Python in a fresh process that finds the copy first."""
    process = subprocess.run(
        [sys.executable, *arguments], cwd=folder, env={**os.environ, "PYTHONPATH": str(folder)}, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert process.returncode == 0, process.stdout + process.stderr
    return process.stdout


def module(folder, path):
    """A recipe's module, by its name in the package, beside the installed package."""
    name = path.removesuffix(".py").replace("/", ".")
    spec = importlib.util.spec_from_file_location(name, folder / path)
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def effect_of(folder, name):
    (effect,) = module(folder, f"structsel/effects/{name}.py").EFFECTS
    return effect


def recipe(title):
    """What the block that begins with this title defines."""
    (block,) = (block for block in BLOCKS if title in block)
    defined = {"__name__": "recipe"}
    exec(block, defined)
    return defined


# --- in the package -------------------------------------------------------------------------------

IMPORTED = """
import json, sys
from pathlib import Path
import structsel
from structsel.effects import EFFECTS
from structsel.recording import read_recording
print(json.dumps([structsel.__file__, [e.name for e in EFFECTS], read_recording(sys.argv[1])["alpha"].tolist()]))
"""


def test_every_recipe_is_imported_in_the_package_by_the_edits_of_the_text(package, tmp_path):
    assert set(RECIPES) == {*(f"structsel/effects/{name}.py" for name in NEW), "structsel/readers/recorder.py"}
    assert [path for path, _ in EDITS].count("structsel/effects/__init__.py") == 6
    text = {"samples": {"t": [0.0, 0.1, 0.2], "alpha": [1.0, 2.0, 3.0]}, "units": {"alpha": "deg"}}
    (tmp_path / "m01.recorder").write_text(json.dumps(text))
    found, names, alpha = json.loads(run(package, "-c", IMPORTED, str(tmp_path / "m01.recorder")))
    assert found.startswith(str(package))
    assert {"aileron-wake", "elevator-wash", "tail-buffet"} <= set(names)
    assert len(names) == len(EFFECTS) + len(NEW)
    assert_allclose(alpha, np.deg2rad([1.0, 2.0, 3.0]))


@pytest.mark.slow
def test_every_recipe_has_types_and_the_style_of_the_package(package):
    run(package, "-m", "mypy", *RECIPES)
    run(package, "-m", "ruff", "check", *RECIPES)
    run(package, "-m", "ruff", "format", "--check", *RECIPES)


@pytest.mark.slow
@pytest.mark.parametrize("name", NEW)
def test_a_case_of_the_proof_is_drawn_in_the_package(name, package):
    effect = name.replace("_", "-")
    draw = f"from proof.generate import draw_case; print(draw_case(3, effect={effect!r}).key.effects[0].effect)"
    assert run(package, "-c", draw).strip() == effect


@pytest.mark.slow
@pytest.mark.parametrize("name", NEW)
def test_the_case_of_a_recipe_is_no_copy_of_its_effect(name, package):
    from tests.proof.independence import copied_terms

    thrust = 1500.0 + 1200.0 * np.sin(2.0 * np.pi * T / 10.0)
    assert copied_terms(effect_of(package, name), flights_with({}, thrust=thrust, az_tail=np.sin(9.0 * T))) == []


# --- effects --------------------------------------------------------------------------------------


def test_a_deterministic_effect_is_found_with_its_value(package):
    effect = effect_of(package, "elevator_wash")
    (term,) = effect.variants([])[0].terms
    flights = flights_with({"Cm": {term: -0.8}}, thrust=1500.0 + 1200.0 * np.sin(2.0 * np.pi * T / 10.0))
    _, values, fraction = best(flights, effect, ["Cm"])
    assert fraction > 0.8
    assert_allclose(values["elevator power"], -0.8, rtol=0.1)
    check_all(flights, effect)


def test_an_effect_with_memory_is_found_with_its_value_and_its_place_on_the_grid(package):
    effect = effect_of(package, "aileron_wake")
    flights = flights_with({"Cn": {"wake": 0.03}}, states=WAKE, speeds=(46.0, 46.0))
    form, values, _ = best(flights, effect, ["Cn"])
    assert_allclose(values["yaw per aileron"], 0.03, rtol=0.1)
    lengths = np.array([v.shape["tail length"] for v in effect.variants(flights)])
    assert form.shape["tail length"] == lengths[np.abs(lengths - 0.14 * 46.0).argmin()]
    check_all(flights, effect)


def test_a_recorded_input_that_no_term_uses_is_kept_in_the_flights():
    flap = np.clip((T - 5.0) / 3.0, 0.0, 0.2)
    for flight in flights_with({}, df=flap):
        assert "df" in flight
        assert_allclose(flight["df"], flap, atol=0.02)  # smoothed


@pytest.mark.slow
def test_a_new_effect_goes_through_diagnosis_report_and_model(package):
    wash = effect_of(package, "elevator_wash")
    recordings, simulated = fly(
        {"Cm": {wash.variants([])[0].terms[0]: -2.0}},
        speeds=(40.0, 46.0, 52.0),
        h=(1000.0,) * 3,
        thrust=lambda k: 1500.0 + 1200.0 * np.sin(2.0 * np.pi * T / (8.0 + k)),
    )
    simulation = {r.name: Recording(r.name, r.t, dict(one)) for r, one in zip(recordings, simulated)}
    others = [one for one in EFFECTS if one.name in ("wrong-derivative", "cg-shift", "sensor-scale")]
    found = diagnose(simulation, recordings, AIRCRAFT, effects=(*others, wash))
    assert found.findings[0].effect == "elevator-wash"
    assert "Propeller wash increases the elevator power: -2" in str(found)
    assert found.to_dict()["findings"][0]["physics"][0]["effect"] == "elevator-wash"
    (term,) = [t for t in found.model["Cm"].terms if "sqrt" in str(t)]
    assert_allclose(found.model["Cm"].values[found.model["Cm"].terms.index(term)], -2.0, rtol=0.02)


@pytest.mark.slow
def test_an_effect_with_memory_becomes_a_state_of_the_model(package):
    wake = effect_of(package, "aileron_wake")
    recordings, simulated = fly({"Cn": {"wake": 0.03}}, states=WAKE, speeds=(44.0, 46.0, 48.0), h=(1000.0,) * 3)
    simulation = {r.name: Recording(r.name, r.t, dict(one)) for r, one in zip(recordings, simulated)}
    others = [one for one in EFFECTS if one.name in ("wrong-derivative", "cg-shift", "sensor-scale")]
    found = diagnose(simulation, recordings, AIRCRAFT, effects=(*others, wake))
    assert found.findings[0].effect == "aileron-wake"
    assert found.model.states["da_wake"].kind == "delay"
    assert_allclose(found.model["Cn"].values[found.model["Cn"].terms.index(Term("da_wake"))], 0.03, rtol=0.1)


def test_a_random_effect_needs_the_channel_that_records_its_cause(package):
    effect = effect_of(package, "tail_buffet")
    assert effect.needs(flights_with({})) == "channel az_tail"
    shaken = flights_with({}, az_tail=np.sin(9.0 * T))
    assert effect.needs(shaken) == ""
    check_all(shaken, effect)


# --- a reader -------------------------------------------------------------------------------------


@pytest.fixture
def recorder(package, monkeypatch):
    monkeypatch.setitem(READERS, ".recorder", module(package, "structsel/readers/recorder.py").read_recorder)


def test_a_reader_gives_units_and_numbers_of_its_file(recorder, tmp_path):
    path, by_number = tmp_path / "m01.recorder", tmp_path / "map.toml"
    path.write_text(json.dumps({"samples": {"t": [0.0, 0.1, 0.2], "AoA": [1.0, 2.0, 3.0]}, "units": {"AoA": "deg"}}))
    by_number.write_text("[channels]\nt = 1\nalpha = 2\n")
    assert_allclose(read_recording(path, load_channel_map(by_number))["alpha"], np.deg2rad([1.0, 2.0, 3.0]))
    by_number.write_text("[channels]\nt = 1\nalpha = 3\n")
    with pytest.raises(MapError, match="which has 2"):
        read_recording(path, load_channel_map(by_number))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[1, 2]", "is no recorder file that can be read"),
        ("5", "is no recorder file that can be read"),
        ('{"sample": {}}', "is no recorder file that can be read"),
        ("[" * 100_000, "is no recorder file that can be read"),
        ('{"samples": [1, 2]}', "holds list where columns by name are needed"),
        ('{"samples": {"t": [0, 1]}, "units": "deg"}', "holds str where units by name are needed"),
        ('{"samples": {"t": [[0, 1], [2]]}}', "'t': rows of different lengths"),
        ('{"samples": {"t": ["0", "1"]}}', "'t': text or objects"),
        ('{"samples": {"t": ' + "[" * 80 + "]" * 80 + "}}", "has no columns of numbers"),
    ],
    ids=["list", "number", "no samples", "deep", "samples", "units", "ragged", "text", "dimensions"],
)
def test_a_damaged_file_of_a_recipe_is_refused(text, says, recorder, tmp_path):
    (tmp_path / "m01.recorder").write_text(text)
    with pytest.raises(DataError, match=says):
        read_recording(tmp_path / "m01.recorder")


@pytest.mark.slow
def test_the_lines_for_the_damaged_files_do_what_the_text_says(recorder, tmp_path):
    ((_, edit),) = ((path, edit) for path, edit in EDITS if path == "tests/test_fuzzing.py")
    assert '(".recorder", _recorder, 12),' in edited((ROOT / "tests/test_fuzzing.py").read_text(), edit)
    (block,) = (block for block in BLOCKS if "def _recorder" in block)
    defined = vars(test_fuzzing).copy()
    exec(block, defined)
    defined["_recorder"](tmp_path / "intact.recorder")
    assert_allclose(read_recording(tmp_path / "intact.recorder")["V"], test_fuzzing.CHANNELS["V"])
    test_fuzzing.fuzz(tmp_path / "damaged.recorder", (tmp_path / "intact.recorder").read_bytes(), read_recording, 100)


# --- metrics and methods --------------------------------------------------------------------------


def test_a_metric_is_computed_with_the_others():
    recipe("def largest_error")
    try:
        assert compute_metrics(np.array([1.0, 2.0, 4.0]), np.array([1.0, 2.0, 3.0]))["largest_error"] == 1.0
    finally:
        remove_metric("largest_error")


def test_a_selection_method_is_an_option_of_select():
    recipe("Single best term")
    try:
        (recording,) = simulated_flights({"1": -0.3, "alpha": -4.0}, 0.03)
        selection = select(recording, "CZ", Candidates(["alpha", "q_hat", "de"]), method="single", bootstrap=0)
        assert list(map(str, selection.terms)) == ["alpha"]
    finally:
        del METHODS["single"]
