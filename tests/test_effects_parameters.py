"""Wrong values, missing terms and couplings: simulated in the truth, found in the difference."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.comparison.flight import prepare_flight
from structsel.demo.aircraft import TRUTH
from structsel.effects import parameters
from structsel.recording import Recording
from tests.effect_fits import best, check_all, effect_named, explain
from tests.noisy_flights import AIRCRAFT, excite, flights_with

WRONG, MISSING, ACROSS = (effect_named(e) for e in ("wrong-derivative", "missing-term", "cross-coupling"))


@pytest.fixture(scope="module")
def flights():
    """One thing in each coefficient that the simulation has wrong or has not."""
    return flights_with({
        "Cl": {"beta": TRUTH["Cl"]["beta"] - 0.03},
        "CZ": {"alpha*de": 4.0},
        "CY": {"beta^3": 10.0},
        "Cm": {"p_hat^2": 4.0, "beta*r_hat": 0.0, "beta^2": TRUTH["Cm"]["beta^2"]},
        "Cn": {"alpha*p_hat": -1.5},
    }, inputs=lambda t, k: excite(t, k, 0.04, 0.05, 0.08))  # fmt: skip


@pytest.mark.parametrize(
    ("hypothesis", "response", "about", "value"),
    [
        (WRONG, "Cl", "beta in Cl", -0.03),
        (MISSING, "CZ", "alpha*de in CZ", 4.0),
        (MISSING, "CY", "beta^3 in CY", 10.0),
        (ACROSS, "Cn", "alpha*p_hat in Cn", -1.5),
    ],
)
def test_a_term_that_the_simulation_lacks_is_found_with_its_value(flights, hypothesis, response, about, value):
    variant, theta, fraction = best(flights, hypothesis, [response])
    assert variant.about == about
    assert fraction > 0.7
    assert_allclose(next(iter(theta.values())), value, rtol=0.06)


def test_terms_of_one_family_are_no_coupling_and_those_of_the_other_no_missing_term(flights):
    missing = {v.about for v in MISSING.variants(flights)}
    across = {v.about for v in ACROSS.variants(flights)}
    assert "alpha^2 in CX" in missing
    assert "beta^2 in Cm" in across
    assert "alpha*beta in Cl" in across
    assert not missing & across


def test_a_derivative_the_simulation_has_is_never_a_missing_linear_term(flights):
    wrong = {v.about for v in WRONG.variants(flights)}
    missing = {v.about for v in MISSING.variants(flights)}
    assert {"alpha in CZ", "beta in Cl", "q_hat in Cm"} <= wrong
    assert "beta in CY" not in missing
    assert not wrong & missing


def test_every_variant_has_finite_columns_and_words(flights):
    for hypothesis in parameters.EFFECTS:
        assert hypothesis.needs(flights) == ""
        check_all(flights, hypothesis)


def test_a_power_left_out_of_a_fitted_simulation_is_found_with_the_refitted_slope(flights):
    # The residual of a linear fit to a parabola is the parabola less its own regression line.
    one = flights[0]
    a = one["alpha"]
    bend = 3.0 * (a**2 - np.polyval(np.polyfit(a, a**2, 1), a))
    fitted = [type(one)(**{**vars_of(one), "measured": {**one.measured, "CX": one.simulated["CX"] + bend}})]
    refit = next(v for v in MISSING.variants(fitted) if v.about.startswith("alpha^2 in CX, linear"))
    _, _, fraction = explain(fitted, refit, ["CX"])
    assert fraction > 0.9


def vars_of(flight):
    return {name: getattr(flight, name) for name in flight.__dataclass_fields__}


def test_any_plant_has_its_channels_tried():
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 20.0, 0.02)
    u = np.convolve(rng.standard_normal(len(t)), np.ones(50) / 50.0, "same")
    recording = Recording("tank", t, {"level": 0.5 * u + 0.8 * u**3, "pump": u})
    flights = [prepare_flight(recording, AIRCRAFT, {"level": 0.5 * u})]
    variant, theta, fraction = best(flights, MISSING, ["level"])
    assert variant.about == "pump^3 in level"
    assert fraction > 0.9  # the smoother rounds the pump's corners
    assert_allclose(theta["level: pump^3"], 0.8, rtol=0.05)
    assert ACROSS.needs(flights) != ""
