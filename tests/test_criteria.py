"""Criteria against statsmodels, thresholds against their definitions."""

import numpy as np
import pytest
import statsmodels.api as sm
from numpy.testing import assert_allclose
from scipy.stats import f, norm
from statsmodels.tools import eval_measures

from structsel.errors import SelectionError
from structsel.numerics.criteria import adjusted_r2, aicc, bic, familywise_F_in, fdr_F_in, pse
from structsel.numerics.stepwise import stepwise
from tests.test_stepwise import problem, products


def test_criteria_equal_statsmodels():
    X, y, *_ = problem(0)
    n, tss = len(y), float(np.sum((y - y.mean()) ** 2))
    full = sm.OLS(y, sm.add_constant(X)).fit()
    small = sm.OLS(y, sm.add_constant(X[:, :3])).fit()
    assert_allclose(adjusted_r2(full.ssr, tss, n, 12), full.rsquared_adj, rtol=1e-12)
    # statsmodels' BIC keeps the constants of the likelihood, which cancel in differences.
    assert_allclose(bic(full.ssr, n, 12) - bic(small.ssr, n, 3), full.bic - small.bic, rtol=1e-10)
    # eval_measures.aicc takes the log-likelihood and all parameters, the variance among them.
    expected = [eval_measures.aicc(m.llf, n, m.df_model + 2) for m in (full, small)]
    found = aicc([full.ssr, small.ssr], n, [12, 3])
    assert_allclose(found[0] - found[1], expected[0] - expected[1], rtol=1e-10)


def test_pse_is_fit_error_plus_penalty():
    # rss 20 over 10 samples, bound 3, two terms and the constant: 2 + 3 x 3 / 10.
    assert_allclose(pse(20.0, 99.0, 10, 2, 3.0), 2.9, rtol=1e-15)
    assert_allclose(pse([20.0, 10.0], 50.0, 10, [1, 2]), [2.0 + 5.0 * 0.2, 1.0 + 5.0 * 0.3], rtol=1e-15)


def test_limits_are_infinities_not_warnings():
    assert bic(0.0, 10, 1) == -np.inf
    assert aicc(1.0, 5, 3) == np.inf
    assert np.isnan(adjusted_r2(1.0, 2.0, 4, 3))


def test_familywise_F_in_has_the_requested_error_probability():
    for p in (1, 164, 494):
        F = familywise_F_in(p, 1e4, 0.05)
        assert_allclose(1.0 - f.cdf(F, 1, 1e4) ** p, 0.05, rtol=1e-9)
    # A threshold of 12 on independent candidates: 8 % at 164 and 23 % at 494.
    assert_allclose(1.0 - f.cdf(12.0, 1, 1e5) ** 164, 0.08, atol=0.01)
    assert_allclose(1.0 - f.cdf(12.0, 1, 1e5) ** 494, 0.23, atol=0.01)


def test_familywise_F_in_holds_on_noise():
    # 600 noise responses, 60 noise candidates: a false entry in 5 % +- 3 standard errors.
    rng = np.random.default_rng(1)
    F_in = familywise_F_in(60, 298.0, 0.05)
    false = 0
    for _ in range(600):
        C = products(rng.normal(size=(300, 60)), rng.normal(size=300))
        false += bool(stepwise(C, 299.0, F_in=F_in, F_out=F_in).selected)
    assert abs(false / 600 - 0.05) < 3 * np.sqrt(0.05 * 0.95 / 600)


def test_fdr_F_in_follow_the_formula_and_become_normal_quantiles():
    thresholds = fdr_F_in(100, 1e9, 0.1)
    k = np.arange(1, 101)
    level = 0.1 * k / (101 - k * 0.9)
    assert_allclose(thresholds, norm.isf(level / 2) ** 2, rtol=1e-6)
    # The first is Bonferroni's to a hundredth of a step in p; the last is q / (1 + ... ) of one test.
    assert_allclose(f.sf(thresholds[0], 1, 1e9 - 1), 0.1 / 100.1, rtol=1e-7)
    assert (np.diff(thresholds) < 0.0).all()


def test_fdr_entry_keeps_the_fraction_of_false_terms_near_q():
    # 10 true of 100 orthogonal-ish candidates, 200 seeds: mean fraction of false terms at most q plus 3 errors.
    rng = np.random.default_rng(2)
    fractions = []
    for _ in range(200):
        X = rng.normal(size=(500, 100))
        y = X[:, :10] @ np.full(10, 0.4) + rng.normal(size=500)
        path = stepwise(products(X, y), 499.0, entry_thresholds=fdr_F_in(100, 499.0, 0.1))
        kept = np.array(path.selected)
        fractions.append(np.mean(kept >= 10) if kept.size else 0.0)
    assert np.mean(fractions) < 0.1 + 3 * np.std(fractions) / np.sqrt(200)
    assert np.mean(fractions) > 0.03


def test_out_of_range_is_refused():
    assert np.isinf(fdr_F_in(10, 5.0, 0.1)[5:]).all()
    with pytest.raises(SelectionError, match="probability between 0 and 1"):
        familywise_F_in(10, 100.0, 1.5)
    with pytest.raises(SelectionError, match="at least one candidate"):
        fdr_F_in(0, 100.0)
