"""Faults of instruments, in simulated recordings: the signature finds which, and how large."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.comparison.flight import prepare_flight
from structsel.comparison.responses import respond
from structsel.comparison.sensitivity import misread, reading
from structsel.effects.sensors import EFFECTS
from structsel.recording import Recording
from structsel.simulation import Instruments
from tests import noisy_flights
from tests.effect_fits import best, effect_named, explain, fitted_effect
from tests.exact_flights import AIRCRAFT, compare, fly
from tests.switched_forms import refined, sizes


def faulty(**faults):
    return compare(fly(instruments=Instruments(**faults)))


@pytest.mark.parametrize(
    ("effect", "faults", "about", "name", "value"),
    [
        ("sensor-scale", {"scale": {"alpha": 0.05}}, "the angle of attack vane", "scale", 0.05),
        ("sensor-scale", {"scale": {"az": 0.04}}, "the normal accelerometer (az)", "scale", 0.04),
        ("sensor-scale", {"scale": {"p": -0.2}}, "the roll gyro (p)", "scale", -0.2),
        ("sensor-scale", {"scale": {"q": 0.15}}, "the pitch gyro (q)", "scale", 0.15),
        ("sensor-delay", {"delay": {"beta": 0.08}}, "the sideslip vane", "delay", 0.08),
        ("sensor-delay", {"delay": {"q": 0.06}}, "the pitch gyro (q)", "delay", 0.06),
        ("sensor-bias", {"bias": {"alpha": 0.03}}, "the angle of attack vane", "bias", 0.03),
        ("position-error", {"scale": {"V": 0.04}}, "airspeed and dynamic pressure", "factor", 0.04),
    ],
)
def test_the_faulty_instrument_is_found_among_all_with_its_fault(effect, faults, about, name, value):
    found = best(faulty(**faults), effect_named(effect))
    assert found.variant.about.removesuffix(", about a zero of its own") == about
    assert found.explained > 0.96
    # First order: slopes where it was read, and other channels that the fault moves as well.
    assert_allclose(found.values[name], value, rtol=0.1)


@pytest.mark.parametrize(
    ("sensors", "about", "name", "value"),
    [
        # Pitching moves the vane's angle of attack by q x / V, and turning the accelerometer's ax by q' z.
        ({"vane": {"position": (3.0, 0.0, 0.0)}}, "the vane", "x", 1.0),
        ({"vane": {"position": (2.0, 0.0, 0.0)}, "accelerometer": {"position": (0.0, 0.0, 0.3)}},
         "the accelerometer", "z", 0.3),
    ],
)  # fmt: skip
def test_an_instrument_that_stands_elsewhere_is_found_with_the_distance(sensors, about, name, value):
    flights = compare(fly(aircraft=AIRCRAFT.model_validate(AIRCRAFT.model_dump() | {"sensors": sensors})))
    variants = {v.about: v for v in effect_named("sensor-position").variants(flights)}
    for which in (f"along body {name}", "along all axes"):
        found = explain(flights, variants[f"{about}, {which}"])
        assert found.explained > 0.98
        assert_allclose(found.values[name], value, rtol=0.03)


def test_turned_accelerometers_are_found_about_their_axis():
    angle = 0.03
    turned = []
    for r in fly():
        ax, az = r["ax"], r["az"]
        # A triad pitched up by the angle reads a part of az along its x, and less of ax along its z.
        mixed = {"ax": np.cos(angle) * ax - np.sin(angle) * az, "az": np.cos(angle) * az + np.sin(angle) * ax}
        turned.append(r.with_channels(**mixed))
    found = best(compare(turned), effect_named("sensor-misalignment"))
    assert found.variant.about == "the accelerometers"
    assert found.explained > 0.98
    assert_allclose(found.values["about y"], angle, rtol=0.03)


def test_measurement_errors_add_up_as_in_the_complete_sensor_chain():
    # An error that varies in time, by level and rate, against the chain gone through with and without it.
    flight = compare(fly())[0]
    error = 1e-4 * np.sin(1.7 * flight.t)
    expected = {**flight.channels, **flight.expected}
    felt = {**expected, **{c: flight.channels[c] for c in ("ax", "ay", "az")}}
    for channel in ("V", "alpha", "p", "ax", "theta"):
        off = {channel: error} | ({"p_dot": flight.rate(error)} if channel == "p" else {})
        stated = misread(flight, **{channel: error})
        for response in flight.responses:
            # Coefficients by the forces that the simulation expects, kinematics by those that were felt.
            clean = expected if response in flight.simulated else felt
            sides = [{**clean, **{c: clean[c] + part * e for c, e in off.items()}} for part in (0.5, -0.5)]
            high, low = (respond(ch, AIRCRAFT, flight.dt, (response,))[response] for ch in sides)
            complete = high - low
            if response in flight.simulated:
                complete = complete - flight.slope(response, channel) * error
            assert_allclose(stated.get(response, 0.0 * error), complete, atol=1e-3 * np.abs(complete).max() + 1e-12)


def test_an_accelerometer_scale_error_is_relative_to_the_true_reading():
    flight = faulty(scale={"az": 0.02})[0]
    assert_allclose(reading(flight, "az"), flight["az"] / 1.02, atol=0.1)  # m/s^2; as read it is off by 0.2


def test_flights_without_air_data_give_no_instrument_faults():
    t = np.arange(0.0, 4.0, 0.02)
    u = np.sin(t)
    level = prepare_flight(Recording("level", t, {"u": u, "y": 2.0 * u}), AIRCRAFT, {"y": 1.9 * u})
    for h in EFFECTS:
        assert "channels V, alpha" in h.needs([level])


def test_a_reading_that_jumps_in_several_manoeuvres_is_found_with_its_times():
    starts, off = {"m01": 7.32, "m02": 15.12}, -0.3
    jumped = []
    recordings, stated = noisy_flights.fly({})
    for recording in recordings:
        channels = {n: recording[n] for n in recording.names if n != "t"}
        channels["az"] = channels["az"] + off * (recording.t >= starts[recording.name])
        jumped.append(Recording(recording.name, recording.t, channels))
    _, score = refined(noisy_flights.ready(jumped, stated), "sensor-bias")
    variant = score.signature.variant
    assert variant.about == "the normal accelerometer (az), in 'm01' from 7.3 s, 'm02' from 15.1 s"
    for name, start in starts.items():
        assert_allclose(variant.shape[f"time in {name}"], start, atol=0.041)  # to the sample
    assert_allclose(sizes(score)["bias"], off, rtol=0.05)


def test_the_sentence_of_a_bias_has_its_sign_and_then_its_times():
    bias = effect_named("sensor-bias")
    forms = {v.about: v for v in bias.variants(faulty(bias={"alpha": 0.03}))}
    vane, drifting = "the angle of attack vane", "the angle of attack vane, drifting"
    assert bias.says(fitted_effect(forms[vane], {"bias": -0.03})) == (
        "The angle of attack vane is biased by -1.72 +- 0.2 deg."
    )
    assert bias.says(fitted_effect(forms[drifting], {"drift": 0.01})) == (
        "The angle of attack vane drifts by 0.573 +- 0.06 deg/min."
    )
    jumped = replace(forms[vane], words={**forms[vane].words, "when": "in 'm0' from 7.3 s"})
    assert bias.says(fitted_effect(jumped, {"bias": 0.03})) == (
        "The angle of attack vane is biased by 1.72 +- 0.2 deg, in 'm0' from 7.3 s."
    )
