"""What a selection must know of the recordings besides their moments, found in one reading of each."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from structsel.candidates import Candidates
from structsel.errors import DataError, SelectionError
from structsel.numerics.arrays import Array
from structsel.numerics.passes import Progress, Runner, Threads
from structsel.numerics.rows import Scales, scale_of, squares_of
from structsel.recording import Recording, StoredRecording
from structsel.selection.signals import RecordingSignals

Flight = Recording | StoredRecording


@dataclass(frozen=True)
class Spread:
    """Least, greatest and mean value of a channel, and its standard deviation."""

    low: float
    high: float
    mean: float
    std: float


@dataclass(frozen=True)
class Summary:
    """What one recording holds, of the channels wanted.

    Attributes
    ----------
    spreads : tuple of Spread
        Of each channel.
    squares : (s,) array, (m,) array, int
        See `structsel.numerics.rows.squares_of`.
    """

    spreads: tuple[Spread, ...]
    squares: tuple[Array, Array, int]


@dataclass(frozen=True)
class Flown:
    """Recordings that were found fit to select from.

    Attributes
    ----------
    flights : tuple of Recording or StoredRecording
    channels : tuple of str
        Of the candidates, and then the responses.
    summaries : tuple of Summary
    """

    flights: tuple[Flight, ...]
    channels: tuple[str, ...]
    summaries: tuple[Summary, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the recordings."""
        return tuple(flight.name for flight in self.flights)

    @property
    def dt(self) -> float:
        """Sampling interval of the first [s]."""
        return self.flights[0].dt

    @property
    def scales(self) -> Scales:
        """Of base signals and responses."""
        return scale_of([summary.squares for summary in self.summaries])

    def unit(self, channel: str) -> str:
        """Unit of a channel."""
        return self.flights[0].unit(channel)

    def spread(self, channel: str) -> Spread:
        """Over all recordings."""
        parts = [summary.spreads[self.channels.index(channel)] for summary in self.summaries]
        n = np.array([len(flight) for flight in self.flights], dtype=float)
        means, stds = np.array([p.mean for p in parts]), np.array([p.std for p in parts])
        mean = float(n @ means / n.sum())
        variance = float(n @ (stds**2 + (means - mean) ** 2) / n.sum())
        return Spread(min(p.low for p in parts), max(p.high for p in parts), mean, float(np.sqrt(variance)))

    def signals(self, candidates: Candidates, responses: Sequence[str]) -> list[RecordingSignals]:
        """The recordings as the engine sees them."""
        return [RecordingSignals(flight, candidates, tuple(responses)) for flight in self.flights]

    def identity(self, *asked: object) -> str:
        """Hash of names, lengths, what the channels hold, and what is asked; another for other data or options."""
        told = hashlib.sha256(repr((self.names, [len(f) for f in self.flights], self.channels, asked)).encode())
        for summary in self.summaries:
            told.update(np.array([(s.low, s.high, s.mean, s.std) for s in summary.spreads]).tobytes())
            told.update(summary.squares[0].tobytes() + summary.squares[1].tobytes())
        return told.hexdigest()


def look_over(
    flights: Sequence[Flight],
    candidates: Candidates,
    responses: Sequence[str],
    runner: Runner | None = None,
    workers: int = 1,
    progress: Progress | None = None,
) -> Flown:
    """Check that every recording has what is needed, finite, and find out what it holds.

    Raises
    ------
    ChannelError
        Where a channel is missing.
    DataError
        Where a sample is not finite, a recording is too short, or a response does not vary at all.
    SelectionError
        Where there is no recording, or a response is also a candidate's channel.
    """
    if not flights:
        raise SelectionError("select needs at least one recording; none was given.")
    if len(candidates) == 0:
        raise SelectionError("select needs candidate terms; the pool is empty.")
    for response in responses:
        if response in candidates.channels:
            raise SelectionError(
                f"select: response {response!r} is also a channel of the candidates, which would explain it by "
                "itself. Take it out with candidates.without(...)."
            )
    channels = tuple(dict.fromkeys([*sorted(candidates.channels), *responses]))
    found: dict[int, Summary] = {}

    def keep(i: int, summary: Summary) -> None:
        found[i] = summary
        if progress is not None:
            progress(len(found), len(flights))

    start = partial(_worker, channels, candidates, tuple(responses))
    (runner or Threads()).run(start, flights, range(len(flights)), workers, keep)
    flown = Flown(tuple(flights), channels, tuple(found[i] for i in range(len(flights))))
    for response in responses:
        spread = flown.spread(response)
        if spread.high - spread.low <= 1e-12 * max(abs(spread.low), abs(spread.high)):
            raise DataError(
                f"select: response {response!r} is constant ({spread.low:.6g}) in {', '.join(flown.names)}; "
                "there is nothing to explain. Check the channel map, or choose another response."
            )
    return flown


def _worker(
    channels: tuple[str, ...], candidates: Candidates, responses: tuple[str, ...]
) -> Callable[[Flight], Summary]:
    return partial(_summarise, channels=channels, candidates=candidates, responses=responses)


def _summarise(
    flight: Flight, channels: tuple[str, ...], candidates: Candidates, responses: tuple[str, ...]
) -> Summary:
    flight.require(*channels, by="select", finite=True)
    if len(flight) < 4:
        raise DataError(
            f"select: recording {flight.name!r} has {len(flight)} sample(s); a regression needs more. "
            "Leave it out, or record longer."
        )
    spreads = []
    for channel in channels:
        values = flight[channel]
        spreads.append(Spread(float(values.min()), float(values.max()), float(values.mean()), float(values.std())))
    return Summary(tuple(spreads), squares_of(RecordingSignals(flight, candidates, responses)))
