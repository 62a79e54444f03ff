"""Checks of the arguments that every search on cross-products takes: products, candidate numbers, sizes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from structsel.errors import SelectionError
from structsel.numerics.arrays import Array


def check_products(C: ArrayLike, dof: float, who: str) -> Array:
    """Return C (p+1, p+1) as the kernels need it: C-contiguous float64, writeable; `who` is named in the messages.

    Raises
    ------
    SelectionError
        C is not square or not finite, dof is not above 1, or the response is constant.
    """
    C = np.require(C, np.float64, ["C", "A", "W"])
    if C.ndim != 2 or C.shape[0] != C.shape[1] or C.shape[0] < 2:
        raise SelectionError(
            f"{who} needs square cross-products of at least one candidate and the response; found shape "
            f"{C.shape}. Pass the centred Z'Z of [candidates, response]."
        )
    # One sum sees every NaN and infinity; the exact place is looked for only to report it.
    if not np.isfinite(C.sum()) and not np.isfinite(C).all():
        # A bad column spoils its product with every other, but on the diagonal only its own.
        wrong = ~np.isfinite(np.diag(C))
        bad = int(np.argmax(wrong if wrong.any() else ~np.isfinite(C).all(axis=0)))
        what = "the response" if bad == C.shape[0] - 1 else f"candidate {bad}"
        raise SelectionError(
            f"{who} needs finite cross-products; {what} has NaN or infinite ones. Remove the samples that "
            "are not finite before accumulating."
        )
    if not dof > 1.0:
        raise SelectionError(
            f"{who} needs more than one degree of freedom besides the constant; found {dof:g}. Use a longer recording."
        )
    if not C[-1, -1] > 0.0:
        raise SelectionError(
            f"{who} needs a response that varies; the sum of squares about its mean is {C[-1, -1]:g}. "
            "Choose another response: the constant alone describes this one."
        )
    return C


def candidate_numbers(values: Sequence[int], p: int, who: str, what: str) -> NDArray[np.int64]:
    """Columns of C without repetition, or a `SelectionError` that states the wrong ones."""
    array = np.asarray(list(dict.fromkeys(int(v) for v in values)), dtype=np.int64)
    if array.size and (array.min() < 0 or array.max() >= p):
        bad = [int(v) for v in array if not 0 <= v < p]
        raise SelectionError(
            f"{who} needs {what} to be candidate numbers from 0 to {p - 1}; found {bad}. Number the "
            "candidates as the columns of C."
        )
    return array


def check_size(include: NDArray[np.int64], initial: NDArray[np.int64], dof: float, max_terms: int, who: str) -> None:
    """Raise `SelectionError` where the terms a search starts from are more than the samples or max_terms allow."""
    wanted = np.union1d(include, initial).size
    if wanted >= dof:
        raise SelectionError(
            f"{who} is to start from {wanted} terms but has {dof:g} degrees of freedom. Start from fewer "
            "terms (initial=() adds them one by one) or use more samples."
        )
    if include.size > max_terms:
        raise SelectionError(
            f"{who} is to include {include.size} terms but max_terms is {max_terms}. Raise max_terms or include fewer."
        )
