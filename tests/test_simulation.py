"""Simulated flights whose answer is known; instruments, air and actuators with the stated effect."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import structsel as ss
from structsel.aircraft import Aircraft
from structsel.candidates import Term
from structsel.coefficients import compute_coefficients
from structsel.demo.aircraft import TRUTH, demo_aircraft
from structsel.errors import (
    AircraftError,
    ChannelError,
    DataError,
    DomainError,
    ModelError,
    SimulationError,
    StructselWarning,
)
from structsel.model import AeroModel
from structsel.numerics.atmosphere import standard_atmosphere
from structsel.numerics.rigid_body import STATES
from structsel.refinement.nonlinear_flight import NonlinearFlight
from structsel.simulation import (
    PUBLISHED_AIRCRAFT,
    Actuator,
    Atmosphere,
    Gust,
    Instruments,
    Turbulence,
    published_aircraft,
    simulate,
    start_from,
)
from tests.models import DEMO, model_of

NONLINEAR = ("beaver", "hfb320", "citation")
CLOCK = np.arange(0.0, 10.0, 0.02)


def moved(start, t=CLOCK):
    """A manoeuvre in all three axes about a trim."""
    departures = {"de": 0.03 * np.sin(2.0 * t), "da": 0.05 * np.sin(1.5 * t), "dr": 0.04 * np.sin(t)}
    return start.inputs(t, **{name: wave for name, wave in departures.items() if name in start.controls})


# --- closed loop -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NONLINEAR)
def test_the_coefficients_of_a_simulated_flight_are_those_of_the_model(name):
    published = published_aircraft(name)
    found = published.trim()
    flight = published.simulate(moved(found), start=found)
    made = compute_coefficients(flight, published.aircraft)
    values = {**made.channels, **{n: flight[n] for n in published.definitions}}
    for response, expected in published.model.evaluate(values, outside="ignore").items():
        scale = np.abs(expected).max()
        assert_allclose(made[response], expected, atol=2e-9 * scale, rtol=0.0, err_msg=response)


def test_readings_at_the_instruments_give_the_coefficients_back(trimmed):
    flight = simulate(DEMO, demo_aircraft(), moved(trimmed), start=trimmed, instruments=Instruments())
    exact = simulate(DEMO, demo_aircraft(), moved(trimmed), start=trimmed)
    # The vane is 4.5 m out on the wing, the accelerometer above and ahead of the centre of gravity.
    assert np.abs(flight["alpha"] - exact["alpha"]).max() > 1e-3
    assert np.abs(flight["az"] - exact["az"]).max() > 0.05
    made = compute_coefficients(flight, demo_aircraft())
    inner = slice(5, -5)
    for response, expected in DEMO.evaluate(made, outside="ignore").items():
        # The rates were differentiated at 50 Hz by a rule of fourth order.
        assert_allclose(made[response][inner], expected[inner], atol=1e-4 * max(np.ptp(expected), 0.1))


def test_rotor_thrust_line_and_burning_fuel_are_allowed_for_in_both_directions(trimmed):
    content = demo_aircraft().to_dict() | {"engine": {"angular_momentum": 150.0}}
    aircraft = Aircraft.from_dict(content)
    flight = simulate(DEMO, aircraft, {**moved(trimmed), "fuel_flow": 2.0}, start=trimmed)
    assert_allclose(flight["mass"], 2288.231 - 2.0 * CLOCK, rtol=1e-12)
    made = compute_coefficients(flight, aircraft)
    for response, expected in DEMO.evaluate(made, outside="ignore").items():
        assert_allclose(made[response], expected, atol=2e-9)


def test_a_model_identified_from_its_own_flight_is_the_model(trimmed):
    flight = simulate(DEMO, demo_aircraft(), moved(trimmed), start=trimmed)
    made = compute_coefficients(flight, demo_aircraft())
    X = np.column_stack([Term(term).evaluate(made) for term in TRUTH["Cm"]])
    assert_allclose(np.linalg.lstsq(X, made["Cm"], rcond=None)[0], list(TRUTH["Cm"].values()), rtol=1e-5)


def test_a_simulation_continues_from_any_of_its_samples(trimmed):
    inputs = moved(trimmed)
    complete = simulate(DEMO, demo_aircraft(), inputs, start=trimmed)
    rest = simulate(DEMO, demo_aircraft(), complete.between(4.0, 10.0))
    for name in ("V", "alpha", "q", "phi", "h", "ax"):
        assert_allclose(rest[name], complete[name][200:], atol=1e-9)
    read = simulate(DEMO, demo_aircraft(), inputs, start=trimmed, instruments=Instruments())
    again = simulate(DEMO, demo_aircraft(), read.between(4.0, 10.0))
    # Air data read at the vane were carried to the centre of gravity.
    assert_allclose(again["alpha"], complete["alpha"][200:], atol=1e-9)


def test_refinement_and_resimulation_start_at_the_centre_of_gravity(trimmed):
    inputs = moved(trimmed)
    complete = simulate(DEMO, demo_aircraft(), inputs, start=trimmed)
    read = simulate(DEMO, demo_aircraft(), inputs, start=trimmed, instruments=Instruments()).between(4.0, 10.0)
    truth = [complete[name][200] for name in STATES]
    assert_allclose(list(start_from(DEMO, demo_aircraft(), read).values()), truth, atol=1e-9)
    flight = NonlinearFlight(DEMO, demo_aircraft())
    refined = dict(zip(flight.states, flight.first_state(read)))
    assert_allclose(list(refined.values()), [complete[name][200] for name in refined], atol=1e-9)
    # Without lateral coefficients there is no sideslip, and the airspeed is the recorded one.
    longitudinal = AeroModel({name: DEMO[name] for name in ("CX", "CZ", "Cm")})
    start = start_from(longitudinal, demo_aircraft(), complete.between(4.0, 10.0))
    assert [start[name] for name in ("v", "p", "r", "phi")] == [0.0] * 4
    assert_allclose(np.hypot(start["u"], start["w"]), complete["V"][200], rtol=1e-12)


# --- air -------------------------------------------------------------------------------------------------------


def test_a_steady_wind_carries_the_aircraft_and_leaves_its_motion_through_the_air(trimmed):
    inputs = moved(trimmed)
    calm = simulate(DEMO, demo_aircraft(), inputs, start=trimmed)
    windy = simulate(DEMO, demo_aircraft(), inputs, start=trimmed, air=Atmosphere(wind=(6.0, -4.0, 0.0)))
    for name in ("V", "alpha", "beta", "p", "theta", "h", "az"):
        assert_allclose(windy[name], calm[name], atol=1e-9)
    assert_allclose(windy["x"] - calm["x"], 6.0 * CLOCK, atol=1e-8)
    assert_allclose(windy["ve"] - calm["ve"], -4.0, atol=1e-10)


def test_a_gust_is_met_by_the_air_data_before_the_aircraft_moves(trimmed):
    gust = Gust("w", -3.0, start=1.0, duration=0.4)
    flight = simulate(DEMO, demo_aircraft(), trimmed.inputs(CLOCK), start=trimmed, air=Atmosphere(gusts=(gust,)))
    met = simulate(DEMO, demo_aircraft(), trimmed.inputs(CLOCK), start=trimmed)["w"][0] + 3.0
    k = 60  # t = 1.2 s, the middle of the gust
    assert_allclose(flight["w"][k], met, atol=0.6)
    assert flight["az"][k] < flight["az"][0] - 2.0  # lifted
    assert_allclose(flight["h"][51], 1000.0, atol=1e-2)
    made = compute_coefficients(flight, demo_aircraft())
    for response in ("CX", "CZ", "Cm"):
        assert_allclose(made[response], DEMO[response].evaluate(made), atol=2e-9)


def test_turbulence_is_drawn_by_its_seed_and_shakes_the_aircraft(trimmed):
    def fly(seed, W20=7.7):
        air = Atmosphere(turbulence=Turbulence(W20, seed=seed))
        return simulate(DEMO, demo_aircraft(), trimmed.inputs(CLOCK), start=trimmed, air=air)

    one, same, other = fly(1), fly(1), fly(2)
    assert_array_equal(one["az"], same["az"])
    assert np.abs(one["az"] - other["az"]).max() > 0.5
    assert np.std(fly(1, W20=0.77)["az"]) == pytest.approx(np.std(one["az"]) / 10.0, rel=0.1)
    assert np.std(one["p"]) > 1e-3


def test_warmer_air_is_thinner_and_a_given_density_is_kept(trimmed):
    warm = simulate(DEMO, demo_aircraft(), trimmed.inputs(CLOCK), start=trimmed, air=Atmosphere(isa_offset=20.0))
    temperature, _, rho, sound = standard_atmosphere(1000.0)
    assert_allclose(warm["rho"][0], rho * temperature / (temperature + 20.0), rtol=1e-12)
    assert_allclose(45.0 / warm["mach"][0], sound * np.sqrt((temperature + 20.0) / temperature), rtol=1e-12)
    held = simulate(DEMO, demo_aircraft(), trimmed.inputs(CLOCK), start=trimmed, air=Atmosphere(rho=0.9))
    assert_array_equal(held["rho"], 0.9)


def test_a_sheared_wind_blows_from_its_direction_with_its_speed_at_the_reference_height():
    for law in ("power", "log"):
        air = Atmosphere.sheared(8.0, np.pi / 2, law=law, ground=100.0)
        at = [np.interp(110.0, air.heights, air.wind[:, j]) for j in range(3)]
        assert_allclose(at, [0.0, -8.0, 0.0], atol=0.01)
        assert_allclose(air.wind[0], 0.0, atol=1e-12)
    with pytest.raises(DomainError, match="no wind law 'cubic'"):
        Atmosphere.sheared(8.0, 0.0, law="cubic")
    with pytest.raises(DomainError, match="ascending"):
        Atmosphere(wind=[[0, 0, 0], [1, 0, 0]], heights=[10.0, 5.0])
    with pytest.raises(DomainError, match="axes are u, v and w"):
        Gust("x", 1.0, 0.0, 1.0)


# --- instruments and actuators -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def read(trimmed):
    def fly(**faults):
        return simulate(DEMO, demo_aircraft(), moved(trimmed), start=trimmed, instruments=Instruments(**faults))

    return fly


def test_every_fault_does_what_it_says_and_nothing_else(read):
    plain = read()
    assert_allclose(read(bias={"az": 0.3})["az"], plain["az"] + 0.3, rtol=1e-14)
    assert_allclose(read(scale={"q": 0.02})["q"], 1.02 * plain["q"], rtol=1e-14)
    delayed = read(delay={"p": 0.06})["p"]
    assert_allclose(delayed[3:], plain["p"][:-3], atol=1e-12)
    assert_allclose(delayed[:3], plain["p"][0], atol=1e-12)
    coarse = read(resolution={"theta": 0.01})["theta"]
    assert_allclose(coarse / 0.01, np.round(coarse / 0.01), atol=1e-9)
    assert np.abs(coarse - plain["theta"]).max() <= 0.005 + 1e-12
    noisy = read(noise={"V": 0.2})["V"] - plain["V"]
    assert abs(noisy.std() / 0.2 - 1.0) < 0.1
    assert_allclose(read(vanes={"KV": 0.03})["V"], 1.03 * plain["V"], rtol=1e-12)
    exact_alpha = plain["alpha"]
    assert_allclose(read(vanes={"Calpha0": 0.01})["alpha"], exact_alpha + 0.01, rtol=1e-12)
    faulty = read(bias={"az": 0.3}, noise={"V": 0.2}, delay={"p": 0.06})
    for name in ("alpha", "beta", "r", "h", "de"):
        assert_array_equal(faulty[name], plain[name])


def test_the_noise_of_one_channel_does_not_depend_on_that_of_another(read):
    alone, both = read(noise={"V": 0.2}, seed=3), read(noise={"V": 0.2, "q": 0.01}, seed=3)
    assert_array_equal(alone["V"], both["V"])
    assert np.abs(read(noise={"V": 0.2}, seed=4)["V"] - alone["V"]).max() > 0.1


def test_noise_is_the_aircrafts_own_where_it_states_it(trimmed):
    content = demo_aircraft().to_dict()
    content["sensors"]["vane"]["noise"] = {"V": 0.3}
    aircraft = Aircraft.from_dict(content)
    instruments = Instruments.of(aircraft, seed=2)
    assert dict(instruments.noise) == {"V": 0.3}
    noisy = simulate(DEMO, aircraft, moved(trimmed), start=trimmed, instruments=instruments)
    plain = simulate(DEMO, aircraft, moved(trimmed), start=trimmed, instruments=Instruments())
    assert abs((noisy["V"] - plain["V"]).std() / 0.3 - 1.0) < 0.1


def test_instruments_that_cannot_be_are_refused(read):
    with pytest.raises(ChannelError, match=r"fault of 'alpah'.*Did you mean 'alpha'"):
        read(bias={"alpah": 0.1})
    with pytest.raises(DomainError, match="noise of 'V' is -1"):
        Instruments(noise={"V": -1.0})
    with pytest.raises(DomainError, match="no vane error 'Cdown'"):
        Instruments(vanes={"Cdown": 0.1})


def test_with_actuators_the_inputs_are_commands(trimmed):
    command = trimmed.inputs(CLOCK, de=np.where(CLOCK >= 1.0, 0.05, 0.0))
    actuator = Actuator(lag=0.1, rate=0.3)
    flight = simulate(
        DEMO, demo_aircraft(), command, start=trimmed, actuators={"de": actuator}, between="hold"
    )  # fmt: skip
    assert_allclose(flight["de"], actuator.follow(CLOCK, command["de"], hold=True), rtol=1e-14)
    assert np.diff(flight["de"]).max() < 0.3 * 0.02 + 1e-9
    with pytest.raises(ChannelError, match="actuator for 'df'"):
        simulate(DEMO, demo_aircraft(), command, start=trimmed, actuators={"df": actuator})


# --- bad input ---------------------------------------------------------------------------------------------------


def test_an_unstable_aircraft_that_blows_up_says_when_and_hands_over_the_flight_so_far(trimmed):
    truth = {name: dict(terms) for name, terms in TRUTH.items()}
    truth["Cm"]["alpha"] = 25.0
    with pytest.raises(SimulationError, match=r"beyond t = .* s \(sample \d+ of 500\)") as error:
        simulate(model_of(truth), demo_aircraft(), moved(trimmed), start=trimmed)
    partial = error.value.partial
    assert 10 < len(partial) < 500
    assert all(np.isfinite(partial[name]).all() for name in partial.names)


def test_what_a_flight_lacks_is_named(trimmed):
    inputs = trimmed.inputs(CLOCK)
    del inputs["dr"]
    start = {"V": 45.0, "alpha": 0.14, "theta": 0.14, "h": 1000.0}
    with pytest.raises(ChannelError, match=r"flies on 'dr'; 'simulated' has none"):
        simulate(DEMO, demo_aircraft(), inputs, start=start)
    full = trimmed.inputs(CLOCK)
    with pytest.raises(ChannelError, match="needs a start"):
        simulate(DEMO, demo_aircraft(), full)
    with pytest.raises(ChannelError, match="lacks h"):
        simulate(DEMO, demo_aircraft(), full, start={"V": 45.0, "alpha": 0.1, "theta": 0.1})
    with pytest.raises(ChannelError, match="no 'speed'"):
        simulate(DEMO, demo_aircraft(), full, start={**start, "speed": 3.0})
    with pytest.raises(ChannelError, match="clock 't'"):
        simulate(DEMO, demo_aircraft(), {"de": 0.0}, start=start)
    bad = np.array(full["de"] + np.zeros(len(CLOCK)))
    bad[3] = np.nan
    with pytest.raises(DataError, match="'de' is nan at sample 3"):
        simulate(DEMO, demo_aircraft(), {**full, "de": bad}, start=start)
    with pytest.raises(DataError, match="shape"):
        simulate(DEMO, demo_aircraft(), {**full, "de": np.zeros(4)}, start=start)
    with pytest.raises(DataError, match="fuel flow exceeds"):
        simulate(DEMO, demo_aircraft(), {**full, "fuel_flow": 1e4}, start=start)
    massless = {k: v for k, v in demo_aircraft().to_dict().items() if k != "mass"}
    with pytest.raises(AircraftError, match="needs a mass"):
        simulate(DEMO, Aircraft.from_dict(massless), full, start=start)
    with pytest.raises(ModelError, match="between='spline'"):
        simulate(DEMO, demo_aircraft(), full, start=start, between="spline")


def test_a_term_in_what_the_flight_makes_is_refused(trimmed):
    for term in ("ax", "q_dot", "CL"):
        with pytest.raises(ModelError, match=f"depends on '{term}'"):
            simulate(model_of({"Cm": {term: 1.0}}), demo_aircraft(), trimmed.inputs(CLOCK), start=trimmed)


def test_leaving_the_region_simulated_is_said(trimmed):
    narrow = model_of(TRUTH, ranges={"alpha": (0.14, 0.15), "q_hat": (-1e-4, 1e-4)})
    with pytest.warns(StructselWarning, match=r"leaves the ranges.*alpha.*q_hat"):
        simulate(narrow, demo_aircraft(), moved(trimmed), start=trimmed)
    with pytest.raises(ModelError, match="leaves the ranges"):
        simulate(narrow, demo_aircraft(), moved(trimmed), start=trimmed, outside="raise")


def test_thrust_may_be_defined_by_a_formula(trimmed):
    inputs = trimmed.inputs(CLOCK)
    thrust = inputs.pop("thrust")
    start = dict(zip(("u", "v", "w", "p", "q", "r", "phi", "theta", "psi", "x", "y", "h"), trimmed.state))
    defined = simulate(
        DEMO, demo_aircraft(), {**inputs, "throttle": thrust / 4000.0}, start=start,
        definitions={"thrust": "4000*throttle"},
    )  # fmt: skip
    given = simulate(DEMO, demo_aircraft(), {**inputs, "thrust": thrust}, start=start)
    assert_allclose(defined["V"], given["V"], rtol=1e-14)
    assert_allclose(defined["thrust"], thrust, rtol=1e-14)


# --- the library -------------------------------------------------------------------------------------------------


def test_every_published_aircraft_is_available_and_has_a_description():
    for name in PUBLISHED_AIRCRAFT:
        published = published_aircraft(name)
        assert published.name == name
        assert str(published)
        assert (published.model is None) == bool(published.linear)
    with pytest.raises(ModelError, match=r"no published aircraft 'beavr'. Did you mean 'beaver'.*hfb320"):
        published_aircraft("beavr")
    with pytest.raises(ModelError, match="only linear ones of 'hawk'"):
        published_aircraft("hawk").trim()


def test_the_beavers_engine_and_slipstream_are_as_published():
    # 76 kW at 45 m/s and sea level gives dpt 0.35; 20 inHg and 1800 rpm give those 76 kW.
    published = published_aircraft("beaver")
    found = published.trim(45.0, 0.0, climb=None, controls={"manifold_pressure": 20.0})
    flight = published.simulate(found.inputs(CLOCK[:5]), start=found)
    assert_allclose(flight["power"][0], 76.2, atol=0.1)
    assert_allclose(flight["dpt"][0], 0.35, atol=0.005)


def test_the_old_names_work_with_a_warning_for_one_release():
    with pytest.warns(DeprecationWarning, match="use Atmosphere"):
        air = ss.Air
    assert air is Atmosphere
    with pytest.warns(DeprecationWarning, match="use published_aircraft"):
        assert ss.ready("beaver").name == published_aircraft("beaver").name
    with pytest.warns(DeprecationWarning, match="use PublishedAircraft"):
        assert isinstance(published_aircraft("hawk"), ss.ReadyAircraft)
    with pytest.warns(DeprecationWarning, match="use isa_offset"):
        warm = Atmosphere(warmer=20.0)
    with pytest.warns(DeprecationWarning, match="use isa_offset"):
        assert warm.warmer == warm.isa_offset == 20.0
