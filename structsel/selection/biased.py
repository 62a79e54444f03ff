"""Biased estimates of collinear terms: principal components and ridge."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from structsel.errors import SelectionError
from structsel.numerics import biased_estimation
from structsel.numerics.arrays import Array
from structsel.selection.search import Fold, centred
from structsel.selection.settings import SelectOptions


def estimate_biased(
    product: Array,
    samples: float,
    kept: Sequence[int],
    scale: Array,
    options: SelectOptions,
    folds: Sequence[Fold],
) -> tuple[Array, Array, str]:
    """Principal-components or ridge estimate of the constant and the kept terms.

    Parameters
    ----------
    product : (p + 2, p + 2) array
        Products of scaled [1, candidates, response].
    scale : (p + 2,) array
    folds : sequence of Fold
        For choosing the number of components, or ridge's k, by cross-validation.

    Returns
    -------
    values : (1 + k,) array
        Physical units.
    covariance : (1 + k, 1 + k) array
        About the estimate's own mean; the bias is not in it.
    label : str
        What was done; empty where all components were kept, which is least squares.

    Raises
    ------
    SelectionError
        Cross-validation was to choose, and there is nothing to leave out.
    """
    if options.components == "cv" and not folds:
        raise SelectionError(
            "select: components='cv' needs parts to hold out; there is only one block of samples. "
            "Give more recordings, or choose components='PSE'."
        )
    rows = [*kept, product.shape[0] - 2]
    C = centred(product)[np.ix_(rows, rows)]
    dof = samples - 1.0
    train, test = ([centred(f[i])[np.ix_(rows, rows)] for f in folds] for i in (0, 1))
    if options.estimate == "ridge":
        k = (
            biased_estimation.ridge_by_folds(train, test)
            if options.components == "cv"
            else biased_estimation.ridge_by_gcv(C, dof)
        )
        result = biased_estimation.ridge(C, dof, k)
    else:
        if isinstance(options.components, int):
            number = min(options.components, len(kept))
        elif options.components == "variance":
            number = biased_estimation.components_by_variance(C)
        elif options.components == "PSE":
            number = biased_estimation.components_by_pse(C, dof)
        else:
            number = biased_estimation.components_by_folds(train, test)[0]
        result = biased_estimation.principal_components(C, dof, number)
    means = product[0, [j + 1 for j in kept]] / product[0, 0]
    constant = product[0, -1] / product[0, 0] - means @ result.theta
    s2 = result.rss / max(dof - result.effective_terms, 1.0)
    cross = -result.covariance @ means
    covariance = np.block(
        [
            [np.array([[means @ result.covariance @ means + s2 / product[0, 0]]]), cross[None, :]],
            [cross[:, None], result.covariance],
        ]
    )
    back = scale[-1] / scale[[0, *(j + 1 for j in kept)]]
    return (
        np.append(constant, result.theta) * back,
        covariance * np.outer(back, back),
        result.method if result.biased else "",
    )
