"""What stated tolerances of the simulation and of the instruments allow, as columns with priors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from structsel.aircraft import Tolerances
from structsel.comparison.flight import Flight
from structsel.comparison.noisy_simulation import readings_columns, simulated_noise
from structsel.comparison.nuisance import WITHIN_SAMPLE, Nuisance
from structsel.comparison.parameter_columns import (
    accelerometer_moved,
    inertia_columns,
    mass_columns,
    offset_columns,
    thrust_columns,
    vane_moved,
)
from structsel.comparison.plant import find_plant
from structsel.comparison.sensitivity import asked_wrongly, misread, reading
from structsel.nomenclature import (
    COEFFICIENTS,
    FORCE_COEFFICIENTS,
    LATERAL_COEFFICIENTS,
    LONGITUDINAL_COEFFICIENTS,
    MOMENT_COEFFICIENTS,
)
from structsel.numerics.arrays import Array

MAIN = {
    ("CX", "alpha"), ("CZ", "alpha"), ("CY", "beta"), ("Cl", "beta"), ("Cl", "p_hat"), ("Cl", "da"), ("Cm", "alpha"),
    ("Cm", "q_hat"), ("Cm", "de"), ("Cn", "beta"), ("Cn", "r_hat"), ("Cn", "dr"),
}  # fmt: skip
"""Derivatives that a simulation is expected to hold best."""

_ACROSS, _ALONG = ("beta", "abs(beta)", "p_hat", "r_hat", "da", "dr"), ("alpha", "q_hat", "de")
_OTHERS = {
    **{c: frozenset(_ACROSS) for c in LONGITUDINAL_COEFFICIENTS},
    **{c: frozenset(_ALONG) for c in LATERAL_COEFFICIENTS},
}
_SAMPLING = 0.25  # of a sampling interval
_FREE = 30.0  # times the usual tolerance, where one is stated to be free
_USUAL = Tolerances()
_ARM = 0.1  # of the chord: a lever arm that is not stated is known at least so well
_TURNED = ("alpha", "beta", "phi", "theta", "psi", "de", "da", "dr")
_BIAS = {"V": 0.3, "p": 0.001, "q": 0.001, "r": 0.001, "ax": 0.05, "ay": 0.05, "az": 0.05}
_LEVEL = dict.fromkeys(("V", "vn", "ve", "vd"), 0.3)  # m/s: a larger constant is wind
_UNSTATED = 0.005  # rad
_JUMPING = ("de", "da", "dr", "df", "throttle")
_ASKED = ("V", "alpha", "beta", "de", "da", "dr")
_JUMP, _ABOVE = 0.08, 3.0  # of a channel's span, and of the changes about it, above which a change is a jump
_MAX_JUMPS = 12
_SCALED = {"alpha": 1.0, "beta": 1.0, "V": 0.5, "phi": 0.5, "theta": 0.5, "psi": 0.5}
"""Of the stated tolerance: less for an airspeed system and a gyro that holds attitude than for a vane in its upwash."""
_CHANGED = 0.1  # of a constant error, by which it changes between recordings of one flight
_SURFACES = ("de", "da", "dr")
_SEPARATE_CLOCKS = (
    ("V",), ("alpha",), ("beta",), ("phi", "theta", "psi"), ("p", "q", "r"), ("ax", "ay", "az"), _SURFACES,
)  # fmt: skip


def tolerances_of(flights: Sequence[Flight]) -> list[Nuisance]:
    """Everything common to all flights that tolerances allow to be off.

    Parameters
    ----------
    flights : sequence of Flight
        Of one aircraft, with a stand-in of the simulation.
    """
    first = flights[0]
    stated = first.aircraft.tolerances
    made: list[Nuisance] = []

    def add(
        name: str,
        key: str,
        unit: str,
        columns: Sequence[Mapping[str, Array]],
        effect: str,
        factor: float = 1.0,
        least: float = 0.0,
        absent: str = "",
        ahead: bool = False,
        response: str = "",
    ) -> None:
        sd = math.hypot(_sd(stated, key, first.aircraft.cbar) * factor, least)
        if sd > 0.0 and _acts(columns):
            delivered = least > 0.0
            made.append(Nuisance(name, sd, unit, columns, least, delivered, effect, absent, ahead, response=response))

    noises = simulated_noise(flights)
    for response in first.simulated:
        if response not in COEFFICIENTS:
            wrong = {"scale": [f.simulated[response] for f in flights], **find_plant(flights, response).errors(flights)}
            for what, signals in wrong.items():
                each = [{response: x} for x in signals]
                add(f"{response}: {what}", "main", "relative", each, "wrong-derivative", response=response)
            if response in noises:
                made += readings_columns(flights, response, noises[response])
            continue
        if first.surrogate is None:
            continue
        polynomial = first.surrogate.polynomial
        for term, value in zip(polynomial.terms[response], polynomial.values[response]):
            name = "*".join(term)
            key = "main" if (response, name) in MAIN else "secondary"
            each = [{response: value * polynomial.column(f, term)} for f in flights]
            absent = "cross-coupling" if couples(response, term) else "missing-term"
            add(f"{response}: {name}", key, "relative", each, "wrong-derivative", absent=absent, response=response)
        rest = [{response: f.simulated[response] - f.surrogate.evaluate(f, response)} for f in flights if f.surrogate]
        level = float(np.sqrt(np.mean([np.mean(f.simulated[response] ** 2) for f in flights])))
        add(
            f"{response}: 1",
            "secondary",
            "-",
            [{response: np.ones(len(f))} for f in flights],
            "wrong-derivative",
            level,
        )
        # What the smooth states do not explain may be the noise of the states at which it was evaluated.
        made.append(Nuisance.of_noise(f"{response}: the rest", rest, response))
    if not set(COEFFICIENTS) & set(first.simulated):
        return made
    add("mass", "mass", "relative", [mass_columns(f) for f in flights], "mass-error")
    for axis in ("Ix", "Iy", "Iz"):
        add(f"inertia {axis}", "inertia", "relative", [inertia_columns(f, axis) for f in flights], "inertia-error")
    for k, axis in enumerate("xyz"):
        add(f"centre of gravity {axis}", "cg", "chords", [offset_columns(f, k) for f in flights], "cg-shift")
    add("thrust", "thrust", "relative", [thrust_columns(f) for f in flights], "thrust-scale")
    for channel, fraction in _SCALED.items():
        if all(channel in f.recorded for f in flights):
            add(
                f"{channel} scale",
                "vane_scale",
                "relative",
                [misread(f, **{channel: f[channel]}) for f in flights],
                "sensor-scale",
                fraction,
            )
    for one, other in (("ax", "az"), ("ax", "ay"), ("ay", "az"), ("p", "r"), ("p", "q"), ("q", "r")):
        each = [misread(f, **{one: reading(f, other), other: -reading(f, one)}) for f in flights]
        add(f"{one} and {other} turned", "alignment", "rad", each, "sensor-misalignment")
    # Nothing recorded at intervals is registered better than to a fraction of one.
    timing = _SAMPLING * float(np.median([f.dt for f in flights]))
    for channels in _SEPARATE_CLOCKS:
        here = [c for c in channels if all(c in f.recorded for f in flights)]
        if here:
            each = [misread(f, **{c: -f.rate(reading(f, c)) for c in here}) for f in flights]
            later = channels is not _SURFACES
            add(f"{', '.join(here)} late", "delay", "s", each, "sensor-delay", least=timing, ahead=later)
    for group in (COEFFICIENTS[:3], COEFFICIENTS[3:]):
        each = [{c: f.rate(f.simulated[c]) for c in group if c in f.simulated} for f in flights]
        add(f"simulated {', '.join(group)} late", "delay", "s", each, "sensor-delay", least=timing, ahead=True)
    made += _held(flights, timing)
    made += _noise_asked_at(flights)
    for k, axis in enumerate("xyz"):
        add(f"accelerometer {axis}", "lever_arm", "m", [accelerometer_moved(f, k) for f in flights], "sensor-position")
        if axis != "y":
            add(f"vane {axis}", "lever_arm", "m", [vane_moved(f, k) for f in flights], "sensor-position")
    return made + _shared_errors(flights)


def couples(response: str, term: Sequence[str]) -> bool:
    """Whether a term is of the other family: longitudinal and lateral motion are then not apart."""
    return not _OTHERS[response].isdisjoint(term)


def _acts(columns: Sequence[Mapping[str, Array]]) -> bool:
    return any(np.any(x) for one in columns for x in one.values())


def _held(flights: Sequence[Flight], timing: float) -> list[Nuisance]:
    """Change of each response if inputs are held over each sample, and averaged over steps in between."""
    sd = 4.0 * timing**2
    names = [c for c in COEFFICIENTS if c in flights[0].simulated]
    turns = {c: [{c: f.rate(f.rate(f.simulated[c]))} for f in flights] for c in names}
    return [Nuisance(f"{c} over a step", sd, "s^2", turns[c], sd, True, ahead=True) for c in names]


def _noise_asked_at(flights: Sequence[Flight]) -> list[Nuisance]:
    """Response of a simulation, evaluated at the readings, to their noise, which the aircraft does not have.

    In a surface that hardly moves it would pass for dead play, and as a drive for anything that rings.
    """
    made = []
    for c in _ASKED:
        if all(c in f.recorded for f in flights):
            noise = [f.raw[c] - f.air.get(c, f.channels[c]) for f in flights]
            each = [{r: a * x for r, a in asked_wrongly(f, c).items()} for f, x in zip(flights, noise)]
            if _acts(each):
                made.append(Nuisance.of_noise(f"noise of {c}", each))
    return made


def biases_of(flight: Flight) -> list[tuple[str, float, Mapping[str, Array]]]:
    """Constant errors of one recording's instruments: name, 1 sigma, and what one unit does.

    Of a recording that is part of a flight, their changes since the other parts.
    """
    if not set(COEFFICIENTS) & set(flight.simulated):
        size = {c: _LEVEL.get(c, float(np.ptp(flight.measured[c]))) for c in flight.simulated}
        return [(f"{c}: offset", size[c], {c: np.ones(len(flight))}) for c in size]
    changed = _CHANGED if flight.sequence else 1.0
    made = [(c, changed * sd, x) for (c, _), (sd, x) in _constant_errors(flight).items()]
    for c in _JUMPING:
        for jump in _jumps(flight, c):
            every = _jumped(flight, c, jump)
            # Forces are read at one time, moments are averages between samples: they show different parts of a jump.
            for group in (FORCE_COEFFICIENTS, MOMENT_COEFFICIENTS):
                if own := {r: x for r, x in every.items() if r in group}:
                    made.append((f"when {c} jumps, {group[0]} to {group[-1]}", WITHIN_SAMPLE, own))
    return made


def _constant_errors(flight: Flight) -> dict[tuple[str, int], tuple[float, Mapping[str, Array]]]:
    """Constant errors of the instruments, numbered for each channel: 1 sigma, and what one unit does."""
    turned = _sd(flight.aircraft.tolerances, "alignment", flight.aircraft.cbar) or _UNSTATED
    sizes: dict[str, float] = {**dict.fromkeys(_TURNED, turned), **_BIAS}
    return {
        (c, k): (sd, x) for c, sd in sizes.items() if c in flight.recorded for k, x in enumerate(_biased(flight, c))
    }


def _shared_errors(flights: Sequence[Flight]) -> list[Nuisance]:
    """Constant errors of instruments that the recordings of one flight share."""
    made = []
    for sequence in dict.fromkeys(f.sequence for f in flights if f.sequence):
        each = [_constant_errors(f) if f.sequence == sequence else {} for f in flights]
        for error, (sd, _) in {k: v for errors in each for k, v in errors.items()}.items():
            columns = [errors[error][1] if error in errors else {} for errors in each]
            made.append(Nuisance(f"{error[0]}: bias", sd, "", columns, least=sd, constant=True))
    return made


def _jumped(flight: Flight, channel: str, jump: Array) -> dict[str, Array]:
    """What a jump that came one sampling interval later does: from then on, a moment's integral lacks that interval."""
    return {
        c: flight.rate(np.cumsum(x) * flight.dt) if c in MOMENT_COEFFICIENTS else x
        for c, x in misread(flight, **{channel: jump}).items()
    }


def _biased(flight: Flight, channel: str) -> list[Mapping[str, Array]]:
    """Change by a unit of constant error of a reading; separately that of a simulation evaluated at other states."""
    complete = misread(flight, **{channel: 1.0})
    if not flight.apart:
        return [complete]
    asked = asked_wrongly(flight, channel)
    read = {c: left for c, x in complete.items() if np.any(left := x - asked.get(c, 0.0))}
    return [columns for columns in (read, asked) if columns]


def _jumps(flight: Flight, channel: str) -> list[Array]:
    """Each jump of an input, at the sample that first shows it: it may have come anywhere since the last.

    Were it later by a part of a sampling interval, the input would have been that part of the jump less there.
    """
    if channel not in flight.recorded or not np.ptp(flight.raw[channel]):
        return []
    steps = np.diff(flight.raw[channel])
    size = np.abs(steps)
    neighbours = np.maximum(np.concatenate([[0.0, 0.0], size[:-2]]), np.concatenate([size[2:], [0.0, 0.0]]))
    jumps = np.flatnonzero((size > _JUMP * np.ptp(flight.raw[channel])) & (size > _ABOVE * neighbours))
    found = jumps[np.argsort(-size[jumps])][:_MAX_JUMPS]
    return [np.where(np.arange(len(flight)) == k + 1, steps[k], 0.0) for k in found]


def _sd(stated: Tolerances, key: str, cbar: float) -> float:
    value = getattr(stated, key)
    if value == "exact":
        return 0.0
    usual = float(getattr(_USUAL, key))
    if key == "lever_arm":
        usual = min(usual, _ARM * cbar)
    if value == "free":
        return _FREE * usual
    return float(value) if key in stated.model_fields_set else usual
