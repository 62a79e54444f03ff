"""The residual where an effect acts, against the heteroscedasticity-consistent variance of statsmodels."""

import numpy as np
import pytest
import statsmodels.api as sm

from structsel.diagnosis.dispersion import NOISE_ALONE, Dispersion


def _noisy_where_it_acts(factor: float, n: int = 4000) -> tuple[np.ndarray, np.ndarray]:
    """A column that acts in one tenth of the rows, and rows of noise that is larger there."""
    random = np.random.default_rng(5)
    x = np.where(np.arange(n) < n // 10, random.standard_normal(n), 0.0)
    return x, 0.3 * x + random.standard_normal(n) * np.where(x != 0.0, factor, 1.0)


def _dispersion(x: np.ndarray, y: np.ndarray) -> Dispersion:
    return Dispersion.between(y, y - x * (x @ y) / (x @ x))


@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_ratio_is_that_of_the_robust_variance(factor):
    x, y = _noisy_where_it_acts(factor)
    robust = sm.OLS(y, x).fit(cov_type="HC0").cov_params()[0, 0]
    found = _dispersion(x, y)
    assert found.ratio == pytest.approx(robust * (x @ x), rel=1e-9)
    assert found.ratio == pytest.approx(factor**2, rel=0.15)


def test_power_is_twice_the_log_likelihood_ratio():
    x, y = _noisy_where_it_acts(1.0)
    left = y - x * (x @ y) / (x @ x)
    assert _dispersion(x, y).power == pytest.approx(y @ y - left @ left, rel=1e-9)


def test_evidence_of_the_fit_is_divided_by_the_ratio():
    x, y = _noisy_where_it_acts(3.0)
    found = _dispersion(x, y)
    assert found.reduced(0.5 * found.power) == pytest.approx(0.5 * found.power / found.ratio)


def test_what_relieves_tolerances_is_kept():
    found = Dispersion(ratio=4.0, power=8.0)
    assert found.reduced(100.0) == pytest.approx(100.0 - 0.5 * 0.75 * 8.0)
    assert found.reduced(2.0) == pytest.approx(0.5)


@pytest.mark.parametrize("found", [NOISE_ALONE, Dispersion(0.5, 40.0), Dispersion.between(np.ones(9), np.ones(9))])
def test_a_residual_below_the_noise_adds_no_evidence(found):
    assert found.reduced(30.0) == 30.0


def test_evidence_against_an_effect_stays():
    assert Dispersion(9.0, 40.0).reduced(-3.0) == -3.0
