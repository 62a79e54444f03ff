"""What a set of sensors and a manoeuvre can determine of a flight path, before any filter is run.

The sensitivities of all sampled measurements, along the recorded path, are whitened by the noise of the
measurements and scaled by the prior standard deviations, so a singular value s leaves 1 / sqrt(1 + s^2) of the
prior standard deviation along its direction. A flight is cut into stretches of at most a minute: each has its own
motion, which is eliminated, and all share the constants.
Noise of the inputs and drifting biases are not counted, so the verdicts are an upper bound.

References
----------
[M86] for linear and nonlinear reconstructibility.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from structsel.errors import DomainError
from structsel.numerics.kinematics import MEASUREMENTS, MOTION, STATES
from structsel.reconstruction.path_sensitivity import recorded_path, sensitivity_factor, stretches_of
from structsel.reconstruction.ukf import KinematicsProblem

FIX_FIRST = (
    # Small where the airspeed is calibrated; and vertical wind has no steady mean.
    *("KV", "wd"),
    # Vanes: scales and offsets are known from the ground or from theory better than biases are.
    *("Csi", "Calpha0", "Cup"),
    # Without a reference to the ground, wind and heading change nothing else that is sought.
    *("wn", "we", "psi", "x", "y"),
    # Biases are why a path is reconstructed; those of gyros can be read before take-off.
    *("br", "bp", "bq", "bay", "bax", "baz"),
)
"""What is fixed, first to last, where not all can be determined. Cbeta0 always is; the motion u to h never."""

_FREE = 1e-3  # weight of the prior on the motion of a stretch that is eliminated
_WEAK = 1.0 / 3.0  # posterior over prior standard deviation
_NOTHING = 0.95  # the same along a direction the data say next to nothing about
_UNDETERMINED = np.sqrt(_NOTHING**-2 - 1.0)  # singular value
_SHARE = 0.1  # of a unit direction, for a state to be named with it

_CBETA0 = (
    "never observable in flight [M86]: an offset of the sideslip vane reads like a steady sideslip and a side "
    "force bias; set it on the ground"
)
# State: channels that show it, what is said when none of them was sampled, what would tell it from others.
_ADVICE: dict[str, tuple[tuple[str, ...], str, str]] = {
    "KV": (("V",), "no airspeed was sampled", "record vn, ve (or x, y) and turn through all headings"),
    "wd": (
        ("h", "vd"),
        "without height or vertical ground velocity nothing shows a vertical wind; record h or vd",
        "a steady vertical wind reads like an offset of the angle of attack; set Calpha0, or fly at different speeds",
    ),
    "Csi": (("beta",), "no sideslip vane was sampled", "fly rudder doublets and steady sideslips; record phi"),
    "Calpha0": (
        ("alpha",),
        "no angle-of-attack vane was sampled",
        "record theta and h (or vd), and fly at different speeds and load factors",
    ),
    "Cup": (
        ("alpha",),
        "no angle-of-attack vane was sampled",
        "fly over a wider range of angle of attack, at different speeds",
    ),
    **dict.fromkeys(
        ("wn", "we"),
        (
            ("x", "y", "vn", "ve"),
            "without position or ground velocity nothing tells wind from airspeed; record x, y or vn, ve",
            "record x and y, or vn and ve, and psi; turn through all headings",
        ),
    ),
    "psi": (
        ("psi", "x", "y", "vn", "ve"),
        "without heading, position or ground velocity nothing shows it; record psi",
        "without a heading measurement it shows only in the ground track; record psi, or turn",
    ),
    **{name: ((name,), f"no position was sampled; record {name}", f"record {name}") for name in ("x", "y")},
    "br": ((), "", "record psi, or beta and ground velocity; turn"),
    "bp": ((), "", "record phi"),
    "bq": ((), "", "record theta, or alpha and h"),
    "bay": ((), "", "record phi and beta; fly steady sideslips"),
    "bax": ((), "", "record theta and V"),
    "baz": ((), "", "record theta, alpha and h; fly at different load factors"),
}


@dataclass(frozen=True, eq=False)
class Reconstructibility:
    """What can be told of each state by these sensors and this manoeuvre: an upper bound.

    Attributes
    ----------
    asked : tuple of str
        The states that were to be estimated.
    verdicts : mapping of str to str
        Of each state asked for: "reconstructible"; "weak" (more than a third of the prior standard deviation is
        left); "not reconstructible" (and most of that lies along directions the data say nothing about).
        All are judged before any but Cbeta0 is fixed.
    posterior_over_prior : mapping of str to float [-]
        Of their standard deviations. That of the motion is at the start of the stretch that tells most.
    fixed : mapping of str to str
        States to hold so that the rest is determined, in the order they were chosen, and why.
    active : tuple of str
        The states left.
    active_over_prior : mapping of str to float [-]
        As `posterior_over_prior`, of the states left, once the others are held.
    rank, condition : int, float [-]
        Of the sensitivities along the path, to the states asked for without Cbeta0.
    linear_rank, linear_condition : int, float [-]
        The same with the path and the inputs frozen at their means.
    active_condition : float [-]
        Along the path, of the states left.
    confounded : tuple of (tuple of str, (k,) array)
        Directions the data say next to nothing about: states, and weights in units of their prior standard
        deviations, largest first; of a unit direction, without what is below 0.1.
    undetermined : tuple of str
        States left that still take part in such a direction; none of them may be fixed.
    stretches : int
    notes : tuple of str
        How the path was found where it was not recorded.
    """

    asked: tuple[str, ...]
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
    stretches: int
    notes: tuple[str, ...]

    @property
    def index(self) -> np.ndarray:
        """The states left, as indices of `kinematics.STATES`."""
        return np.array([STATES.index(name) for name in self.active], dtype=int)

    def __str__(self) -> str:
        tried = len(self.asked) - ("Cbeta0" in self.asked)
        lines = [
            f"Along the path ({self.stretches} stretch{'es' if self.stretches > 1 else ''}): rank {self.rank} of "
            f"{tried}, condition {self.condition:.2g}",
            f"Linearised at its mean: rank {self.linear_rank} of {tried}, condition {self.linear_condition:.2g}",
            f"With {len(self.fixed)} of {len(self.asked)} fixed: condition {self.active_condition:.2g}",
            "An upper bound: noise of the inputs and drifting biases are not counted.",
            "",
            f"{'state':8s} {'posterior/prior':>15s} {'others fixed':>13s}  verdict",
        ]
        for name in self.asked:
            after = f"{self.active_over_prior[name]:.2g}" if name in self.active_over_prior else "fixed"
            lines.append(f"{name:8s} {self.posterior_over_prior[name]:15.2g} {after:>13s}  {self.verdicts[name]}")
        said: dict[str, list[str]] = {}
        for name, why in self.fixed.items():
            said.setdefault(why, []).append(name)
        paragraphs = [f"{', '.join(names)}: {why}." for why, names in said.items()]
        if paragraphs:
            lines += ["", "Fixed"]
        if self.undetermined:
            paragraphs.append(f"Still undetermined, and not to be fixed: {', '.join(self.undetermined)}.")
        for paragraph in (*paragraphs, *self.notes):
            lines += textwrap.wrap(paragraph, 78, initial_indent="  ", subsequent_indent="    ")
        return "\n".join(lines)


def reconstructibility(problem: KinematicsProblem, *, fix_first: Sequence[str] = FIX_FIRST) -> Reconstructibility:
    """Tell which states, biases and winds a flight determines, and which to fix so that the rest is.

    Parameters
    ----------
    problem : KinematicsProblem
        As for the filter; `start_std` are the priors.
    fix_first : sequence of str
        States of `FIX_FIRST`; where there is a choice, an earlier one is fixed rather than a later. Those not
        named come after, in the order of `FIX_FIRST`. wn and we go together, unless one of them alone is
        undetermined.

    Returns
    -------
    Reconstructibility
        psi fixed where the ground track is measured means its *start*: there it stays among the states, with a
        small `start_std`, because the heading moves on.

    Raises
    ------
    DomainError
        An unknown name in `fix_first`, no two samples without a gap between, or no airspeed at all.

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
    stretches = stretches_of(problem.t)
    path, notes = recorded_path(problem, stretches)
    factors = np.stack([sensitivity_factor(problem, path, problem.inputs, piece, active, std) for piece in stretches])
    # The prior of the motion is used once: in the stretch that says most about it.
    best = int(np.argmax(np.linalg.slogdet(np.swapaxes(factors, 1, 2) @ factors + np.eye(len(active)))[1]))
    mean, steady = (np.broadcast_to(part.mean(axis=0), part.shape) for part in (path, problem.inputs))
    alone = sensitivity_factor(problem, mean, steady, stretches[best], active, std)
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
    undetermined = tuple(names[j] for j, row in zip(kept, null) if np.linalg.norm(row) > _SHARE)
    ratios, verdicts = dict(zip(names, ratio)), dict(zip(names, verdict))
    if len(active) < len(problem.active):
        fixed = {"Cbeta0": _CBETA0} | fixed
        ratios["Cbeta0"], verdicts["Cbeta0"] = 1.0, "not reconstructible"
    asked = tuple(STATES[j] for j in problem.active)
    return Reconstructibility(
        asked=asked,
        verdicts={name: verdicts[name] for name in asked},
        posterior_over_prior={name: float(ratios[name]) for name in asked},
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
        stretches=len(stretches),
        notes=notes,
    )


@dataclass(frozen=True)
class _PathInformation:
    """Triangular factors (N, L, L) of all stretches, which columns move, and the stretch whose motion counts."""

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
    """Posterior over prior standard deviation of each state, and what that means."""
    parts = V**2 / (1.0 + s**2)
    variance, unseen = parts.sum(axis=1), parts[:, s < _UNDETERMINED].sum(axis=1)
    words = []
    for whole, part in zip(variance, unseen):
        if whole <= _WEAK**2:
            words.append("reconstructible")
        else:
            words.append("not reconstructible" if part > 0.5 * whole else "weak")
    return np.sqrt(variance), words


def _condition(s: np.ndarray) -> float:
    return float(s[0] / s[-1]) if s.size and s[-1] > s[0] * np.finfo(float).eps else float("inf")


def _named(names: Sequence[str], direction: np.ndarray) -> tuple[tuple[str, ...], np.ndarray]:
    """Those of a unit direction that have a share in it, largest first."""
    order = [j for j in np.argsort(-np.abs(direction)) if abs(direction[j]) > _SHARE]
    weights = direction[order]
    weights.setflags(write=False)
    return tuple(names[j] for j in order), weights


def _groups(order: Sequence[str], names: Mapping[str, int], alone: np.ndarray) -> Iterator[tuple[tuple[str, ...], int]]:
    """What may be fixed, in order, and how many directions that must determine."""
    both = "wn" in names and "we" in names
    for name in order:
        if name in names and not (both and name in ("wn", "we")):
            yield (name,), 1
        elif name in names:
            # Half a wind is fixed only if nothing tells it and the other half is told.
            yield ("wn", "we"), 2
            if alone[names[name]] > _NOTHING:
                yield (name,), 1
    if both:
        yield ("wn", "we"), 1


def _choose(
    data: _PathInformation, names: Sequence[str], order: Sequence[str], sampled: set[str]
) -> tuple[dict[str, str], list[int], list[tuple[tuple[str, ...], np.ndarray]]]:
    """Fix states until no direction in which one of them takes part is undetermined."""
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
            # The undetermined direction nearest to this state; and those it cannot be told apart from.
            direction = null @ null[here[name]]
            direction /= np.linalg.norm(direction)
            confounded.append(_named([names[j] for j in kept], direction))
            partners = [other for other in confounded[-1][0] if other not in group]
            fixed[name] = _reason(name, partners, sampled)
        kept = without


def _reason(name: str, partners: Sequence[str], sampled: set[str]) -> str:
    shows, lacking, remedy = _ADVICE[name]
    if shows and not sampled & set(shows):
        return lacking
    apart = f"cannot be told apart from {', '.join(partners)} here" if partners else "hardly shows in this flight"
    return f"{apart}; {remedy}"
