"""What a replay found: scores by output, and where flights parted."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np
import pandas as pd

from structsel.errors import DomainError, ModelError
from structsel.recording import Recording
from structsel.rich_text import opening, to_html
from structsel.validation import metrics

Kind = Literal["windows", "whole"]
KINDS: tuple[Kind, ...] = get_args(Kind)


@dataclass(frozen=True)
class ReplayScore:
    """How near one output came.

    Attributes
    ----------
    kind : {"whole", "windows"}
        Flown whole, or in windows that each start from what was recorded.
    recording : str
        ``"all"`` for all of them together.
    output : str
    n : int
        Samples measured.
    flown : float
        Share of those that the simulation reached; the scores are over these.
    r2, rrmse, tic : float
        As the functions of these names; nan where they are not defined.
    rms_error : float [output unit]
    band : float [output unit]
        Half-width of the proof-of-match band; nan where there is none.
    inside : float
        Share of the samples measured at which the simulation was flying and within the band.
    """

    kind: str
    recording: str
    output: str
    n: int
    flown: float
    r2: float
    rrmse: float
    tic: float
    rms_error: float
    band: float
    inside: float


def score_output(
    kind: str,
    recording: str,
    output: str,
    pairs: Sequence[tuple[np.ndarray, np.ndarray]],
    band: float | None,
    normaliser: metrics.Normaliser,
) -> ReplayScore:
    """Score of measured and simulated (n,) arrays, pieces together; NaN where there is no sample, or no flight."""
    y, z = (np.concatenate(parts) for parts in zip(*pairs))
    seen = np.isfinite(y)
    both = seen & np.isfinite(z)
    n = int(seen.sum())
    y, z = y[both], z[both]

    def defined(measure: Any, *more: Any) -> float:
        try:
            return float(measure(y, z, *more)) if len(y) else math.nan
        except DomainError:  # a channel that stands still
            return math.nan

    with np.errstate(over="ignore"):
        error = np.abs(y - z)
        rms = float(np.sqrt(np.mean(error**2))) if len(y) else math.nan
        scores = (defined(metrics.r2), defined(metrics.rrmse, normaliser), defined(metrics.tic))
    inside = math.nan if band is None or not n else float((error <= band).sum() / n)
    share = len(y) / n if n else math.nan
    return ReplayScore(kind, recording, output, n, share, *scores, rms, math.nan if band is None else band, inside)


@dataclass(frozen=True)
class Departure:
    """Where a simulated flight ended early, or parted from the recorded one.

    Attributes
    ----------
    recording, kind : str
    start, at : float [s]
        When the flight began, and when that happened.
    why : str
    """

    recording: str
    kind: str
    start: float
    at: float
    why: str

    def __str__(self) -> str:
        from_ = f"flown from t = {self.start:g} s" if self.kind == "windows" else "flown whole"
        return f"'{self.recording}', {from_}, parts at t = {self.at:g} s: {self.why}"


@dataclass(frozen=True, eq=False)
class Replay:
    """A model's flights with recorded inputs, against what was recorded.

    Attributes
    ----------
    model : str
    outputs : tuple of str
    window : float [s]
    normaliser : str
        What RRMSE is relative to.
    bands : mapping of output to float
        Half-widths of the proof-of-match bands.
    scores : tuple of ReplayScore
        By recording, kind of flight and output.
    pooled : tuple of ReplayScore
        Over all recordings.
    departures : tuple of Departure
        Flights that ended early or parted from the recorded ones.
    recordings, whole, windows : tuple of Recording
        As recorded; and with the outputs flown, whole and in windows, in their place, NaN after a flight ended.
    doubts : tuple of str
    """

    model: str
    outputs: tuple[str, ...]
    window: float
    normaliser: str
    bands: Mapping[str, float]
    scores: tuple[ReplayScore, ...]
    pooled: tuple[ReplayScore, ...]
    departures: tuple[Departure, ...]
    recordings: tuple[Recording, ...]
    whole: tuple[Recording, ...]
    windows: tuple[Recording, ...]
    doubts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "bands", MappingProxyType(dict(self.bands)))

    def __reduce__(self) -> tuple[Any, ...]:  # a mapping proxy does not pickle
        held = [getattr(self, name) for name in self.__dataclass_fields__]
        return Replay, tuple(dict(p) if isinstance(p, MappingProxyType) else p for p in held)

    def score(self, output: str, recording: str = "all", kind: Kind = "whole") -> ReplayScore:
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
            f"No score of '{output}' on '{recording}' flown {kind!r}. There are {', '.join(self.outputs)} on all, "
            f"{', '.join(r.name for r in self.recordings)}, flown 'whole' and 'windows'."
        )

    def partings(self) -> list[str]:
        """Sentences on the departures; those of a recording's windows in one."""
        said = [str(one) for one in self.departures if one.kind == "whole"]
        for recording in self.recordings:
            mine = [one for one in self.departures if (one.recording, one.kind) == (recording.name, "windows")]
            if mine:
                more = f", and {len(mine) - 1} more of its windows break off" if len(mine) > 1 else ""
                said.append(f"{mine[0]}{more}")
        return said

    def to_frame(self) -> pd.DataFrame:
        """One row for each recording, kind of flight and output, then the pooled ones."""
        return pd.DataFrame([asdict(one) for one in (*self.scores, *self.pooled)])

    def to_dict(self) -> dict[str, Any]:
        """Everything but the samples; None for what is not defined."""
        return {
            "schema": "structsel.replay/1",
            "model": self.model,
            "window": self.window,
            "normaliser": self.normaliser,
            "bands": dict(self.bands),
            "scores": [_plain(one) for one in self.scores],
            "pooled": [_plain(one) for one in self.pooled],
            "departures": [asdict(one) for one in self.departures],
            "doubts": list(self.doubts),
        }

    def __str__(self) -> str:
        count = len(self.recordings)
        lines = [f"{self.model or 'model'} flown with the inputs of {count} recording{'s' * (count != 1)}"]
        heads = "".join(f"{head:>8}" for head in ("R2", "RRMSE", "TIC", "in band"))
        lines.append(f"  {'':<8}  {f'in windows of {self.window:g} s':>32}  {'whole':>32}")
        for name in (*(r.name for r in self.recordings), *(("all",) if count > 1 else ())):
            lines.append(f"  {name:<8}  {heads:>32}  {heads:>32}")
            for output in self.outputs:
                both = (self.score(output, name, kind) for kind in KINDS)
                lines.append(f"  {output:<8}  " + "  ".join("".join(f"{x:>8}" for x in shown(one)) for one in both))
        lines.append(f"in band: within {', '.join(f'{n} {b:.4g}' for n, b in self.bands.items())}")
        lines += [f"  ! {text}" for text in self.partings()]
        return "\n".join([*lines, *(f"  ! {text}" for text in self.doubts)])

    def _repr_html_(self) -> str:
        return to_html(self.to_frame(), opening(self), (*self.partings(), *self.doubts))


def shown(score: ReplayScore) -> tuple[str, str, str, str]:
    """R2, RRMSE, TIC and the share within the band, as tables have them."""
    figures = (f"{x:.4f}" if not abs(x) >= 100.0 else f"{x:.2g}" for x in (score.r2, score.rrmse, score.tic))
    r2, rrmse, tic = ("-" if x == "nan" else x for x in figures)
    return r2, rrmse, tic, f"{100.0 * score.inside:.0f} %" if math.isfinite(score.inside) else "-"


def _plain(score: ReplayScore) -> dict[str, Any]:
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in asdict(score).items()}
