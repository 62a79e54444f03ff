"""Passes done by the workers of a Dask cluster: every part is one task, and the results are added up here."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from structsel.errors import SelectionError
from structsel.numerics.passes import Runner, Threads, one_thread


class Cluster:
    """Workers of a `distributed.Client`; a `structsel.numerics.passes.Runner`.

    A task carries the file's name, or the samples, it works on, and nothing is left with a worker between tasks: one
    that is killed has its tasks done anew by the others.

    Parameters
    ----------
    client : distributed.Client
    """

    def __init__(self, client: Any):
        self.client = client

    def run(
        self,
        start: Callable[[], Callable[[Any], Any]],
        items: Sequence[Any],
        todo: Iterable[int],
        workers: int,
        keep: Callable[[int, Any], None],
    ) -> None:
        """Work items off; how many at once is the cluster's affair."""
        from distributed import KilledWorker, as_completed

        tasks = {self.client.submit(_work, start, items[i], pure=False): i for i in todo}
        try:
            for task, result in as_completed(tasks, with_results=True):
                keep(tasks.pop(task), result)
        except KilledWorker as error:
            raise SelectionError(
                f"A task was given up because every worker that took it on died ({error}).\n"
                "Most often memory ran out: give workers more of it, or shorter recordings."
            ) from error
        finally:
            self.client.cancel(list(tasks))


def _work(start: Callable[[], Callable[[Any], Any]], item: Any) -> Any:
    with one_thread():
        return start()(item)


def runner_of(client: Any) -> Runner:
    """Who does the work: the workers of a client, or threads of this process where there is none."""
    return Threads() if client is None else Cluster(client)
