"""Effects as others write them: one term of several, one moment of three, one vane of two; simulated, and found."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from tests.effect_fits import best, effect_named, fit_form
from tests.exact_flights import AIRCRAFT, TERMS, aerodynamics, compare, fly


def changed(**more):
    """The model with values added to its terms, by response and term."""
    return aerodynamics({r: {t: TERMS[r].get(t, 0.0) + v for t, v in terms.items()} for r, terms in more.items()})


def times(response, factor):
    """A response's own terms, times a factor."""
    return {t: factor * v for t, v in TERMS[response].items()}


@pytest.mark.parametrize(
    ("effect", "more", "about", "values"),
    [
        ("propeller-normal-force", {"Cn": {"CT*alpha": -0.2}}, "yaw alone", [-0.2]),
        (
            "propeller-normal-force", {"CZ": {"CT*alpha": -1.0}, "Cm": {"CT*alpha": 0.7}, "Cn": {"CT*alpha": 0.3}},
            "forces and moments of their own", [-1.0, 0.0, 0.7, 0.3],
        ),
        (
            "propeller-normal-force", {"Cn": {"CT*alpha": 0.3}, "Cm": {"CT*beta": -0.3}}, "freely",
            [0.0, 0.0, 0.0, 0.3, -0.3, 0.0],
        ),
        ("slipstream", {"Cm": {"CT*de": -1.5}}, "at the elevator", [-1.5]),
        ("slipstream", {"Cn": {"CT*dr": -0.1}}, "at the rudder", [-0.1]),
        (
            "slipstream", {"Cm": {"CT": 0.06, "CT*de": -1.5}, "CZ": {"CT*alpha": -1.0}},
            "at tail and wing, each by its own", [0.06, 0.0, -1.5, 0.0, -1.0],
        ),
        ("missing-term", {"Cl": {"p_hat^3": -100.0}}, "p_hat^3 in Cl", [-100.0]),
        ("missing-term", {"CX": {"de^2": -1.5}}, "de^2 in CX", [-1.5]),
        ("cg-shift", {"Cm": times("CZ", 0.03 / AIRCRAFT.cbar)}, "in all manoeuvres, in Cm alone", [0.03]),
        ("cg-shift", {"Cl": times("CZ", 0.05 / AIRCRAFT.b)}, "in all manoeuvres, in Cl alone", [-0.05]),
        (
            "cg-shift", {"Cl": times("CZ", 0.05 / AIRCRAFT.b), "Cn": times("CX", -0.05 / AIRCRAFT.b)},
            "in all manoeuvres, the line of thrust with it", [-0.05],
        ),
    ],
)  # fmt: skip
def test_part_of_an_effect_is_the_effect(effect, more, about, values):
    found = fit_form(compare(fly(changed(**more))), effect, about)
    assert found.explained > 0.97
    assert_allclose(list(found.values.values()), values, rtol=0.05, atol=0.03 * np.abs(values).max())


@pytest.mark.parametrize(
    ("effect", "channel", "reads", "about", "value"),
    [
        ("sensor-position", "alpha", lambda r: -1.0 * r["q"] / r["V"], "the angle of attack vane, along body x", 1.0),
        ("sensor-position", "beta", lambda r: 1.0 * r["r"] / r["V"], "the sideslip vane, along body x", 1.0),
        ("sensor-misalignment", "r", lambda r: 0.03 * r["p"], "the yaw gyro (r) alone, by a fraction of p", 0.03),
        (
            "sensor-misalignment", "ax", lambda r: 0.02 * r["az"],
            "the longitudinal accelerometer (ax) alone, by a fraction of az", 0.02,
        ),
    ],
)  # fmt: skip
def test_one_instrument_of_several_is_found_alone(effect, channel, reads, about, value):
    found = best(compare([r.with_channels(**{channel: r[channel] + reads(r)}) for r in fly()]), effect_named(effect))
    assert found.variant.about == about
    assert found.explained > 0.97
    assert_allclose(next(iter(found.values.values())), value, rtol=0.05)


def test_thrust_that_is_delayed_along_the_axis_alone_leaves_the_moment():
    offset = AIRCRAFT.model_validate(AIRCRAFT.model_dump() | {"thrust": {"offset": (1.8, 0.0, 0.3)}})
    flights = compare(fly(aircraft=offset), offset)
    about = {v.about for v in effect_named("thrust-lag").variants(flights)}
    assert about == {"", "along the axis alone"}
    alone = next(v for v in effect_named("thrust-lag").variants(flights) if v.about)
    assert set(alone.columns(flights[0])) == {"CX"}
