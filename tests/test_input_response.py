"""Response to the recorded inputs: without gusts, and enough to separate an effect from gusts that resemble it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from structsel.aircraft import Aircraft
from structsel.coefficients import compute_coefficients
from structsel.comparison.driving import input_responses
from structsel.comparison.locating.turbulence import has_coloured_forces, turbulence_without_vanes
from structsel.diagnosis.input_response import InputDrivenMotion
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.residuals import residuals
from structsel.diagnosis.scoring import score_all
from structsel.diagnosis.weighing import log_bayes, log_bayes_as_given, unconfirmed_log_bayes, with_unconfirmed_weight
from structsel.numerics.air_data import air_data, body_to_earth
from structsel.recording import Recording
from structsel.simulation import Atmosphere, Turbulence, simulate, trim
from tests.models import model_of
from tests.noisy_flights import AIRCRAFT, NOISE, TRUTH, T, excite, ready, tried

BARE = Aircraft(**{**AIRCRAFT.model_dump(exclude={"schema_name"}), "sensors": {}})  # vanes at the centre of gravity
SPEEDS = (40.0, 44.0, 48.0, 52.0, 56.0, 60.0)


@cache
def blown(W20=9.0, **extra):
    """Flights in turbulence that neither vanes nor simulation see, and its vertical speed."""
    simulation = model_of(TRUTH)
    truth = model_of({r: {**TRUTH[r], **dict(extra.get(r, ()))} for r in TRUTH})
    recordings, stated, gusts = [], [], []
    rng = np.random.default_rng(8)
    for k, V in enumerate(SPEEDS):
        start = trim(simulation, BARE, V, 1000.0)
        air = Atmosphere(turbulence=Turbulence(W20, seed=k, high=0.1 * W20)) if W20 else Atmosphere()
        simulated = simulate(truth, BARE, start.inputs(T, **excite(T, k % 3)), start=start, air=air, outside="ignore")
        ground = np.column_stack([simulated[c] for c in ("vn", "ve", "vd")])
        body = np.einsum("nij,ni->nj", body_to_earth(simulated["phi"], simulated["theta"], simulated["psi"]), ground)
        still = dict(zip(("V", "alpha", "beta"), air_data(*body.T)))
        gusts.append((simulated["alpha"] - still["alpha"]) * simulated["V"])
        read = ("p", "q", "r", "phi", "theta", "psi", "h", "ax", "ay", "az", "rho", "mass", "de", "da", "dr", "thrust")
        exact = Recording(f"m{k}", simulated.t, {**{c: simulated[c] for c in read}, **still})
        noisy = {c: exact[c] + NOISE[c] * rng.standard_normal(len(exact)) for c in NOISE}
        recordings.append(exact.with_channels(**noisy))
        stated.append(simulation.evaluate(compute_coefficients(exact, BARE), outside="ignore"))
    return ready(recordings, stated, BARE), gusts


def alike(flights, gusts, channel, lags=40):
    """Fraction of a channel's variance that the gusts of the last seconds explain, all flights together."""
    rows = [np.column_stack([np.roll(g, k)[lags:] for k in range(0, lags, 2)]) for g in gusts]
    X = np.concatenate([x - x.mean(axis=0) for x in rows])
    y = np.concatenate([f[channel][lags:] - f[channel][lags:].mean() for f in flights])
    return 1.0 - float(np.var(y - X @ np.linalg.lstsq(X, y, rcond=None)[0]) / np.var(y))


def test_the_response_to_the_inputs_does_not_follow_the_gusts():
    flights, gusts = blown()
    moved = input_responses(flights)
    by_probability = alike(input_responses(blown(0.0)[0]), gusts, "alpha")
    assert alike(flights, gusts, "alpha") > 0.3
    assert alike(moved, gusts, "alpha") < by_probability + 0.1
    for f, g in zip(flights, moved):
        assert all(np.allclose(f.difference[c], g.difference[c]) for c in f.difference)


EFFECTS = (
    "wrong-derivative", "missing-term", "augmentation", "unsteady-lift", "sensor-position", "inertia-error",
    "control-nonlinearity", "downwash-lag", "sidewash-lag",
)  # fmt: skip


def test_an_effect_that_gusts_resemble_is_not_confirmed_by_the_response_to_the_inputs():
    problem, library = tried(blown()[0], *EFFECTS)
    scores = InputDrivenMotion.of(problem.flights).confirm(problem, score_all(problem, library))
    plain = {s.effect: log_bayes(replace(s, input_only=None)) for s in scores}
    assert sum(x > 200.0 for x in plain.values()) >= 5  # a simulation that is right, in air that no vane feels
    assert max(map(log_bayes, scores)) < 10.0
    assert max(map(log_bayes_as_given, scores)) < 10.0
    assert max(s.unconfirmed_weight for s in scores) == 0.0  # gusts are others in each manoeuvre
    air = turbulence_without_vanes(problem.flights, residuals(problem), unconfirmed_log_bayes(scores))
    size = np.std(np.concatenate(blown()[1]))
    assert air.sigma["w"] == pytest.approx(size, rel=0.4)
    assert "No vane feels it" in air.says


def test_an_effect_is_found_in_turbulence_and_in_the_form_that_the_response_to_the_inputs_confirms():
    problem, library = tried(blown(Cl=(("da^3", -20.0),))[0], *EFFECTS)
    best = max(InputDrivenMotion.of(problem.flights).confirm(problem, score_all(problem, library)), key=log_bayes)
    assert (best.effect, best.signature.variant.about[:2]) == ("control-nonlinearity", "da")
    assert log_bayes(best) > 15.0


def test_calm_air_changes_nothing_of_the_effects():
    problem, library = tried(blown(0.0, Cl=(("da^3", -20.0),))[0], *EFFECTS)
    plain = score_all(problem, library)
    before, after = (
        max(plain, key=log_bayes),
        max(InputDrivenMotion.of(problem.flights).confirm(problem, plain), key=log_bayes),
    )
    assert before.effect == after.effect == "control-nonlinearity"
    assert log_bayes(after) == pytest.approx(log_bayes(before))


def test_an_effect_that_explains_all_beyond_the_noise_counts_where_the_inputs_predict_little_of_it():
    problem, library = tried(blown(0.0, Cl=(("da^3", -60.0),))[0], "control-nonlinearity")
    (known,) = score_all(problem, library)
    small = replace(known, log_evidence=4.0, predictive=np.zeros(len(problem.flights)), within=0.0)
    little = replace(known, input_only=small)
    assert log_bayes(little) == pytest.approx(6.0)
    (sure,) = with_unconfirmed_weight(problem, [little])
    assert sure.unconfirmed_weight > 0.5
    assert log_bayes(sure) == pytest.approx(
        sure.unconfirmed_weight * log_bayes(known) + (1.0 - sure.unconfirmed_weight) * 6.0
    )


def test_coloured_forces_are_no_evidence_unless_the_form_of_an_identified_simulation_may_leave_them():
    flights = tuple(blown(1.5)[0])
    left = residuals(DiagnosisProblem.set_up(flights, ()))
    assert has_coloured_forces(flights, left, 70.0)
    assert not has_coloured_forces(flights, left, 20.0)
    assert turbulence_without_vanes(flights, left, 70.0) is None  # it may be noise as well
    identified = tuple(replace(f, fit_error={"CZ": 0.1}) for f in flights)
    assert not has_coloured_forces(identified, left, 70.0)
    calm = tuple(blown(0.0)[0])
    assert not has_coloured_forces(calm, residuals(DiagnosisProblem.set_up(calm, ())), 70.0)


def test_calm_air_is_not_reported_as_turbulent():
    problem, library = tried(blown(0.0)[0], *EFFECTS)
    log_bayes_lost = unconfirmed_log_bayes(
        InputDrivenMotion.of(problem.flights).confirm(problem, score_all(problem, library))
    )
    assert turbulence_without_vanes(problem.flights, residuals(problem), log_bayes_lost) is None


def test_a_motion_without_recorded_inputs_is_not_predicted():
    flights = [replace(f, recorded=f.recorded - {"da", "dr"}) for f in blown(0.0, Cl=(("da^3", -20.0),))[0]]
    once_more = InputDrivenMotion.of(flights)
    assert once_more.excited == (True, False)
    problem, library = tried(flights, "wrong-derivative", "unsteady-lift", "sidewash-lag")
    scores = once_more.confirm(problem, score_all(problem, library))
    sideways = [
        s
        for s in scores
        if s.signature.responses <= {"CY", "Cl", "Cn"} and max(log_bayes(s), log_bayes_as_given(s)) > 20.0
    ]
    assert sideways
    assert all(s.input_only is None for s in sideways)


def test_flights_without_inputs_are_left_as_they_are():
    flights = [replace(f, recorded=f.recorded - {"de", "da", "dr", "thrust"}) for f in blown(0.0)[0]]
    assert input_responses(flights) == ()
    assert InputDrivenMotion.of(flights).excited == (False, False)
