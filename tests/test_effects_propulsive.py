"""Propulsion beyond its declared thrust along its declared line: simulated, and found in the difference."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.effects.propulsive import EFFECTS
from structsel.recording import Recording
from structsel.simulation import Actuator
from tests.effect_fits import best, effect_named, fit_form
from tests.exact_flights import AIRCRAFT, aerodynamics, compare, fly

WASHED = {
    "CZ": {"CT*de": -0.4}, "Cm": {"CT*de": -1.92, "CT": 0.06},
    "CY": {"CT*dr": 0.116}, "Cl": {"CT*dr": 0.007}, "Cn": {"CT*dr": -0.083},
}  # fmt: skip
ACROSS = {
    "CZ": {"CT*alpha": -1.0}, "CY": {"CT*beta": -1.0},
    "Cm": {"CT*alpha": 2.0 / AIRCRAFT.cbar}, "Cn": {"CT*beta": -2.0 / AIRCRAFT.b},
}  # fmt: skip


def aircraft(**other):
    return AIRCRAFT.model_validate(AIRCRAFT.model_dump() | other)


def test_a_slipstream_over_tail_and_controls_is_found_with_one_power_for_both():
    found = fit_form(compare(fly(aerodynamics(WASHED))), "slipstream", "over tailplane and controls")
    assert found.explained > 0.97
    assert_allclose(found.values["control power per CT"], 1.0, rtol=0.05)
    assert_allclose(found.values["Cm per CT"], 0.06, rtol=0.05)


@pytest.mark.parametrize(
    ("effect", "thrust", "name", "value"),
    [
        ("thrust-line", {"offset": (1.8, 0.0, 0.2)}, "offset down", 0.2),
        ("thrust-line", {"offset": (1.8, 0.3, 0.0)}, "offset right", 0.3),
        ("thrust-line", {"offset": (1.8, 0.0, 0.0), "inclination": 0.04}, "tilt up", 0.04),
    ],
)
def test_a_thrust_line_elsewhere_is_found_with_its_place(effect, thrust, name, value):
    found = best(compare(fly(aircraft=aircraft(thrust=thrust))), effect_named(effect))
    assert list(found.values) == [name]
    assert found.explained > 0.9
    assert_allclose(found.values[name], value, rtol=0.03)


def test_more_thrust_than_stated_is_found_as_a_fraction():
    found = best(compare(fly(true_inputs={"thrust": lambda T: 1.1 * T})), effect_named("thrust-scale"))
    assert found.variant.about == "all of it"
    assert found.explained > 0.98
    assert_allclose(found.values["fraction"], 0.1, rtol=0.02)


def test_thrust_that_comes_delayed_is_found_with_its_lag():
    flights = compare(fly(actuators={"thrust": Actuator(lag=1.0)}, true_inputs={"thrust": lambda T: T}))
    found = best(flights, effect_named("thrust-lag"))
    assert found.explained > 0.98
    assert_allclose(found.values["lag"], 1.0, rtol=0.15)


def test_the_force_across_the_shaft_and_the_p_factor_are_separate_effects():
    found = fit_form(compare(fly(aerodynamics(ACROSS))), "propeller-normal-force", "force across the shaft")
    assert found.explained > 0.97
    assert_allclose([found.values["force per CT"], found.values["moment per CT"]], [1.0, 2.0], rtol=0.05)
    turning = {"Cn": {"CT*alpha": -1.0 / AIRCRAFT.b}, "Cm": {"CT*beta": -1.0 / AIRCRAFT.cbar}}
    found = best(compare(fly(aerodynamics(turning))), effect_named("propeller-normal-force"))
    assert_allclose(found.values["P-factor"], 1.0, rtol=0.05)
    assert abs(found.values.get("force per CT", 0.0)) < 0.02


@pytest.mark.parametrize("speed", [None, 2400.0])
def test_a_rotor_missing_from_the_simulation_is_found_with_its_angular_momentum(speed):
    recordings = fly(aircraft=aircraft(engine={"angular_momentum": 500.0}))
    if speed:
        recordings = [r.with_channels(rpm=speed) for r in recordings]
    found = best(compare(recordings), effect_named("engine-gyroscopic"))
    assert found.explained > 0.9
    (value,) = found.values.values()
    turns = {p.name: 1.0 if p.unit.endswith("/s") else speed * np.pi / 30.0 for p in found.variant.parameters}
    assert_allclose(value * next(iter(turns.values())), 500.0, rtol=0.03)


def test_a_constant_thrust_gives_no_finding():
    recordings = [Recording(r.name, r.t, {c: r[c] for c in r.names if c not in ("t", "thrust")}) for r in fly()]
    still = compare(recordings)
    for h in EFFECTS:
        if h.name != "engine-gyroscopic":
            assert "thrust" in h.needs(still)


@pytest.mark.parametrize(("change", "told"), [(0.1, False), (0.4, True)])
def test_terms_of_a_thrust_that_hardly_changes_are_derivatives(change, told):
    flights = []
    for k, f in enumerate(compare(fly())):
        thrust = 0.05 * (1.0 + change * (k % 2)) * f["qbar"] * AIRCRAFT.S
        flights.append(replace(f, channels={**f.channels, "thrust": thrust}))
    for name in ("slipstream", "propeller-normal-force"):
        assert (effect_named(name).needs(flights) == "") is told
