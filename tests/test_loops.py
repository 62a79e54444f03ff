"""Reconstruction through the vertical; the truth is an attitude that scipy integrated."""

import numpy as np
import pytest
import scipy

from structsel.coefficients import compute_coefficients
from structsel.reconstruction import reconstruct
from structsel.recording import Recording
from tests.loops import BIASES, aircraft, attitude_of, recording

KINDS = ("loop", "roll")


def to_body(phi, theta):
    """Rotation vector in body axes for a change of phi, theta and psi."""
    sf, cf, st, ct = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta)
    return np.array([[1.0, 0.0, -st], [0.0, cf, sf * ct], [0.0, -sf, cf * ct]])


def normalised_squares(found, attitude, velocity, h, samples):
    """Squared error of all states in units of the covariance, at some samples; the attitude as a rotation vector."""
    names, values = list(found.states), []
    at = [names.index(n) for n in ("phi", "theta", "psi")]
    turns = (attitude_of(found.recording).inv() * attitude).as_rotvec()
    for k in samples:
        truth = dict(zip("uvw", velocity[k])) | BIASES | {"h": h[k]}
        error = np.array([truth.get(n, 0.0) for n in names]) - found.estimates[k]
        J = np.eye(len(names))
        J[np.ix_(at, at)] = to_body(*found.estimates[k, at[:2]])
        error[at] = turns[k]
        (row,) = np.flatnonzero(found.covariance_at == k)
        values.append(error @ np.linalg.solve(J @ found.covariance[row] @ J.T, error))
    return values, len(names)


@pytest.mark.parametrize("kind", KINDS)
def test_a_flight_through_the_vertical_is_reconstructed(kind):
    measured, attitude, velocity = recording(kind)
    assert np.abs(measured["theta"]).max() > 1.5
    found = reconstruct(measured, aircraft())
    made = found.recording
    assert found.trusted, found.distrust
    error = (attitude_of(made).inv() * attitude).as_rotvec()
    # The noise of one reading is 4e-3 rad.
    assert np.sqrt(np.mean(error**2)) < 1e-3
    assert np.abs(np.c_[made["u"], made["v"], made["w"]] - velocity).max() < 0.1
    for name, bias in BIASES.items():
        assert abs(found[name].value - bias) < 4.0 * found[name].std, name
    # The coefficients: mass times specific force over dynamic pressure and area, from the truth.
    assert compute_coefficients(made, aircraft())["CZ"].size == len(measured)


@pytest.mark.parametrize("count", [2, pytest.param(12, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", KINDS)
def test_errors_in_a_flight_through_the_vertical_are_as_large_as_the_covariance_says(kind, count):
    total, n = np.zeros(3), 0
    for seed in range(count):
        measured, attitude, velocity = recording(kind, seed=seed)
        found = reconstruct(measured, aircraft())
        # Nearest the vertical, between two passages, and at the end.
        up = -attitude.apply([1.0, 0.0, 0.0])[:, 2]
        samples = [int(np.argmax(up)), len(up) // 2, len(up) - 1]
        true_h = 1500.0 - scipy.integrate.cumulative_trapezoid(attitude.apply(velocity)[:, 2], measured.t, initial=0.0)
        squares, n = normalised_squares(found, attitude, velocity, true_h, samples)
        total += squares
    low, high = scipy.stats.chi2.ppf([5e-4, 1.0 - 5e-4], n * count)
    assert ((low < total) & (total < high)).all(), total / count


def test_a_loop_without_lateral_channels_has_a_pitch_attitude_beyond_the_vertical():
    measured, _, _ = recording("loop")
    kept = {n: measured[n] for n in ("V", "alpha", "ax", "az", "q", "h", "theta")}
    calm = measured.t > 7.0
    part = Recording("plane", measured.t[calm], {n: x[calm] for n, x in kept.items()})
    found = reconstruct(part, aircraft())
    theta = found.recording["theta"]
    assert theta[-1] - theta[0] == pytest.approx(2.0 * np.pi, abs=0.05)
    assert np.abs(np.diff(theta)).max() < 0.02
