"""Which samples of a recording the reconstruction can use; the samples that it cannot use are findings.

A measurement that is missing, stuck, saturated or repeated is *not sampled* there, and the filter continues without
it. The inertial readings are inputs of the filter and cannot be left out: short gaps are interpolated linearly, with
the standard deviation of the channel as the noise of the interpolated samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from structsel.errors import ChannelError, DataError
from structsel.formatting import count_of
from structsel.numerics.signal_quality import find_spikes
from structsel.recording import Finding, Recording
from structsel.recording.checks import GAP, find_gaps
from structsel.recording.repeated_values import repeated_readings, saturated_samples, stuck_intervals

WHO = "reconstruct"
LONGITUDINAL = ("ax", "az", "q")
LATERAL = ("ay", "p", "r")
_ZERO_IN_SYMMETRIC_FLIGHT = (*LATERAL, "beta", "phi", "psi", "y", "ve")
_MAX_INTERPOLATION = 2.0  # s
_SPIKE = 8.0  # standard deviations of the noise
_MIN_GAP = 0.2  # s
_MIN_SAMPLES = 20
_ON_GROUND = 0.1  # of the usual airspeed
_MAX_ON_GROUND = 0.5  # s


@dataclass(frozen=True)
class ValidatedChannel:
    """One channel as the filter uses it.

    Attributes
    ----------
    values : (n,) array
        NaN where not sampled (measurements only).
    interpolated : (n,) int array
        For interpolated samples (inertial readings only), the length of their gap in samples; otherwise 0.
    findings : tuple of Finding
    """

    values: np.ndarray
    interpolated: np.ndarray
    findings: tuple[Finding, ...]


def valid_measurement(recording: Recording, name: str) -> ValidatedChannel:
    """One measured channel, with NaN where there is no new reading of the instrument."""
    values, none = recording[name].copy(), np.zeros(len(recording), dtype=int)
    if _is_dead(name, values):
        message = f"is constant at {_first_finite(values):g} in all samples, as if the instrument were dead; not used"
        every = np.arange(len(values))
        found = [Finding.of_samples("stuck", name, message, "warning", "", recording.t, every)]
        return ValidatedChannel(np.full(len(values), np.nan), none, tuple(found))
    found = _mask_faults(recording, name, values)
    repeated = repeated_readings(values)
    if repeated.size:
        values[repeated] = np.nan
        message = f"each reading is repeated in several samples; {repeated.size} repeats are not used, first"
        found.append(Finding.of_samples("held", name, message, "note", "", recording.t, repeated))
    return ValidatedChannel(values, none, tuple(found))


def valid_input(recording: Recording, name: str) -> ValidatedChannel:
    """One inertial channel without gaps.

    Raises
    ------
    DataError
        If a gap is too long to be interpolated.
    """
    values, t = recording[name].copy(), recording.t
    needs = f"{WHO} cannot continue without '{name}' [{recording.unit(name)}]"
    if _is_dead(name, values):
        raise DataError(
            f"{needs}: in '{recording.name}' it is constant at {_first_finite(values):g} in all samples, as if the "
            "instrument were dead.\nUse another recording, or remove ay, p, r and beta together, for the longitudinal "
            "motion only."
        )
    found = _mask_faults(recording, name, values)
    spikes, _ = find_spikes(values, threshold=_SPIKE)
    if spikes.size:
        message = f"{count_of(spikes.size, 'spike sample')}, as far as {values[spikes[0]]:g}, not used; first"
        found.append(Finding.of_samples("spike", name, message, "warning", "", t, spikes))
        values[spikes] = np.nan
    missing = ~np.isfinite(values)
    interpolated = np.zeros(len(values), dtype=int)
    if not missing.any():
        return ValidatedChannel(values, interpolated, tuple(found))
    if missing.all():
        raise DataError(
            f"{WHO} needs channel '{name}' [{recording.unit(name)}]; '{recording.name}' has no reading of it."
        )
    intervals = intervals_of(missing)
    for first, last in intervals:
        if t[last] - t[first] > _MAX_INTERPOLATION:
            start, end = longest_interval(~missing)
            raise DataError(
                f"{needs}: '{recording.name}' lacks it for {t[last] - t[first]:.3g} s, from sample {first} "
                f"(t = {t[first]:g} s) to {last}{_cause(found, name)}.\n"
                f"Take a part that has it: recording.between({t[start]:g}, {t[end]:g}) is the longest."
            )
        interpolated[first : last + 1] = last - first + 1
    values[missing] = np.interp(t[missing], t[~missing], values[~missing])
    lost = np.flatnonzero(missing)
    message = f"{count_of(lost.size, 'sample')} in {count_of(len(intervals), 'gap')} interpolated linearly, first"
    found.append(Finding.of_samples("bridged", name, message, "warning", "", t, lost))
    return ValidatedChannel(values, interpolated, tuple(found))


def intervals_of(flag: np.ndarray) -> list[tuple[int, int]]:
    """First and last sample of every interval in which a flag is true."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flag, [False]))))
    return list(zip(edges[::2].tolist(), (edges[1::2] - 1).tolist()))


def longest_interval(flag: np.ndarray) -> tuple[int, int]:
    """First and last sample of the longest interval in which a flag is true; the first of several."""
    return max(intervals_of(flag), key=lambda interval: interval[1] - interval[0])


def require_inertial(recording: Recording) -> bool:
    """Refuse a recording that cannot be reconstructed; True if the lateral motion can be reconstructed, too.

    Raises
    ------
    ChannelError
        Without V, ax, az or q.
    DataError
        With a gap in time.
    """
    recording.require("V", *LONGITUDINAL, by=WHO)
    gaps = find_gaps(recording.t, max(GAP * recording.dt, _MIN_GAP))
    if gaps.size:
        i = int(gaps[0])
        raise DataError(
            f"{WHO} needs time without gaps; '{recording.name}' has no samples between {recording.t[i]:g} s (sample "
            f"{i}) and {recording.t[i + 1]:g} s ({count_of(gaps.size, 'gap')} in all).\n"
            "Use recording.split() first and reconstruct each part."
        )
    if len(recording) < _MIN_SAMPLES:
        raise DataError(
            f"{WHO} needs at least {_MIN_SAMPLES} samples; '{recording.name}' has {len(recording)}.\n"
            "Use a complete manoeuvre."
        )
    _refuse_on_ground(recording)
    lateral = [name for name in LATERAL if name in recording]
    if "beta" in recording and lateral and len(lateral) < len(LATERAL):
        missing = [name for name in LATERAL if name not in recording]
        raise ChannelError(
            f"{WHO} needs ax ay az p q r for the lateral motion; '{recording.name}' has no {' and '.join(missing)}.\n"
            f"Map {'it' if len(missing) == 1 else 'them'}, or remove {', '.join(lateral)} and beta, "
            "for the longitudinal motion only."
        )
    return len(lateral) == len(LATERAL)


def _refuse_on_ground(recording: Recording) -> None:
    """Refuse a recording that includes time on the ground: there are no air data there."""
    V, t = recording["V"], recording.t
    finite = np.isfinite(V)
    if finite.sum() < 2 or _is_dead("V", V):
        value = f"constant at {_first_finite(V):g}" if finite.any() else "missing"
        raise DataError(
            f"{WHO} needs channel 'V' [m/s]; in '{recording.name}' it is {value} in all samples.\n"
            "Check that the instrument was recorded."
        )
    slow = finite & (_ON_GROUND * float(np.percentile(V[finite], 75)) > V)
    if slow.sum() * recording.dt > _MAX_ON_GROUND:
        i = int(np.flatnonzero(slow)[0])
        first, last = longest_interval(~slow)
        raise DataError(
            f"{WHO} needs air data of a flight; V of '{recording.name}' is {V[i]:.3g} m/s at sample {i} (t = {t[i]:g} "
            f"s), and below a tenth of its usual value in {slow.sum()} samples.\n"
            f"Use the part in flight: recording.between({t[first]:g}, {t[last]:g})."
        )


def _is_dead(name: str, values: np.ndarray) -> bool:
    """Whether the channel is constant, except for lateral channels that are zero in a longitudinal simulation."""
    finite = values[np.isfinite(values)]
    if not finite.size or finite.min() != finite.max():
        return False
    return finite[0] != 0.0 or name not in _ZERO_IN_SYMMETRIC_FLIGHT


def _first_finite(values: np.ndarray) -> float:
    return float(values[np.isfinite(values)][0])


def _mask_faults(recording: Recording, name: str, values: np.ndarray) -> list[Finding]:
    """Replace samples that are missing, stuck or saturated by NaN; return the findings."""
    found, t = [], recording.t
    lost = np.flatnonzero(~np.isfinite(values))
    if 0 < lost.size < len(values):
        values[lost] = np.nan
        message = f"missing in {lost.size} of {len(values)} samples, first"
        found.append(Finding.of_samples("missing", name, message, "note", "", t, lost))
    saturated = saturated_samples(values)
    stuck = np.zeros(len(values), dtype=bool)
    for first, end in stuck_intervals(t, values):
        stuck[first:end] = not saturated[first:end].any()
    for kind, lost in (("stuck", np.flatnonzero(stuck)), ("saturated", np.flatnonzero(saturated))):
        if lost.size:
            message = f"{kind} at {values[lost[0]]:g} in {lost.size} samples, not used there; first"
            found.append(Finding.of_samples(kind, name, message, "warning", "", t, lost))
            values[lost] = np.nan
    return found


def _cause(found: list[Finding], name: str) -> str:
    """Faults of the channel that are the cause of its gaps, in parentheses."""
    kinds = [f.kind for f in found if f.channel == name and f.kind in ("stuck", "saturated")]
    return f" ({' and '.join(kinds)})" if kinds else ""
