"""Wind, shear, gusts and modes of the structure."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lsim

from structsel.effects import structural
from structsel.effects.operators import pulse
from structsel.numerics.air_data import air_data, body_to_earth
from structsel.recording import Recording
from structsel.simulation import Atmosphere, Gust
from tests.effect_fits import best, effect_named, explain
from tests.exact_flights import AIRCRAFT, compare, fly

VANE_AT_CG = AIRCRAFT.model_validate(AIRCRAFT.model_dump() | {"sensors": {}})


def over_ground(recordings):
    """Air data made from the motion over the ground."""
    made = []
    for r in recordings:
        frame = body_to_earth(r["phi"], r["theta"], r["psi"])
        body = np.einsum("nji,nj->in", frame, np.column_stack([r["vn"], r["ve"], r["vd"]]))
        channels = {c: r[c] for c in r.names if c != "t"} | dict(zip(("V", "alpha", "beta"), air_data(*body)))
        made.append(Recording(r.name, r.t, channels))
    return made


def test_a_shear_with_height_is_found_by_kinematics_alone():
    # 8 m/s more northerly wind per 100 m, through climbs and descents of some 30 m.
    air = Atmosphere(wind=[[-40.0, 0.0, 0.0], [40.0, 0.0, 0.0]], heights=[500.0, 1500.0])
    flights = compare(fly(aircraft=VANE_AT_CG, air=air), VANE_AT_CG)
    variants = {v.about: v for v in effect_named("wind-shear").variants(flights)}
    found = explain(flights, variants["linear with height"])
    assert found.explained > 0.98
    assert_allclose([found.values["north"], found.values["east"]], [8.0, 0.0], atol=0.1)
    assert set(variants["linear with height"].columns(flights[0])) <= {r for r in flights[0].measured if r[0] == "k"}


def test_a_steady_wind_that_went_into_the_airspeed_is_found():
    air = Atmosphere(wind=(6.0, 4.0, 0.0))
    flights = compare(over_ground(fly(aircraft=VANE_AT_CG, air=air)), VANE_AT_CG)
    variants = {v.about: v for v in effect_named("steady-wind").variants(flights)}
    found = explain(flights, variants["airspeed and angles made from the motion over the ground"])
    assert found.explained > 0.9
    assert_allclose([found.values["north"], found.values["east"]], [6.0, 4.0], atol=1.2)


def test_a_gust_the_vane_missed_is_found_with_its_time_and_speed():
    air = Atmosphere(gusts=(Gust("w", -3.0, 5.0, 1.6),))
    first, _ = fly(aircraft=VANE_AT_CG, air=air)
    _, second = fly(aircraft=VANE_AT_CG)
    flights = compare(over_ground([first, second]), VANE_AT_CG)
    found = best(flights, effect_named("gust"))
    assert found.variant.about == "upward, in 'm0'"
    assert found.explained > 0.85
    assert_allclose(found.variant.shape["time in m0"], 5.8, atol=0.15)
    assert found.variant.shape["length"] == 1.6
    assert_allclose(found.values["speed"], 3.0, rtol=0.1)


def test_a_pulse_is_one_minus_cosine():
    t = np.linspace(0.0, 4.0, 401)
    form = pulse(t, 2.0, 1.0)
    assert_allclose(form[[149, 175, 200, 225, 251]], [0.0, 0.5, 1.0, 0.5, 0.0], atol=1e-12)


def test_without_motion_over_the_ground_a_wind_cannot_be_stated():
    recordings = [Recording(r.name, r.t, {c: r[c] for c in r.names if c not in ("t", "vn", "ve", "vd")}) for r in fly()]
    assert "over the ground" in effect_named("steady-wind").needs(compare(recordings))


@pytest.mark.parametrize(("numerator", "name"), [("bent", "CZ per de"), ("moving", "CZ per de, as it moves")])
def test_a_mode_excited_by_the_elevator_is_found_with_its_frequency(numerator, name):
    w, damping = 2.0 * np.pi * 3.3, 0.04
    made = []
    for f in compare(fly()):
        de, denominator = f["de"] - f["de"][0], [1.0, 2.0 * damping * w, w**2]
        answer = {"bent": [w**2], "moving": [w, 0.0]}[numerator]
        extra = lsim((answer, denominator), de, f.t - f.t[0])[1] - (de if numerator == "bent" else 0.0)
        more = {"CZ": f.simulated["CZ"] + 0.8 * extra, "Cm": f.simulated["Cm"] + 0.3 * extra}
        made.append(replace(f, measured={**f.measured, **more}))
    (hypothesis,) = structural.EFFECTS
    found = best(made, hypothesis)
    assert found.variant.about == "de"
    assert found.explained > 0.8
    assert_allclose(found.variant.shape["frequency"], 3.3, rtol=0.05)
    assert_allclose(found.values[name], 0.8, rtol=0.25)


def test_a_mode_at_the_edge_of_the_compared_band_is_found():
    w, made = 2.0 * np.pi * 3.95, []
    slow = [Recording(r.name, r.t[::2], {c: r[c][::2] for c in r.names if c != "t"}) for r in fly()]
    for f in compare(slow):
        ring = lsim(([w, 0.0], [1.0, 0.1 * w, w**2]), f["de"] - f["de"][0], f.t - f.t[0])[1]
        made.append(replace(f, measured={**f.measured, "CZ": f.simulated["CZ"] + 0.8 * ring}))
    found = best(made, structural.EFFECTS[0])
    assert found.variant.about == "de"
    assert found.explained > 0.6
    assert_allclose(found.variant.shape["frequency"], 3.95, rtol=0.05)


def test_slow_samples_cannot_show_a_mode():
    (hypothesis,) = structural.EFFECTS
    slow = [replace(f, dt=0.4) for f in compare(fly())]
    assert "samples faster than" in hypothesis.needs(slow)


def test_the_same_gust_in_two_manoeuvres_is_one_effect_with_both_times():
    seen = []
    for k, start in enumerate((5.0, 11.0)):
        air = Atmosphere(gusts=(Gust("w", -3.0, start, 1.6),))
        seen.append(fly(aircraft=VANE_AT_CG, air=air)[k])
    found = best(compare(over_ground(seen)), effect_named("gust"))
    assert set(found.variant.about.removeprefix("upward, in ").split(", ")) == {"'m0'", "'m1'"}
    assert found.explained > 0.85
    assert_allclose([found.variant.shape[f"time in m{k}"] for k in range(2)], [5.8, 11.8], atol=0.15)
    assert_allclose(found.values["speed"], 3.0, rtol=0.15)  # to first order, at two airspeeds
    assert found.variant.shape["length"] == 1.6
