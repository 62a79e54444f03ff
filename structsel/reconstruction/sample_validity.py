"""Which samples of a recording the reconstruction can lean on; what it must do without, it names.

A measurement that is missing, stuck, saturated or merely held is *not sampled* there, and the filter goes on
without it. The inertial readings drive the filter and cannot be left out: short holes are bridged by straight
lines, and the filter is told to trust the bridge no more than the channel's own spread.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from structsel.errors import ChannelError, DataError
from structsel.numerics.signal_quality import find_spikes
from structsel.recording import Finding, Recording
from structsel.recording.checks import GAP, run_lengths, stuck_stretches

WHO = "reconstruct"
LONGITUDINAL = ("ax", "az", "q")
LATERAL = ("ay", "p", "r")
_AT_REST = (*LATERAL, "beta", "phi", "psi", "y", "ve")
_LONGEST_BRIDGE = 2.0  # s
_FEWEST_HELD, _LONGEST_HELD = 0.3, 4.0  # share of repeats; longest run over the usual one
_FEWEST_CLIPPED = 4  # samples on the limit
_SPIKE = 8.0  # standard deviations of the noise
_SHORTEST_GAP = 0.2  # s
_STANDING = 0.1  # of the usual airspeed
_HEAP = 5.0  # times as many samples as on the values next to it make a limit
_CLIPPED_APART = 10  # samples on the limit closer than this are one stretch
_LONGEST_REPEAT = 12  # samples of one value in a row, under noise above the resolution (chance: below 1e-6)


@dataclass(frozen=True)
class ValidatedChannel:
    """One channel, made fit for the filter.

    Attributes
    ----------
    values : (n,) array
        NaN where not sampled (measurements only).
    bridged : (n,) int array
        0, or for samples that were made up (inertial readings only) how many there are in a row.
    findings : tuple of Finding
    """

    values: np.ndarray
    bridged: np.ndarray
    findings: tuple[Finding, ...]


def valid_measurement(recording: Recording, name: str) -> ValidatedChannel:
    """One measured channel with NaN wherever the instrument did not really say anything."""
    values = recording[name].copy()
    if _is_dead(name, values):
        level = values[np.isfinite(values)][0]
        message = f"stands at {level:g} throughout, as if its instrument were dead; not used"
        return ValidatedChannel(
            np.full(len(values), np.nan),
            np.zeros(len(values), dtype=int),
            (Finding("stuck", name, message, "warning", "", 0, float(recording.t[0]), len(values)),),
        )
    found = list(_mask_faults(recording, name, values))
    held = _held(values)
    if held.size:
        values[held] = np.nan
        message = f"each reading stands for several samples; {held.size} repeats are not counted as readings, first"
        found.append(_finding("held", name, message, recording, held, "note"))
    return ValidatedChannel(values, np.zeros(len(values), dtype=int), tuple(found))


def valid_input(recording: Recording, name: str) -> ValidatedChannel:
    """One inertial channel without holes.

    Raises
    ------
    DataError
        Where a hole is too long to be bridged.
    """
    values = recording[name].copy()
    if _is_dead(name, values):
        level = values[np.isfinite(values)][0]
        raise DataError(
            f"{WHO} cannot go on without '{name}' [{recording.unit(name)}]: in '{recording.name}' it stands at "
            f"{level:g} throughout, from sample 0, as if its instrument were dead.\n"
            "Take another recording, or for ay, p, r and beta leave them all out, for the longitudinal motion alone."
        )
    found = list(_mask_faults(recording, name, values))
    spikes, _ = find_spikes(values, threshold=_SPIKE)
    if spikes.size:
        message = f"{spikes.size} spike samples, as far as {values[spikes[0]]:g}, not used; first"
        found.append(_finding("spike", name, message, recording, spikes, "warning"))
        values[spikes] = np.nan
    missing = ~np.isfinite(values)
    bridged = np.zeros(len(values), dtype=int)
    if not missing.any():
        return ValidatedChannel(values, bridged, tuple(found))
    t = recording.t
    good = np.flatnonzero(~missing)
    if not good.size:
        raise DataError(
            f"{WHO} needs channel '{name}' [{recording.unit(name)}]; '{recording.name}' has no reading of it."
        )
    edges = np.concatenate(([-1], good, [len(values)]))
    holes = np.flatnonzero(np.diff(edges) > 1)
    for k in holes:
        first, last = int(edges[k]) + 1, int(edges[k + 1]) - 1
        if t[last] - t[first] > _LONGEST_BRIDGE:
            kept = _longest_between(t, missing)
            raise DataError(
                f"{WHO} cannot go on without '{name}' [{recording.unit(name)}]: '{recording.name}' lacks it for "
                f"{t[last] - t[first]:.3g} s, from sample {first} (t = {t[first]:g} s) to {last}"
                f"{_why(found, name)}.\nTake a part that has it: recording.between({kept[0]:g}, {kept[1]:g}) "
                "is the longest."
            )
        bridged[first : last + 1] = last - first + 1
    values[missing] = np.interp(t[missing], t[good], values[good])
    lost = np.flatnonzero(missing)
    message = (
        f"{lost.size} samples in {holes.size} hole{'s' if holes.size > 1 else ''} bridged by straight lines, first"
    )
    found.append(_finding("bridged", name, message, recording, lost, "warning"))
    return ValidatedChannel(values, bridged, tuple(found))


def require_inertial(recording: Recording) -> bool:
    """Refuse a recording nothing can be reconstructed from; True where the lateral motion can be, too.

    Raises
    ------
    ChannelError
        Without V, ax, az or q.
    DataError
        With a gap in time.
    """
    recording.require("V", *LONGITUDINAL, by=WHO)
    step = np.diff(recording.t)
    gaps = np.flatnonzero(step > max(GAP * recording.dt, _SHORTEST_GAP))
    if gaps.size:
        i = int(gaps[0])
        raise DataError(
            f"{WHO} needs a clock without gaps; '{recording.name}' has no samples between {recording.t[i]:g} s (sample "
            f"{i}) and {recording.t[i + 1]:g} s ({gaps.size} gap{'s' if gaps.size > 1 else ''} in all).\n"
            "Use recording.split() first and reconstruct each part."
        )
    if len(recording) < _FEWEST_SAMPLES:
        raise DataError(
            f"{WHO} needs at least {_FEWEST_SAMPLES} samples; '{recording.name}' has {len(recording)}.\n"
            "Give it a whole manoeuvre."
        )
    _refuse_standing(recording)
    lateral = [name for name in LATERAL if name in recording]
    if "beta" in recording and lateral and len(lateral) < len(LATERAL):
        missing = [name for name in LATERAL if name not in recording]
        raise ChannelError(
            f"{WHO} needs ax ay az p q r for the lateral motion; '{recording.name}' has no {' and '.join(missing)}.\n"
            f"Map {'it' if len(missing) == 1 else 'them'}, or leave {', '.join(lateral)} and beta out, "
            "for the longitudinal motion alone."
        )
    return len(lateral) == len(LATERAL)


_FEWEST_SAMPLES = 20


def _refuse_standing(recording: Recording) -> None:
    """Refuse a recording that was begun, or not ended, on the ground: there are no air data there."""
    V, t = recording["V"], recording.t
    seen = np.isfinite(V)
    if seen.sum() < 2 or _is_dead("V", V):
        found = f"{V[seen][0]:g} throughout" if seen.any() else "missing throughout"
        raise DataError(
            f"{WHO} needs channel 'V' [m/s]; in '{recording.name}' it is {found}, from sample 0.\n"
            "Look whether the instrument was recorded."
        )
    slow = seen & (_STANDING * float(np.percentile(V[seen], 75)) > V)
    if slow.sum() * recording.dt > 0.5:
        i = int(np.flatnonzero(slow)[0])
        kept = _longest_between(t, slow)
        raise DataError(
            f"{WHO} needs air data of a flight; V of '{recording.name}' is {V[i]:.3g} m/s at sample {i} (t = {t[i]:g} "
            f"s), and below a tenth of its usual value in {slow.sum()} samples.\n"
            f"Take the flight alone: recording.between({kept[0]:g}, {kept[1]:g})."
        )


def _is_dead(name: str, values: np.ndarray) -> bool:
    """Whether the channel never moves; one that a simulation of the longitudinal motion holds at zero may."""
    finite = values[np.isfinite(values)]
    if not finite.size or finite.min() != finite.max():
        return False
    return finite[0] != 0.0 or name not in _AT_REST


def _mask_faults(recording: Recording, name: str, values: np.ndarray) -> list[Finding]:
    """Put NaN where the instrument was missing, stuck or saturated."""
    found = []
    lost = np.flatnonzero(~np.isfinite(values))
    if 0 < lost.size < len(values):
        values[lost] = np.nan
        message = f"missing in {lost.size} of {len(values)} samples, first"
        found.append(_finding("missing", name, message, recording, lost, "note"))
    clipped = _clipped(values)
    standing = [(a, b) for a, b in _standing(recording.t, values) if not clipped[a:b].any()]
    stuck = np.zeros(len(values), dtype=bool)
    for first, last in standing:
        stuck[first:last] = True
    for kind, lost in (("stuck", np.flatnonzero(stuck)), ("saturated", np.flatnonzero(clipped))):
        if lost.size:
            message = f"{kind} at {values[lost[0]]:g} in {lost.size} samples, not used there; first"
            found.append(_finding(kind, name, message, recording, lost, "warning"))
            values[lost] = np.nan
    return found


def _standing(t: np.ndarray, values: np.ndarray) -> list[tuple[int, int]]:
    """Stretches on which the channel stands still though its instrument works elsewhere."""
    found = set(stuck_stretches(t, values))
    starts, lengths = run_lengths(values)
    usual = float(np.median(lengths))
    if _is_noisy(values[starts]) and np.percentile(lengths, 95) <= 2.0 * usual:
        # Noise above the resolution repeats a value now and then, never so often in a row.
        long = lengths >= _LONGEST_REPEAT * usual
        found |= {(int(i), int(i + k)) for i, k in zip(starts[long], lengths[long])}
    return sorted(found)


def _clipped(values: np.ndarray) -> np.ndarray:
    """(n,) bool, samples on which the channel had come to the end of its range.

    Noise leaves the largest and the smallest value to one sample, or few: a heap of samples on one of them is a
    limit. A channel without noise rests on its extremes at smooth turning points, but comes and goes by its
    smallest step then; a limit it enters and leaves at a run.
    """
    clipped = np.zeros(len(values), dtype=bool)
    finite = values[np.isfinite(values)]
    if finite.size < 20 or finite.min() == finite.max():
        return clipped
    starts, lengths = run_lengths(values)
    usual = float(np.median(lengths))
    noisy = _is_noisy(values[starts])
    levels, counts = np.unique(finite, return_counts=True)
    for level, count, next_counts in ((levels[0], counts[0], counts[1:4]), (levels[-1], counts[-1], counts[-4:-1])):
        at = np.flatnonzero(values == level)
        runs = np.split(at, np.flatnonzero(np.diff(at) > 1) + 1)
        if len(runs) == 1 and runs[0].size >= _LONGEST_REPEAT * usual:
            continue  # once and for long: stuck
        if noisy and count >= _FEWEST_CLIPPED * usual and count > _HEAP * next_counts.max():
            # Between and beside samples on the limit stand those that only noise kept from it.
            for run in np.split(at, np.flatnonzero(np.diff(at) > _CLIPPED_APART * usual) + 1):
                clipped[max(0, run[0] - 2) : run[-1] + 3] = True
        elif not noisy and usual == 1.0:
            for run in runs:
                if run.size >= _FEWEST_CLIPPED and _at_a_run(values, int(run[0]), int(run[-1])):
                    clipped[run] = True
    return clipped


def _at_a_run(values: np.ndarray, first: int, last: int) -> bool:
    """Whether the steps into and out of a stretch are as large as the channel's usual ones."""
    steps = np.abs(np.diff(values))
    moves = steps[np.isfinite(steps) & (steps > 0.0)]
    least = max(float(np.median(moves)), 3.0 * float(moves.min()))
    return all(steps[i] >= least for i in (first - 1, last) if 0 <= i < len(steps))


def _is_noisy(values: np.ndarray) -> bool:
    """Whether noise larger than the resolution rides on the channel.

    Fourth differences of white noise change sign in 80 % of samples, those of a motion seldom.
    """
    finite = values[np.isfinite(values)]
    rough = np.diff(finite, 4)
    rough = rough[rough != 0.0]
    if rough.size < 40:
        return False
    steps = np.abs(np.diff(finite))
    level = 1.4826 * float(np.median(np.abs(rough))) / np.sqrt(70.0)  # variance of fourth differences: 70 sigma^2
    return bool(np.mean(rough[1:] * rough[:-1] < 0.0) > 0.65 and level >= steps[steps > 0.0].min())


def _held(values: np.ndarray) -> np.ndarray:
    """Samples that only repeat the reading before, in a channel slower than the clock."""
    finite = np.isfinite(values)
    if finite.sum() < 20:
        return np.empty(0, dtype=int)
    starts, lengths = run_lengths(values)
    usual = float(np.median(lengths))
    repeats = 1.0 - len(starts) / len(values)
    # A coarse but slow channel also repeats, though not in runs of about one length.
    if usual < 2.0 or repeats < _FEWEST_HELD or np.percentile(lengths, 95) > _LONGEST_HELD * usual:
        return np.empty(0, dtype=int)
    first = np.zeros(len(values), dtype=bool)
    first[starts] = True
    return np.flatnonzero(~first & finite)


def _finding(kind: str, name: str, message: str, recording: Recording, samples: np.ndarray, severity: str) -> Finding:
    i = int(samples[0])
    return Finding(kind, name, message, severity, "", i, float(recording.t[i]), int(samples.size))


def _longest_between(t: np.ndarray, missing: np.ndarray) -> tuple[float, float]:
    bad = np.flatnonzero(missing)
    edges = np.concatenate(([-1], bad, [len(t)]))
    k = int(np.argmax(np.diff(edges)))
    return float(t[edges[k] + 1]), float(t[edges[k + 1] - 1])


def _why(found: list[Finding], name: str) -> str:
    kinds = [f.kind for f in found if f.channel == name and f.kind in ("stuck", "saturated")]
    return f" ({' and '.join(kinds)})" if kinds else ""
