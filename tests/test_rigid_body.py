import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from structsel.aircraft import Inertia
from structsel.errors import DomainError
from structsel.numerics import rigid_body as rb
from structsel.numerics.air_data import (
    air_data,
    air_data_at_cg,
    body_to_earth,
    body_velocity,
    lift_and_drag,
    nondimensional_rates,
)
from structsel.numerics.atmosphere import standard_atmosphere

INERTIA = Inertia(Ix=5368.0, Iy=6929.0, Iz=11159.0, Ixz=500.0).tensor
angle = st.floats(-1.4, 1.4)
speed = st.floats(1.0, 300.0)


@given(phi=st.floats(-3, 3), theta=angle, psi=st.floats(-3, 3))
def test_the_rotation_is_yaw_then_pitch_then_roll(phi, theta, psi):
    expected = Rotation.from_euler("ZYX", [psi, theta, phi]).as_matrix()
    assert_allclose(body_to_earth(phi, theta, psi), expected, atol=1e-14)


@given(V=speed, alpha=angle, beta=angle)
def test_air_data_and_body_velocity_undo_each_other(V, alpha, beta):
    assert_allclose(air_data(*body_velocity(V, alpha, beta)), (V, alpha, beta), rtol=1e-9, atol=1e-9)


def test_the_atmosphere_is_the_standards_table():
    # ISO 2533 table values at 0, 5, 11, 15 and 25 km: T, p, rho, a.
    table = np.array(
        [
            [288.15, 101325.0, 1.22500, 340.294],
            [255.65, 54019.9, 0.736116, 320.529],
            [216.65, 22632.0, 0.363918, 295.069],
            [216.65, 12044.5, 0.193673, 295.069],
            [221.65, 2511.02, 0.0394658, 298.455],
        ]
    )
    got = np.array(standard_atmosphere(np.array([0.0, 5e3, 11e3, 15e3, 25e3]))).T
    assert_allclose(got, table, rtol=5e-6)


def test_an_altitude_outside_the_atmosphere_is_named():
    with pytest.raises(DomainError, match="sample 1 has h = 90000 m"):
        standard_atmosphere(np.array([0.0, 90_000.0]))


def test_level_flight_at_one_g_carries_the_weight():
    # Accelerometer reads -g along z, so CZ = -m g / (qbar S).
    _, _, CZ = rb.force_coefficients(0.0, 0.0, -9.80665, qbar=2500.0, mass=4500.0, S=30.0)
    assert_allclose(CZ, -4500.0 * 9.80665 / (2500.0 * 30.0), rtol=1e-12)


@given(k=st.floats(0.1, 10.0))
def test_coefficients_are_unchanged_when_mass_thrust_and_qbar_scale_together(k):
    args = (1.0, 0.3, -9.0)
    one = rb.force_coefficients(*args, qbar=900.0, mass=2000.0, S=23.0, thrust=800.0, inclination=0.05)
    other = rb.force_coefficients(*args, qbar=900.0 * k, mass=2000.0 * k, S=23.0, thrust=800.0 * k, inclination=0.05)
    assert_allclose(one, other, rtol=1e-12)


def test_thrust_tilted_up_lifts_and_a_line_below_the_centre_of_gravity_pitches_up():
    Tx, _, Tz = rb.thrust_force(1000.0, 0.1)
    assert_allclose((Tx, Tz), (1000 * np.cos(0.1), -1000 * np.sin(0.1)), rtol=1e-14)
    assert_allclose(rb.thrust_moment(1000.0, (0.0, 0.0, 0.3)), (0.0, 300.0, 0.0), atol=1e-12)
    # A line 2 m right of the centre turns the nose left; one 2 m ahead and tilted up pitches up.
    assert_allclose(rb.thrust_moment(1000.0, (0.0, 2.0, 0.0)), (0.0, 0.0, -2000.0), atol=1e-12)
    assert_allclose(rb.thrust_moment(1000.0, (2.0, 0.0, 0.0), 0.1)[1], 2000.0 * np.sin(0.1), rtol=1e-14)


def test_the_moments_are_mulders_with_the_rotor_term():
    # [M86], as printed: L = Ix p' - (Iy - Iz) q r - Izx (r' + p q), and so on.
    rng = np.random.default_rng(3)
    p, q, r, pd, qd, rd = rng.standard_normal((6, 5))
    Ix, Iy, Iz, J, H = 5368.0, 6929.0, 11159.0, 500.0, 120.0
    L = Ix * pd - (Iy - Iz) * q * r - J * (rd + p * q)
    M = Iy * qd - (Iz - Ix) * r * p - J * (r**2 - p**2) + H * r
    N = Iz * rd - (Ix - Iy) * p * q - J * (pd - q * r) - H * q
    assert_allclose(rb.inertial_moment((p, q, r), (pd, qd, rd), INERTIA, H), (L, M, N), rtol=1e-11, atol=1e-9)
    # [H17], as printed.
    Cl, Cm, Cn = rb.moment_coefficients((p, q, r), (pd, qd, rd), np.full(5, 900.0), INERTIA, S=23.0, b=14.0, cbar=1.6)
    qS = 900.0 * 23.0
    assert_allclose(Cl, Ix / (qS * 14) * (pd - (Iy - Iz) / Ix * q * r - J / Ix * (p * q + rd)), rtol=1e-11, atol=1e-12)
    assert_allclose(
        Cm, Iy / (qS * 1.6) * (qd - (Iz - Ix) / Iy * p * r + J / Iy * (p**2 - r**2)), rtol=1e-11, atol=1e-12
    )
    assert_allclose(Cn, Iz / (qS * 14) * (rd - (Ix - Iy) / Iz * p * q + J / Iz * (q * r - pd)), rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("products", [(500.0, 0.0, 0.0), (500.0, -300.0, 200.0)])
def test_torque_free_rotation_keeps_angular_momentum_and_kinetic_energy(products):
    Ixz, Ixy, Iyz = products
    inertia = Inertia(Ix=5368.0, Iy=6929.0, Iz=11159.0, Ixz=Ixz, Ixy=Ixy, Iyz=Iyz).tensor

    def derivative(_, x):
        rates = rb.angular_acceleration(x[:3], (0.0, 0.0, 0.0), inertia)
        return np.concatenate([rates, rb.euler_rates(*x[:3], *x[3:5])])

    start = [0.3, 0.5, -0.2, 0.1, 0.2, -0.4]
    run = solve_ivp(derivative, (0.0, 3.0), start, rtol=1e-11, atol=1e-12, max_step=0.1)
    rates = run.y[:3]
    energy = 0.5 * np.sum(rates * (inertia @ rates), axis=0)
    in_earth = np.einsum("nij,jn->in", body_to_earth(*run.y[3:]), inertia @ rates)
    assert np.abs(rates[0] - rates[0, 0]).max() > 0.1  # it does tumble
    assert_allclose(energy, energy[0], rtol=1e-9)
    assert_allclose(in_earth, in_earth[:, :1] * np.ones(in_earth.shape[1]), rtol=0, atol=1e-6)


def test_a_thrown_stone_follows_a_parabola_however_it_spins():
    # No air, no thrust: h = h0 + vh t - g t^2/2 in earth axes, with the wind added to the path.
    state = np.array([20.0, 3.0, -5.0, 0.5, 0.4, -0.6, 0.2, 0.3, 0.5, 0.0, 0.0, 100.0])
    run = solve_ivp(
        lambda _, x: rb.state_derivative(
            x, np.zeros(6), 0.0, rb.Airframe(10.0, INERTIA, 1.0, 1.0, 1.0), wind=(1.0, -2.0, 0.5)
        ),
        (0.0, 2.0),
        state,
        rtol=1e-11,
        atol=1e-11,
    )
    vx, vy, vz = body_to_earth(0.2, 0.3, 0.5) @ state[:3] + np.array([1.0, -2.0, 0.5])
    expected = (2 * vx, 2 * vy, 100.0 - 2 * vz - 0.5 * rb.G0 * 4.0)
    assert_allclose(run.y[9:, -1], expected, rtol=1e-8)


def test_forces_and_moments_come_back_out_of_the_equations_of_motion():
    rng = np.random.default_rng(4)
    state = rng.standard_normal((12, 7)) * 0.2
    state[0] += 50.0
    wanted = rng.standard_normal((6, 7)) * 0.1
    offset, inclination = (0.5, 0.1, -0.2), 0.05
    airframe = rb.Airframe(2288.0, INERTIA, 23.2, 14.6, 1.59, offset, inclination, rotor_momentum=90.0)
    slope = rb.state_derivative(state, wanted, 1.1, airframe, 1500.0)
    qbar = 0.55 * np.sum(state[:3] ** 2, axis=0)
    # Specific force is what remains of the acceleration after gravity and rotation are taken off.
    phi, theta = state[6:8]
    gravity = rb.G0 * np.array([-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)])
    felt = slope[:3] + np.cross(state[3:6], state[:3], axis=0) - gravity
    forces = rb.force_coefficients(*felt, qbar=qbar, mass=2288.0, S=23.2, thrust=1500.0, inclination=0.05)
    moments = rb.moment_coefficients(
        state[3:6], slope[3:6], qbar, INERTIA, 23.2, 14.6, 1.59, 1500.0, offset, inclination, 90.0
    )
    assert_allclose((*forces, *moments), wanted, rtol=1e-9, atol=1e-12)


def test_an_accelerometer_off_the_centre_measures_the_rotation():
    # Turntable: 2 m from the axis at r = 3 rad/s the accelerometer feels -r^2 R = -18 along x; spinning up at
    # 0.5 rad/s^2 it also feels +R r' = 1 along y.
    at_cg = rb.acceleration_at_cg(-18.0, 1.0, 0.0, (0.0, 0.0, 3.0), (0.0, 0.0, 0.5), (2.0, 0.0, 0.0))
    assert_allclose(at_cg, (0.0, 0.0, 0.0), atol=1e-12)


def test_accelerations_anywhere_on_a_moving_body_come_from_its_path():
    # Differentiate twice the earth position of a point on a body that moves and turns, by a fine difference.
    place, dt = np.array([1.5, -0.7, 0.4]), 1e-4
    t = np.arange(-3, 4) * dt

    def attitude(s):
        return 0.3 * np.sin(2 * s), 0.2 * np.cos(1.5 * s), 0.4 * s

    R = body_to_earth(*attitude(t))
    cg = np.stack([np.sin(t), t**2, np.cos(3 * t)], axis=-1)
    weights = np.array([2, -27, 270, -490, 270, -27, 2]) / 180.0 / dt**2
    felt = R[3].T @ np.tensordot(weights, cg + R @ place, axes=(0, 0))
    expected = R[3].T @ np.tensordot(weights, cg, axes=(0, 0))

    def rates(s):
        first = np.array([2, -27, 270, -490, 270, -27, 2]) * 0 + np.array([-1, 9, -45, 0, 45, -9, 1]) / 60 / dt
        spin = body_to_earth(*attitude(s)).T @ np.tensordot(first, body_to_earth(*attitude(s + t)), axes=(0, 0))
        return np.array([spin[2, 1], spin[0, 2], spin[1, 0]])

    omega_dot = (rates(1e-3) - rates(-1e-3)) / 2e-3
    got = rb.acceleration_at_cg(*felt, rates(0.0), omega_dot, place)
    assert_allclose(got, expected, atol=2e-5)


def test_a_boom_ahead_of_the_centre_reads_less_angle_of_attack_while_pitching_up():
    # [M86]: alpha_v = atan((w - x q + y p) / u).
    u, w, q, p = 50.0, 4.0, 0.2, 0.5
    V, alpha, beta = air_data(u, 0.0, w - 6.0 * q + 1.0 * p)
    got = air_data_at_cg(V, alpha, beta, p, q, 0.0, (6.0, 1.0, 0.0))
    assert_allclose(got, air_data(u, 0.0, w), rtol=1e-12, atol=1e-12)


@given(alpha=angle, beta=angle)
def test_drag_points_down_the_wind_and_lift_across_it(alpha, beta):
    C = np.array([-0.1, 0.2, -0.8])
    along = np.array(body_velocity(1.0, alpha, beta))
    across = np.array([np.sin(alpha), 0.0, -np.cos(alpha)])  # up in the plane of symmetry
    CL, CD = lift_and_drag(*C, alpha, beta)
    assert_allclose((CL, CD), (C @ across, -C @ along), atol=1e-14)


def test_rates_are_made_dimensionless_with_the_two_in_them():
    assert_allclose(nondimensional_rates(50.0, 0.1, 0.2, 0.3, 10.0, 2.0), (0.01, 0.004, 0.03), rtol=1e-14)


@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan])
def test_dynamic_pressure_that_is_not_above_zero_is_named_by_sample(bad):
    qbar = np.array([900.0, 900.0, bad, bad])
    with pytest.raises(DomainError, match=r"qbar \[Pa\] above zero; sample 2"):
        rb.force_coefficients(0.0, 0.0, -9.8, qbar, 1000.0, 20.0)
    with pytest.raises(DomainError, match="sample 2"):
        rb.moment_coefficients((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), qbar, INERTIA, 20.0, 10.0, 2.0)
    with pytest.raises(DomainError, match=r"V \[m/s\] above zero; sample 2"):
        nondimensional_rates(qbar, 0.0, 0.0, 0.0, 10.0, 2.0)


def test_straight_up_has_no_heading():
    with pytest.raises(DomainError, match="theta"):
        rb.euler_rates(0.0, 0.1, 0.0, 0.0, np.pi / 2)
