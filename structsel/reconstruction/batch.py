"""Reconstruction of many manoeuvres: those that fail are reported, the others are completed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from structsel.aircraft import Aircraft
from structsel.errors import DomainError, StructselError
from structsel.options import takes_options
from structsel.reconstruction.reconstruct import reconstruct
from structsel.reconstruction.result import CONSTANTS, Reconstruction
from structsel.reconstruction.settings import ReconstructOptions
from structsel.recording import Recording
from structsel.recording.arguments import as_recordings, require_kind
from structsel.results import Result
from structsel.tables import Cell, Column, Summary, Table, text_column

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False, repr=False)
class Reconstructions(Result):
    """Results of several manoeuvres, in the order given.

    Attributes
    ----------
    done : tuple of Reconstruction
    failed : mapping of str to str
        Names of recordings that could not be reconstructed, with the reason.
    """

    done: tuple[Reconstruction, ...]
    failed: Mapping[str, str]

    def __post_init__(self) -> None:
        object.__setattr__(self, "failed", MappingProxyType(dict(self.failed)))

    def __len__(self) -> int:
        return len(self.done)

    def __iter__(self) -> Iterator[Reconstruction]:
        return iter(self.done)

    def __getitem__(self, name: str) -> Reconstruction:
        """One manoeuvre by its name.

        Raises
        ------
        KeyError
            If there is none; if it failed, the message has the reason.
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
        import pandas as pd

        rows = []
        for one in self.done:
            row: dict[str, Any] = {"name": one.name, "trusted": one.trusted, "nis": one.consistency.nis}
            for c in one.constants:
                row |= {c.name: c.value, f"{c.name}_std": c.std}
            rows.append(row)
        return pd.DataFrame(rows)

    def to_dict(self) -> dict[str, Any]:
        """All manoeuvres without their samples, and the failures."""
        return {
            "schema": "structsel.reconstructions/1",
            "done": [one.to_dict() for one in self.done],
            "failed": dict(self.failed),
        }

    def summary(self) -> Summary:
        """Verdict on each recording, and the constants of all trusted recordings."""
        rows = [
            (one.name, f"{one.recording.duration:.1f}", f"{one.consistency.nis:.3f}",
             Cell(one.verdict, "good" if one.trusted else "bad"))
            for one in self.done
        ]  # fmt: skip
        rows += [(name, "-", "-", Cell("NOT RECONSTRUCTED", "bad")) for name in self.failed]
        columns = (text_column("manoeuvre"), Column("duration", unit="s"), Column("NIS"), text_column("verdict"))
        trusted = [one for one in self.done if one.trusted]
        tables = [Table(columns, tuple(rows))] + ([_constant_table(trusted)] if len(trusted) > 1 else [])
        return Summary(
            "All manoeuvres",
            f"{len(trusted)} of {len(rows)} reconstructed and trusted",
            tables=tuple(tables),
            notes=("A constant whose scatter is far above its standard deviation is not constant.",)
            * (len(trusted) > 1),
            warnings=tuple(f"{name}: {reason}" for name, reason in self.failed.items()),
            parts=tuple(one.summary() for one in self.done),
        )


def _constant_table(results: Sequence[Reconstruction]) -> Table:
    """Mean and scatter of every constant over the recordings."""
    rows = []
    for name, (_, unit) in CONSTANTS.items():
        found = [c for one in results for c in one.constants if c.name == name]
        if found:
            values = np.array([c.value for c in found])
            scatter = float(values.std(ddof=1)) if len(found) > 1 else None
            rows.append((name, len(found), float(values.mean()), scatter, float(np.mean([c.std for c in found])), unit))
    columns = (text_column("constant"), Column("n"), Column("mean"), Column("scatter", "2g"), Column("mean std", "2g"))
    return Table((*columns, text_column("unit")), tuple(rows), "Constants of the trusted manoeuvres")


@takes_options(ReconstructOptions)
def reconstruct_all(
    recordings: Iterable[Recording],
    aircraft: Aircraft,
    *,
    options: ReconstructOptions,
    workers: int | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Reconstructions:
    """Reconstruct several manoeuvres, in parallel; see `reconstruct`.

    Parameters
    ----------
    recordings : iterable of Recording
        With different names.
    aircraft : Aircraft
    options : ReconstructOptions, optional
        Each field can also be given as a keyword.
    workers : int, optional
        Number of processes; by default that of the cores. The results do not depend on it.
    progress : callable, optional
        Called with the name of the stage, the manoeuvres done and all manoeuvres.

    Returns
    -------
    Reconstructions

    Raises
    ------
    DomainError
        Two recordings of one name, fewer than one worker, or an option out of range.
    """
    from joblib import Parallel, cpu_count, delayed

    given = as_recordings(recordings, "reconstruct_all(recordings, aircraft)")
    require_kind(aircraft, Aircraft, "reconstruct_all(recordings, aircraft)")
    names = [recording.name for recording in given]
    double = next((name for name in names if names.count(name) > 1), None)
    if double is not None:
        raise DomainError(f"reconstruct_all was given two recordings called '{double}'. Rename one.")
    if workers is not None and workers < 1:
        raise DomainError(f"reconstruct_all needs at least one worker, not {workers}.")
    count = min(workers or cpu_count(), max(1, len(given)))
    done: list[tuple[int, Reconstruction | str]] = []
    jobs = (delayed(_one)(i, recording, aircraft, options) for i, recording in enumerate(given))
    for result in Parallel(n_jobs=count, return_as="generator_unordered")(jobs):
        done.append(result)
        if progress is not None:
            progress("manoeuvres", len(done), len(given))
    done.sort(key=lambda result: result[0])
    made = tuple(result for _, result in done if isinstance(result, Reconstruction))
    failed = {names[i]: result for i, result in done if isinstance(result, str)}
    return Reconstructions(made, failed)


def _one(
    i: int, recording: Recording, aircraft: Aircraft, options: ReconstructOptions
) -> tuple[int, Reconstruction | str]:
    try:
        return i, reconstruct(recording, aircraft, options=options)
    except StructselError as error:
        return i, str(error)
    except (ArithmeticError, ValueError) as error:
        # A numerical failure in one manoeuvre must not stop the others.
        return i, f"{type(error).__name__}: {error}"
