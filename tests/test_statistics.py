"""What the selection claims of itself in repeated flights; seeds are fixed, so every figure here is one number.

The flights, truths and residual noise models are those of benchmarks/cases.py.
"""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy import stats

from structsel.numerics.regressors import ArrayData
from structsel.selection.engine import select_arrays
from structsel.selection.settings import SelectOptions

from .flights import cases, signals_of
from .pools import monomial_exponents


def run(case, exponents, include=(), **options):
    asked = SelectOptions(**{"F_in": "auto", "bootstrap": 0, "workers": 1, **options})
    return select_arrays(signals_of(case), exponents, asked, include)[0]


# --- intervals -------------------------------------------------------------------------------------


def few_and_many(*numbers):
    """Cases of each noise model: few runs in the default set, which show a gross error, and many in the slow one."""
    few, many = numbers
    noise_models = ("ar1_0.92", "smoothed_5pt")
    return pytest.mark.parametrize(
        ("noise_model", "runs"),
        [
            (noise_models[0], few),
            *(pytest.param(noise_model, many, marks=pytest.mark.slow) for noise_model in noise_models),
        ],
    )


@few_and_many(30, 250)
def test_intervals_cover_the_truth_in_93_to_97_of_100_where_the_structure_is_given(noise_model, runs):
    # 250 runs of 7 terms: 1750 intervals, a standard error of 0.5 % if 95 % is right; 93 and 97 lie four away.
    # Of the 210 intervals of 30 runs 89.0 to 100 % lie within four standard errors.
    flights = [cases.recovery_case(noise_model, seed, n=2000) for seed in range(5)]
    error, said, textbook = [], [], []
    for k in range(runs):
        case = flights[k % 5].redraw(1000 + k)
        found = run(case, case.exponents[list(case.true)], include=range(7))
        assert_array_equal(found.search.selected, range(7))
        error.append(found.values[1:] - case.theta)
        said.append(np.sqrt(np.diag(found.covariance))[1:])
        textbook.append(np.sqrt(np.diag(found.white_noise_covariance))[1:])
    t = stats.t.ppf(0.975, 2000 - 8)
    inside = np.abs(error) < t * np.array(said)
    assert abs(inside.mean() - 0.95) <= (0.02 if runs >= 250 else 4.0 * np.sqrt(0.95 * 0.05 / inside.size))
    # The textbook's intervals for white residuals cover far less, which is why they are not the ones printed.
    assert (np.abs(error) < t * np.array(textbook)).mean() < 0.8
    # The estimates are unbiased: the mean of all runs lies within 3.5 standard errors in 995 of 1000 for all seven.
    assert np.abs(np.mean(np.array(error) / said, axis=0)).max() < 3.5 / np.sqrt(runs)


@few_and_many(10, 80)
def test_intervals_after_selection_cover_the_truth_in_at_least_90_of_100(noise_model, runs):
    # 34 candidates, seven true; a term kept that is not there has zero for its truth. About 560 intervals in 80
    # runs: were 95 % right, 90 % would be five standard errors away; in 10 runs, two.
    flights = [cases.recovery_case(noise_model, seed, n=2000, n_signals=4) for seed in range(5)]
    assert len(flights[0].exponents) == 34
    inside, exact = [], 0
    for k in range(runs):
        case = flights[k % 5].redraw(2000 + k)
        found = run(case, case.exponents, bootstrap=100)
        truth = dict(zip(case.true, case.theta))
        error = found.values[1:] - [truth.get(j, 0.0) for j in found.search.selected]
        said = np.fmax(np.sqrt(np.diag(found.covariance)), found.bootstrap.std)[1:]
        inside += list(np.abs(error) < stats.t.ppf(0.975, found.n - len(found.values)) * said)
        exact += set(found.search.selected) == set(case.true)
    assert len(inside) > 6 * runs
    assert np.mean(inside) >= 0.90
    assert exact >= 0.8 * runs


# --- structure -------------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=[1, pytest.param(4, marks=pytest.mark.slow)], ids="{} of each".format)
def recoveries(request):
    """Flights with each of six noise models: seven true terms among 164, and the terms selected."""
    seeds = range(request.param)
    every = [cases.recovery_case(name, seed, n=8000) for name in cases.NOISE_MODELS for seed in seeds]
    return [(case, run(case, case.exponents)) for case in every]


def test_the_exact_structure_comes_back_from_164_candidates_in_at_least_8_of_10(recoveries):
    scores = np.array([cases.score(case, found.search.selected) for case, found in recoveries])
    exact, missed, false = scores.sum(axis=0)
    assert exact >= 20 / 24 * len(recoveries)
    assert missed <= len(recoveries) / 6
    assert false <= len(recoveries) / 6


def test_the_model_chosen_never_has_a_worse_bic_than_the_truth(recoveries):
    # In the whitened metric the search believed in; a worse one would mean that it did not look well enough.
    for case, found in recoveries:
        ar = found.noise[0].ar
        chosen, truth = (whitened_bic(case, terms, ar) for terms in (found.search.selected, case.true))
        assert chosen <= truth + 1e-6


def whitened_bic(case, terms, ar):
    """n log(rss / n) + k log n of a least-squares fit after the filter, its first samples left out."""
    (base, responses), L = case.manoeuvres[0], len(ar)
    X = cases.design_matrix(base, case.exponents[list(terms)])
    Z = np.column_stack([np.ones(len(X)), X, responses[0]])
    Z = Z[L:] - sum((a * Z[L - l : len(Z) - l] for l, a in enumerate(ar, 1)), np.zeros_like(Z[L:]))
    rss = np.linalg.lstsq(Z[:, :-1], Z[:, -1], rcond=None)[1][0]
    return len(Z) * np.log(rss / len(Z)) + (1 + len(terms)) * np.log(len(Z))


def test_the_automatic_threshold_lets_a_false_term_in_about_once_in_twenty_flights():
    # Responses of coloured noise alone, 14 candidates, 120 flights: at a probability of 5 %, 14 or more would have
    # a term with odds of 1 in 300. The white rule with the same threshold fails in nearly all.
    exponents = monomial_exponents(4, 2)
    false = {"ar": 0, "white": 0}
    for seed in range(120):
        residual = cases.residual("ar1_0.92", 1500, np.random.default_rng([seed, 3]))
        one = [ArrayData(cases.flight_signals(1500, seed, 4), residual[None])]
        for noise in false if seed < 40 else ("ar",):
            asked = SelectOptions(F_in="auto", noise=noise, bootstrap=0, workers=1)
            false[noise] += len(select_arrays(one, exponents, asked)[0].search.selected) > 0
    assert false["ar"] < 14
    assert false["white"] > 35  # of 40
