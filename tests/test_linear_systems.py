"""Linear systems: motion against scipy, modes against published numbers, sensitivities against differences."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal

from structsel.errors import DomainError
from structsel.numerics.linear_models import LinearFamily, LinearSystem
from structsel.numerics.linear_systems import discretise, previous_input, simulate_linear
from structsel.simulation.modes import modes

DT = 0.05


def some_system(seed=0, ns=3, ni=2, no=2):
    """A stable system with everything in it, and an input that starts from rest and then jumps about."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(ns, ns))
    A -= (np.linalg.eigvals(A).real.max() + 0.5) * np.eye(ns)
    u = rng.normal(size=(120, ni))
    u[:10] = 0.0
    return A, rng.normal(size=(ns, ni)), rng.normal(size=(no, ns)), rng.normal(size=(no, ni)), u


@pytest.mark.parametrize("hold", ["hold", "linear"])
def test_motion_without_delay_is_that_of_scipy_lsim(hold):
    A, B, C, D, u = some_system()
    t, x0 = DT * np.arange(len(u)), np.array([0.3, -0.2, 0.5])
    _, want, _ = signal.lsim(signal.StateSpace(A, B, C, D), u, t, X0=x0, interp=hold == "linear")
    assert_allclose(simulate_linear(A, B, C, D, u, DT, x0=x0, hold=hold), want, rtol=0, atol=1e-12)


@pytest.mark.parametrize("hold", ["hold", "linear"])
@pytest.mark.parametrize("twentieths", [7, 20, 33, 60])
def test_any_delay_equals_scipy_on_a_grid_of_which_it_is_a_multiple(hold, twentieths):
    A, B, C, D, u = some_system(1)
    fine, n = DT / 20, len(u)
    t = fine * np.arange((n - 1) * 20 + 1)
    delayed = t - twentieths * fine
    if hold == "linear":
        v = np.column_stack([np.interp(delayed, DT * np.arange(n), column) for column in u.T])
    else:
        v = u[np.clip(np.floor(delayed / DT + 1e-9).astype(int), 0, None)]
    _, want, _ = signal.lsim(signal.StateSpace(A, B, C, D), v, t, interp=hold == "linear")
    got = simulate_linear(A, B, C, D, u, DT, delay=twentieths * fine, hold=hold)
    assert_allclose(got, want[::20], rtol=0, atol=1e-11)
    assert_allclose(previous_input(u, DT, twentieths * fine, hold), v[::20], rtol=0, atol=1e-11)


def test_a_constant_bias_leads_to_the_steady_state_of_its_equation_and_the_reference_adds():
    A, B, C, D, _ = some_system(2)
    bias, y_ref = np.array([0.1, -0.2, 0.3]), np.array([5.0, -7.0])
    y = simulate_linear(A, B, C, D, np.zeros((4000, 2)), DT, bias=bias, y_ref=y_ref)
    assert_allclose(y[-1], -C @ np.linalg.solve(A, bias) + y_ref, rtol=1e-10)
    assert_allclose(y[0], y_ref)


def test_a_batch_equals_its_members_one_by_one_whatever_carries_the_axis():
    parts = [some_system(seed) for seed in range(4)]
    A, B, C, D, u = (np.array(p) for p in zip(*parts))
    delay, bias, x0 = np.array([0.0, 0.02, 0.05, 0.33]), np.ones((4, 3)), np.arange(12.0).reshape(4, 3)
    y, x = simulate_linear(A, B, C, D, u, DT, delay=delay, bias=bias, x0=x0, return_states=True)
    assert y.shape == (4, 120, 2)
    for j in range(4):
        more = {"delay": delay[j], "bias": bias[j], "x0": x0[j], "return_states": True}
        one, state = simulate_linear(A[j], B[j], C[j], D[j], u[j], DT, **more)
        assert_allclose(y[j], one, rtol=0, atol=1e-12)
        assert_allclose(x[j], state, rtol=0, atol=1e-12)
    common = simulate_linear(A[0], B[0], C[0], D[0], u, DT)
    assert_allclose(common[2], simulate_linear(A[0], B[0], C[0], D[0], u[2], DT), atol=1e-14)
    outputs_only = simulate_linear(A[0], B[0], C, D, u[0], DT)
    assert_allclose(outputs_only[3], simulate_linear(A[0], B[0], C[3], D[3], u[0], DT), atol=1e-14)


def test_a_step_of_the_ramp_weights_is_the_integral_scipy_finds():
    A, B, *_ = some_system(3)
    Phi, held, ramp = discretise(A[None], B[None], np.array([0.3]))
    zoh = signal.cont2discrete((A, B, np.eye(3), np.zeros((3, 2))), 0.3, "zoh")
    assert_allclose(Phi[0], zoh[0], atol=1e-13)
    assert_allclose(held[0], zoh[1], atol=1e-13)
    _, want, _ = signal.lsim((A, B[:, :1], np.eye(3), np.zeros((3, 1))), np.array([0.0, 1.0]), np.array([0.0, 0.3]))
    assert_allclose(ramp[0][:, 0], want[1], atol=1e-13)


def test_a_member_that_blows_up_is_nan_from_there_on_and_alone():
    A = np.array([[[-1.0]], [[400.0]], [[np.nan]], [[1e9]]])
    y = simulate_linear(A, np.ones((1, 1)), np.eye(1), np.zeros((1, 1)), np.ones((100, 1)), DT)
    assert np.isfinite(y[0]).all()
    lost = np.isnan(y[1, :, 0])
    assert 5 < lost.argmax() < 20
    assert lost[lost.argmax() :].all()
    assert np.abs(y[1, ~lost]).max() < 1e100
    assert np.isnan(y[2:, 1:]).all()


@pytest.mark.parametrize("delay", [-0.1, 120 * DT, np.nan])
def test_a_delay_that_cannot_be_is_refused(delay):
    A, B, C, D, u = some_system()
    with pytest.raises(DomainError, match=r"delay of .* the record lasts 5.95 s"):
        simulate_linear(A, B, C, D, u, DT, delay=delay)


def test_bad_steps_inputs_and_shapes_are_refused_by_name():
    A, B, C, D, u = some_system()
    with pytest.raises(DomainError, match="time step above zero"):
        simulate_linear(A, B, C, D, u, 0.0)
    u[7, 1] = np.nan
    with pytest.raises(DomainError, match="sample 7"):
        simulate_linear(A, B, C, D, u, DT)
    with pytest.raises(DomainError, match="leading axes differ"):
        simulate_linear(np.stack([A] * 2), np.stack([B] * 3), C, D, u[:5], DT)
    with pytest.raises(DomainError, match=r"B of shape \(2, 1\)"):
        LinearSystem.of(("w", "q"), ("de",), np.eye(2), np.ones((2, 2)))


def test_modes_are_the_eigenvalues_numpy_finds_in_a_pilots_quantities():
    A = np.array([[-0.02, 0.1, 0.0, -9.8], [-0.2, -1.0, 100.0, 0.0], [0.0, -0.05, -1.5, 0.0], [0.0, 0.0, 1.0, 0.0]])
    found = modes(A, ("u", "w", "q", "theta"))
    values = np.linalg.eigvals(A)
    assert found.names == ("short period", "phugoid")
    for name, z in zip(found.names, sorted(values[values.imag > 0], key=abs, reverse=True)):
        i = found.names.index(name)
        assert_allclose(found.eigenvalues[i], z, rtol=1e-10)
        assert_allclose(found.frequency[i], np.hypot(z.real, z.imag), rtol=1e-10)
        assert_allclose(found.damping[i], -z.real / abs(z), rtol=1e-10)
        assert_allclose(found.period[i] * z.imag, 2 * np.pi, rtol=1e-10)
        assert_allclose(np.exp(z.real * found.time_to_half[i]), 0.5, rtol=1e-10)
    assert_allclose(found.participation.sum(axis=1), 1.0)


def test_a_diverging_mode_has_its_time_to_double():
    found = modes(np.array([[0.1]]))
    assert_allclose(np.exp(0.1 * found.time_to_double[0]), 2.0)
    assert np.isnan(found.time_to_half[0])
    assert "double" in str(found)
    assert found.names == ("aperiodic",)


def test_names_of_modes_do_not_depend_on_units_or_the_order_of_states():
    lateral = np.array([[-0.2, 0, -105.5, 9.8], [-0.085, -3.8, 1.0, 0], [0.04, 0, -0.5, 0], [0, 1, 0, 0]])
    states = ["v", "p", "r", "phi"]
    assert modes(lateral, states).names == ("roll", "Dutch roll", "spiral")
    scale, order = np.diag([1e-2, 57.3, 57.3, 57.3]), [3, 1, 0, 2]
    changed = (scale @ lateral @ np.linalg.inv(scale))[np.ix_(order, order)]
    assert modes(changed, [states[i] for i in order]).names == ("roll", "Dutch roll", "spiral")
    turned = np.zeros((5, 5))
    turned[:4, :4], turned[4, 2] = lateral, 1.0
    assert modes(turned, [*states, "psi"]).names == ("roll", "Dutch roll", "spiral", "heading")


def a_family():
    """Four parameters: one in A and C, one in B and D, a bias with a reference, and the delay."""
    A, B, C, D, u = some_system(5)
    base = LinearSystem(("a", "b", "c"), ("u1", "u2"), ("y1", "y2"), A, B, C, D, 0.0, np.zeros(3), np.zeros(2))
    rng = np.random.default_rng(6)
    family = LinearFamily.of(
        base,
        {
            "stiffness": {"A": rng.normal(size=(3, 3)), "C": rng.normal(size=(2, 3))},
            "power": {"B": rng.normal(size=(3, 2)), "D": rng.normal(size=(2, 2))},
            "offset": {"bias": np.array([0.1, 0.2, -0.3]), "y_ref": np.array([1.0, 2.0])},
            "delay": {"delay": 1.0},
        },
    )
    return family, np.array([0.2, 0.5, 0.4, 0.11]), u


@pytest.mark.parametrize("hold", ["hold", "linear"])
def test_sensitivities_are_central_differences_of_the_outputs(hold):
    family, theta, u = a_family()
    x0 = np.array([0.1, 0.0, -0.2])
    got = family.sensitivities(theta, u, DT, x0=x0, hold=hold)
    assert got.shape == (120, 2, 4)
    for j, h in enumerate([1e-5, 1e-5, 1e-5, 1e-6]):
        steps = np.array([theta, theta])
        steps[:, j] += [h, -h]
        up, down = family.simulate(steps, u, DT, x0=x0, hold=hold)
        assert_allclose(got[:, :, j], (up - down) / (2 * h), rtol=1e-6, atol=1e-7)


def test_sensitivities_of_several_inputs_are_those_of_each_and_of_a_kept_few_the_same_columns():
    family, theta, u = a_family()
    both = family.sensitivities(theta, np.stack([u, 2 * u]), DT)
    assert_allclose(both[0], family.sensitivities(theta, u, DT))
    few = family.keep(("delay", "stiffness"), theta)
    assert_allclose(few.sensitivities(theta[[3, 0]], u, DT), both[0][:, :, [3, 0]], atol=1e-13)
    with pytest.raises(DomainError, match="no parameter damping; there are stiffness, power"):
        family.keep(("damping",), theta)
