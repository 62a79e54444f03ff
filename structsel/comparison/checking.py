"""What makes a comparison meaningless, said before or instead of a result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from structsel.comparison.flight import Flight
from structsel.errors import DataError
from structsel.nomenclature import COEFFICIENTS
from structsel.recording import Recording

_STEEP = 0.5 * np.pi  # rad of angle of attack or sideslip
_FAST = 20.0  # rad/s
_TIMES = 3.0  # the highest recorded airspeed
_WIDER = 0.25  # by which the range a simulation flew may be exceeded at each end
_SHARED = 0.2  # of the recorded samples that must lie in the range the simulation flew
_OFF = 5.0  # times the size of what was measured
_SPAN = ("V", "alpha")


def check_recorded(recordings: Sequence[Recording]) -> None:
    """Refuse recordings whose air data cannot be an aeroplane's in flight.

    Raises
    ------
    DataError
    """
    for r in recordings:
        if not {"V", "ax", "az"} <= set(r.names):
            continue
        for name in ("alpha", "beta"):
            if (i := _first_beyond(r, name, _STEEP)) is not None:
                raise DataError(
                    f"'{r.name}': {name} is {r[name][i]:.4g} rad at sample {i} (t = {r.t[i]:g} s), "
                    "the air from behind. Its unit, its sign or its source is wrong, or the aircraft stood.\n"
                    "Check the channel map, or leave those samples out."
                )


def check_free_simulations(simulations: Mapping[str, Recording], recordings: Sequence[Recording], where: str) -> None:
    """Refuse free simulations that diverged, or whose states differ from the recorded ones.

    Raises
    ------
    DataError
    """
    for r in recordings:
        _check_finite(simulations[r.name], where)
        _check_tame(simulations[r.name], r, where)
    for channel in _SPAN:
        simulated = np.concatenate([simulations[r.name][channel] for r in recordings])
        seen = np.concatenate([r[channel] for r in recordings if channel in r] or [np.zeros(0)])
        low, high = float(simulated.min()), float(simulated.max())
        room = _WIDER * max(high - low, 1e-6 * max(abs(low), abs(high)))
        shared = float(np.mean((seen >= low - room) & (seen <= high + room))) if len(seen) else 1.0
        if shared < _SHARED:
            raise DataError(
                f"the simulation in '{where}' flew {channel} from {low:.4g} to {high:.4g}, the recordings from "
                f"{seen.min():.4g} to {seen.max():.4g}: only {shared:.0%} of the recorded samples lie where it flew.\n"
                "Its coefficients elsewhere cannot be determined from its flights: start it from the recorded states, "
                "or give its coefficients along the recordings."
            )


def _check_finite(flight: Recording, where: str) -> None:
    for name in flight.names:
        x = np.asarray(flight[name])
        if not np.isfinite(x).all():
            i = int(np.argmin(np.isfinite(x)))
            raise DataError(
                f"the simulation in '{where}' of '{flight.name}': {name} is {x[i]} at sample {i} "
                f"(t = {flight.t[i]:g} s): it diverged, or was not finished.\n"
                "Leave this manoeuvre out, cut it short, or correct the simulation."
            )


def _check_tame(flight: Recording, recording: Recording, where: str) -> None:
    limits = {"alpha": _STEEP, "beta": _STEEP, "p": _FAST, "q": _FAST, "r": _FAST}
    if "V" in recording:
        limits["V"] = _TIMES * float(np.max(recording["V"]))
    for name, limit in limits.items():
        if (i := _first_beyond(flight, name, limit)) is not None:
            raise DataError(
                f"the simulation in '{where}' of '{flight.name}' diverged: {name} is {flight[name][i]:.4g} at sample "
                f"{i} (t = {flight.t[i]:g} s).\nCut the manoeuvre before it, hold the simulation with a light "
                "stabilisation, or give its coefficients along the recordings instead."
            )


def _first_beyond(recording: Recording, name: str, limit: float) -> int | None:
    """First sample at which a channel is larger than a limit; None where it never is, or there is no such channel."""
    if name not in recording or not (beyond := np.abs(recording[name]) > limit).any():
        return None
    return int(np.argmax(beyond))


def check_alike(flights: Sequence[Flight], where: str) -> None:
    """Refuse a simulation whose coefficients are of another size in every flight: the largest, or most of them.

    Raises
    ------
    DataError
    """
    shared = [c for c in flights[0].simulated if c in COEFFICIENTS]
    size = {c: [float(np.sqrt(np.mean(f.measured[c] ** 2))) for f in flights] for c in shared}
    off = {c: [float(np.sqrt(np.mean(f.difference[c] ** 2))) for f in flights] for c in shared}
    wrong = [c for c in shared if all(e > _OFF * g for e, g in zip(off[c], size[c]))]
    if not wrong or (2 * len(wrong) <= len(shared) and max(shared, key=lambda c: sum(size[c])) not in wrong):
        return
    c = wrong[0]
    f = flights[int(np.argmax(off[c]))]
    i = int(np.argmax(np.abs(f.difference[c])))
    raise DataError(
        f"'{where}' gives {c} = {f.simulated[c][i]:.4g} in '{f.name}' at sample {i} (t = {f.t[i]:g} s) where "
        f"{f.measured[c][i]:.4g} was measured, and is as far off in every manoeuvre ({', '.join(wrong)}): it is of "
        "another aircraft, or its coefficients have other units, signs or references.\n"
        "Check S, b, cbar, mass and inertia in "
        "aircraft.toml against the simulation's, and its signs."
    )
