"""Near copies of a candidate against a search by QR."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.numerics.regressors import ArrayData
from structsel.selection.engine import select_arrays
from structsel.selection.settings import SelectOptions

from .benchmark_modules import load_benchmark
from .flights import cases
from .pools import design

qr_stepwise = load_benchmark("qr_search").qr_stepwise


def near_copy(own_motion, seed, n=5000):
    """A flight whose ninth signal is the elevator except for a small motion of its own; both are in the model."""
    rng = np.random.default_rng([seed, 9])
    base = cases.flight_signals(n, seed)
    own = rng.standard_normal(n)
    base = np.vstack([base, base[5] + own_motion * base[5].std() * own])
    exponents = np.vstack([np.eye(9, dtype=int), 2 * np.eye(9, dtype=int)[:5]])
    unit = [row / row.std() for row in base[[0, 3, 5]]]
    signal = sum(unit) + (base[1] / base[1].std()) ** 2
    noise = 0.2 * signal.std()
    y = signal + noise * (rng.standard_normal(n) + 60.0 / np.sqrt(n) * own)
    return ArrayData(base, y[None]), exponents, (0, 3, 5, 8, 10)


def partial_f_by_qr(X, y):
    Q, R = np.linalg.qr(np.column_stack([np.ones(len(y)), X]))
    rest = y - Q @ (Q.T @ y)
    s2 = rest @ rest / (len(y) - len(R))
    return ((np.linalg.solve(R, Q.T @ y)) ** 2 / (s2 * np.sum(np.linalg.inv(R) ** 2, axis=1)))[1:]


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("own_motion", [1e-1, 1e-2, 1e-3, 1e-4, 4e-5, 1e-5, 1e-6])
def test_near_copies_of_the_elevator_are_selected_as_by_qr_or_refused_and_listed(own_motion, seed):
    # The selected set's condition number runs from 3e1 to 3e6; the copy's Schur complement is about own_motion^2.
    one, exponents, true = near_copy(own_motion, seed)
    options = SelectOptions(noise="white", F_in=12.0, bootstrap=0, workers=1)
    (found,) = select_arrays([one], exponents, options)
    X, y = design(one.base_signals, exponents)[:, 1:], one.response_signals[0]
    kept, refused = qr_stepwise(X, y, 12.0)
    assert set(found.search.selected) == kept
    assert set(found.dependent) == refused
    schur = 1.0 / np.linalg.inv(np.corrcoef(X[:, [5, 0, 3, 10, 8]].T))[-1, -1]
    if schur >= 1e-9:
        assert set(true) <= kept
        F = partial_f_by_qr(X[:, list(found.search.selected)], y)
        last = found.search.steps[-1]
        assert (last.action, last.index) == ("enter", found.search.selected[-1])
        # Products know the Schur complement to some 1e-15, so the search's F to 1e-15 / schur; the refit to 1e-8.
        assert_allclose(last.F, F[-1], rtol=1e-6 if schur >= 5e-9 else 1e-5)
        assert_allclose(found.fit.partial_F[1:], F, rtol=1e-8)
    else:
        assert len({5, 8} & kept) == 1
        assert {5, 8} - kept <= set(found.dependent)
