from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from structsel.numerics import kinematics as fp
from structsel.numerics import rigid_body as rb
from structsel.numerics.air_data import air_data, air_data_at_cg, body_to_earth
from structsel.numerics.kinematic_tangents import noise_columns, reading_columns, step_columns
from structsel.numerics.rotations import angles_of, cosines_of, quaternion_of, turn, vector_between

N = 200


@pytest.fixture(scope="module")
def scene():
    """Random but flyable full vectors, readings and places."""
    rng = np.random.default_rng(1)
    path = np.zeros((N, 34))
    path[:, :3] = rng.normal([90.0, 3.0, 6.0], [10.0, 4.0, 4.0], (N, 3))
    path[:, 3:6] = rng.uniform([-3.0, -1.2, -6.0], [3.0, 1.2, 6.0], (N, 3))
    path[:, 6:9] = rng.normal(0.0, 500.0, (N, 3))
    path[:, 9:23] = rng.normal(0.0, [0.1, 0.1, 0.1, 0.01, 0.01, 0.01, 5, 5, 1, 0.1, 0.01, 0.1, 0.01, 0.02], (N, 14))
    path[:, fp.SCALE : fp.GUST] = rng.normal(0.0, 0.05, (N, 8))
    inputs = np.c_[rng.normal(0.0, 5.0, (N, 3)), rng.normal(0.0, 0.5, (N, 3)), rng.normal(0.0, 1.0, (N, 3))]
    place = rng.normal(0.0, [4.0, 1.0, 1.0], (6, 3))
    return path, inputs, place


def rates_and_force(path, inputs, place):
    by_force, by_rate = 1.0 + path[:, 25:28], 1.0 + path[:, 28:31]
    rates, turning = (inputs[:, 3:6] - path[:, 12:15]) / by_rate, inputs[:, 6:9] / by_rate
    force = rb.acceleration_at_cg(*((inputs[:, :3] - path[:, 9:12]) / by_force).T, rates.T, turning.T, place[0])
    return rates.T, force


def test_force_and_rates_are_those_carried_to_the_centre_without_bias(scene):
    path, inputs, place = scene
    rates, force = rates_and_force(path, inputs, place)
    assert_allclose(fp.forces(path, inputs, place), np.vstack([*force, *rates]).T, rtol=1e-11, atol=1e-11)


def test_slopes_are_the_rigid_body_equations(scene):
    path, inputs, place = scene
    rates, force = rates_and_force(path, inputs, place)
    phi, theta, psi = path[:, 3:6].T
    ground = np.einsum("nij,nj->ni", body_to_earth(phi, theta, psi), path[:, :3]) + path[:, 15:18]
    expected = np.vstack(
        [
            *rb.velocity_derivative(path[:, :3].T, rates, force, phi, theta, 9.81),
            *rb.euler_rates(*rates, phi, theta),
            *(ground * [1.0, 1.0, -1.0]).T,
        ]
    ).T
    assert_allclose(fp.slopes(path, inputs, place, 9.81), expected, rtol=1e-11, atol=1e-10)


def test_air_data_read_on_a_boom_come_back_to_those_at_the_centre(scene):
    path, inputs, place = scene
    bare = path.copy()
    bare[:, 18:] = 0.0  # upwash and scale errors are not in air_data_at_cg
    one = np.tile(place[1], (6, 1))
    V, alpha, beta = fp.readings(bare, inputs, one, False)[:, :3].T
    rates = (inputs[:, 3:6] - bare[:, 12:15]).T
    assert_allclose(air_data_at_cg(V, alpha, beta, *rates, place[1]), air_data(*bare[:, :3].T), rtol=1e-10, atol=1e-12)


def test_upwash_sidewash_offsets_and_scale_enter_as_in_the_equations(scene):
    path, inputs, place = scene
    bare = path.copy()
    bare[:, 18:23] = bare[:, 31:] = 0.0
    _, alpha, beta = air_data(*path[:, :3].T)
    without, full = fp.readings(bare, inputs, place, False), fp.readings(path, inputs, place, False)
    expected = without.copy()
    expected[:, 0] *= 1.0 + path[:, 22]
    expected[:, 1] += path[:, 18] * alpha + path[:, 19]
    expected[:, 2] += path[:, 20] * beta + path[:, 21]
    assert_allclose(full, expected, rtol=1e-11, atol=1e-12)


def test_a_flank_angle_vane_reads_the_angle_in_its_own_aircraft(scene):
    path, inputs, place = scene
    bare = path.copy()
    bare[:, 18:] = 0.0
    omega = inputs[:, 3:6] - bare[:, 12:15]
    u, v, _ = (bare[:, :3] + np.cross(omega, place[2])).T
    assert_allclose(fp.readings(bare, inputs, place, True)[:, 2], np.arctan2(v, u), rtol=1e-12)


def test_height_position_and_ground_velocity_are_those_of_port_and_antenna(scene):
    path, inputs, place = scene
    turn = body_to_earth(*path[:, 3:6].T)
    omega = (inputs[:, 3:6] - path[:, 12:15]) / (1.0 + path[:, 28:31])
    port, antenna = turn @ place[4], turn @ place[5]
    velocity = np.einsum("nij,nj->ni", turn, path[:, :3] + np.cross(omega, place[5])) + path[:, 15:18]
    got = fp.readings(path, inputs, place, False)
    assert_allclose(got[:, 6], path[:, 8] - port[:, 2], rtol=1e-11, atol=1e-10)
    assert_allclose(got[:, 7:9], path[:, 6:8] + antenna[:, :2], rtol=1e-11, atol=1e-10)
    assert_allclose(got[:, 9:], velocity, rtol=1e-11, atol=1e-11)
    assert_allclose(got[:, 3:5], path[:, 3:5] * (1.0 + path[:, 23:25]), rtol=1e-14)
    assert_allclose(got[:, 5], path[:, 5], rtol=0)


def test_a_roll_angle_of_many_turns_is_scaled_within_its_turn():
    full = np.zeros((2, 34))
    full[:, 0], full[:, 3], full[:, 23] = 50.0, [0.4, 0.4 + 4.0 * np.pi], 0.05
    got = fp.readings(full, np.zeros((2, 9)), np.zeros((6, 3)), False)
    assert_allclose(got[:, 3], [0.42, 0.42 + 4.0 * np.pi], rtol=1e-14)


def test_a_simulated_path_is_the_integral_that_scipy_finds():
    # Inputs linear between samples on both sides; Runge-Kutta at 20 ms leaves 1e-7 of these motions.
    t = np.cumsum(np.random.default_rng(2).uniform(0.01, 0.03, 60))
    inputs = np.zeros((60, 9))
    inputs[:, 0] = 0.8 + 0.3 * np.sin(0.9 * t)
    inputs[:, 1] = 0.5 * np.sin(1.9 * t)
    inputs[:, 2] = -9.8 + 2.0 * np.sin(2.1 * t)
    for j, (size, frequency) in enumerate([(0.6, 2.0), (0.2, 1.5), (0.1, 1.0)]):
        inputs[:, 3 + j] = size * np.sin(frequency * t)
        inputs[:, 6 + j] = size * frequency * np.cos(frequency * t)
    place = np.zeros((6, 3))
    place[0] = [1.0, -0.2, 0.4]
    start = np.zeros(34)
    start[:9] = [100.0, 2.0, 5.0, 0.1, 0.05, 2.0, 10.0, -20.0, 1000.0]
    start[9:18] = [0.1, -0.05, 0.08, 2e-3, -1e-3, 3e-3, 5.0, -3.0, 0.5]

    def slope(time, motion):
        full = np.r_[motion, start[9:]]
        now = np.array([np.interp(time, t, column) for column in inputs.T])
        rates, force = rates_and_force(full[None], now[None], place)
        ground = body_to_earth(*motion[3:6]) @ motion[:3] + start[15:18]
        return np.concatenate(
            [
                np.ravel(rb.velocity_derivative(motion[:3], rates[:, 0], np.ravel(force), *motion[3:5], 9.80665)),
                np.ravel(rb.euler_rates(*rates[:, 0], *motion[3:5])),
                ground * [1.0, 1.0, -1.0],
            ]
        )

    expected = [start[:9]]
    for a, b in pairwise(t):
        run = solve_ivp(slope, (a, b), expected[-1], rtol=1e-9, atol=1e-10, method="RK45")
        expected.append(run.y[:, -1])
    got = fp.fly(t, inputs, start, place, 9.80665, True)
    assert_allclose(got[:, :9], expected, rtol=1e-8, atol=1e-6)
    assert_allclose(got[:, 9:], np.tile(start[9:], (60, 1)), rtol=0)


def test_without_position_states_the_rest_is_unchanged(scene):
    path, inputs, place = scene
    t = np.arange(20) * 0.02
    with_it = fp.fly(t, inputs[:20], path[0], place, 9.8, True)
    without = fp.fly(t, inputs[:20], path[0], place, 9.8, False)
    others = [0, 1, 2, 3, 4, 5, 8, *range(9, 34)]
    assert_allclose(without[:, others], with_it[:, others], rtol=0)
    assert_allclose(without[:, 6:8], np.tile(path[0, 6:8], (20, 1)), rtol=0)


def test_noise_enters_as_the_slopes_change_with_the_readings(scene):
    # At the centre of gravity: the arm's part of gyro noise in the accelerometers is left out.
    path, inputs, _ = scene
    at_centre, gain, h, std = np.zeros((6, 3)), np.empty((6, 6)), 1e-4, np.linspace(0.5, 1.0, 6)
    for k in range(20):
        C = body_to_earth(*path[k, 3:6])
        noise_columns(path[k], C, std, gain)
        for j in range(6):
            more, less = inputs[k].copy(), inputs[k].copy()
            more[j] += h
            less[j] -= h
            ends = [fp.slopes(path[k : k + 1], a[None], at_centre, 9.8)[0] for a in (more, less)]
            assert_allclose(gain[:3, j], std[j] * (ends[0] - ends[1])[:3] / (2.0 * h), rtol=1e-7, atol=1e-7)
            turned = C[:, j - 3] * std[j] / (1.0 + path[k, 25 + j]) if j >= 3 else np.zeros(3)
            assert_allclose(gain[3:, j], turned, rtol=1e-12)


def test_columns_of_a_root_are_the_derivatives_of_step_and_readings(scene):
    # Against central differences of the step and of the readings, each at the attitude that the deviation turns to.
    path, inputs, place = scene
    states, dt, z = np.r_[9:15, 15:31, :9, 31:34], 0.01, np.empty(34)
    N, dy, C0, C1 = np.empty((34, 12)), np.empty((34, 12)), np.empty((3, 3)), np.empty((3, 3))
    e0, e1, turned = np.empty(4), np.empty(4), np.empty(4)
    everything = np.ones(12, dtype=bool)
    size = np.r_[np.full(3, 1e-2), np.full(3, 1e-4), np.full(3, 1e-2), np.full(3, 1e-3), np.full(3, 1e-4), [1e-2] * 3,
                 np.full(13, 1e-4), [1e-2] * 3]  # fmt: skip
    for flank in (False, True):
        for k in range(1, 10):
            x = path[k].copy()
            e0[:] = quaternion_of(*x[3:6])
            cosines_of(e0, C0)

            def after(d, x=x, k=k):
                moved, out = x + d, np.empty(34)
                moved[3:6] = C0.T @ d[3:6]
                fp.step(moved, C0, inputs[k], inputs[k], dt, place, 9.8, True, out)
                return out

            def read(d, x=x, k=k, flank=flank):
                moved, C, out = x + d, np.empty((3, 3)), np.empty(12)
                turn(e0, *(C0.T @ d[3:6]), turned)
                cosines_of(turned, C)
                moved[3:6] = angles_of(C)
                fp.observe_at(moved, C, inputs[k], place, flank, everything, out)
                return out

            centre = after(np.zeros(34))
            turn(e0, *centre[3:6], e1)
            cosines_of(e1, C1)
            T = np.diag(size[states])
            step_columns(T, states, 22, x, centre, C0, C1, inputs[k], inputs[k], dt, place, 9.8, 1.0, z, N)
            reading_columns(T, states, x, C0, inputs[k], place, flank, everything, z, dy)
            for j, state in enumerate(states):
                d = size[state] * np.eye(34)[state]
                ends = after(d), after(-d)
                difference = 0.5 * (ends[0] - ends[1])
                turns = []
                for end in ends:
                    turn(e0, *end[3:6], turned)
                    turns.append(C1 @ vector_between(e1, turned))
                difference[3:6] = 0.5 * np.subtract(*turns)
                # The midpoint rule leaves out the third power of rate times step, (1 rad/s x 0.01 s)^3.
                allowed = 1e-4 * np.abs(difference).max()
                assert_allclose(N[j], difference[states[22:]], rtol=1e-4, atol=allowed)
                y = 0.5 * (read(d) - read(-d))
                assert_allclose(dy[j], y, rtol=1e-5, atol=1e-6 * size[state] * (100.0 if state in (3, 4, 5) else 1.0))


def test_a_gust_is_felt_by_vanes_and_pitot_alone(scene):
    path, inputs, place = scene
    path = path.copy()
    path[:, [18, 20]] = 0.0  # upwash and sidewash are those of steady air
    gusty, moved = path.copy(), path.copy()
    gusty[:, fp.GUST :] = np.random.default_rng(2).normal(0.0, 2.0, (N, 3))
    moved[:, :3] += gusty[:, fp.GUST :]
    still, there, elsewhere = (fp.readings(x, inputs, place, False) for x in (path, gusty, moved))
    assert_allclose(there[:, :3], elsewhere[:, :3], rtol=1e-13)
    assert_allclose(there[:, 3:], still[:, 3:], rtol=0, atol=0)
    assert_allclose(fp.slopes(gusty, inputs, place, 9.8), fp.slopes(path, inputs, place, 9.8), rtol=0, atol=0)
