"""Recording: named SI channels on one clock.

Measured, reconstructed and simulated flights are all Recordings, so any two compare. A
*manoeuvre* is one continuous Recording.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from structsel.errors import ChannelError, DataError, StructselWarning
from structsel.formatting import count_of
from structsel.nomenclature import close_names, find_channel, is_known, unit_of
from structsel.recording import signals
from structsel.recording.arrays import checked_channels, checked_clock
from structsel.recording.checks import FROM_SAMPLES, GAP, Finding, check_channel, check_recording, require_clock
from structsel.results import Result
from structsel.tables import Cell, Column, Summary, Table, text_column


@dataclass(frozen=True, eq=False, repr=False)
class Recording(Result):
    """Named channels on one clock, read-only.

    Attributes
    ----------
    name : str
    t : (n,) array [s]
        Finite, strictly increasing, n at least 2. Dates and time differences (datetime64, timedelta64, datetime) are
        converted: seconds since the first sample, and seconds.
    channels : mapping of str to (n,) array
        SI and radians, signs as in the nomenclature; ``t`` is not among them. Masked samples become NaN.
    units : mapping of str to str
        Units of channels the nomenclature does not hold. A unit given for a channel that it holds is that of the
        values given: they are converted to the nomenclature's, and the unit is not kept.
    provenance : tuple of str
        File, map, and every conversion made since.
    findings : tuple of Finding
        What the checks found; see `check`.
    at_cg : frozenset of str
        Channels that have been moved from their sensor to the centre of gravity, or were computed there.

    Raises
    ------
    DataError
        When the clock cannot be used, or a channel has another length than it or holds no real numbers.
    ChannelError
        When a unit does not measure what its channel is.
    """

    name: str
    t: np.ndarray
    channels: Mapping[str, np.ndarray]
    units: Mapping[str, str] = field(default_factory=dict)
    provenance: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    at_cg: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        t = checked_clock(self.t, self.name)
        require_clock(t, self.name)
        channels, units = checked_channels(self.channels, self.units, t, self.name)
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "channels", channels)
        object.__setattr__(self, "units", units)
        object.__setattr__(self, "provenance", tuple(self.provenance))
        object.__setattr__(self, "findings", tuple(self.findings))
        object.__setattr__(self, "at_cg", frozenset(self.at_cg) & frozenset(channels))

    def __len__(self) -> int:
        return len(self.t)

    def __contains__(self, name: object) -> bool:
        return name == "t" or name in self.channels

    __iter__ = None  # len() counts samples, so iterating over names would mislead; use .names

    def __getitem__(self, name: str) -> np.ndarray:
        """Channel by name, (n,), read-only; ``"t"`` is the clock.

        Raises
        ------
        ChannelError
            When there is none; the message says what there is.
        """
        if name == "t":
            return self.t
        if name not in self.channels:
            text = f"channel '{name}' [{self.unit(name)}]; {self._lacks((name,))}"
            raise ChannelError(text, remedy=self._ways((name,)), cli_remedy=self._ways((name,), cli=True))
        return self.channels[name]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels, the clock not among them."""
        return tuple(self.channels)

    @property
    def dt(self) -> float:
        """Sampling interval [s]: the median step of the clock."""
        return float(np.median(np.diff(self.t)))

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""
        return float(self.t[-1] - self.t[0])

    def unit(self, name: str) -> str:
        """Unit of a channel: the nomenclature's, else the recording's own, else ``"?"``."""
        return unit_of(name, self.units)

    def require(self, *names: str, finite: bool = False, by: str | None = None) -> None:
        """Refuse to go on without these channels.

        Parameters
        ----------
        *names : str
        finite : bool
            Also refuse NaN and infinite samples in them.
        by : str, optional
            Who needs them, for the message; the calling function if not given.

        Raises
        ------
        ChannelError
            When a channel is missing.
        DataError
            When `finite` and a sample is not.
        """
        who = by or sys._getframe(1).f_code.co_name
        needs = "this script needs" if who == "<module>" else f"{who} needs"
        missing = tuple(name for name in dict.fromkeys(names) if name not in self)
        if missing:
            which = ", ".join(f"'{name}' [{self.unit(name)}]" for name in missing)
            plural = "s" if len(missing) > 1 else ""
            text = f"{needs} channel{plural} {which}; {self._lacks(missing)}"
            raise ChannelError(text, remedy=self._ways(missing), cli_remedy=self._ways(missing, cli=True))
        for name in names if finite else ():
            lost = np.flatnonzero(~np.isfinite(self[name]))
            if lost.size:
                i = int(lost[0])
                raise DataError(
                    f"{needs} finite samples of channel '{name}' [{self.unit(name)}]; in '{self.name}' it is "
                    f"{self[name][i]} at sample {i} (t = {self.t[i]:g} s), {lost.size} in all.",
                    remedy="Take a part without them with recording.between(), or correct the file.",
                    cli_remedy="Take a part without them with [file] rows = [first, last] in a channel map.",
                )

    def _lacks(self, missing: Sequence[str]) -> str:
        return f"'{self.name}' has none.\nIt has: {', '.join(('t', *self.names))}."

    def _ways(self, missing: Sequence[str], *, cli: bool = False) -> str:
        """What adds the missing channels."""
        commands = {
            "reconstruct": "Run structsel reconstruct first, or give --reconstruct, which adds it.",
            "compute_coefficients": "Give --aircraft, and the coefficients are computed first.",
        }
        ways: dict[str, None] = {}
        to_differentiate = []
        for name in missing:
            source = find_channel(name).source if is_known(name) else ""
            if source == "differentiate":
                if name.removesuffix("_dot") in self:
                    to_differentiate.append(name.removesuffix("_dot"))
            elif source:
                ways[commands.get(source, "") if cli else f"Run {source}() first, which adds it."] = None
        if to_differentiate:
            quoted = ", ".join(f'"{name}"' for name in to_differentiate)
            run = f"Run reconstruct() first, which adds it, or recording.differentiate({quoted})."
            ways[commands["reconstruct"] if cli else run] = None
        for name in missing:
            near = [other for other in close_names(name, self.names) if not is_known(other) or not is_known(name)]
            if near:
                ways[f"Did you mean {' or '.join(repr(other) for other in near)} for '{name}'?"] = None
        if not ways:
            ways["If the file holds it under another name, say so in a channel map."] = None
        return " ".join(way for way in ways if way)

    def with_channels(
        self,
        *,
        note: str = "",
        units: Mapping[str, str] | None = None,
        at_cg: Iterable[str] = (),
        **arrays: np.ndarray | float,
    ) -> Recording:
        """Recording with channels added or replaced.

        Parameters
        ----------
        note : str
            Added to the provenance: how the channels came about.
        units : mapping of str to str, optional
            Units of the channels added; see `Recording`.
        at_cg : iterable of str
            Channels that are now at the centre of gravity, in addition to those that were.
        **arrays : (n,) array or float
            In the nomenclature's unit and sign unless `units` gives another unit; a number is held throughout.
        """
        added = {
            name: np.broadcast_to(a, self.t.shape) if np.ndim(a) == 0 else np.asarray(a) for name, a in arrays.items()
        }
        kept = [finding for finding in self.findings if finding.channel not in added]
        made = Recording(
            self.name,
            self.t,
            {**self.channels, **added},
            {**self.units, **{name: unit for name, unit in (units or {}).items() if name in added}},
            self.provenance + ((note,) if note else ()),
            at_cg=self.at_cg.union(at_cg),
        )
        for name in added:
            kept += check_channel(name, made.t, made[name])
        object.__setattr__(made, "findings", tuple(kept))
        return made

    def between(self, start: float, end: float) -> Recording:
        """Samples with start <= t <= end [s], checked anew.

        Raises
        ------
        DataError
            When fewer than two samples lie there.
        """
        inside = np.flatnonzero((self.t >= start) & (self.t <= end))
        if inside.size < 2:
            raise DataError(
                f"'{self.name}' has {inside.size} samples between {start:g} and {end:g} s; it runs from "
                f"{self.t[0]:g} to {self.t[-1]:g} s."
            )
        return self._rows(self.name, int(inside[0]), int(inside[-1]) + 1)

    def split(self, gap: float = GAP) -> list[Recording]:
        """Manoeuvres between the gaps, each a Recording.

        A gap is a step longer than `gap` times the median step. Without one, the list holds this
        recording alone; otherwise the parts are named ``name_1``, ``name_2``, ... A part of a
        single sample is left out, with a warning.
        """
        cuts = np.flatnonzero(np.diff(self.t) > gap * self.dt) + 1
        if not cuts.size:
            return [self]
        edges = [0, *cuts.tolist(), len(self)]
        parts = [(a, b) for a, b in pairwise(edges) if b - a >= 2]
        lone = [a for a, b in pairwise(edges) if b - a < 2]
        if lone:
            warnings.warn(
                StructselWarning(
                    f"split: {len(lone)} samples of '{self.name}' stand alone between gaps and are left out, "
                    f"the first is sample {lone[0]} (t = {self.t[lone[0]]:g} s)."
                ),
                stacklevel=2,
            )
        return [self._rows(f"{self.name}_{k}", a, b) for k, (a, b) in enumerate(parts, 1)]

    def _rows(self, name: str, first: int, last: int) -> Recording:
        made = replace(
            self,
            name=name,
            t=self.t[first:last],
            channels={key: values[first:last] for key, values in self.channels.items()},
            provenance=(*self.provenance, f"samples {first} to {last - 1} of '{self.name}'"),
        )
        return made.check()

    def check(self) -> Recording:
        """Recording whose findings are made anew from its samples.

        What was found otherwise, in the file or by a station, is kept.
        """
        found = check_recording(self.t, self.channels)
        kept = tuple(f for f in self.findings if f.kind not in FROM_SAMPLES)
        return replace(self, findings=kept + found)

    def differentiate(self, *names: str, method: str = "central", order: int = 4) -> Recording:
        """Add the time derivatives ``p_dot``, ... of channels.

        An uneven clock is allowed for by the chain rule over the sample number, and by the spline
        directly ("fourier" refuses it); a gap is not. The spline also bridges samples that are NaN, and the
        provenance says how many.

        Parameters
        ----------
        *names : str
        method, order
            As `structsel.numerics.differentiation.differentiate` takes them.

        Raises
        ------
        ChannelError
            When a channel is missing.
        DataError
            When there is a gap in time, or a sample is not finite.
        """
        return signals.differentiate(self, names, method, order)

    def remove_spikes(self, *names: str, threshold: float = 5.0) -> Recording:
        """Replace isolated wrong samples of channels by a local fit, and report every one.

        Each channel touched gets a finding of kind "spike" and a line in the provenance with the number, time and
        old value of every sample replaced.

        Parameters
        ----------
        *names : str
        threshold : float [-]
            In standard deviations of the channel's noise; `structsel.numerics.signal_quality.find_spikes` says what
            else a spike must be.

        Raises
        ------
        ChannelError
            When a channel is missing.
        """
        return signals.remove_spikes(self, names, threshold)

    def unwrap(self, *names: str, turn: float = 2.0 * np.pi) -> Recording:
        """Take the jumps of whole turns out of angles, so that they run on beyond pi (or 360 degrees).

        A jump within a quarter turn of a whole number of turns is a wrap; others are left. NaN samples
        are passed over.

        Parameters
        ----------
        *names : str
        turn : float [rad]
            What the channel wraps by: pi for a bank angle logged in half turns.

        Raises
        ------
        ChannelError
            When a channel is missing.
        """
        return signals.unwrap(self, names, turn)

    def align(self, delays: Mapping[str, float]) -> Recording:
        """Advance late channels, each by its own delay.

        Parameters
        ----------
        delays : mapping of str to float [s]
            Positive where the channel is delayed; `reconstruct` estimates the delays of a recording.

        Returns
        -------
        Recording
            Samples about which nothing is known, at the end of an advanced channel, are NaN and found "not-finite".

        Raises
        ------
        ChannelError
            When a channel is missing.
        DomainError
            When a delay is not finite.
        """
        return signals.align(self, delays)

    def to_frame(self) -> pd.DataFrame:
        """Columns ``t`` and the channels, one row per sample."""
        return pd.DataFrame({"t": self.t, **self.channels})

    def to_dict(self) -> dict[str, Any]:
        """Everything but the samples, with a summary of each channel."""
        return {
            "name": self.name,
            "samples": len(self),
            "start": float(self.t[0]),
            "end": float(self.t[-1]),
            "dt": self.dt,
            "channels": {
                name: {"unit": self.unit(name), **dict(zip(("min", "mean", "max"), _summary(values)))}
                for name, values in self.channels.items()
            },
            "findings": [finding.to_dict() for finding in self.findings],
            "provenance": list(self.provenance),
            "at_cg": sorted(self.at_cg),
        }

    def summary(self) -> Summary:
        """Channels with their units and ranges, and what the checks found."""
        kinds: dict[str, list[str]] = {}
        for finding in self.findings:
            kinds.setdefault(finding.channel, []).append(finding.kind)
        columns = [text_column("channel"), text_column("unit"), Column("min"), Column("mean"), Column("max")]
        rows: list[list[Any]] = [[name, self.unit(name), *_summary(values)] for name, values in self.channels.items()]
        if kinds:
            columns.append(text_column("found"))
            for row in rows:
                row.append(Cell(", ".join(dict.fromkeys(kinds.get(str(row[0]), []))), "warning"))
        return Summary(
            self.name,
            f"{len(self)} samples, t = {self.t[0]:g} to {self.t[-1]:g} s, every {self.dt:g} s, "
            f"{count_of(len(self.channels), 'channel')}",
            tables=(Table(tuple(columns), tuple(map(tuple, rows))),),
            notes=tuple(f"- {f}" for f in self.findings if f.severity == "note"),
            warnings=tuple(str(f) for f in self.findings if f.severity != "note"),
        )


def _summary(values: np.ndarray) -> tuple[float, float, float]:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return float("nan"), float("nan"), float("nan")
    return float(finite.min()), float(finite.mean()), float(finite.max())
