"""Effects that depend on the flight condition: simulated in the truth, found in the difference."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.demo.aircraft import TRUTH
from structsel.effects.signals import mean_slope
from tests.effect_fits import best, check_all, effect_named, explain
from tests.noisy_flights import excite, flights_with, fly, ready

STALL, GROUND, POLAR, ASYMMETRY = (
    effect_named(e) for e in ("static-stall", "ground-effect", "drag-polar", "asymmetry")
)
MACH, REYNOLDS = (effect_named(e) for e in ("compressibility", "reynolds"))


def pull_up(t, k):
    made = excite(t, k)
    return {**made, "de": made["de"] - 0.10 * np.clip((t - 2.0) / 6.0, 0.0, 1.0) * (t < 9.0)}


def small(t, k):
    return excite(t, k, 0.02, 0.03, 0.03)


def test_a_wing_that_separates_is_found_at_its_angle():
    definitions = {
        "gone": "0.5 + 0.5*tanh(40*(alpha - 0.19))",
        "lost": "0.8*5.5*alpha*(1 - ((1 + sqrt(1 - gone))/2)^2)",
        "drag": "0.06*gone",
    }
    extra = {
        "CZ": {"lost*cos(alpha)": 1.0, "drag*sin(alpha)": -1.0},
        "CX": {"lost*sin(alpha)": -1.0, "drag*cos(alpha)": -1.0},
        "Cm": {"gone": -0.05},
    }
    flights = flights_with(extra, inputs=pull_up, definitions=definitions)
    assert STALL.needs(flights) == ""
    variant, theta, fraction = best(flights, STALL, ["CZ", "CX", "Cm"])
    assert variant.about == "separation"
    assert_allclose(variant.shape["stall angle"], 0.19, atol=0.015)
    assert fraction > 0.95
    assert_allclose([theta["drag"], theta["pitching moment"]], [0.06, -0.05], rtol=0.1)
    assert_allclose(theta["lift loss"], 0.8, rtol=0.1)
    check_all(flights, STALL)


def test_a_kink_of_one_coefficient_needs_no_other():
    flights = flights_with({"Cm": {"abs(alpha - 0.15)": -0.3, "alpha": -0.6028 - 0.3}}, speeds=(42.0, 46.0))
    _, theta, fraction = best(flights, STALL, ["Cm"])
    assert fraction > 0.9
    # abs(x) + x = 2 max(x, 0)
    kinks = [explain(flights, v, ["Cm"]) for v in STALL.variants(flights) if v.about == "a kink in Cm only"]
    _, theta, fraction = max(kinks, key=lambda one: one.explained)
    assert fraction > 0.9
    assert_allclose(theta["Cm kink"], -0.6, rtol=0.15)


def test_ground_effect_is_found_with_its_decay():
    extra = {"CZ": {"near*alpha": -0.8}, "Cm": {"near": -0.02}}
    recordings, stated = fly(extra, definitions={"near": "exp(-3*(h - 984)/14.63)"}, h=(995.0, 993.0))
    flights = ready([r.with_channels(h_agl=r["h"] - 984.0) for r in recordings], stated)
    assert GROUND.needs(flights) == ""
    near = next(v for v in GROUND.variants(flights) if v.shape.get("decay") == 3.0 and "with lift" in v.about)
    _, theta, fraction = explain(flights, near, ["CZ"])
    assert fraction > 0.6
    # CL is nearly 5.6 alpha here, so 0.8 alpha is a seventh of it.
    assert_allclose(theta["lift"], 0.8 / 5.6, rtol=0.1)
    _, theta, _ = explain(flights, near, ["Cm"])
    assert_allclose(theta["pitching moment"], -0.02, rtol=0.25)
    check_all(flights, GROUND)
    away = [replace(f, channels={**f.channels, "h_agl": f["h"]}) for f in flights]
    assert GROUND.needs(away) == "height below one span (14.6 m)"
    blind = [replace(f, recorded=f.recorded - {"h_agl"}) for f in flights]
    assert GROUND.needs(blind) == "channel h_agl"


@pytest.mark.parametrize(("term", "value", "found"), [("(0.1 + 5.1*alpha)^2", -0.03, 0.03), ("alpha^2", -0.8, 0.8)])
def test_drag_due_to_lift_is_found(term, value, found):
    base = 5.459 if term == "alpha^2" else 0.0
    flights = flights_with({"CX": {term: base + value}}, inputs=pull_up)
    wanted = [v for v in POLAR.variants(flights) if v.about == ("alpha^2" if base else "CL^2")]
    _, theta, fraction = explain(flights, wanted[0], ["CX"])
    assert fraction > 0.97
    assert_allclose(theta["drag"], found, rtol=0.06)
    check_all(flights, POLAR)


def test_slopes_that_grow_with_mach_are_found():
    extra = {
        "CZ": {"glauert*alpha": -5.578},
        "Cm": {"glauert*alpha": -0.6028, "glauert*de": -1.921, "glauert*q_hat": -31.12},
    }
    flights = flights_with(
        extra, definitions={"glauert": "1/sqrt(1 - mach^2) - 1"}, speeds=(90.0, 130.0), h=(3000.0, 7000.0), inputs=small
    )
    assert MACH.needs(flights) == ""
    complete = next(v for v in MACH.variants(flights) if v.about == "all slopes; right at rest")
    for response in ("CZ", "Cm"):
        _, theta, fraction = explain(flights, complete, [response])
        # A slope of the stand-in is that of the curved lift at the middle of the flight, and it has q and de besides.
        assert_allclose(theta["slope growth"], 1.0, rtol=0.15)
        assert fraction > 0.3
    check_all(flights, MACH)


def test_controls_that_lose_effect_with_mach_each_by_its_own_ratio_are_found_together():
    ratios, mean = {("Cm", "de"): -0.6, ("Cl", "da"): -1.0}, 0.345
    extra = {
        r: {f"mach*{c}": fraction * TRUTH[r][c], c: (1.0 - mean * fraction) * TRUTH[r][c]}
        for (r, c), fraction in ratios.items()
    }
    flights = flights_with(extra, speeds=(90.0, 130.0), h=(3000.0, 7000.0), inputs=small)
    each = next(v for v in MACH.variants(flights) if v.about.startswith("each slope by its own, in proportion to Mach"))
    _, theta, fraction = explain(flights, each, ["Cm", "Cl"])
    assert fraction > 0.9
    for place, ratio in ratios.items():  # of the mean slope
        found = theta[f"{place[1]} growth"] * mean_slope(flights, *place)
        assert_allclose(found, ratio * TRUTH[place[0]][place[1]], rtol=0.1)


def test_a_drag_rise_starts_at_its_mach_number():
    flights = flights_with(
        {"CX": {"rise^2": -1.5}},
        definitions={"rise": "(abs(mach - 0.41) + mach - 0.41)/2"},
        speeds=(130.0, 150.0),
        h=(4000.0, 6000.0),
        inputs=lambda t, k: excite(t, k, 0.04, 0.03, 0.03),
    )
    variants = [v for v in MACH.variants(flights) if v.about == "power 2"]
    near = min(variants, key=lambda v: abs(v.shape["drag rise from Mach"] - 0.41))
    _, theta, _ = explain(flights, near, ["CX"])
    assert_allclose(theta["drag rise"], 1.5, rtol=0.5)


def test_drag_that_falls_with_reynolds_number_is_found():
    flights = flights_with({"CX": {"log(rho*V)": 0.03}}, speeds=(45.0, 52.0), h=(500.0, 1500.0), inputs=pull_up)
    assert REYNOLDS.needs(flights) == ""
    drag = next(v for v in REYNOLDS.variants(flights) if v.about == "drag")
    _, theta, fraction = explain(flights, drag, ["CX"])
    assert fraction > 0.8
    assert_allclose(theta["drag per ln Re"], -0.03, rtol=0.1)
    check_all(flights, REYNOLDS)


def test_a_simulation_correct_at_another_reynolds_number_has_an_offset_too():
    flights = flights_with({"CX": {"log(rho*V/20)": 0.005}}, speeds=(45.0, 52.0), h=(500.0, 1500.0), inputs=pull_up)
    variant = next(v for v in REYNOLDS.variants(flights) if "another" in v.about)
    X = np.vstack([variant.columns(f)["CX"] for f in flights])
    y = np.concatenate([f.difference["CX"] for f in flights])
    found, *_ = np.linalg.lstsq(X, y, rcond=None)
    assert_allclose(found, [-0.005, -0.005 * np.log(np.mean([f["rho"] * f["V"] for f in flights]) / 20.0)], rtol=0.1)


def test_conditions_that_flights_do_not_cover_are_reported():
    flights = flights_with({}, speeds=(70.0,), inputs=lambda t, k: excite(t, k, 0.02, 0.03, 0.03))
    assert STALL.needs(flights) == "angle of attack above 0.1 rad"
    assert MACH.needs(flights) == "Mach numbers above 0.25"
    assert REYNOLDS.needs(flights) == "Reynolds numbers that differ by 15 % or more"
    assert POLAR.needs(flights) == ""
    check_all(flights, ASYMMETRY)
