"""Recordings as the engine sees them: base signals and responses, evaluated over the samples asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from structsel.candidates import Candidates
from structsel.errors import DataError, SelectionError
from structsel.numerics.rows import Signals
from structsel.recording import Recording


class _Window:
    """A stretch of a recording that answers like one."""

    def __init__(self, recording: Recording, start: int, stop: int):
        self._recording, self._range = recording, slice(start, stop)
        self.name = recording.name

    def __getitem__(self, channel: str) -> NDArray[np.float64]:
        return self._recording[channel][self._range]

    def __contains__(self, channel: object) -> bool:
        return channel in self._recording

    def __len__(self) -> int:
        return self._range.stop - self._range.start

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the channels."""
        return self._recording.names


@dataclass(frozen=True)
class RecordingSignals:
    """One manoeuvre's candidates and responses; nothing is copied until samples are asked for."""

    recording: Recording
    candidates: Candidates
    responses_wanted: tuple[str, ...]

    @property
    def n(self) -> int:
        """Number of samples."""
        return len(self.recording)

    def base(self, start: int, stop: int) -> NDArray[np.float64]:
        """(s, stop - start) base signals."""
        return self.candidates.evaluate_base(_Window(self.recording, start, stop))

    def responses(self, start: int, stop: int) -> NDArray[np.float64]:
        """(m, stop - start) responses."""
        return np.array([self.recording[r][start:stop] for r in self.responses_wanted])


@dataclass(frozen=True)
class SomeResponses:
    """The same manoeuvre with some of its responses."""

    signals: Signals
    rows: tuple[int, ...]

    @property
    def n(self) -> int:
        """Number of samples."""
        return self.signals.n

    def base(self, start: int, stop: int) -> NDArray[np.float64]:
        """Base signals of these samples."""
        return self.signals.base(start, stop)

    def responses(self, start: int, stop: int) -> NDArray[np.float64]:
        """The chosen responses of these samples."""
        return self.signals.responses(start, stop)[list(self.rows)]


def as_signals(
    recordings: Sequence[Recording], candidates: Candidates, responses: Sequence[str]
) -> list[RecordingSignals]:
    """Check that every recording has what is needed, finite, and wrap it.

    Raises
    ------
    ChannelError
        Where a channel is missing.
    DataError
        Where a sample is not finite, a recording is too short, or a response does not vary at all.
    SelectionError
        Where there is no recording, or a response is also a candidate's channel.
    """
    if not recordings:
        raise SelectionError("select needs at least one recording; none was given.")
    if len(candidates) == 0:
        raise SelectionError("select needs candidate terms; the pool is empty.")
    for response in responses:
        if response in candidates.channels:
            raise SelectionError(
                f"select: response {response!r} is also a channel of the candidates, which would explain it by "
                "itself. Take it out with candidates.without(...)."
            )
    for recording in recordings:
        recording.require(*candidates.channels, *responses, by="select", finite=True)
        if len(recording) < 4:
            raise DataError(
                f"select: recording {recording.name!r} has {len(recording)} sample(s); a regression needs more. "
                "Leave it out, or record longer."
            )
    for response in responses:
        spread = max(float(r[response].max()) for r in recordings) - min(float(r[response].min()) for r in recordings)
        size = max(float(np.abs(r[response]).max()) for r in recordings)
        if spread <= 1e-12 * size:
            names = ", ".join(r.name for r in recordings)
            raise DataError(
                f"select: response {response!r} is constant ({recordings[0][response][0]:.6g}) in {names}; "
                "there is nothing to explain. Check the channel map, or choose another response."
            )
    return [RecordingSignals(r, candidates, tuple(responses)) for r in recordings]
