"""Result of a comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from structsel.comparison.flight import Flight
from structsel.comparison.locating.changes import Change, Window
from structsel.comparison.locating.character import Character
from structsel.comparison.locating.coherence import Coherence
from structsel.comparison.locating.refitted import Refitted
from structsel.comparison.locating.region import Bound
from structsel.comparison.locating.turbulence import TurbulenceEstimate
from structsel.deprecation import renamed_attribute
from structsel.formatting import count_of
from structsel.results import Result
from structsel.tables import Column, Summary, Table, text_column

_SHOWN = 4
_EXCEEDED = 2.5  # standard deviations, beyond which a tolerance is said to be exceeded


_KEYS = {"fraction": "share", "log_bayes_factor": "nats", "input_fraction": "driven"}
"""Attributes whose keys in files are those of their first version."""
_COLUMNS = (
    text_column("response"),
    Column("measured", "3g"),
    Column("difference", "3g"),
    Column("refitted", "3g"),
    Column("noise", "3g"),
    Column("explainable", "%"),
)


def _as_before(values: dict[str, Any]) -> dict[str, Any]:
    return {_KEYS.get(name, name): value for name, value in values.items()}


@dataclass(frozen=True)
class Size:
    """Root mean squares of one response in the compared band, constant offsets aside.

    Attributes
    ----------
    measured, difference : float
    refitted : float
        Residual of the difference after a fit within the tolerances.
    noise : float
        Of the part that no usual function of the states explains either.
    """

    measured: float
    difference: float
    refitted: float
    noise: float


@dataclass(frozen=True, eq=False, repr=False)
class Mismatch(Result):
    """Difference between a simulation and recordings.

    Attributes
    ----------
    form : str
        Of the simulation.
    simulation : str
    recordings : tuple of str
    sizes : mapping of response to Size
    windows : tuple of Window
        In which the residual within tolerances is larger than usual.
    intervals : mapping of recording to intervals [s]
        The same, all responses together.
    region : mapping of channel to Bound
        That bound those intervals.
    changes : tuple of Change
    coherences : tuple of Coherence
    characters : tuple of Character
    explainable : mapping of response to float
        Fraction of the difference's variance that a regression model predicts on manoeuvres it was not fitted to.
    turbulence : TurbulenceEstimate or None
    deviations : tuple of (tolerance, sigmas)
    remarks : tuple of str
    flights : tuple of Flight
    refitted : Refitted
    """

    form: str
    simulation: str
    recordings: tuple[str, ...]
    sizes: Mapping[str, Size]
    windows: tuple[Window, ...]
    intervals: Mapping[str, tuple[tuple[float, float], ...]]
    region: Mapping[str, Bound]
    changes: tuple[Change, ...]
    coherences: tuple[Coherence, ...]
    characters: tuple[Character, ...]
    explainable: Mapping[str, float]
    turbulence: TurbulenceEstimate | None
    deviations: tuple[tuple[str, float], ...]
    remarks: tuple[str, ...]
    flights: tuple[Flight, ...] = field(repr=False)
    refitted: Refitted = field(repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Numbers and words, without time histories."""
        return {
            "form": self.form,
            "simulation": self.simulation,
            "recordings": list(self.recordings),
            "sizes": {c: asdict(s) for c, s in self.sizes.items()},
            "windows": [asdict(w) for w in self.windows],
            "intervals": {name: [list(s) for s in each] for name, each in self.intervals.items()},
            "region": {c: asdict(b) for c, b in self.region.items()},
            "changes": [asdict(c) for c in self.changes],
            "coherence": [
                {"response": c.response, "channel": c.channel, "share": c.fraction, "peak": c.peak}
                for c in self.coherences
                if c.significant
            ],
            "character": [_as_before(asdict(c)) for c in self.characters if c.significant],
            "explainable": dict(self.explainable),
            "turbulence": None if self.turbulence is None else _as_before(asdict(self.turbulence)),
            "tolerances": [{"name": n, "sigmas": s} for n, s in self.deviations],
            "remarks": list(self.remarks),
        }

    pulls = renamed_attribute("deviations")

    def _found(self) -> list[str]:
        made = []
        for c in self.characters[:_SHOWN]:
            if c.significant:
                made.append(f"{c.response}: {c.kind}, {c.fraction:.0%} of the residual (p = {c.p:.2g})")
        for d in self.changes[:_SHOWN]:
            made.append(f"{d.response} steps by {d.step:.3g} +- {d.std:.1g} in '{d.flight}' at {d.time:.1f} s")
        seconds = sum(b - a for each in self.intervals.values() for a, b in each)
        if seconds:
            bounds = ", ".join(f"{c} {b.low:.3g} to {b.high:.3g}" for c, b in self.region.items())
            made.append(
                f"the residual is larger than usual in {seconds:.0f} s" + (f", where {bounds}" if bounds else "")
            )
        for x in [x for x in self.coherences if x.significant][:_SHOWN]:
            made.append(f"{x.response} goes with {x.channel}: {x.fraction:.0%} of its power, most at {x.peak:.2g} Hz")
        exceeded = [f"{n} ({s:+.1f})" for n, s in self.deviations if abs(s) > _EXCEEDED]
        if exceeded:
            made.append("tolerances exceeded, in standard deviations: " + ", ".join(exceeded[:_SHOWN]))
        if self.turbulence is not None:
            made.append(self.turbulence.says)
        return made or ["nothing stands out beyond tolerances and noise"]

    def summary(self) -> Summary:
        """Size of the difference in every response, and what characterises it."""
        rows = tuple(
            (c, s.measured, s.difference, s.refitted, s.noise, self.explainable.get(c)) for c, s in self.sizes.items()
        )
        return Summary(
            self.simulation,
            f"({self.form}) compared with {count_of(len(self.recordings), 'recording')}",
            tables=(Table(_COLUMNS, rows),),
            notes=tuple(self._found()),
            warnings=self.remarks,
        )
