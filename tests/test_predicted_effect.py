"""The most probable effect in prediction errors: its evidence, and what it adds to the probability of a mismatch."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.special import expit

from structsel.comparison.causal_rows import CausalRows
from structsel.comparison.tolerances import tolerances_of
from structsel.diagnosis.detection import Detection, detect
from structsel.diagnosis.effect_probability import FEATURES
from structsel.diagnosis.event import Event
from structsel.diagnosis.predicted_effect import PredictedEffect, find_predicted
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.ranking import with_detection
from structsel.diagnosis.scoring import score_all
from structsel.diagnosis.weighing import CandidateEffect
from tests.noisy_flights import flights_with, tried

SPEEDS = {"speeds": (40.0, 45.0, 50.0, 55.0), "h": (1000.0,) * 4}


@pytest.fixture(scope="module")
def correct():
    return flights_with({}, **SPEEDS)


def candidate(flights, effect="missing-term"):
    problem, library = tried(flights, effect)
    (score,) = (one for one in score_all(problem, library) if one.effect == effect)
    return CandidateEffect(np.zeros(len(FEATURES)), score=score)


def test_the_evidence_of_columns_is_that_of_linear_regression_with_independent_coefficients(correct):
    rows = CausalRows(correct, tolerances_of(correct))
    null = rows.null()
    rng = np.random.default_rng(5)
    columns = [{c: 1e-3 * rng.standard_normal((len(f), 2)) for c in ("CZ", "CX")} for f in correct]

    Z, y = [], []
    for c in rows.responses:
        for i, f in enumerate(correct):
            added = columns[i].get(c, np.zeros((len(f), 2)))[rows.edge : len(f) - rows.edge]
            W = null.filters[c].white(rows.columns(c)[i], i)
            full = np.zeros((len(W), rows.q + 2))
            full[:, rows.place[c, i]] = W[:, :-1]
            # The filter is linear: columns appended to others are filtered like them.
            full[:, -2:] = null.filters[c].white(np.hstack([rows.columns(c)[i], added]), i)[:, -2:]
            Z.append(full)
            y.append(W[:, -1])
    Z, y = np.vstack(Z), np.concatenate(y)

    def log_evidence(Z):
        A, b = np.eye(Z.shape[1]) + Z.T @ Z, Z.T @ y
        return 0.5 * b @ np.linalg.solve(A, b) - 0.5 * np.linalg.slogdet(A)[1]

    assert_allclose(rows.jointly(null, columns), log_evidence(Z) - log_evidence(Z[:, :-2]), rtol=1e-6, atol=1e-6)


def test_a_missing_term_has_evidence_in_prediction_errors_and_none_in_a_correct_simulation(correct):
    bent = flights_with({"CZ": {"alpha^2": -6.0}}, **SPEEDS)
    one, found = candidate(bent), {}
    for name, flights in (("bent", bent), ("correct", correct)):
        rows = CausalRows(flights, tolerances_of(flights))
        found[name] = find_predicted(rows, rows.null(), [one], 1.0)
    assert found["bent"].effect == "missing-term"
    assert found["bent"].log_bayes > 30.0
    assert found["correct"].log_bayes < 3.0


def test_detection_asks_the_most_probable_effect_unless_it_is_an_event_or_an_instrument(correct):
    problem, one = DiagnosisProblem.set_up(correct, ()), candidate(correct)
    found = detect(correct, problem, [one])
    assert found.predicted.effect == "missing-term"
    assert found.probability < 0.05
    assert detect(correct, problem, []).predicted is None
    hypothesis = one.score.hypothesis
    searched = SimpleNamespace(effect=one.effect, event=True, hypothesis=hypothesis, input_only=True)
    assert detect(correct, problem, [replace(one, score=searched)]).predicted is None
    instrument = replace(one.score, hypothesis=replace(hypothesis, kind="sensor"))
    assert not instrument.event
    assert detect(correct, problem, [replace(one, score=instrument)]).predicted is None


def test_coloured_noise_and_the_form_of_an_identified_simulation_limit_it():
    one = PredictedEffect("icing", 100.0, 0.5, np.inf)
    assert one.log_odds > 10.0
    assert replace(one, white=0.05).log_odds < -3.0
    assert_allclose(replace(one, of_form=3.0).log_odds, 1.0)


def test_the_effect_has_the_probability_that_it_adds(correct):
    event = Event("m01", 5.0, 0.3, "step")
    seen = Detection((), {"CZ": -5.0}, [(-5.0, event)], predicted=PredictedEffect("missing-term", 40.0, 0.5, np.inf))
    p = with_detection({"nothing": 0.9, "missing-term": 0.1}, seen, [candidate(correct)], {"missing-term"})
    assert_allclose(p["nothing"], 0.9 * expit(-seen.predicted.log_odds), atol=1e-3)
    assert p["missing-term"] > 0.99 * (1.0 - p["nothing"])
