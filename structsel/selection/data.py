"""Recordings as selection reads them: checks, statistics of the channels, base signals and responses."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from structsel.candidates import Candidates
from structsel.errors import DataError, SelectionError
from structsel.numerics.arrays import Array
from structsel.numerics.blocks import JobRunner, Progress
from structsel.numerics.regressors import DataSource, Scales, scales_of, sums_of_squares
from structsel.recording import Recording, StoredRecording

AnyRecording = Recording | StoredRecording
FEWEST = 4  # samples of a recording


class _Window:
    """Some samples of a recording, with the interface that candidates evaluate."""

    def __init__(self, recording: AnyRecording, start: int, stop: int):
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
class RecordingData:
    """Candidates and responses of one manoeuvre; nothing is copied until samples are read."""

    recording: AnyRecording
    candidates: Candidates
    responses_wanted: tuple[str, ...]

    @property
    def n(self) -> int:
        """Number of samples."""
        return len(self.recording)

    def base(self, start: int, stop: int) -> NDArray[np.float64]:
        """(s, stop - start) base signals."""
        base = self.candidates.base
        if base and all(factor.kind == "channel" for factor in base):  # checked by `summarise_recordings`
            return np.array([self.recording[factor.channels[0]][start:stop] for factor in base])
        return self.candidates.evaluate_base(_Window(self.recording, start, stop))

    def responses(self, start: int, stop: int) -> NDArray[np.float64]:
        """(m, stop - start) responses."""
        return np.array([self.recording[r][start:stop] for r in self.responses_wanted])


@dataclass(frozen=True)
class SelectedResponses:
    """The same manoeuvre with some of its responses."""

    source: DataSource
    rows: tuple[int, ...]

    @property
    def n(self) -> int:
        """Number of samples."""
        return self.source.n

    def base(self, start: int, stop: int) -> NDArray[np.float64]:
        """Base signals of these samples."""
        return self.source.base(start, stop)

    def responses(self, start: int, stop: int) -> NDArray[np.float64]:
        """The chosen responses of these samples."""
        return self.source.responses(start, stop)[list(self.rows)]


# ---------------------------------------------------------------- checks and statistics


@dataclass(frozen=True)
class ChannelStatistics:
    """Least, greatest and mean value of a channel, and its standard deviation."""

    low: float
    high: float
    mean: float
    std: float


@dataclass(frozen=True)
class RecordingSummary:
    """What one recording holds, of the channels wanted.

    Attributes
    ----------
    channels : tuple of ChannelStatistics
    squares : (s,) array, (m,) array, int
        See `structsel.numerics.regressors.sums_of_squares`.
    """

    channels: tuple[ChannelStatistics, ...]
    squares: tuple[Array, Array, int]


@dataclass(frozen=True)
class DataSummary:
    """Recordings that passed the checks, and what they hold.

    Attributes
    ----------
    recordings : tuple of Recording or StoredRecording
    channels : tuple of str
        Of the candidates, and then the responses.
    summaries : tuple of RecordingSummary
    """

    recordings: tuple[AnyRecording, ...]
    channels: tuple[str, ...]
    summaries: tuple[RecordingSummary, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the recordings."""
        return tuple(recording.name for recording in self.recordings)

    @property
    def dt(self) -> float:
        """Sampling interval of the first [s]."""
        return self.recordings[0].dt

    @property
    def scales(self) -> Scales:
        """Of base signals and responses."""
        return scales_of([summary.squares for summary in self.summaries])

    def unit(self, channel: str) -> str:
        """Unit of a channel."""
        return self.recordings[0].unit(channel)

    def statistics(self, channel: str) -> ChannelStatistics:
        """Of a channel over all recordings."""
        parts = [summary.channels[self.channels.index(channel)] for summary in self.summaries]
        n = np.array([len(recording) for recording in self.recordings], dtype=float)
        means, stds = np.array([p.mean for p in parts]), np.array([p.std for p in parts])
        mean = float(n @ means / n.sum())
        variance = float(n @ (stds**2 + (means - mean) ** 2) / n.sum())
        return ChannelStatistics(min(p.low for p in parts), max(p.high for p in parts), mean, float(np.sqrt(variance)))

    def complete(self, channels: Sequence[str]) -> list[str]:
        """Those of these channels that every recording has, all of it finite."""
        return [
            name
            for name in channels
            if all(name in recording and np.isfinite(recording[name]).all() for recording in self.recordings)
        ]

    def sources(self, candidates: Candidates, responses: Sequence[str]) -> list[RecordingData]:
        """The recordings as the engine reads them."""
        return [RecordingData(recording, candidates, tuple(responses)) for recording in self.recordings]

    def fingerprint(self, *asked: object) -> str:
        """Hash of names, lengths, contents of the channels, and what is asked; different for other data or options."""
        lengths = [len(recording) for recording in self.recordings]
        digest = hashlib.sha256(repr((self.names, lengths, self.channels, asked)).encode())
        for summary in self.summaries:
            digest.update(np.array([(c.low, c.high, c.mean, c.std) for c in summary.channels]).tobytes())
            digest.update(summary.squares[0].tobytes() + summary.squares[1].tobytes())
        return digest.hexdigest()


def summarise_recordings(
    recordings: Sequence[AnyRecording],
    candidates: Candidates,
    responses: Sequence[str],
    runner: JobRunner | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> DataSummary:
    """Check that every recording has what is needed, finite, and summarise it.

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
                f"select: response {response!r} is also a channel of the candidates, which alone would explain it.",
                remedy="Take it out with candidates.without(...).",
                cli_remedy="Leave the response out of --candidates and --terms.",
            )
    channels = tuple(dict.fromkeys([*sorted(candidates.channels), *responses]))
    function = partial(_summarise, channels=channels, candidates=candidates, responses=tuple(responses))
    summaries = (runner or JobRunner()).map(function, recordings, workers, progress)
    data = DataSummary(tuple(recordings), channels, tuple(summaries))
    for response in responses:
        found = data.statistics(response)
        if found.high - found.low <= 1e-12 * max(abs(found.low), abs(found.high)):
            raise DataError(
                f"select: response {response!r} is constant ({found.low:.6g}) in {', '.join(data.names)}; "
                "there is nothing to explain. Check the channel map, or choose another response."
            )
    return data


def _summarise(
    recording: AnyRecording, channels: tuple[str, ...], candidates: Candidates, responses: tuple[str, ...]
) -> RecordingSummary:
    recording.require(*channels, by="select")
    if len(recording) < FEWEST:
        raise DataError(
            f"select: recording {recording.name!r} has {len(recording)} sample(s); a regression needs more. "
            "Leave it out, or record longer."
        )
    statistics = []
    for channel in channels:
        x = recording[channel]
        low, high, mean = float(x.min()), float(x.max()), float(x.mean())
        if not (np.isfinite(low) and np.isfinite(high)):  # the least value is NaN if one sample is
            recording.require(channel, by="select", finite=True)
        deviation = x - mean
        statistics.append(ChannelStatistics(low, high, mean, float(np.sqrt(deviation @ deviation / len(x)))))
    return RecordingSummary(tuple(statistics), sums_of_squares(RecordingData(recording, candidates, responses)))
