"""Criteria for the size of a model, entry thresholds for a number of candidates, and argument checks of the searches.

In every criterion ``n`` is the number of samples (or the effective number), ``rss`` the residual sum of squares
[response^2], ``tss`` the sum of squares of the response about its mean, and ``k`` the number of terms *without the
constant*: the constant is always in the model and is counted inside, as k + 1 coefficients. rss and k may be (m,)
arrays, for a complete path at once; the criterion is then an (m,) array.

In every threshold ``p`` is the number of candidates and ``dof`` that of the degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from structsel.errors import SelectionError
from structsel.numerics.arrays import Array


def pse(rss: ArrayLike, tss: float, n: float, k: ArrayLike, sigma_max2: float | None = None) -> NDArray[np.float64]:
    """Predicted squared error, rss / n + sigma_max2 (k + 1) / n.

    Parameters
    ----------
    sigma_max2 : float [response^2], optional
        Upper bound of the squared prediction error; default tss / n, the variance of the response, as
        in [H17]. With it a term stays if it explains more than 1 / n of tss: a partial F near
        1 / (1 - R^2), which is loose when R^2 is low and strict when it is high.

    References
    ----------
    [H17], [M95], [KM16]
    """
    bound = tss / n if sigma_max2 is None else sigma_max2
    return np.asarray(rss, dtype=float) / n + bound * (np.asarray(k, dtype=float) + 1.0) / n


def bic(rss: ArrayLike, n: float, k: ArrayLike) -> NDArray[np.float64]:
    """Bayesian information criterion, n log(rss / n) + (k + 1) log n.

    Defined up to a constant of the data, so only differences are meaningful. -inf for a perfect fit.
    """
    with np.errstate(divide="ignore"):
        return n * np.log(np.asarray(rss, dtype=float) / n) + (np.asarray(k, dtype=float) + 1.0) * np.log(n)


def ebic(rss: ArrayLike, n: float, k: ArrayLike, p: int) -> NDArray[np.float64]:
    """Extended BIC, n log(rss / n) + (k + 1) log n + k log p: with a price for the number of candidates.

    BIC takes every model of the pool as equally probable, and so most of its probability is on large models: with 164
    candidates and 20,000 samples it admits one false term in three selections. The extended criterion (gamma = 1/2)
    takes every size as equally probable to a degree.

    References
    ----------
    [CC08]
    """
    return bic(rss, n, k) + np.asarray(k, dtype=float) * np.log(p)


def aicc(rss: ArrayLike, n: float, k: ArrayLike) -> NDArray[np.float64]:
    """Akaike's criterion with the small-sample correction.

    With K = k + 2 parameters (terms, constant and the residual variance)::

        AICc = n log(rss / n) + 2 K + 2 K (K + 1) / (n - K - 1)

    inf where n - K - 1 is not above zero; else -inf for a perfect fit.
    """
    K = np.asarray(k, dtype=float) + 2.0
    room = n - K - 1.0
    with np.errstate(divide="ignore"):
        value = n * np.log(np.asarray(rss, dtype=float) / n) + 2.0 * K
    correction = 2.0 * K * (K + 1.0) / np.where(room > 0.0, room, 1.0)
    return np.where(room > 0.0, value + correction, np.inf)[()]


def adjusted_r2(rss: ArrayLike, tss: float, n: float, k: ArrayLike) -> NDArray[np.float64]:
    """R^2 with both variances unbiased, 1 - (rss / (n - k - 1)) / (tss / (n - 1)); nan without degrees of freedom."""
    room = n - np.asarray(k, dtype=float) - 1.0
    ratio = np.asarray(rss, dtype=float) / np.where(room > 0.0, room, np.nan)
    return 1.0 - ratio * (n - 1.0) / tss


def familywise_F_in(p: int, dof: float, probability: float = 0.05) -> float:
    """F_in at which the best of p false candidates enters with the given probability.

    Each is tested at 1 - (1 - probability)^(1/p) (Sidak; exact for independent candidates, safe for
    correlated ones). The classical 4 and 12 take no account of p: at 494 candidates 12 admits a false term
    about one time in four.

    Raises
    ------
    SelectionError
        p, dof or probability out of range.
    """
    _check(p, dof, probability, "familywise_F_in", "probability")
    # The square of Student's t; scipy.stats.f takes fifty times as long to check its arguments.
    return float(scipy.special.stdtrit(dof, -0.5 * np.expm1(np.log1p(-probability) / p)) ** 2)


def ebic_F_in(p: int, dof: float) -> float:
    """F_in with which stepwise regression lowers the extended BIC, its price of a term in units of partial F.

    A term lowers n log rss + k (log n + log p) if its F exceeds::

        F = (n - 1) (exp((log n + log p) / n) - 1),    n = dof + 1

    References
    ----------
    [CC08]
    """
    _check(p, dof, 0.05, "ebic_F_in", "probability")
    n = dof + 1.0
    return float(dof * np.expm1((np.log(n) + np.log(p)) / n))


def fdr_F_in(p: int, dof: float, q: float = 0.05) -> NDArray[np.float64]:
    """Entry thresholds that control the fraction of false terms among those that enter.

    The k-th entry is tested, two-sided, at q k / (p + 1 - k (1 - q))::

        F_k = F^-1(1 - q k / (p + 1 - k (1 - q)); 1, dof - k)

    Parameters
    ----------
    p, dof
        dof is the number of samples less those swept out for the constant, N - 1.
    q : float [-]
        Fraction of false terms allowed.

    Returns
    -------
    thresholds : (p,) array [-]
        Partial F the first, second, ... term needs, not rising while dof is large; inf where no degree of
        freedom is left.

    Raises
    ------
    SelectionError
        p, dof or q out of range.

    References
    ----------
    [BG09]
    """
    _check(p, dof, q, "fdr_F_in", "q")
    k = np.arange(1.0, p + 1.0)
    room = dof - k
    level = q * k / (p + 1.0 - k * (1.0 - q))
    return np.where(room > 0.0, scipy.stats.f.isf(level, 1, np.where(room > 0.0, room, 1.0)), np.inf)


def _check(p: int, dof: float, probability: float, who: str, name: str) -> None:
    if p < 1 or not dof > 0.0 or not 0.0 < probability < 1.0:
        raise SelectionError(
            f"{who} needs at least one candidate, dof above zero and {name} between 0 and 1; found p = {p}, "
            f"dof = {dof:g}, {name} = {probability:g}. 0.05 is the usual {name}."
        )


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
    # One sum of squares detects every NaN and infinity; their place is needed for the message only.
    if not np.isfinite(np.vdot(C, C)) and not np.isfinite(C).all():
        # One NaN makes all products of its column NaN; the diagonal shows which column it is.
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
    numbers = list(dict.fromkeys(int(v) for v in values))
    if numbers and not 0 <= min(numbers) <= max(numbers) < p:
        bad = [v for v in numbers if not 0 <= v < p]
        raise SelectionError(
            f"{who} needs {what} to be candidate numbers from 0 to {p - 1}; found {bad}. Number the "
            "candidates as the columns of C."
        )
    return np.array(numbers, dtype=np.int64)


def check_size(include: NDArray[np.int64], initial: NDArray[np.int64], dof: float, max_terms: int, who: str) -> None:
    """Raise `SelectionError` where the terms a search starts from are more than the samples or max_terms allow."""
    wanted = len({*include.tolist(), *initial.tolist()})
    if wanted >= dof:
        raise SelectionError(
            f"{who} is to start from {wanted} terms but has {dof:g} degrees of freedom. Start from fewer "
            "terms (initial=() adds them one by one) or use more samples."
        )
    if include.size > max_terms:
        raise SelectionError(
            f"{who} is to include {include.size} terms but max_terms is {max_terms}. Raise max_terms or include fewer."
        )
