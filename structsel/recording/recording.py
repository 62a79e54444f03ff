"""Recording: named SI channels on one time axis.

Measured, reconstructed and simulated flights are all Recordings, so that any two can be compared. A *manoeuvre* is one
continuous Recording.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from structsel.errors import DataError, StructselWarning
from structsel.formatting import count_of
from structsel.nomenclature import unit_of
from structsel.recording.arrays import checked_channels, checked_time, frame_channels
from structsel.recording.channel_errors import missing_channels_error, not_above_zero_error, not_finite_error
from structsel.recording.checks import (
    GAP,
    RECOMPUTED_KINDS,
    check_channel,
    check_recording,
    find_gaps,
    parts_between,
    require_time,
)
from structsel.recording.finding import Finding
from structsel.recording.signals import SignalMethods
from structsel.recording.summary import range_of, summarise
from structsel.results import Result
from structsel.tables import Summary

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False, repr=False)
class Recording(SignalMethods, Result):
    """Named channels on one time axis, read-only.

    Attributes
    ----------
    name : str
    t : (n,) array [s]
        Finite, strictly increasing, n at least 2. Dates and time differences (datetime64, timedelta64, datetime) are
        converted: seconds since the first sample, and seconds.
    channels : mapping of str to (n,) array
        In SI units and radians, with the signs of the nomenclature; without ``t``. Masked samples become NaN.
    units : mapping of str to str
        Units of channels that are not in the nomenclature. If a unit is given for one that is, the values are
        converted from it to the unit of the nomenclature.
    provenance : tuple of str
        File, map, and every conversion since.
    findings : tuple of Finding
        Results of the checks; see `check`.
    at_cg : frozenset of str
        Channels that have been moved from their sensor to the centre of gravity, or were computed there.

    Raises
    ------
    DataError
        If the time axis cannot be used, or a channel has not its length or contains other than real numbers.
    ChannelError
        If a unit is not of the quantity of its channel.
    """

    name: str
    t: np.ndarray
    channels: Mapping[str, np.ndarray]
    units: Mapping[str, str] = field(default_factory=dict)
    provenance: tuple[str, ...] = ()
    findings: tuple[Finding, ...] = ()
    at_cg: frozenset[str] = frozenset()
    is_checked: bool = field(init=False, default=False, repr=False, compare=False)  # by `check`, as it is

    def __post_init__(self) -> None:
        t = checked_time(self.t, self.name)
        require_time(t, self.name)
        channels, units = checked_channels(self.channels, self.units, t, self.name)
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "channels", channels)
        object.__setattr__(self, "units", units)
        object.__setattr__(self, "provenance", tuple(self.provenance))
        object.__setattr__(self, "findings", tuple(self.findings))
        object.__setattr__(self, "at_cg", frozenset(self.at_cg) & frozenset(channels))

    @classmethod
    def from_frame(
        cls, frame: pd.DataFrame, units: Mapping[str, str] | None = None, *, name: str = "recording", time: str = ""
    ) -> Recording:
        """Recording of a data frame, a channel for each column.

        Parameters
        ----------
        frame : DataFrame
            One row for each sample.
        units : mapping of str to str, optional
            Units of columns, such as ``{"alpha": "deg", "V": "kt"}``; the values are converted to SI units and radians.
            Columns that are not named are in the units of the nomenclature. By default ``frame.attrs["units"]``.
        name : str
        time : str
            Column of the time [s], or of time stamps. By default the column ``t``, or else the index, if it has time
            stamps, time differences or the name ``t`` or ``time``.

        Raises
        ------
        DataError
            There is no such column, or no time; or see `Recording`.
        ChannelError
            A unit is not of the quantity of its channel.
        """
        t, channels, units = frame_channels(frame, name, time, units)
        return cls(name, t, channels, units=units)

    def __len__(self) -> int:
        return len(self.t)

    def __contains__(self, name: object) -> bool:
        return name == "t" or name in self.channels

    __iter__ = None  # len() is the number of samples; .names are the channels

    def __getitem__(self, name: str) -> np.ndarray:
        """Channel by name, (n,), read-only; ``"t"`` is the time axis.

        Raises
        ------
        ChannelError
            If there is none; the message lists the channels.
        """
        if name == "t":
            return self.t
        if name not in self.channels:
            raise missing_channels_error(f"channel '{name}' [{self.unit(name)}]", self.name, (name,), self.names)
        return self.channels[name]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels, without the time axis."""
        return tuple(self.channels)

    @property
    def dt(self) -> float:
        """Sampling interval [s]: the median time step."""
        return float(np.median(np.diff(self.t)))

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""
        return float(self.t[-1] - self.t[0])

    def unit(self, name: str) -> str:
        """Unit of a channel: that of the nomenclature, else that in `units`, else ``"?"``."""
        return unit_of(name, self.units)

    def require(self, *names: str, finite: bool = False, by: str | None = None) -> None:
        """Raise an error if one of these channels is missing.

        Parameters
        ----------
        *names : str
        finite : bool
            Raise an error for NaN and infinite samples, too.
        by : str, optional
            Function that needs them, for the message; the calling function if not given.

        Raises
        ------
        ChannelError
            If a channel is missing.
        DataError
            If `finite` is set and a sample is not finite.
        """
        who = by or sys._getframe(1).f_code.co_name
        needs = "this script needs" if who == "<module>" else f"{who} needs"
        missing = tuple(name for name in dict.fromkeys(names) if name not in self)
        if missing:
            which = ", ".join(f"'{name}' [{self.unit(name)}]" for name in missing)
            plural = "s" if len(missing) > 1 else ""
            raise missing_channels_error(f"{needs} channel{plural} {which}", self.name, missing, self.names)
        for name in names if finite else ():
            if not np.isfinite(self[name]).all():
                text = f"{needs} finite samples of channel '{name}' [{self.unit(name)}]"
                raise not_finite_error(text, self.name, self.t, self[name])

    def require_above_zero(self, name: str, *, by: str) -> None:
        """Raise a DomainError if a sample of a channel is not above zero; `by` is the function that needs it."""
        if not (self[name] > 0.0).all():
            text = f"{by} needs '{name}' [{self.unit(name)}] above zero"
            raise not_above_zero_error(text, self.name, self.t, self[name])

    def with_channels(
        self,
        *,
        note: str = "",
        units: Mapping[str, str] | None = None,
        at_cg: Iterable[str] = (),
        findings: Iterable[Finding] = (),
        **arrays: np.ndarray | float,
    ) -> Recording:
        """Recording with additional or replaced channels.

        Parameters
        ----------
        note : str
            Added to the provenance: where the channels are from.
        units : mapping of str to str, optional
            Units of the new channels; see `Recording`.
        at_cg : iterable of str
            Channels that are at the centre of gravity, in addition to those that were there.
        findings : iterable of Finding
            Added to the findings, after those of the new channels.
        **arrays : (n,) array or float
            In the nomenclature's unit and sign unless `units` gives another unit; a number is a constant channel.
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
        object.__setattr__(made, "findings", (*kept, *findings))
        return made

    def between(self, start: float, end: float) -> Recording:
        """Samples with start <= t <= end [s], with new findings.

        Raises
        ------
        DataError
            If there are fewer than two.
        """
        inside = np.flatnonzero((self.t >= start) & (self.t <= end))
        if inside.size < 2:
            raise DataError(
                f"'{self.name}' has {inside.size} samples between {start:g} and {end:g} s; it runs from "
                f"{self.t[0]:g} to {self.t[-1]:g} s."
            )
        return self._slice(self.name, int(inside[0]), int(inside[-1]) + 1)

    def split(self, gap: float = GAP) -> list[Recording]:
        """Split the recording at gaps in time.

        A gap is a time step longer than `gap` times the median time step. Each part becomes a recording of its own,
        named ``name_1``, ``name_2``, ... A recording without gaps is returned unchanged.

        Parameters
        ----------
        gap : float, default 3.0
            Threshold, in median time steps.

        Returns
        -------
        list of Recording
            In order of time. Parts of a single sample are left out.

        Warns
        -----
        StructselWarning
            If parts of a single sample are left out.
        """
        gaps = find_gaps(self.t, gap * self.dt)
        if not gaps.size:
            return [self]
        parts = parts_between(gaps, len(self))
        single = [part.start for part in parts if part.stop - part.start < 2]
        if single:
            warnings.warn(
                StructselWarning(
                    f"split: {count_of(len(single), 'sample')} of '{self.name}' between two gaps left out, "
                    f"the first is sample {single[0]} (t = {self.t[single[0]]:g} s)."
                ),
                stacklevel=2,
            )
        parts = [part for part in parts if part.stop - part.start >= 2]
        return [self._slice(f"{self.name}_{k}", part.start, part.stop) for k, part in enumerate(parts, 1)]

    def _slice(self, name: str, first: int, last: int) -> Recording:
        made = replace(
            self,
            name=name,
            t=self.t[first:last],
            channels={key: values[first:last] for key, values in self.channels.items()},
            provenance=(*self.provenance, f"samples {first} to {last - 1} of '{self.name}'"),
        )
        return made.check()

    def check(self) -> Recording:
        """Recording with findings computed from its samples.

        Findings about the file, and those of other functions, are kept.
        """
        found = check_recording(self.t, self.channels)
        kept = tuple(f for f in self.findings if f.kind not in RECOMPUTED_KINDS)
        made = replace(self, findings=kept + found)
        object.__setattr__(made, "is_checked", True)
        return made

    def to_frame(self) -> pd.DataFrame:
        """Columns ``t`` and the channels, one row for each sample."""
        import pandas as pd

        return pd.DataFrame({"t": self.t, **self.channels})

    def to_dict(self) -> dict[str, Any]:
        """All fields without the samples, with a summary of each channel."""
        return {
            "name": self.name,
            "samples": len(self),
            "start": float(self.t[0]),
            "end": float(self.t[-1]),
            "dt": self.dt,
            "channels": {
                name: {"unit": self.unit(name), **dict(zip(("min", "mean", "max"), range_of(values)))}
                for name, values in self.channels.items()
            },
            "findings": [finding.to_dict() for finding in self.findings],
            "provenance": list(self.provenance),
            "at_cg": sorted(self.at_cg),
        }

    def summary(self) -> Summary:
        """Channels with their units and ranges, and the findings."""
        return summarise(self.name, self.t, self.channels, self.units, self.findings)
