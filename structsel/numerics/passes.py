"""A pass over the data: one small job for every part of it, in threads here or by workers elsewhere.

Data that do not fit in memory are gone through part by part. A part is a few stretches of samples, and what a job makes
of it is one vector of known length, so that the results of a pass are one array: it can be kept, and gone on with.
Every part is worked by one worker from its first sample to its last; who does which has no influence on the result.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import ThreadpoolController

from structsel.numerics.arrays import Array
from structsel.numerics.noise_models import ARNoise
from structsel.numerics.rows import Signals

Progress = Callable[[int, int], None]
"""Called with parts done and parts in all."""


@dataclass(frozen=True)
class Piece:
    """Samples ``start`` to ``stop`` of a manoeuvre, and the colours of its residuals, where they are known."""

    signals: Signals
    start: int
    stop: int
    colours: tuple[ARNoise, ...] = ()


Part = Sequence[Piece]


class Job(Protocol):
    """What is made of every part; small, for it travels to the workers."""

    def size(self, part: Part) -> int:
        """Length of the vector made of this part."""

    def start(self) -> Callable[[Part], Array]:
        """Give a worker its own function, with a workspace nobody else writes to."""


class Runner(Protocol):
    """Who does the work."""

    def run(
        self,
        start: Callable[[], Callable[[Any], Any]],
        items: Sequence[Any],
        todo: Iterable[int],
        workers: int,
        keep: Callable[[int, Any], None],
    ) -> None:
        """Give ``keep`` the number and result of every item to do, in any order."""


@cache
def _blas() -> ThreadpoolController:
    return ThreadpoolController()


def one_thread() -> Any:
    """Within, linear algebra keeps to one thread: workers share the cores out among themselves."""
    return _blas().limit(limits=1, user_api="blas")


class Threads:
    """Workers in this process."""

    def run(
        self,
        start: Callable[[], Callable[[Any], Any]],
        items: Sequence[Any],
        todo: Iterable[int],
        workers: int,
        keep: Callable[[int, Any], None],
    ) -> None:
        """Work items off; see `Runner`."""
        waiting = iter(todo)
        broken = False

        def work() -> None:
            nonlocal broken
            try:
                one = start()
                for i in waiting:  # shared between workers: each next() is one step of the interpreter
                    keep(i, one(items[i]))
                    if broken:
                        return
            except BaseException:
                broken = True
                raise

        with one_thread():
            if workers == 1:
                work()
                return
            with ThreadPoolExecutor(workers) as pool:
                futures = [pool.submit(work) for _ in range(workers)]
                try:
                    for future in futures:
                        future.result()
                except BaseException:  # Ctrl-C comes here: the others end with the item they are at
                    broken = True
                    raise


class Memory(Protocol):
    """Where the results of passes are kept, so that a run that was broken off can go on."""

    def begin(self, edges: NDArray[np.int64]) -> tuple[Array, NDArray[np.bool_]]:
        """Results of the next pass, and which parts' are there; part i is ``edges[i]`` to ``edges[i + 1]``."""

    def tick(self) -> None:
        """Another part is done."""

    def end(self) -> None:
        """The pass is over."""


@dataclass(frozen=True)
class Made:
    """What a pass made of every part.

    Attributes
    ----------
    values : (edges[-1],) array
    edges : (B + 1,) int array
    """

    values: Array
    edges: NDArray[np.int64]

    def __getitem__(self, part: int) -> Array:
        """The vector of one part."""
        return self.values[self.edges[part] : self.edges[part + 1]]

    def __iter__(self) -> Iterator[Array]:
        return (self[i] for i in range(self.edges.size - 1))

    @property
    def table(self) -> Array:
        """One row per part, (B, length), not copied; where all are of one length."""
        return self.values.reshape(self.edges.size - 1, -1)


@dataclass(frozen=True)
class Passes:
    """Who goes through the data, and what remembers it.

    Attributes
    ----------
    runner : Runner
    memory : Memory, optional
    """

    runner: Runner = field(default_factory=Threads)
    memory: Memory | None = None

    def over(self, job: Job, parts: Sequence[Part], workers: int = 1, progress: Progress | None = None) -> Made:
        """Do a job for every part."""
        edges = np.concatenate([[0], np.cumsum([job.size(part) for part in parts])]).astype(np.int64)
        if self.memory is None:
            values, done = np.zeros(edges[-1]), np.zeros(len(parts), dtype=bool)
        else:
            values, done = self.memory.begin(edges)
        lock, so_far = threading.Lock(), int(done.sum())

        def keep(i: int, vector: Array) -> None:
            nonlocal so_far
            values[edges[i] : edges[i + 1]] = vector
            with lock:
                done[i] = True
                so_far += 1
                if progress is not None:
                    progress(so_far, len(parts))
                if self.memory is not None:
                    self.memory.tick()

        self.runner.run(job.start, parts, np.flatnonzero(~done).tolist(), workers, keep)
        if self.memory is not None:
            self.memory.end()
        return Made(values, edges)
