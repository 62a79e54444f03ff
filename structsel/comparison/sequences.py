"""Which recordings are parts of one flight, and those joined that continue each other."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from structsel.numerics.arrays import Array
from structsel.recording import Recording

_ANGLES = ("phi", "psi")
_LARGEST_STEP = 2.0
"""Times the largest step between two samples of any recording, by which a channel may step from one to the next."""
_SAME_TIME = 1e-3  # of a sampling interval
Simulated = Mapping[str, Mapping[str, Array]]


@dataclass(frozen=True)
class JoinedRecordings:
    """Recordings, those joined that continue each other.

    Attributes
    ----------
    recordings : list of Recording
    simulated : mapping of recording to mapping of response to (n,) array
    remarks : tuple of str
        Which were joined.
    """

    recordings: list[Recording]
    simulated: Simulated
    remarks: tuple[str, ...] = ()


def sequences(recordings: Sequence[Recording]) -> list[list[Recording]]:
    """Recordings of one flight, in the order in which they were flown; each sequence has at least two.

    Recordings that do not overlap in time are those of one flight. If they overlap, those that continue another one
    to the next sample belong to it.
    """
    in_order = sorted(recordings, key=lambda r: float(r.t[0]))
    if all(later.t[0] > before.t[-1] for before, later in pairwise(in_order)):
        return [in_order] if len(in_order) > 1 else []
    return [chain for chain in continued(recordings) if len(chain) > 1]


def continued(recordings: Sequence[Recording], simulated: Simulated | None = None) -> list[list[Recording]]:
    """Recordings, each of which continues the one before it; most are alone.

    One recording continues another if it begins with its next sample, and all channels go on from there, or if it
    begins within it with the same readings.

    Parameters
    ----------
    recordings : sequence of Recording
    simulated : mapping of recording to mapping of response to (n,) array, optional
        Responses that must continue as well.
    """
    stated = {r.name: (simulated or {}).get(r.name, {}) for r in recordings}
    each = {r.name: {**r.channels, **{f"simulated {c}": x for c, x in stated[r.name].items()}} for r in recordings}
    shared = [c for c in each[recordings[0].name] if all(c in x for x in each.values())]
    steps = {c: max(float(np.abs(_steps(c, x[c])).max(initial=0.0)) for x in each.values()) for c in shared}

    def distance(before: Recording, after: Recording) -> float:
        """Largest step of a channel over that within the recordings; zero if they overlap with the same readings."""
        first, last = each[before.name], each[after.name]
        if 0.0 < after.t[0] - before.t[-1] < 1.5 * before.dt:
            joint = {c: abs(float(_steps(c, np.array([first[c][-1], last[c][0]]))[0])) for c in shared}
            over = [x / steps[c] if steps[c] else np.inf for c, x in joint.items() if x or steps[c]]
            return max(over, default=np.inf)
        common = _common(before, after)
        return 0.0 if common and all(np.array_equal(first[c][-common:], last[c][:common]) for c in shared) else np.inf

    chains: list[list[Recording]] = []
    for r in sorted(recordings, key=lambda r: (float(r.t[0]), float(r.t[-1]))):
        nearest = min(chains, key=lambda chain: distance(chain[-1], r), default=[])
        if nearest and distance(nearest[-1], r) <= _LARGEST_STEP:
            nearest.append(r)
        else:
            chains.append([r])
    return chains


def join_continued(
    recordings: Sequence[Recording], simulated: Simulated, but_for: Collection[str] = ()
) -> JoinedRecordings:
    """Join the recordings that continue each other, and the responses simulated along them.

    Parameters
    ----------
    recordings : sequence of Recording
    simulated : mapping of recording to mapping of response to (n,) array
        Empty if the simulation can be evaluated anywhere.
    but_for : collection of str
        Names of recordings that stay as they are.
    """
    free = [r for r in recordings if r.name not in but_for]
    found = continued(free, simulated) if free else []
    first = {chain[0].name: chain for chain in found}
    inside = {r.name for chain in found for r in chain[1:]}
    made, along, remarks = [], dict(simulated), []
    for r in recordings:
        chain = first.get(r.name, [r])
        if r.name in inside:
            continue
        if len(chain) == 1:
            made.append(r)
            continue
        name = f"{chain[0].name} to {chain[-1].name}"
        starts = [0, *(_common(before, after) for before, after in pairwise(chain))]
        shared = [c for c in r.names if all(c in part for part in chain)]
        channels = {c: np.concatenate([part[c][k:] for part, k in zip(chain, starts)]) for c in shared}
        t = np.concatenate([part.t[k:] for part, k in zip(chain, starts)])
        at_cg = frozenset.intersection(*(part.at_cg for part in chain))
        made.append(Recording(name, t, channels, r.units, r.provenance, at_cg=at_cg))
        parts = [along.pop(part.name, {}) for part in chain]
        if parts[0]:
            along[name] = {c: np.concatenate([x[c][k:] for x, k in zip(parts, starts)]) for c in parts[0]}
        remarks.append(f"{len(chain)} recordings continue each other, and were taken as one, '{name}'")
    return JoinedRecordings(made, along, tuple(remarks))


def _steps(channel: str, x: Array) -> Array:
    """Differences of successive samples; of angles, the smaller ones about the circle."""
    made = np.diff(x)
    return np.asarray((made + np.pi) % (2.0 * np.pi) - np.pi if channel in _ANGLES else made)


def _common(before: Recording, after: Recording) -> int:
    """Samples at the end of a recording that are the first of the next one; none unless these go on beyond it."""
    if not before.t[0] < after.t[0] <= before.t[-1] < after.t[-1]:
        return 0
    count = int(np.sum(before.t >= after.t[0] - _SAME_TIME * before.dt))
    same = np.abs(before.t[-count:] - after.t[:count]) < _SAME_TIME * before.dt if count <= len(after) else [False]
    return count if np.all(same) else 0
