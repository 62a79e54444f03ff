"""Ice: drag grows and lift falls, slowly, until it is shed."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from structsel.comparison.flight import Flight
from structsel.effects.base import Columns, EffectParameter, FittedEffect, Flights, Variant
from structsel.effects.signals import Column, from_lift_and_drag, lift_line, reach, signature
from structsel.numerics.arrays import Array

_ONSETS = (0.0, 0.2, 0.4, 0.6)  # of a manoeuvre's duration, from which ice grows
_SHED = (0.25, 0.5, 0.75)
"""Of all manoeuvres, after which ice is shed."""
_SUDDEN = 1e-6  # of all manoeuvres, within which it is shed
_STALLING = 0.12  # rad, of angle of attack, from which a stall may come early
_SPELLS = tuple(
    (begin, end) for begin in (0.0, 0.12, 0.25, 0.4, 0.6) for end in (0.3, 0.5, 0.75, 1.0) if end > begin + 0.1
)
"""Begin and end of ice's growth over all manoeuvres."""


def ice_variants(flights: Flights) -> list[Variant]:
    """Forms: growing in one manoeuvre or over all, shed, and what ice takes besides."""
    slope, zero = lift_line(flights)
    longest = max(f.t[-1] - f.t[0] for f in flights)
    made = [
        _iced(_growing(onset, longest), slope, zero, "over each manoeuvre", {"onset": onset * longest})
        for onset in _ONSETS
    ]
    for rest in (0.2, 0.5):
        shape = {"time constant": rest * longest}
        made.append(_iced(_settling(rest * longest), slope, zero, "over each manoeuvre, levelling off", shape))
    made += _other_ices(flights, slope, zero, longest)
    if len(flights) > 1:
        clock = _clock(flights)
        made += [
            _iced(_before(clock, end), slope, zero, f"until it was shed after {100 * end:.0f} % of all manoeuvres", {})
            for end in _SHED
        ]
        for begin, end in _SPELLS:
            about = f"from {100 * begin:.0f} to {100 * end:.0f} % of all manoeuvres one after the other"
            made.append(_iced(_since(clock, begin, end), slope, zero, about, {}))
        made += [
            _iced(_growing(onset, longest, f.name), slope, zero, f"in {f.name}", {"onset": onset * longest})
            for f in flights[:10]
            for onset in _ONSETS
        ]
    return made


def _other_ices(flights: Flights, slope: float, zero: float, longest: float) -> list[Variant]:
    """Growing ice that reduces the power of the controls, lies on one wing, or causes the stall.

    Ice that does not change in time is not among them: in calm flights a wrong scale of a vane has the same form.
    """
    along = _growing(0.0, longest)
    made = [
        _iced(along, slope, zero, "growing, with power of the elevator", {}, more=_LESS_POWER),
        _iced(along, slope, zero, "growing, on one wing", {}, more=_ONE_WING),
    ]
    highest = reach(flights, "alpha")[1]
    if highest > _STALLING:
        onset = 0.7 * highest
        made.append(_iced(along, slope, onset, "growing, beyond an angle of attack", {"stall": onset}, sudden=True))
    return made


def _less_power(flight: Flight, x: Array) -> list[tuple[str, int, Array]]:
    return [(r, 3, -flight.slope(r, "de") * flight["de"] * x) for r in ("Cm", "CZ")]


def _one_wing(flight: Flight, x: Array) -> list[tuple[str, int, Array]]:
    return [("Cl", 3, x), ("Cl", 4, (flight["alpha"]) * x), ("Cn", 5, x)]


def _before(clock: Mapping[str, tuple[float, float]], end: float) -> Column:
    """One until a time on the clock of all."""
    return lambda flight: 1.0 - _since(clock, end, end + _SUDDEN)(flight)


def _growing(onset: float, longest: float, only: str = "") -> Column:
    """From a fraction of the longest manoeuvre's duration on, in units of this duration."""

    def column(flight: Flight) -> Array:
        if only not in ("", flight.name):
            return np.zeros(len(flight))
        return np.maximum((flight.t - flight.t[0]) / longest - onset, 0.0)

    return column


def _settling(constant: float) -> Column:
    return lambda flight: 1.0 - np.exp(-(flight.t - flight.t[0]) / constant)


def _clock(flights: Flights) -> dict[str, tuple[float, float]]:
    """Start and end of each manoeuvre on the common clock, from zero to one; by their order where it is not known."""
    starts = [float(f.t[0]) for f in flights]
    if all(later >= before.t[-1] for before, later in zip(flights, starts[1:])):
        first, duration = starts[0], float(flights[-1].t[-1]) - starts[0]
        return {f.name: ((f.t[0] - first) / duration, (f.t[-1] - first) / duration) for f in flights}
    return {f.name: (k / len(flights), (k + 1) / len(flights)) for k, f in enumerate(flights)}


def _since(clock: Mapping[str, tuple[float, float]], begin: float, end: float) -> Column:
    """Growing between two times on the clock of all, one being what is there afterwards."""

    def column(flight: Flight) -> Array:
        first, last = clock.get(flight.name, (0.0, 0.0))
        fraction = (flight.t - flight.t[0]) / max(flight.t[-1] - flight.t[0], 1e-9)
        return np.clip((first + (last - first) * fraction - begin) / (end - begin), 0.0, 1.0)

    return column


def _iced(
    along: Column,
    slope: float,
    zero: float,
    about: str,
    shape: dict[str, float],
    more: tuple[tuple[EffectParameter, ...], Callable[[Flight, Array], list[tuple[str, int, Array]]]] | None = None,
    sudden: bool = False,
) -> Variant:
    """Ice along a column; `sudden` where lift is lost beyond the angle `zero` only, `more` for what else it takes."""
    further = more[0] if more else ()
    parameters = (
        EffectParameter("drag", "-", 0.02, 0.0, 0.3),
        EffectParameter("lift slope loss", "-", 0.1, 0.0, 1.5 if sudden else 0.7),
        EffectParameter("pitching moment", "-", 0.006, -0.1, 0.1),
        *further,
    )

    def columns(flight: Flight) -> Columns:
        x = along(flight)
        if not x.any():
            return {}
        angle = flight["alpha"] - zero
        lost = slope * (np.maximum(angle, 0.0) if sudden else angle) * x
        parts = [*from_lift_and_drag(flight, 0, CD=x), *from_lift_and_drag(flight, 1, CL=-lost), ("Cm", 2, x)]
        return signature(flight, len(parameters), parts + (more[1](flight, x) if more else []))

    units = {name: "rad" if name == "stall" else "s" for name in shape}
    return Variant(parameters, columns, shape, units, about)


_LESS_POWER = ((EffectParameter("elevator power loss", "-", 0.1, 0.0, 0.7),), _less_power)
_ONE_WING = (
    (
        EffectParameter("rolling moment", "-", 0.004),
        EffectParameter("rolling moment per alpha", "1/rad", 0.05),
        EffectParameter("yawing moment", "-", 0.002),
    ),
    _one_wing,
)


def ice_says(found: FittedEffect) -> str:
    """The sentence of ice."""
    return (
        f"Drag grows by {found.text('drag', 1e4, 'counts')} and the lift slope falls by "
        f"{found.text('lift slope loss', 100.0, '%')} {found.variant.about}, as with ice."
    )
