"""Division of manoeuvres into blocks of samples, and jobs on the blocks in threads or on a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from structsel.errors import SelectionError
from structsel.numerics.arrays import Array
from structsel.numerics.noise_models import ARNoise
from structsel.numerics.regressors import DataSource

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

ROOM = 64 << 20  # bytes of cross-products stored block by block, per response
MIN_BLOCKS, MAX_BLOCKS = 48, 512  # limits of the number of blocks that many manoeuvres are joined into
SHORTEST = 64  # samples of the shortest segment
Progress = Callable[[int, int], None]
"""Called with the number of completed jobs and the total number."""

MULTIPLICATIONS_FOR_TWO = 2e9  # of a pass; above it a second thread saves time


class Segment(NamedTuple):
    """Samples ``start`` to ``stop`` of manoeuvre number ``manoeuvre``."""

    manoeuvre: int
    start: int
    stop: int


Block = tuple[Segment, ...]
"""One segment, or several complete manoeuvres that follow each other."""


@dataclass(frozen=True)
class Samples:
    """A segment with its data, and the noise models of the responses where they are known."""

    source: DataSource
    start: int
    stop: int
    noise: tuple[ARNoise, ...] = ()


def max_blocks(p: int) -> int:
    """Maximum number of blocks whose cross-products of p candidates are stored."""
    return min(max(MIN_BLOCKS, ROOM // (4 * (p + 2) * (p + 3))), MAX_BLOCKS)


def cut_blocks(lengths: Sequence[int], wanted: int, p: int) -> list[Block]:
    """Cut manoeuvres into about ``wanted`` blocks in total, or join them if they are more than `max_blocks`.

    Parameters
    ----------
    lengths : sequence of int
        Samples of each manoeuvre.
    wanted : int
    p : int
        Candidates.
    """
    if len(lengths) <= max_blocks(p):
        return [(segment,) for segment in split_manoeuvres(lengths, wanted)]
    return join_manoeuvres(lengths, max_blocks(p))


def complete_manoeuvres(lengths: Sequence[int]) -> list[Block]:
    """Blocks of complete manoeuvres: one each, or several if there are more than `MAX_BLOCKS`."""
    if len(lengths) <= MAX_BLOCKS:
        return [(Segment(k, 0, n),) for k, n in enumerate(lengths)]
    return join_manoeuvres(lengths, MAX_BLOCKS)


def split_manoeuvres(lengths: Sequence[int], wanted: int) -> list[Segment]:
    """Cut manoeuvres into about ``wanted`` segments in total, at least one each, of at least `SHORTEST` samples."""
    total = sum(lengths)
    segments = []
    for k, n in enumerate(lengths):
        pieces = max(1, min(round(wanted * n / max(total, 1)), n // SHORTEST))
        edges = np.linspace(0, n, pieces + 1).round().astype(int)
        segments += [Segment(k, int(a), int(b)) for a, b in pairwise(edges)]
    return segments


def join_manoeuvres(lengths: Sequence[int], limit: int) -> list[Block]:
    """Join complete manoeuvres into at most ``limit`` blocks with about equal numbers of samples."""
    ends = np.cumsum(lengths)
    middle = ends - np.asarray(lengths) / 2.0
    of = np.minimum((middle / ends[-1] * limit).astype(int), limit - 1)
    groups = [np.flatnonzero(of == g).tolist() for g in np.unique(of)]
    return [tuple(Segment(k, 0, lengths[k]) for k in group) for group in groups]


def first_and_last(blocks: Sequence[Block]) -> NDArray[np.int64]:
    """(2, B) first and last manoeuvre of each block."""
    return np.array([[block[0].manoeuvre, block[-1].manoeuvre] for block in blocks]).T


def count_samples(blocks: Sequence[Block], reach: Sequence[int] | None = None) -> NDArray[np.int64]:
    """(B,) samples of each block, without the first ``reach`` samples of a manoeuvre, which start a filter."""
    return np.array(
        [sum(max(s.stop - max(s.start, reach[s.manoeuvre] if reach else 0), 0) for s in block) for block in blocks]
    )


def attach_data(
    blocks: Sequence[Block], manoeuvres: Sequence[DataSource], noise: Sequence[Sequence[ARNoise]] = ()
) -> list[list[Samples]]:
    """The blocks with their data, and with the noise model of every response in every manoeuvre."""
    return [
        [Samples(manoeuvres[s.manoeuvre], s.start, s.stop, tuple(of[s.manoeuvre] for of in noise)) for s in block]
        for block in blocks
    ]


class PassStore(Protocol):
    """Storage of the results of complete passes, so that an interrupted run can continue."""

    def load(self, size: int) -> Array | None:
        """Result of the next pass, or None if it is not stored."""

    def save(self, result: Array) -> None:
        """Store the result of the pass for which `load` was called last."""


@dataclass(frozen=True)
class JobRunner:
    """Execution of jobs, and storage of the results of passes over the data.

    Attributes
    ----------
    client : distributed.Client, optional
        Of a Dask cluster. Functions and items are sent to its workers; a job whose worker dies is repeated by another.
    store : PassStore, optional
    """

    client: Any = None
    store: PassStore | None = None

    def map(
        self, function: Callable[[Any], Any], items: Sequence[Any], workers: int = 1, progress: Progress | None = None
    ) -> Iterator[Any]:
        """Results of a function of one item, in the order of the items; an error cancels the other jobs."""
        if self.client is None:
            with _one_blas_thread():
                yield from _counted(_in_threads(function, items, workers), len(items), progress)
        else:
            yield from _counted(_on_cluster(self.client, function, items), len(items), progress)

    def run_pass(
        self,
        function: Callable[[Any], Array],
        items: Sequence[Any],
        sizes: Sequence[int],
        workers: int = 1,
        progress: Progress | None = None,
    ) -> Array:
        """Concatenated vectors that a function returns for the items; read from the store if they are in it.

        Parameters
        ----------
        function : callable
            From an item to a vector.
        items : sequence
        sizes : sequence of int
            Length of the vector of each item.
        workers : int
        progress : callable, optional

        Returns
        -------
        (sum of sizes,) array
        """
        edges = np.concatenate([[0], np.cumsum(sizes)]).astype(int).tolist()
        stored = self.store.load(edges[-1]) if self.store is not None else None
        if stored is not None:
            return stored
        result = np.empty(edges[-1])
        for i, vector in enumerate(self.map(function, items, workers, progress)):
            result[edges[i] : edges[i + 1]] = vector
        if self.store is not None:
            self.store.save(result)
        return result


def choose_workers(workers: int | None, n: int, p: int) -> int:
    """Number of threads for n samples and p columns: as given, or one for a small problem and two for a large one."""
    if workers is not None:
        if workers < 1:
            raise SelectionError(f"workers must be 1 or more, not {workers}.")
        return workers
    return 2 if n * p * p > MULTIPLICATIONS_FOR_TWO else 1


@cache
def _blas() -> ThreadpoolController:
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def _one_blas_thread() -> Any:
    """Context with one thread for linear algebra, because the workers occupy the cores."""
    return _blas().limit(limits=1, user_api="blas")


def _in_threads(function: Callable[[Any], Any], items: Sequence[Any], workers: int) -> Iterator[Any]:
    # Not joblib: its generator looks for results every 10 ms, where a pass may take 20.
    if workers == 1:
        yield from map(function, items)
        return
    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(function, items)


def _on_cluster(client: Any, function: Callable[[Any], Any], items: Sequence[Any]) -> Iterator[Any]:
    # Not joblib's Dask backend: it waits for ever when every worker that took a job has died (joblib 1.6).
    from distributed import KilledWorker

    one = partial(_on_one_blas_thread, function)
    futures = [client.submit(one, item, pure=False) for item in items]
    try:
        while futures:
            result = futures[0].result()
            del futures[0]  # the worker then forgets the result
            yield result
    except KilledWorker as error:
        raise SelectionError(
            f"A job was dropped because every worker that took it died ({error}).\n"
            "Usually memory ran out: give the workers more of it, or shorter recordings."
        ) from error
    finally:
        client.cancel(futures)


def _on_one_blas_thread(function: Callable[[Any], Any], item: Any) -> Any:
    with _one_blas_thread():
        return function(item)


def _counted(results: Iterator[Any], total: int, progress: Progress | None) -> Iterator[Any]:
    for done, result in enumerate(results, 1):
        yield result
        if progress is not None:
            progress(done, total)
