"""What a wrong reading does to every response, to first order, worked out once per flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from weakref import WeakKeyDictionary

import numpy as np

from structsel.comparison.flight import AIRFRAME, Flight
from structsel.comparison.responses import KINEMATIC, respond
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array

Sensitivity = Mapping[str, tuple[Array, Array | None]]
"""By response, what an error e of a channel adds to the difference: ``A e + B e'``; B is None where it is zero."""

_BODY, _ANGLES = ("V", "alpha", "beta", "p", "q", "r", "ax", "ay", "az"), ("phi", "theta", "psi")
_READ = {
    COEFFICIENTS: (*_BODY, "qbar_ratio", "rho", "thrust", "mass"),
    tuple(KINEMATIC): (*_BODY, *_ANGLES, "h", "vn", "ve", "vd"),
}
"""Responses, and the channels from which they are computed."""
_DIFFERENTIATED = {
    COEFFICIENTS: ("p", "q", "r"),
    tuple(KINEMATIC): ("V", "alpha", "beta", "p", "q", "r", *_ANGLES, "h"),
}
"""The same, and the channels whose derivatives are in them."""
_STEP = 1e-4  # of 1 rad, 1 rad/s or 1 m/s^2, and of 100 m/s: small beside every bend, large beside rounding
_AT_ONCE = 4  # channels: the more, the more is worked out again for those that their errors do not touch
_INERTIAL = ("ax", "ay", "az")
_KNOWN: WeakKeyDictionary[Flight, dict[str, Sensitivity]] = WeakKeyDictionary()
_FULL: WeakKeyDictionary[Flight, dict[str, Sensitivity]] = WeakKeyDictionary()


def sensitivity(flight: Flight, channel: str) -> Sensitivity:
    """Sensitivity of a flight's differences to one channel; the simulation was driven by what was read."""
    full = _FULL.setdefault(flight, {})
    if channel not in full:
        full[channel] = _less_simulated(flight, channel)
    return full[channel]


def _less_simulated(flight: Flight, channel: str) -> Sensitivity:
    if flight not in _KNOWN:
        _KNOWN[flight] = _measured(flight)
    made = dict(_KNOWN[flight].get(channel, {}))
    for r, answer in asked_wrongly(flight, channel).items():
        A, B = made.get(r, (0.0, None))
        made[r] = A + answer, B
    return made


def asked_wrongly(flight: Flight, channel: str) -> dict[str, Array]:
    """Change of the differences by a unit error of a channel at which only the simulation was evaluated."""
    slopes = {r: flight.slope(r, channel) for r in flight.responses if r in COEFFICIENTS}
    return {r: -slope for r, slope in slopes.items() if np.any(slope)}


def misread(flight: Flight, **errors: Array | float) -> dict[str, Array]:
    """What wrong readings do to the differences, to first order.

    Parameters
    ----------
    flight : Flight
    **errors : (n,) array or float
        By how much each channel reads more than the truth.

    Returns
    -------
    dict of response to (n,) array
    """
    made: dict[str, Array] = {}
    for channel, e in errors.items():
        parts = sensitivity(flight, channel)
        changes = np.ndim(e) > 0 and any(B is not None for _, B in parts.values())
        rate = flight.rate(np.asarray(e, dtype=float)) if changes else None
        for r, (A, B) in parts.items():
            added = A * e if B is None or rate is None else A * e + B * rate
            made[r] = made[r] + added if r in made else added
    return made


def reading(flight: Flight, channel: str) -> Array:
    """A channel; of an accelerometer what it would read were the simulation right, so that no noise meets itself."""
    return flight.expected[channel] if channel in _INERTIAL and channel in flight.expected else flight[channel]


def _measured(flight: Flight) -> dict[str, Sensitivity]:
    """What each channel's error does to what was measured."""
    clean = {**flight.channels, **flight.expected}
    made: dict[str, dict[str, tuple[Array, Array | None]]] = {}
    if not set(AIRFRAME) <= set(clean):
        return {}
    for kind, read in _READ.items():
        wanted = tuple(r for r in flight.responses if r in kind)
        # Kinematics does not ask what the simulation says of forces, which may lack a good part of them.
        channels = clean if kind == COEFFICIENTS else {**clean, **{c: flight.channels[c] for c in _INERTIAL}}
        names = [c for c in read if c in clean] if wanted else []
        for i in range(0, len(names), _AT_ONCE):
            some = names[i : i + _AT_ONCE]
            moving = [c for c in some if c in _DIFFERENTIATED[kind]]
            for c, one in _measured_of(some, moving, flight, channels, wanted).items():
                made.setdefault(c, {}).update(one)
    return dict(made)


def _measured_of(
    names: Sequence[str], moving: Sequence[str], flight: Flight, channels: Mapping[str, Array], wanted: tuple[str, ...]
) -> dict[str, dict[str, tuple[Array, Array | None]]]:
    """The same of a few channels: a constant error of each and a ramp of those that are differentiated, in columns."""
    n, k = len(flight), len(names)
    span = float(np.ptp(flight.t))
    ramp = (flight.t - flight.t.mean()) / span
    steps = {c: 100.0 * _STEP if c == "V" else _STEP for c in names}
    column = {c: k + j for j, c in enumerate(moving)}
    sides = []
    for sign in (0.5, -0.5):
        off = {c: np.zeros((k + len(moving), n)).T for c in names}  # columns contiguous in memory
        for j, c in enumerate(names):
            off[c][:, j] = sign * steps[c]
            if c in column:
                off[c][:, column[c]] = sign * steps[c] * ramp
        off |= {f"{c}_dot": flight.rate(off[c]) for c in ("p", "q", "r") if c in off}
        ch = {c: x[:, None] for c, x in channels.items()}  # what no error touches is worked out once
        ch |= {c: ch[c] + e for c, e in off.items()}
        sides.append(respond(ch, flight.aircraft, flight.dt, wanted))
    size = np.array([*steps.values(), *(steps[c] for c in moving)])
    change = {r: np.broadcast_to(sides[0][r] - sides[1][r], (n, len(size))) / size for r in wanted}
    made: dict[str, dict[str, tuple[Array, Array | None]]] = {}
    for j, c in enumerate(names):
        for r, x in change.items():
            slow = x[:, j].copy()
            quick = (x[:, column[c]] - slow * ramp) * span if c in column else None
            if slow.any() or (quick is not None and quick.any()):
                made.setdefault(c, {})[r] = slow, quick
    return made
