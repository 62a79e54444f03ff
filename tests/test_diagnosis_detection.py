"""A mismatch is detected from prediction errors before it is named, and a correct simulation is not."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import expit
from scipy.stats import norm

import structsel as ss
from structsel.coefficients import compute_coefficients
from structsel.comparison.causal_rows import CausalRows
from structsel.comparison.nuisance import Nuisance
from structsel.comparison.past_motion import averaged, evaluated_at_readings, referred
from structsel.comparison.preparing import prepare
from structsel.comparison.sensitivity import misread
from structsel.comparison.tolerances import _jumped, tolerances_of
from structsel.diagnosis.detection import SCALE, Detection, detect
from structsel.diagnosis.effect_probability import FEATURES
from structsel.diagnosis.event import Event
from structsel.diagnosis.exceeded import ExceededTolerance, exceeded, exceeded_as_recorded
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.ranking import Ranking, with_detection
from structsel.diagnosis.scoring import score_all
from structsel.diagnosis.unattributed import detected
from structsel.diagnosis.unknown_function import features, log_bayes_beyond_form
from structsel.diagnosis.weighing import CandidateEffect, log_bayes
from tests.benchmark_modules import load_benchmark
from tests.models import model_of
from tests.noisy_flights import AIRCRAFT, TRUTH, flights_with, fly, ready, tried

SPEEDS = {"speeds": (40.0, 45.0, 50.0, 55.0), "h": (1000.0,) * 4}


@pytest.fixture(scope="module")
def bent():
    return flights_with({"CZ": {"alpha^2": -6.0}}, **SPEEDS)


@pytest.fixture(scope="module")
def correct():
    return flights_with({}, **SPEEDS)


def test_a_missing_quadratic_term_is_detected_in_its_response(bent):
    found = detect(bent, DiagnosisProblem.set_up(bent, ()))
    assert found.axes == ("CZ",)
    assert found.probability > 0.95


def test_a_correct_simulation_is_not_a_mismatch(correct):
    assert detect(correct, DiagnosisProblem.set_up(correct, ())).probability < 0.05


def test_an_accelerometer_off_its_place_within_tolerance_is_no_mismatch():
    # What it feels of angular acceleration is of its own sample: a column of four samples before cannot explain it.
    content = AIRCRAFT.to_dict()
    accelerometer = content["sensors"]["accelerometer"]
    x, y, z = accelerometer.get("position", (0.0, 0.0, 0.0))
    accelerometer["position"] = [x, y, z + 2.0 * AIRCRAFT.tolerances.lever_arm]
    flights = ready(*fly({}, **SPEEDS), ss.Aircraft.from_dict(content))
    found = detect(flights, DiagnosisProblem.set_up(flights, ()))
    assert max(found.remainder.values()) < 10.0
    assert found.probability < 0.05


def test_a_moment_that_follows_the_bank_angle_is_detected_as_one_function_among_a_hundred(correct):
    size = 0.4 * np.std(np.concatenate([f.simulated["Cm"] for f in correct]))
    bank = [np.abs(f["phi"]) for f in correct]
    added = size / np.concatenate(bank).std()
    flights = [
        replace(f, measured={**f.measured, "Cm": f.measured["Cm"] + added * (x - x.mean())})
        for f, x in zip(correct, bank)
    ]
    found = detect(flights, DiagnosisProblem.set_up(flights, ()))
    assert found.axes == ("Cm",)
    assert found.probability > 0.5
    rows = CausalRows(flights, tolerances_of(flights))
    inside = [rows.size["Cm"] * x[rows.edge : len(x) - rows.edge] for x in features(flights)]
    assert log_bayes_beyond_form(rows, rows.null(), "Cm", inside, 0.015) < 0.8 * found.remainder["Cm"]


def test_control_derivatives_within_tolerance_are_no_mismatch_where_surfaces_step():
    # Were the columns of the derivatives late, the differences right after each step would need other physics.
    recordings, aircraft, truth = ss.demo_flights(4, 3, turbulence=0.0)
    stated = {("Cl", "da"): 0.93, ("Cm", "de"): 0.93, ("Cn", "dr"): 0.93}
    for (response, term), factor in stated.items():
        truth[response][term] *= factor
    flights = prepare(model_of(truth), recordings, aircraft).flights
    rows = CausalRows(flights, tolerances_of(flights))
    null = rows.null()
    std = dict(zip((n.name for n in rows.tolerances), zip(null.mean, np.sqrt(np.diag(null.covariance)))))
    for (response, term), factor in stated.items():
        mean, error = (0.05 * x for x in std[f"{response}: {term}"])
        assert abs(mean - (1.0 / factor - 1.0)) < 3.0 * error
    found = detect(flights, DiagnosisProblem.set_up(flights, ()))
    assert max(found.remainder.values()) < 0.0


def test_a_surface_that_jumped_within_a_sample_shows_in_moments_from_that_sample_on(correct):
    f = correct[0]
    jump = np.where(np.arange(len(f)) == 200, 0.1, 0.0)
    columns = _jumped(f, "de", jump)
    lacking = np.where(np.arange(len(f)) >= 200, 0.1 * f.dt, 0.0)
    assert_allclose(columns["Cm"], f.rate(lacking) * misread(f, de=1.0)["Cm"][200], rtol=0.02, atol=1e-9)
    assert_allclose(columns["CZ"], misread(f, de=jump)["CZ"])


def test_rounding_of_the_samples_does_not_matter(bent):
    # Thresholds act on a continuous score: a change of 1e-12 in the samples must not change it visibly.
    moved = [type(f)(**{**vars_of(f), "measured": {c: x * (1.0 + 1e-12) for c, x in f.measured.items()}}) for f in bent]
    first, second = (detect(f, DiagnosisProblem.set_up(f, ())).log_bayes for f in (bent, moved))
    assert_allclose(second, first, rtol=1e-6)


def vars_of(flight):
    return {name: getattr(flight, name) for name in flight.__dataclass_fields__}


def test_the_order_of_the_recordings_does_not_matter(bent):
    first, second = (detect(f, DiagnosisProblem.set_up(f, ())).log_bayes for f in (bent, bent[::-1]))
    assert_allclose(second, first, rtol=1e-6)


def test_a_moment_is_compared_as_the_differentiator_measures_it(correct):
    f = correct[0]
    step = (f.t > 7.0).astype(float)
    # Rates that are the integral of the step: what the differentiator makes of them is what is compared.
    rates = np.concatenate([[0.0], np.cumsum(0.5 * (step[1:] + step[:-1]) * f.dt)])
    assert_allclose(averaged(f, "Cl", step), f.rate(rates), atol=1e-12)
    assert np.abs(averaged(f, "Cl", step) - step).max() > 0.1
    assert averaged(f, "CZ", step) is step


def test_a_simulation_evaluated_at_noisy_readings_is_referred_to_smooth_states():
    recordings, stated = fly({}, **SPEEDS)
    simulation = model_of(TRUTH)
    raw = [simulation.evaluate(compute_coefficients(r, AIRCRAFT), outside="ignore") for r in recordings]
    smooth, noisy = ready(recordings, stated), ready(recordings, raw)
    assert evaluated_at_readings(smooth, ("CZ",)) < 0.1
    assert evaluated_at_readings(noisy, ("CZ",)) > 0.9
    off = {}
    for flights, fraction in ((smooth, 0.0), (noisy, 0.0), (noisy, 1.0)):
        quick = np.concatenate([np.diff(referred(f, "CZ", fraction), 3) for f in flights])
        off[flights is noisy, fraction] = float(quick.std())
    assert off[True, 1.0] < 1.2 * off[False, 0.0] < 0.95 * off[True, 0.0]


def test_rows_are_white(correct):
    rows = CausalRows(correct, tolerances_of(correct))
    null = rows.null()
    white = null.filters["CZ"].white(rows.columns("CZ")[0], 0)[:, -1]
    assert_allclose(white.std(), 1.0, atol=0.15)
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.15


@pytest.fixture(scope="module")
def unsure(bent):
    problem, library = tried(bent, "missing-term")
    scores = tuple(score_all(problem, library))

    def ranking(seen, candidates=()):
        p = with_detection({"nothing": 0.6, "missing-term": 0.4}, seen, candidates, {"missing-term"})
        return Ranking(problem, (), scores, None, tuple(p.items()), scores, seen)

    return ranking


def detection(log_bayes, *tolerances):
    return Detection(tolerances, {"CZ": 0.0, "Cl": log_bayes}, [(-2.0, Event("m01", 5.0, 0.3, "step"))])


def mass(log_bayes):
    return ExceededTolerance(Nuisance("mass", 0.01, "relative", (), effect="missing-term"), 6.0, 0.2, log_bayes, 0.75)


def test_names_share_the_probability_of_what_was_detected(unsure):
    (finding,) = detected(unsure(detection(300.0)), ("CZ", "Cl"))
    probabilities = {p.effect: p.probability for p in finding.physics}
    assert_allclose(finding.probability, 1.0, atol=1e-6)
    assert_allclose([probabilities["unknown"], probabilities["missing-term"]], [0.6, 0.4], atol=1e-6)
    assert finding.ambiguous_with == ("missing-term",)
    assert finding.axes == ("Cl",)
    assert finding.to_dict()["probability"] == 1.0


def test_an_effect_with_as_much_evidence_as_what_was_detected_shares_what_is_unknown(unsure):
    candidates = CandidateEffect(np.zeros(len(FEATURES)), score=unsure(detection(0.0)).others[0])
    evidence = log_bayes(candidates.score)
    for above, share in ((0.0, 0.5), (50.0, 0.0), (-50.0, 1.0)):
        seen = detection(0.0)
        seen = replace(seen, remainder={"CZ": 0.0, "Cl": evidence + above - seen.log_bayes})
        seen = replace(seen, remainder={"CZ": 0.0, "Cl": seen.remainder["Cl"] + evidence + above - seen.log_bayes})
        p = with_detection({"nothing": 1.0, "missing-term": 0.0}, seen, [candidates], {"missing-term"})
        assert_allclose(p["missing-term"] / (1.0 - p["nothing"]), share, atol=0.01)
        assert_allclose(sum(p.values()), 1.0)


def test_what_is_not_detected_is_no_finding(unsure):
    assert detected(unsure(detection(10.0)), ("CZ", "Cl")) == []


def test_the_sentence_says_what_shows_the_mismatch():
    step = Detection((), {"CZ": 0.0}, [(200.0, Event("m02", 12.5, 0.3, "step"))])
    assert "'m02' at 12.5 +- 0.3 s (step" in step.says
    assert "'mass' deviates from its stated value by +6.0 +- 0.2 %, 6.0 times" in detection(0.0, mass(30.0)).says
    assert "in Cl" in detection(300.0).says


def test_a_tolerance_exceeded_is_named_by_its_effect_and_unknown_has_what_others_exceed(unsure):
    seen = detection(0.0, mass(30.0))
    (finding,) = detected(unsure(seen), ("CZ", "Cl"))
    probabilities = {p.effect: p.probability for p in finding.physics}
    # 0.4 as before, and of the rest 0.75 that the mass alone is exceeded, as far as nothing else is.
    exceeded_mass = 0.6 * 0.75 * expit((30.0 - seen.log_bayes) / SCALE)
    assert_allclose(
        [probabilities["missing-term"], probabilities["unknown"]], [0.4 + exceeded_mass, 0.6 - exceeded_mass], atol=1e-4
    )
    assert finding.physics[0].parameters["mass"].value == pytest.approx(0.06)
    assert detected(unsure(detection(0.0, mass(0.0))), ("CZ", "Cl")) == []


def test_the_event_is_written_with_its_time(unsure):
    step = Detection((), {"CZ": 0.0, "Cl": 0.0}, [(200.0, Event("m02", 12.5, 0.3, "step"))])
    (finding,) = detected(unsure(step), ("CZ", "Cl"))
    assert finding.to_dict()["where"]["events"] == [{"recording": "m02", "t": 12.5, "std": 0.3, "shape": "step"}]
    assert replace(step, tolerances=(mass(300.0),)).event == ()


def test_the_evidence_of_an_exceeded_tolerance_is_that_of_the_wider_prior():
    # One observation of a value known to v, prior of standard deviation s: its density is normal of variance v + s^2.
    v, seen = 0.3, 5.0
    variance = np.array([[1.0 / (1.0 + 1.0 / v)]])
    tolerance = Nuisance("mass", 0.01, "relative", (), effect="mass-error")
    (one,) = exceeded([tolerance], variance[0] * seen / v, variance)
    densities = [norm.pdf(seen, scale=np.sqrt(v + s**2)) for s in (5.0, 15.0, 50.0)]
    expected = np.log(np.mean(densities)) - norm.logpdf(seen, scale=np.sqrt(v + 1.0))
    assert_allclose(one.log_bayes, expected, rtol=1e-10)
    assert_allclose(one.deviations, seen, rtol=0.01)
    assert_allclose(one.estimate.value, 0.05, rtol=0.01)


def test_four_tolerances_known_exactly_are_as_probably_an_exceeded_one_as_not():
    tolerance = Nuisance("mass", 0.01, "relative", (), effect="mass-error")
    (one,) = exceeded([tolerance], np.array([4.0]), np.array([[1e-9]]))
    assert_allclose(one.log_odds, 0.0, atol=1e-6)


def test_a_term_of_which_less_than_a_quarter_is_there_is_missing_and_one_of_a_half_is_wrong():
    term = Nuisance("Cl: alpha*beta", 0.15, "relative", (), effect="wrong-derivative", absent="cross-coupling")
    half, fifth = (exceeded([term], np.array([x / 0.15]), np.array([[1e-6]]))[0] for x in (1.0, 4.0))
    assert (half.effect, fifth.effect) == ("wrong-derivative", "cross-coupling")


def test_what_has_no_stated_tolerance_and_explains_more_takes_the_name():
    stated = Nuisance("Cm: de", 0.05, "relative", (), effect="wrong-derivative")
    unstated = Nuisance("Cm over a step", 0.01, "s^2", (), delivered=True)
    (one,) = exceeded([stated, unstated], np.array([6.0, 12.0]), 1e-4 * np.eye(2))
    assert one.tolerance is stated
    assert one.alone < 1e-6
    (sure,) = exceeded([stated, unstated], np.array([6.0, 0.0]), 1e-4 * np.eye(2))
    assert sure.alone > 0.99


def test_evidence_of_recorded_motion_does_not_count_where_what_is_left_is_no_white_noise(monkeypatch):
    flights = flights_with({"Cm": {"de": 1.4 * TRUTH["Cm"]["de"]}}, **SPEEDS)
    problem = DiagnosisProblem.set_up(flights, ())
    calm = exceeded_as_recorded(problem)[0]
    monkeypatch.setattr("structsel.diagnosis.residuals.coloured_fractions", lambda *_: {"CX": 0.2, "CZ": 0.98})
    rough = {one.tolerance.name: one.log_bayes for one in exceeded_as_recorded(problem)}
    assert calm.log_odds > 3.0
    assert rough[calm.tolerance.name] < 0.1 * calm.log_bayes


def test_a_wrong_derivative_is_found_as_a_tolerance_exceeded():
    flights = flights_with({"Cm": {"de": 1.4 * TRUTH["Cm"]["de"]}}, **SPEEDS)
    first = detect(flights, DiagnosisProblem.set_up(flights, ())).tolerances[0]
    assert (first.tolerance.name, first.effect) == ("Cm: de", "wrong-derivative")
    assert_allclose(first.estimate.value, 0.4, atol=3.0 * first.estimate.std)
    assert first.estimate.std < 0.1
    assert first.log_odds > 3.0


def test_recordings_of_two_seconds_are_asked_too(correct):
    short = [f.between(0, 50, f.name) for f in correct]
    assert detect(short, DiagnosisProblem.set_up(short, ())).probability < 0.05


def test_nothing_exceeds_a_form_that_leaves_more_than_the_response(bent):
    flights = [replace(f, fit_error={"CZ": 4.0}) for f in bent]
    found = detect(flights, DiagnosisProblem.set_up(flights, ()))
    assert found.remainder["CZ"] == -np.inf
    assert found.probability < 0.05


def test_the_ledger_places_the_evidence_of_a_quadratic_term_in_its_response(bent):
    problem, library = tried(bent, "missing-term")
    best = score_all(problem, library)[0]
    by_band = load_benchmark("ledger").by_band(problem, best.signature)
    clearest = max(by_band, key=lambda c: max(by_band[c].values(), default=-np.inf))
    assert clearest == "CZ"
    assert max(by_band["CZ"].values()) > 10.0


def test_the_ledger_counts_evidence_of_correct_simulations():
    def case(null, best, other, known=None):
        form = None if best is None else {"log_bayes": best}
        return {"null": null, "best form": form, "best other": {"log_bayes": other}, "true difference": known,
                "confirmed other": {"log_bayes": other / 2.0}, "detection": None}  # fmt: skip

    said = load_benchmark("ledger").summary(
        [case(True, None, 12.0), case(True, None, 3.0), case(False, 50.0, 0.0, 100.0)]
    )
    assert "1 of 2 above 10; 12" in said[0]
    assert "as it counts: 0 of 2 above 10; 6" in said[1]
    assert "1 of 1; median 50%" in said[2]
