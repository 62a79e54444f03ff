"""Propellers: their wash over the rest of the aircraft, and what flow across their shaft does to them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from structsel.comparison.flight import Flight
from structsel.effects.base import EffectParameter, Flights, Variant
from structsel.effects.signals import moves, of_parts, per_unit
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array

Term = tuple[str, tuple[str, ...], float]
"""Response, what the thrust coefficient is multiplied with, and how large the product's coefficient is taken to be."""

_TAIL: tuple[Term, ...] = (("Cm", (), 0.1), ("Cm", ("alpha",), 0.6))
_WING: tuple[Term, ...] = (("CZ", (), 0.3), ("CZ", ("alpha",), 2.0))
_FIN: tuple[Term, ...] = (("Cn", (), 0.02), ("Cl", (), 0.02), ("Cn", ("beta",), 0.1))
_SWIRL: tuple[Term, ...] = (("Cn", (), 0.01), ("Cl", (), 0.01))
_PLACES = (
    ("at the tailplane", _TAIL), ("over the wing", _WING), ("at the fin, turning", _FIN),
    ("over wing and tailplane", _TAIL + _WING),
)  # fmt: skip
_WITH_CONTROLS: tuple[tuple[str, tuple[Term, ...]], ...] = (
    ("over the controls", ()), ("over tailplane and controls", _TAIL),
    ("over wing, tailplane and controls", _TAIL + _WING), ("over all of the aircraft", _TAIL + _WING + _FIN),
)  # fmt: skip
_PARTS: tuple[tuple[str, tuple[Term, ...]], ...] = (
    ("at the elevator", (("Cm", ("de",), 1.0),)),
    ("at the rudder", (("Cn", ("dr",), 0.1),)),
    ("at tail and wing, each by its own", (*_TAIL, ("Cm", ("de",), 1.0), *_WING)),
    ("at tail, wing and fin, each by its own", (
        ("Cm", (), 0.1), ("Cm", ("de",), 1.0), *_WING, ("Cn", (), 0.02), ("Cl", (), 0.02), ("Cn", ("dr",), 0.1),
    )),
)  # fmt: skip
_ACROSS: tuple[Term, ...] = (
    ("CZ", ("alpha",), 1.0), ("CY", ("beta",), 1.0), ("Cm", ("alpha",), 0.5), ("Cn", ("alpha",), 0.5),
    ("Cm", ("beta",), 0.5), ("Cn", ("beta",), 0.5),
)  # fmt: skip
"""Blades differ: what thrust gains to the side of alpha and of beta, and where, need not follow the disc."""


def _parameters(each: Sequence[Term]) -> tuple[EffectParameter, ...]:
    return tuple(EffectParameter(f"{r} per {_term(c)}", per_unit(c), sd) for r, c, sd in each)


def _term(channels: Sequence[str]) -> str:
    return "*".join(("CT", *channels))


def _terms(each: Sequence[Term], *more: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys((*more, *(_term(c) for _, c, _ in each))))


def _grown(f: Flight, each: Sequence[Term], first: int = 0) -> list[tuple[str, int, Array]]:
    return [(r, first + j, np.prod([f["CT"], *(f[x] for x in c)], axis=0)) for j, (r, c, _) in enumerate(each)]


def _each(about: str, each: Sequence[Term]) -> Variant:
    """Each term by its own."""
    return of_parts(_parameters(each), partial(_grown, each=each), about, _terms(each))


# Slipstream


def _washed(f: Flight, each: Sequence[Term]) -> list[tuple[str, int, Array]]:
    """More dynamic pressure at the tail: the part of the controls grows with CT, in addition to other terms."""
    controls = [
        (r, 0, f["CT"] * sum(f.slope(r, c) * f[c] for c in ("de", "dr") if c in f.recorded))
        for r in COEFFICIENTS
        if r in f.measured
    ]
    return controls + _grown(f, each, 1)


def slipstream_variants(flights: Flights) -> list[Variant]:
    """Wash over wing, tailplane, fin and controls: with one power for all controls, and each by its own."""
    made = [_each(about, each) for about, each in _PLACES]
    power = EffectParameter("control power per CT", "-", 1.0, -1.0, 6.0)
    if any(moves(flights, c) for c in ("de", "dr")):
        made += [
            of_parts((power, *_parameters(each)), partial(_washed, each=each), about, _terms(each, "CT*de", "CT*dr"))
            for about, each in _WITH_CONTROLS
        ]
    return made + [
        _each(about, each) for about, each in _PARTS if all(moves(flights, x) for _, c, _ in each for x in c)
    ]


# Flow across the shaft


def propeller_variants(flights: Flights) -> list[Variant]:
    """Force across the shaft and thrust beside it, as of a disc, and each response by its own."""
    aircraft = flights[0].aircraft
    normal = EffectParameter("force per CT", "1/rad", 1.0, -1.0, 6.0)
    arm = EffectParameter("moment per CT", "m/rad", 1.0 * aircraft.cbar)
    factor = EffectParameter("P-factor", "m/rad", 0.2 * aircraft.b)

    def across(f: Flight) -> list[tuple[str, int, Array]]:
        a, b = f["CT"] * f["alpha"], f["CT"] * f["beta"]
        return [("CZ", 0, -a), ("CY", 0, -b), ("Cm", 1, a / aircraft.cbar), ("Cn", 1, -b / aircraft.b)]

    def turning(f: Flight, j: int) -> list[tuple[str, int, Array]]:
        # The blade going down meets more air: the line of thrust moves to its side with alpha, and likewise with beta.
        return [("Cn", j, -f["CT"] * f["alpha"] / aircraft.b), ("Cm", j, -f["CT"] * f["beta"] / aircraft.cbar)]

    turned = _terms(_ACROSS)
    return [
        _each("yaw alone", _ACROSS[3:4]),
        _each("forces and moments of their own", _ACROSS[:4]),
        _each("freely", _ACROSS),
        of_parts((normal, arm), across, "force across the shaft", turned),
        of_parts((factor,), lambda f: turning(f, 0), "P-factor", turned),
        of_parts(
            (factor, *_parameters(_SWIRL)), lambda f: turning(f, 0) + _grown(f, _SWIRL, 1), "P-factor and swirl",
            (*turned, "CT"),
        ),
        of_parts(
            (normal, arm, factor), lambda f: across(f) + turning(f, 2), "force across the shaft and P-factor", turned
        ),
    ]  # fmt: skip
