"""Further forms of effects: shear in air data, shared gusts, rate limits, scales, latched stalls, ice, instruments."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.signal import lsim

from structsel.demo.aircraft import TRUTH
from structsel.effects.latched_stall import latched
from structsel.effects.rate_limits import _slewing
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.air_data import body_from_wind_axes
from structsel.recording import Recording
from structsel.simulation import Atmosphere, Gust, Instruments
from tests.effect_fits import best, check_all, effect_named, explain
from tests.exact_flights import AIRCRAFT, compare, fly
from tests.test_effects_air_and_structure import VANE_AT_CG, over_ground

SHEAR = Atmosphere(wind=[[-40.0, 0.0, 0.0], [40.0, 0.0, 0.0]], heights=[500.0, 1500.0])  # 8 m/s per 100 m, from south


def added(flights, more):
    """Flights whose measured responses have more than simulated, by a function of the flight."""
    return [replace(f, measured={**f.measured, **{r: f.simulated[r] + x for r, x in more(f).items()}}) for f in flights]


def without(recordings, *channels):
    return [Recording(r.name, r.t, {c: r[c] for c in r.names if c not in ("t", *channels)}) for r in recordings]


def test_a_shear_that_went_into_the_air_data_is_found():
    flights = compare(over_ground(fly(aircraft=VANE_AT_CG, air=SHEAR)), VANE_AT_CG)
    forms = {v.parameters[0].name: v for v in effect_named("wind-shear").variants(flights) if "over the g" in v.about}
    found = explain(flights, forms["north"])
    assert found.explained > 0.85  # to first order in the wind
    assert_allclose([found.values["north"], found.values["east"]], [8.0, 0.0], atol=1.2)


def test_a_shear_along_the_path_needs_no_heading():
    # Both flights begin to the north and turn by some degrees.
    seen = without(over_ground(fly(aircraft=VANE_AT_CG, air=SHEAR)), "psi", "vn", "ve", "vd")
    flights = compare(seen, VANE_AT_CG)
    shear = effect_named("wind-shear")
    assert shear.needs(flights) == ""
    found = best(flights, shear)
    assert found.variant.parameters[0].name == "along the path"
    assert found.explained > 0.8
    assert_allclose(found.values["along the path"], 8.0, rtol=0.2)


def test_one_gust_at_the_same_time_of_all_manoeuvres_has_one_time():
    air = Atmosphere(gusts=(Gust("w", -3.0, 5.0, 1.2),))
    flights = compare(over_ground(fly(aircraft=VANE_AT_CG, air=air)), VANE_AT_CG)
    shared = [v for v in effect_named("gust").variants(flights) if v.about == "upward, in every manoeuvre"]
    found = max((explain(flights, v) for v in shared), key=lambda fit: fit.explained)
    assert found.explained > 0.85
    assert set(found.variant.shape) == {"time", "length"}
    assert_allclose(found.variant.shape["time"], 5.6, atol=0.15)
    assert_allclose(found.values["speed"], 3.0, rtol=0.15)


def test_an_actuator_that_is_slow_in_one_direction_follows_at_once_in_the_other():
    class Clock:
        dt = 0.1

    asked = np.array([0.0, 1.0, 1.0, 1.0, 0.0, -1.0])
    # At most 0.4 up in a sample; down at once.
    assert_allclose(_slewing(asked, Clock, up=4.0, down=np.inf), [0.0, 0.4, 0.8, 1.0, 0.0, -1.0])
    assert_allclose(_slewing(asked, Clock, up=np.inf, down=4.0), [0.0, 1.0, 1.0, 1.0, 0.6, 0.2])


def test_a_surface_that_is_slow_in_one_direction_and_slow_surfaces_together_are_found():
    limit = effect_named("actuator-rate-limit")
    tried = {v.about: v for v in reversed(limit.variants(compare(fly())))}  # the lowest rate of each
    for about in ("elevator, up only", "elevator, down only", "elevator, with a lag", "all surfaces"):
        made = added(compare(fly()), lambda f, v=tried[about]: {r: x[:, 0] for r, x in v.columns(f).items()})
        found = best(made, limit)
        assert found.variant.about == about
        assert found.explained > 0.99
    check_all(compare(fly()), limit)


@pytest.mark.parametrize(
    ("faults", "about", "value"),
    [
        ({"scale": {"theta": 0.08}}, "the pitch attitude", 0.08),
        ({"scale": {"phi": -0.05}}, "the bank angle", -0.05),
    ],
)
def test_the_scale_of_an_attitude_is_found(faults, about, value):
    flights = compare(fly(instruments=Instruments(**faults)))
    found = max(
        (explain(flights, v) for v in effect_named("sensor-scale").variants(flights) if len(v.parameters) == 1),
        key=lambda fit: fit.explained,
    )
    assert found.variant.about == about
    assert_allclose(found.values["scale"], value, rtol=0.1)


def test_a_scale_about_another_zero_brings_a_constant():
    recordings = [r.with_channels(alpha=r["alpha"] + 0.1 * (r["alpha"] - 0.2)) for r in fly()]
    flights = compare(recordings)
    forms = [v for v in effect_named("sensor-scale").variants(flights) if "attack vane, about a zero" in v.about]
    assert {v.shape["zero"] for v in forms} == {-0.15, -0.05, 0.05, 0.15}
    found = max((explain(flights, forms[0].again(x)) for x in np.linspace(0.1, 0.3, 21)), key=lambda fit: fit.explained)
    assert found.explained > 0.97
    # Of the reading, as others tell the truth: 0.1 of 1.1.
    assert_allclose(found.values["scale"], 0.1 / 1.1, rtol=0.1)
    assert_allclose(-found.values["scale"] * found.variant.shape["zero"], -0.02 / 1.1, rtol=0.3)
    # First order; about the same reading on the other side of zero it is none.
    assert explain(flights, forms[0].again(-0.2)).explained < 0.1
    for f in flights:  # the level too, which the fit leaves out
        wrong = {c: found.values["scale"] * x[:, 0] for c, x in found.variant.columns(f).items() if c in COEFFICIENTS}
        for c, x in wrong.items():
            assert_allclose(x.mean(), f.difference[c].mean(), rtol=0.2, atol=2e-4)


def test_a_latched_flow_attaches_at_a_smaller_angle_than_it_separates():
    (first, _) = compare(fly())
    alpha = 0.3 * np.sin(2.0 * np.pi * np.arange(len(first)) / 200.0)
    flight = replace(first, channels={**first.channels, "alpha": alpha})
    got = latched(flight, 0.25, 0.1)["CZ"][:, 0]
    rising = np.concatenate([[0.0], np.diff(alpha)]) > 0.0
    # On the way up from 0.1 to 0.25 rad the flow is attached, on the way down separated.
    between = (alpha > 0.12) & (alpha < 0.24)
    assert_array_equal(got[between & rising], 0.0)
    assert_array_equal(got[between & ~rising], 1.0)


def test_a_latched_stall_with_a_branch_of_its_own_is_found():
    def stalled(f):
        top = max(float(np.quantile(g["alpha"], 0.998)) for g in compare(fly()))
        separated, state = np.zeros(len(f)), 0.0
        for k, angle in enumerate(f["alpha"]):
            state = 1.0 if angle > 0.85 * top else 0.0 if angle < 0.5 * top else state
            separated[k] = state
        return {"CZ": separated * (0.3 + 2.0 * (f["alpha"] - top)), "CX": -0.05 * separated, "Cm": -0.04 * separated}

    flights = added(compare(fly()), stalled)
    found = [explain(flights, v) for v in effect_named("stall-hysteresis").variants(flights)]
    best_form = max(found, key=lambda fit: fit.explained)
    assert "until a smaller angle" in best_form.variant.about
    assert best_form.explained > 0.7


@pytest.mark.parametrize("where", ["growing, on one wing", "growing, with power of the elevator"])
def test_ice_is_found_in_what_it_takes(where):
    zero = -TRUTH["CZ"]["1"] / TRUTH["CZ"]["alpha"]  # angle of attack of no lift

    def iced(f):
        x = (f.t - f.t[0]) / 24.0
        CX, CZ = body_from_wind_axes(-0.6 * (f["alpha"] - zero) * x, 0.02 * x, f["alpha"])
        more = {"CX": CX, "CZ": CZ, "Cm": 0.003 * x}
        if "wing" in where:
            more |= {"Cl": -0.01 * x - 0.05 * f["alpha"] * x, "Cn": 0.004 * x}
        if "power" in where:
            for c in ("Cm", "CZ"):
                more[c] = more[c] - 0.3 * TRUTH[c]["de"] * f["de"] * x
        return more

    flights = added(compare(fly()), iced)
    icing = effect_named("icing")
    form = next(v for v in icing.variants(flights) if v.about == where)
    found = explain(flights, form)
    if "power" in where:
        assert_allclose(found.values["elevator power loss"], 0.3, rtol=0.02)
    else:
        assert found.explained > 0.9
    assert 0.05 < found.values["lift slope loss"] < 0.2  # of 5.6 per rad
    assert form.about in icing.says(_as_found(form, found.values))


def _as_found(form, values):
    from tests.effect_fits import fitted_effect

    return fitted_effect(form, values)


def test_accelerometers_on_a_mode_of_the_structure_ring_by_themselves():
    w = 2.0 * np.pi * 3.0
    flights = []
    for f in compare(fly()):
        de = f["de"] - f["de"][0]
        ring = lsim(([w**2], [1.0, 0.05 * w, w**2]), de, f.t - f.t[0])[1] - de
        # 20 m/s^2 per rad, as a normal force coefficient.
        CZ = 20.0 * ring * AIRCRAFT.mass / (f["qbar"] * AIRCRAFT.S)
        flights.append(replace(f, measured={**f.measured, "CZ": f.simulated["CZ"] + CZ}))
    forms = [v for v in effect_named("structural-mode").variants(flights) if "instruments" in v.about]
    found = max((explain(flights, v, ["CZ"]) for v in forms), key=lambda fit: fit.explained)
    assert found.variant.about == "de, of the instruments only"
    assert found.explained > 0.8
    assert_allclose(found.values["az per de"], 20.0, rtol=0.1)
