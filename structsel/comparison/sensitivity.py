"""What a wrong reading does to every response, to first order, worked out once per flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from weakref import WeakKeyDictionary

import numpy as np

from structsel.comparison.flight import AIRFRAME, Flight
from structsel.comparison.responses import KINEMATIC, respond
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array

Sensitivity = Mapping[str, tuple[Array, Array]]
"""By response, what an error e of a channel adds to the difference: ``A e + B e'``."""

_READ = (*AIRFRAME, "qbar_ratio", "rho", "thrust", "mass", "h", "vn", "ve", "vd")
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
    nothing = np.zeros(len(flight))
    for r, answer in asked_wrongly(flight, channel).items():
        A, B = made.get(r, (nothing, nothing))
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
        error = np.broadcast_to(np.asarray(e, dtype=float), flight.t.shape)
        rate = flight.rate(error)
        for r, (A, B) in sensitivity(flight, channel).items():
            added = A * error + B * rate
            made[r] = made[r] + added if r in made else added
    return made


def reading(flight: Flight, channel: str) -> Array:
    """A channel; of an accelerometer what it would read were the simulation right, so that no noise meets itself."""
    return flight.expected[channel] if channel in _INERTIAL and channel in flight.expected else flight[channel]


def _measured(flight: Flight) -> dict[str, Sensitivity]:
    """What each channel's error does to what was measured."""
    clean = {**flight.channels, **flight.expected}
    wanted = tuple(r for r in flight.responses if r in COEFFICIENTS or r in KINEMATIC)
    if not wanted or not set(AIRFRAME) <= set(clean):
        return {}
    names = [c for c in _READ if c in clean]
    made: dict[str, Sensitivity] = {}
    for i in range(0, len(names), _AT_ONCE):
        made |= _measured_of(names[i : i + _AT_ONCE], flight, clean, wanted)
    return made


def _measured_of(
    names: Sequence[str], flight: Flight, clean: Mapping[str, Array], wanted: tuple[str, ...]
) -> dict[str, Sensitivity]:
    """The same of a few channels: a constant error and a ramp of each, side by side."""
    # Kinematics does not ask what the simulation says of forces, which may lack a good part of them.
    felt = {c: flight.channels[c] for c in _INERTIAL}
    n, k = len(flight), len(names)
    span = float(np.ptp(flight.t))
    ramp = (flight.t - flight.t.mean()) / span
    steps = np.array([100.0 * _STEP if c == "V" else _STEP for c in names])
    sides: tuple[dict[str, Array], ...] = ({}, {})
    for side, sign in zip(sides, (0.5, -0.5)):
        off = {c: np.zeros((n, 2 * k)) for c in names}
        for j, c in enumerate(names):
            off[c][:, j], off[c][:, k + j] = sign * steps[j], sign * steps[j] * ramp
        off |= {f"{c}_dot": flight.rate(off[c]) for c in ("p", "q", "r") if c in off}
        for channels, kind in ((clean, COEFFICIENTS), ({**clean, **felt}, KINEMATIC)):
            ch = {c: x[:, None] for c, x in channels.items()}  # what no error touches is worked out once
            ch |= {c: ch[c] + e for c, e in off.items()}
            side |= respond(ch, flight.aircraft, flight.dt, tuple(r for r in wanted if r in kind))
    change = {r: (sides[0][r] - sides[1][r]) / np.tile(steps, 2) for r in wanted}
    return {
        c: {
            r: (x[:, j].copy(), (x[:, k + j] - x[:, j] * ramp) * span)
            for r, x in change.items()
            if np.any(x[:, [j, k + j]])
        }
        for j, c in enumerate(names)
    }
