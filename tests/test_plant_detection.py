"""A plant whose gain changes, or that does something without a name, is a mismatch; a correct simulation is none."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from structsel.comparison.causal_rows import CausalRows
from structsel.comparison.noisy_simulation import simulated_noise
from structsel.comparison.preparing import prepare
from structsel.comparison.tolerances import tolerances_of
from structsel.diagnosis import diagnose
from structsel.diagnosis.change_times import find_steps, gain_columns
from structsel.diagnosis.detection import detect, simulated_at_readings
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.errors import DataError
from structsel.recording import Recording
from structsel.report import write_report

THRUST = 20.0  # m/s^2 at full throttle
RUNS, N, DT = 4, 1500, 0.02


def multicopter(factor=lambda k, t: 1.0, level=lambda k, t: 0.0, seed=0, slow=0.0):
    """Its vertical specific force by its throttle, in four runs; the gain times a factor, and a level added."""
    rng = np.random.default_rng(seed)
    recordings, simulated = [], {}
    for k in range(RUNS):
        t = DT * np.arange(N)
        motion = gaussian_filter1d(rng.standard_normal(N), 15.0)
        throttle = 0.5 + 0.06 * motion / motion.std()
        stated = -THRUST * throttle
        drift = lfilter([slow * np.sqrt(1.0 - 0.99**2)], [1.0, -0.99], rng.standard_normal(N))
        read = stated * factor(k, t) + level(k, t) + drift + 0.2 * rng.standard_normal(N)
        recordings.append(Recording(f"run {k}", t, {"throttle": throttle, "az": read}))
        simulated[f"run {k}"] = Recording(f"run {k}", t, {"az": stated})
    return simulated, recordings


def found_in(simulated, recordings):
    flights = prepare(simulated, recordings, None).flights
    return detect(flights, DiagnosisProblem.set_up(flights, ()))


def drained(k, t):
    return 1.0 - 0.25 * (t + 30.0 * k) / 120.0


def lightened(k, t):
    return np.where(t + 30.0 * k > 75.0, 1.25, 1.0)


def test_a_gain_that_falls_from_run_to_run_is_a_mismatch():
    found = diagnose(*multicopter(drained))
    assert found.verdict == "mismatch"
    (first,) = found.findings
    assert first.effect == "unknown"
    assert "gain of az changes" in first.physics[0].says


@pytest.mark.parametrize(
    ("make", "change"),
    [
        ({"factor": lightened}, "the gain of az by +25 %"),
        ({"level": lambda k, t: np.where(t + 30.0 * k > 75.0, 1.5, 0.0)}, "the level of az by +1.5"),
    ],
)
def test_a_step_is_a_mismatch_at_its_time_with_its_size(make, change, tmp_path):
    found = diagnose(*multicopter(**make))
    (event,) = found.findings[0].events
    assert found.verdict == "mismatch"
    assert event.recording == "run 2"
    assert abs(event.t - 15.0) < 3.0 * event.std + DT
    assert event.change[:24] == change[:24]
    assert f"run 2 {event.says}" in " ".join(str(found).split())
    page = (write_report(found, tmp_path / "report.html")).read_text(encoding="utf-8")
    assert "In all recorded conditions, all the time." not in page


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("slow", [0.0, 0.3])
def test_noise_is_no_mismatch_even_where_it_lasts_two_seconds(seed, slow):
    assert found_in(*multicopter(seed=seed, slow=slow)).probability < 0.05


def test_the_answer_does_not_depend_on_units():
    simulated, recordings = multicopter(drained)
    first = found_in(simulated, recordings)
    small = [Recording(r.name, r.t, {"throttle": r["throttle"], "az": 1e-6 * r["az"]}) for r in recordings]
    stated = {name: Recording(name, r.t, {"az": 1e-6 * r["az"]}) for name, r in simulated.items()}
    assert found_in(stated, small).log_bayes == pytest.approx(first.log_bayes, rel=1e-4)


def test_an_unknown_function_of_an_input_is_a_mismatch_beyond_the_form_only():
    for size, is_there in ((0.3, True), (0.02, False)):
        simulated, recordings = multicopter()
        added = []
        for r in recordings:
            x = np.cos(20.0 * r["throttle"])
            bent = r["az"] + size * 1.2 * x / x.std()
            added.append(Recording(r.name, r.t, {"throttle": r["throttle"], "az": bent}))
        assert (found_in(simulated, added).probability > 0.5) is is_there


def parafoil(wind):
    """Its northward velocity by noisy airspeed and heading, simulated in still air."""
    rng = np.random.default_rng(1)
    recordings, simulated = [], {}
    for k in range(RUNS):
        t = 0.2 * np.arange(900)
        psi, V = 0.1 * t * (-1.0) ** k, 9.0 + gaussian_filter1d(rng.standard_normal(900), 20.0)
        read = {"V": V + 0.15 * rng.standard_normal(900), "psi": psi + 0.02 * rng.standard_normal(900)}
        for c, along, air in (("vn", np.cos(psi), wind), ("ve", np.sin(psi), 0.0)):
            read[c] = V * along + air + 0.05 * rng.standard_normal(900)
        recordings.append(Recording(f"run {k}", t, read))
        stated = {"vn": read["V"] * np.cos(read["psi"]), "ve": read["V"] * np.sin(read["psi"])}
        simulated[f"run {k}"] = Recording(f"run {k}", t, stated)
    return simulated, recordings


def test_what_is_simulated_at_noisy_motion_is_not_asked_for_functions_of_it():
    flights = prepare(*parafoil(0.0), None).flights
    assert simulated_at_readings(flights, tolerances_of(flights)) == {"vn", "ve"}
    assert detect(flights, DiagnosisProblem.set_up(flights, ())) is None
    assert diagnose(*parafoil(0.0)).verdict == "consistent"


def test_an_effect_on_the_level_is_found_beside_the_noise_of_the_motion():
    found = diagnose(*parafoil(4.0))
    assert found.verdict == "mismatch"
    assert found.findings[0].effect == "steady-wind"
    assert found.findings[0].probability > 0.9


def test_columns_of_gains_add_up_to_the_simulated_response():
    flights = prepare(*multicopter(), None).flights
    for i, (f, x) in enumerate(zip(flights, gain_columns(flights, "az"))):
        assert x.shape == (N, RUNS + 1)
        np.testing.assert_allclose(x[:, :RUNS].sum(axis=1), f.simulated["az"])
        assert not x[:, [k for k in range(RUNS) if k != i]].any()
        assert abs(x[:, -1].mean()) < 0.01 * abs(f.simulated["az"].mean())


def test_a_step_within_slow_noise_is_not_mistaken_for_it():
    # The noise is found anew with the step: without, a step is noise that lasts.
    flights = prepare(*multicopter(lightened), None).flights
    rows = CausalRows(flights, tolerances_of(flights), ["az"])
    logs = [log_bayes for log_bayes, _ in find_steps(rows, rows.null())]
    assert np.argmax(logs) == 2
    assert logs[2] > 100.0


def test_only_coefficients_need_the_file_of_an_aircraft():
    simulated, recordings = multicopter()
    log = [
        Recording(r.name, r.t, {"V": 10.0 + 0.0 * r.t, "throttle": r["throttle"], "az": r["az"]}) for r in recordings
    ]
    assert prepare(simulated, log, None).flights[0].aircraft.name == "plant"
    complete = [Recording(r.name, r.t, dict(r.channels) | {"alpha": 0.0 * r.t, "ax": 0.0 * r.t}) for r in log]
    with pytest.raises(DataError, match="it is of an aircraft"):
        prepare(simulated, complete, None)


def over_ground(wind, seed=0, runs=4, n=400, dt=0.02, shaken=0.0):
    """Velocity over the ground in turns; stated in still air from an airspeed that is filtered, held and noisy.

    Quick motion to the east is in what is stated as well.
    """
    rng = np.random.default_rng(seed)
    recordings, simulated = [], {}
    t = dt * np.arange(n)
    for k in range(runs):
        heading = 1.5 * k + np.cumsum(gaussian_filter1d(rng.standard_normal(n), 40.0))
        speed = 15.0 + gaussian_filter1d(rng.standard_normal(n), 60.0) * 8.0
        along = np.array([np.cos(heading), np.sin(heading)])
        noise = lfilter([0.3], [1.0, -0.9], rng.standard_normal(n))
        read = np.repeat((speed + noise)[::5], 5)[:n] + 0.02 * rng.standard_normal(n)
        vn, ve = speed * along + np.array(wind)[:, None] + 0.05 * rng.standard_normal((2, n))
        quick = shaken * rng.standard_normal(n)
        recordings.append(Recording(f"run {k}", t, {"V": read, "psi": heading, "vn": vn, "ve": ve + quick}))
        simulated[f"run {k}"] = Recording(f"run {k}", t, {"vn": read * along[0], "ve": read * along[1] + quick})
    return simulated, recordings


@pytest.mark.parametrize("seed", range(3))
def test_a_steady_wind_is_found_with_coloured_noise_of_the_airspeed(seed):
    found = diagnose(*over_ground((2.0, -1.0), seed))
    first = found.findings[0]
    assert first.effect == "steady-wind"
    for axis, truth in (("north", 2.0), ("east", -1.0)):
        estimate = first.physics[0].parameters[axis]
        assert abs(estimate.value - truth) < 3.0 * estimate.std


@pytest.mark.parametrize("seed", range(3))
def test_coloured_noise_of_an_airspeed_is_no_mismatch(seed):
    assert diagnose(*over_ground((0.0, 0.0), seed)).verdict == "consistent"


def held_airspeed(wind, seed, runs=4, n=500, dt=0.04):
    """Airspeed that a pilot holds, read at 5 Hz in gusts; stated in still air from the velocity over the ground."""
    rng = np.random.default_rng(seed)
    recordings, simulated = [], {}
    t = dt * np.arange(n)
    for k in range(runs):
        heading = 1.5 * k + 0.25 * np.cumsum(gaussian_filter1d(rng.standard_normal(n), 40.0))
        gust = 3.0 * gaussian_filter1d(rng.standard_normal((2, n)), 30.0, axis=1)
        speed = 12.0 + 0.3 * gaussian_filter1d(rng.standard_normal(n), 30.0)
        vn, ve = speed * np.array([np.cos(heading), np.sin(heading)]) + np.array(wind)[:, None] + gust
        read = np.interp(t, t[::5], (speed + 0.1 * rng.standard_normal(n))[::5])
        recordings.append(Recording(f"run {k}", t, {"V": read, "psi": heading, "vn": vn, "ve": ve}))
        simulated[f"run {k}"] = Recording(f"run {k}", t, {"V": np.hypot(vn, ve)})
    return simulated, recordings


@pytest.mark.parametrize("seed", range(4))
def test_the_size_of_a_wind_does_not_rest_on_a_gain_far_beyond_its_tolerance(seed):
    # The held airspeed hardly moves, the simulated one does: a gain of zero explains that as well as the wind.
    wind = np.array([2.0, -5.0])
    first = diagnose(*held_airspeed(wind, seed)).findings[0]
    assert first.effect == "steady-wind"
    found = np.array([first.physics[0].parameters[axis].value for axis in ("north", "east")])
    assert abs(found @ wind / (wind @ wind) - 1.0) < 0.15


def test_readings_whose_noise_shows_in_one_velocity_are_those_of_the_other():
    # Of the white part to the east a fifth is noise of the airspeed; the rest was flown.
    simulated, recordings = over_ground((2.0, -5.0), shaken=0.1)
    flights = prepare(simulated, recordings, None).flights
    east = {name: Recording(name, r.t, {"ve": r["ve"]}) for name, r in simulated.items()}
    alone = prepare(east, recordings, None).flights
    assert set(simulated_noise(flights)) == {"vn", "ve"}
    assert not simulated_noise(alone)


def test_a_simulation_of_air_data_without_accelerations_states_channels():
    _, recordings = over_ground((0.0, 0.0))
    ones = {r.name: Recording(r.name, r.t, {"V": r["V"] + 0.1, "alpha": 0.05 + 0.0 * r.t}) for r in recordings}
    with_vane = [r.with_channels(alpha=0.05 + 0.001 * np.sin(r.t)) for r in recordings]
    assert {c for f in prepare(ones, with_vane, None).flights for c in f.simulated} == {"V", "alpha"}
