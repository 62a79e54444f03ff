"""A mismatch is detected from prediction errors before it is named, and a correct simulation is not."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.coefficients import compute_coefficients
from structsel.comparison.causal_rows import CausalRows, averaged, evaluated_at_readings, referred
from structsel.comparison.tolerances import tolerances_of
from structsel.diagnosis.detection import Detection, detect
from structsel.diagnosis.ranking import Ranking
from structsel.diagnosis.scoring import score_all
from structsel.diagnosis.unnamed import detected
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
    found = detect(bent, tolerances_of(bent))
    assert found.axes == ("CZ",)
    assert found.probability > 0.95


def test_a_correct_simulation_is_not_a_mismatch(correct):
    assert detect(correct, tolerances_of(correct)).probability < 0.05


def test_rounding_of_the_samples_does_not_matter(bent):
    # Thresholds act on a continuous score: a change of 1e-12 in the samples must not change it visibly.
    moved = [type(f)(**{**vars_of(f), "measured": {c: x * (1.0 + 1e-12) for c, x in f.measured.items()}}) for f in bent]
    first, second = (detect(f, tolerances_of(f)).log_bayes for f in (bent, moved))
    assert_allclose(second, first, rtol=1e-6)


def vars_of(flight):
    return {name: getattr(flight, name) for name in flight.__dataclass_fields__}


def test_the_order_of_the_recordings_does_not_matter(bent):
    first, second = (detect(f, tolerances_of(f)).log_bayes for f in (bent, bent[::-1]))
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
    white = rows.white("CZ", 0, null.filters["CZ"])[:, -1]
    assert_allclose(white.std(), 1.0, atol=0.15)
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.15


@pytest.fixture(scope="module")
def unsure(bent):
    problem, library = tried(bent, "missing-term")
    scores = tuple(score_all(problem, library))
    return Ranking(problem, (), scores, None, (("nothing", 0.6), ("missing-term", 0.4)), scores)


def detection(log_bayes):
    return Detection(-2.0, {"CZ": 0.0, "Cl": log_bayes}, [(-2.0, "m01", "step", 5.0)], "mass")


def test_names_share_the_probability_of_what_was_detected(unsure):
    (finding,) = detected(detection(300.0), unsure, ("CZ", "Cl"))
    chances = {p.effect: p.probability for p in finding.physics}
    assert_allclose(finding.probability, 1.0, atol=1e-6)
    assert_allclose([chances["unknown"], chances["missing-term"]], [0.6, 0.4], atol=1e-6)
    assert finding.ambiguous_with == ("missing-term",)
    assert finding.axes == ("Cl",)
    assert finding.to_dict()["probability"] == 1.0


def test_what_is_not_detected_is_no_finding(unsure):
    assert detected(detection(10.0), unsure, ("CZ", "Cl")) == []


def test_the_sentence_says_what_shows_the_mismatch():
    step = Detection(-2.0, {"CZ": 0.0}, [(200.0, "m02", "step", 12.5)], "mass")
    assert "'m02' at 12.5 s (step" in step.says
    assert "'mass' above all" in Detection(200.0, {"CZ": 0.0}, [(0.0, "m01", "step", 1.0)], "mass").says
    assert "in Cl" in detection(300.0).says


def test_recordings_of_two_seconds_are_asked_too(correct):
    short = [f.between(0, 50, f.name) for f in correct]
    assert detect(short, tolerances_of(short)).probability < 0.05


def test_a_plant_without_coefficients_is_not_asked():
    plant = SimpleNamespace(simulated={"level": np.zeros(100)}, channels={})
    assert detect([plant], []) is None


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
                "detection": None}  # fmt: skip

    said = load_benchmark("ledger").summary(
        [case(True, None, 12.0), case(True, None, 3.0), case(False, 50.0, 0.0, 100.0)]
    )
    assert "1 of 2 above 10; 12" in said[0]
    assert "1 of 1; median 50%" in said[1]
