"""Effects where a simulation states channels of a plant or a vehicle, not aerodynamic coefficients."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lfilter, lsim

from structsel import diagnose
from structsel.aircraft import Aircraft
from structsel.comparison.flight import prepare_flight
from structsel.comparison.plant import find_plant, find_plants
from structsel.comparison.preparing import prepare
from structsel.effects import EFFECTS
from structsel.effects.moving_air import channels_in_wind
from structsel.recording import Recording
from tests.channel_simulations import fixed_wing, joint, quadrotor, ship, wandering
from tests.effect_fits import best, check_all, effect_named, explain

LOGGED = Aircraft(name="uav", S=0.4, b=1.6, cbar=0.24, mass=3.3)


def steady(north, east):
    return lambda t, k: np.outer(np.ones(len(t)), [north, east, 0.0])


def sine(t, k):
    """A fan along north: 3 m/s, 0.15 Hz, of another phase in each recording."""
    return np.outer(3.0 * np.sin(2.0 * np.pi * 0.15 * t + k), [1.0, 0.0, 0.0])


def compared(case, aircraft=None):
    simulated, recordings = case
    return prepare(simulated, recordings, aircraft).flights


@pytest.mark.parametrize(
    ("stated", "angle", "force"),
    [("current", True, 0.6), ("current", False, 0.6), ("acceleration", True, 3.0), ("acceleration", False, 3.0)],
)
def test_dry_friction_of_a_joint_is_found_along_its_recorded_rate(stated, angle, force):
    # 0.6 in units of the current; over the inertia of 0.2 where an acceleration is stated.
    flights = compared(joint(stated, angle=angle))
    found = best(flights, effect_named("friction"))
    assert "dry friction" in found.variant.about
    assert found.explained > 0.9
    assert_allclose(found.values["force"], force, rtol=0.15)


def test_the_motion_of_a_joint_is_in_other_channels_than_its_response():
    plant = find_plant(compared(joint("current")), "current")
    assert (plant.along, plant.sense) == (("angle", "rate"), 1.0)
    plant = find_plant(compared(joint("acceleration")), "acceleration")
    assert (plant.along, plant.sense) == (("angle", "rate"), -1.0)
    # Rate and acceleration alone are speed and acceleration, or displacement and speed: both are tried.
    assert {p.along for p in find_plants(compared(joint("current", angle=False)), "current")} == {
        ("", "rate"),
        ("rate", "acceleration"),
    }


@pytest.mark.parametrize("effect", ["stiffening", "mechanical-hysteresis", "friction"])
def test_a_response_never_explains_itself(effect):
    # A force and an acceleration whose difference is a cube of their own values, without a recorded motion.
    dt, n = 0.02, 900
    t = dt * np.arange(n)
    flights = []
    for seed in (3, 4):
        rng = np.random.default_rng(seed)
        y = wandering(rng, n, dt, 0.1)
        other = wandering(rng, n, dt, 0.3)
        stated = y - 0.1 * y**3
        channels = {"force": y, "other": other}
        record = Recording(f"m{seed}", t, channels, units=dict.fromkeys(channels, "?"))
        flights.append(prepare_flight(record, LOGGED, {"force": stated}))
    assert effect_named(effect).variants(flights) == []


def test_a_force_acts_through_the_past_of_a_response_behind_inertia():
    # y'' + 0.6 y' + 25 y = u: the displacement is the response, and a force reaches it through the inertia.
    dt, n = 0.02, 900
    t = dt * np.arange(n)
    u = wandering(np.random.default_rng(3), n, dt, 0.1)
    y = lsim(([1.0], [1.0, 0.6, 25.0]), u, t)[1]
    record = Recording("m0", t, {"u": u, "y": y}, units={"u": "?", "y": "?"})
    flights = [prepare_flight(record, LOGGED, {"y": y})]
    plant = find_plant(flights, "y")
    assert plant.along is None
    assert plant.pushes_back
    impulse = lfilter(plant.b, plant.a, np.eye(1, 200)[0])
    # Of a value of the response, hardly anything acts on that value itself: dt^2 / 6 beside dt / 5.
    assert_allclose(impulse[0], dt**2 / 6.0, rtol=0.05)
    assert abs(impulse[0]) < 0.03 * np.abs(impulse).max()
    assert effect_named("stiffening").variants(flights)


def test_the_yawing_moment_of_a_ship_lacks_a_term():
    found = best(compared(ship()), effect_named("missing-term"))
    assert found.variant.terms == ("yaw_rate*abs(yaw_rate)",)
    assert_allclose(next(iter(found.values.values())), -3.0, rtol=0.05)


def test_a_still_air_quadrotor_finds_the_wind():
    flights = compared(quadrotor(steady(3.0, -2.0)))
    assert set(channels_in_wind(flights)) == {"ax", "ay", "az"}
    found = best(flights, effect_named("steady-wind"))
    assert found.explained > 0.95
    assert_allclose([found.values["north"], found.values["east"]], [3.0, -2.0], rtol=0.05)


def test_a_still_air_quadrotor_finds_a_wind_that_comes_and_goes():
    found = best(compared(quadrotor(sine)), effect_named("wind-shear"))
    assert found.explained > 0.95
    assert_allclose(found.variant.shape["frequency"], 0.15, atol=0.01)
    assert_allclose(found.values["north"], 3.0, rtol=0.05)
    # Crests of 3 sin(2 pi 0.15 t + k) are a quarter of a period after its zeros.
    crest = (np.pi / 2.0 - 1.0) / (2.0 * np.pi * 0.15)
    assert_allclose(found.variant.shape["time in m1"], crest, atol=0.15)


@pytest.mark.parametrize("stated", ["V", "vn"])
def test_a_fixed_wing_log_finds_the_wind(stated):
    flights = compared(fixed_wing(stated, steady(4.0, -3.0)), LOGGED)
    found = explain(flights, effect_named("steady-wind").variants(flights)[0])
    if stated == "V":
        assert found.explained > 0.95
        assert_allclose([found.values["north"], found.values["east"]], [4.0, -3.0], rtol=0.1)
    else:
        # A constant wind is a constant in the ground velocity, which this fit leaves out: the columns are constants.
        columns = found.variant.columns(flights[0])
        assert_allclose(columns["vn"], np.outer(np.ones(len(flights[0])), [1.0, 0.0]))
        assert_allclose(columns["ve"], np.outer(np.ones(len(flights[0])), [0.0, 1.0]))


def test_a_control_that_loses_its_power_is_found_in_accelerometers():
    flights = compared(elevator_log(lambda de: de - 0.3 * de * np.abs(de) / 0.3))
    found = best(flights, effect_named("control-nonlinearity"))
    assert found.explained > 0.95
    assert found.variant.words["control"] == "de"
    assert_allclose(found.values["de loss"], 0.3 * largest_of(flights) / 0.3, rtol=0.15)


def test_a_mode_that_a_control_excites_is_found_in_accelerometers():
    flights = compared(elevator_log(lambda de: de, mode=2.4))
    found = best(flights, effect_named("structural-mode"))
    assert found.explained > 0.8
    assert_allclose(found.variant.shape["frequency"], 2.4, rtol=0.05)


def largest_of(flights):
    return max(float(np.abs(f.raw["de"]).max()) for f in flights)


def elevator_log(power, mode=0.0):
    """Accelerometer of a vehicle that an elevator moves at once, with a mode [Hz] that the simulation lacks."""
    dt, n = 0.02, 1500
    t, simulated, recordings = dt * np.arange(n), {}, []
    for k in range(3):
        rng = np.random.default_rng(k)
        de, theta, phi = 0.1 * wandering(rng, n, dt, 0.15), *(0.1 * wandering(rng, n, dt, 1.0) for _ in range(2))
        az = -9.8 + 20.0 * power(de) + 5.0 * theta
        if mode:
            # Exact second-order response by zero-order hold, damping 2.5 %.
            w = 2.0 * np.pi * mode
            pole = np.exp(dt * w * complex(-0.025, np.sqrt(1.0 - 0.025**2)))
            a = [1.0, -2.0 * pole.real, abs(pole) ** 2]
            az = az + 4.0 * (lfilter([0.0, sum(a)], a, de) - de)
        recorded = {"de": de, "theta": theta, "phi": phi, "az": az + 0.02 * rng.standard_normal(n)}
        recordings.append(Recording(f"m{k}", t, recorded))
        simulated[f"m{k}"] = Recording(f"m{k}", t, {"az": -9.8 + 20.0 * de + 5.0 * theta})
    return simulated, recordings


@pytest.mark.parametrize(
    ("case", "aircraft", "effects"),
    [
        (joint("current"), None, ("friction", "structural-mode")),
        (quadrotor(steady(3.0, -2.0), 2), None, ("steady-wind", "wind-shear", "gust", "control-nonlinearity")),
        (fixed_wing("V", steady(4.0, -3.0), 2), LOGGED, ("steady-wind", "wind-shear", "gust")),
    ],
    ids=["joint", "quadrotor", "fixed-wing"],
)
def test_every_form_of_an_effect_on_channels_has_columns_and_a_sentence(case, aircraft, effects):
    flights = compared(case, aircraft)
    for effect in effects:
        if effect_named(effect).needs(flights) == "" and effect_named(effect).variants(flights):
            check_all(flights, effect_named(effect))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "aircraft", "effect"),
    [
        (lambda: joint("current"), None, "friction"),
        (lambda: joint("current", angle=False), None, "friction"),
        (lambda: joint("acceleration"), None, "friction"),
        (lambda: ship(), None, "missing-term"),
        (lambda: quadrotor(steady(3.0, -2.0)), None, "steady-wind"),
        (lambda: quadrotor(sine), None, "wind-shear"),
        (lambda: fixed_wing("V", steady(4.0, -3.0)), LOGGED, "steady-wind"),
        (lambda: elevator_log(lambda de: de - de * np.abs(de)), None, "control-nonlinearity"),
        (lambda: elevator_log(lambda de: de, mode=2.4), None, "structural-mode"),
        (lambda: joint("current", friction=0.0), None, ""),
        (lambda: joint("acceleration", friction=0.0), None, ""),
        (lambda: ship(cross_flow=0.0), None, ""),
        (lambda: quadrotor(steady(0.0, 0.0)), None, ""),
        (lambda: fixed_wing("V", steady(0.0, 0.0)), LOGGED, ""),
        (lambda: fixed_wing("vn", steady(0.0, 0.0)), LOGGED, ""),
        (lambda: elevator_log(lambda de: de), None, ""),
    ],
)
def test_a_diagnosis_names_what_simulated_channels_lack(case, aircraft, effect):
    simulated, recordings = case()
    found = diagnose(simulated, recordings, aircraft)
    assert [f.effect for f in found.findings][:1] == ([effect] if effect else [])


def test_effects_that_a_simulation_of_channels_can_lack_are_tested():
    flights = compared(fixed_wing("V", steady(4.0, -3.0), 2), LOGGED)
    tested = {e.name for e in EFFECTS if not e.needs(flights) and e.variants(flights)}
    assert {"steady-wind", "wind-shear", "gust", "wrong-derivative", "missing-term", "saturation"} <= tested
