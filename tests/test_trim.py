"""Trim and linearisation: published conditions, hand calculations, and the simulation about them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.demo.aircraft import demo_aircraft
from structsel.errors import (
    ChannelError,
    DomainError,
    ModelError,
    SimulationError,
)
from structsel.numerics import rigid_body as rb
from structsel.numerics.air_data import lift_and_drag
from structsel.numerics.atmosphere import standard_atmosphere
from structsel.recording import Recording
from structsel.simulation import (
    linearise,
    published_aircraft,
    trim,
)
from tests.models import DEMO

NONLINEAR = ("beaver", "hfb320", "citation")

CLOCK = np.arange(0.0, 10.0, 0.02)


# --- trim ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NONLINEAR)
def test_a_published_aircraft_trims_and_stays_there(name):
    published = published_aircraft(name)
    found = published.trim()
    assert max(abs(x) for x in found.unbalance.values()) < 1e-9
    assert_allclose((found["V"], found["h"]), (published.condition["V"], published.condition["h"]), rtol=1e-12)
    flight = published.simulate(found.inputs(CLOCK), start=found)
    for channel in ("V", "alpha", "theta", "phi", "h"):
        assert_allclose(flight[channel], found[channel], atol=1e-6)


def test_the_beaver_trims_where_the_fdc_toolbox_has_it():
    # Its example at 35 m/s and sea level, wings level, 1800 rpm and 20 inHg: alpha 0.2113, theta 0.1919, de -0.0931.
    found = published_aircraft("beaver").trim(
        35.0, 0.0, climb=None, bank=0.0, turn_rate=0.0, controls={"manifold_pressure": 20.0}
    )  # fmt: skip
    assert_allclose([found["alpha"], found["theta"], found["de"]], [0.2113, 0.1919, -0.0931], atol=1e-4)
    assert found["beta"] < 0.0


def test_the_citation_carries_its_weight_as_a_hand_calculation_says():
    # With q = 0: Cm gives de from alpha, CZ then alpha from the weight across the path, thrust and sideslip apart.
    published = published_aircraft("citation")
    found = published.trim()
    qbar = 0.5 * standard_atmosphere(7500.0)[2] * 120.0**2
    de = -(0.021 - 0.488 * found["alpha"]) / -1.25
    assert_allclose(found["de"], de, atol=1e-12)
    CZ = -4500.0 * rb.G0 * np.cos(found["theta"]) * np.cos(found["phi"]) / (qbar * 24.99)
    assert_allclose(-0.213 - 4.037 * found["alpha"] - 0.836 * de, CZ, rtol=1e-9)


def test_a_steady_turn_turns_at_its_rate():
    published = published_aircraft("beaver")
    found = published.trim(turn_rate=0.15)
    assert_allclose(np.tan(found["phi"]), 45.0 * 0.15 / rb.G0, rtol=0.04)
    flight = published.simulate(found.inputs(CLOCK), start=found)
    assert_allclose(flight["psi"], 0.15 * CLOCK, atol=1e-7)
    assert_allclose(flight["phi"], found["phi"], atol=1e-7)
    assert_allclose(published.trim(bank=found["phi"]).turn_rate, 0.15, rtol=1e-9)


def test_a_climb_climbs_at_its_angle():
    published = published_aircraft("hfb320")  # its air does not thin
    found = published.trim(climb=0.02)
    flight = published.simulate(found.inputs(CLOCK), start=found)
    assert_allclose(flight["h"] - flight["h"][0], 104.67 * np.sin(0.02) * CLOCK, atol=1e-6)
    level = published.trim()
    weight = 7472.0 * rb.G0
    assert_allclose(found["thrust"] - level["thrust"], weight * np.sin(0.02), rtol=0.01)
    glide = published.trim(climb=None, controls={"thrust": 0.0})
    lift_over_drag = -1.0 / np.tan(glide.climb)
    CL, CD = lift_and_drag(glide["CX"], 0.0, glide["CZ"], glide["alpha"])
    assert_allclose(lift_over_drag, CL / CD, rtol=1e-9)


def test_wings_level_without_a_turn_finds_the_sideslip():
    found = published_aircraft("beaver").trim(bank=0.0, turn_rate=0.0)
    assert found["phi"] == 0.0
    assert 0.001 < abs(found["beta"]) < 0.05


def test_an_impossible_trim_says_what_is_missing_and_hands_over_the_nearest():
    with pytest.raises(
        SimulationError, match=r"No trim exists at V = 80.*\n?.*At a limit: manifold_pressure = 37"
    ) as error:
        published_aircraft("beaver").trim(80.0, 600.0, climb=0.3)
    assert error.value.partial.controls["manifold_pressure"] == pytest.approx(37.0)
    with pytest.raises(SimulationError, match="No trim exists"):
        trim(DEMO, demo_aircraft(), 12.0, 1000.0)


def test_what_a_trim_cannot_be_asked_is_refused():
    published = published_aircraft("hfb320")
    with pytest.raises(ModelError, match="flies straight"):
        published.trim(turn_rate=0.1)
    with pytest.raises(DomainError, match="above zero"):
        published.trim(V=0.0)
    with pytest.raises(ModelError, match="three were given"):
        trim(DEMO, demo_aircraft(), 45.0, 0.0, bank=0.1, turn_rate=0.1, sideslip=0.0)
    with pytest.raises(ModelError, match="equations, and only"):
        trim(DEMO, demo_aircraft(), 45.0, 0.0, free=("de",))
    with pytest.raises(ModelError, match="'flaps' cannot be trimmed"):
        trim(DEMO, demo_aircraft(), 45.0, 0.0, free=("de", "da", "dr", "flaps"))


def test_a_trim_prints_what_it_found(trimmed):
    text = str(trimmed)
    assert "steady flight" in text
    assert "V 45 m/s   h 1000 m" in text
    assert "de" in text
    assert "found" in text
    assert set(trimmed.to_frame().columns) == set(trimmed.to_dict())
    with pytest.raises(ChannelError, match="no control 'flap'"):
        trimmed.inputs(CLOCK, flap=0.1)


# --- linear ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "axis"), [("beaver", "longitudinal"), ("hfb320", "longitudinal"), ("citation", "lateral")]
)
def test_small_departures_follow_the_linear_model(name, axis):
    published = published_aircraft(name)
    found = published.trim()
    shown = ("V", "alpha", "q", "az") if axis == "longitudinal" else ("beta", "p", "r", "phi", "ay")
    # The Beaver's axes are coupled, and its engine knows the altitude.
    states = ("u", "w", "q", "theta", "v", "p", "r", "phi", "h") if name == "beaver" else None
    linear = published.linearise(found, axis=axis, states=states, outputs=shown)
    size = 1e-4
    moving = "de" if axis == "longitudinal" else "dr"
    wave = size * np.sin(1.7 * CLOCK)
    exact = published.simulate(found.inputs(CLOCK, **{moving: wave}), start=found)
    zero = np.zeros(len(CLOCK))
    inputs = Recording("wave", CLOCK, {n: wave if n == moving else zero for n in linear.inputs})
    small = linear.simulate(inputs, hold="linear")
    for channel in shown:
        departure = exact[channel] - exact[channel][0]
        start = small[channel][0] - departure[0]
        assert_allclose(small[channel] - start, departure, atol=4e-3 * np.abs(departure).max(), err_msg=channel)


def test_modes_have_their_usual_names_and_order():
    published = published_aircraft("beaver")
    found = published.trim()
    assert published.linearise(found).modes().names == ("short period", "phugoid")
    assert published.linearise(found, axis="lateral").modes().names == ("roll", "Dutch roll", "spiral")
    hansa = published_aircraft("hfb320")
    modes = hansa.linearise(hansa.trim()).modes()
    # Lanchester: the phugoid's frequency is about sqrt(2) g / V.
    assert_allclose(modes.frequency[1], np.sqrt(2.0) * rb.G0 / 104.67, rtol=0.05)


def test_the_linear_model_is_that_of_textbook_derivatives():
    # HFB-320 about its trim: M_w, M_q and M_de of the definitions, thrust and speed derivatives apart.
    published = published_aircraft("hfb320")
    found = published.trim()
    linear = published.linearise(found, states=("q",), inputs=("de",))
    a = published.aircraft
    factor = 0.5 * 0.792 * 104.67**2 * a.S * a.cbar / a.inertia.Iy
    assert_allclose(linear.system.A[0, 0], factor * -34.707 * 1.215 / 104.67, rtol=1e-8)
    assert_allclose(linear.system.B[0, 0], factor * -1.5294, rtol=1e-8)


def test_an_axis_or_a_channel_that_is_none_is_refused(trimmed):
    for more, said in [
        ({"axis": "vertical"}, "axis='vertical'"),
        ({"states": ("speed",)}, "no state 'speed'"),
        ({"inputs": ("df",)}, "does not fly on 'df'"),
    ]:
        with pytest.raises(ModelError, match=said):
            linearise(DEMO, demo_aircraft(), trimmed, **more)
    with pytest.raises(ChannelError, match="no output 'lift'"):
        linearise(DEMO, demo_aircraft(), trimmed, outputs=("lift",))
