"""Result of a re-simulation: scores by output, and where the simulation diverged from the recording."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from structsel.deprecation import renamed_attribute
from structsel.errors import ModelError
from structsel.formatting import count_of, finite_or_none, format_number
from structsel.metrics import MetricValues, Normaliser, compute_metrics, in_tables
from structsel.nomenclature import unit_of
from structsel.recording import Recording
from structsel.results import Result
from structsel.tables import Column, Summary, Table, text_column

if TYPE_CHECKING:
    import pandas as pd

Kind = Literal["windows", "whole"]
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True, eq=False, kw_only=True)
class ResimulationScore(MetricValues):
    """Metrics of one output, over the samples that the simulation reached.

    Attributes
    ----------
    kind : {"whole", "windows"}
        The complete recording simulated from its first sample, or windows that each start from the recorded state.
    recording : str
        ``"all"`` for all of them together.
    output : str
    n : int
        Samples measured.
    reached : float
        Fraction of those before the simulation diverged.
    metrics : mapping of str to float
        By name, also as attributes: ``score.tic``; nan where not defined.
    band : float [output unit]
        Half-width of the proof-of-match band; nan where there is none.
    inside : float
        Fraction of the measured samples within the band; samples after a divergence are outside.
    """

    kind: str
    recording: str
    output: str
    n: int
    reached: float
    band: float
    inside: float

    flown = renamed_attribute("reached")

    def to_dict(self) -> dict[str, Any]:
        """Return the score as one flat row."""
        return {
            "kind": self.kind, "recording": self.recording, "output": self.output, "n": self.n, "flown": self.reached,
            **self.metrics, "band": self.band, "inside": self.inside,
        }  # fmt: skip

    def table_cells(self) -> list[str]:
        """Metrics and fraction within the band, as tables show them."""
        return [*self.cells(), f"{100.0 * self.inside:.0f} %" if math.isfinite(self.inside) else "-"]


def table_heads() -> list[str]:
    """Headings of `ResimulationScore.table_cells`."""
    return [*(metric.label for metric in in_tables(brief=True)), "in band"]


def score_output(
    kind: str,
    recording: str,
    output: str,
    pairs: Sequence[tuple[np.ndarray, np.ndarray]],
    band: float | None,
    normaliser: Normaliser,
) -> ResimulationScore:
    """Score of measured and simulated (n,) arrays, pieces together; NaN where there is no sample, or no simulation."""
    y, z = (np.concatenate(parts) for parts in zip(*pairs))
    sampled = np.isfinite(y)
    both = sampled & np.isfinite(z)
    n = int(sampled.sum())
    y, z = y[both], z[both]
    return ResimulationScore(
        kind=kind, recording=recording, output=output, n=n, reached=len(y) / n if n else math.nan,
        metrics=compute_metrics(y, z, undefined="nan", normaliser=normaliser),
        band=math.nan if band is None else band,
        inside=math.nan if band is None or not n else float((np.abs(y - z) <= band).sum() / n),
    )  # fmt: skip


@dataclass(frozen=True)
class Divergence:
    """Where a simulation ended early, or left the recording.

    Attributes
    ----------
    recording, kind : str
    start, at : float [s]
        Start of the simulation, and time of the divergence.
    why : str
    """

    recording: str
    kind: str
    start: float
    at: float
    why: str

    def __str__(self) -> str:
        start = f"simulated from t = {self.start:g} s" if self.kind == "windows" else "simulated as a whole"
        return f"'{self.recording}', {start}, diverges at t = {self.at:g} s: {self.why}"


@dataclass(frozen=True, eq=False, repr=False)
class Resimulation(Result):
    """A model simulated with recorded inputs, compared with the recordings.

    Attributes
    ----------
    model : str
    outputs : tuple of str
    window : float [s]
    normaliser : str
        What RRMSE is relative to.
    bands : mapping of output to float
        Half-widths of the proof-of-match bands.
    scores : tuple of ResimulationScore
        By recording, kind of simulation and output.
    pooled : tuple of ResimulationScore
        Over all recordings.
    divergences : tuple of Divergence
        Simulations that ended early or left the recording.
    recordings, whole, windows : tuple of Recording
        As recorded; and with the simulated outputs, whole and in windows, in their place, NaN after a divergence.
    doubts : tuple of str
        Warnings.
    """

    model: str
    outputs: tuple[str, ...]
    window: float
    normaliser: str
    bands: Mapping[str, float]
    scores: tuple[ResimulationScore, ...]
    pooled: tuple[ResimulationScore, ...]
    divergences: tuple[Divergence, ...]
    recordings: tuple[Recording, ...]
    whole: tuple[Recording, ...]
    windows: tuple[Recording, ...]
    doubts: tuple[str, ...] = ()

    departures = renamed_attribute("divergences")
    partings = renamed_attribute("divergence_notes")

    def __post_init__(self) -> None:
        self.freeze()

    def score(self, output: str, recording: str = "all", kind: Kind = "whole") -> ResimulationScore:
        """Score of one output, on one recording or on all.

        Raises
        ------
        ModelError
            There is no such score.
        """
        for one in (*self.pooled, *self.scores):
            if (one.output, one.recording, one.kind) == (output, recording, kind):
                return one
        raise ModelError(
            f"No score of '{output}' on '{recording}' simulated {kind!r}. There are {', '.join(self.outputs)} on all, "
            f"{', '.join(r.name for r in self.recordings)}, simulated 'whole' and in 'windows'."
        )

    def divergence_notes(self) -> list[str]:
        """Sentences on the divergences; those of a recording's windows in one."""
        said = [str(one) for one in self.divergences if one.kind == "whole"]
        for recording in self.recordings:
            mine = [one for one in self.divergences if (one.recording, one.kind) == (recording.name, "windows")]
            if mine:
                more = f", and {len(mine) - 1} more of its windows diverge" if len(mine) > 1 else ""
                said.append(f"{mine[0]}{more}")
        return said

    def to_frame(self) -> pd.DataFrame:
        """One row for each recording, kind of simulation and output, then the pooled ones."""
        import pandas as pd

        return pd.DataFrame([one.to_dict() for one in (*self.scores, *self.pooled)])

    def to_dict(self) -> dict[str, Any]:
        """Everything but the samples; None for what is not defined."""
        return {
            "schema": "structsel.replay/1",
            "model": self.model,
            "window": self.window,
            "normaliser": self.normaliser,
            "bands": dict(self.bands),
            "scores": finite_or_none([one.to_dict() for one in self.scores]),
            "pooled": finite_or_none([one.to_dict() for one in self.pooled]),
            "departures": [asdict(one) for one in self.divergences],
            "doubts": list(self.doubts),
        }

    def summary(self) -> Summary:
        """Scores in windows and over the complete recordings, side by side."""
        count = len(self.recordings)
        first, *more = table_heads()
        heads = ("output", f"{self.window:g} s: {first}", *more, f"whole: {first}", *more)
        columns = (text_column(heads[0]), *map(Column, heads[1:]))
        tables = []
        for name in (*(r.name for r in self.recordings), *(("all",) if count > 1 else ())):
            rows = ((o, *(x for kind in KINDS for x in self.score(o, name, kind).table_cells())) for o in self.outputs)
            tables.append(Table(columns, tuple(rows), name if count > 1 else ""))
        bands = ", ".join(f"{n} {format_number(b, 3)} {unit_of(n)}" for n, b in self.bands.items())
        note = f"{self.window:g} s: windows that each start from the recorded state. whole: from the first sample. "
        return Summary(
            self.model or "model",
            f"simulated with the inputs of {count_of(count, 'recording')}",
            tables=tuple(tables),
            notes=(f"{note}in band: fraction of samples within {bands}.",),
            warnings=(*self.divergence_notes(), *self.doubts),
        )
