"""diagnose() on the demonstration of missing physics, and on the published examples."""

import json
from pathlib import Path

import numpy as np
import pytest

import structsel as ss
from structsel.demo import demo_missing_physics
from structsel.diagnosis import diagnose
from structsel.diagnosis.diagnose import exceeded_notes
from structsel.diagnosis.result import ToleranceDeviation
from structsel.effects import EFFECTS
from structsel.errors import DataError

EXAMPLES = Path(__file__).parents[2] / "shared" / "data" / "diagnose-examples"
needs_examples = pytest.mark.skipif(not EXAMPLES.exists(), reason="../shared/data is not here")


def run(case, **options):
    return diagnose(case.simulated, case.recordings, case.aircraft, **options)


@pytest.fixture(scope="module")
def ground():
    case = demo_missing_physics("ground-effect", flights=3)
    return case, run(case)


def test_a_missing_ground_effect_is_named_located_and_brings_a_gain(ground):
    case, found = ground
    first = found.findings[0]
    assert found.verdict == "mismatch"
    assert first.effect == "ground-effect"
    assert first.physics[0].probability > 0.8
    assert set(first.axes) & set(case.terms)
    bars = first.bars[first.axes[0]]
    assert bars.physics.rrmse < 0.8 * bars.refitted.rrmse <= 0.8 * 1.02 * bars.delivered.rrmse


def test_what_is_written_follows_the_contract(ground):
    _, found = ground
    stated = json.loads(json.dumps(found.to_dict()))
    assert stated["schema"] == "structsel.diagnosis/2"
    assert {"verdict", "within_tolerances", "findings", "not_testable", "remaining"} <= set(stated)
    finding = stated["findings"][0]
    assert finding["probability"] == pytest.approx(sum(p["probability"] for p in finding["physics"]), abs=1e-3)
    assert {"probability", "axes", "kind", "where", "physics", "ambiguous_with", "to_separate", "fit"} <= set(finding)
    assert {"effect", "probability", "says", "parameters", "terms"} <= set(finding["physics"][0])
    assert {"held_out", "explainable", "explained"} <= set(finding["fit"])
    assert all({"effect", "needs"} <= set(one) for one in stated["not_testable"])


def test_the_corrected_model_can_be_evaluated_along_the_flights(ground):
    case, found = ground
    assert set(found.model) == set(found.responses)
    recorded = ss.compute_all(case.recordings, case.aircraft)
    corrected, measured, simulated = (
        np.concatenate([source(r) for r in recorded])
        for source in (found.model["CZ"].evaluate, lambda r: r["CZ"], lambda r: case.simulated[r.name]["CZ"])
    )
    # Most of the missing effect is in the model: what is left is noise of the recorded states.
    assert np.std(corrected - measured) < 0.5 * np.std(simulated - measured)


@pytest.mark.slow
def test_recordings_held_out_by_name_judge_alone(ground):
    case, _ = ground
    name = case.recordings[-1].name
    found = run(case, held_out=[name], effects=[h for h in EFFECTS if h.name == "ground-effect"])
    assert found.held_out == (name,)
    with pytest.raises(DataError, match="'m99' is not there"):
        run(case, held_out=["m99"])
    with pytest.raises(DataError, match="all recordings are held out"):
        run(case, held_out=[r.name for r in case.recordings])


@pytest.mark.slow
def test_nothing_is_named_where_the_simulation_is_right():
    case = demo_missing_physics("", flights=3)
    found = run(case)
    assert found.verdict == "consistent"
    assert not [f for f in found.findings if f.kind != "random"]


@pytest.mark.slow
def test_half_of_what_tolerances_could_explain_counts_in_the_fraction_of_a_finding():
    """A lift slope 30 % too large is three quarters of the error, and all tolerances together would explain it."""
    recordings, aircraft, truth = ss.demo_flights(8, turbulence=0.0)
    truth["CZ"]["alpha"] *= 1.3
    del truth["Cm"]["beta^2"]
    found = diagnose(ss.AeroModel.from_terms(truth), recordings, aircraft)
    fractions = {f.effect: f.fraction for f in found.findings}
    assert set(fractions) == {"wrong-derivative", "cross-coupling"}
    assert 0.25 < fractions["wrong-derivative"] < 0.5


def test_a_parameter_beyond_its_tolerance_is_reported():
    deviations = [
        ToleranceDeviation("V scale", 4.8, 0.036, 0.002, "relative"),
        ToleranceDeviation("mass", -3.9, -0.01, 0.002, "relative"),
    ]
    said = exceeded_notes(deviations)
    assert len(said) == 1
    assert "'V scale' deviates by +4.8" in said[0]
    assert exceeded_notes(deviations[1:]) == []


def test_one_manoeuvre_alone_is_not_decided(ground):
    case, _ = ground
    low = min(case.recordings, key=lambda r: float(np.min(r["h_agl"])))
    found = diagnose({low.name: case.simulated[low.name]}, [low], case.aircraft)
    assert found.verdict in ("undecidable", "consistent")
    assert any("one manoeuvre only" in remark for remark in found.remarks)


@pytest.mark.slow
@needs_examples
@pytest.mark.parametrize(
    ("name", "effect"),
    [("nothing-wrong", None), ("sensor-scale", "sensor-scale"), ("drag-polar-free", "drag-polar")],
)
def test_published_examples(name, effect):  # the fourth, a ground effect, through the command line
    folder = EXAMPLES / name
    found = diagnose(
        folder / "simulated", ss.read_recordings(folder / "recordings"), ss.Aircraft.from_toml(folder / "aircraft.toml")
    )
    assert found.verdict == ("mismatch" if effect else "consistent")
    assert [f.effect for f in found.findings] == ([effect] if effect else [])
