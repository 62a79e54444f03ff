"""Small pools and signals of the tests of selection."""

from itertools import combinations_with_replacement

import numpy as np


def monomial_exponents(n_base, degree):
    rows = []
    for k in range(1, degree + 1):
        for word in combinations_with_replacement(range(n_base), k):
            rows.append(np.bincount(word, minlength=n_base))
    return np.array(rows)


def design(base, exponents):
    """(n, 1 + p): the regressor matrix the engine never forms."""
    columns = [np.prod(base.T**e, axis=1) for e in exponents]
    return np.column_stack([np.ones(base.shape[1]), *columns])


def ar1(rng, n, rho, sigma=1.0):
    from scipy.signal import lfilter

    return lfilter([1.0], [1.0, -rho], sigma * rng.standard_normal(n + 500))[500:]
