"""Optimal inputs: their information against brute force, limits, and the scatter of estimates."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from structsel import read_recording
from structsel.errors import ModelError
from structsel.inputs import (
    combine,
    compare_inputs,
    design_inputs,
    doublet,
    energy,
    information,
    mehra,
    scatter,
    schulz,
    with_energy,
)
from structsel.inputs.criteria import DesignProblem, elementary_matrices
from structsel.inputs.mehra_schulz import optimal_powers, sensitivity_response
from structsel.inputs.optimal import frame, newton, orthonormal_functions, spherical
from structsel.simulation.library.linear import as355, hawk

NOISE = {"w": 0.3, "q": 0.003}


def short_period():
    return hawk().keep("w", "q")


@pytest.fixture(scope="module")
def comparison():
    return compare_inputs(short_period(), noise=NOISE, energy=0.01, duration=15.0, dt=0.05)


@pytest.mark.parametrize("basis", ["sines", "fourier", "legendre"])
def test_the_functions_are_orthonormal(basis):
    phi = orthonormal_functions(basis, 12, 301, 0.05)
    assert_allclose(0.05 * phi @ phi.T, np.eye(12), atol=1e-12)
    if basis == "sines":
        assert_allclose(phi[:, [0, -1]], 0.0, atol=1e-12)
        assert_allclose(phi[1], np.sqrt(2 / 15) * np.sin(2 * np.pi * np.arange(301) / 300), atol=1e-12)


def a_problem(criterion, of_interest=(0, 1, 2, 3), limits=None):
    S = np.random.default_rng(1).normal(size=(7, 40, 4)) * [1.0, 2.0, 0.5, 1.0]
    rows = np.zeros((0, 6)) if limits is None else limits
    return DesignProblem(elementary_matrices(S), criterion, np.array(of_interest), 2.0, rows), S


def test_the_information_is_quadratic_in_the_coefficients():
    problem, S = a_problem("A")
    a = np.random.default_rng(2).normal(size=6)
    complete = S[0] + np.tensordot(a, S[1:], 1)
    assert_allclose(problem.information(a), complete.T @ complete, rtol=1e-12)


@pytest.mark.parametrize("criterion", ["A", "D", "trace", "E"])
@pytest.mark.parametrize("of_interest", [(0, 1, 2, 3), (1, 3)])
def test_slope_and_curvature_of_every_criterion_are_central_differences(criterion, of_interest):
    problem, _ = a_problem(criterion, of_interest)
    a = np.random.default_rng(3).normal(size=6)
    value, slope, curvature = problem.derivatives(a)
    assert value == problem.values(a[None])[0]
    for i, e in enumerate(np.eye(6) * 1e-5):
        up, down = problem.values(np.array([a + e, a - e]))
        assert_allclose(slope[i], (up - down) / 2e-5, rtol=1e-6, atol=1e-8)
        assert_allclose(
            curvature[i], (problem.derivatives(a + e)[1] - problem.derivatives(a - e)[1]) / 2e-5, rtol=1e-5, atol=1e-7
        )


@given(seed=st.integers(0, 1000))
def test_spherical_angles_keep_the_energy_and_have_the_slope_and_curvature_claimed(seed):
    rng = np.random.default_rng(seed)
    assert_allclose(np.linalg.norm(spherical(rng.uniform(0, 2 * np.pi, 5))), 1.0, rtol=1e-14)
    direction = rng.normal(size=6)
    direction /= np.linalg.norm(direction)
    turned = frame(direction)
    assert_allclose(turned.T @ turned, np.eye(6), atol=1e-14)
    assert_allclose(turned[:, -1], direction, atol=1e-14)
    h, middle = 1e-4, np.full(5, np.pi / 2)
    for i, e in enumerate(np.eye(5) * h):
        up, down = turned @ spherical(middle + e), turned @ spherical(middle - e)
        assert_allclose((up - down) / (2 * h), -turned[:, i], atol=1e-8)
        assert_allclose((up + down - 2 * direction) / h**2, -direction, atol=1e-6)
        for d in np.eye(5)[i + 1 :] * h:
            corners = [turned @ spherical(middle + s * e + t * d) * s * t for s in (1, -1) for t in (1, -1)]
            assert_allclose(np.sum(corners, axis=0) / (4 * h**2), 0.0, atol=1e-6)


def test_newton_on_the_trace_ends_at_the_leading_eigenvector():
    # Without a constant part, trace M is a quadratic form of a, so its largest value is known.
    S = np.random.default_rng(4).normal(size=(7, 30, 3))
    S[0] = 0.0
    problem = DesignProblem(elementary_matrices(S), "trace", np.arange(3), 2.0, np.zeros((0, 6)))
    T = np.einsum("ijll->ij", problem.elementary[1:, 1:])
    found = newton(problem, np.ones(6))
    assert found.converged
    assert_allclose(-found.value, 2.0 * np.linalg.eigvalsh(T)[-1], rtol=1e-10)
    assert len(found.history) < 15


@pytest.mark.parametrize("criterion", ["A", "D", "E"])
def test_newton_converges_quadratically_to_where_the_slope_vanishes(criterion):
    problem, _ = a_problem(criterion)
    found = newton(problem, np.array([1.0, 0.2, -0.3, 0.5, 0.1, 0.7]))
    assert found.converged
    _, slope, _ = problem.derivatives(found.a)
    square = slope - found.a * (found.a @ slope) / (found.a @ found.a)
    assert np.linalg.norm(square) < 1e-7 * np.linalg.norm(found.a) * (1 + abs(found.value))
    assert_allclose(found.a @ found.a, 2.0, rtol=1e-12)
    before, last = [size for _, size in found.history][-2:]
    assert last < 1e-2 * before


def test_mehra_powers_satisfy_the_equivalence_theorem():
    model, noise = short_period(), NOISE
    names = tuple(model.parameters)
    lines = np.arange(1, 25)
    S = sensitivity_response(model, names, 2 * np.pi * lines / 15.0, noise)[:, :, :, 0]
    M = np.einsum("lok,lom->lkm", S.conj(), S).real
    power = optimal_powers(M)
    assert_allclose(power.sum(), 1.0)
    gain = np.einsum("kl,ilk->i", np.linalg.inv(np.tensordot(power, M, 1)), M)
    assert gain.max() < 6 * (1 + 1e-5)
    assert_allclose(gain[power > 1e-3], 6.0, rtol=1e-3)


def test_the_frequency_response_of_the_sensitivities_is_what_a_long_sine_shows():
    model = as355("80kt").with_parameters(Xu=-0.3, Xw=0.0, Zu=0.0, Zw=-0.6, Mu=0.01, Mw=-0.02, Mq=-2.0)
    names, omega = ("Mq", "tau", "K_alpha", "Zd"), 1.3
    assert model.modes().eigenvalues.real.max() < -0.1  # so that a steady state exists
    dt = 2 * np.pi / omega / 400
    t = dt * np.arange(400 * 60)
    family = model.family.keep(names, model.theta)
    theta = np.array([model.parameters[n] for n in names])
    S = family.sensitivities(theta, np.sin(omega * t)[:, None], dt, hold="linear")[-400:]
    measured = 2j / 400 * np.einsum("t,tok->ok", np.exp(-1j * omega * t[-400:]), S)
    noise = dict.fromkeys(model.outputs, 1.0)
    want = sensitivity_response(model, names, np.array([omega]), noise)[0, :, :, 0]
    assert_allclose(measured, want, atol=2e-4 * np.abs(want).max())


def test_schulz_has_the_largest_trace_of_any_input_of_its_energy():
    model, n, dt = short_period(), 101, 0.1
    u = schulz(model, noise=NOISE, energy=0.01, duration=10.0, dt=dt)
    assert_allclose(energy(u), 0.01, rtol=1e-9)
    sizes = np.abs(np.array(list(model.parameters.values())))
    got = np.sum(np.diag(information(model, u, noise=NOISE).matrix) * sizes**2)
    # The operator as a dense matrix, one unit pulse after another.
    basis = np.zeros((n, n, 1))
    basis[np.arange(n), np.arange(n), 0] = 1.0
    basis = basis[1:]  # a pulse at the first sample would have been there before the record too
    S = model.family.sensitivities(model.theta, basis, dt) / np.array([0.3, 0.003])[:, None] * sizes
    K = np.einsum("anok,bnok->ab", S, S, optimize=True)
    assert_allclose(got, 0.01 / dt * np.linalg.eigvalsh(K)[-1], rtol=1e-3)


def test_all_inputs_compared_have_the_same_energy(comparison):
    assert [u.name for u in comparison.inputs] == [
        "doublet", "3-2-1-1", "2-1-1-1", "frequency sweep", "multisine", "Mehra", "Schulz", "optimal A", "optimal D",
    ]  # fmt: skip
    for u in comparison.inputs:
        assert_allclose(energy(u), 0.01, rtol=1e-9)


def test_no_input_has_more_information_by_a_criterion_than_the_one_optimised_for_it(comparison):
    frame = comparison.to_frame().set_index("input")
    others = frame.drop(index=["optimal A", "optimal D"])
    # Measured on the Hawk's short period: A 20 to 80 % lower than any other, D 8 % lower than Mehra's.
    assert frame.loc["optimal A", "A"] < 0.85 * others["A"].min()
    assert frame.loc["optimal D", "D"] < 0.95 * others["D"].min()
    assert frame.loc["optimal A", "A"] <= frame.loc["optimal D", "A"]
    assert frame.loc["optimal D", "D"] <= frame.loc["optimal A", "D"]
    ratios = comparison.ratios()
    assert_allclose(ratios.loc["optimal A"], 1.0)
    assert (ratios.loc[["doublet", "3-2-1-1", "Schulz"]] > 1.0).all(axis=None)
    assert "optimal A" in str(comparison)


@pytest.mark.parametrize("runs", [40, pytest.param(500, marks=pytest.mark.slow)])
def test_estimates_from_many_flights_scatter_as_the_bound_says(comparison, runs):
    # The standard deviation of 500 estimates has a standard error of 3.2 %, of 40 estimates 11 %; 3.5 of them over 54
    # parameters and inputs.
    found = {u.name: scatter(short_period(), u, noise=NOISE, runs=runs, seed=5) for u in comparison.inputs}
    for name, result in found.items():
        table = result.to_frame()
        assert result.lost == 0
        assert_allclose(table["ratio"], 1.0, atol=3.5 / np.sqrt(2 * (runs - 1)), err_msg=name)
        assert (np.abs(table["bias"]) < 4 * table["bias_error"]).all(), name
    total = {name: np.sum((s.std / np.abs(s.truth)) ** 2) for name, s in found.items()}
    assert total["optimal A"] < min(total[k] for k in ("doublet", "3-2-1-1", "Mehra", "Schulz"))


def test_the_scatter_of_any_estimator_can_be_computed():
    model, u = short_period(), doublet("de", 0.05, duration=8.0, dt=0.05)

    def by_least_squares(flight):
        X = np.column_stack([flight["w"], flight["q"], flight["de"]])[:-1]
        return np.linalg.lstsq(X, np.diff(flight["q"]) / 0.05, rcond=None)[0]

    found = scatter(model, u, noise=NOISE, parameters=["mw", "mq", "mde"], runs=100, estimate=by_least_squares)
    # Differences of noisy states, fitted on noisy states, are biased and worse than the bound.
    assert (found.std > 1.5 * found.crlb).all()
    assert np.abs(found.bias[1]) > 3 * found.std[1] / 10


def test_a_design_for_two_terms_determines_their_worst_combination_best(comparison):
    model = short_period()
    design = design_inputs(model, noise=NOISE, to_separate=["zq", "zde"], energy=0.01, duration=15.0)

    def worst(info):
        rows = [info.parameters.index(n) for n in ("zq", "zde")]
        sizes = np.array([1.379, 21.849])
        return np.linalg.eigvalsh(info.covariance[np.ix_(rows, rows)] / np.outer(sizes, sizes))[-1]

    assert design.converged
    assert_allclose(worst(design.information), design.value, rtol=1e-6)
    assert design.value < min(worst(info) for info in comparison.found)
    assert "of zq, zde" in str(design)


def test_limits_on_amplitude_rate_and_excursion_hold_and_are_said(tmp_path):
    model, limits = hawk().keep("w", "q"), {"de": 0.03, "alpha": 0.04, "q": 0.15}
    design = design_inputs(model, noise=NOISE, energy=0.01, duration=15.0, limits=limits, rate_limits={"de": 0.1})
    flight = model.simulate(design.to_recording())
    assert np.abs(flight["de"]).max() <= 0.03 * (1 + 1e-9)
    assert np.abs(flight["w"]).max() / 105.5 <= 0.04 * (1 + 1e-9)
    assert np.abs(flight["q"]).max() <= 0.15 * (1 + 1e-9)
    assert np.abs(np.diff(flight["de"])).max() / 0.05 <= 0.1 * (1 + 1e-9)
    assert {r.what: r.allowed for r in design.limits} == limits | {"rate of de": 0.1}
    assert_allclose(design.limits[1].reached, np.abs(flight["w"]).max() / 105.5, rtol=1e-9)
    assert "not the given 0.01" in str(design)
    assert design.energy < 0.01
    # Shaped by the limits it tells more than the free shape merely scaled down to them.
    free = design_inputs(model, noise=NOISE, energy=0.01, duration=15.0)
    simulated = model.simulate(free.inputs)
    over = max(
        np.abs(simulated["de"]).max() / 0.03,
        np.abs(simulated["w"]).max() / 105.5 / 0.04,
        np.abs(simulated["q"]).max() / 0.15,
        np.abs(np.diff(simulated["de"])).max() / 0.05 / 0.1,
    )
    assert design.value < 0.8 * free.value * over**2
    assert free.limits == ()
    assert_allclose(free.energy, 0.01, rtol=1e-9)
    back = read_recording(design.write(tmp_path / "input.csv"))
    assert_allclose(back["de"], design.inputs["de"], atol=1e-12)


def test_limits_that_are_not_reached_change_nothing():
    model = short_period()
    free = design_inputs(model, noise=NOISE, energy=0.001, duration=10.0)
    same = design_inputs(model, noise=NOISE, energy=0.001, duration=10.0, limits={"de": 1.0})
    assert_allclose(same.inputs["de"], free.inputs["de"])
    assert same.notes == ()


def test_limits_alone_set_the_energy():
    design = design_inputs(short_period(), noise=NOISE, duration=10.0, limits={"alpha": 0.03})
    assert_allclose(max(r.reached / r.allowed for r in design.limits), 1.0, rtol=1e-6)
    assert "the limits set the energy" in str(design)


def test_two_inputs_are_designed_together_with_biases_estimated_too():
    model = hawk("lateral")
    noise = {"v": 0.3, "p": 0.005, "r": 0.003, "phi": 0.005}
    names = ("yv", "lv", "lp", "lr", "lda", "ldr", "nv", "nr", "nda", "ndr")
    design = design_inputs(
        model, noise=noise, parameters=names, criterion="D", energy=0.02, duration=15.0, functions=12
    )
    assert design.inputs.names == ("da", "dr")
    assert_allclose(energy(design.inputs), 0.02, rtol=1e-9)
    plain = with_energy(
        combine(
            doublet("da", 1.0, 0.8, start=0.5, duration=15.0, dt=0.05),
            doublet("dr", 1.0, 1.2, start=5.0, duration=15.0, dt=0.05),
        ),
        0.02,
    )
    other = information(model, plain, noise=noise, parameters=names)
    assert np.linalg.slogdet(design.information.covariance)[1] < np.linalg.slogdet(other.covariance)[1] - 2.0


def test_a_design_is_the_same_every_time():
    one, two = (design_inputs(short_period(), noise=NOISE, energy=0.01, duration=8.0, seed=3) for _ in range(2))
    assert_allclose(one.coefficients, two.coefficients, rtol=0, atol=0)


def test_designs_that_cannot_be_meant_are_refused_by_name():
    model = short_period()
    with pytest.raises(ModelError, match="needs an energy, or limits"):
        design_inputs(model, noise=NOISE)
    with pytest.raises(ModelError, match="to_separate names at least two of the parameters"):
        design_inputs(model, noise=NOISE, energy=1.0, to_separate=["mw", "mu"])
    with pytest.raises(ModelError, match="has no output az; it has w, q"):
        design_inputs(model, noise={"az": 0.1}, energy=1.0)
    with pytest.raises(ModelError, match="noise above zero"):
        design_inputs(model, noise={"q": 0.0}, energy=1.0)
    with pytest.raises(ModelError, match=r"xq of 'Hawk, longitudinal' is zero.*parameter_scales=\{'xq': 0.1\}"):
        design_inputs(hawk(), noise={"q": 0.01}, energy=1.0, parameters=["xq", "mq"])
    with pytest.raises(ModelError, match="no 'beta' to limit"):
        design_inputs(model, noise=NOISE, energy=1.0, limits={"beta": 0.1})
    # No elevator input moves what only the rudder moves, and what is not measured tells nothing.
    with pytest.raises(ModelError, match=r"any input of this kind.*\n.*ref_q does not affect the measured outputs"):
        design_inputs(
            as355(), noise={"theta": 0.01}, energy=1.0, parameters=["Mq", "ref_q"], parameter_scales={"ref_q": 1.0}
        )
    with pytest.raises(ModelError, match="needs more than the 1 harmonics"):
        mehra(model, noise=NOISE, energy=1.0, low=0.1, high=0.19, duration=10.0)
