"""frequency_response(): responses and coherence of recorded inputs and outputs, with random errors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from structsel.errors import ChannelError, DataError, DomainError
from structsel.formatting import count_of, display_unit, finite_or_none, format_number, join_names
from structsel.nomenclature import unit_of
from structsel.numerics.frequency_response import OVERLAP, combine_windows, condition, multiple_coherence
from structsel.numerics.spectra import spectral_matrix
from structsel.numerics.transfer_functions import DB, DEG
from structsel.recording import Recording, require_recordings
from structsel.recording.arguments import as_recordings
from structsel.results import Result
from structsel.tables import Column, Summary, Table

if TYPE_CHECKING:
    import pandas as pd

CYCLES = 10.0
"""Cycles of a frequency that the windows of a composite hold at least; the longest may hold fewer. Short windows
smooth a resonance: the 95 % intervals of a fitted damping of 0.45 hold in 85 % of 40 simulated sweeps with 2 cycles, in
88 % with 5, in 93 % with 10."""
LOWEST_CYCLES = 2.0
"""Cycles of the lowest default frequency in the longest window [TR12]."""
USABLE = 0.6
"""Partial coherence from which a response is usable [TR12]."""
WINDOWS = (1.0, 0.8, 0.6, 0.4, 0.2)
"""Lengths of the default windows, as fractions of the longest; [TR12] has 50, 40, 30, 20 and 10 s."""
SEGMENTS = 5.0
"""Times that the longest default window fits into all recordings together [TR12]."""
FRACTION = 0.5
"""Longest default window over the longest recording [TR12]."""
SAMPLES_PER_CYCLE = 5.0
"""Samples in a cycle of the highest default frequency [TR12]."""
_SHOWN = 12  # rows of the printed table


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponse(Result):
    """Frequency responses of o outputs to i inputs at f frequencies.

    Attributes
    ----------
    outputs, inputs : tuple of str
    omega : (f,) array [rad/s]
    response : (f, o, i) complex array [output unit / input unit]
        In SI units and radians; each with the other inputs removed.
    coherence : (f, o, i) array [-]
        Partial coherence, squared: the fraction of the power of the output, after removing what the other inputs
        explain, that this input explains linearly.
    multiple_coherence : (f, o) array [-]
        Fraction of the power of the output that all inputs explain, in the longest window.
    random_error : (f, o, i) array [-]
        One standard deviation of the magnitude over the magnitude, and of the phase in rad. Infinite where the
        recordings have no independent segments.
    window : (f, o, i) array [s]
        Length of the window, a mean of those in the composite.
    windows : tuple of float [s]
    recordings : tuple of str
    units : mapping of str to str
    doubts : tuple of str
        Warnings.
    """

    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    omega: np.ndarray
    response: np.ndarray
    coherence: np.ndarray
    multiple_coherence: np.ndarray
    random_error: np.ndarray
    window: np.ndarray
    windows: tuple[float, ...]
    recordings: tuple[str, ...]
    units: dict[str, str]
    doubts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self.freeze()

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Output and input of each response."""
        return tuple((output, given) for output in self.outputs for given in self.inputs)

    def places(self, output: str, given: str) -> tuple[int, int]:
        """Places of an output and an input on the last two axes.

        Raises
        ------
        ChannelError
            There is no such response.
        """
        if output not in self.outputs or given not in self.inputs:
            raise ChannelError(
                f"there is no frequency response of '{output}' to '{given}'.\n"
                f"Outputs: {', '.join(self.outputs)}. Inputs: {', '.join(self.inputs)}."
            )
        return self.outputs.index(output), self.inputs.index(given)

    def display_factor(self, output: str, given: str) -> tuple[float, str]:
        """Factor to the displayed unit of a response, and that unit: degrees for radians."""
        (above, top), (below, bottom) = (display_unit(unit_of(name, self.units)) for name in (output, given))
        unit = f"{top or '-'} per {bottom}" if bottom else top
        return above / below, unit

    def magnitude_db(self, output: str, given: str) -> np.ndarray:
        """(f,) magnitude in dB of the displayed units, such as deg/s per deg."""
        o, i = self.places(output, given)
        with np.errstate(divide="ignore"):
            return np.asarray(DB * np.log(self.display_factor(output, given)[0] * np.abs(self.response[:, o, i])))

    def phase_deg(self, output: str, given: str) -> np.ndarray:
        """(f,) phase [deg], continuous over frequency, within half a turn at the frequency of the highest coherence."""
        o, i = self.places(output, given)
        wrapped = np.angle(self.response[:, o, i])
        smooth = np.unwrap(wrapped)
        best = int(np.argmax(self.coherence[:, o, i]))
        return np.asarray(DEG * (smooth - smooth[best] + wrapped[best]))

    def usable_band(self, output: str, given: str, least: float = USABLE) -> tuple[float, float] | None:
        """Band [rad/s], longest in decades, with a partial coherence of at least `least`; None if there is none."""
        o, i = self.places(output, given)
        good = np.concatenate([[False], self.coherence[:, o, i] >= least, [False]])
        edges = np.flatnonzero(np.diff(good.astype(int)))
        runs = [(float(self.omega[a]), float(self.omega[b - 1])) for a, b in zip(edges[::2], edges[1::2])]
        return max(runs, key=lambda run: run[1] / run[0]) if runs else None

    def to_frame(self) -> pd.DataFrame:
        """One row for each response and frequency; columns of SI and of displayed units."""
        import pandas as pd

        parts = []
        for output, given in self.pairs:
            o, i = self.places(output, given)
            error = self.random_error[:, o, i]
            parts.append(
                pd.DataFrame(
                    {
                        "output": output,
                        "input": given,
                        "omega": self.omega,
                        "real": self.response[:, o, i].real,
                        "imag": self.response[:, o, i].imag,
                        "magnitude_dB": self.magnitude_db(output, given),
                        "phase_deg": self.phase_deg(output, given),
                        "coherence": self.coherence[:, o, i],
                        "multiple_coherence": self.multiple_coherence[:, o],
                        "magnitude_dB_std": DB * error,
                        "phase_deg_std": DEG * error,
                        "window": self.window[:, o, i],
                    }
                )
            )
        return pd.concat(parts, ignore_index=True)

    def to_dict(self) -> dict[str, Any]:
        """Everything, for JSON."""
        content: dict[str, Any] = {
            "schema": "structsel.frequency_response/1",
            "recordings": list(self.recordings),
            "windows": list(self.windows),
            "responses": [],
            "doubts": list(self.doubts),
        }
        frame = self.to_frame()
        for output, given in self.pairs:
            rows = frame[(frame["output"] == output) & (frame["input"] == given)]
            columns = {name: rows[name].tolist() for name in rows.columns[2:]}
            content["responses"].append({"output": output, "input": given, **columns})
        found: dict[str, Any] = finite_or_none(content)
        return found

    def summary(self) -> Summary:
        """Magnitude, phase, coherence and random errors at some of the frequencies."""
        columns = (
            Column("frequency", "3g", "rad/s"),
            Column("magnitude", "2f", "dB"),
            Column("+-", "2f", "dB"),
            Column("phase", "1f", "deg"),
            Column("+-", "1f", "deg"),
            Column("coherence", "3f"),
            Column("window", "3g", "s"),
        )
        rows = np.unique(np.linspace(0, self.omega.size - 1, _SHOWN).round().astype(int))
        tables = []
        for output, given in self.pairs:
            o, i = self.places(output, given)
            error = self.random_error[:, o, i]
            each = (
                self.omega, self.magnitude_db(output, given), DB * error, self.phase_deg(output, given), DEG * error,
                self.coherence[:, o, i], self.window[:, o, i],
            )  # fmt: skip
            unit = self.display_factor(output, given)[1]
            title = f"{output}/{given} [{unit}]" if unit else f"{output}/{given}"
            tables.append(Table(columns, tuple(tuple(float(x[row]) for x in each) for row in rows), title))
        partial = "partial coherence, the other inputs removed" if len(self.inputs) > 1 else "squared coherence"
        return Summary(
            "Frequency response",
            f"{count_of(len(self.pairs), 'response')} of {join_names(self.recordings)}",
            facts=(("windows [s]", ", ".join(format_number(w, 3) for w in self.windows)),),
            tables=tuple(tables),
            notes=(f"+-: one standard deviation of the random error. coherence: {partial}.",),
            warnings=self.doubts,
        )


def frequency_response(
    recordings: Recording | Sequence[Recording],
    outputs: str | Iterable[str],
    inputs: str | Iterable[str],
    *,
    band: tuple[float, float] | None = None,
    windows: Sequence[float] | None = None,
    points: int = 100,
    overlap: float = OVERLAP,
    hold_ends: bool = True,
) -> FrequencyResponse:
    """Estimate frequency responses and coherence of recorded inputs and outputs.

    Segments of all recordings are averaged; none extends over two recordings. With several inputs each response is
    conditioned: what the other inputs explain is removed first, and the coherence is the partial coherence. Several
    windows are combined at each frequency with weights that follow from their random errors.

    Parameters
    ----------
    recordings : Recording or sequence of Recording
        With the same sampling interval. Frequency sweeps are best; each recording should begin and end near trim.
    outputs, inputs : str or iterable of str
        Channels, such as ``["q", "az"]`` and ``"de"``.
    band : (low, high), optional [rad/s]
        By default from two cycles in the longest window to five samples in a cycle.
    windows : sequence of float, optional [s]
        By default five, from the longest that fits five times into all recordings and twice into the longest
        recording, down to a fifth of it.
    points : int
        Number of frequencies, evenly spaced in the logarithm.
    overlap : float
        Fraction of a segment that overlaps the next one.
    hold_ends : bool
        Extend each recording by its first and last values, so that the first and last seconds have the weight of the
        others. Recordings should begin and end near trim.

    Returns
    -------
    FrequencyResponse

    Raises
    ------
    ArgumentError
        The recordings are objects of another type.
    ChannelError, DataError
        A channel is missing or has samples that are not finite; the sampling intervals differ; a channel is both an
        input and an output.
    DomainError
        A window or a band that the recordings do not allow, or proportional inputs.

    References
    ----------
    [TR12], [BP10], [W67].
    """
    flights = as_recordings(recordings, "frequency_response(recordings, outputs, inputs)")
    made = [(name,) if isinstance(name, str) else tuple(dict.fromkeys(name)) for name in (outputs, inputs)]
    shown, driving = made
    dt = _check(flights, shown, driving)
    lengths = _window_lengths(flights, windows)
    low, high = band or (LOWEST_CYCLES * 2.0 * np.pi / max(lengths), 2.0 * np.pi / (SAMPLES_PER_CYCLE * dt))
    if not (0.0 < low < high < np.pi / dt and points >= 2):
        raise DomainError(
            f"frequency_response needs a band above zero and below the Nyquist frequency, {np.pi / dt:.4g} rad/s, and "
            f"two points or more; it has {low:.4g} to {high:.4g} rad/s and {points} points."
        )
    omega = np.geomspace(low, high, points)
    signals = [np.column_stack([r[name] for name in (*driving, *shown)]) for r in flights]
    spectra = [spectral_matrix(signals, dt, length, omega, overlap, hold_ends) for length in lengths]
    each = [condition(one, len(driving)) for one in spectra]
    found = combine_windows(each, CYCLES, omega)
    units = {name: flights[0].unit(name) for name in (*driving, *shown)}
    return FrequencyResponse(
        shown, driving, omega, found.response, found.coherence, multiple_coherence(spectra[0], len(driving)),
        found.random_error, found.window, tuple(one.window for one in spectra), tuple(r.name for r in flights), units,
        tuple(_doubts(found.coherence, shown, driving, float(np.median(each[0].independent)))),
    )  # fmt: skip


def _check(flights: Sequence[Recording], outputs: Sequence[str], inputs: Sequence[str]) -> float:
    """Sampling interval of all recordings."""
    require_recordings(flights, samples=16, by="frequency_response")
    if both := [name for name in outputs if name in inputs]:
        raise ChannelError(f"frequency_response: '{both[0]}' is both output and input. Name each channel once.")
    if not (outputs and inputs):
        raise ChannelError("frequency_response needs at least one output and one input.")
    for flight in flights:
        flight.require(*inputs, *outputs, finite=True, by="frequency_response")
    dt = flights[0].dt
    for flight in flights:
        steps = np.diff(flight.t)
        if not (np.allclose(steps, dt, rtol=0.01, atol=0.0)):
            raise DataError(
                f"frequency_response needs one sampling interval; '{flights[0].name}' has {dt:.5g} s, '{flight.name}' "
                f"{steps.min():.5g} to {steps.max():.5g} s.\nUse Recording.resample() or Recording.split() first."
            )
    return dt


def _window_lengths(flights: Sequence[Recording], given: Sequence[float] | None) -> list[float]:
    """Lengths of the windows [s], longest first."""
    if given is not None:
        if not len(given) or not all(length > 0.0 for length in given):
            raise DomainError(f"frequency_response needs windows above zero; it was given {list(given)}.")
        return sorted({float(length) for length in given}, reverse=True)
    spans = [len(r) * r.dt for r in flights]
    longest = min(FRACTION * max(spans), sum(spans) / SEGMENTS)
    return [fraction * longest for fraction in WINDOWS]


def _doubts(coherence: np.ndarray, outputs: Sequence[str], inputs: Sequence[str], independent: float) -> list[str]:
    doubts = []
    if independent <= 1.0:
        doubts.append(
            f"The longest window has {independent:.1f} independent segments: its coherence is near one whatever the "
            "data. Use shorter windows or more recordings."
        )
    for o, output in enumerate(outputs):
        for i, given in enumerate(inputs):
            if (fraction := float(np.mean(coherence[:, o, i] < USABLE))) > 0.5:
                doubts.append(
                    f"{output}/{given}: the coherence is below {USABLE:g} at {100 * fraction:.0f} % of the frequencies."
                )
    return doubts
