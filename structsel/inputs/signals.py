"""Classical inputs, each a Recording of one control on an even clock: held from each sample to the next.

Amplitudes are changes from trim, in the channel's unit; pulses begin at ``start`` and end at a sample.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from structsel.errors import DataError, DomainError
from structsel.nomenclature import UNKNOWN
from structsel.recording import Recording


def clock(duration: float, dt: float) -> np.ndarray:
    """Even clock from zero to `duration` [s], both ends in it.

    Raises
    ------
    DomainError
        A step that is not above zero, or no room for two samples.
    """
    if not (dt > 0.0 and duration >= dt and np.isfinite(duration)):
        raise DomainError(f"an input needs a step above zero and a longer duration; found dt {dt} s, {duration} s.")
    return dt * np.arange(round(duration / dt) + 1)


def whole_steps(duration: float, dt: float) -> float:
    """The duration [s] as a whole number of steps."""
    return dt * round(duration / dt)


def multistep(
    channel: str,
    amplitude: float,
    pattern: Sequence[float],
    width: float,
    *,
    start: float = 1.0,
    duration: float = 20.0,
    dt: float = 0.02,
    name: str = "multistep",
) -> Recording:
    """Pulses of alternating length, then zero.

    Parameters
    ----------
    channel : str
    amplitude : float
        Of every pulse, in the channel's unit.
    pattern : sequence of float
        Lengths in units of `width`, with sign: ``(3, -2, 1, -1)``.
    width : float [s]
        Of one unit.
    start, duration, dt : float [s]
    name : str

    Raises
    ------
    DomainError
        A pulse shorter than a sample, or an end after the record's.
    """
    t = clock(duration, dt)
    # Lengths are rounded, not edges, so that equal pulses stay equal.
    lengths = np.round(np.abs(pattern) * round(width / dt)).astype(int)
    if (lengths < 1).any():
        raise DomainError(
            f"{name}: a pulse of {width} s is shorter than a sample of {dt} s. Widen it or sample faster."
        )
    at = round(start / dt) + np.concatenate([[0], np.cumsum(lengths)])
    if at[0] < 0 or at[-1] >= len(t):
        raise DomainError(
            f"{name} on '{channel}' runs from {at[0] * dt:g} to {at[-1] * dt:g} s, the record from 0 to {t[-1]:g} s. "
            "Lengthen the record or narrow the pulses."
        )
    values = np.zeros(len(t))
    for first, last, sign in zip(at[:-1], at[1:], np.sign(pattern)):
        values[first:last] = sign * amplitude
    return Recording(name, t, {channel: values}, provenance=(f"{name}: amplitude {amplitude:g}, unit {width:g} s",))


def step(channel: str, amplitude: float, *, start: float = 1.0, duration: float = 20.0, dt: float = 0.02) -> Recording:
    """Zero, and from `start` [s] on the amplitude."""
    t = clock(duration, dt)
    if not 0.0 <= start <= t[-1]:
        raise DomainError(f"step on '{channel}' starts at {start:g} s, outside the record of {t[-1]:g} s.")
    values = np.where(np.arange(len(t)) >= round(start / dt), float(amplitude), 0.0)
    return Recording("step", t, {channel: values}, provenance=(f"step: amplitude {amplitude:g}",))


def impulse(channel: str, area: float, *, start: float = 1.0, duration: float = 20.0, dt: float = 0.02) -> Recording:
    """One sample that has the complete area [unit s]."""
    return multistep(channel, area / dt, (1,), dt, start=start, duration=duration, dt=dt, name="impulse")


def doublet(
    channel: str, amplitude: float, width: float = 1.0, *, start: float = 1.0, duration: float = 20.0, dt: float = 0.02
) -> Recording:
    """Positive for `width` [s], then negative."""
    return multistep(channel, amplitude, (1, -1), width, start=start, duration=duration, dt=dt, name="doublet")


def three_two_one_one(
    channel: str, amplitude: float, width: float = 0.5, *, start: float = 1.0, duration: float = 20.0, dt: float = 0.02
) -> Recording:
    """Pulses of 3, 2, 1 and 1 units of `width` [s], alternating."""
    pattern = (3, -2, 1, -1)
    return multistep(channel, amplitude, pattern, width, start=start, duration=duration, dt=dt, name="3-2-1-1")


def two_one_one_one(
    channel: str, amplitude: float, width: float = 0.5, *, start: float = 1.0, duration: float = 20.0, dt: float = 0.02
) -> Recording:
    """Pulses of 2, 1, 1 and 1 units of `width` [s], alternating."""
    pattern = (2, -1, 1, -1)
    return multistep(channel, amplitude, pattern, width, start=start, duration=duration, dt=dt, name="2-1-1-1")


def table(
    channel: str,
    points: Sequence[tuple[float, float]],
    *,
    between: Literal["linear", "hold"] = "linear",
    duration: float | None = None,
    dt: float = 0.02,
) -> Recording:
    """Input from a table of (time, value).

    Parameters
    ----------
    channel : str
    points : sequence of (float [s], float)
        Times not falling. Before the first and after the last the value stays.
    between : {"linear", "hold"}
        Two points at one time make a step; of them the later counts at that time.
    duration : float, optional [s]
        The last time where absent.
    dt : float [s]

    Raises
    ------
    DataError
        No points, times that fall, or numbers that are not finite.
    """
    rows = np.asarray(points, dtype=float)
    if rows.ndim != 2 or rows.shape[1] != 2 or not len(rows) or not np.isfinite(rows).all():
        raise DataError(f"table on '{channel}' needs pairs of finite (t, value); found shape {rows.shape}.")
    if (np.diff(rows[:, 0]) < 0.0).any():
        i = int(np.argmax(np.diff(rows[:, 0]) < 0.0))
        raise DataError(f"table on '{channel}': time falls after row {i}, from {rows[i, 0]:g} to {rows[i + 1, 0]:g} s.")
    t = clock(float(rows[-1, 0]) if duration is None else duration, dt)
    at = np.clip(np.searchsorted(rows[:, 0], t + 1e-9 * dt, side="right") - 1, 0, None)
    values = rows[at, 1]
    if between == "linear":
        after = np.minimum(at + 1, len(rows) - 1)
        gap = rows[after, 0] - rows[at, 0]
        fraction = np.where(gap > 0.0, (t - rows[at, 0]) / np.where(gap > 0.0, gap, 1.0), 0.0)
        values = values + np.clip(fraction, 0.0, 1.0) * (rows[after, 1] - values)
    return Recording(
        "table", t, {channel: values}, provenance=(f"table of {len(rows)} points, {between} between them",)
    )


def frequency_sweep(
    channel: str,
    amplitude: float,
    low: float,
    high: float,
    *,
    law: Literal["linear", "log"] = "log",
    start: float = 1.0,
    duration: float = 20.0,
    dt: float = 0.02,
) -> Recording:
    """Sine whose frequency runs from `low` to `high` [Hz] between `start` and the end, linearly or by octaves.

    Raises
    ------
    DomainError
        Frequencies not above zero or beyond half the sampling rate.
    """
    t = clock(duration, dt)
    if not 0.0 < min(low, high) <= max(low, high) < 0.5 / dt:
        raise DomainError(
            f"frequency_sweep needs frequencies between zero and half the sampling rate, {0.5 / dt:g} Hz; "
            f"found {low:g} to {high:g} Hz."
        )
    span = t[-1] - start
    if not span > 0.0:
        raise DomainError(f"frequency_sweep starts at {start:g} s; the record ends at {t[-1]:g} s.")
    past = np.clip(t - start, 0.0, None)
    if law == "linear" or high == low:
        cycles = low * past + 0.5 * (high - low) * past**2 / span
    else:
        rate = np.log(high / low) / span
        cycles = low * np.expm1(rate * past) / rate
    note = f"frequency sweep: {low:g} to {high:g} Hz, {law}, amplitude {amplitude:g}"
    return Recording("frequency sweep", t, {channel: amplitude * np.sin(2.0 * np.pi * cycles)}, provenance=(note,))


def combine(*inputs: Recording, name: str = "inputs") -> Recording:
    """Schedules of several controls as one; a control in more than one of them is the sum.

    Raises
    ------
    DataError
        Their clocks differ.
    """
    first = inputs[0]
    channels: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    for part in inputs:
        if len(part) != len(first) or np.abs(part.t - first.t).max() > 1e-9:
            raise DataError(
                f"combine needs one clock; '{first.name}' has {len(first)} samples over {first.duration:g} s, "
                f"'{part.name}' {len(part)} over {part.duration:g} s. Give all the same duration and dt."
            )
        units |= {c: part.unit(c) for c in part.names if part.unit(c) != UNKNOWN}
        for channel in part.names:
            channels[channel] = channels.get(channel, 0.0) + part[channel]
    return Recording(name, first.t, channels, units, tuple(note for part in inputs for note in part.provenance))


def energy(inputs: Recording, scales: Mapping[str, float] | None = None) -> float:
    """Integral of the squared inputs over time [unit^2 s], each over its scale, held from sample to sample.

    Parameters
    ----------
    inputs : Recording
    scales : mapping of str to float, optional
        What counts as one in each channel; 1 where not named.
    """
    return float(sum(((inputs[c] / (scales or {}).get(c, 1.0)) ** 2).sum() for c in inputs.names) * inputs.dt)


def with_energy(inputs: Recording, wanted: float, scales: Mapping[str, float] | None = None) -> Recording:
    """The same shape at another energy.

    Raises
    ------
    DomainError
        An input that is zero throughout.
    """
    held = energy(inputs, scales)
    if not held > 0.0:
        raise DomainError(f"'{inputs.name}' is zero throughout; no factor gives it an energy of {wanted:g}.")
    factor = float(np.sqrt(wanted / held))
    note = f"scaled by {factor:.6g} to an energy of {wanted:g}"
    made = {c: factor * inputs[c] for c in inputs.names}
    return Recording(inputs.name, inputs.t, made, inputs.units, (*inputs.provenance, note))
