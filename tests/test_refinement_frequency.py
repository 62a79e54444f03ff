import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.errors import DataError, DomainError, ModelError
from structsel.model import AeroModel, ResponseModel
from structsel.numerics.frequency_regression import sampled_response
from structsel.numerics.linear_models import LinearSystem
from structsel.numerics.linear_systems import interval, simulate_linear
from structsel.numerics.score_covariance import spectral_score_covariance
from structsel.recording import Recording
from structsel.refinement import LinearStructure, compare_estimates, equation_error, refine
from structsel.simulation.library.linear import as355
from tests.linear_flights import AS355, fly_by_solver, helicopter, pitch, recording, three_two_one_one

T = np.arange(0.0, 20.0, 0.05)
LEVER = three_two_one_one(T, 0.5, 0.4, 0.02)
TRUTH = {"zw": -1.34, "mw": -0.048, "mq": -1.67, "mde": -19.5}
NOISE = np.array([0.3, 0.005])


def pitch_flight(seed=1, noise=NOISE, start=(0.0, 0.0)):
    y = fly_by_solver(pitch(), T, [LEVER], start=start)
    return recording(f"m{seed:02d}", T, pitch(), [LEVER], y, noise, seed)


ROUGH = {"mw": -0.03, "mq": -1.0, "mde": -15.0}


@pytest.mark.parametrize("hold", ["linear", "hold"])
@pytest.mark.parametrize("part", [0.0, 0.4])
def test_the_sampled_response_is_the_transform_of_the_flight_to_the_last_digit(hold, part):
    rng = np.random.default_rng(2)
    A, B = np.array([[[-1.3, 0.9], [-4.8, -1.7]]]), np.array([[[0.4], [-19.5]]])
    C, n, dt = np.array([[[1.0, 0.0], [-30.0, 0.5]]]), 80, 0.1
    u = np.concatenate([[[0.0]] * 3, rng.standard_normal((n - 2, 1))])  # one more, to see the state after the last
    y, x = simulate_linear(
        A, B, C, np.zeros((2, 1)), u, dt, delay=part * dt, x0=np.array([0.2, -1.0]), hold=hold, return_states=True
    )
    f = np.arange(1, n // 2) / (n * dt)
    W = np.exp(-2j * np.pi * np.outer(f, dt * np.arange(n)))
    Phi, _, G = interval(A, B, dt, np.array([part]), hold)
    k = np.arange(n)
    push = sum((u[np.clip(k - 1 + e, 0, None)] @ G[e, 0].T) for e in range(3))
    found = sampled_response(
        Phi, (W @ push)[None], C, np.zeros((1, f.size, 2)), np.exp(2j * np.pi * f * dt), x[:, 0] - x[:, n]
    )
    assert_allclose(found[0], W @ y[0, :n], rtol=1e-9, atol=1e-9)


def test_over_the_full_band_it_is_output_error_in_time():
    # In time with what the band does not hold set free: constants in states and outputs.
    flight = pitch_flight()
    in_time = refine(pitch(**ROUGH), None, flight, drifts="all", biases="all")
    in_band = refine(pitch(**ROUGH), None, flight, domain="frequency", band=(0.01, 9.999), starts="all")
    assert in_band.converged
    off = [(in_band[n].value - in_time[n].value) / in_time[n].std_white for n in TRUTH]
    assert np.abs(off).max() < 0.1
    assert_allclose([in_band[n].std_white for n in TRUTH], [in_time[n].std_white for n in TRUTH], rtol=0.05)
    assert_allclose(list(in_band.noise_std.values()), NOISE, rtol=0.12)
    assert "\nOutput error from 0.01 to 9.999 Hz" in str(in_band)
    assert in_band.to_dict()["band"] == [0.01, 9.999]
    assert in_band.residuals["m01"]["q"].dtype == complex
    near = in_band.simulated[0]["w"] - flight["w"]
    assert np.std(near) == pytest.approx(NOISE[0], rel=0.2)


def test_a_vibration_outside_the_band_does_no_harm():
    flight = pitch_flight(2)
    shaken = flight.with_channels(q=flight["q"] + 0.02 * np.sin(2.0 * np.pi * 6.0 * T))
    in_time = refine(pitch(**ROUGH), None, shaken)
    in_band = refine(pitch(**ROUGH), None, shaken, domain="frequency", band=(0.04, 2.0))
    z = [(in_band[n].value - v) / in_band[n].std for n, v in TRUTH.items()]
    assert np.abs(z).max() < 3.5
    assert in_band.noise_std["q"] == pytest.approx(NOISE[1], rel=0.3)
    assert in_time.noise_std["q"] > 2.5 * NOISE[1]
    assert all(in_band[n].std_white < in_time[n].std_white for n in ("mq", "mde"))


def test_the_unstable_as355_with_its_delay_comes_back_from_starts_off_by_half():
    t = np.arange(0.0, 25.0, 0.05)
    lever = three_two_one_one(t, 1.0, 0.8, 1.0)
    y = fly_by_solver(helicopter(), t, [lever], delay=0.284, drift=np.array([0.02, -0.05, 0.004, 0.001]), reference=0.3)
    flight = recording("m01", t, helicopter(), [lever], y, np.array([0.003, 0.002, 0.05, 0.05, 0.002]), 1)
    off = np.random.default_rng(3).uniform(0.5, 1.5, len(AS355))
    start = helicopter(**{name: value * f for (name, value), f in zip(AS355.items(), off)})
    found = refine(start, None, flight, delay=True, domain="frequency", band=(0.03, 3.0), starts="all")
    assert found.converged
    truth = {**AS355, "delay": 0.284}
    assert max(abs(found[n].value - v) / found[n].std_white for n, v in truth.items()) < 3.5


def test_the_published_as355_is_refined_in_the_frequency_domain_too():
    truth = as355("80kt", x_boom=2.5, x_acc=0.4, z_acc=0.2, bias=(0.02, -0.05, 0.004, 0.001))
    t = np.arange(0.0, 25.0, 0.05)
    schedule = Recording("m01", t, {"dlon": three_two_one_one(t, 1.0, 0.8, 1.0)}, {"dlon": "unit"})
    noise = {"alpha": 0.003, "q": 0.002, "ax": 0.05, "az": 0.05, "theta": 0.002}
    flight = truth.simulate(schedule, hold="linear", noise=noise)
    free = [name for name in truth.parameters if not name.startswith(("bias", "ref"))]
    start = truth.with_parameters({name: 0.8 * truth.parameters[name] for name in free})
    found = refine(start, None, flight, free=free, domain="frequency", band=(0.03, 3.0), starts="all")
    assert found.converged
    assert max(abs(found[n].value - truth.parameters[n]) / found[n].std_white for n in free) < 3.5


def test_what_has_no_transform_is_refused():
    flight = pitch_flight()
    band = {"domain": "frequency", "band": (0.1, 2.0)}
    with pytest.raises(ModelError, match=r"biases \(bias:m01:w\)"):
        refine(pitch(), None, flight, biases=["w"], **band)
    with pytest.raises(ModelError, match=r"needs band=\(low, high\)"):
        refine(pitch(), None, flight, domain="frequency")
    with pytest.raises(DomainError, match="no frequency"):
        refine(pitch(), None, flight, domain="frequency", band=(0.051, 0.052))
    with pytest.raises(DataError, match="below half its sampling frequency"):
        refine(pitch(), None, flight, domain="frequency", band=(10.5, 12.0))
    gone = flight["w"].copy()
    gone[5] = np.nan
    with pytest.raises(DataError, match="'w'"):
        refine(pitch(), None, flight.with_channels(w=gone), **band)


def test_standard_errors_allow_for_the_shape_of_the_spectrum():
    # Least squares on transforms whose noise is three times as strong at one end of the band as at the other.
    rng = np.random.default_rng(4)
    f, k = 150, 2
    S = rng.standard_normal((k, 2 * f, 1))
    S[0] *= np.tile(np.linspace(2.0, 0.1, f), 2)[:, None]  # excited where the noise is strong
    level = np.tile(np.linspace(3.0, 1.0, f), 2)
    D = np.linalg.inv(S[:, :, 0] @ S[:, :, 0].T)
    errors, claimed, white = [], [], []
    for _ in range(400):
        v = level * rng.standard_normal(2 * f)
        theta = D @ (S[:, :, 0] @ v)
        s = np.std(v)
        residual = (v - theta @ S[:, :, 0]) / s
        errors.append(theta)
        claimed.append(np.diag(D @ spectral_score_covariance(S, residual[:, None]) @ D) * s**2)
        white.append(np.diag(D) * s**2)
    ratio = np.var(errors, axis=0) / np.mean(claimed, axis=0)
    assert_allclose(ratio, 1.0, atol=0.25)  # a variance of 400: 7 %, here at 3.5 of that
    assert (np.var(errors, axis=0) / np.mean(white, axis=0))[0] > 1.25


# --- equation error -------------------------------------------------------------------------------


def test_equation_error_of_a_linear_structure_finds_it_without_noise_in_time_and_over_a_band():
    flight = pitch_flight(noise=None)
    rates = pitch().matrices(np.array([list(TRUTH.values())]))
    moved = np.column_stack([flight["w"], flight["q"]])
    x_dot = moved @ rates.A[0].T + LEVER[:, None] @ rates.B[0].T
    flight = flight.with_channels(w_dot=x_dot[:, 0], q_dot=x_dot[:, 1])
    for options in ({}, {"domain": "frequency", "band": (0.05, 2.0)}):
        found = equation_error(pitch(**ROUGH), None, flight, **options)
        for name, value in TRUTH.items():
            assert found[name][0] == pytest.approx(value, rel=1e-6)
        assert found.model.parameters["mde"] == found["mde"][0]
        assert found.r2["q_dot"] == pytest.approx(1.0, abs=1e-6)


def test_equation_error_over_a_band_keeps_noise_out_that_biases_it_in_time():
    flights = [pitch_flight(seed) for seed in range(12)]
    errors = {}
    for name, options in (("time", {}), ("band", {"domain": "frequency", "band": (0.04, 1.2)})):
        found = [equation_error(pitch(), None, f, **options) for f in flights]
        errors[name] = np.abs(np.mean([f["mq"][0] for f in found]) / TRUTH["mq"] - 1.0)
    assert errors["band"] < 0.6 * errors["time"]


def test_methods_stand_side_by_side_over_several_recordings():
    flights = [pitch_flight(5), pitch_flight(6, start=(0.5, -0.02))]
    band = {"domain": "frequency", "band": (0.04, 1.2)}
    table = compare_estimates(
        {
            "equation error": equation_error(pitch(**ROUGH), None, flights),
            "equation error, band": equation_error(pitch(**ROUGH), None, flights, **band),
            "output error": refine(pitch(**ROUGH), None, flights, starts="all"),
            "output error, band": refine(pitch(**ROUGH), None, flights, starts="all", **band),
        },
        truth=TRUTH,
    )
    assert table.parameters == tuple(TRUTH)
    held = np.abs(table.values - table.truth[:, None]) < 3.5 * table.std
    assert held[:, 2:].all()
    text = str(table)
    assert "* where the truth lies outside" in text
    assert text.count("*") - 1 == np.sum(np.abs(table.values - table.truth[:, None]) > 1.959964 * table.std)


def test_equation_error_of_an_aeromodel_is_regression_and_constants_have_no_band():
    rng = np.random.default_rng(7)
    alpha, q_hat = np.cumsum(rng.standard_normal((2, 400)), axis=1) * 0.01
    flights = [
        Recording(
            f"m{k}", 0.05 * np.arange(400), {"alpha": alpha, "q_hat": q_hat, "Cm": level - 0.6 * alpha - 12.0 * q_hat}
        )
        for k, level in ((1, 0.1), (2, 0.1))
    ]
    model = AeroModel({"Cm": ResponseModel(("1", "alpha", "q_hat"), [0.0, 0.0, 0.0])})
    found = equation_error(model, None, flights)
    assert_allclose(found.values, [0.1, -0.6, -12.0], rtol=1e-9)
    assert found.model["Cm"]["q_hat"] == found["Cm:q_hat"][0]
    band = equation_error(model, None, flights, domain="frequency", band=(0.05, 2.0))
    assert_allclose(band.values[1:], [-0.6, -12.0], rtol=1e-9)
    assert np.isnan(band.values[0])
    assert "from 0.05 to 2 Hz" in str(band)
    assert list(band.to_frame()["name"]) == ["Cm:1", "Cm:alpha", "Cm:q_hat"]


def test_equation_error_refuses_what_it_cannot_solve():
    flight = pitch_flight()
    system = LinearSystem.of(("w", "q"), ("de",), np.array([[-1.0, 105.0], [-1.0, -1.67]]), np.ones((2, 1)))
    shared = LinearStructure.from_entries(system, {"k": [("A", 0, 0), ("A", 1, 0)]})
    with pytest.raises(ModelError, match="k of 'linear model' occur in several"):
        equation_error(shared, None, flight)
    with pytest.raises(DataError, match=r"cannot determine the terms of q_dot \(mde\)"):
        equation_error(pitch(), None, flight.with_channels(de=0.0 * T))
    with pytest.raises(ModelError, match="domain='frequency' with band"):
        equation_error(pitch(), None, flight, domain="frequency")
    model = AeroModel({"Cm": ResponseModel(("1", "alpha"), [0.0, 0.0])})
    with pytest.raises(ModelError, match="needs the aircraft"):
        equation_error(model, None, flight)
    bent = LinearStructure(
        ("w",), ("de",), ("w",), {"a": -1.0},
        lambda p: {"A": (p["a"] ** 2)[:, None, None], "B": np.eye(1), "C": np.eye(1), "D": np.zeros((1, 1))},
    )  # fmt: skip
    with pytest.raises(ModelError, match="linear in their parameters"):
        equation_error(bent, None, flight)
