"""Concealed cases flown by JSBSim: what is evaluated is what JSBSim flew, and the keys tell what was done."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

jsbsim = pytest.importorskip("jsbsim", reason="JSBSim is not installed")

from proof.generate import draw_case  # noqa: E402
from proof.jsbsim.added_force import AddedForce  # noqa: E402
from proof.jsbsim.aircraft import JSBSimPlant  # noqa: E402
from proof.jsbsim.effects import effects_of  # noqa: E402
from proof.jsbsim.effects_built_in import find_built_in  # noqa: E402
from proof.jsbsim.flight import LEAD, Additions, Manoeuvre, simulate_manoeuvre  # noqa: E402
from proof.jsbsim.manoeuvres import find_point  # noqa: E402
from proof.jsbsim.prescribed_motion import coefficients, functions_with  # noqa: E402

AXES = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")


def true_coefficients(aircraft, flight):
    """(n, 6) of all forces that JSBSim computed but the declared thrust, added effects included."""
    qS = (flight["qbar"] * aircraft.S)[:, None]
    line = aircraft.thrust
    force = np.column_stack([flight[f"F{c}"] for c in "xyz"]) - flight["thrust"][:, None] * line.direction
    moment = np.column_stack([flight[f"M{c}"] for c in "lmn"]) - flight["thrust"][:, None] * line.arm
    return np.hstack([force / qS, moment / qS / np.array([aircraft.b, aircraft.cbar, aircraft.b])])


@pytest.fixture(scope="module")
def low_pass():
    """Twelve seconds of a Cessna going down to the ground."""
    aircraft = JSBSimPlant("c172p")
    point = find_point(aircraft, np.random.default_rng(3), low=True, lift=(0.5, 0.6))
    t = np.round(np.arange(-LEAD, 12.0, 0.04), 9)
    h = np.interp(t, [1.0, 9.0], [0.0, 3.0 - point.h])
    commands = {
        "h": h, "climb": np.gradient(h, t), "firm": np.full_like(t, 4.0), "dr": 0.03 * ((t > 3) & (t < 4)),
    }  # fmt: skip
    return aircraft, Manoeuvre("m01", "low", t, point.state, point.controls, commands, point.gains)


def test_the_functions_evaluated_over_a_flight_are_those_that_jsbsim_flew(low_pass):
    aircraft, manoeuvre = low_pass
    flight = simulate_manoeuvre(aircraft, manoeuvre, Additions())
    assert flight["h"].min() < 0.6 * aircraft.aircraft.b  # tables of ground effect are in it
    ours = coefficients(aircraft, flight, aircraft.functions)
    theirs = true_coefficients(aircraft.aircraft, flight)
    assert_allclose(ours, theirs, atol=1e-9)


def test_ground_effect_taken_out_of_the_functions_is_what_a_changed_aircraft_flies_without(low_pass):
    # The changed functions written as XML and flown by JSBSim, against the same functions over arrays.
    aircraft, manoeuvre = low_pass
    built_in = next(n for n in find_built_in(aircraft) if n.effect == "ground-effect")
    functions = functions_with(aircraft, built_in.left_in(aircraft, 0.4))
    other = JSBSimPlant("c172p", functions)
    flight = simulate_manoeuvre(other, manoeuvre, Additions())
    assert_allclose(coefficients(other, flight, functions), true_coefficients(other.aircraft, flight), atol=1e-9)
    lacking = coefficients(other, flight, aircraft.functions) - true_coefficients(other.aircraft, flight)
    near = flight["h"] < 0.5 * aircraft.aircraft.b
    assert np.all(lacking[near, 2] < 0.0)  # the ground's lift, up
    assert abs(lacking[0, 2]) < 0.3 * np.abs(lacking[:, 2]).max()


def test_a_law_put_into_the_truth_acts_on_the_aircraft_with_the_coefficients_it_states(low_pass):
    aircraft, manoeuvre = low_pass
    added_force = AddedForce(lambda now, memory, dt: (0.0, 0.002, -0.01, 0.0005, 0.004 * now["alpha"], 0.0))
    flight = simulate_manoeuvre(aircraft, manoeuvre, Additions(added=[added_force]))
    m = aircraft.aircraft.mass
    qS = flight["qbar"] * aircraft.aircraft.S
    acted = true_coefficients(aircraft.aircraft, flight) - coefficients(aircraft, flight, aircraft.functions)
    # The rest of all forces is the added law, held over a step in which the airspeed changes by little.
    assert_allclose(acted[1:, 2], -0.01, atol=1e-5)
    assert_allclose(acted[1:, 4], 0.004 * flight["alpha"][1:], atol=1e-5)
    assert_allclose(flight["Fz"] / m, flight["w_dot"] + flight["p"] * flight["v"] - flight["q"] * flight["u"]
                    - 9.80665 * np.cos(flight["theta"]) * np.cos(flight["phi"]), atol=0.02)  # fmt: skip
    assert np.ptp(qS) > 0.0


@pytest.mark.slow
def test_the_same_seed_gives_the_same_case():
    one, same = (draw_case(4, source="jsbsim", aircraft="pa28", family="null") for _ in range(2))
    assert one.key == same.key
    for a, b in zip(one.recordings, same.recordings):
        assert_array_equal(a["alpha"], b["alpha"])
    # A correct simulation leaves nothing to attain.
    assert one.key.verdicts == ("consistent",)
    assert set(one.key.attainable.values()) == {0.0}
    assert all(e.effect == "turbulence" for e in one.key.effects)


def test_a_case_is_complete_and_its_key_says_what_a_perfect_account_gains():
    case = draw_case(
        2, source="jsbsim", aircraft="global5000", family="single", effect="configuration-change", severity="medium"
    )
    assert len(case.recordings) == 8
    assert set(case.simulated) == {r.name for r in case.recordings}
    for recording in case.recordings:
        assert {"V", "alpha", "beta", "p", "q", "r", "ax", "ay", "az", "de", "da", "dr", "h_agl"} <= set(
            recording.names
        )
        held = case.simulated[recording.name]
        assert len(held["t"]) == len(recording.t)
        assert all(np.isfinite(held[c]).all() for c in held)
    (effect,) = case.key.effects
    assert effect.effect == "configuration-change"
    assert case.key.attainable[effect.axes[0]] == max(case.key.attainable.values()) > 0.05
    assert any(effect.intervals.values())
    assert not all(effect.intervals.values())  # not every manoeuvre shows it
    assert "global" not in case.aircraft.name


def test_every_aircraft_of_the_fleet_has_effects_of_its_own_and_put_in():
    assert "ground-effect" in effects_of(JSBSimPlant("c172p"))
    built_in = {n.effect for n in find_built_in(JSBSimPlant("c172p"))}
    assert {"ground-effect", "drag-polar", "static-stall", "stall-hysteresis", "downwash-lag", "slipstream"} <= built_in
    assert "compressibility" in {n.effect for n in find_built_in(JSBSimPlant("global5000"))}
    assert len(effects_of(JSBSimPlant("c172p"))) > 30
