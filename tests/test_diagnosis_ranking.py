"""Which effects are taken in, what is no effect at all, and when none of the names may be right."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from numpy.testing import assert_allclose

from structsel.demo.aircraft import TRUTH
from structsel.diagnosis import judging, members, ranking
from structsel.diagnosis.assembling import make_findings
from structsel.diagnosis.diagnose import unpredicted
from structsel.diagnosis.effect_probability import AGAINST, FEATURES, further_probabilities
from structsel.diagnosis.notes import notes
from structsel.diagnosis.ranking import Ranking, rank
from structsel.diagnosis.scoring import score_all
from structsel.diagnosis.signatures import Library
from structsel.diagnosis.weighing import CandidateEffect, candidate_effects
from structsel.numerics.evidence import Base
from structsel.recording import Recording
from tests.noisy_flights import flights_with, fly, ready, tried


def test_an_effect_in_several_places_is_one_hypothesis(monkeypatch):
    def taken(effects):
        left = iter(effects)
        monkeypatch.setattr(ranking, "score_all", lambda *_: [])
        monkeypatch.setattr(ranking, "candidate_effects", lambda *_: [likely(next(left))])
        monkeypatch.setattr(ranking, "first_probabilities", lambda those, _: further_probabilities(those))
        monkeypatch.setattr(ranking, "white_fraction", lambda _: 0.0)
        plant = SimpleNamespace(channels={})
        problem = SimpleNamespace(
            accepted=(), flights=(plant,), nuisances=(), is_plant=True, with_effects=lambda *_: problem
        )
        return len(rank(problem, Library((), {})).steps)

    assert taken("abcde") == 4
    assert taken("aaabcde") == 6
    assert taken("a" * 20) == 8


def likely(effect):
    """An effect that is certain."""
    score = SimpleNamespace(effect=effect, signature=None, input_only=True)
    return CandidateEffect(np.where(np.isin(FEATURES, AGAINST), 0.0, 10.0), score=score)


def test_an_effect_that_leaves_much_of_its_own_responses_has_a_warning_and_one_that_explains_them_has_none():
    flights = flights_with({"Cl": {"da^3": -20.0}})

    def found(*effects):
        return make_findings(rank(*tried(flights, *effects)), lambda axes: {})[0]

    alone = found("wrong-derivative")
    assert alone.ambiguous_with == ("unknown",)
    stays = float(re.search(r"leaves (\d+) % of the power beyond the noise in Cl\.", alone.physics[0].says)[1]) / 100.0
    probabilities = {one.effect: one.probability for one in alone.physics}
    # The remaining fraction, at most half, of the probability of the named effects is that of something else.
    assert_allclose(probabilities["unknown"] / sum(probabilities.values()), min(stays, 0.5), atol=0.006)
    # Where "unknown" was detected as well, it is one alternative and not two.
    ranking = rank(*tried(flights, "wrong-derivative"))
    (step,) = ranking.steps
    seen = make_findings(
        replace(ranking, steps=(replace(step, alternatives=(*step.alternatives, ("unknown", 0.9))),)), lambda axes: {}
    )[0]
    assert seen.ambiguous_with == ("unknown",)
    assert [one.effect for one in seen.physics].count("unknown") == 1
    right = found("wrong-derivative", "control-nonlinearity")
    assert (right.effect, right.ambiguous_with) == ("control-nonlinearity", ())


def test_an_effect_that_adds_nearly_nothing_to_others_is_no_finding(monkeypatch):
    flights = flights_with({"Cl": {"da^3": -20.0}, "CZ": {"alpha^2": -6.0}})
    found = rank(*tried(flights, "control-nonlinearity", "missing-term"))
    both = {"control-nonlinearity", "missing-term"}
    # The second explains a hundredth of what both do, but much of CZ.
    assert {f.effect for f in make_findings(found, lambda axes: {})} == both
    assert found.only(both) is found
    monkeypatch.setattr(members, "_NEGLIGIBLE", 0.9)
    # Without the second, tolerances of CZ would have to be exceeded: it has evidence.
    assert {f.effect for f in make_findings(found, lambda axes: {})} == both
    monkeypatch.setattr(members, "EVIDENT", np.inf)
    (finding,) = make_findings(found, lambda axes: {})
    assert (finding.effect, finding.fraction) == ("control-nonlinearity", 1.0)
    (step,) = found.only({finding.effect}).steps
    assert step.score.effect == finding.effect
    assert [s.hypothesis.name for s in step.problem.accepted] == [finding.effect]


def test_timing_that_other_flights_do_not_confirm_keeps_its_stated_value():
    recordings, stated = fly({})
    problem, _ = tried(ready(recordings, stated), "wrong-derivative")
    delayed = [n.name for n in problem.nuisances].index("de, da, dr late")

    def free(*signs):
        y = [s * 5.0 * B[:, delayed] for s, B in zip(signs, problem.base.given, strict=True)]
        other = replace(problem, base=Base(y, problem.base.given, problem.base.groups, problem.base.scales))
        return other.as_given.nuisances

    assert "de, da, dr late" in [n.name for n in free(1.0, 1.0)]
    assert free(1.0, -1.0) == []


def test_a_small_attitude_scale_error_is_that_of_the_attitude_and_not_of_a_gyro():
    recordings, stated = fly({})

    def read_as(channel, factor):
        read = [Recording(r.name, r.t, {**r.channels, channel: factor * r[channel]}, r.units) for r in recordings]
        problem, library = tried(ready(read, stated), "sensor-scale")
        k = [n.name for n in problem.nuisances].index("phi scale")
        return problem.deviations[0][k] * problem.nuisances[k].sd, score_all(problem, library)[0]

    scale, accused = read_as("phi", 1.02)
    assert_allclose(scale, 0.02, rtol=0.1)
    assert accused.signature.variant.about == "the bank angle"
    assert_allclose(accused.trial.theta[0] * accused.signature.variant.parameters[0].sd, 0.02, rtol=0.1)
    gyros = [t.log_bayes for t, s in zip(accused.trials, accused.signatures) if "gyro" in s.variant.about]
    assert max(gyros) < 10.0
    # A gyro that is off by 5 % is found all the same: by moments, and by more than an attitude is ever off.
    _, found = read_as("p", 1.05)
    assert found.signature.variant.about == "the roll gyro (p)"
    assert found.log_evidence > 100.0
    assert_allclose(found.trial.theta[0] * found.signature.variant.parameters[0].sd, 0.05, rtol=0.1)


def test_an_effect_that_only_kinematics_shows_is_a_remark_to_the_verdict():
    recordings, stated = fly({})

    def said(north, east):
        windy = [
            Recording(r.name, r.t, {**r.channels, "vn": r["vn"] + north, "ve": r["ve"] + east}) for r in recordings
        ]
        problem, library = tried(ready(windy, stated), "steady-wind", "sensor-scale")
        return notes(Ranking(problem, (), tuple(score_all(problem, library))))

    (wind,) = said(3.0, -1.0)
    assert "not the coefficients: A steady wind of" in wind
    north, east = (float(x) for x in re.findall(r"(-?[0-9.]+) \+- [0-9.]+ m/s", wind))
    assert_allclose((north, east), (3.0, -1.0), atol=0.1)
    assert said(0.0, 0.0) == []


def test_responses_with_little_predicted_are_reported():
    (said,) = unpredicted({"CZ": (0.2, True), "Cl": (0.94, True)})
    assert "relative to the measured rms: Cl 0.94." in said
    assert unpredicted({"CZ": (0.2, True)}) == []


def test_an_effect_that_takes_errors_within_tolerances_where_these_are_exact_stays_a_candidate():
    slope = TRUTH["CZ"]["alpha"]
    bent = {"alpha": 0.08 * slope, "V*alpha": 0.02 * slope}
    within = {"CY": {"beta": 1.2 * TRUTH["CY"]["beta"]}, "Cl": {"da": 1.2 * TRUTH["Cl"]["da"]}}
    flights = flights_with({"CZ": bent, **within}, speeds=(42.0, 50.0, 46.0), h=(1000.0,) * 3)
    problem, library = tried(flights, "flexibility")
    (score,) = score_all(problem, library)

    def gained(before):
        after = before.with_effect(score.signature)
        return judging.gains(judging.held_out(before), judging.held_out(after), after.judged_responses)

    assert min(gained(problem.as_given).values()) < -0.5
    assert gained(problem)["CZ"] > 0.5
    assert min(gained(problem).values()) > -0.1
    (candidate,) = candidate_effects(problem, [score])
    assert candidate.effect == "flexibility"
