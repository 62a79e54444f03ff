import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import linalg

from structsel.errors import DataError, ModelError
from structsel.model import AeroModel, ResponseModel
from structsel.numerics.flight_model import STATES, outputs_index
from structsel.numerics.flight_simulation import Correction, linearise_batch, simulate_batch
from structsel.numerics.linear_models import LinearSystem
from structsel.numerics.linear_systems import discretise_noise, simulate_linear
from structsel.recording import Recording
from structsel.refinement import LinearStructure, refine
from structsel.refinement.filter_kernels import diagonal, predict_linear, steady_gain
from structsel.simulation import prepare, published_aircraft, simulate, trim
from structsel.simulation.library.linear import as355
from tests.linear_flights import fly_by_solver, pitch, recording, three_two_one_one

# --- kernels --------------------------------------------------------------------------------------


def systems(seed=0, m=6, s=4, c=3):
    """Stable and growing systems, their states and outputs of very different sizes."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((m, s, s))
    A[0] -= 3.0 * np.eye(s)
    C = rng.standard_normal((m, c, s)) * [1.0, 100.0, 0.01, 1.0]
    noise = np.abs(rng.standard_normal((m, s))) * [1.0, 1e-3, 10.0, 0.1]
    return A, C, noise, rng.uniform(0.01, 1.0, (m, c)) ** 2


def test_the_steady_gain_is_that_of_scipys_riccati_equation():
    A, C, noise, R = systems()
    Phi, Q = discretise_noise(A, diagonal(noise**2), 0.1)
    K, P = steady_gain(Phi, C, Q, R)
    for j in range(len(A)):
        X = linalg.solve_discrete_are(Phi[j].T, C[j].T, Q[j], np.diag(R[j]))
        assert_allclose(P[j], X, rtol=1e-8, atol=1e-10 * np.abs(X).max())
        gain = X @ C[j].T @ np.linalg.inv(C[j] @ X @ C[j].T + np.diag(R[j]))
        assert_allclose(K[j], gain, rtol=1e-7, atol=1e-10 * np.abs(gain).max())


def test_noise_gathered_over_a_sample_is_the_formula():
    # One state: Q = q^2 (e^(2 a dt) - 1) / 2a.
    a, q, dt = -1.3, 0.7, 0.4
    Phi, Q = discretise_noise(np.array([[[a]]]), np.array([[[q**2]]]), dt)
    assert_allclose(Phi[0, 0, 0], np.exp(a * dt), rtol=1e-14)
    assert_allclose(Q[0, 0, 0], q**2 * (np.exp(2.0 * a * dt) - 1.0) / (2.0 * a), rtol=1e-13)


def test_a_growing_motion_that_no_output_shows_has_no_steady_gain():
    Phi = np.array([np.diag([0.9, 1.1]), np.diag([0.9, 0.8])])
    K, P = steady_gain(Phi, np.array([[[1.0, 0.0]]] * 2), np.array([np.eye(2)] * 2), np.ones((2, 1)))
    assert np.isnan(K[0]).all()
    assert np.isnan(P[0]).all()
    assert np.isfinite(K[1]).all()


def test_predictions_are_those_of_a_filter_written_out_and_gaps_correct_nothing():
    rng = np.random.default_rng(1)
    n, (A, C, noise, R) = 60, systems(1, m=2)
    Phi, Q = discretise_noise(A - 3.0 * np.eye(4), diagonal(noise**2), 0.1)
    K = steady_gain(Phi, C, Q, R)[0]
    push, feed = rng.standard_normal((2, n - 1, 4)), rng.standard_normal((2, n, 3))
    z, x0 = 10.0 * rng.standard_normal((2, n, 3)), rng.standard_normal((2, 4))
    z[0, 20:30, 1] = np.nan
    y = predict_linear(Phi, push, C, feed, x0, K, z)
    for j in range(2):
        x = x0[j]
        for k in range(n):
            expected = C[j] @ x + feed[j, k]
            assert_allclose(y[j, k], expected, rtol=1e-9)
            x = x + K[j] @ np.nan_to_num(z[j, k] - expected)
            if k < n - 1:
                x = Phi[j] @ x + push[j, k]


@pytest.fixture(scope="module")
def beaver():
    published = published_aircraft("beaver")
    model = AeroModel({name: held for name, held in published.model.responses.items() if name in ("CX", "CZ", "Cm")})
    converged = trim(model, published.aircraft, 45.0, 1500.0, free=("de", "thrust"), definitions={"dpt": "0*V"})
    t = np.arange(0.0, 6.0, 0.05)
    inputs = {"t": t, "de": converged.controls["de"] + three_two_one_one(t, 0.5, 0.3, 0.03)}
    return prepare(model, published.aircraft, inputs, start=converged, definitions={"dpt": "0*V"}), converged


def test_a_simulation_with_zero_gain_is_the_open_loop_simulation(beaver):
    made, _ = beaver
    names = ("V", "alpha", "q", "theta", "az")
    observed, states = outputs_index(names, instruments=True), np.array([STATES.index(s) for s in ("u", "w", "q")])
    full = np.tile(made.compiled.parameters(made.manoeuvre), (2, 1))
    full[1, made.compiled.parameter_index(["Cm:alpha"])] *= 1.3

    def fly(full, gain=None, measured=None):
        correction = None if gain is None else Correction(states, gain, measured)
        return simulate_batch(
            made.compiled, made.manoeuvre, full, np.arange(full.shape[1]), observed, substeps=made.substeps,
            correction=correction,
        ).outputs  # fmt: skip

    open_loop = fly(full)
    z = np.ones((2, len(made.manoeuvre.t), len(names)))
    alone = fly(full, np.zeros((2, 3, len(names))), z)
    assert_allclose(alone, open_loop, rtol=1e-10, atol=1e-12)
    # One measurement used, at the start: simulated from the corrected state; the first output is as predicted.
    z[:] = np.nan
    z[:, 0, 1] = open_loop[:, 0, 1] + 0.01
    gain = np.zeros((2, 3, len(names)))
    gain[:, 1, 1] = 30.0
    let_in = fly(full, gain, z)
    moved = full.copy()
    moved[:, made.compiled.parameter_index(["start:w"])] += 0.3
    from_there = fly(moved)
    assert_allclose(let_in[:, 1:], from_there[:, 1:], rtol=1e-10, atol=1e-12)
    assert_allclose(let_in[:, 0], open_loop[:, 0], rtol=1e-12)


def test_the_slopes_of_the_simulation_hold_kinematics_and_gravity(beaver):
    made, converged = beaver
    states = np.array([STATES.index(s) for s in ("u", "w", "q", "theta")])
    observed = outputs_index(("V", "theta", "az"))
    A, C = linearise_batch(
        made.compiled, made.manoeuvre, made.compiled.parameters(made.manoeuvre)[None], converged.state,
        made.manoeuvre.controls[0], states, observed,
    )  # fmt: skip
    theta, (u, _, w) = converged.state[7], converged.state[:3]
    g = made.manoeuvre.gravity
    assert_allclose(A[0, 3], [0.0, 0.0, 1.0, 0.0], atol=1e-9)
    assert_allclose(A[0, :2, 3], [-g * np.cos(theta), -g * np.sin(theta)], rtol=1e-6)
    assert_allclose(C[0, 0], [u / np.hypot(u, w), w / np.hypot(u, w), 0.0, 0.0], atol=1e-8)
    assert_allclose(C[0, 1], [0.0, 0.0, 0.0, 1.0], atol=1e-9)


# --- refine: a short period in turbulence ---------------------------------------------------------

TRUTH = {"zw": -1.34, "mw": -0.048, "mq": -1.67, "mde": -19.5}
PROCESS, NOISE = (2.0, 0.03), (0.3, 0.005)
CLOCK = np.arange(0.0, 20.0, 0.05)
LEVER = three_two_one_one(CLOCK, 0.5, 0.5, 0.02)


def turbulent(seed, process=PROCESS, noise=NOISE):
    """Simulated in twenty steps a sample, each with its own process noise."""
    rng = np.random.default_rng(seed)
    made = pitch().matrices(np.array([list(TRUTH.values())]))
    h = 0.05 / 20
    block = linalg.expm(np.block([[made.A[0], made.B[0]], [np.zeros((1, 3))]]) * h)
    x, y = np.zeros(2), np.empty((len(CLOCK), 2))
    for k in range(len(CLOCK)):
        y[k] = x
        for i in range(20 if k < len(CLOCK) - 1 else 0):
            u = LEVER[k] + (i + 0.5) / 20 * (LEVER[k + 1] - LEVER[k])
            x = block[:2, :2] @ x + block[:2, 2] * u + np.sqrt(h) * np.array(process) * rng.standard_normal(2)
    y += rng.standard_normal(y.shape) * noise
    return Recording(f"m{seed:02d}", CLOCK, {"de": LEVER, "w": y[:, 0], "q": y[:, 1]})


ROUGH = {"zw": -1.0, "mw": -0.03, "mq": -1.2, "mde": -15.0}


@pytest.fixture(scope="module")
def in_turbulence():
    flights = [turbulent(seed) for seed in range(12)]
    return {
        noise: [refine(pitch(**ROUGH), None, flight, noise=noise) for flight in flights]
        for noise in ("measurement", "process")
    }


def test_filter_error_finds_parameters_and_both_noises_in_turbulence(in_turbulence):
    found = in_turbulence["process"]
    assert all(f.converged for f in found)
    z = np.array([[(f[n].value - v) / f[n].std for n, v in TRUTH.items()] for f in found])
    assert np.abs(z).max() < 4.0
    assert np.mean(np.abs(z) < 1.96) > 0.85  # 48 intervals of 95 %: below 0.85 once in 100
    levels = np.array([[f["process:w"].value, f["process:q"].value] for f in found])
    # Each flight knows them to about 15 %, so twelve do to 4 %.
    assert_allclose(levels.mean(axis=0), PROCESS, rtol=0.13)


def test_its_innovations_are_white_where_output_errors_residuals_are_not(in_turbulence):
    def follow(f):
        (residuals,) = f.residuals.values()
        return [np.corrcoef(v[1:], v[:-1])[0, 1] for v in residuals.values()]

    limit = 3.0 / np.sqrt(len(CLOCK) * 12)
    assert np.abs(np.mean([follow(f) for f in in_turbulence["process"]], axis=0)).max() < limit + 0.02
    assert np.mean([follow(f) for f in in_turbulence["measurement"]]) > 0.5


def test_its_estimates_scatter_less(in_turbulence):
    error = {
        noise: np.array([[f[n].value / v - 1.0 for n, v in TRUTH.items()] for f in found])
        for noise, found in in_turbulence.items()
    }
    rms = {noise: np.sqrt(np.mean(e**2, axis=0)) for noise, e in error.items()}
    assert (rms["process"][1:] < rms["measurement"][1:]).all()


def test_in_calm_air_it_is_output_error_and_says_that_no_process_noise_is_needed():
    flight = turbulent(3, process=(0.0, 0.0))
    calm, filtered = (refine(pitch(**ROUGH), None, flight, noise=n) for n in ("measurement", "process"))
    assert filtered.converged
    off = [(filtered[n].value - calm[n].value) / calm[n].std_white for n in TRUTH]
    assert np.abs(off).max() < 0.7
    assert filtered["process:w"].value < 0.1 * NOISE[0]
    assert str(filtered).splitlines()[2].startswith("Filter error")
    assert filtered.to_dict()["noise"] == "process"


def test_gaps_scales_biases_and_several_recordings_go_with_it():
    flights = [turbulent(20), turbulent(21)]
    gone = flights[0]["w"].copy()
    gone[100:140] = np.nan
    flights[0] = flights[0].with_channels(w=gone, q=flights[0]["q"] + 0.02)
    flights[1] = flights[1].with_channels(w=1.2 * flights[1]["w"])
    flights[0] = flights[0].with_channels(w=1.2 * flights[0]["w"])
    found = refine(pitch(**ROUGH), None, flights, noise="process", biases=["q"], scales=["w"])
    assert found.converged
    assert found["scale:w"].value == pytest.approx(1.2, abs=4.0 * found["scale:w"].std)
    assert found["bias:m20:q"].value == pytest.approx(0.02, abs=4.0 * found["bias:m20:q"].std)
    assert found["bias:m21:q"].value == pytest.approx(0.0, abs=4.0 * found["bias:m21:q"].std)


def test_filter_error_cut_short_says_so_and_carries_its_best():
    found = refine(pitch(**ROUGH), None, turbulent(5), noise="process", iterations=1)
    assert not found.converged
    assert "NOT CONVERGED" in str(found)
    assert np.isfinite(found.values).all()
    assert found.costs[-1] < found.costs[0]


def test_rounds_that_do_not_converge_say_so_and_hand_over_the_lowest_cost(monkeypatch):
    monkeypatch.setattr("structsel.refinement.filter_error._ROUNDS", 2)
    flight, start = turbulent(5), pitch(**ROUGH)
    found = refine(start, None, flight, noise="process")
    assert not found.converged
    assert "not converged in 2 rounds" in found.message
    assert found.costs[-1] == found.costs.min()
    assert_allclose(found.thetas[-1], found.values)


def test_wrong_kinds_of_noise_are_refused():
    flight = turbulent(6)
    with pytest.raises(ModelError, match="'measurement' or 'process'"):
        refine(pitch(), None, flight, noise="turbulence")
    with pytest.raises(ModelError, match="needs domain='time'"):
        refine(pitch(), None, flight, noise="process", domain="frequency", band=(0.1, 1.0))
    with pytest.raises(ModelError, match="process noise of state 'theta'"):
        refine(pitch(), None, flight, noise="process", process=["theta"])


# --- delays of some inputs ------------------------------------------------------------------------


def test_a_delay_may_hold_for_one_input_of_two():
    A, B = np.array([[-1.34, 105.0], [-0.048, -1.67]]), np.array([[-21.8, 30.0], [-19.5, 4.0]])
    system = LinearSystem.of(("w", "q"), ("de", "df"), A, B)
    structure = LinearStructure.from_entries(system, {"mde": ("B", 1, 0), "mdf": ("B", 1, 1)})
    flap = 0.02 * np.sin(1.7 * CLOCK)
    fine = np.arange(0.0, CLOCK[-1] + 1e-9, 0.01)
    inputs = [np.interp(fine - 0.13, CLOCK, LEVER), np.interp(fine, CLOCK, flap)]
    y = fly_by_solver(structure, fine, inputs)[::5]
    flight = recording("m01", CLOCK, structure, [LEVER, flap], y, np.array([0.1, 0.002]), 7)
    found = refine(structure, None, flight, delay=["de"])
    assert found["delay"].value == pytest.approx(0.13, abs=0.01)
    assert found["mdf"].value == pytest.approx(4.0, abs=4.0 * found["mdf"].std_white)
    again = refine(found.model, None, flight, iterations=0)  # the structure remembers which input is late
    assert_allclose(again.costs[0], found.costs[-1], rtol=1e-9)
    both = refine(structure, None, flight, delay=True)
    assert both.costs[-1] > found.costs[-1] + 100.0
    filtered = refine(structure, None, flight, delay=["de"], noise="process")
    assert filtered["delay"].value == pytest.approx(0.13, abs=0.01)
    with pytest.raises(ModelError, match="delay of input 'dr'"):
        refine(structure, None, flight, delay=["dr"])


def test_a_recorded_thrust_is_not_delayed_with_the_controls(beaver):
    made, converged = beaver
    published = published_aircraft("beaver")
    model = AeroModel({name: held for name, held in published.model.responses.items() if name in ("CX", "CZ", "Cm")})
    t = made.manoeuvre.t
    thrust = converged.controls["thrust"] * (1.0 + 0.3 * np.sin(2.0 * t))
    commanded = converged.controls["de"] + three_two_one_one(t, 0.5, 0.3, 0.03)
    delayed = np.interp(t - 0.2, t, commanded)
    definitions = {"dpt": "0*V"}
    simulated = simulate(
        model, published.aircraft, {"t": t, "de": delayed, "thrust": thrust}, start=converged, definitions=definitions
    )
    flight = simulated.with_channels(de=commanded)
    options = {"free": ["Cm:de"], "outputs": ["V", "alpha", "q", "theta"], "definitions": definitions}
    found = refine(model, published.aircraft, flight, delay=True, **options)
    assert found["delay"].value == pytest.approx(0.2, abs=0.004)
    with_thrust = refine(model, published.aircraft, flight, delay=["de", "thrust"], **options)
    assert with_thrust.costs[-1] > found.costs[-1] + 100.0


# --- ready models and lateral motion --------------------------------------------------------------


def test_the_published_as355_gives_its_23_parameters_back_with_delay_and_angle_of_attack_scale():
    truth = as355("80kt", x_boom=2.5, x_acc=0.4, z_acc=0.2, bias=(0.02, -0.05, 0.004, 0.001),
                  y_ref=(0.01, 0.02, 0.15, -9.7, 0.05))  # fmt: skip
    t = np.arange(0.0, 25.0, 0.05)
    schedule = Recording("m01", t, {"dlon": three_two_one_one(t, 1.0, 0.8, 1.0)}, {"dlon": "unit"})
    noise = {"alpha": 0.003, "q": 0.002, "ax": 0.05, "az": 0.05, "theta": 0.002}
    flight = truth.simulate(schedule, hold="linear", noise=noise, seed=1)
    rng = np.random.default_rng(3)
    start = {
        name: 0.0 if name.startswith(("bias", "ref")) else value * rng.uniform(0.5, 1.5)
        for name, value in truth.parameters.items()
    }
    found = refine(truth.with_parameters(start), None, flight)
    assert found.converged
    assert len(found.names) == 23
    z = [(found[n].value - v) / found[n].std_white for n, v in truth.parameters.items()]
    assert np.abs(z).max() < 3.5
    assert found["tau"].value == pytest.approx(0.284, abs=0.01)
    assert found.model.parameters["K_alpha"] == found["K_alpha"].value


def lateral_flight():
    published = published_aircraft("beaver")
    own = {"CX": {"1": -0.04, "alpha": 0.05, "alpha^2": 4.0},
           "CZ": {"1": -0.2, "alpha": -5.2, "q_hat": -6.0, "de": -0.4},
           "Cm": {"1": 0.06, "alpha": -0.9, "q_hat": -28.0, "de": -1.9},
           "CY": {"beta": -0.77, "dr": 0.12}, "Cl": {"beta": -0.062, "p_hat": -0.5, "r_hat": 0.17, "da": -0.099},
           "Cn": {"beta": 0.05, "p_hat": -0.06, "r_hat": -0.11, "dr": -0.083}}  # fmt: skip
    model = AeroModel({n: ResponseModel(tuple(terms), list(terms.values())) for n, terms in own.items()}, "truth")
    converged = trim(model, published.aircraft, 47.0, 1000.0, free=("de", "da", "dr", "thrust"))
    t = np.arange(0.0, 12.0, 0.05)
    rudder = 0.06 * (((t >= 1.0) & (t < 1.8)) * 1.0 - ((t >= 1.8) & (t < 2.6)))
    aileron = 0.08 * (((t >= 6.0) & (t < 6.6)) * 1.0 - ((t >= 6.6) & (t < 7.2)))
    simulated = simulate(model, published.aircraft, {"t": t, "da": aileron, "dr": rudder}, start=converged)
    rng = np.random.default_rng(0)
    noise = {"beta": 0.002, "p": 0.003, "r": 0.002, "phi": 0.003, "ay": 0.05}
    noisy = {name: simulated[name] + std * rng.standard_normal(len(t)) for name, std in noise.items()}
    return model, published.aircraft, simulated.with_channels(**noisy), list(noise)


@pytest.mark.parametrize("noise", ["measurement", "process"])
def test_lateral_derivatives_of_an_aeromodel_come_back(noise):
    model, aircraft, flight, outputs = lateral_flight()
    truth = {f"{r}:{term}": v for r in ("CY", "Cl", "Cn") for term, v in zip(model[r].terms, model[r].values)}
    rng = np.random.default_rng(4)
    found = refine(
        model, aircraft, flight, free=list(truth), guess={n: v * rng.uniform(0.6, 1.4) for n, v in truth.items()},
        outputs=outputs, starts=["v", "p", "r", "phi"], noise=noise,
    )  # fmt: skip
    assert found.converged
    assert max(abs(found[n].value - v) / found[n].std_white for n, v in truth.items()) < 3.6
    if noise == "process":
        assert [n for n in found.names if n.startswith("process")] == [f"process:{s}" for s in ("v", "p", "r", "phi")]


def test_a_model_without_lift_is_refused():
    model, aircraft, flight, outputs = lateral_flight()
    alone = AeroModel({name: model[name] for name in ("CY", "Cl", "Cn")})
    with pytest.raises(ModelError, match="would fall"):
        refine(alone, aircraft, flight, outputs=outputs)


def test_a_linear_model_with_inputs_predicts_what_simulate_linear_computes():
    # No feedback, one of two inputs late: the sum of two flights, each with all its inputs equally late.
    A, B, C = np.array([[-1.0, 9.0], [-2.0, -1.5]]), np.array([[1.0, -3.0], [2.0, 0.5]]), np.eye(2)
    D = np.array([[0.1, 0.2], [0.0, 0.3]])
    system = LinearSystem.of(("w", "q"), ("de", "df"), A, B, D=D)
    structure = LinearStructure.from_entries(system, {"a": ("A", 0, 0)})
    u = np.random.default_rng(3).standard_normal((50, 2))
    flight = Recording("m01", 0.1 * np.arange(50), {"de": u[:, 0], "df": u[:, 1], "w": u[:, 0], "q": u[:, 1]})
    for tau in (0.0, 0.23, 0.3):
        parts = [
            simulate_linear(A, B * on, C, D * on, u, 0.1, delay=delayed, hold="linear")
            for on, delayed in ((np.array([1.0, 0.0]), tau), (np.array([0.0, 1.0]), 0.0))
        ]
        found = refine(
            structure, None, flight, free=["a"], delay=["de"], bounds={"delay": (tau, tau + 1e-9)}, iterations=0
        )
        assert_allclose(np.column_stack([found.simulated[0][c] for c in "wq"]), sum(parts), atol=1e-7)


def test_an_output_that_was_never_sampled_is_refused():
    flight = turbulent(8)
    with pytest.raises(DataError, match="output 'w', but no recording has a sample of it"):
        refine(pitch(), None, flight.with_channels(w=np.full(len(CLOCK), np.nan)), noise="process")
