"""Plants that are no aircraft: an electronic spring, a yielding joint, a quadrotor's motors, and made ones."""

import gzip
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.signal import lfilter, lsim

from structsel.comparison.flight import prepare_flight
from structsel.comparison.plant import find_plant
from structsel.comparison.tolerances import tolerances_of
from structsel.effects import plants
from structsel.numerics.dynamic_elements import first_order_lag
from structsel.recording import Recording
from tests.effect_fits import best, effect_named
from tests.exact_flights import AIRCRAFT, compare, fly

DATA = Path(__file__).parents[2] / "shared" / "data"
shared = pytest.mark.skipif(not DATA.exists(), reason="the shared recordings are not here")


def rig(parts, dt, response):
    """Flights of (input, measured, simulated)."""
    return [
        prepare_flight(
            Recording(f"m{k}", dt * np.arange(len(u)), {"u": u, response: y}, units={"u": "?", response: "?"}),
            AIRCRAFT,
            {response: stated},
        )
        for k, (u, y, stated) in enumerate(parts)
    ]


def linear_fit(u, y, samples=None):
    """Second-order model of y by least squares over its first samples, a user's linear simulation, run over all."""
    n = samples or len(y)
    rows = np.column_stack([-y[1 : n - 1], -y[: n - 2], u[2:n], u[1 : n - 1], u[: n - 2]])
    values = np.linalg.lstsq(rows, y[2:n], rcond=None)[0]
    return lfilter(values[2:], [1.0, *values[:2]], u)


def ranking(flights):
    """Fraction explained by each effect, best first."""
    tried = [*plants.EFFECTS, effect_named("actuator-lag")]
    found = {h.name: best(flights, h) for h in tried if h.variants(flights)}
    return sorted(found, key=lambda e: -found[e].explained), found


@shared
def test_the_silverbox_has_a_cubic_spring():
    with gzip.open(DATA / "silverbox" / "SNLS80mV.csv.gz", "rt") as file:
        u, y = np.loadtxt(file, delimiter=",", skiprows=1, usecols=(0, 1), max_rows=66000).T
    stated = linear_fit(u, y, 20000)  # of the gentle beginning
    cut = [slice(30000, 34000), slice(60000, 64000)]
    order, found = ranking(rig([(u[c], y[c], stated[c]) for c in cut], 2**14 / 1e7, "y"))
    assert order[0] == "stiffening"
    assert "cube" in found["stiffening"].variant.about
    assert found["stiffening"].explained > 0.95
    assert found["stiffening"].values["restoring"] > 0.0


@shared
def test_the_bouc_wen_joint_has_an_internal_state():
    with h5py.File(DATA / "boucwen" / "train.h5") as file:
        u, y = (np.ravel(file["multisine"][name]) for name in ("u", "y"))
    stated = linear_fit(u, y)
    cut = [slice(1000, 5000), slice(20000, 24000)]
    order, found = ranking(rig([(u[c], y[c], stated[c]) for c in cut], 1.0 / 750.0, "y"))
    assert order[0] == "mechanical-hysteresis"
    # The joint's own constants are not among those tried.
    assert found["mechanical-hysteresis"].explained > 0.85
    assert found[order[1]].explained < 0.7


@shared
def test_the_motors_of_the_crazyflie_come_delayed():
    log = np.load(DATA / "crazyflie" / "log10.npz")
    t = np.arange(8.7, 38.7, 0.004)
    az = np.interp(t, log["t_s"], np.convolve(log["acc_g"][:, 2], np.ones(4) / 4.0, "same"))
    w = np.column_stack([np.interp(t, log["t_s"], x / 65535.0) for x in log["motor_pwm"].T])
    thrust = np.column_stack([w.sum(axis=1), (w**2).sum(axis=1), np.ones(len(t))])
    stated = thrust @ np.linalg.lstsq(thrust, az, rcond=None)[0]
    cut = [slice(0, 3500), slice(3500, 7000)]
    order, found = ranking(rig([(w[c, 0], az[c], stated[c]) for c in cut], 0.004, "az"))
    assert order[0] == "actuator-lag"
    # The curve was fitted without the lag, so that it is a little flat: about 0.07 s by scanning it.
    delayed = found["actuator-lag"].values
    assert_allclose(next(iter(delayed.values())), 0.07, atol=0.015)


def mechanism(force, seed=3):
    """y'' + 0.6 y' + 25 y + force(y, y') = u, measured; the same without the force, simulated."""
    t, u = pushed(seed)
    free = lsim(([1.0], [1.0, 0.6, 25.0]), u, t)[1]
    return u, free if force is None else motion(t, u, force)[0], free


def pushed(seed):
    """Times and a rough input."""
    dt, n = 0.02, 900
    rng = np.random.default_rng(seed)
    return dt * np.arange(n), lfilter([0.2], [1.0, -0.8], rng.standard_normal(n)) * 20.0


def motion(t, u, force):
    """Displacement and speed of a mass on a spring and a damper, with a force against it."""

    def move(s, x):
        return [x[1], np.interp(s, t, u) - 0.6 * x[1] - 25.0 * x[0] - force(x[0], x[1])]

    return solve_ivp(move, (0.0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-6, atol=1e-9, max_step=2.0 * t[1]).y


@pytest.mark.parametrize(
    ("effect", "force", "name", "value"),
    [
        ("stiffening", lambda y, v: 60.0 * y**3, "restoring", 60.0),
        ("friction", lambda y, v: 1.5 * np.tanh(v / 0.1), "force", 1.5),
    ],
)
def test_a_force_added_to_the_input_is_found_in_the_input_s_unit(effect, force, name, value):
    flights = rig([mechanism(force, seed) for seed in (3, 4)], 0.02, "y")
    order, found = ranking(flights)
    assert order[0] == effect
    assert found[effect].explained > 0.97
    assert_allclose(found[effect].values[name], value, rtol=0.12)


@pytest.mark.parametrize(
    ("effect", "force", "name", "value"),
    [
        ("stiffening", lambda y, v: 60.0 * y**3, "restoring", 60.0),
        ("friction", lambda y, v: 1.5 * np.tanh(v / 0.1), "force", 1.5),
    ],
)
def test_a_force_is_found_in_the_acceleration_of_a_recorded_motion(effect, force, name, value):
    flights = []
    for seed in (3, 4):
        t, u = pushed(seed)
        y, v = motion(t, u, force)
        stated = u - 0.6 * v - 25.0 * y
        channels = {"u": u, "y": y, "v": v, "a": stated - force(y, v)}
        record = Recording(f"m{seed}", t, channels, units=dict.fromkeys(channels, "?"))
        flights.append(prepare_flight(record, AIRCRAFT, {"a": stated}))
    order, found = ranking(flights)
    assert order[0] == effect
    assert found[effect].explained > 0.97
    assert_allclose(found[effect].values[name], value, rtol=0.12)


def test_an_output_that_overflows_is_found_at_its_limit():
    u, _, stated = mechanism(None)
    limit = 0.6 * stated.max()
    flights = rig([(u, np.minimum(stated, limit), stated)], 0.02, "y")
    found = best(flights, effect_named("saturation"))
    assert found.explained > 0.99
    assert_allclose(found.variant.shape["limit"], limit, rtol=1e-6)
    assert_allclose(found.values["fraction"], 1.0, rtol=1e-6)


def test_an_output_that_clips_either_way_is_found_at_the_level_of_its_readings():
    u, _, stated = mechanism(None)
    limit = 0.5 * np.abs(stated).max()
    noise = 0.01 * limit * np.random.default_rng(0).standard_normal(len(u))
    flights = rig([(u, np.clip(stated, -limit, limit) + noise, stated)], 0.02, "y")
    found = best(flights, effect_named("saturation"))
    assert found.variant.about == "y, either side"
    assert_allclose(found.variant.shape["limit"], limit, rtol=0.01)


def two_tanks(seed, limit, spilled):
    """Level of the lower of two linear tanks whose upper one overflows, part of it into the lower one."""
    dt, tau = 1.0, (40.0, 60.0)
    rng = np.random.default_rng(seed)
    u = np.clip(np.repeat(rng.uniform(0.5, 5.5, 20), 50), 0.0, None)
    u = np.convolve(np.pad(u, 15, mode="edge"), np.hanning(31) / np.hanning(31).sum(), mode="valid")
    level = np.full((2, len(u)), u[0])
    for k in range(1, len(u)):
        upper = level[0, k - 1] + dt / tau[0] * (u[k - 1] - level[0, k - 1])
        over = max(upper - limit, 0.0) * tau[0] / dt
        level[0, k] = min(upper, limit)
        level[1, k] = level[1, k - 1] + dt / tau[1] * (level[0, k - 1] + spilled * over - level[1, k - 1])
    return u, level[1]


def test_a_state_that_overflows_between_input_and_response_is_found_with_its_limit():
    parts = []
    for seed in range(4):
        (u, measured), (_, stated) = two_tanks(seed, 3.5, 0.4), two_tanks(seed, np.inf, 0.0)
        parts.append((u, measured, stated))
    flights = rig(parts, 1.0, "y")
    assert_allclose(
        find_plant(flights, "y").time_constant(1.0), 49.0, rtol=0.05
    )  # the mean of 1/40 and 1/60 per second
    order, _ = ranking(flights)
    assert order[0] == "saturation"
    found = best(flights, effect_named("saturation"))
    assert found.variant.about == "between u and y"
    assert found.explained > 0.9
    assert_allclose(found.variant.shape["limit"], 3.5, rtol=0.15)
    # What swings is no row of lags.
    u, _, stated = mechanism(None)
    assert find_plant(rig([(u, stated, stated)], 0.02, "y"), "y").time_constant(0.02) == 0.0


def test_a_rotor_that_follows_late_is_told_from_its_actuator_by_nothing_but_the_name():
    t, u = pushed(3)
    stated = lfilter([0.1], [1.0, -0.9], u)
    measured = 0.9 * first_order_lag(stated, t[1], 0.08)
    record = Recording("m0", t, {"dlon": u, "y": measured}, units={"dlon": "?", "y": "?"})
    flights = [prepare_flight(record, AIRCRAFT, {"y": stated})]
    for effect in ("rotor-inflow-lag", "actuator-lag"):
        found = best(flights, effect_named(effect))
        assert found.explained > 0.998  # lags are tried in steps of 20 %
        assert_allclose(found.values["lag"], 0.08, rtol=0.05)
        assert_allclose(found.values["gain"], -0.1, rtol=0.1)


def test_the_linear_plant_is_found_from_its_input_and_output():
    u, _, stated = mechanism(None)
    plant = find_plant(rig([(u, stated, stated)], 0.02, "y"), "y")
    assert plant.source == "u"
    assert_allclose(plant.stiffness, 25.0, rtol=1e-3)
    poles = np.log(np.roots(plant.a)) / 0.02
    exact = np.roots([1.0, 0.6, 25.0])
    nearest = [np.abs(poles - e).min() for e in exact]
    assert_allclose(nearest, 0.0, atol=0.02)
    assert_allclose(plant.under(np.ones(100)), 0.0, atol=1e-12)


def test_coefficients_are_no_plants():
    flights = compare(fly())
    for h in plants.EFFECTS:
        assert "no coefficient" in h.needs(flights)


def test_a_stop_that_a_motion_runs_into_is_found_with_its_place():
    limit, stiff = 0.55, 250.0

    def stop(y, v):
        return stiff * np.sign(y) * np.maximum(np.abs(y) - limit, 0.0)

    saturation = effect_named("saturation")
    flights = rig([mechanism(stop, seed) for seed in (3, 4)], 0.02, "y")
    assert sum(bool((np.abs(f.measured["y"]) > limit).any()) for f in flights) == 2
    order, _ = ranking(flights)
    assert order[0] == "saturation"
    found = best(flights, saturation)
    assert "a stop" in found.variant.about
    assert found.explained > 0.9
    assert_allclose(found.variant.shape["limit"], limit, rtol=0.15)  # places tried are quantiles of what is reached


@pytest.mark.parametrize(("name", "wrong"), [("stiffness", (1.0, 0.6, 25.25)), ("damping", (1.0, 0.606, 25.0))])
@pytest.mark.parametrize("numerator", [[1.0], [1.0, 0.0]])  # its place, and its speed, which stands still at rest
def test_tolerances_of_a_plant_are_errors_of_its_stiffness_and_damping(name, wrong, numerator):
    t, u = pushed(3)
    stated, other = (lsim((numerator, list(a)), u, t)[1] for a in ((1.0, 0.6, 25.0), wrong))
    flights = rig([(u, stated, stated)], 0.02, "y")
    column = find_plant(flights, "y").errors(flights)[name][0]
    expected = other - stated  # of one in a hundred more
    assert np.corrcoef(column, expected)[0, 1] > 0.995
    assert_allclose(0.01 * column.std(), expected.std(), rtol=0.05)


def test_tolerances_of_an_acceleration_are_its_own_terms():
    t, u = pushed(3)
    y, v = motion(t, u, lambda y, v: 0.0)
    channels = {"u": u, "y": y, "v": v, "a": u - 0.6 * v - 25.0 * y}
    record = Recording("m0", t, channels, units=dict.fromkeys(channels, "?"))
    flights = [prepare_flight(record, AIRCRAFT, {"a": channels["a"]})]
    columns = find_plant(flights, "a").errors(flights)
    assert set(columns) == {"stiffness", "damping"}
    assert_allclose(columns["stiffness"][0].std(), 25.0 * y.std(), rtol=0.02)
    assert_allclose(columns["damping"][0].std(), 0.6 * v.std(), rtol=0.1)  # channels are smoothed
    made = [n.name for n in tolerances_of(flights)]
    assert made == ["a: scale", "a: stiffness", "a: damping"]
