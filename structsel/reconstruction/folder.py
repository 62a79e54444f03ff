"""Many manoeuvres at once: one that cannot be reconstructed is reported, the rest finish."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import pandas as pd
from joblib import Parallel, cpu_count, delayed

from structsel.aircraft import Aircraft
from structsel.errors import DomainError, StructselError
from structsel.reconstruction.reconstruct import reconstruct
from structsel.reconstruction.result import Reconstruction
from structsel.recording import Recording
from structsel.rich_text import to_html


@dataclass(frozen=True, eq=False)
class Reconstructions:
    """What became of several manoeuvres, in the order given.

    Attributes
    ----------
    done : tuple of Reconstruction
    failed : mapping of str to str
        Name of a recording that could not be reconstructed -> why.
    """

    done: tuple[Reconstruction, ...]
    failed: Mapping[str, str]

    def __post_init__(self) -> None:
        object.__setattr__(self, "failed", MappingProxyType(dict(self.failed)))

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:  # a mapping proxy does not pickle
        return type(self), (self.done, dict(self.failed))

    def __len__(self) -> int:
        return len(self.done)

    def __iter__(self) -> Iterator[Reconstruction]:
        return iter(self.done)

    def __getitem__(self, name: str) -> Reconstruction:
        """One manoeuvre by its name.

        Raises
        ------
        KeyError
            When there is none; the message says why it failed, if it did.
        """
        for one in self.done:
            if one.name == name:
                return one
        raise KeyError(f"{name}: {self.failed[name]}" if name in self.failed else name)

    @property
    def recordings(self) -> list[Recording]:
        """The reconstructed recordings, for `compute_all` and `select`."""
        return [one.recording for one in self.done]

    def to_frame(self) -> pd.DataFrame:
        """One row for each manoeuvre: verdict, NIS, and every constant with its standard deviation."""
        rows = []
        for one in self.done:
            row: dict[str, Any] = {"name": one.name, "trusted": one.trusted, "nis": one.consistency.nis}
            for c in one.constants:
                row |= {c.name: c.value, f"{c.name}_std": c.std}
            rows.append(row)
        return pd.DataFrame(rows)

    def to_dict(self) -> dict[str, Any]:
        """Every manoeuvre but its samples, and the failures."""
        return {
            "schema": "structsel.reconstructions/1",
            "done": [one.to_dict() for one in self.done],
            "failed": dict(self.failed),
        }

    def __str__(self) -> str:
        parts = [str(one) for one in self.done]
        parts += [f"{name}: NOT RECONSTRUCTED\n  {why}" for name, why in self.failed.items()]
        return "\n\n".join(parts)

    def _repr_html_(self) -> str:
        return to_html(
            self.to_frame(),
            f"{len(self)} flight paths",
            [f"{n}: NOT RECONSTRUCTED. {why}" for n, why in self.failed.items()],
        )


def reconstruct_all(
    recordings: Iterable[Recording],
    aircraft: Aircraft,
    *,
    workers: int | None = None,
    progress: Callable[[str, int, int], None] | None = None,
    **options: Any,
) -> Reconstructions:
    """Reconstruct several manoeuvres, in parallel; see `reconstruct`.

    Parameters
    ----------
    recordings : iterable of Recording
        Of different names.
    aircraft : Aircraft
    workers : int, optional
        Processes; as many as there are cores if not given. The results do not depend on it.
    progress : callable, optional
        Called with a stage's name, manoeuvres done and manoeuvres in all.
    **options
        Of `reconstruct`, but progress.

    Returns
    -------
    Reconstructions

    Raises
    ------
    DomainError
        Two recordings of one name, fewer than one worker, or an option `reconstruct` refuses outright.
    """
    flown = list(recordings)
    names = [recording.name for recording in flown]
    double = next((name for name in names if names.count(name) > 1), None)
    if double is not None:
        raise DomainError(f"reconstruct_all was given two recordings called '{double}'. Rename one.")
    if workers is not None and workers < 1:
        raise DomainError(f"reconstruct_all needs at least one worker, not {workers}.")
    count = min(workers or cpu_count(), max(1, len(flown)))
    done: list[tuple[int, Reconstruction | str]] = []
    jobs = (delayed(_one)(i, recording, aircraft, options) for i, recording in enumerate(flown))
    for result in Parallel(n_jobs=count, return_as="generator_unordered")(jobs):
        done.append(result)
        if progress is not None:
            progress("manoeuvres", len(done), len(flown))
    done.sort(key=lambda result: result[0])
    made = tuple(result for _, result in done if isinstance(result, Reconstruction))
    failed = {names[i]: result for i, result in done if isinstance(result, str)}
    return Reconstructions(made, failed)


def _one(i: int, recording: Recording, aircraft: Aircraft, options: dict[str, Any]) -> tuple[int, Reconstruction | str]:
    try:
        return i, reconstruct(recording, aircraft, **options)
    except StructselError as error:
        return i, str(error)
    except (ArithmeticError, ValueError) as error:
        # Numerical trouble nobody foresaw in one manoeuvre must not cost the others.
        return i, f"{type(error).__name__}: {error}"
