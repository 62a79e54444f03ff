"""An effect in some manoeuvres only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from structsel.comparison.flight import Flight
from structsel.effects.base import Flights, Variant


def confined(flights: Flights, variant: Variant) -> Variant | None:
    """The same, in those manoeuvres only in which the differences have it; None where that is all of them, or one.

    Parameters
    ----------
    flights : sequence of Flight
    variant : Variant
        Of one parameter.
    """
    power = {r: sum(float(f.difference[r].var()) for f in flights) for r in flights[0].difference}
    with_difference, with_itself = np.array([_products(variant, f, power) for f in flights]).T
    sizes = with_difference / np.maximum(with_itself, 1e-30)
    best: tuple[float, tuple[str, ...]] = (0.0, ())
    for sign in (1.0, -1.0):
        order = np.argsort(-sign * sizes)
        explained = np.cumsum(sign * with_difference[order])
        explained = np.maximum(explained, 0.0) ** 2 / np.maximum(np.cumsum(with_itself[order]), 1e-30)
        best_count = int(np.argmax(explained))
        best = max(
            best, (float(explained[best_count]), tuple(sorted(flights[i].name for i in order[: best_count + 1])))
        )
    on = best[1]
    if not 1 < len(on) < len(flights):
        return None
    return replace(variant, columns=lambda flight: variant.columns(flight) if flight.name in on else {}, only_in=on)


def _products(variant: Variant, flight: Flight, power: Mapping[str, float]) -> tuple[float, float]:
    """Sums over responses of a form's column with the difference, and with itself, each over the response's power."""
    total = np.zeros(2)
    for response, column in variant.columns(flight).items():
        x, y = (z - z.mean() for z in (column[:, 0], flight.difference[response]))
        total += np.array([x @ y, x @ x]) / max(power[response], 1e-30)
    return float(total[0]), float(total[1])
