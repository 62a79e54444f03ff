"""What to allow for in a reconstruction, and what speaks against using it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from structsel.numerics.signal_quality import noise_level
from structsel.reconstruction.delays import Delay
from structsel.reconstruction.innovations import Consistency
from structsel.reconstruction.noise_levels import most_active_interval
from structsel.reconstruction.observability import Reconstructibility
from structsel.reconstruction.problem import BEST, ReconstructionProblem
from structsel.reconstruction.result import CONSTANTS, Constant
from structsel.reconstruction.settings import INERTIAL
from structsel.reconstruction.ukf import KinematicsProblem, ukf_filter

_MANY_MADE_UP = 0.01  # share of an inertial channel's readings
_MANY_REJECTED = 0.1  # share of a channel's readings
_IMPLAUSIBLE = {"bax": 2.0, "bay": 2.0, "baz": 2.0, "bp": 0.1, "bq": 0.1, "br": 0.1, "Cup": 0.5, "Csi": 0.5,
                "Calpha0": 0.1, "KV": 0.2, "wn": 80.0, "we": 80.0, "wd": 15.0}  # fmt: skip
_KNOWN = 0.05  # rad, or share of the airspeed
_LATE = 0.05  # s
_FELT, _FELT_ANGLE, _FELT_SPEED = 3.0, 3e-3, 0.5  # times the noise, rad, m/s: gusts can hide a delay, and the path
# then follows the late vane
_RESTLESS = 5.0  # times
_SEVERAL = 3  # channels
_TOO_SMALL = 2.5  # variance of normalised innovations under a stated noise
_LEAST_PLACE = 0.25  # m
_MUCH_LIKELIER = 15.0  # log-likelihood
_PLACES = {"accelerometers": [0], "vanes": [1, 2, 3], "static port": [4], "GPS antenna": [5]}
_LARGE = {"V": 5.0, "alpha": 0.05, "beta": 0.05, "phi": 0.1, "theta": 0.05, "psi": 0.2}


def check_quality(
    problem_setup: ReconstructionProblem,
    path: np.ndarray,
    consistency: Consistency,
    constants: tuple[Constant, ...],
    verdict: Reconstructibility,
    delays: tuple[Delay, ...],
    stds: Mapping[str, np.ndarray],
    white: np.ndarray,
    wide: np.ndarray,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Doubts and reasons for distrust, each a sentence."""
    doubts, contradicted = [], []
    for channel in consistency.channels:
        name, n = channel.channel, channel.n
        share, excess = channel.rejected / max(n, 1), np.sqrt(max(channel.variance, 0.0))
        says = []
        if share > _MANY_REJECTED:
            says.append(f"{channel.rejected} of {n} readings lie outside the gate")
        elif channel.rejected:
            doubts.append(f"{channel.rejected} of {n} readings of {name} lay outside the gate and were not used")
        if name in problem_setup.given and channel.variance > _TOO_SMALL:
            says.append(
                f"innovations are {excess:.1f} times what its stated noise of {problem_setup.noise[name]:.3g} allows"
            )
        elif name in _LARGE and channel.residual_rms > _LARGE[name]:
            says.append(f"{channel.residual_rms:.2g} rms is left unexplained")
        if says:
            contradicted.append((max(excess, 10.0 * share), f"{name} contradicts the others: {', and '.join(says)}"))
    too_small = _noise_too_small(problem_setup, consistency)
    contradicted.sort(key=lambda found: -found[0])
    worst = max([1.0, *(c.variance * c.inflation for c in consistency.channels if np.isfinite(c.variance))])
    lateness = {late: _delay_text(late) for late in delays if late.significant}
    named = {text.split()[0] for _, text in contradicted}
    # A late channel looks like a misplaced vane, too.
    distrust = [
        text
        for late, text in lateness.items()
        if abs(late.delay) > _LATE and (late.channel in named or _is_felt(late, problem_setup.noise[late.channel]))
    ]
    distrust += _reversed_positions(problem_setup.problem, worst)
    faults = [f for f in problem_setup.findings if f.severity == "warning"]
    if contradicted:
        # What is wrong with an inertial reading shows in all the others.
        distrust += [
            str(f).removeprefix("warning: ")
            for f in faults
            if f.channel in INERTIAL and f.count > _MANY_MADE_UP * len(path)
        ]
    distrust += too_small + _implausible(constants) + [text for _, text in contradicted] + _undetermined(path, stds)
    if contradicted:
        distrust.append(
            "look at the clock, sign, unit and place of what is named first, and at the noise that is stated; a bias "
            "that drifts needs drift, a delayed channel delays='estimate' (--delays estimate)"
        )
    doubts += [text for f in faults if (text := str(f).removeprefix("warning: ")) not in distrust]
    doubts += [text for text in lateness.values() if text not in distrust]
    quiet = [
        c.channel for c in consistency.channels if c.channel in problem_setup.given and c.variance < 1.0 / _TOO_SMALL
    ]
    if quiet:
        doubts.append(f"innovations of {', '.join(quiet)} are far smaller than the stated noise: state less")
    doubts += _restless(problem_setup)
    coloured = [c.channel for c in consistency.channels if not c.white]
    if coloured:
        factor = float(np.median(wide[-1] / white[-1]))
        doubts.append(
            f"innovations of {', '.join(coloured)} are not white (turbulence, lags or a drifting instrument): standard "
            f"deviations are widened, by {factor:.2g} in the median"
        )
    weak = [c.name for c in constants if verdict.verdicts.get(c.name) == "weak"]
    if weak:
        doubts.append(f"these data say little about {', '.join(weak)}: what was believed beforehand carries the value")
    return tuple(doubts), tuple(distrust)


def _is_felt(late: Delay, noise: float) -> bool:
    least = _FELT_SPEED if late.channel == "V" else _FELT_ANGLE
    return late.effect > max(_FELT * noise, least)


def _delay_text(late: Delay) -> str:
    way = "late" if late.delay > 0.0 else "early"
    return (
        f"{late.channel} reads {abs(late.delay):.3f} s {way} (+- {2 * late.std:.3f}); delays='estimate' (--delays "
        "estimate) allows for it"
    )


def _restless(problem_setup: ReconstructionProblem) -> list[str]:
    """Inertial readings that agree with the others only if they are far noisier than they look."""
    problem = problem_setup.problem
    dt = float(np.median(np.diff(problem.t)))
    found = []
    for j, name in enumerate(INERTIAL):
        if name in problem_setup.given or name not in problem_setup.noise:
            continue
        own = max(noise_level(problem.inputs[:, j], dt), BEST[name])
        if problem_setup.noise[name] > _RESTLESS * own:
            found.append(f"{name} ({problem_setup.noise[name] / own:.0f} times)")
    if not found:
        return []
    return [
        f"{', '.join(found)} agree with the other instruments only if taken as so much noisier than they look: scale "
        "errors, a delay, vibration or a bias that drifts (drift allows for it)"
    ]


def _noise_too_small(problem_setup: ReconstructionProblem, consistency: Consistency) -> list[str]:
    """Where every stated noise is exceeded, the statement is likelier to be wrong than every instrument."""
    excess = [np.sqrt(c.variance) for c in consistency.channels if c.channel in problem_setup.given]
    if len(excess) < _SEVERAL or min(excess) ** 2 <= _TOO_SMALL:
        return []
    return [
        f"the readings scatter {min(excess):.1f} to {max(excess):.1f} times as much as stated, in all {len(excess)} "
        "channels: the noise may be stated too small (leave it out to have it estimated)"
    ]


def _implausible(constants: tuple[Constant, ...]) -> list[str]:
    """Constants that no instrument in order has."""
    return [
        f"{c.name}, {CONSTANTS[c.name][0]}, comes out at {c.value:.3g} {c.unit}, more than any instrument in order has "
        "(check signs, units and places)"
        for c in constants
        if abs(c.value) - 2.0 * c.std > _IMPLAUSIBLE.get(c.name, np.inf)
    ]


def _undetermined(path: np.ndarray, stds: Mapping[str, np.ndarray]) -> list[str]:
    """Motion that these instruments leave open."""
    V = np.sqrt(np.sum(path[:, :3] ** 2, axis=1))
    known = {"alpha": stds["alpha"], "theta": stds["theta"], "V": stds["V"] / V}
    return [
        f"{name} is known to {np.median(std):.2g} {'of itself' if name == 'V' else 'rad'} only: these instruments do "
        "not determine it"
        for name, std in known.items()
        if not np.median(std) < _KNOWN
    ]


def _reversed_positions(problem: KinematicsProblem, excess: float) -> list[str]:
    """Which instrument's place would be far likelier with the other sign, tried on the part that moves most.

    `excess` is the factor by which the readings say less than they would if they were as good as stated.
    """
    part = most_active_interval(problem)
    base = ukf_filter(part, spread=0.0)
    if base.failed >= 0:
        return []
    found = []
    for instrument, rows in _PLACES.items():
        for axis, ahead in enumerate(("x (forward)", "y (right)", "z (down)")):
            away = float(part.place[rows[0], axis])
            if abs(away) < _LEAST_PLACE:
                continue
            place = part.place.copy()
            place[np.ix_(rows, [axis])] *= -1.0
            turned = ukf_filter(replace(part, place=place), spread=0.0)
            gain = (turned.log_likelihood - base.log_likelihood) / excess
            if turned.failed < 0 and gain > _MUCH_LIKELIER:
                text = (
                    f"the place of the {instrument} seems to have the wrong sign: {ahead} = {-away:+.2f} m explains "
                    f"the readings far better than {away:+.2f} m (log-likelihood +{gain:.0f}; in the aircraft file)"
                )
                found.append((gain, text))
    # One place turned round makes others look wrong, too, but less.
    return [max(found)[1]] if found else []
