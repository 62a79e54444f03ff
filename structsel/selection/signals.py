"""Recordings as the engine sees them: base signals and responses, evaluated over the samples asked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from structsel.candidates import Candidates
from structsel.numerics.rows import Signals
from structsel.recording import Recording, StoredRecording


class _Window:
    """A stretch of a recording that answers like one."""

    def __init__(self, recording: Recording | StoredRecording, start: int, stop: int):
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

    recording: Recording | StoredRecording
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
