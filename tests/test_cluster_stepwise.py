import numpy as np
import pytest
import statsmodels.api as sm
from numpy.testing import assert_allclose
from scipy import stats

from structsel.numerics.cluster_stepwise import cluster_F_threshold, cluster_stepwise, samples_per_independent_sample
from structsel.numerics.cross_products import cross_products
from structsel.numerics.regressors import ArrayData
from structsel.selection import SelectOptions, prewhitening, select_arrays

from .pools import ar1, design, monomial_exponents


def one_flight(rng, n=4000, rho=0.95, s=3, degree=2):
    base = np.vstack([ar1(rng, n, 0.98) for _ in range(s)])
    exponents = monomial_exponents(s, degree)
    X = design(base, exponents)
    y = 1.0 + X[:, 1] - 0.5 * X[:, 2] + 0.05 * X[:, 5] + ar1(rng, n, rho)
    return base, exponents, X, y


def clusters(moments):
    return np.repeat(np.arange(moments.n_blocks), moments.n)


def test_partial_f_of_kept_terms_is_the_cluster_robust_one_of_statsmodels():
    base, exponents, X, y = one_flight(np.random.default_rng(1))
    moments = cross_products([ArrayData(base, y[None])], exponents, blocks=20)
    path = cluster_stepwise(moments, None, 3999.0, F_in=4.0, F_out=0.0, include=(0, 1), max_terms=2)
    model = sm.OLS(y, X[:, [0, 1, 2]]).fit(
        cov_type="cluster", cov_kwds={"groups": clusters(moments), "use_correction": False}
    )
    last = path.steps[-1]
    count = moments.n_blocks
    # The step tells F of the entering term beside those already in, shrunk for the terms before it.
    assert_allclose(last.F, model.tvalues[2] ** 2 * (count - 2) / count, rtol=1e-8)
    assert_allclose(last.rss * moments.scale[-1] ** 2, model.ssr, rtol=1e-9)


def test_weight_zero_is_the_same_as_leaving_a_block_out():
    base, exponents, _, y = one_flight(np.random.default_rng(2))
    moments = cross_products([ArrayData(base, y[None])], exponents, blocks=20)
    weights = np.ones(20)
    weights[10:] = 0.0
    half = cross_products([ArrayData(base[:, :2000], y[None, :2000])], exponents, blocks=10)
    a = cluster_stepwise(moments, weights, 1999.0)
    b = cluster_stepwise(half, None, 1999.0)
    assert a.selected == b.selected
    assert_allclose(a.rss * moments.scale[-1] ** 2, b.rss * half.scale[-1] ** 2, rtol=1e-8)


def test_thresholds_are_equally_improbable():
    F = cluster_F_threshold(12.0, 5000.0, 20)
    assert_allclose(stats.f.sf(F, 1, 19), stats.f.sf(12.0, 1, 5000), rtol=1e-9)
    assert F > 12.0


def test_few_false_terms_enter_under_strongly_coloured_noise():
    # 50 draws, nine candidates, none of them true beyond the forced one; samples taken as independent keep most.
    robust = white = 0
    for seed in range(50):
        rng = np.random.default_rng(seed)
        base, exponents, X, _ = one_flight(rng, n=3000)
        y = X[:, 1] + ar1(rng, 3000, 0.98)
        flight = [ArrayData(base, y[None])]
        moments = cross_products(flight, exponents, blocks=30)
        robust += len(cluster_stepwise(moments, None, 2999.0, F_in=12.0, F_out=12.0, include=(0,)).selected) - 1
        plain = select_arrays(
            flight, exponents, SelectOptions(noise="white", F_in=12.0, parsimony="none", bootstrap=0), include=(0,)
        )
        white += len(plain[0].search.selected) - 1
    assert robust <= 25
    assert white >= 150


def test_the_correlation_length_grows_with_the_residual_autocorrelation():
    values = []
    for rho in (0.0, 0.95):
        base, exponents, _, y = one_flight(np.random.default_rng(3), n=20_000, rho=rho)
        moments = cross_products([ArrayData(base, y[None])], exponents, blocks=40)
        values.append(samples_per_independent_sample(moments, None, (0, 1, 4), 19_999.0))
    assert values[0] < 4.0
    assert values[1] > 8.0


def delayed_flight(rng, delay):
    """A response to signals that the recording has ``delay`` samples late, nearly noise-free."""
    n = 3000
    smooth = np.hanning(25) / np.hanning(25).sum()
    pulses = np.repeat(rng.choice([-1.0, 0.0, 1.0], size=(3, n // 40)), 40, axis=1)
    signals = np.array([np.convolve(p, smooth, mode="same") for p in pulses])
    y = 2.0 * signals[0] - signals[1] + 0.005 * rng.standard_normal(n)
    return ArrayData(np.roll(signals, delay, axis=1)[:, 50:], y[None, 50:])


@pytest.mark.parametrize("delay", [0, 6])
def test_whitening_is_dropped_where_a_delayed_channel_leaves_misfit_and_only_there(delay):
    rng = np.random.default_rng(4)
    flights = [delayed_flight(rng, delay) for _ in range(4)]
    (outcome,) = select_arrays(flights, monomial_exponents(3, 2), SelectOptions(F_in="auto", bootstrap=0))
    assert set(outcome.search.selected) >= {0, 1}
    assert outcome.r2 > 0.8
    if delay == 0:
        assert not outcome.cluster_robust
        assert outcome.prewhitening_dropped is None


@pytest.mark.parametrize("read_noise", [0.0, 0.05])
def test_whitening_is_dropped_where_estimates_differ_by_more_than_noise_would_cause(monkeypatch, read_noise):
    # Noise in the signals shrinks the prewhitened estimates; a drift of the response alone leaves both without bias.
    monkeypatch.setattr(prewhitening, "_predicts_worse", lambda *_: False)
    dropped = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        flights = []
        for _ in range(3):
            signals = delayed_flight(rng, 0).base_signals
            y = np.array([2.0, -1.0, 0.5]) @ signals + 0.05 * ar1(rng, signals.shape[1], 0.99)
            noise = read_noise * signals.std(axis=1)[:, None] * rng.standard_normal(signals.shape)
            flights.append(ArrayData(signals + noise, y[None]))
        (outcome,) = select_arrays(flights, monomial_exponents(3, 1), SelectOptions(F_in="auto", bootstrap=0))
        dropped += outcome.prewhitening_dropped is not None
    assert dropped == (20 if read_noise else 0)
