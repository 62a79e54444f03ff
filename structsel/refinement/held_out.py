"""Verdict of a refinement: whether it predicts recordings that it did not use better than the original model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal, TypeAlias

import numpy as np

from structsel.errors import DataError
from structsel.formatting import count_of, format_number, join_names
from structsel.recording import Recording
from structsel.refinement.parameters import require_even_clock
from structsel.refinement.protocols import RefinableModel

Verdict: TypeAlias = Literal["better", "no better", "worse", "not validated"]

WINDOW = 4.0
"""Length of the windows [s], two periods or so of a short period: the default of `structsel.validation.resimulate`."""
_FEWEST_RECORDINGS = 3
"""Recordings from which the scatter of the differences is taken over recordings. The standard error of two differences
has one degree of freedom: it is exceeded in half of all cases without any effect."""
_SHORTEST = 10  # samples of a window, as of a recording that is re-simulated


@dataclass(frozen=True)
class HeldOutComparison:
    """Errors of the original and the refined model on recordings that the refinement did not use.

    A recording is simulated in windows, each started from the recorded state. The states of a linear model are not
    recorded: its first state and a constant of each output are estimated in each window by least squares, for the
    original and the refined model alike. The error of a window is the root mean
    square of measured minus simulated outputs, each relative to the standard deviation of that output over the held-out
    recordings. Biases, references and scale factors of outputs are not applied: the model does not contain them.

    Attributes
    ----------
    recordings : tuple of str
    outputs : tuple of str
    unit : {"recording", "window"}
        What the differences are paired over: recordings if there are three or more, otherwise windows.
    original, refined : (n,) tuple of float
        Error of each recording or window.
    diverged : (original, refined) tuple of int
        Windows in which a simulation diverged; they are not in the errors.
    """

    recordings: tuple[str, ...]
    outputs: tuple[str, ...]
    unit: Literal["recording", "window"]
    original: tuple[float, ...]
    refined: tuple[float, ...]
    diverged: tuple[int, int] = (0, 0)

    @property
    def difference(self) -> float:
        """Mean error of the refined model minus that of the original."""
        return float(np.mean(np.subtract(self.refined, self.original))) if self.original else float("nan")

    @property
    def standard_error(self) -> float:
        """Of the mean difference, from its scatter; NaN for fewer than two."""
        n = len(self.original)
        return float(np.std(np.subtract(self.refined, self.original), ddof=1) / np.sqrt(n)) if n > 1 else float("nan")

    @property
    def verdict(self) -> Verdict:
        """Better or worse if the mean difference exceeds its standard error; first, fewer or more divergences.

        One standard error is a weak test: without any difference, about two of five verdicts are better or worse.
        """
        before, after = self.diverged
        if before != after:
            return "worse" if after > before else "better"
        if not np.isfinite(self.standard_error):
            return "not validated"
        if abs(self.difference) <= self.standard_error:
            return "no better"
        return "worse" if self.difference > 0.0 else "better"

    @property
    def reason(self) -> str:
        """Numbers behind the verdict, as a sentence."""
        where = f"{count_of(len(self.original), self.unit)} of {join_names(self.recordings)}"
        if self.diverged[0] != self.diverged[1]:
            return (
                f"the simulation diverges in {count_of(self.diverged[1], 'window')} of {join_names(self.recordings)}, "
                f"with the original model in {self.diverged[0]}"
            )
        if self.verdict == "not validated":
            return f"{where} is too little to compare the two models"
        means = [format_number(float(np.mean(errors)), 3) for errors in (self.refined, self.original)]
        difference = format_number(self.difference, 2, signed=True)
        return (
            f"relative error {means[0]}, original model {means[1]}; difference {difference}, standard error "
            f"{format_number(self.standard_error, 2)} over {where}"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as plain lists and numbers."""
        return {
            "recordings": list(self.recordings), "outputs": list(self.outputs), "window": WINDOW, "unit": self.unit,
            "original": list(self.original), "refined": list(self.refined), "difference": self.difference,
            "standard_error": self.standard_error, "diverged": list(self.diverged),
        }  # fmt: skip


def check_held_out(held_out: Sequence[Recording], used: Sequence[Recording]) -> None:
    """Refuse held-out recordings that were used, and uneven clocks.

    Raises
    ------
    DataError
    """
    names = {r.name for r in used}
    for recording in held_out:
        if recording.name in names:
            raise DataError(f"refine was given '{recording.name}' as held out, and to refine with. Give it once.")
        require_even_clock(recording)


def compare_on_held_out(
    flight: RefinableModel,
    held_out: Sequence[Recording],
    outputs: Sequence[str],
    original: tuple[np.ndarray, float],
    refined: tuple[np.ndarray, float],
) -> HeldOutComparison:
    """Errors of two sets of model parameters on recordings, in windows.

    Parameters
    ----------
    flight : RefinableModel
    held_out : sequence of Recording
    outputs : sequence of str
        Those that all of the recordings have are compared.
    original, refined : ((k,) array, delay [s])

    Raises
    ------
    DataError
        No output is in all recordings.
    """
    shown = [name for name in outputs if all(name in r and np.isfinite(r[name]).any() for r in held_out)]
    sizes = {name: float(np.nanstd(np.concatenate([r[name] for r in held_out]))) for name in shown}
    shown = [name for name in shown if sizes[name] > 0.0]
    if not shown:
        raise DataError(f"The held-out recordings have no varying output in common of {', '.join(outputs)}.")
    values, delays = np.array([original[0], refined[0]]), np.array([original[1], refined[1]])
    of_shown = {name: sizes[name] for name in shown}
    by_recording = [
        np.array([_squares(flight, piece, of_shown, values, delays) for piece in _windows(recording)])
        for recording in held_out
    ]
    return _paired([r.name for r in held_out], shown, by_recording)


def _squares(
    flight: RefinableModel, piece: Recording, sizes: Mapping[str, float], values: np.ndarray, delays: np.ndarray
) -> np.ndarray:
    """(2,) mean square relative error in a window; infinite where the simulation diverges, NaN without a sample."""
    measured = np.column_stack([piece[name] for name in sizes])
    sampled = np.isfinite(measured)
    if not sampled.any():
        return np.full(len(values), np.nan)
    columns = [flight.outputs.index(name) for name in sizes]
    with np.errstate(all="ignore"):
        if flight.from_rest:
            each = [_fit_start(flight, piece, sizes, measured, v, d) for v, d in zip(values, delays)]
            simulated = np.array(each)
        else:
            start = np.tile(flight.first_state(piece), (len(values), 1))
            simulated = flight.simulator(piece)(values, start, np.zeros_like(start), delays)[:, :, columns]
    relative = ((measured - simulated) / np.array([*sizes.values()]))[:, sampled]
    diverged = ~np.isfinite(relative).all(axis=1)
    return np.where(diverged, np.inf, np.mean(np.where(np.isfinite(relative), relative, 0.0) ** 2, axis=1))


def _fit_start(
    flight: RefinableModel,
    piece: Recording,
    sizes: Mapping[str, float],
    measured: np.ndarray,
    values: np.ndarray,
    delay: float,
) -> np.ndarray:
    """(n, c) outputs of a linear model from the first state and the constants of the outputs that fit best."""
    columns = [flight.outputs.index(name) for name in sizes]
    states, count = len(flight.states), len(columns)
    # From rest, and from a unit of each state: the outputs are linear in the first state.
    start = np.vstack([np.zeros(states), np.eye(states)])
    many = np.tile(values, (states + 1, 1))
    simulated = flight.simulator(piece)(many, start, np.zeros_like(start), np.full(states + 1, delay))[:, :, columns]
    from_rest, free = simulated[0], simulated[1:] - simulated[0]
    if not np.isfinite(simulated).all():
        return np.full(from_rest.shape, np.inf)
    constants = np.broadcast_to(np.eye(count)[:, None, :], (count, len(piece), count))
    shapes = np.concatenate([free, constants]) / np.array([*sizes.values()])
    left = (measured - from_rest) / np.array([*sizes.values()])
    sampled = np.isfinite(left)
    best = np.linalg.lstsq(shapes[:, sampled].T, left[sampled], rcond=None)[0]
    return np.asarray(from_rest + np.tensordot(best, np.concatenate([free, constants]), axes=1))


def _windows(recording: Recording) -> list[Recording]:
    """Consecutive pieces; the rest at the end joins the last if it is shorter than half a window."""
    n, size = len(recording), max(_SHORTEST, round(WINDOW / recording.dt))
    ends = [*(size * i for i in range(max(1, round(n / size)))), n]
    return [_cut(recording, a, b) for a, b in pairwise(ends)]


def _cut(recording: Recording, first: int, end: int) -> Recording:
    channels = {name: recording[name][first:end] for name in recording.names}
    return replace(recording, t=recording.t[first:end], channels=channels)


def _paired(names: list[str], outputs: list[str], by_recording: list[np.ndarray]) -> HeldOutComparison:
    """Comparison of mean squares (windows, 2) of each recording, windows where either diverged counted apart."""
    diverged = np.sum([np.isinf(squares).sum(axis=0) for squares in by_recording], axis=0)
    kept = [squares[np.isfinite(squares).all(axis=1)] for squares in by_recording]
    kept = [squares for squares in kept if len(squares)]
    over_recordings = len(kept) >= _FEWEST_RECORDINGS
    if over_recordings:
        errors = np.array([np.sqrt(squares.mean(axis=0)) for squares in kept])
    else:
        errors = np.sqrt(np.concatenate(kept)) if kept else np.empty((0, 2))
    return HeldOutComparison(
        tuple(names), tuple(outputs), "recording" if over_recordings else "window", tuple(errors[:, 0].tolist()),
        tuple(errors[:, 1].tolist()), (int(diverged[0]), int(diverged[1])),
    )  # fmt: skip
