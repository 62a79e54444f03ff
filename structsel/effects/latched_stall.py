"""A stall that holds: flow separates at one angle of attack at once, and attaches again at a smaller one."""

from __future__ import annotations

from functools import partial

import numpy as np

from structsel.comparison.flight import Flight
from structsel.effects.base import Columns, EffectParameter, Flights, Variant, of_shape
from structsel.effects.signals import signature
from structsel.numerics.compiling import njit

LATCH = "separated until a smaller angle"
_LATCHING, _RELEASING = (0.75, 0.85, 0.95), (0.4, 0.6, 0.8)
"""Of the largest angle of attack, where the flow separates; of that, where it attaches again."""


def latched_variants(flights: Flights, top: float) -> list[Variant]:
    """Flow that separates at one angle, and attaches again at a smaller one; coefficients of its own in between."""
    parameters = tuple(
        EffectParameter(f"{r}{more}", unit, sd)
        for more, unit, factor in (("", "-", 1.0), (" per alpha", "1/rad", 5.0))
        for r, sd in (("CZ", 0.3 * factor), ("CX", 0.1 * factor), ("Cm", 0.05 * factor))
    )

    def form(onset: float, release: float) -> Variant:
        shape = {"onset": onset, "release": release}
        columns = partial(latched, onset=onset, release=release)
        return Variant(parameters, columns, shape, dict.fromkeys(shape, "rad"), LATCH)

    return [of_shape(form, high * top, low * high * top) for high in _LATCHING for low in _RELEASING]


def latched(flight: Flight, onset: float, release: float) -> Columns:
    """Increment of each coefficient while the flow is separated, and its slope with the angle of attack."""
    alpha = flight["alpha"]
    separated = np.empty(len(alpha))
    _latch(np.ascontiguousarray(alpha), onset, release, separated)
    parts = [(r, j, separated) for j, r in enumerate(("CZ", "CX", "Cm"))]
    parts += [(r, 3 + j, separated * (alpha - onset)) for j, r in enumerate(("CZ", "CX", "Cm"))]
    return signature(flight, 6, parts)


@njit(cache=True)
def _latch(x, onset, release, made):  # type: ignore[no-untyped-def]  # pragma: no cover
    """One from where x exceeds the onset until it falls below the release."""
    state = 0.0
    for k in range(x.size):
        if x[k] > onset:
            state = 1.0
        elif x[k] < release:
            state = 0.0
        made[k] = state
