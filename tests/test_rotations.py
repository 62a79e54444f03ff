"""Quaternions and rotation vectors against scipy."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from structsel.numerics import rotations as rot


def cosines(e):
    C = np.empty((3, 3))
    rot.cosines_of(e, C)
    return C


@pytest.mark.parametrize("angles", [(0.3, -0.7, 2.0), (-3.0, 1.5, 0.1), (2.0, -1.57, -3.0)])
def test_angles_quaternion_and_cosines_are_those_of_scipy(angles):
    phi, theta, psi = angles
    expected = Rotation.from_euler("ZYX", [psi, theta, phi]).as_matrix()
    C = np.empty((3, 3))
    rot.cosines_of_angles(phi, theta, psi, C)
    assert_allclose(C, expected, atol=1e-15)
    assert_allclose(cosines(np.array(rot.quaternion_of(phi, theta, psi))), expected, atol=1e-15)
    assert_allclose(rot.angles_of(C), angles, atol=1e-12)


@pytest.mark.parametrize("size", [0.0, 1e-9, 0.01, 0.3, 0.33, 2.5, 3.1])
def test_a_turn_is_the_rotation_vector_of_scipy_and_back(size):
    d = size * np.array([0.48, -0.6, 0.64])
    e, out = np.array(rot.quaternion_of(0.4, -1.2, 2.2)), np.empty(4)
    rot.turn(e, *d, out)
    assert_allclose(cosines(out), cosines(e) @ Rotation.from_rotvec(d).as_matrix(), atol=1e-14)
    assert_allclose(rot.vector_between(e, out), d, atol=1e-13)
    s, c, _ = rot.rotation_factors(float(d @ d))
    v = np.array([1.0, 2.0, -0.5])
    turned = v + s * np.cross(d, v) + c * np.cross(d, np.cross(d, v))
    assert_allclose(turned, Rotation.from_rotvec(d).apply(v), atol=1e-13)


def test_the_rate_of_a_rotation_vector_is_that_of_the_attitude():
    w = np.array([0.9, -0.4, 0.7])

    def slope(_, d):
        _, _, b = rot.rotation_factors(float(d @ d))
        return w + 0.5 * np.cross(d, w) + b * np.cross(d, np.cross(d, w))

    start = np.array([0.1, 0.3, -0.2])
    end = solve_ivp(slope, (0.0, 0.5), start, rtol=1e-11, atol=1e-13).y[:, -1]
    expected = Rotation.from_rotvec(start) * Rotation.from_rotvec(0.5 * w)
    assert_allclose(Rotation.from_rotvec(end).as_matrix(), expected.as_matrix(), atol=1e-8)
