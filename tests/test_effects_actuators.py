"""Surfaces that stand elsewhere than recorded: simulated with an actuator, recorded without."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.effects.actuators import EFFECTS
from structsel.numerics.dynamic_elements import actuate
from structsel.simulation import Actuator
from tests.effect_fits import best, effect_named, fitted_effect
from tests.exact_flights import aerodynamics, compare, fly


def commanded(control, actuator):
    """Flights in which a control is recorded as it was commanded."""
    return compare(fly(actuators={control: actuator}, true_inputs={control: lambda x: x}))


def test_a_lag_is_found_on_its_surface_with_its_time_constant():
    found = best(commanded("de", Actuator(lag=0.1)), effect_named("actuator-lag"))
    assert (found.variant.about, *found.values) == ("elevator", "lag")
    assert found.explained > 0.98
    # The grid of shapes is coarse; the parameter makes up for it to first order.
    assert_allclose(found.values["lag"], 0.1, rtol=0.1)


def test_servos_that_are_all_delayed_are_one_effect():
    every = dict.fromkeys(("de", "da", "dr"), Actuator(lag=0.1))
    flights = compare(fly(actuators=every, true_inputs={control: lambda x: x for control in every}))
    found = best(flights, effect_named("actuator-lag"))
    assert (found.variant.about, *found.values) == ("all surfaces", "lag")
    assert found.explained > 0.97
    assert_allclose(found.values["lag"], 0.1, rtol=0.1)
    still = [replace(f, channels={**f.channels, **dict.fromkeys(("da", "dr"), np.zeros(len(f)))}) for f in flights]
    assert {v.about for v in effect_named("actuator-lag").variants(still)} == {"elevator"}


def test_a_pure_delay_is_stated_from_a_lag():
    flights = compare(fly(true_inputs={"da": lambda x: np.concatenate([np.full(5, x[0]), x[:-5]])}))
    found = best(flights, effect_named("actuator-lag"))
    assert (found.variant.about, *found.values) == ("aileron", "delay")
    assert found.explained > 0.98
    assert_allclose(found.values["delay"], 0.1, rtol=0.05)


@pytest.mark.parametrize(
    ("effect", "control", "actuator", "about", "name", "value"),
    [
        ("actuator-rate-limit", "de", Actuator(rate=0.2), "elevator", "rate", 0.2),
        ("actuator-saturation", "dr", Actuator(high=0.08), "rudder, upper side", "stop", 0.08),
        ("actuator-saturation", "dr", Actuator(high=0.03), "rudder, upper side", "stop", 0.03),
        ("backlash", "da", Actuator(backlash=0.02), "aileron", "width", 0.02),
    ],
)
def test_limits_and_play_are_found_to_the_next_value_tried(effect, control, actuator, about, name, value):
    found = best(commanded(control, actuator), effect_named(effect))
    assert found.variant.about == about
    assert found.explained > 0.95
    assert_allclose(found.variant.shape[name], value, rtol=0.3)
    assert 0.5 < found.values["fraction"] < 1.5


def test_each_recording_may_begin_on_either_side_of_a_play():
    width, sides = 0.01, (0.9, -0.9)
    flights = compare(fly())
    played = [actuate(f.t, f["de"], backlash=width, start=side) for f, side in zip(flights, sides)]
    flights = [
        replace(f, measured=f.measured | {c: f.measured[c] + f.slope(c, "de") * (x - f["de"]) for c in ("CZ", "Cm")})
        for f, x in zip(flights, played)
    ]
    found = best(flights, effect_named("backlash"))
    assert found.explained > 0.98
    assert_allclose(found.variant.shape["width"], width, rtol=0.3)
    assert_allclose([found.values[f"start in {f.name}"] for f in flights], sides, atol=0.35)
    stated = found.variant.stated(fitted_effect(found.variant, found.values).estimates)
    assert stated.keys() == {"fraction", "width"}


def test_rates_far_below_that_of_a_step_are_tried():
    flights = [replace(f, channels={**f.channels, "de": 0.1 * (f.t > f.t[0] + 3.0)}) for f in compare(fly())]
    variants = effect_named("actuator-rate-limit").variants(flights)
    tried = np.array([v.shape["rate"] for v in variants if v.about == "elevator"])
    assert tried.max() > 2.0
    assert np.abs(np.log(tried / 0.2)).min() < 0.5 * np.log(1.3)
    assert len(tried) < 25


def test_a_pitch_damper_nobody_recorded_is_found_with_its_gain():
    # A surface that moves by 0.2 s times q has the moment and the force of so much elevator.
    flights = compare(fly(aerodynamics({"CZ": {"q": -0.4 * 0.2}, "Cm": {"q": -1.92 * 0.2}})))
    variants = effect_named("augmentation").variants(flights)
    assert {"q to elevator", "r to rudder", "p to aileron"} <= {v.about for v in variants}
    found = best(flights, effect_named("augmentation"))
    assert "q" in found.variant.about
    assert found.explained > 0.99
    assert_allclose(found.values["gain of q"], 0.2, rtol=0.02)


def test_the_sentence_of_a_rate_limit_has_no_standard_error_of_a_rate_that_was_tried():
    limit = effect_named("actuator-rate-limit")
    form = next(v for v in limit.variants(compare(fly())) if v.about == "elevator, with a lag")
    said = limit.says(fitted_effect(form, {"fraction": 1.0}))
    assert said.startswith("The elevator, with a lag, moves no faster than ")
    assert "+-" not in said


def test_surfaces_that_never_move_cannot_be_delayed():
    flights = compare(fly(size=1e-13))
    for h in EFFECTS:
        assert "control that moves" in h.needs(flights)
