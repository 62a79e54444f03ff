"""comparison() and effects left out: the results that another ranking method, and the proof, need of the diagnosis."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import structsel as ss
from structsel.demo import demo_missing_physics
from structsel.diagnosis import comparison, diagnose
from structsel.effects import EFFECTS
from structsel.errors import DataError

GROUND = [h for h in EFFECTS if h.name in ("ground-effect", "drag-polar")]


@pytest.fixture(scope="module")
def case():
    return demo_missing_physics("ground-effect", flights=3)


@pytest.fixture(scope="module")
def compared(case):
    return comparison(case.simulated, case.recordings, case.aircraft, effects=GROUND)


def test_differences_are_measured_less_simulated_coefficients(case, compared):
    assert compared.parts == ("m01", "m02", "m03")
    recorded = {r.name: r for r in ss.compute_all(case.recordings, case.aircraft)}
    for name, found in compared.differences.items():
        expected = recorded[name]["CZ"] - case.simulated[name]["CZ"]
        assert_allclose(found["CZ"].mean(), expected.mean(), atol=2e-3)
        if name != "m02":  # at altitude there is noise only, which the comparison weights differently
            assert np.corrcoef(found["CZ"], expected)[0, 1] > 0.5


def test_the_signature_of_the_effect_explains_the_differences(compared):
    assert {s.effect for s in compared.signatures} == {"ground-effect", "drag-polar"}

    def left(signature):
        y = np.concatenate([p["CZ"][1:] for p in compared.transformed])
        X = np.vstack([c["CZ"][1:] if "CZ" in c else np.zeros((len(p["CZ"]) - 1, len(signature.parameters)))
                       for c, p in zip(signature.columns, compared.transformed)])  # fmt: skip
        return np.sum((y - X @ np.linalg.lstsq(X, y, rcond=None)[0]) ** 2) / np.sum(y**2)

    best = min(compared.signatures, key=left)
    assert best.effect == "ground-effect"
    assert left(best) < 0.2


def test_the_evidence_rises_without_the_added_effect_and_not_without_another_effect(case, compared):
    def near(name):
        flight = next(r for r in case.recordings if r.name == name)
        fade = np.exp(-4.0 * flight["h_agl"] / case.aircraft.b)
        added = case.terms["CZ"]
        return flight.t, added["near"] * fade + added["near*alpha"] * fade * flight["alpha"]

    truth = {name: {"CZ": near(name)} for name in compared.parts}
    assert compared.log_bayes_factor(truth) > 30.0
    wrong = {name: {"CZ": (t, -x)} for name, held in truth.items() for t, x in held.values()}
    assert compared.log_bayes_factor(wrong) < 0.0
    assert compared.log_bayes_factor({}) == 0.0
    with pytest.raises(DataError, match="recording 'm09', which is not compared"):
        compared.log_bayes_factor({"m09": {}})
    with pytest.raises(DataError, match="response 'CL', which is not compared"):
        compared.log_bayes_factor({"m01": {"CL": truth["m01"]["CZ"]}})
    # A wrong reading changes kinematic residuals too; its contribution to the coefficients is judged by these alone.
    assert compared.log_bayes_factor(truth, ["CX", "CZ", "Cm"]) > 30.0
    with pytest.raises(DataError, match="response 'CZ', which is not compared"):
        compared.log_bayes_factor(truth, ["Cm"])
    # What another effect adds is subtracted first: with half of the truth known, the rest has less evidence than all.
    half = {name: {"CZ": (t, 0.5 * x)} for name, held in truth.items() for t, x in held.values()}
    assert 0.0 < compared.log_bayes_factor(half, known=half) < compared.log_bayes_factor(truth)
    assert compared.log_bayes_factor({}, known=truth) == 0.0
    with pytest.raises(DataError, match="recording 'm09', which is not compared"):
        compared.log_bayes_factor(truth, known={"m09": {}})


def test_an_effect_that_is_left_out_is_not_named(case):
    found = diagnose(case.simulated, case.recordings, case.aircraft, effects=GROUND, without_effects=["ground-effect"])
    assert all(f.effect != "ground-effect" for f in found.findings)
    assert "ground-effect" not in found.not_testable
    compared = comparison(
        case.simulated, case.recordings, case.aircraft, effects=GROUND, without_effects=["ground-effect"]
    )
    assert {s.effect for s in compared.signatures} <= {"drag-polar"}
    assert set(compared.not_testable) <= {"drag-polar"}
    with pytest.raises(DataError, match=r"no effect 'ground-efect' to leave out\. Did you mean 'ground-effect'"):
        diagnose(case.simulated, case.recordings, case.aircraft, without_effects=["ground-efect"])
