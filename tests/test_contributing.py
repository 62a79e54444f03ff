"""The recipes of CONTRIBUTING.md work as they are written."""

import json
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.candidates import Candidates
from structsel.diagnosis import diagnose
from structsel.effects import EFFECTS
from structsel.metrics import compute_metrics, remove_metric
from structsel.readers import READERS
from structsel.recording import Recording, read_recording
from structsel.selection import select
from structsel.selection.methods import METHODS
from tests.effect_fits import best, check_all
from tests.flights import fly as simulated_flights
from tests.noisy_flights import AIRCRAFT, T, flights_with, fly
from tests.package_source import ROOT

BLOCKS = re.findall(r"^```python\n(.*?)^```$", (ROOT / "CONTRIBUTING.md").read_text(), re.MULTILINE | re.DOTALL)


def recipe(title):
    """What the block that begins with this title defines."""
    (block,) = (block for block in BLOCKS if title in block)
    defined = {"__name__": "recipe"}
    exec(block, defined)
    return defined


def test_a_deterministic_effect_is_found_with_its_value():
    wash = recipe("Propeller wash over the elevator")
    thrust = 1500.0 + 1200.0 * np.sin(2.0 * np.pi * T / 10.0)
    extra = {"Cm": {f"de*(sqrt(1 + CT/{wash['DISC']}) - 1)": -0.8}}
    flights = flights_with(extra, thrust=thrust)
    effect = wash["ELEVATOR_WASH"]
    assert effect.needs(flights) == ""
    _, values, fraction = best(flights, effect, ["Cm"])
    assert fraction > 0.8
    assert_allclose(values["elevator power"], -0.8, rtol=0.1)
    check_all(flights, effect)


@pytest.mark.slow
def test_a_new_effect_goes_through_diagnosis_report_and_model():
    wash = recipe("Propeller wash over the elevator")["ELEVATOR_WASH"]
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


def test_a_random_effect_needs_the_channel_that_records_its_cause():
    effect = recipe("Tail buffet")["TAIL_BUFFET"]
    flights = flights_with({})
    assert effect.needs(flights) == "channel az_tail"


def test_a_reader_reads_a_file_of_its_format(tmp_path):
    recipe("Recorder files")
    try:
        (tmp_path / "m01.recorder").write_text(json.dumps({"t": [0.0, 0.1, 0.2], "alpha [deg]": [1.0, 2.0, 3.0]}))
        assert_allclose(read_recording(tmp_path / "m01.recorder")["alpha"], np.deg2rad([1.0, 2.0, 3.0]))
    finally:
        del READERS[".recorder"]


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
        selection = select(recording, "CZ", Candidates(["alpha", "q_hat", "de"]), method="single", bootstrap=0)["CZ"]
        assert list(map(str, selection.terms)) == ["alpha"]
    finally:
        del METHODS["single"]


@pytest.mark.slow
@pytest.mark.parametrize("title", ["Propeller wash over the elevator", "Tail buffet"])
def test_a_case_of_the_proof_can_be_drawn(title, monkeypatch):
    generate = pytest.importorskip("proof.generate")
    from structsel import effects

    (effect,) = recipe(title)["EFFECTS"]
    monkeypatch.setattr(effects, "EFFECTS", (*effects.EFFECTS, effect))
    case = generate.draw_case(3, effect=effect.name)
    assert case.key.effects[0].effect == effect.name
