"""Which states, biases and winds a set of sensors and a manoeuvre can determine."""

import time
import tracemalloc
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import CubicSpline

from structsel.demo import demo_instruments
from structsel.errors import DomainError
from structsel.numerics.kinematics import MEASUREMENTS, SCALE
from structsel.numerics.kinematics import STATES as FULL
from structsel.reconstruction.kinematics_problem import KinematicsProblem
from structsel.reconstruction.observability import reconstructibility
from structsel.reconstruction.ukf import ukf_smoother

G = 9.80665
NOISE = np.array([0.2, 2e-3, 2e-3, 2e-3, 2e-3, 2e-3, 0.5, 1.0, 1.0, 0.05, 0.05, 0.05])
INPUT_NOISE = np.array([0.02] * 3 + [5e-4] * 3)
STATES = FULL[:SCALE]  # gusts are never requested: they are noise, if slow
PRIOR = dict(zip(STATES, [2.0] * 3 + [0.1, 0.1, 0.5] + [10.0] * 3 + [0.3] * 3 + [0.01] * 3 + [10.0, 10.0, 1.0]))
PRIOR |= {"Cup": 0.1, "Calpha0": 0.02, "Csi": 0.1, "Cbeta0": 0.02, "KV": 0.05}
AIR, ATTITUDE, HEADING = ("V", "alpha", "beta", "h"), ("phi", "theta"), ("psi",)
POSITION, VELOCITY = ("x", "y"), ("vn", "ve", "vd")
EVERYTHING = tuple(name for name in STATES if name != "Cbeta0")


def make_problem(t, inputs, readings, start, sensors, states, place=None):
    measurements = np.full((len(t), 12), np.nan)
    for name in sensors:
        measurements[:, MEASUREMENTS.index(name)] = readings[name]
    return KinematicsProblem(
        t=t,
        inputs=inputs,
        input_std=np.tile(INPUT_NOISE, (len(t), 1)),
        measurements=measurements,
        measurement_std=NOISE,
        start=start,
        start_std=np.array([PRIOR[name] for name in states]),
        active=np.array([STATES.index(name) for name in states]),
        drift=np.zeros(34),
        place=np.zeros((6, 3)) if place is None else place,
        flank=False,
        g=G,
    )


@cache
def demo(which, exact):
    return demo_instruments(which, 3, errors={} if exact else None, noise=0.0 if exact else 1.0)


def demo_problem(which, sensors, states=EVERYTHING, *, exact=False):
    flight = demo(which, exact)
    seen, truth = flight.measured, flight.truth
    t = np.asarray(seen.t)
    rates = [CubicSpline(t, seen[name]).derivative()(t) if exact else truth[f"{name}_dot"] for name in "pqr"]
    inputs = np.column_stack([*(seen[name] for name in ("ax", "ay", "az", "p", "q", "r")), *rates])
    start = np.zeros(34)
    start[:9] = [truth[name][0] for name in STATES[:9]]
    where = ("accelerometer", "vane", "vane", "vane", "static", "gps")
    place = np.array([flight.aircraft.position(name) for name in where])
    return make_problem(t, inputs, seen, start, sensors, states, place)


def prescribed(kind, seconds=40.0, rate=25.0):
    """Inputs and readings of a flight whose airspeed and angles are given functions of time."""
    t = np.arange(round(seconds * rate) + 1) / rate
    one = np.ones_like(t)
    angles = {"V": 45.0 * one, "alpha": 0.06 * one, "beta": 0.0 * one}
    angles |= {"phi": 0.0 * one, "theta": 0.06 * one, "psi": 0.6 * one}
    if kind == "turning":
        angles["phi"] = 0.5 * one
        angles["psi"] = 0.6 + G * np.tan(0.5) / 45.0 * t
    if kind == "lively":
        angles["V"] = 45.0 + 3.0 * np.sin(0.4 * t)
        angles["alpha"] = 0.06 + 0.04 * np.sin(1.3 * t)
        angles["beta"] = 0.05 * np.sin(0.9 * t + 1.0)
        angles["phi"] = 0.5 * np.sin(0.5 * t)
        angles["theta"] = 0.06 + 0.08 * np.sin(0.7 * t)
        angles["psi"] = 0.6 + 0.4 * np.sin(0.2 * t)
    V, alpha, beta, phi, theta, psi = angles.values()
    velocity = V * np.array([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)])
    turn = [CubicSpline(t, angle).derivative()(t) for angle in (phi, theta, psi)]
    p = turn[0] - turn[2] * np.sin(theta)
    q = turn[1] * np.cos(phi) + turn[2] * np.cos(theta) * np.sin(phi)
    r = -turn[1] * np.sin(phi) + turn[2] * np.cos(theta) * np.cos(phi)
    gravity = G * np.array([-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)])
    omega = np.array([p, q, r])
    force = CubicSpline(t, velocity, axis=1).derivative()(t) + np.cross(omega, velocity, axis=0) - gravity
    inputs = np.vstack([force, omega, np.zeros((3, len(t)))]).T
    start = np.zeros(34)
    start[:9] = [*velocity[:, 0], phi[0], theta[0], psi[0], 0.0, 0.0, 1000.0]
    return t, inputs, start


def textbook_slope(X, a):
    """[M86]'s kinematics written out once more, columns of X side by side."""
    u, v, w, phi, theta = X[:5]
    fx, fy, fz, p, q, r = a[:6, None] - X[9:15]
    s, c, t = np.sin, np.cos, np.tan
    out = np.zeros_like(X)
    out[0] = fx - G * s(theta) - q * w + r * v
    out[1] = fy + G * c(theta) * s(phi) - r * u + p * w
    out[2] = fz + G * c(theta) * c(phi) - p * v + q * u
    out[3] = p + (q * s(phi) + r * c(phi)) * t(theta)
    out[4] = q * c(phi) - r * s(phi)
    out[5] = (q * s(phi) + r * c(phi)) / c(theta)
    out[6:9] = textbook_ground(X) * np.array([1.0, 1.0, -1.0])[:, None]
    return out


def textbook_ground(X):
    """North, east and down over the ground."""
    u, v, w, phi, theta, psi = X[:6]
    s, c = np.sin, np.cos
    roll = (u, v * c(phi) - w * s(phi), v * s(phi) + w * c(phi))
    pitch = (roll[0] * c(theta) + roll[2] * s(theta), roll[1], -roll[0] * s(theta) + roll[2] * c(theta))
    return np.array([pitch[0] * c(psi) - pitch[1] * s(psi), pitch[0] * s(psi) + pitch[1] * c(psi), pitch[2]]) + X[15:18]


def textbook_readings(X):
    u, v, w = X[:3]
    V, alpha = np.sqrt(u * u + v * v + w * w), np.arctan(w / u)
    beta = np.arcsin(v / V)
    air = [(1.0 + X[22]) * V, (1.0 + X[18]) * alpha + X[19], (1.0 + X[20]) * beta + X[21]]
    return np.vstack([air, X[3:6], X[8:9], X[6:8], textbook_ground(X)])


def textbook_flight(t, inputs, starts):
    """(n, 12, k) readings of k flights from columns of starts, by Runge and Kutta."""
    X, out = starts.copy(), [textbook_readings(starts)]
    for k in range(1, len(t)):
        dt, middle = t[k] - t[k - 1], 0.5 * (inputs[k - 1] + inputs[k])
        k1 = textbook_slope(X, inputs[k - 1])
        k2 = textbook_slope(X + 0.5 * dt * k1, middle)
        k3 = textbook_slope(X + 0.5 * dt * k2, middle)
        k4 = textbook_slope(X + dt * k3, inputs[k])
        X = X + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        out.append(textbook_readings(X))
    return np.array(out)


def brute_force(t, inputs, start, sensors, states):
    """Whitened, prior-scaled sensitivities by flying again from every start moved a little."""
    steps = np.array([1e-3 * PRIOR[name] for name in states])
    moves = np.zeros((34, len(states)))
    moves[[STATES.index(name) for name in states], np.arange(len(states))] = steps
    simulated = textbook_flight(t, inputs, start[:, None] + np.hstack([moves, -moves]))
    J = (simulated[:, :, : len(states)] - simulated[:, :, len(states) :]) / (2.0 * steps)
    kept = [MEASUREMENTS.index(name) for name in sensors]
    scaled = J[:, kept] / NOISE[kept, None] * [PRIOR[name] for name in states]
    return scaled.reshape(-1, len(states))


def given(kind, sensors, states=EVERYTHING, **flight):
    t, inputs, start = prescribed(kind, **flight)
    readings = dict(zip(MEASUREMENTS, textbook_flight(t, inputs, start[:, None])[:, :, 0].T))
    return make_problem(t, inputs, readings, start, sensors, states)


SENSOR_SETS = {
    "air data": (AIR, {"psi", "x", "y", "wn", "we"}),
    "and attitude": (AIR + ATTITUDE, {"psi", "x", "y", "wn", "we"}),
    "and heading": (AIR + ATTITUDE + HEADING, {"x", "y", "wn", "we"}),
    "and position": (AIR + ATTITUDE + HEADING + POSITION, set()),
    "and ground velocity": (AIR + ATTITUDE + HEADING + VELOCITY, {"x", "y"}),
    "position, no heading": (AIR + ATTITUDE + POSITION, set()),
    "ground velocity, no heading": (AIR + ATTITUDE + VELOCITY, {"x", "y"}),
    "position north only": (AIR + ATTITUDE + HEADING + ("x",), {"y", "we"}),
}


@pytest.mark.default_cases(4)
@pytest.mark.parametrize("flight", ["lively", "all-axes"])
@pytest.mark.parametrize("sensors", SENSOR_SETS)
def test_each_sensor_set_fixes_only_the_states_it_cannot_determine(flight, sensors):
    channels, lost = SENSOR_SETS[sensors]
    make = given if flight == "lively" else demo_problem
    found = reconstructibility(make(flight, channels, STATES))
    assert set(found.fixed) == lost | {"Cbeta0"}
    assert {name for name, verdict in found.verdicts.items() if verdict == "not reconstructible"} == set(found.fixed)
    assert found.active == tuple(name for name in STATES if name not in found.fixed)
    assert found.rank == len(EVERYTHING) - len(lost)
    assert found.undetermined == ()
    assert max(found.active_over_prior.values()) < 1.0 / 3.0
    # The remaining states are determined: requested alone, nothing more is fixed.
    again = reconstructibility(make(flight, channels, found.active))
    assert again.fixed == {}
    assert again.rank == len(found.active)


@pytest.mark.parametrize(("states", "why"), [(("wn", "we"), "wind from airspeed; record x, y or vn, ve")])
def test_a_fixed_state_names_the_sensor_that_would_determine_it(states, why):
    found = reconstructibility(given("lively", AIR))
    assert all(found.fixed[name].endswith(why) for name in states)
    assert found.fixed["psi"].endswith("record psi")
    assert found.fixed["x"] == "no position was sampled; record x"


def test_cbeta0_is_fixed_whatever_is_measured():
    found = reconstructibility(given("lively", MEASUREMENTS, STATES))
    assert tuple(found.fixed) == ("Cbeta0",)
    assert "never observable in flight [M86]" in found.fixed["Cbeta0"]
    assert found.verdicts["Cbeta0"] == "not reconstructible"


MOTION_AND_BIASES = STATES[:15]


@pytest.mark.parametrize(("kind", "lost"), [("straight", {"psi"}), ("turning", set())])
def test_wind_and_heading_separate_only_in_a_turn(kind, lost):
    # Straight, a crosswind and a drift angle give one track; turning, the wind stays and the drift does not.
    sensors = (*AIR, *ATTITUDE, *POSITION)
    found = reconstructibility(given(kind, sensors, (*MOTION_AND_BIASES, "wn", "we")))
    assert set(found.fixed) & {"psi", "wn", "we"} == lost
    if lost:
        # Of the pair it is the heading that goes: the wind along the track is known, and is not thrown away.
        assert "cannot be separated from" in found.fixed["psi"]
        assert {"wn", "we"} <= set(found.fixed["psi"].split(";")[0].replace(",", "").split())
    else:
        assert max(found.posterior_over_prior[name] for name in ("psi", "wn", "we")) < 1.0 / 3.0


@pytest.mark.parametrize(("kind", "lost"), [("straight", {"KV"}), ("turning", set())])
def test_wind_and_airspeed_scale_separate_only_in_a_turn(kind, lost):
    sensors = (*AIR, *ATTITUDE, *HEADING, *POSITION)
    found = reconstructibility(given(kind, sensors, (*MOTION_AND_BIASES, "wn", "we", "KV")))
    assert set(found.fixed) & {"KV", "wn", "we"} == lost
    if lost:
        # Faster air and a head wind give one track; the flight goes 34 degrees from north.
        (direction,) = [dict(zip(*pair)) for pair in found.confounded if "KV" in pair[0]]
        assert {"u", "wn"} <= set(direction)
        assert_allclose(direction["u"] * PRIOR["u"] * np.cos(0.6), -direction["wn"] * PRIOR["wn"], rtol=0.05)


LONGITUDINAL = ("u", "w", "theta", "h", "bax", "baz", "bq", "Calpha0", "Cup")


@pytest.mark.parametrize(
    ("sensors", "lost"),
    [
        (("V", "h"), {"Calpha0", "Cup"}),
        (("V", "theta", "h"), {"Calpha0", "Cup"}),
        (("V", "alpha", "h"), set()),
        (("V", "alpha", "theta", "h"), set()),
    ],
)
def test_a_longitudinal_flight_needs_a_vane_only_for_the_vane_s_own_errors(sensors, lost):
    found = reconstructibility(demo_problem("elevator-3211", sensors, LONGITUDINAL))
    assert set(found.fixed) == lost
    assert all(found.fixed[name] == "no angle-of-attack vane was sampled" for name in lost)


def test_in_steady_flight_the_offset_and_the_scale_of_the_vane_are_one():
    sensors = ("V", "alpha", "theta", "h")
    problem = given("straight", sensors, LONGITUDINAL)
    found = reconstructibility(problem)
    assert list(found.fixed) == ["Calpha0"]
    assert "Cup" in found.fixed["Calpha0"]
    other = reconstructibility(problem, fix_first=("Cup",))
    assert list(other.fixed) == ["Cup"]
    assert "Calpha0" in other.fixed["Cup"]


@pytest.mark.default_cases(1)
@pytest.mark.parametrize("seed", range(5))
def test_vane_noise_is_not_taken_for_excitation(seed):
    # 2e-3 rad taken for motion would give Cup to a fifth of its prior, without any excitation.
    problem = given("straight", ("V", "alpha", "theta", "h"), LONGITUDINAL, seconds=60.0, rate=50.0)
    noise = NOISE * np.random.default_rng(seed).standard_normal(problem.measurements.shape)
    found = reconstructibility(replace(problem, measurements=problem.measurements + noise))
    assert list(found.fixed) == ["Calpha0"]
    assert "Cup" in found.fixed["Calpha0"]


def test_motion_is_never_fixed_even_where_nothing_measures_it():
    found = reconstructibility(given("lively", ("V", "alpha", "beta", "phi", "theta"), (*STATES[:5], "h")))
    assert found.fixed == {}
    assert found.undetermined == ("h",)
    assert found.verdicts["h"] == "not reconstructible"
    assert_allclose(found.posterior_over_prior["h"], 1.0, rtol=1e-9)
    assert "not to be fixed: h" in str(found)


@pytest.mark.default_cases(1)
@pytest.mark.parametrize("sensors", [AIR + ATTITUDE, AIR + ATTITUDE + HEADING + POSITION, MEASUREMENTS])
def test_rank_and_posterior_are_those_of_simulations_from_every_start_moved_a_little(sensors):
    # 1501 samples, so the analysis works on some of them and the flights on all.
    t, inputs, start = prescribed("lively", 30.0, 50.0)
    J = brute_force(t, inputs, start, sensors, EVERYTHING)
    found = reconstructibility(given("lively", sensors, seconds=30.0, rate=50.0))
    s = np.linalg.svd(J, compute_uv=False)
    assert found.rank == np.linalg.matrix_rank(J, tol=0.1)
    posterior = np.sqrt(np.diag(np.linalg.inv(J.T @ J + np.eye(len(EVERYTHING)))))
    assert_allclose([found.posterior_over_prior[name] for name in EVERYTHING], posterior, rtol=0.03)
    if found.rank == len(EVERYTHING):
        assert_allclose(found.condition, s[0] / s[-1], rtol=0.03)


def test_segments_have_only_their_constants_in_common():
    # The same 30 s three times with gaps between: a least-squares problem with three starts and one set of constants.
    sensors, moving = (*AIR, *ATTITUDE, *HEADING, *POSITION), 9
    t, inputs, start = prescribed("lively", 30.0, 25.0)
    J = brute_force(t, inputs, start, sensors, EVERYTHING)
    constants, rows = len(EVERYTHING) - moving, len(J)
    joint = np.zeros((3 * rows, 3 * moving + constants))
    for k in range(3):
        joint[k * rows : (k + 1) * rows, k * moving : (k + 1) * moving] = J[:, :moving]
        joint[k * rows : (k + 1) * rows, 3 * moving :] = J[:, moving:]
    prior = np.r_[np.ones(moving), np.zeros(2 * moving), np.ones(constants)]
    posterior = np.sqrt(np.diag(np.linalg.inv(joint.T @ joint + np.diag(prior))))
    once = given("lively", sensors, seconds=30.0)
    found = reconstructibility(
        replace(
            once,
            t=np.concatenate([t, t + 100.0, t + 200.0]),
            inputs=np.tile(once.inputs, (3, 1)),
            measurements=np.tile(once.measurements, (3, 1)),
        )
    )
    assert found.segments == 3
    expected = np.r_[posterior[:moving], posterior[3 * moving :]]
    assert_allclose([found.posterior_over_prior[name] for name in EVERYTHING], expected, rtol=0.03)


@pytest.mark.default_cases(3)
@pytest.mark.parametrize("sensors", [AIR, AIR + ATTITUDE, AIR + ATTITUDE + HEADING + POSITION, MEASUREMENTS])
@pytest.mark.parametrize("kind", ["straight", "turning"])
def test_linear_rank_is_that_of_the_observability_matrix(kind, sensors):
    states = (*MOTION_AND_BIASES, "wn", "we")
    problem = given(kind, sensors, states)
    found = reconstructibility(problem)
    at, a = problem.start.copy(), problem.inputs.mean(axis=0)
    if kind == "turning":
        at[5] = problem.measurements[:, 5].mean() if "psi" in sensors else at[5]
    kept, seen = [STATES.index(name) for name in states], [MEASUREMENTS.index(name) for name in sensors]
    # Complex steps: derivatives exact to rounding.
    moved = at[:, None] + 1e-30j * np.eye(34)[:, kept]
    A = (textbook_slope(moved, a.astype(complex)).imag / 1e-30)[kept]
    C = (textbook_readings(moved).imag / 1e-30)[seen]
    prior = np.array([PRIOR[name] for name in states])
    rows = [C / NOISE[seen, None] * prior]
    step = A * prior / prior[:, None]
    for _ in range(len(states) - 1):
        rows.append(rows[-1] @ step)
    observability = np.vstack([row / np.abs(row).max() for row in rows if np.abs(row).max() > 0.0])
    assert found.linear_rank == np.linalg.matrix_rank(observability, tol=1e-9)


@pytest.mark.parametrize("which", ["all-axes", "aileron-rudder"])
@pytest.mark.parametrize("sensors", [AIR + ATTITUDE + HEADING, MEASUREMENTS])
def test_the_smoother_reaches_the_bound_without_input_noise_and_stays_above_it_with(which, sensors):
    unseen = () if "x" in sensors else ("x", "y", "wn", "we")
    states = tuple(name for name in EVERYTHING if name not in unseen)
    problem = demo_problem(which, sensors, states, exact=True)
    bound = np.array(list(reconstructibility(problem).posterior_over_prior.values()))
    _, quiet = ukf_smoother(replace(problem, input_std=1e-5 * problem.input_std), spread=0.0)
    assert_allclose(quiet.std[0] / problem.start_std, bound, rtol=0.08)
    _, noisy = ukf_smoother(demo_problem(which, sensors, states))
    reached = noisy.std[0] / problem.start_std
    assert (reached > 0.9 * bound).all()
    # Gyro noise of 5e-4 rad/s costs most where the attitude alone would give the gyros' biases to 3e-6 rad/s.
    assert (reached < 6.0 * bound).all()


def test_attitude_that_was_not_measured_is_taken_from_accelerometers_however_biased_the_gyros():
    # 0.02 rad/s on the roll gyro: integrated over 40 s, it would bank by 46 degrees more than the aircraft did.
    problem = given("turning", AIR, (*STATES[:5], *STATES[8:15]))
    biased = problem.inputs + np.r_[np.zeros(3), 0.02, np.zeros(5)]
    calm = reconstructibility(problem)
    found = reconstructibility(replace(problem, inputs=biased))
    assert "phi and theta not sampled: computed from accelerometers and air data." in found.notes
    assert_allclose(
        [found.posterior_over_prior[name] for name in found.requested],
        list(calm.posterior_over_prior.values()),
        rtol=0.3,
    )


def test_a_report_fits_the_terminal_and_says_it_is_a_bound():
    for kind in ("straight", "lively"):
        text = str(reconstructibility(given(kind, AIR, STATES)))
        assert max(map(len, text.splitlines())) <= 80
        assert "An upper bound" in text
        for name in STATES:
            assert f"\n{name} " in text


def test_steep_attitude_is_said_and_survived():
    problem = given("lively", AIR + ATTITUDE, EVERYTHING)
    measurements = problem.measurements.copy()
    measurements[100, 4] = 1.56
    found = reconstructibility(replace(problem, measurements=measurements))
    assert any("theta is beyond 1.5 rad in 1 samples, the first at 4.00 s" in note for note in found.notes)
    assert np.isfinite(list(found.posterior_over_prior.values())).all()


def test_what_cannot_be_analysed_is_refused():
    problem = given("lively", AIR)
    with pytest.raises(DomainError, match="cannot fix 'theta' at will"):
        reconstructibility(problem, fix_first=("theta",))
    short = replace(problem, t=problem.t[:1], inputs=problem.inputs[:1], measurements=problem.measurements[:1])
    with pytest.raises(DomainError, match="two samples without a gap"):
        reconstructibility(short)
    still = replace(given("lively", ("alpha", "h")), start=np.zeros(34))
    with pytest.raises(DomainError, match="needs an airspeed"):
        reconstructibility(still)


@pytest.mark.slow
def test_an_hour_takes_bounded_memory_and_time_in_proportion_to_its_samples():
    problem = given("lively", MEASUREMENTS, EVERYTHING[:20], seconds=120.0, rate=50.0)
    reconstructibility(given("lively", MEASUREMENTS, EVERYTHING[:20], seconds=2.0))  # compile
    taken = []
    for _ in range(3):
        before = time.perf_counter()
        reconstructibility(problem)
        taken.append(time.perf_counter() - before)
    hour = replace(
        problem,
        t=np.arange(30 * 6001) * 0.02,
        inputs=np.tile(problem.inputs, (30, 1)),
        measurements=np.tile(problem.measurements, (30, 1)),
    )
    tracemalloc.start()
    try:
        before = time.perf_counter()
        found = reconstructibility(hour)
        taken_hour, peak = time.perf_counter() - before, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert found.segments == 61
    assert taken_hour < 3.0 * 30.0 * min(taken)
    assert peak < 150e6
