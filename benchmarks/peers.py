"""Other packages' structure selection behind one signature, at settings that favour them.

Every peer gets the candidates as a matrix ``X`` (n, p) whose columns have mean zero and unit variance, and the
response less its mean: scaling and the constant, which several would not handle, are removed beforehand,
outside their time. They answer with the indices of the columns they keep. Where a package grows a path of models
and leaves its length to the user, the path goes to 20 terms (the truth holds 7) and BIC picks from it. A peer
that needs the number of terms is given the true one.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from cases import design_matrix
from numpy.typing import NDArray
from scipy import linalg

from structsel.numerics.arrays import Array

Chosen = NDArray[np.intp]
LONGEST = 20
_WARM: set[str] = set()


@dataclass(frozen=True)
class Peer:
    """One package's selector.

    Attributes
    ----------
    name : str
        As printed in the tables.
    package : str
        Distribution name, for its version.
    module : str
        What must import for the peer to run.
    needs_count : bool
        Whether it is given the true number of terms.
    run : callable
        ``run(X, y, true_count)``, columns standardised.
    settings : str
        What was set, for the report.
    copies : float
        Roughly how many copies of X it holds at its peak, to skip it where memory would not do.
    """

    name: str
    package: str
    module: str
    needs_count: bool
    run: Callable[[Array, Array, int], Sequence[int] | Chosen]
    settings: str
    copies: float = 2.0

    def absent(self) -> str:
        """Empty when the peer can run, otherwise why not."""
        try:
            importlib.import_module(self.module)
        except ImportError as error:
            return f"not installed ({error})"
        return ""

    def warm_up(self) -> None:
        """Import and compile what the first call would, on a small problem, once per process."""
        if self.name not in _WARM:
            rng = np.random.default_rng(0)
            X = np.asfortranarray(rng.standard_normal((400, 2 * LONGEST)))
            self.fit(X, X[:, :3].sum(axis=1) + rng.standard_normal(400), true_count=3)
            _WARM.add(self.name)

    def version(self) -> str:
        return importlib.metadata.version(self.package)

    def fit(self, X: Array, y: Array, true_count: int | None = None) -> Chosen:
        """Indices of the columns kept, ascending.

        Parameters
        ----------
        X : (n, p) array
            Columns of mean zero and unit variance (`standardise`).
        y : (n,) array
            Of mean zero.
        true_count : int, optional
            True number of terms; only a peer with `needs_count` uses it.
        """
        if self.needs_count and true_count is None:
            raise ValueError(f"{self.name} needs true_count, the true number of terms.")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            chosen = self.run(X, y, true_count or 0)
        return np.unique(np.asarray(chosen, dtype=np.intp))


def candidate_matrix(base: Array, exponents: NDArray[np.integer]) -> Array:
    """(n, p) matrix of the candidates, column by column in memory: the order most peers are fastest in."""
    X = np.empty((base.shape[1], len(exponents)), order="F")
    for start in range(0, len(X), 4096):
        chunk = slice(start, start + 4096)
        X[chunk] = design_matrix(base[:, chunk], exponents)
    return X


def standardise(X: Array, y: Array) -> tuple[Array, Array]:
    """Columns of mean zero and unit variance, in place; the response less its mean."""
    for j in range(X.shape[1]):
        X[:, j] -= X[:, j].mean()
        X[:, j] /= np.sqrt(X[:, j] @ X[:, j] / len(X))
    return X, y - y.mean()


def bic_along(X: Array, y: Array, path: Sequence[int]) -> Array:
    """BIC of the models with 0, 1, 2 ... first columns of a path: ``n log(rss / n) + k log n``."""
    n = y.size
    rss = [float(y @ y)]
    if len(path):
        Q, _ = linalg.qr(X[:, list(path)], mode="economic")
        rss += list(rss[0] - np.cumsum((Q.T @ y) ** 2))
    k = np.arange(len(rss))
    return n * np.log(np.maximum(rss, 1e-300) / n) + k * np.log(n)


def _omp_stated(X: Array, y: Array, count: int) -> Chosen:
    from sklearn.linear_model import OrthogonalMatchingPursuit

    model = OrthogonalMatchingPursuit(n_nonzero_coefs=count, fit_intercept=False).fit(X, y)
    return np.flatnonzero(model.coef_)


def _omp_cv(X: Array, y: Array, _: int) -> Chosen:
    from sklearn.linear_model import OrthogonalMatchingPursuitCV

    model = OrthogonalMatchingPursuitCV(max_iter=LONGEST, fit_intercept=False, cv=5).fit(X, y)
    return np.flatnonzero(model.coef_)


def _lasso_lars_bic(X: Array, y: Array, _: int) -> Chosen:
    from sklearn.linear_model import LassoLarsIC

    return np.flatnonzero(LassoLarsIC(criterion="bic", fit_intercept=False).fit(X, y).coef_)


def _sysidentpy(name: str, **settings: object) -> object:
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS, OSF

    kind = {"FROLS": FROLS, "OSF": OSF}[name]
    return kind(xlag=1, ylag=1, model_type="NFIR", basis_function=Polynomial(degree=1), **settings)


def _ahead(y: Array) -> Array:
    return np.concatenate([[0.0], y])[:, None]  # it drops max_lag = 1 sample: rows then match X


def _sysidentpy_frols(X: Array, y: Array, _: int) -> Chosen:
    from sysidentpy.model_structure_selection.ofr_base import get_min_info_value

    model = _sysidentpy("FROLS", order_selection=False, n_terms=LONGEST)
    path = np.asarray(model.error_reduction_ratio(X, _ahead(y), LONGEST)[1])
    return path[: get_min_info_value(bic_along(X, y, path)[1:])]


def _sysidentpy_frols_own(X: Array, y: Array, _: int) -> Chosen:
    from sysidentpy.model_structure_selection.ofr_base import get_min_info_value
    from sysidentpy.parameter_estimation import LeastSquares

    model = _sysidentpy("FROLS", info_criteria="bic", n_info_values=LONGEST, estimator=LeastSquares())
    length = get_min_info_value(model.information_criterion(X, _ahead(y)))
    return np.asarray(model.error_reduction_ratio(X, _ahead(y), length)[1])


def _sysidentpy_osf(X: Array, y: Array, count: int) -> Chosen:
    model = _sysidentpy("OSF", order_selection=False, n_terms=count)
    return np.asarray(model.run_mss_algorithm(X, _ahead(y), count)[1])


def _pysindy_frols(X: Array, y: Array, _: int) -> Chosen:
    from pysindy.optimizers import FROLS

    model = FROLS(max_iter=LONGEST, alpha=1e-12, unbias=False).fit(X, y / y.std())
    path: list[int] = []
    for coefficients in model.history_[1:]:  # history_[k] holds the model of k terms
        path += [j for j in np.flatnonzero(coefficients[0]) if j not in path]
    return np.asarray(path[: int(np.argmin(bic_along(X, y, path)))], dtype=np.intp)


def _pysindy_stlsq(X: Array, y: Array, _: int) -> Chosen:
    from pysindy.optimizers import STLSQ

    best, chosen = np.inf, np.empty(0, np.intp)
    for threshold in np.geomspace(0.003, 0.3, 15):  # of the response's standard deviation
        model = STLSQ(threshold=threshold, alpha=1e-9, unbias=False).fit(X, y / y.std())
        kept = np.flatnonzero(model.coef_[0])
        bic = bic_along(X, y, kept)[-1]
        if bic < best:
            best, chosen = bic, kept
    return chosen


def _abess(X: Array, y: Array, _: int) -> Chosen:
    from abess.linear import LinearRegression

    model = LinearRegression(
        support_size=range(LONGEST + 1), ic_type="ebic", fit_intercept=False, thread=1, covariance_update=True
    )  # its faster way where n >> p
    return np.flatnonzero(model.fit(X, y).coef_)


def _statsmodels_loop(X: Array, y: Array, _: int) -> Chosen:
    from statsmodels.regression.linear_model import OLS

    kept: list[int] = []
    while len(kept) < LONGEST:
        tried = [j for j in range(X.shape[1]) if j not in kept]
        t = [OLS(y, X[:, [*kept, j]]).fit(method="qr").tvalues[-1] for j in tried]
        best = int(np.argmax(np.abs(t)))
        if t[best] ** 2 < 12.0:
            break
        kept.append(tried[best])
    return np.asarray(kept, dtype=np.intp)


PEERS: tuple[Peer, ...] = (
    Peer("scikit-learn OMP, true count", "scikit-learn", "sklearn", True, _omp_stated, "given the count"),
    Peer("scikit-learn OMP, CV", "scikit-learn", "sklearn", False, _omp_cv, "5 folds of samples, up to 20 terms", 3.0),
    Peer("scikit-learn LassoLarsIC", "scikit-learn", "sklearn", False, _lasso_lars_bic, "BIC", 3.0),
    Peer("SysIdentPy FROLS", "sysidentpy", "sysidentpy", False, _sysidentpy_frols,
         "ERR to 20 terms in one run, length by its own rule on BIC (first rise)", 4.0),
    Peer("SysIdentPy FROLS, as called", "sysidentpy", "sysidentpy", False, _sysidentpy_frols_own,
         "order_selection: a run for each of 20 lengths; same answer as above", 4.0),
    Peer("SysIdentPy OSF, true count", "sysidentpy", "sysidentpy", True, _sysidentpy_osf,
         "orthogonal floating search, n_terms = true count", 3.0),
    Peer("PySINDy FROLS", "pysindy", "pysindy", False, _pysindy_frols,
         "no ridge, 20 terms, best BIC along its history", 6.0),
    Peer("PySINDy STLSQ", "pysindy", "pysindy", False, _pysindy_stlsq,
         "15 thresholds from 0.003 to 0.3 standard deviations, best BIC", 4.0),
    Peer("statsmodels, a forward loop", "statsmodels", "statsmodels", False, _statsmodels_loop,
         "OLS by QR of every candidate at every step, F to enter 12, none leaves", 2.0),
    Peer("abess", "abess", "abess", False, _abess, "support_size 0 to 20, ebic (its default), covariance_update", 4.0),
)  # fmt: skip


def peers_named(names: str) -> tuple[Peer, ...]:
    """Peers whose name contains one of the semicolon-separated words; "all" and "none" mean that."""
    if names == "none":
        return ()
    words = [word.strip().lower() for word in names.split(";")]
    return tuple(peer for peer in PEERS if names == "all" or any(word in peer.name.lower() for word in words))
