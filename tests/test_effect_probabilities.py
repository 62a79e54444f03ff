"""Probabilities of effects: the formula, the weights of the evidence, and the fit of the weights."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.fft import dct
from scipy.optimize import brentq
from scipy.special import expit, logit, softmax
from statsmodels.discrete.discrete_model import Logit

from proof import calibrate, write_case
from proof.generate import draw_case
from proof.worker import open_case
from structsel.diagnosis import diagnose, judging, scoring, size_evidence, weighing
from structsel.diagnosis.dispersion import NOISE_ALONE, Dispersion
from structsel.diagnosis.effect_probability import (
    AGAINST,
    COLOURED,
    FEATURES,
    IDENTIFIED,
    WEIGHTS,
    EffectEvidence,
    coloured,
    first_probabilities,
    further_probabilities,
)
from structsel.diagnosis.members import Member, mean_gains
from structsel.diagnosis.size_evidence import beyond_form, jackknifed
from structsel.effects.base import EffectParameter
from structsel.numerics.evidence import Trial


def test_a_mismatch_is_as_probable_as_its_best_effect_alone_and_the_names_share_that():
    x, priors = np.random.default_rng(1).uniform(size=(3, len(FEATURES))), np.array([0.0, -1.0, 2.0])
    p = further_probabilities([EffectEvidence(row, lead_alone=0.5, log_prior=prior) for row, prior in zip(x, priors)])
    alone = x.copy()
    alone[:, FEATURES.index("ahead")], alone[:, FEATURES.index("behind")] = 0.5, 0.0
    assert p[0] == pytest.approx(expit(-(WEIGHTS[0] + alone @ WEIGHTS[1:]).max()))
    assert p[1:] == pytest.approx((1.0 - p[0]) * softmax(x @ WEIGHTS[1:] + priors))
    assert further_probabilities([]) == pytest.approx([1.0])


def scored(
    with_effect, delivered, kind="atmospheric", input_only=None, unconfirmed_weight=0.0, contradiction=0.0,
    dispersion=NOISE_ALONE,
):  # fmt: skip
    """An effect with its log Bayes factors over tolerances, and over the simulation as given."""
    return SimpleNamespace(
        event=False, predictive=np.array([with_effect]), within=0.0, log_evidence=with_effect,
        input_only=input_only, unconfirmed_weight=unconfirmed_weight, contradiction=contradiction,
        dispersion=dispersion,
        hypothesis=SimpleNamespace(log_prior=0.0, kind=kind), as_given=delivered,
    )  # fmt: skip


def test_an_effect_no_larger_than_the_form_of_an_identified_simulation_leaves_is_no_evidence(monkeypatch):
    t = np.linspace(0.0, 10.0, 200)
    flight = SimpleNamespace(simulated={"CZ": np.sin(t)}, form_error={"CZ": 0.1}, fit_error={})
    effect = SimpleNamespace(responses=("CZ",))
    rows = SimpleNamespace(part=lambda _: slice(0, 2))
    without = SimpleNamespace(fitted_residuals=[(rows, np.array([3.0, 2.0]))])
    problem = SimpleNamespace(flights=[flight], accepted=[effect], fitted_residuals=[(rows, np.array([1.0, 0.0]))])
    for size, expected in ((0.1, 0.5), (0.3, 4.5)):
        monkeypatch.setattr(size_evidence, "contributions", lambda *_, size=size: [{"CZ": size * np.sin(t)}])
        assert beyond_form(without, problem) == pytest.approx(expected)
    effect.responses = ("CZ", "k_alpha")  # what it explains of a kinematic residual: (3^2 + 2^2 - 1) / 2
    assert beyond_form(without, problem) == pytest.approx(6.0)
    flight.form_error = {}
    assert beyond_form(without, problem) == np.inf


def features(**given):
    return np.array([given.get(name, 0.0) for name in FEATURES])


def test_of_an_identified_simulation_the_same_evidence_is_worth_less():
    stated, identified = (EffectEvidence(features(), identified=flag).log_odds for flag in (False, True))
    assert stated - identified == pytest.approx(IDENTIFIED)


def test_a_mismatch_that_two_effects_explain_alike_is_as_probable_as_with_one():
    one = EffectEvidence(features(takes=1.0, level=1.0))
    alone, pair = first_probabilities([one], 0.0), first_probabilities([one, one], 0.0)
    assert alone[0] < 0.2
    assert pair == pytest.approx([alone[0], 0.5 * alone[1], 0.5 * alone[1]])
    unconfirmed = replace(one, is_tested=False)  # its alternatives count against it
    assert unconfirmed.log_odds_alone() == unconfirmed.log_odds < one.log_odds_alone()


def test_evidence_counts_as_far_as_what_is_left_is_white_noise():
    one = EffectEvidence(features(), lead_alone=0.0, log_bayes=100.0)
    even = brentq(lambda white: white * (1.0 - (1.0 - white) ** 16) - 0.32, 0.2, 0.9)
    assert even == pytest.approx(0.32, abs=0.005)
    p = [first_probabilities([one], white)[1] for white in (0.0, even, 1.0)]
    assert p[0] < 0.1
    assert p[1:] == pytest.approx([0.5, 1.0], abs=1e-6)
    assert first_probabilities([], 1.0) == pytest.approx([1.0])


def test_where_no_noise_is_white_a_mismatch_is_less_probable_and_the_names_are_the_same():
    def probabilities(white):
        first, second = (features(takes=x, behind=x - 1.0) for x in (1.0, -1.0))
        untested = EffectEvidence(second, is_tested=False)
        return first_probabilities([EffectEvidence(first, gain=0.0), untested], white)

    some = [probabilities(white) for white in (0.0, 0.1, 0.5, 1.0)]
    odds = [logit(1.0 - p[0]) for p in some]
    assert odds == sorted(odds)
    assert odds[-1] - odds[0] == pytest.approx(COLOURED)
    assert all(p[1] / p[2] == pytest.approx(some[0][1] / some[0][2]) for p in some)
    assert coloured(None) == 0.0  # without forces


def test_an_effect_whose_size_no_two_flights_agree_on_is_not_probable():
    one = EffectEvidence(features(takes=9.0, level=9.0))
    assert first_probabilities([one], 1.0)[1] > 0.99
    assert first_probabilities([replace(one, max_log_odds=-2.0)], 1.0)[1] == pytest.approx(1.0 / (1.0 + np.exp(2.0)))


def test_each_feature_has_the_sign_that_it_must_have():
    assert all((w < 0.0) == (name in AGAINST) for name, w in zip(FEATURES, WEIGHTS[1:]))


def test_evidence_that_tolerances_can_absorb_does_not_count_once_something_was_found():
    def score(effect, with_effect, delivered, event=False):
        return SimpleNamespace(
            effect=effect, event=event, predictive=np.array([with_effect]), within=0.0, log_evidence=with_effect,
            hypothesis=SimpleNamespace(name=effect, log_prior=0.0), as_given=delivered,
            input_only=None, unconfirmed_weight=0.0, dispersion=NOISE_ALONE,
        )  # fmt: skip

    first = SimpleNamespace(accepted=(), found=frozenset())
    gust = SimpleNamespace(accepted=(SimpleNamespace(),), found=frozenset({"gust"}))
    mass, gusts = score("mass-error", 1.0, 400.0), score("gust", 900.0, 900.0, event=True)
    assert [weighing.evident(b, mass) for b in (first, gust)] == [True, False]
    assert [weighing.evident(b, gusts) for b in (first, gust)] == [True, False]
    assert weighing.evident(gust, score("icing", 20.0, 0.0))
    assert not weighing.evident(first, score("mass-error", 9.0, 60.0))  # the gain that tolerances alone give at random


def test_evidence_that_the_response_to_the_inputs_does_not_confirm_does_not_count():
    gusty = scored(900.0, 400.0, input_only=scored(-1.0, 2.0))
    true, unasked = scored(90.0, 40.0, input_only=scored(60.0, 30.0)), scored(9.0, 4.0)
    assert [weighing.log_bayes(s) for s in (gusty, true, unasked)] == pytest.approx([-1.5, 90.0, 9.0])
    assert [weighing.log_bayes_as_given(s) for s in (gusty, true, unasked)] == pytest.approx([3.0, 40.0, 4.0])
    half = scored(
        900.0, 400.0, input_only=scored(-1.0, 2.0), unconfirmed_weight=0.5
    )  # as what takes nearly all on other flights may
    assert (weighing.log_bayes(half), weighing.log_bayes_as_given(half)) == pytest.approx((449.25, 201.5))


def test_a_size_that_the_response_to_the_inputs_contradicts_counts_against_an_effect():
    there = scored(11.0, 8.0)
    moved_by_gusts = scored(5630.0, 12.0, input_only=there, contradiction=818.0)
    assert weighing.log_bayes(moved_by_gusts) == 1.5 * (11.0 - 807.0)
    # A recorded size off by a quarter is not contradicted, nor is one that is as probable there as no effect.
    assert weighing.log_bayes(scored(5630.0, 12.0, input_only=there, contradiction=0.7)) == 16.5
    assert weighing.confirmed(8443.0, 426.0) == 8443.0
    assert weighing.confirmed(50.0, 50.0) == 50.0


def test_the_response_to_the_inputs_limits_what_the_residual_leaves():
    four, there = Dispersion(4.0, 200.0), scored(10.0, 0.0)
    assert weighing.log_bayes(scored(100.0, 0.0)) == 100.0
    assert weighing.log_bayes(scored(100.0, 0.0, dispersion=four)) == pytest.approx(25.0)
    limited = scored(100.0, 0.0, input_only=there, dispersion=four)
    assert weighing.log_bayes(limited) == pytest.approx(15.0)
    assert weighing.unconfirmed_log_bayes([limited]) == pytest.approx(85.0)  # of the factors as they were


def test_a_contradiction_is_half_the_squared_distance_beyond_chance():
    def trial(theta, std):
        return Trial(0.0, np.zeros(2), np.array(theta), np.diag(np.square(std)), np.zeros(4))

    one, other = trial([6.0, 1.0], [0.3, 3.0]), trial([1.0, -2.0], [0.4, 4.0])
    assert scoring.contradiction(one, other) == pytest.approx(0.5 * (100.0 + 0.36 - 2.0))
    assert scoring.contradiction(one, one) == 0.0


def test_the_log_bayes_factor_is_against_the_best_other_effect_and_within_one():
    scores = [SimpleNamespace(log_bayes=x) for x in (100.0, 40.0, -5.0)]
    ahead = [weighing.ahead_of(s, scores, lambda one: one.log_bayes) for s in scores]
    assert ahead == pytest.approx([0.6, -1.0, -1.0])
    near = [SimpleNamespace(log_bayes=x) for x in (100.0, 98.0, 40.0)]
    as_good_as_the_first = weighing.ahead_of(near[1], near, lambda one: one.log_bayes)
    assert as_good_as_the_first == pytest.approx(58.0 / 98.0)
    alone = [SimpleNamespace(log_bayes=10.0)]
    assert weighing.ahead_of(alone[0], alone, lambda one: one.log_bayes) == pytest.approx(0.5)  # half of 20


def test_the_lead_does_not_jump_where_an_alternative_becomes_as_good():
    leads = []
    for other in np.arange(80.0, 125.0, 0.02):
        scores = [SimpleNamespace(log_bayes=x) for x in (100.0, other, 40.0)]
        leads.append(weighing.ahead_of(scores[0], scores, lambda one: one.log_bayes))
    assert (leads[0], leads[-1]) == pytest.approx((0.2, -0.25), abs=0.001)
    assert leads[1000] == pytest.approx(0.6)  # 100 and 100
    assert np.abs(np.diff(leads)).max() < 0.01


def test_an_alternative_that_is_as_good_as_given_counts_if_the_tolerances_distinguish_it():
    one, other, far = scored(3456.0, 1594.0), scored(2960.0, 1623.0), scored(2357.0, 449.0)
    assert weighing.lead(one, [one, other, far]) == pytest.approx(1.0 - 2960.0 / 3456.0)
    as_good = scored(3440.0, 1623.0)
    assert weighing.lead(one, [one, as_good, far]) > 1.0


def test_what_tolerances_would_still_add_to_an_effect_does_not_count_for_it():
    def alone(exact, free, still_added):
        trial = SimpleNamespace(at_scales=np.array([free, exact]), log_bayes=free)
        return scoring.EffectScore(
            SimpleNamespace(name=""), (), (trial,), np.zeros(1), free, np.zeros(2), np.array([still_added]), 0.0, 0
        ).as_given_alone

    assert alone(787.0, 10.0, 698.0) == 89.0  # one of many parameters that deviate within their tolerances
    assert alone(539.0, 19.0, 6.0) == 533.0  # the only one that deviates
    assert alone(984.0, 971.0, 1000.0) == 971.0  # tolerances and effect are different differences
    assert alone(50.0, 60.0, 200.0) == 50.0


def test_an_effect_that_is_one_deviation_of_many_is_less_probable_alone():
    one = SimpleNamespace(**vars(scored(7.0, 787.0)), as_given_alone=89.0)
    assert weighing.lead(one, ()) > 1.4
    assert weighing.lead(one, (), weighing.log_bayes_alone) == pytest.approx(np.log1p(8.9) / 3.0)


def test_an_effect_is_behind_the_best_by_its_gain_at_admission():
    first, near, far, delivered = scored(1000.0, 50.0), scored(980.0, 0.0), scored(200.0, 0.0), scored(2.0, 400.0)
    kept = [first, near, far, delivered]
    assert [weighing.behind(s, kept) for s in kept] == pytest.approx([0.0, -1.0, -3.0, 0.0])
    assert weighing.behind(scored(11.0, 0.0), [scored(16.0, 0.0)]) == pytest.approx(-0.5)  # 10 is clear


def problem_of(signals):
    """Problems that hold white rows of one response of several flights: a level, and cosine coefficients."""
    rows = SimpleNamespace(part=lambda response: slice(None), flight=SimpleNamespace(name="m01"))
    left = [(rows, np.concatenate([[0.0], dct(x, norm="ortho")])) for x in signals]
    return SimpleNamespace(held_out_residuals=left, fitted_residuals=left, responses=("CZ",))


def test_a_few_samples_count_by_the_effect_there():
    rng = np.random.default_rng(2)
    noise = [rng.normal(size=400) for _ in range(3)]
    stop = np.zeros(400)
    stop[100:104] = 8.0
    without, with_effect = problem_of([x + stop for x in noise]), problem_of(noise)
    before, after = judging.excess_where_moved(without, with_effect)["CZ"]
    there = np.concatenate([x[100:104] for x in noise])
    assert before == pytest.approx(np.mean((there + 8.0) ** 2))
    assert after == pytest.approx(np.mean(there**2))
    assert judging.excess_where_moved(without, without) == {}


def test_an_effect_gains_by_the_fraction_of_each_response_however_small_that_is():
    """Two effects, one in each response: as much of either counts the same, whatever its noise."""

    def plain(kept):
        left = {"CZ": 100.0 * np.ones(4) * (0.5 if 0 in kept else 1.0), "Cm": np.ones(4) * (0.5 if 1 in kept else 1.0)}
        rows = SimpleNamespace(part=lambda c: slice(*{"CZ": (0, 4), "Cm": (4, 8), "CY": (8, 12)}[c]))
        return SimpleNamespace(fitted_residuals=[(rows, np.concatenate([left["CZ"], left["Cm"], np.zeros(4)]))])

    problem = SimpleNamespace(subset=plain, judged_responses=["CZ", "Cm", "CY"])  # nothing is amiss in CY
    both = [Member((), (0,)), Member((), (1,))]
    assert mean_gains(problem, both) == pytest.approx([np.log(4.0), np.log(4.0)])


def test_an_effect_that_explains_nearly_all_gains_more_than_one_that_takes_its_place_in_part():
    """A spring's cube leaves 1e-4 of the power, stops in its place 6 %; with both 3e-5 are left."""
    left = {frozenset(): 1.0, frozenset({0}): 1e-4, frozenset({1}): 0.06, frozenset({0, 1}): 3e-5}
    rows = SimpleNamespace(part=lambda c: slice(None))

    def only(kept):
        return SimpleNamespace(fitted_residuals=[(rows, np.sqrt(left[frozenset(kept)]) * np.ones(1))])

    problem = SimpleNamespace(subset=only, judged_responses=["angle"])
    spring, stops = mean_gains(problem, [Member((), (0,)), Member((), (1,))])
    assert spring == pytest.approx(0.5 * (np.log(1e4) + np.log(0.06 / 3e-5)))
    assert stops < 0.4 * spring


def test_the_jackknife_of_a_mean_is_its_standard_error():
    x = np.random.default_rng(3).normal(size=9)
    without = np.array([[np.delete(x, i).mean()] for i in range(9)])
    assert jackknifed(without) == pytest.approx([x.std(ddof=1) / 3.0])
    assert jackknifed(without[:1]) == pytest.approx([0.0])


def test_weights_of_searches_with_one_candidate_are_those_of_a_logistic_regression():
    rng = np.random.default_rng(4)
    x = np.column_stack([np.ones(300), rng.uniform(size=(300, 2))])
    y = rng.uniform(size=300) < expit(x @ [-2.0, 3.0, 1.5])
    rounds = []
    for (_, ahead, takes), right in zip(x, y):
        evidence = {"features": features(ahead=ahead, takes=takes).tolist(), "lead_alone": ahead}
        rows = [{"right": bool(right), "evidence": evidence}]
        rounds.append({"case": "", "round": 1, "white": None, "rows": rows})
    found = calibrate.fit(rounds, mild=0.0)
    assert found[:3] == pytest.approx(Logit(y, x).fit(disp=0).params, abs=2e-3)


@pytest.mark.slow
def test_what_is_collected_of_a_case_gives_the_probabilities_that_the_diagnosis_states(tmp_path):
    case = draw_case(60004, effect="cg-shift", severity="easy")
    write_case(case, tmp_path / "cases", tmp_path / "keys")
    found = [json.loads(json.dumps(one)) for one in calibrate.collect(tmp_path, case.name)]
    assert [one["round"] for one in found] == [0, 1]
    right = [p for p, hit in zip(calibrate.stated(found[0], WEIGHTS), calibrate.right_of(found[0])) if hit]
    named = diagnose(*open_case(tmp_path / "cases" / case.name)).findings[0]
    assert named.effect == "cg-shift"
    assert named.physics[0].probability == pytest.approx(sum(right), abs=0.05)


@pytest.mark.parametrize(
    ("times", "only_in", "values", "choices"),
    [
        (("time",), (), 1.0, 60.0),
        (("time in m01", "time in m02"), (), 1.0, 60.0**2),
        ((), ("m01",), 1.0, 2.0**2),
        ((), (), 7.0, 7.0),
    ],
)
def test_what_was_searched_costs_the_log_of_the_number_of_choices(times, only_in, values, choices):
    base = SimpleNamespace(evidence=np.zeros((1, 2)), y=[np.zeros(4)], freed=np.zeros(1))
    trial = Trial(50.0, np.array([25.0, 25.0]), np.ones(1), np.eye(1), np.array([50.0]))

    def found(given, where, searched):
        parameters = (EffectParameter("bias", "-", 1.0),)
        variant = SimpleNamespace(times=given, only_in=where, parameters=parameters, searched=searched)
        form = SimpleNamespace(variant=variant, flights={"m01", "m02"})
        return scoring.score(SimpleNamespace(base=base), SimpleNamespace(event=False), [form], [trial])

    # Half a minute has sixty places half a second apart.
    cost = found((), (), 0.0).log_evidence - found(times, only_in, np.log(values)).log_evidence
    assert cost == pytest.approx(np.log(choices), rel=0.05)
