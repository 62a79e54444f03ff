"""Result of simulating held-out recordings in short windows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from structsel.formatting import display_unit, format_number
from structsel.numerics.arrays import Array

if TYPE_CHECKING:
    import pandas as pd

STAGES = ("delivered", "refitted", "physics")
"""The simulation as given, retuned within tolerances, and with the effects that were found."""
_WRITTEN = dict(zip(STAGES, ("before", "refitted", "after")))


@dataclass(frozen=True)
class WindowScore:
    """Error of one channel at one stage.

    Attributes
    ----------
    rms : float [unit of the channel]
        Error against the smoothed recording, over all samples of all windows except their starts.
    tic : float
        Theil's coefficient of the change since the start of a window; nan if both are constant.
    inside : float
        Fraction of the readings within the band about the simulated channel.
    """

    rms: float
    tic: float
    inside: float

    def to_dict(self) -> dict[str, float | None]:
        """For diagnosis.json."""
        return {name: x if math.isfinite(x) else None for name, x in asdict(self).items()}


@dataclass(frozen=True)
class ChannelScores:
    """One channel.

    Attributes
    ----------
    channel, unit : str
    noise : float [unit]
        Root mean square of the readings less the smoothed ones.
    band : float [unit]
        Half-width.
    stages : mapping of stage to WindowScore
        ``delivered``, ``refitted`` and, if an effect was found, ``physics``.
    """

    channel: str
    unit: str
    noise: float
    band: float
    stages: Mapping[str, WindowScore]

    @property
    def left(self) -> float:
        """Error of the last stage over that of the first."""
        first = next(iter(self.stages.values()))
        return self.last.rms / first.rms if first.rms > 0.0 else 1.0

    @property
    def last(self) -> WindowScore:
        """Error at the last stage."""
        return list(self.stages.values())[-1]


@dataclass(frozen=True, eq=False)
class ExampleWindows:
    """Windows for a figure: those in which the error of the channel that is shown decreases most, or is the largest.

    Attributes
    ----------
    recording, channel : str
    t : (n,) array [s]
        Windows one after another; all other arrays hold a NaN between two.
    measured, smoothed : (n,) array [unit of the channel]
    simulated : mapping of stage to (n,) array
    """

    recording: str
    channel: str
    t: Array
    measured: Array
    smoothed: Array
    simulated: Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class HeldOutSimulation:
    """Held-out recordings simulated in short windows, at three stages.

    Attributes
    ----------
    rows : tuple of ChannelScores
        Recorded channels that the simulation computes.
    seconds : float [s]
        Length of a window.
    windows : int
    example : ExampleWindows or None
    reason : str
        Reason why there is no simulation; empty otherwise.
    """

    rows: tuple[ChannelScores, ...] = ()
    seconds: float = 0.0
    windows: int = 0
    example: ExampleWindows | None = None
    reason: str = ""

    @property
    def gained(self) -> ChannelScores | None:
        """Row of the channel whose error decreases most; None without rows."""
        return min(self.rows, key=lambda row: row.left, default=None)

    @property
    def shown(self) -> ChannelScores | None:
        """Row that a report shows: that of `gained`; without effects, the largest error relative to its band."""
        if self.explains:
            return self.gained
        return max(self.rows, key=lambda row: row.last.rms / row.band, default=None)

    @property
    def explains(self) -> bool:
        """Whether there is a stage with effects."""
        return any(STAGES[-1] in row.stages for row in self.rows)

    def to_frame(self) -> pd.DataFrame:
        """One row for each channel and stage."""
        import pandas as pd

        return pd.DataFrame(
            [
                {"channel": r.channel, "unit": r.unit, "stage": stage, **asdict(near), "band": r.band, "noise": r.noise}
                for r in self.rows
                for stage, near in r.stages.items()
            ]
        )

    def to_dict(self) -> dict[str, Any]:
        """For diagnosis.json."""
        if self.reason:
            return {"reason": self.reason}
        return {
            "window": {"value": self.seconds, "unit": "s"},
            "windows": self.windows,
            "channels": {
                r.channel: {"unit": r.unit, "band": r.band, "noise": r.noise}
                | {_WRITTEN[stage]: near.to_dict() for stage, near in r.stages.items()}
                for r in self.rows
            },
        }

    def __str__(self) -> str:

        if self.reason:
            return f"not simulated in windows: {self.reason}"
        stages = self.rows[0].stages if self.rows else {}
        n = len(stages)
        lines = [
            f"{self.windows} windows of {self.seconds:.1f} s: {', '.join(stages)}",
            f"  {'':<6}{'rms error':>{9 * n}}  {'':<6}{'TIC':>{7 * n}}{'in the band':>{7 * n}}",
        ]
        for r in self.rows:
            factor, unit = display_unit(r.unit)
            each = r.stages.values()
            rms = "".join(f"{factor * near.rms:9.2g}" for near in each)
            tic = "".join(f"{near.tic:7.3f}" for near in each)
            inside = "".join(f"{100.0 * near.inside:5.0f} %" for near in each)
            lines.append(f"  {r.channel:<6}{rms}  {unit:<6}{tic}{inside} of +-{format_number(factor * r.band, 2)}")
        return "\n".join(lines)
