"""Propellers: their wash over the rest of the aircraft, and what flow across their shaft does to them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from structsel.hypotheses.base import Flights, Parameter, Variant
from structsel.hypotheses.signals import FORCES, Parts, moves, of_parts
from structsel.mismatch.flight import Flight
from structsel.mismatch.responses import COEFFICIENTS
from structsel.numerics.smoothing.result import Array

_WASHED: tuple[tuple[str, tuple[tuple[str, tuple[str, ...], float], ...]], ...] = (
    ("at the elevator", (("Cm", ("de",), 1.0),)),
    ("at the rudder", (("Cn", ("dr",), 0.1),)),
    ("at tail and wing, each by its own", (
        ("Cm", (), 0.1), ("Cm", ("alpha",), 0.6), ("Cm", ("de",), 1.0), ("CZ", (), 0.3), ("CZ", ("alpha",), 2.0),
    )),
    ("at tail, wing and fin, each by its own", (
        ("Cm", (), 0.1), ("Cm", ("de",), 1.0), ("CZ", (), 0.3), ("CZ", ("alpha",), 2.0), ("Cn", (), 0.02),
        ("Cl", (), 0.02), ("Cn", ("dr",), 0.1),
    )),
)  # fmt: skip
"""Where wash arrives: response, what it is times the thrust coefficient, and how large that is taken to be."""


# Slipstream


def _washed_controls(f: Flight) -> list[tuple[str, int, Array]]:
    """More dynamic pressure at the tail: the elevator's and the rudder's share of all coefficients grow with CT."""
    return [
        (r, 0, f["CT"] * sum(f.slope(r, c) * f[c] for c in ("de", "dr") if c in f.recorded))
        for r in COEFFICIENTS
        if r in f.measured
    ]


def slipstream_variants(flights: Flights) -> list[Variant]:
    """Wash over wing, tailplane, fin and controls: with one power for all controls, and each by its own."""
    controls = Parameter("control power per CT", "-", 1.0, -1.0, 6.0)
    tail = (Parameter("Cm per CT", "-", 0.1), Parameter("Cm per CT*alpha", "1/rad", 0.6))
    wing = (Parameter("CZ per CT", "-", 0.3), Parameter("CZ per CT*alpha", "1/rad", 2.0))
    fin = (
        Parameter("Cn per CT", "-", 0.02),
        Parameter("Cl per CT", "-", 0.02),
        Parameter("Cn per CT*beta", "1/rad", 0.1),
    )

    def pitch(f: Flight, j: int) -> list[tuple[str, int, Array]]:
        return [("Cm", j, f["CT"]), ("Cm", j + 1, f["CT"] * f["alpha"])]

    def lift(f: Flight, j: int) -> list[tuple[str, int, Array]]:
        return [("CZ", j, f["CT"]), ("CZ", j + 1, f["CT"] * f["alpha"])]

    def yaw(f: Flight, j: int) -> list[tuple[str, int, Array]]:
        return [("Cn", j, f["CT"]), ("Cl", j + 1, f["CT"]), ("Cn", j + 2, f["CT"] * f["beta"])]

    made = [
        of_parts(tail, lambda f: pitch(f, 0), "at the tailplane", terms=("CT", "CT*alpha")),
        of_parts(wing, lambda f: lift(f, 0), "over the wing", terms=("CT", "CT*alpha")),
        of_parts(fin, lambda f: yaw(f, 0), "at the fin, turning", terms=("CT", "CT*beta")),
        of_parts(tail + wing, lambda f: pitch(f, 0) + lift(f, 2), "over wing and tailplane", ("CT", "CT*alpha")),
    ]
    if any(moves(flights, c) for c in ("de", "dr")):
        washed = ("CT*de", "CT*dr", "CT", "CT*alpha")
        made += [
            of_parts((controls,), _washed_controls, "over the controls", terms=("CT*de", "CT*dr")),
            of_parts((controls, *tail), lambda f: _washed_controls(f) + pitch(f, 1), "over tailplane and controls",
                washed,
            ),
            of_parts(
                (controls, *tail, *wing), lambda f: _washed_controls(f) + pitch(f, 1) + lift(f, 3),
                "over wing, tailplane and controls", washed,
            ),
            of_parts(
                (controls, *tail, *wing, *fin),
                lambda f: _washed_controls(f) + pitch(f, 1) + lift(f, 3) + yaw(f, 5), "over all of the aircraft",
                (*washed, "CT*beta"),
            ),
        ]  # fmt: skip
    # Wash that reaches some parts only: each term of these by its own.
    for about, each in _WASHED:
        parameters = tuple(Parameter(f"{r} per {'*'.join(('CT', *c))}", "-", sd) for r, c, sd in each)
        if all(moves(flights, x) for _, c, _ in each for x in c):
            made.append(of_parts(parameters, partial(_washed, each=each), about, tuple(
                dict.fromkeys("*".join(("CT", *c)) for _, c, _ in each)
            )))  # fmt: skip
    return made


def _washed(f: Flight, each: Sequence[tuple[str, tuple[str, ...], float]]) -> Parts:
    return [(r, j, np.prod([f["CT"], *(f[x] for x in c)], axis=0)) for j, (r, c, _) in enumerate(each)]


# Flow across the shaft


def propeller_variants(flights: Flights) -> list[Variant]:
    """Force across the shaft and thrust beside it, as of a disc, and each response by its own."""
    craft = flights[0].craft
    normal = Parameter("force per CT", "1/rad", 1.0, -1.0, 6.0)
    arm = Parameter("moment per CT", "m/rad", 1.0 * craft.cbar)
    factor = Parameter("P-factor", "m/rad", 0.2 * craft.b)
    swirl = (Parameter("Cn per CT", "-", 0.01), Parameter("Cl per CT", "-", 0.01))

    def across(f: Flight) -> list[tuple[str, int, Array]]:
        a, b = f["CT"] * f["alpha"], f["CT"] * f["beta"]
        return [("CZ", 0, -a), ("CY", 0, -b), ("Cm", 1, a / craft.cbar), ("Cn", 1, -b / craft.b)]

    def turning(f: Flight, j: int) -> list[tuple[str, int, Array]]:
        # The blade going down meets more air: the line of thrust moves to its side with alpha, and likewise with beta.
        return [("Cn", j, -f["CT"] * f["alpha"] / craft.b), ("Cm", j, -f["CT"] * f["beta"] / craft.cbar)]

    def swirling(f: Flight, j: int) -> list[tuple[str, int, Array]]:
        return [("Cn", j, f["CT"]), ("Cl", j + 1, f["CT"])]

    # Blades differ: what thrust gains to the side of alpha and of beta, and where that acts, need not follow the disc.
    freely = (
        ("CZ", "alpha"), ("CY", "beta"), ("Cm", "alpha"), ("Cn", "alpha"), ("Cm", "beta"), ("Cn", "beta"),
    )  # fmt: skip
    each = tuple(Parameter(f"{r} per CT*{c}", "1/rad", 1.0 if r in FORCES else 0.5) for r, c in freely)

    def free(f: Flight, first: int, last: int) -> list[tuple[str, int, Array]]:
        return [(r, j, f["CT"] * f[c]) for j, (r, c) in enumerate(freely[first:last])]

    turned = ("CT*alpha", "CT*beta")
    return [
        *(
            of_parts(each[i:k], partial(free, first=i, last=k), about, turned)
            for i, k, about in ((3, 4, "yaw alone"), (0, 4, "forces and moments of their own"), (0, 6, "freely"))
        ),
        of_parts((normal, arm), across, "force across the shaft", terms=("CT*alpha", "CT*beta")),
        of_parts((factor,), lambda f: turning(f, 0), "P-factor", terms=("CT*alpha", "CT*beta")),
        of_parts(
            (factor, *swirl),
            lambda f: turning(f, 0) + swirling(f, 1),
            "P-factor and swirl",
            ("CT*alpha", "CT*beta", "CT"),
        ),
        of_parts(
            (normal, arm, factor), lambda f: across(f) + turning(f, 2), "force across the shaft and P-factor", turned
        ),
    ]
