"""Parameters far beyond their tolerance beside an effect that was found."""

import pytest

from structsel.aircraft import Aircraft
from structsel.demo.aircraft import TRUTH
from structsel.diagnosis.assembling import make_findings
from structsel.diagnosis.material import find_material
from structsel.diagnosis.ranking import rank
from tests.noisy_flights import AIRCRAFT, fly, ready, tried

LACKED = {"Cl": {"da^3": -20.0}}


def found(flights):
    """Findings where control-nonlinearity is the only effect that may be named, and the parameter beside it."""
    ranking = rank(*tried(flights, "control-nonlinearity"))
    before = make_findings(ranking, lambda axes: {})
    assert [f.effect for f in before] == ["control-nonlinearity"]
    return find_material(ranking, before)


def test_a_wrong_derivative_beside_an_effect_is_found_with_its_size():
    wrong = {"Cm": {"de": 0.6 * TRUTH["Cm"]["de"]}}
    findings = found(ready(*fly({**LACKED, **wrong})))
    (other,) = [f for f in findings if f.effect != "control-nonlinearity"]
    assert (other.effect, other.axes[0], other.kind) == ("wrong-derivative", "Cm", "parameter")
    (estimate,) = other.physics[0].parameters.values()
    assert estimate.value == pytest.approx(-0.4, abs=0.04)
    assert 0.5 < other.physics[0].probability <= other.probability <= 0.99
    bars = other.bars["Cm"]
    assert bars.physics.rrmse < 0.5 * bars.refitted.rrmse


def test_a_mass_that_is_not_the_stated_one_is_found_after_what_is_more_probable():
    light = AIRCRAFT.to_dict() | {"mass": 0.7 * AIRCRAFT.mass}
    recordings, stated = fly(LACKED)
    first, second = found(ready(recordings, stated, Aircraft.from_dict(light)))
    assert first.physics[0].probability > second.physics[0].probability
    assert (second.effect, second.kind) == ("mass-error", "parameter")
    assert "CZ" in second.axes


def test_parameters_within_their_tolerances_add_nothing():
    assert len(found(ready(*fly(LACKED)))) == 1
