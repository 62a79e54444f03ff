"""Jobs of benchmarks/selection.py: timed in this process, their memory measured in a child process."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from cases import flight_signals, monomials, recovery_case
from methods import CLASSICAL, WHITE_PSE, complete_fit, cross_products_of, search_in, select_all
from numpy.typing import NDArray
from peers import PEERS, Peer, candidate_matrix, standardise
from timing import MEBI, in_child, one_blas_thread, peak_above_now

from structsel.numerics import polynomial_products, regressors
from structsel.numerics.arrays import Array
from structsel.numerics.regressors import ArrayData
from structsel.selection import SelectOptions

XTX = "X.T @ X"
WHITE = "complete fit, white"
FRESH = "complete fit, white, plans rebuilt"
GENERIC = "complete fit, generic candidates"
CROSS = "cross-products"
CROSS_SIX = "cross-products, six responses"
SIX = "complete fit, six responses"
SELECT_WHITE = "select, white"
SELECT = "select, coloured"
BOOTSTRAP = "select, coloured, 200 bootstrap replicates"
AGAIN = "one more search: other threshold"
FOLD = "one more search: a block left out"
OTHER = "one more search: orthogonal, PSE"
SPLINES = 6
ONCE_MORE = (AGAIN, FOLD, OTHER)


@dataclass(frozen=True)
class Work:
    """Signals and pool of one size.

    Attributes
    ----------
    white, coloured : ArrayData
        One response, white or AR(1) residual.
    six : ArrayData
        Six responses.
    generic : ArrayData
        The same and a spline of each of six signals: too many base signals for sharing products of monomials.
    exponents, generic_exponents : (p, s) int arrays
        Equal numbers of candidates; the splines replace the last six in the generic pool.
    true : int
        Number of true terms.
    """

    white: ArrayData
    coloured: ArrayData
    six: ArrayData
    generic: ArrayData
    exponents: NDArray[np.int64]
    generic_exponents: NDArray[np.int64]
    true: int

    @property
    def n(self) -> int:
        return self.white.n

    @property
    def p(self) -> int:
        return len(self.exponents)


@lru_cache(maxsize=1)
def prepare(n: int, degree: int, seed: int = 1) -> Work:
    """Signals of one flight; the six responses have their own truths."""
    case = recovery_case("white", seed, n=n, degree=degree, n_responses=6)
    coloured = recovery_case("ar1_0.92", seed, n=n, degree=degree)
    base, responses = case.manoeuvres[0]
    splines = np.maximum(base[:SPLINES] - base[:SPLINES, :20_000].mean(axis=1, keepdims=True), 0.0)
    powers = np.pad(case.exponents, ((0, 0), (0, SPLINES)))
    powers[-SPLINES:] = np.eye(powers.shape[1], dtype=int)[-SPLINES:]
    words = tuple(regressors.words_of(powers))
    if polynomial_products.plan_polynomial_products(words, powers.shape[1], 1) is not None:
        raise RuntimeError("the generic pool is not generic: its products would be shared. Raise SPLINES.")
    return Work(
        white=ArrayData(base, responses[:1]),
        coloured=ArrayData(*coloured.manoeuvres[0]),
        six=ArrayData(base, responses),
        generic=ArrayData(np.vstack([base, splines]), responses[:1]),
        exponents=case.exponents,
        generic_exponents=powers,
        true=len(case.true),
    )


def forget_plans() -> None:
    """Empty the caches of how a pool is computed, so that the next fit makes them again."""
    for value in (*vars(regressors).values(), *vars(polynomial_products).values()):
        if callable(clear := getattr(value, "cache_clear", None)):
            clear()


def jobs(work: Work, X: Array | None) -> dict[str, Callable[[], Any]]:
    """Everything timed at one size; X is the candidates' matrix, absent where it has no room."""
    stored = cross_products_of([work.white], work.exponents)

    def fresh() -> Any:
        forget_plans()
        return complete_fit([work.white], work.exponents)

    functions: dict[str, Callable[[], Any]] = {} if X is None else {XTX: lambda: X.T @ X}
    return {
        **functions,
        CROSS: lambda: cross_products_of([work.white], work.exponents),
        CROSS_SIX: lambda: cross_products_of([work.six], work.exponents),
        WHITE: lambda: complete_fit([work.white], work.exponents),
        SIX: lambda: complete_fit([work.six], work.exponents),
        FRESH: fresh,
        GENERIC: lambda: complete_fit([work.generic], work.generic_exponents),
        SELECT_WHITE: lambda: select_all([work.white], work.exponents, noise="white"),
        SELECT: lambda: select_all([work.coloured], work.exponents),
        BOOTSTRAP: lambda: select_all([work.coloured], work.exponents, bootstrap=200),
        AGAIN: lambda: search_in(stored, work.exponents, options=SelectOptions(noise="white", F_in=4.0)),
        FOLD: lambda: search_in(stored, work.exponents, options=CLASSICAL.settings, without=0),
        OTHER: lambda: search_in(stored, work.exponents, options=WHITE_PSE.settings),
    }


def standardised(work: Work) -> tuple[Array, Array]:
    """What the peers are given."""
    X = candidate_matrix(work.white.base_signals, work.exponents)
    return standardise(X, work.white.response_signals[0])


# ---------------------------------------------------------------- memory, in a child


def matrix_mebibytes(n: int, degree: int) -> float:
    return n * len(monomials(8, degree)) * 8 / MEBI


def peak(n: int, degree: int, what: str) -> float:
    """Peak memory above the signals [MiB] of one job or peer, in a fresh process."""
    work = prepare(n, degree)
    signals = work.coloured if what in (SELECT, BOOTSTRAP) else work.generic if what == GENERIC else work.white
    exponents = work.generic_exponents if what == GENERIC else work.exponents
    with tempfile.TemporaryDirectory() as folder:
        for name, array in (("base", signals.base_signals), ("response", signals.response_signals)):
            np.save(Path(folder) / f"{name}.npy", array)
        np.save(Path(folder) / "exponents.npy", exponents)
        return float(in_child("workloads", "peak_in_child", {"folder": folder, "what": what, "true": work.true}))


def peak_in_child(folder: str, what: str, true: int) -> float:
    """The child's side of `peak`: warm up on a small pool of another shape, load the signals, measure."""
    base, response, exponents = (np.load(Path(folder) / f"{n}.npy") for n in ("base", "response", "exponents"))
    small = flight_signals(3000, 1, 7)
    with one_blas_thread():
        noise = np.random.default_rng(0).standard_normal(3000)
        job(what, small, (small[0] / small[0].std() + noise)[None], monomials(7, 3), 1)()
        return peak_above_now(job(what, base, response, exponents, true))


def job(what: str, base: Array, response: Array, exponents: NDArray[np.int64], true: int) -> Callable[[], Any]:
    signals = [ArrayData(base, response)]
    if what in (WHITE, GENERIC):
        return lambda: complete_fit(signals, exponents)
    if what in (SELECT, BOOTSTRAP):
        return lambda: select_all(signals, exponents, bootstrap=200 if what == BOOTSTRAP else 0)
    if what == XTX:

        def gram() -> Array:
            X = candidate_matrix(base, exponents)
            return X.T @ X

        return gram
    peer = next(p for p in PEERS if p.name == what)
    return lambda: peer.fit(*standardise(candidate_matrix(base, exponents), response[0]), true_count=true)


def room_for(peer: Peer | None, n: int, degree: int, free: float) -> bool:
    """Whether a peer (or X and its product) should fit in memory, with a gigabyte left."""
    copies = 1.0 if peer is None else 1.0 + peer.copies
    return copies * matrix_mebibytes(n, degree) + 1024 < free


# ---------------------------------------------------------------- a busy neighbour


@contextmanager
def busy_neighbour() -> Iterator[None]:
    """One process that keeps one core busy."""
    spin = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    try:
        yield
    finally:
        spin.terminate()
        spin.wait()
