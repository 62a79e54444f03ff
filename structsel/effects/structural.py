"""Structure that swings: lightly damped modes that controls excite."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import scipy

from structsel.comparison.flight import Flight
from structsel.comparison.noise import highest_of
from structsel.effects.base import Columns, Effect, EffectParameter, Flights, Variant, of_shape
from structsel.effects.inputs import DrivenChannel, channels_with_input
from structsel.effects.operators import oscillate, peaks
from structsel.effects.readings import Errors, cannot_be_shifted, present, wrong_readings
from structsel.effects.signals import coefficients, held, moves, signature, variation
from structsel.nomenclature import LATERAL_COEFFICIENTS, LONGITUDINAL_COEFFICIENTS
from structsel.numerics.arrays import Array

_LOWEST = 0.8  # Hz
_OF_BAND = 0.97  # half of a mode at the edge of the compared band is not separated from noise
_PEAKS = 3
_SPREAD = (1.5, 3.0)  # Hz, tried whatever the spectrum says
_DAMPINGS = (0.01, 0.025, 0.06)  # of what bends: with more, a mode is any lag of second order
_PERIODS = 8.0  # of a mode that a channel shows, in the shortest manoeuvre at least
_ITS_OWN = 0.4  # log of the frequency over that of a plant, below which its mode is the plant itself
_HOW = ("", ", as it moves")
_UNITS = {"frequency": "Hz", "damping": "-"}
_FAMILIES = ((LONGITUDINAL_COEFFICIENTS, ("de",)), (LATERAL_COEFFICIENTS, ("da", "dr")))
"""Surfaces excite a mode. As drives, angles of the air gave correct simulations log Bayes factors of 19 to 27."""
_RATIO, _SOUGHT = 1.03, 2  # of one frequency tried to the next, and how many are kept where a drive explains most


def _through(one: DrivenChannel, frequency: float, damping: float) -> Callable[[Flight], Columns]:
    """Contribution to a channel of a mode that an input excites, through the plant of that channel if it has one."""

    def columns(flight: Flight) -> Columns:
        if one.response not in flight.measured:
            return {}
        x = flight.raw[one.control]
        swung = oscillate(x, flight.dt, frequency, damping)
        moving = flight.rate(swung) / (2.0 * np.pi * frequency)
        return {one.response: np.column_stack([one.to(flight, part) for part in (swung - x, moving)])}

    return columns


def _in_channels(flights: Flights) -> list[Variant]:
    """Modes that the inputs of channels excite, except for that of the plant itself."""
    made = []
    for one in channels_with_input(flights):
        low = _PERIODS / min(len(f) * f.dt for f in flights)
        own = one.plant.frequency(flights[0].dt) if one.plant else 0.0
        found = peaks(flights, (one.response,), _PEAKS, low, _OF_BAND * min(highest_of(f) for f in flights))
        parameters = tuple(EffectParameter(f"{one.response} per {one.control}{how}", "-", 0.3) for how in _HOW)
        for frequency in found:
            if own and abs(np.log(frequency / own)) < _ITS_OWN:
                continue
            form = partial(_mode, parameters, partial(_through, one), one.control)
            made += [of_shape(form, frequency, damping) for damping in _DAMPINGS]
    return made


def _mode(
    parameters: tuple[EffectParameter, ...],
    ringing: Callable[[float, float], Callable[[Flight], Columns]],
    about: str,
    frequency: float,
    damping: float,
) -> Variant:
    shape = {"frequency": frequency, "damping": damping}
    return Variant(parameters, ringing(frequency, damping), shape, _UNITS, about)


def _ringing(responses: Sequence[str], drive: str, frequency: float, damping: float) -> Callable[[Flight], Columns]:
    def columns(flight: Flight) -> Columns:
        x, w = flight[drive], 2.0 * np.pi * frequency
        swung = oscillate(x, flight.dt, frequency, damping)
        # The quasi-steady part of the mode is in the rigid derivatives already. Air is moved by the mode's speed,
        # instruments are by what accelerates it.
        bent, moving = swung - x, flight.rate(swung) / w
        k = len(responses)
        parts = [(r, j + at, part) for at, part in ((0, bent), (k, moving)) for j, r in enumerate(responses)]
        return signature(flight, 2 * k, parts)

    return columns


def _variants(flights: Flights) -> list[Variant]:
    made = []
    for family, drives in _FAMILIES:
        responses = held(flights, family)
        top = _OF_BAND * min(highest_of(f) for f in flights)
        frequencies = peaks(flights, responses, _PEAKS, _LOWEST, top)
        frequencies += [x for x in _SPREAD if all(abs(np.log(x / y)) > 0.2 for y in frequencies)]
        frequencies = [x for x in frequencies if x <= top]
        for drive in drives:
            if not responses or not moves(flights, drive):
                continue
            sought = _clearest(flights, responses, drive, top)
            parameters = tuple(
                EffectParameter(f"{r} per {drive}{how}", "1/rad", _size(flights, r, drive))
                for how in _HOW
                for r in responses
            )
            form = partial(_mode, parameters, partial(_ringing, responses, drive), drive)
            made += [of_shape(form, x, damping) for x in [*frequencies, *sought] for damping in _DAMPINGS]
    return [*made, *_of_instruments(flights), *_in_channels(flights)]


def _of_instruments(flights: Flights) -> list[Variant]:
    """Accelerometers that ring on a structure that does not move the air: their specific force, not the aircraft's."""
    if cannot_be_shifted(flights):
        return []
    top = _OF_BAND * min(highest_of(f) for f in flights)
    made = []
    for channel, response, drives in (("az", "CZ", ("de",)), ("ay", "CY", ("da", "dr"))):
        if not held(flights, (response,)) or not present(flights, (channel,)):
            continue
        for frequency in peaks(flights, (response,), 1, _LOWEST, top):
            for drive in (d for d in drives if moves(flights, d)):
                parameters = (EffectParameter(f"{channel} per {drive}", "m/s^2/rad", 10.0),)
                form = partial(_mode, parameters, partial(_shaken, channel, drive), f"{drive}, of the instruments only")
                made.append(of_shape(form, frequency, _DAMPINGS[1]))
    return made


def _shaken(channel: str, drive: str, frequency: float, damping: float) -> Callable[[Flight], Columns]:
    """Acceleration of a mode that a surface excites, over that of the drive at rest."""

    def errors(flight: Flight) -> list[Errors]:
        return [{channel: oscillate(flight[drive], flight.dt, frequency, damping) - flight[drive]}]

    return wrong_readings(errors)


def _clearest(flights: Flights, responses: Sequence[str], drive: str, top: float) -> list[float]:
    """Frequencies [Hz] of a mode with which a drive explains most of the differences, of each response alone."""
    tried = np.geomspace(_LOWEST, top, max(3, 1 + int(np.log(top / _LOWEST) / np.log(_RATIO))))
    explained = np.zeros(len(tried))
    moved = [r for r in responses if all(r in f.measured for f in flights)]
    target = {r: np.concatenate([_fast(f.difference[r]) for f in flights]) for r in moved}
    for k, frequency in enumerate(tried):
        waves = []
        for f in flights:
            swung = oscillate(f[drive], f.dt, float(frequency), _DAMPINGS[1])
            waves.append(np.column_stack([_fast(swung - f[drive]), _fast(f.rate(swung))]))
        Q = np.linalg.qr(np.vstack(waves))[0]
        explained[k] = max((float(np.sum((Q.T @ y) ** 2) / (y @ y)) for y in target.values() if y.any()), default=0.0)
    peaked = scipy.signal.argrelmax(np.pad(explained, 1))[0] - 1
    return [float(tried[k]) for k in sorted(peaked, key=lambda k: -explained[k])[:_SOUGHT]]


def _fast(x: Array) -> Array:
    """Second differences: what is slow, such as the error of a derivative, hides a mode."""
    return np.diff(x, 2)


def _size(flights: Flights, response: str, drive: str) -> float:
    rms = np.sqrt(np.mean([np.var(f[drive]) for f in flights]))
    return 0.2 * variation(flights, response) / float(rms)


def _needs(flights: Flights) -> str:
    if channels_with_input(flights):
        return ""
    if not coefficients(flights):
        return "simulated coefficients, or a simulated channel that an input drives"
    if _OF_BAND * min(highest_of(f) for f in flights) <= 2.0 * _LOWEST:
        return f"samples faster than {4.0 * _LOWEST / (0.32 * _OF_BAND):.0f} Hz"
    return "" if any(moves(flights, d) for _, drives in _FAMILIES for d in drives) else "a control that moves"


EFFECTS: tuple[Effect, ...] = (
    Effect(
        "structural-mode", "structural", "A lightly damped structural mode, excited by controls.",
        _needs, _variants,
        lambda found: f"A mode at {found.text('frequency')}, damping {found.text('damping', 100.0, '%')} of critical, "
        f"is excited by {found.variant.about}.",
        look_alikes=("turbulence", "slosh", "actuator-lag"),
        separated_by="a frequency sweep through the mode at two dynamic pressures", check="the ground vibration test",
    ),
)  # fmt: skip
