"""A simulation of any form against recordings: what was left out is located, and what cannot be compared is refused."""

import sys
from dataclasses import replace
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.aircraft import Simulation
from structsel.comparison import free_simulation
from structsel.comparison.compare import compare
from structsel.comparison.preparing import prepare
from structsel.comparison.simulations import open_simulation
from structsel.comparison.surrogate import identify
from structsel.comparison.tolerances import biases_of, tolerances_of
from structsel.diagnosis.extending import as_models
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.scoring import score_all
from structsel.diagnosis.weighing import log_bayes
from structsel.errors import DataError, ModelError
from structsel.model import AeroModel
from structsel.recording import Recording
from tests.models import model_of
from tests.noisy_flights import AIRCRAFT, DT, TRUTH, T, flights_with, fly, tried

LIFT = {"CZ": {"alpha^2": -6.0}}


@pytest.fixture(scope="module")
def flights_and_truth():
    return fly(LIFT, speeds=(40.0, 45.0, 50.0, 55.0), h=(1000.0,) * 4)


def files(recordings, stated):
    return {r.name: Recording(r.name, r.t, s) for r, s in zip(recordings, stated)}


def altered(recordings, which, **channels):
    """The recordings as if a simulation had produced them, some channels of one exchanged."""
    made = {r.name: Recording(r.name, r.t, dict(r.channels)) for r in recordings}
    made[which] = Recording(which, made[which].t, {**made[which].channels, **channels})
    return made


def test_a_forced_simulation_is_compared_and_its_difference_found(flights_and_truth):
    recordings, stated = flights_and_truth
    seen = []
    found = compare(files(recordings, stated), recordings, AIRCRAFT, progress=lambda *step: seen.append(step))
    assert found.form == "forced"
    assert found.recordings == ("m01", "m02", "m03", "m04")
    assert found.explainable["CZ"] > 0.5
    # The others have nothing to explain but noise.
    assert found.explainable["CY"] < 0.1
    assert found.sizes["CZ"].difference > 2.0 * found.sizes["CZ"].noise
    text = str(found)
    assert "CZ" in text
    assert "compared with 4 recordings" in text
    assert found.to_dict()["sizes"]["CZ"]["difference"] == found.sizes["CZ"].difference
    assert {what for what, *_ in seen} == {"smoothing", "locating"}
    assert found.turbulence is None


def test_a_model_its_file_and_a_function_say_the_same(flights_and_truth, tmp_path, monkeypatch):
    recordings, _ = flights_and_truth
    model = model_of(TRUTH)
    first = compare(model, recordings[:2], AIRCRAFT)
    assert first.form == "model"
    model.to_json(tmp_path / "model.json")
    second = compare(tmp_path / "model.json", recordings[:2], AIRCRAFT)
    module = ModuleType("their_simulation")
    module.evaluate = open_simulation(model, recordings, AIRCRAFT).evaluate
    monkeypatch.setitem(sys.modules, "their_simulation", module)
    third = compare("python:their_simulation:evaluate", recordings[:2], AIRCRAFT)
    assert third.form == "python"
    for c in ("CX", "CZ", "Cm"):
        assert_allclose(second.sizes[c].difference, first.sizes[c].difference, rtol=1e-9)
        assert_allclose(third.sizes[c].difference, first.sizes[c].difference, rtol=1e-9)


def test_a_free_simulation_of_the_truth_leaves_little(flights_and_truth):
    recordings, _ = flights_and_truth
    found = compare(altered(recordings, "m01"), recordings, AIRCRAFT)
    assert found.form == "free"
    # It flew what was recorded: what it says is what was measured, as far as few terms give it.
    for c in ("CZ", "Cm"):
        assert found.sizes[c].difference < 0.3 * found.sizes[c].measured


def test_a_jsbsim_aircraft_is_evaluated_along_the_recordings(flights_and_truth):
    pytest.importorskip("jsbsim", reason='JSBSim is not installed: pip install "structsel[jsbsim]"')
    recordings, _ = flights_and_truth
    found = compare("jsbsim:c172p", recordings[:2], AIRCRAFT)
    assert found.form == "jsbsim"
    # Another aircraft of the same size and weight carries the same weight, and turns otherwise.
    assert found.sizes["CZ"].difference < found.sizes["CZ"].measured
    assert found.sizes["Cm"].difference > found.sizes["Cm"].noise


def test_any_channel_may_be_compared(flights_and_truth):
    recordings, _ = flights_and_truth
    stated = {r.name: Recording(r.name, r.t, {"h": r["h"] + 2.0 * np.sin(T)}) for r in recordings}
    found = compare(stated, recordings, AIRCRAFT)
    assert list(found.sizes) == ["h"]
    # A sine of 2 has an rms of 2 / sqrt(2), less what fading a tenth of the samples takes.
    assert_allclose(found.sizes["h"].difference, np.sqrt(2.0), rtol=0.08)
    assert found.turbulence is None


def test_a_single_manoeuvre_says_what_it_cannot_conclude(flights_and_truth):
    recordings, stated = flights_and_truth
    found = compare(files(recordings[:1], stated[:1]), recordings[:1], AIRCRAFT)
    assert found.explainable == {}
    assert found.characters == ()
    assert "a single manoeuvre: nothing can be held out" in str(found)


def test_names_that_do_not_match_are_listed(flights_and_truth):
    recordings, stated = flights_and_truth
    with pytest.raises(DataError, match=r"no file for m04; it has m01, m02, m03\.\nEach recording needs"):
        compare(files(recordings[:3], stated[:3]), recordings, AIRCRAFT)


def test_a_clock_that_does_not_overlap_is_refused(flights_and_truth):
    recordings, stated = flights_and_truth
    delayed = {r.name: Recording(r.name, r.t + 100.0, s) for r, s in zip(recordings, stated)}
    with pytest.raises(DataError, match=r"'m01' runs from 0 to 19\.96 s, its simulation from 100 to 119\.96 s"):
        compare(delayed, recordings, AIRCRAFT)


def test_a_measurement_error_need_not_be_an_error_of_the_simulations_inputs(flights_and_truth):
    recordings, stated = flights_and_truth
    bias = 0.002

    def first(states, alpha):
        aircraft = AIRCRAFT.model_copy(update={"simulation": Simulation(states=states)})
        read = [Recording(r.name, r.t, {**r.channels, "alpha": r["alpha"] + alpha}) for r in recordings[:2]]
        return prepare(files(recordings, stated), read, aircraft).flights[0]

    flight = first("reconstructed", 0.0)
    read, asked = (columns for name, _, columns in biases_of(flight) if name == "alpha")
    # Only the readings are off: what the simulation says stays.
    off = first("reconstructed", bias)
    for c in flight.responses:
        change = np.mean(off.difference[c] - flight.difference[c])
        assert_allclose(change, bias * np.mean(read.get(c, 0.0)), atol=0.05 * bias)
    assert np.mean(read["k_h"]) > 30.0
    assert set(asked) <= {"CX", "CY", "CZ", "Cl", "Cm", "Cn"}
    assert np.mean(asked["CZ"]) > 3.0
    # Evaluated at the recorded states, it has the same error.
    (both,) = (columns for name, _, columns in biases_of(first("raw", 0.0)) if name == "alpha")
    for c, x in both.items():
        assert_allclose(x, read.get(c, 0.0) + asked.get(c, 0.0), atol=1e-9)


def test_slopes_of_the_surrogate_are_those_of_the_simulation_although_measurements_are_biased():
    # Evaluated at the true states at the centre of gravity; alpha and de read with another bias in each flight.
    recordings, stated = fly({}, speeds=(42.0, 46.0, 50.0, 54.0), h=(1000.0,) * 4)
    biases = 0.005 * np.array([1.0, -1.0, 0.8, -0.8])
    read = [
        Recording(r.name, r.t, {**r.channels, "alpha": r["alpha"] + b, "de": r["de"] - b})
        for r, b in zip(recordings, biases)
    ]
    arm = AIRCRAFT.position("vane")[0]
    for f, r in zip(prepare(files(recordings, stated), read, AIRCRAFT).flights, recordings):
        alpha, V = r["alpha"].mean(), r["V"].mean()
        lift = TRUTH["CZ"]["alpha"] + 3.0 * TRUTH["CZ"]["alpha^3"] * np.mean(r["alpha"] ** 2)
        stiffness = TRUTH["Cm"]["alpha"] + 2.0 * TRUTH["Cm"]["alpha^2"] * alpha
        # Of what the vane reads, turning takes its part.
        damping = (TRUTH["Cm"]["q_hat"] * AIRCRAFT.cbar / 2.0 + stiffness * arm) / V
        assert_allclose(f.slope("CZ", "alpha").mean(), lift, rtol=0.02)
        assert_allclose(f.slope("Cm", "alpha").mean(), stiffness, rtol=0.04)
        assert_allclose(f.slope("Cm", "q").mean(), damping, rtol=0.02)
        assert_allclose(f.slope("Cm", "de").mean(), TRUTH["Cm"]["de"], rtol=0.02)
        assert_allclose(f.slope("Cl", "p").mean(), TRUTH["Cl"]["p_hat"] * AIRCRAFT.b / (2.0 * V), rtol=0.01)


def test_the_slope_of_a_table_that_bends_is_followed_beside_the_bend():
    def table(alpha):
        return np.interp(alpha, [-0.2, 0.06, 0.1, 0.3], [0.0, 0.02, 0.05, 0.35])

    flights = flights_with({}, speeds=(36.0, 45.0, 60.0), h=(1000.0,) * 3)
    simulated = [{"CX": table(f["alpha"])} for f in flights]
    stand_in = identify(flights, simulated, ["CX"])
    for f in flights:
        exact = (table(f["alpha"] + 1e-6) - table(f["alpha"] - 1e-6)) / 2e-6
        away = (np.abs(f["alpha"] - 0.06) > 0.02) & (np.abs(f["alpha"] - 0.1) > 0.02)
        assert np.abs(stand_in.slope(f, "CX", "alpha") - exact)[away].mean() < 0.03
    (model,) = as_models(stand_in, flights).values()
    assert_allclose(model.evaluate(flights[0]), stand_in.evaluate(flights[0], "CX"), atol=1e-9)


def test_the_slope_of_a_table_that_is_even_in_sideslip_is_its_mean_over_the_zero_of_the_vane():
    flights = flights_with({}, speeds=(36.0, 45.0, 60.0), h=(1000.0,) * 3)
    stand_in = identify(flights, [{"CX": 0.4 * np.abs(f["beta"])} for f in flights], ["CX"])
    assert ("abs(beta)",) in stand_in.terms["CX"]
    zero = np.random.default_rng(3).normal(0.0, 0.002, 4000)
    for f in flights:
        mean = 0.4 * np.sign(f["beta"][:, None] + zero).mean(axis=1)
        assert_allclose(stand_in.slope(f, "CX", "beta"), mean, atol=0.02)


def test_what_thrust_does_to_a_lateral_response_is_in_the_surrogate():
    same = flights_with({}, speeds=(36.0, 45.0, 60.0), h=(1000.0,) * 3)
    flights = [replace(f, channels={**f.channels, "CT": 0.1 + 0.05 * np.sin(f.t)}) for f in same]
    simulated = [{"Cl": -0.09 * f["beta"] - 0.1 * f["da"] + 0.001 * f["CT"]} for f in flights]
    stand_in = identify(flights, simulated, ["Cl"])
    assert any("CT" in term for term in stand_in.terms["Cl"])
    for f, s in zip(flights, simulated):
        assert_allclose(stand_in.evaluate(f, "Cl"), s["Cl"], atol=0.02 * s["Cl"].std())


def test_an_airbrake_deflection_is_in_the_surrogate_and_in_the_tolerances(flights_and_truth):
    recordings, stated = flights_and_truth
    out = [np.clip(T - 8.0, 0.0, 1.0) * (k == 1) for k in range(4)]
    stated = [{**s, "CZ": s["CZ"] + 0.08 * x} for s, x in zip(stated, out)]
    recordings = [Recording(r.name, r.t, {**r.channels, "speedbrake": x}) for r, x in zip(recordings, out)]
    flights = prepare(files(recordings, stated), recordings, AIRCRAFT).flights
    assert_allclose(flights[0].slope("CZ", "speedbrake"), 0.08, rtol=0.03)
    (allowed,) = (n for n in tolerances_of(flights) if n.name == "CZ: speedbrake")
    assert np.ptp(allowed.columns[1]["CZ"]) == pytest.approx(0.08, rel=0.03)


def test_noise_of_the_simulations_inputs_is_allowed_for_and_is_not_diagnosed_as_play():
    sd = 0.0005  # of a span of 0.08; without the allowance, play raises the log evidence by 288
    recordings, stated = fly({}, speeds=(40.0, 45.0, 50.0, 55.0), h=(1000.0,) * 4)
    rng = np.random.default_rng(4)
    noise = [sd * rng.standard_normal(len(T)) for _ in recordings]
    recordings = [Recording(r.name, r.t, {**r.channels, "de": r["de"] + x}) for r, x in zip(recordings, noise)]
    stated = [{**s, **{c: s[c] + TRUTH[c]["de"] * x for c in ("CZ", "Cm")}} for s, x in zip(stated, noise)]
    flights = prepare(files(recordings, stated), recordings, AIRCRAFT).flights
    (allowed,) = (n for n in tolerances_of(flights) if n.name == "noise of de")
    for column, x in zip(allowed.columns, noise):
        assert np.corrcoef(column["Cm"], -TRUTH["Cm"]["de"] * x)[0, 1] > 0.85
    (score,) = score_all(*tried(flights, "backlash"))
    assert score.signature.variant.shape["width"] > 2.0 * sd
    assert log_bayes(score) < 10.0


def test_a_forced_simulation_that_diverged_names_file_channel_and_sample(flights_and_truth):
    recordings, stated = flights_and_truth
    broken = [dict(s) for s in stated]
    broken[1]["Cm"] = np.where(T > 10.0, np.nan, broken[1]["Cm"])
    with pytest.raises(DataError, match=r"'m02' gives Cm = nan at sample 251 \(t = 10\.04 s\)"):
        compare(files(recordings, broken), recordings, AIRCRAFT)


@pytest.mark.parametrize(
    ("value", "words"), [(np.nan, "alpha is nan at sample 251"), (7.0, "diverged: alpha is 7 at sample 251")]
)
def test_a_free_simulation_that_diverged_is_refused(flights_and_truth, value, words):
    recordings, _ = flights_and_truth
    gone = np.where(T > 10.0, value, recordings[2]["alpha"])
    with pytest.raises(DataError, match=rf"of 'm03'.* ?{words} \(t = 10\.04 s\)"):
        compare(altered(recordings, "m03", alpha=gone), recordings, AIRCRAFT)


def test_a_free_simulation_that_flew_elsewhere_is_refused(flights_and_truth):
    recordings, _ = flights_and_truth
    fast = {r.name: Recording(r.name, r.t, {**r.channels, "V": r["V"] + 60.0}) for r in recordings}
    with pytest.raises(DataError, match=r"flew V from 9\d.* only 0% of the recorded samples lie where it flew"):
        compare(fast, recordings, AIRCRAFT)


def test_a_simulation_of_another_aircraft_is_refused(flights_and_truth):
    recordings, stated = flights_and_truth
    degrees = [{c: 57.3 * x for c, x in s.items()} for s in stated]
    with pytest.raises(DataError, match=r"gives CX = .* in 'm0\d' at sample \d+ .* of another aircraft"):
        compare(files(recordings, degrees), recordings, AIRCRAFT)


def test_a_recording_with_a_gap_names_channel_and_sample(flights_and_truth):
    recordings, stated = flights_and_truth
    gap = recordings[0]["az"].copy()
    gap[100] = np.nan
    holed = [Recording("m01", recordings[0].t, {**recordings[0].channels, "az": gap}), *recordings[1:]]
    with pytest.raises(DataError, match=r"'m01': channel 'az' is nan at sample 100 \(t = 4 s\)"):
        compare(files(recordings, stated), holed, AIRCRAFT)


def test_no_recording_or_no_simulation_is_said(flights_and_truth, tmp_path):
    recordings, _ = flights_and_truth
    with pytest.raises(DataError, match="at least one recording"):
        compare(model_of(TRUTH), [], AIRCRAFT)
    with pytest.raises(DataError, match="there is no simulation at"):
        compare(tmp_path / "nowhere", recordings, AIRCRAFT)
    with pytest.raises(ModelError, match="cannot be loaded"):
        compare("python:no_such_module:f", recordings, AIRCRAFT)


def test_channels_that_are_constant_as_on_a_ship_are_compared():
    # p, q, phi and theta are zero: the rates of the attitude close exactly and have no noise to weigh them by.
    rng = np.random.default_rng(3)
    recordings, stated = [], {}
    for k in range(2):
        zero, dr = np.zeros(len(T)), 0.2 * np.sign(np.sin(T + k))
        r = 0.02 * np.sin(0.7 * T + k) + 1e-4 * rng.standard_normal(len(T))
        still = dict.fromkeys(("alpha", "beta", "p", "q", "phi", "theta", "ax"), zero)
        moving = {"V": 8.0 + 0.01 * rng.standard_normal(len(T)), "r": r, "psi": np.cumsum(r) * DT, "ay": 8.0 * r}
        recordings.append(Recording(f"m{k}", T, {**still, **moving, "az": zero - 9.81, "dr": dr}))
        stated[f"m{k}"] = Recording(f"m{k}", T, {"CY": 0.1 * r, "Cn": -0.002 * dr})
    flights = prepare(stated, recordings, AIRCRAFT).flights
    assert not {"k_phi", "k_theta"} & set(flights[0].responses)
    base = DiagnosisProblem.set_up(flights, []).base
    assert np.isfinite(base.evidence).all()


def test_the_form_of_a_simulation_is_as_exact_as_its_residual_or_as_stated(flights_and_truth):
    recordings, stated = flights_and_truth
    assert prepare(files(recordings, stated), recordings, AIRCRAFT).flights[0].form_error == {}
    tolerances = AIRCRAFT.tolerances.model_copy(update={"form": 0.1})
    coarse = AIRCRAFT.model_copy(update={"tolerances": tolerances})
    errors = prepare(files(recordings, stated), recordings, coarse).flights[0].form_error
    assert errors == dict.fromkeys(("CX", "CY", "CZ", "Cl", "Cm", "Cn"), 0.1)
    exact = model_of(TRUTH)
    responses = {c: replace(exact[c], r2=0.9 if c == "CZ" else np.nan) for c in exact}
    flights = prepare(AeroModel(responses), recordings, AIRCRAFT).flights
    assert flights[0].form_error == {}
    assert flights[0].fit_error.keys() == {"CZ"}
    simulated = np.concatenate([f.simulated["CZ"] - f.simulated["CZ"].mean() for f in flights])
    noise = np.concatenate([np.diff(f.measured["CZ"], 3) for f in flights]).var() / 20.0
    assert_allclose(flights[0].fit_error["CZ"] ** 2, 1.0 / 9.0 - noise / simulated.var(), rtol=0.05)


def test_inputs_between_samples_are_taken_alike_for_all_moments_of_a_flight(monkeypatch):
    # Cl alone fits a little better held, Cm much better straight; the forces have a way of their own.
    misfit = {
        "straight": {"CZ": 3.0, "Cl": 0.9, "Cm": 0.1}, "held after": {"CZ": 3.0, "Cl": 0.8, "Cm": 1.0},
        "as read": {"CZ": 1.0, "Cl": 5.0, "Cm": 5.0}, "held before": {"CZ": 3.0, "Cl": 5.0, "Cm": 5.0},
    }  # fmt: skip
    wave = np.sin(T)
    flight = SimpleNamespace(measured=dict.fromkeys(("CZ", "Cl", "Cm"), np.zeros(len(T))), air={})
    monkeypatch.setattr(free_simulation, "_averaged_channels", lambda f, way, air: way)
    model = SimpleNamespace(evaluate=lambda way, c: misfit[way][c] * wave)
    (made,) = free_simulation._evaluated([flight], dict.fromkeys(("CZ", "Cl", "Cm"), model))
    assert {c: x.max() / wave.max() for c, x in made.items()} == pytest.approx({"CZ": 1.0, "Cl": 0.9, "Cm": 0.1})
