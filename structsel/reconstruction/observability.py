"""Reconstructibility: which states a set of sensors and a manoeuvre determine, before the filter is run.

The sensitivities of all sampled measurements along the recorded path are divided by the noise of the measurements and
multiplied by the prior standard deviations. A singular value s reduces the prior standard deviation along its direction
by the factor 1 / sqrt(1 + s^2). A flight is divided into segments of at most a minute: each has its own motion, which
is eliminated, and all have the same constants. Noise of the inputs and drifting biases are not included, so the
verdicts are an upper bound.

References
----------
[M86] for linear and nonlinear reconstructibility.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from structsel.deprecation import renamed_attribute
from structsel.errors import DomainError
from structsel.formatting import count_of
from structsel.numerics.kinematics import MEASUREMENTS, MOTION, STATES
from structsel.reconstruction.fixed_states import CBETA0_REASON, reason_for_fixing
from structsel.reconstruction.kinematics_problem import KinematicsProblem
from structsel.reconstruction.path_sensitivity import recorded_inputs, recorded_path, segments_of, sensitivity_factor

FIX_FIRST = (
    # Most instruments have no scale error that matters; gravity calibrates accelerometers best.
    *("Kax", "Kay", "Kaz", "Kp", "Kq", "Kr", "Ktheta", "Kphi"),
    # Small where the airspeed is calibrated; and vertical wind has no steady mean.
    *("KV", "wd"),
    # Vanes: scales and offsets are known from the ground or from theory better than biases are.
    *("Csi", "Calpha0", "Cup"),
    # Without a reference to the ground, wind and heading change nothing else that is sought.
    *("wn", "we", "psi", "x", "y"),
    # Biases are why a path is reconstructed; those of gyros can be read before take-off.
    *("br", "bp", "bq", "bay", "bax", "baz"),
)
"""States that are fixed, in this order, if not all can be determined. Cbeta0 always is, the motion u to h never."""

_FREE = 1e-3  # weight of the prior on the motion of a segment that is eliminated
_WEAK = 1.0 / 3.0  # posterior over prior standard deviation
_NO_INFORMATION = 0.95  # the same ratio, along a direction on which the data have almost no information
_UNDETERMINED = np.sqrt(_NO_INFORMATION**-2 - 1.0)  # singular value
_MIN_WEIGHT = 0.1  # in a unit direction, above which a state belongs to it


@dataclass(frozen=True, eq=False)
class Reconstructibility:
    """Which states these sensors and this manoeuvre determine: an upper bound.

    Attributes
    ----------
    requested : tuple of str
        States to be estimated.
    verdicts : mapping of str to str
        Of each requested state: "reconstructible"; "weak" (posterior over prior standard deviation above a third);
        "not reconstructible" (and most of this is along directions on which the data have no information).
        The verdicts apply before any state except Cbeta0 is fixed.
    posterior_over_prior : mapping of str to float [-]
        Of their standard deviations; for the motion, at the start of the segment with the most information.
    fixed : mapping of str to str
        States that are fixed so that the others are determined, in the order of the choice, with the reasons.
    active : tuple of str
        The other states.
    active_over_prior : mapping of str to float [-]
        As `posterior_over_prior`, for the active states when the others are fixed.
    rank, condition : int, float [-]
        Of the sensitivities along the path, to the requested states without Cbeta0.
    linear_rank, linear_condition : int, float [-]
        The same with the path and the inputs constant at their means.
    active_condition : float [-]
        Along the path, for the active states.
    confounded : tuple of (tuple of str, (k,) array)
        Directions on which the data have almost no information: states, and their weights in a unit direction, in
        units of the prior standard deviations, largest first; weights below 0.1 are left out.
    undetermined : tuple of str
        Active states that belong to such a direction; none of them may be fixed.
    segments : int
    notes : tuple of str
        Assumptions about the part of the path that was not recorded.
    """

    requested: tuple[str, ...]
    verdicts: Mapping[str, str]
    posterior_over_prior: Mapping[str, float]
    fixed: Mapping[str, str]
    active: tuple[str, ...]
    active_over_prior: Mapping[str, float]
    rank: int
    condition: float
    linear_rank: int
    linear_condition: float
    active_condition: float
    confounded: tuple[tuple[tuple[str, ...], np.ndarray], ...]
    undetermined: tuple[str, ...]
    segments: int
    notes: tuple[str, ...]
    asked = renamed_attribute("requested")
    stretches = renamed_attribute("segments")

    @property
    def index(self) -> np.ndarray:
        """The active states, as indices of `kinematics.STATES`."""
        return np.array([STATES.index(name) for name in self.active], dtype=int)

    def __str__(self) -> str:
        count = len(self.requested) - ("Cbeta0" in self.requested)
        lines = [
            f"Along the path ({count_of(self.segments, 'segment')}): rank {self.rank} of {count}, condition "
            f"{self.condition:.2g}",
            f"Linearised at its mean: rank {self.linear_rank} of {count}, condition {self.linear_condition:.2g}",
            f"With {len(self.fixed)} of {len(self.requested)} fixed: condition {self.active_condition:.2g}",
            "An upper bound: noise of the inputs and drifting biases are not included.",
            "",
            f"{'state':8s} {'posterior/prior':>15s} {'others fixed':>13s}  verdict",
        ]
        for name in self.requested:
            after = f"{self.active_over_prior[name]:.2g}" if name in self.active_over_prior else "fixed"
            lines.append(f"{name:8s} {self.posterior_over_prior[name]:15.2g} {after:>13s}  {self.verdicts[name]}")
        by_reason: dict[str, list[str]] = {}
        for name, reason in self.fixed.items():
            by_reason.setdefault(reason, []).append(name)
        paragraphs = [f"{', '.join(names)}: {reason}." for reason, names in by_reason.items()]
        if paragraphs:
            lines += ["", "Fixed"]
        if self.undetermined:
            paragraphs.append(f"Undetermined, but not to be fixed: {', '.join(self.undetermined)}.")
        for paragraph in (*paragraphs, *self.notes):
            lines += textwrap.wrap(paragraph, 78, initial_indent="  ", subsequent_indent="    ")
        return "\n".join(lines)


def reconstructibility(problem: KinematicsProblem, *, fix_first: Sequence[str] = FIX_FIRST) -> Reconstructibility:
    """Find which states, biases and winds a flight determines, and which to fix so that the others are determined.

    Parameters
    ----------
    problem : KinematicsProblem
        As for the filter; `start_std` are the priors.
    fix_first : sequence of str
        States of `FIX_FIRST`; if there is a choice, an earlier one is fixed. States that are not named follow in the
        order of `FIX_FIRST`. wn and we are fixed together, unless only one of them is undetermined.

    Returns
    -------
    Reconstructibility
        If the ground track is measured, a fixed psi means its *initial value*: the heading remains a state, with a
        small `start_std`.

    Raises
    ------
    DomainError
        An unknown name in `fix_first`, no two samples without a gap between them, or no airspeed.

    References
    ----------
    [M86]
    """
    unknown = [name for name in fix_first if name not in FIX_FIRST]
    if unknown:
        raise DomainError(f"reconstructibility cannot fix {unknown[0]!r} at will. It can fix: {', '.join(FIX_FIRST)}.")
    active = problem.active[problem.active != STATES.index("Cbeta0")]
    std = problem.start_std[problem.active != STATES.index("Cbeta0")]
    names = [STATES[j] for j in active]
    segments = segments_of(problem.t)
    path, notes = recorded_path(problem, segments)
    inputs = recorded_inputs(problem, segments)
    factors = np.stack([sensitivity_factor(problem, path, inputs, segment, active, std) for segment in segments])
    # The prior of the motion is used once: in the segment with the most information on it.
    best = int(np.argmax(np.linalg.slogdet(np.swapaxes(factors, 1, 2) @ factors + np.eye(len(active)))[1]))
    mean, steady = (np.broadcast_to(part.mean(axis=0), part.shape) for part in (path, inputs))
    alone = sensitivity_factor(problem, mean, steady, segments[best], active, std)
    data = _PathInformation(factors, active < MOTION, best)
    linear = _PathInformation(np.broadcast_to(alone, factors.shape), active < MOTION, best)

    everything = list(range(len(active)))
    s, V = data.directions(everything)
    s_linear = linear.directions(everything)[0]
    ratio, verdict = _verdicts(s, V)
    sampled = {name for name, seen in zip(MEASUREMENTS, np.isfinite(problem.measurements).any(axis=0)) if seen}
    order = dict.fromkeys((*fix_first, *FIX_FIRST))
    fixed, kept, confounded = _choose(data, names, tuple(order), sampled)
    left, directions = data.directions(kept)
    null = directions[:, left < _UNDETERMINED]
    confounded += [_named([names[j] for j in kept], column) for column in null.T]
    undetermined = tuple(names[j] for j, row in zip(kept, null) if np.linalg.norm(row) > _MIN_WEIGHT)
    ratios, verdicts = dict(zip(names, ratio)), dict(zip(names, verdict))
    if len(active) < len(problem.active):
        fixed = {"Cbeta0": CBETA0_REASON} | fixed
        ratios["Cbeta0"], verdicts["Cbeta0"] = 1.0, "not reconstructible"
    requested = tuple(STATES[j] for j in problem.active)
    return Reconstructibility(
        requested=requested,
        verdicts={name: verdicts[name] for name in requested},
        posterior_over_prior={name: float(ratios[name]) for name in requested},
        fixed=fixed,
        active=tuple(names[j] for j in kept),
        active_over_prior=dict(zip((names[j] for j in kept), _verdicts(left, directions)[0].tolist())),
        rank=int(np.sum(s >= _UNDETERMINED)),
        condition=_condition(s),
        linear_rank=int(np.sum(s_linear >= _UNDETERMINED)),
        linear_condition=_condition(s_linear),
        active_condition=_condition(left),
        confounded=tuple(confounded),
        undetermined=undetermined,
        segments=len(segments),
        notes=notes,
    )


@dataclass(frozen=True)
class _PathInformation:
    """Triangular factors (N, L, L) of all segments, columns of the motion, and the segment whose motion is kept."""

    factors: np.ndarray
    moving: np.ndarray
    best: int

    def directions(self, kept: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """Singular values of the data's sensitivity to some states, and (k, k) directions as columns."""
        columns = np.asarray(kept, dtype=int)
        m = int(self.moving[columns].sum())
        R = self.factors[:, :, columns]
        others = np.delete(R, self.best, axis=0)
        stays = [R[self.best]]
        if len(others):
            free = np.zeros((len(others), m, len(columns)))
            free[:, np.arange(m), np.arange(m)] = _FREE
            triangular: np.ndarray = np.linalg.qr(np.concatenate([others, free], axis=1), mode="r")  # type: ignore[assignment]
            rest = np.zeros((len(others), len(columns) - m, len(columns)))
            rest[:, :, m:] = triangular[:, m:, m:]
            stays.append(rest.reshape(-1, len(columns)))
        _, s, Vt = np.linalg.svd(np.concatenate(stays), full_matrices=False)
        return s, Vt.T


def _verdicts(s: np.ndarray, V: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Posterior over prior standard deviation of each state, and its verdict."""
    parts = V**2 / (1.0 + s**2)
    variance, undetermined = parts.sum(axis=1), parts[:, s < _UNDETERMINED].sum(axis=1)
    verdicts = []
    for total, part in zip(variance, undetermined):
        if total <= _WEAK**2:
            verdicts.append("reconstructible")
        else:
            verdicts.append("not reconstructible" if part > 0.5 * total else "weak")
    return np.sqrt(variance), verdicts


def _condition(s: np.ndarray) -> float:
    return float(s[0] / s[-1]) if s.size and s[-1] > s[0] * np.finfo(float).eps else float("inf")


def _named(names: Sequence[str], direction: np.ndarray) -> tuple[tuple[str, ...], np.ndarray]:
    """States of a unit direction with their weights, largest first."""
    order = [j for j in np.argsort(-np.abs(direction)) if abs(direction[j]) > _MIN_WEIGHT]
    weights = direction[order]
    weights.setflags(write=False)
    return tuple(names[j] for j in order), weights


def _groups(order: Sequence[str], names: Mapping[str, int], alone: np.ndarray) -> Iterator[tuple[tuple[str, ...], int]]:
    """States that may be fixed, in order, and the number of directions that this must determine."""
    both = waiting = "wn" in names and "we" in names
    for name in order:
        if waiting and name.startswith("b"):
            # Both, if one direction of them is undetermined and no heading can be fixed instead; before any bias.
            yield ("wn", "we"), 1
            waiting = False
        if name in names and not (both and name in ("wn", "we")):
            yield (name,), 1
        elif name in names:
            # One component of the wind is fixed alone only if the other is determined.
            yield ("wn", "we"), 2
            if alone[names[name]] > _NO_INFORMATION:
                yield (name,), 1


def _choose(
    data: _PathInformation, names: Sequence[str], order: Sequence[str], sampled: set[str]
) -> tuple[dict[str, str], list[int], list[tuple[tuple[str, ...], np.ndarray]]]:
    """Fix states until none of the others belongs to an undetermined direction."""
    fixed: dict[str, str] = {}
    confounded: list[tuple[tuple[str, ...], np.ndarray]] = []
    kept = list(range(len(names)))
    while True:
        s, V = data.directions(kept)
        null = V[:, s < _UNDETERMINED]
        count = null.shape[1]
        here = {names[j]: i for i, j in enumerate(kept)}
        for group, needed in _groups(order, here, np.linalg.norm(null, axis=1)) if count else ():
            without = [j for j in kept if names[j] not in group]
            if without and count - int(np.sum(data.directions(without)[0] < _UNDETERMINED)) >= needed:
                break
        else:
            return fixed, kept, confounded
        for name in group:
            # The undetermined direction nearest to this state, and the states that are not separated from it.
            direction = null @ null[here[name]]
            direction /= np.linalg.norm(direction)
            confounded.append(_named([names[j] for j in kept], direction))
            partners = [other for other in confounded[-1][0] if other not in group]
            fixed[name] = reason_for_fixing(name, partners, sampled)
        kept = without
