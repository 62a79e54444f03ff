"""The manoeuvre that would separate two effects: its measure against dense algebra, and what it finds."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.diagnosis.scoring import score_all
from structsel.diagnosis.separating import find_separation, with_separation
from tests.noisy_flights import excite, flights_with, tried


@pytest.fixture(scope="module")
def asked():
    """Comparison problem of two flights whose elevator barely moves, and the scores of two effects in pitch."""
    flights = flights_with({"Cm": {"q_hat": -8.0}}, inputs=lambda t, k: excite(t, k, 0.008, 0.05, 0.04))
    problem, library = tried(flights, "wrong-derivative", "downwash-lag", "asymmetry", "cg-shift")
    return problem, {s.effect: s for s in score_all(problem, library)}


def test_the_information_is_the_part_of_the_first_effect_that_the_other_and_the_tolerances_leave(asked):
    problem, scores = asked
    one, other = scores["wrong-derivative"], scores["downwash-lag"]
    y = np.concatenate(
        [r.whiten(x, one.signature.width) @ one.trial.theta for r, x in zip(problem.rows, one.signature.spectra)]
    )
    B = np.vstack([
        np.column_stack([given, r.whiten(x, other.signature.width)])
        for r, given, x in zip(problem.rows, problem.base.given, other.signature.spectra)
    ])  # fmt: skip
    expected = 0.5 * y @ np.linalg.solve(np.eye(len(y)) + B @ B.T, y)
    assert_allclose(find_separation(problem, one, other).recorded, expected, rtol=1e-6)


@pytest.mark.slow
def test_a_manoeuvre_on_the_control_that_barely_moved_separates_two_effects_in_pitch(asked):
    problem, scores = asked
    one, other = scores["wrong-derivative"], scores["downwash-lag"]
    found = find_separation(problem, one, other)
    assert found.log_bayes > found.recorded
    assert "de" in found.inputs.names
    assert f"wrong-derivative from downwash-lag best: expected log Bayes factor {found.log_bayes:.0f}" in found.says
    seconds = found.inputs.t[-1]
    assert f"in {seconds:.0f} s" in found.says
    largest = max(np.abs(f["de"] - np.median(np.concatenate([g["de"] for g in problem.flights]))).max()
                  for f in problem.flights)  # fmt: skip
    assert np.abs(found.inputs["de"]).max() <= 1.001 * largest  # at most what was recorded


@pytest.mark.slow
def test_no_manoeuvre_separates_equal_effects(asked):
    problem, scores = asked
    one = scores["asymmetry"]
    found = find_separation(problem, one, one)
    assert found.inputs is None
    assert found.says.startswith("None of")


@pytest.mark.slow
@pytest.mark.parametrize("dt", [0.0200072, 0.03, 0.3])
def test_manoeuvres_are_tried_at_any_interval_between_samples(asked, dt):
    problem, scores = asked
    flights = tuple(replace(f, t=f.t[0] + dt * np.arange(len(f)), dt=dt) for f in problem.flights)
    found = find_separation(replace(problem, flights=flights), scores["wrong-derivative"], scores["asymmetry"])
    assert "simulated manoeuvres" in found.says


def test_no_manoeuvre_is_given_where_the_simulation_differs_from_its_surrogate(asked):
    problem, scores = asked
    flights = tuple(replace(f, simulated={**f.simulated, "lift": f.simulated["CZ"]}) for f in problem.flights)
    assert find_separation(replace(problem, flights=flights), scores["asymmetry"], scores["cg-shift"]) is None


def test_a_diagnosis_without_a_tie_stays_as_it_is():
    finding = SimpleNamespace(effect="asymmetry", ambiguous_with=())
    step = SimpleNamespace(score=SimpleNamespace(effect="asymmetry"))
    assert with_separation(finding, SimpleNamespace(steps=(step,))) is finding
    assert with_separation(finding, SimpleNamespace(steps=())) is finding
