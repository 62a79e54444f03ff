"""Controls that lose effectiveness, slopes that fall with dynamic pressure: simulated, found in the difference."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.demo.aircraft import TRUTH
from structsel.effects import controls
from structsel.effects.signals import mean_slope
from tests.effect_fits import best, check_all, effect_named, explain
from tests.noisy_flights import excite, flights_with

BENT, LINKAGE, FLEXIBLE = (effect_named(e) for e in ("control-nonlinearity", "control-stretch", "flexibility"))


def large(t, k):
    made = excite(t, k, 0.06, 0.06, 0.04)
    return {**made, "da": made["da"] + 0.10 * np.sin(2.0 * t) * np.sin(0.15 * t)}


@pytest.fixture(scope="module")
def flights():
    """Aileron with d|d|, elevator with d^3, rudder whose effectiveness falls with dynamic pressure."""
    extra = {
        "Cm": {"de^3": 40.0},
        "Cl": {"da*abs(da)": 0.4},
        "Cn": {"qbar*dr": -2e-4 * TRUTH["Cn"]["dr"]},
        "CY": {"qbar*dr": -2e-4 * TRUTH["CY"]["dr"]},
    }
    return flights_with(extra, inputs=large, speeds=(42.0, 56.0))


def test_an_aileron_that_fades_is_found_with_its_loss(flights):
    assert BENT.needs(flights) == ""
    variant, theta, fraction = best(flights, BENT, ["Cl"])
    assert variant.about.startswith("da: d|d|")
    assert fraction > 0.9
    largest = max(np.abs(f["da"]).max() for f in flights)
    assert_allclose(theta["da loss"], 0.4 * largest / 0.105, rtol=0.12)


def test_an_elevator_with_a_cubic_is_found(flights):
    cubic = next(v for v in BENT.variants(flights) if v.about == "de: d^3 in Cm only")
    _, theta, fraction = explain(flights, cubic, ["Cm"])
    assert fraction > 0.9
    largest = max(np.abs(f["de"]).max() for f in flights)
    assert_allclose(theta["de loss"], 40.0 * largest**2 / 1.92, rtol=0.12)


def test_a_cubic_of_a_surface_that_moves_little_is_found():
    """Surfaces of a fast aircraft move by less than 2 deg."""

    def small(t, k):
        return {c: 0.2 * x for c, x in excite(t, k, 0.06, 0.06, 0.04).items()}

    flights = flights_with({"Cl": {"da^3": 300.0}}, inputs=small)
    largest = max(np.abs(f["da"]).max() for f in flights)
    assert largest < 0.02
    variant, values, fraction = best(flights, BENT, ["Cl"])
    assert variant.about.startswith("da: d^3")
    assert fraction > 0.8
    assert_allclose(values["da loss"], 300.0 * largest**2 / 0.105, rtol=0.12)


def test_a_rudder_with_elastic_cables_is_found(flights):
    assert LINKAGE.needs(flights) == ""
    _, theta, fraction = best(flights, LINKAGE, ["Cn", "CY"])
    assert set(theta) == {"dr loss at mean qbar"}
    assert fraction > 0.6
    plain = next(
        v
        for v in LINKAGE.variants(flights)
        if v.parameters[0].name == "dr loss at mean qbar" and v.about == "rigid at rest"
    )
    _, theta, _ = explain(flights, plain, ["Cn"])
    mean = np.concatenate([f["qbar"] for f in flights]).mean()
    assert_allclose(theta["dr loss at mean qbar"], 2e-4 * mean, rtol=0.1)


def test_every_variant_has_finite_columns_and_words(flights):
    for hypothesis in controls.EFFECTS:
        check_all(flights, hypothesis)


def test_slopes_that_fall_with_dynamic_pressure_are_found_in_all_axes():
    slopes = ("alpha", "beta", "p_hat", "q_hat", "r_hat", "de", "da", "dr")
    lost = {
        r: {f"qbar*{c}": -1e-4 * value for c, value in TRUTH[r].items() if c in slopes}
        for r in ("CZ", "Cm", "Cl", "Cn", "CY")
    }
    flights = flights_with(lost, speeds=(45.0, 60.0))
    assert FLEXIBLE.needs(flights) == ""
    complete = next(v for v in FLEXIBLE.variants(flights) if v.about == "all slopes; rigid at rest")
    mean = np.concatenate([f["qbar"] for f in flights]).mean()
    for response in ("CZ", "Cl"):
        _, theta, fraction = explain(flights, complete, [response])
        assert fraction > 0.8
        assert_allclose(theta["loss at mean qbar"], 1e-4 * mean, rtol=0.12)


def test_one_speed_shows_no_loss_with_dynamic_pressure():
    flights = flights_with({}, speeds=(50.0,), inputs=lambda t, k: excite(t, k, 0.01, 0.02, 0.02))
    assert FLEXIBLE.needs(flights) == "dynamic pressure that changes by 20 % or more"
    assert LINKAGE.needs(flights) == FLEXIBLE.needs(flights)
    assert BENT.needs(flights) == ""


def test_slopes_that_fall_each_by_its_own_ratio_are_found_with_all_of_them():
    # The wing bends otherwise than the tail, so that stability may fall or rise.
    ratios = {("CZ", "alpha"): 1e-4, ("Cm", "alpha"): -1.5e-4, ("Cm", "de"): 2e-4, ("Cl", "da"): 1.5e-4}
    lost = {}
    for (r, c), fraction in ratios.items():
        lost.setdefault(r, {})[f"qbar*{c}"] = -fraction * TRUTH[r][c]
    flights = flights_with(lost, speeds=(45.0, 60.0))
    each = next(v for v in FLEXIBLE.variants(flights) if v.about == "each slope by its own; rigid at rest")
    _, theta, fraction = explain(flights, each, ["CZ", "Cm", "Cl"])
    mean = np.concatenate([f["qbar"] for f in flights]).mean()
    assert fraction > 0.95
    names = {("CZ", "alpha"): "lift slope", ("Cm", "alpha"): "stability", ("Cm", "de"): "de", ("Cl", "da"): "da"}
    for place, name in names.items():  # relative to the mean slope, which curvature changes
        found = theta[f"{name} loss at mean qbar"] * mean_slope(flights, *place)
        assert_allclose(found, mean * ratios[place] * TRUTH[place[0]][place[1]], rtol=0.1)
