"""Simulation of held-out flights in short windows: the effect of coefficient differences on the motion."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

import structsel as ss
from structsel.comparison.flight import prepare_flight
from structsel.comparison.noise import as_spectra, edge_of
from structsel.comparison.preparing import prepare
from structsel.comparison.surrogate import Surrogate
from structsel.demo import demo_flights
from structsel.diagnosis.held_out_result import ChannelScores, HeldOutSimulation, WindowScore
from structsel.diagnosis.held_out_simulation import (
    PredictedCoefficients,
    predicted_differences,
    predictions_by_stage,
    simulate_held_out,
    simulate_stages,
    window_length,
)
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.ranking import rank
from structsel.diagnosis.signatures import work_out
from structsel.effects import EFFECTS
from structsel.inputs import three_two_one_one
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.fourier_series import spectrum
from structsel.report import render
from tests.diagnoses import GROUND, diagnosis

EXAMPLES = Path(__file__).parents[2] / "shared" / "data" / "diagnose-examples"
needs_examples = pytest.mark.skipif(not EXAMPLES.exists(), reason="../shared/data is not here")
AIR = ("k_V", "k_alpha", "k_beta", "k_phi", "k_theta")


@pytest.fixture(scope="module")
def clean():
    """Two flights in still air, read without noise, and the coefficients of the model that flew them."""
    recordings, aircraft, truth = demo_flights(2, noise=0.0, turbulence=0.0, duration=12.0)
    model = ss.AeroModel({c: ss.ResponseModel(tuple(t), np.array([*t.values()])) for c, t in truth.items()})
    at_centre = [ss.compute_coefficients(r, aircraft) for r in recordings]
    exact = [{c: model[c].evaluate(r) for c in COEFFICIENTS} for r in at_centre]
    return [prepare_flight(r, aircraft, one) for r, one in zip(recordings, exact)]


def stated(flight, *, only=COEFFICIENTS, **more):
    """Exact coefficients in perfect air first, then with something added."""
    exact = {c: flight.simulated[c] for c in only} | {k: np.zeros(len(flight)) for k in AIR}
    return PredictedCoefficients(
        flight, {"delivered": {c: x + more.get(c, 0.0) for c, x in exact.items()}, "refitted": exact}
    )


def rows(replay):
    return {r.channel: r for r in replay.rows}


def ramp(rate, seconds, dt):
    """Root mean square of a straight drift over the samples of a window but its start."""
    t = dt * np.arange(1, round(seconds / dt) + 1)
    return rate * np.sqrt(np.mean(t**2))


def test_exact_coefficients_reproduce_the_recordings(clean):
    found = rows(simulate_stages([stated(f) for f in clean], 2.0))
    assert list(found) == ["V", "alpha", "beta", "p", "q", "r", "phi", "theta"]
    for channel, row in found.items():
        moved = max(np.ptp(f.raw[channel]) for f in clean)
        # Steps of the surfaces fall between samples, where the recording does not say when.
        assert row.stages["refitted"].rms < 0.005 * moved
        assert row.stages["refitted"].tic < 0.02


def test_a_wrong_moment_drifts_as_mechanics_says(clean):
    f = clean[0]
    off = 2e-3
    found = rows(simulate_stages([stated(f, Cm=off)], 1.0))
    rate = float(np.mean(f["qbar"])) * f.aircraft.S * f.aircraft.cbar * off / f.aircraft.inertia.Iy
    assert_allclose(found["q"].stages["delivered"].rms, ramp(rate, 1.0, f.dt), rtol=0.03)
    # An angle that grows with t^2 / 2.
    t = f.dt * np.arange(1, round(1.0 / f.dt) + 1)
    assert_allclose(found["theta"].stages["delivered"].rms, 0.5 * rate * np.sqrt(np.mean(t**4)), rtol=0.05)
    assert found["q"].stages["refitted"].rms < 0.05 * found["q"].stages["delivered"].rms
    assert found["q"].left < 0.05


def test_a_wrong_drag_slows_down_as_mechanics_says(clean):
    f = clean[0]
    found = rows(simulate_stages([stated(f, CX=-0.01)], 2.0))
    rate = 0.01 * float(np.mean(f["qbar"])) * f.aircraft.S / f.aircraft.mass
    assert_allclose(found["V"].stages["delivered"].rms, ramp(rate, 2.0, f.dt), rtol=0.05)


def test_a_rate_error_of_the_measurements_alone_moves_the_measured_output(clean):
    f = clean[0]
    found = rows(simulate_stages([stated(f, k_theta=0.01, k_V=0.1)], 1.0))
    assert_allclose(found["theta"].stages["delivered"].rms, ramp(0.01, 1.0, f.dt), rtol=0.03)
    # Gravity along the axis cancels the contribution of the false pitch.
    assert_allclose(found["V"].stages["delivered"].rms, ramp(0.1, 1.0, f.dt), rtol=0.6)
    assert_allclose(found["q"].stages["delivered"].rms, found["q"].stages["refitted"].rms, rtol=0.05)


def test_damping_of_the_simulation_holds_the_drift_back(clean):
    f = clean[0]
    damping, off = -60.0, 2e-3
    stand_in = Surrogate({"q_hat": 0.0}, {"q_hat": 1.0}, {"Cm": (("q_hat",),)}, {"Cm": np.array([damping])},
                         {"Cm": 0.0}, {"Cm": 1.0})  # fmt: skip
    held = replace(f, surrogate=stand_in)
    found = rows(simulate_stages([stated(held, Cm=off)], 3.0))
    moment = float(np.mean(f["qbar"])) * f.aircraft.S * f.aircraft.cbar / f.aircraft.inertia.Iy
    a = -damping * moment * f.aircraft.cbar / (2.0 * float(np.mean(f["V"])))
    t = f.dt * np.arange(1, round(3.0 / f.dt) + 1)
    drift = moment * off / a * (1.0 - np.exp(-a * t))
    assert a > 1.0
    assert_allclose(found["q"].stages["delivered"].rms, np.sqrt(np.mean(drift**2)), rtol=0.05)


def test_windows_agree_with_a_simulator_that_flies_the_wrong_model_itself():
    aircraft = ss.published_aircraft("citation")
    trim = aircraft.trim()
    held = aircraft.model["Cm"]
    off = {"alpha": 0.8, "q_hat": 0.7, "de": 1.15}
    values = np.array([off.get(str(term), 1.0) * value for term, value in zip(held.terms, held.values)])
    wrong = ss.AeroModel({**aircraft.model.responses, "Cm": ss.ResponseModel(held.terms, values)})
    flights = []
    for k, (size, step) in enumerate(((0.02, 0.5), (-0.03, 0.8), (0.01, 1.2))):
        u = three_two_one_one("de", size, step, duration=16.0, dt=0.02)
        flights.append(aircraft.simulate(ss.Recording(f"m{k}", u.t, {"de": trim["de"] + u["de"]}), start=trim))
    made = prepare(wrong, flights, aircraft.aircraft).flights
    along = [PredictedCoefficients(f, {"delivered": f.simulated}) for f in made]
    found = rows(simulate_stages(along, 2.0))
    stiff = rows(simulate_stages([replace(one, flight=replace(one.flight, surrogate=None)) for one in along], 2.0))
    simulated = ss.resimulate(wrong, aircraft.aircraft, flights, outputs=["V", "alpha", "q", "theta"], window=2.0)
    for channel in ("V", "alpha", "q", "theta"):
        itself = simulated.score(channel, "all", "windows").rms_error
        assert_allclose(found[channel].stages["delivered"].rms, itself, rtol=0.06)
    # Without slopes the aircraft has neither stiffness nor damping, and errors grow that are none.
    assert stiff["theta"].stages["delivered"].rms > 2.0 * found["theta"].stages["delivered"].rms


def test_responses_that_the_simulation_does_not_give_are_taken_as_measured(clean):
    found = rows(simulate_stages([stated(f, only=("CX", "CZ", "Cm")) for f in clean], 2.0))
    assert list(found) == ["V", "alpha", "q", "theta"]
    complete = rows(simulate_stages([stated(f) for f in clean], 2.0))
    for channel, row in found.items():
        assert row.stages["refitted"].rms < 0.005 * max(np.ptp(f.raw[channel]) for f in clean)
        assert_allclose(row.band, complete[channel].band)


def test_forces_alone_fly_an_aircraft_without_moments_of_inertia(clean):
    aircraft = clean[0].aircraft.model_copy(update={"inertia": None})
    bare = [replace(f, aircraft=aircraft, surrogate=None) for f in clean]
    found = rows(simulate_stages([stated(f, only=("CX", "CY", "CZ"), CX=-0.01) for f in bare], 2.0))
    assert list(found) == ["V", "alpha", "beta"]
    assert found["alpha"].stages["refitted"].rms < 0.005 * max(np.ptp(f.raw["alpha"]) for f in clean)
    assert window_length(bare) == 2.0


def test_without_coefficients_nothing_is_simulated_and_the_reason_is_given():
    plant = SimpleNamespace(channels={"level": np.zeros(5)}, simulated={"level": np.zeros(5)})
    found = simulate_held_out(SimpleNamespace(problem=SimpleNamespace(flights=(plant,))))
    assert "no aerodynamic coefficient" in found.reason
    assert found.to_dict() == {"reason": found.reason}
    assert str(found) == f"not simulated in windows: {found.reason}"


def test_a_diverging_motion_is_reported_and_not_scored(clean):
    f = clean[0]
    wild = Surrogate({"q_hat": 0.0}, {"q_hat": 1.0}, {"Cm": (("q_hat",),)}, {"Cm": np.array([1e6])},
                     {"Cm": 0.0}, {"Cm": 1.0})  # fmt: skip
    found = simulate_stages([stated(replace(f, surrogate=wild), Cm=0.1)], 3.0)
    assert found.rows == ()
    assert found.reason


def test_windows_take_two_short_periods_of_the_simulation(clean):
    f = clean[0]
    moment = float(np.median(f["qbar"])) * f.aircraft.S * f.aircraft.cbar / f.aircraft.inertia.Iy

    def length(period):
        slope = -((2.0 * np.pi / period) ** 2) / moment
        stand_in = Surrogate({"alpha": 0.0}, {"alpha": 1.0}, {"Cm": (("alpha",),)}, {"Cm": np.array([slope])},
                             {"Cm": 0.0}, {"Cm": 1.0})  # fmt: skip
        return window_length([replace(f, surrogate=stand_in)])

    assert_allclose([length(1.1), length(0.2), length(5.0)], [2.2, 1.0, 3.0], rtol=1e-6)
    assert window_length([f]) == 2.0


def ranked(name, *effects):
    """An example, as a diagnosis that knows only these effects ranks it."""
    folder = EXAMPLES / name
    recordings = [ss.read_recording(path) for path in sorted((folder / "recordings").glob("*.csv"))][:5]
    aircraft = ss.Aircraft.from_toml(folder / "aircraft.toml")
    flights = prepare(str(folder / "simulated"), recordings, aircraft).flights
    library = work_out([h for h in EFFECTS if h.name in effects], flights, flights[0].responses, None)
    return rank(DiagnosisProblem.set_up(flights, library.signatures), library)


@pytest.fixture(scope="module")
def ground():
    return ranked("ground-effect", "ground-effect")


@needs_examples
def test_with_the_effect_held_out_flights_are_simulated_nearer_to_the_recordings(ground):
    found = rows(simulate_held_out(ground))
    theta = found["theta"].stages
    assert theta["physics"].rms < 0.6 * min(theta["delivered"].rms, theta["refitted"].rms)
    assert theta["physics"].tic < 0.6 * theta["delivered"].tic
    assert found["alpha"].stages["physics"].rms < 0.6 * found["alpha"].stages["delivered"].rms
    # What the instruments' noise alone leaves in a band of two standard deviations.
    assert theta["delivered"].inside < 0.92 < theta["physics"].inside < 0.97
    assert {c: r.left for c, r in found.items() if r.left > 1.1} == {}


@needs_examples
def test_the_simulated_coefficients_are_those_of_the_bars(ground):
    for problem in (ground.problem, ground.problem.subset([]), ground.problem.as_given):
        for m, (r, y, B) in enumerate(zip(problem.rows, problem.base.y, problem.base.B)):
            added = predicted_differences(problem, m, m)
            left = {c: x - added.get(c, 0.0) for c, x in r.flight.difference.items()}
            rows_left = r.whiten({c: x[:, None] for c, x in as_spectra(left, r.flight).items()})[:, 0]
            judged = y - B @ problem.base.solved[m + 1]
            assert_allclose(rows_left, judged, atol=1e-6 * np.abs(y).max())


@needs_examples
def test_mean_values_are_as_measured_and_the_rest_is_as_simulated(ground):
    for one in predictions_by_stage(ground):
        f = one.flight
        for c in COEFFICIENTS:
            moved = one.stages["delivered"][c] - f.simulated[c]
            assert np.ptp(moved) < 1e-12
            for stated in one.stages.values():
                assert abs(spectrum(f.measured[c] - stated[c], 8, edge_of(f))[0]) < 1e-9


@needs_examples
def test_the_file_holds_plain_values_with_units(ground):
    found = simulate_held_out(ground)
    plain = json.loads(json.dumps(found.to_dict()))
    assert plain["window"]["unit"] == "s"
    assert 1.0 <= plain["window"]["value"] <= 3.0
    one = plain["channels"]["theta"]
    assert one["unit"] == "rad"
    assert_allclose(one["band"], 2.0 * one["noise"])
    assert {"rms", "tic", "inside"} == set(one["before"]) == set(one["refitted"]) == set(one["after"])
    assert len(found.to_frame()) == 24
    assert "theta" in str(found)


@needs_examples
def test_without_an_effect_taken_in_there_are_two_stages(ground):
    bare = replace(ground, steps=())
    stages = {tuple(one.stages) for one in predictions_by_stage(bare)}
    assert stages == {("delivered", "refitted")}
    assert simulate_held_out(bare).example.simulated.keys() == {"delivered", "refitted"}


@needs_examples
def test_only_flights_held_out_are_simulated(ground):
    groups = [(1, 3)]
    problem = DiagnosisProblem.set_up(ground.problem.flights, (), groups)
    simulated = list(predictions_by_stage(replace(ground, start=problem, steps=())))
    assert [one.flight.name for one in simulated] == ["m02", "m04"]


@needs_examples
def test_the_segment_drawn_is_that_of_the_channel_with_the_largest_gain(ground):
    found = simulate_held_out(ground)
    drawn = found.example
    assert drawn.channel == found.gained.channel
    gap = np.isnan(drawn.measured)
    assert np.all(np.isnan(drawn.simulated["physics"]) == gap)
    starts = np.flatnonzero(np.r_[True, gap[:-1]])
    # Every window starts from the recorded state, whatever flies.
    for simulated in drawn.simulated.values():
        assert_allclose(simulated[starts], drawn.smoothed[starts], atol=1e-9)
    off = {stage: np.nanmean((x - drawn.smoothed) ** 2) for stage, x in drawn.simulated.items()}
    assert off["physics"] < off["delivered"]


@needs_examples
def test_the_page_shows_the_table_and_the_windows(ground):
    page = render(diagnosis(GROUND, replayed=simulate_held_out(ground)))
    assert "Re-simulation in short windows" in page
    assert '<div id="windows" class="chart">' in page
    assert "theta of m0" in page or "alpha of m0" in page


def test_the_page_says_why_nothing_was_simulated_and_leaves_out_what_was_not_asked():
    assert "Re-simulation" not in render(diagnosis(GROUND))
    assert "Not done: no inertia." in render(diagnosis(GROUND, replayed=HeldOutSimulation(reason="no inertia")))


def test_channels_gain_by_the_last_stage_over_the_first():
    def row(channel, *rms):
        return ChannelScores(channel, "rad", 0.1, 0.2, {str(k): WindowScore(x, 0.1, 0.9) for k, x in enumerate(rms)})

    found = HeldOutSimulation((row("alpha", 2.0, 2.0, 1.0), row("q", 2.0, 0.1, 1.5), row("V", 0.0, 0.0)), 2.0, 3)
    assert found.gained.channel == "alpha"
    assert HeldOutSimulation().gained is None
