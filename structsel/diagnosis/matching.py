"""Which terms of a model an effect's columns are, if they are any."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from structsel.candidates import Term
from structsel.comparison.flight import Flight
from structsel.effects.base import Variant
from structsel.effects.signals import CHANNELS_OF, lift, moves
from structsel.errors import StructselError
from structsel.numerics.arrays import Array

_TURNED = ("sin(alpha)", "cos(alpha)")
LIFT = "CL"
"""In terms of an effect, the lift as simulated."""
_EXACT = 1e-7
"""Of a column's largest value, that its terms may miss by."""
_NOTHING = 1e-9  # of it, below which a term is none


def exact_terms(variant: Variant, flights: Sequence[Flight]) -> dict[str, dict[Term, Array]] | None:
    """Terms whose fixed sums are the columns of an effect, in all flights.

    The terms that the form states are tried first, then the same terms in body axes, then both with the linear terms of
    the response, to which some forms are orthogonal.

    Parameters
    ----------
    variant : Variant
    flights : sequence of Flight

    Returns
    -------
    mapping of response to mapping of Term to (k,) array, or None
        Value of each term per unit of each parameter; None if a column is no such sum.
    """
    columns = [variant.columns(f) for f in flights]
    responses = sorted({c for each in columns for c in each})
    named = [Term(f"abs({t.strip('|')})" if t.startswith("|") else t) for t in variant.terms]
    turned = [t * Term(other) for t in named for other in _TURNED]
    found: dict[str, dict[Term, Array]] = {}
    for response in responses:
        y = np.concatenate([each.get(response, np.zeros((len(f), len(variant.parameters))))
                            for f, each in zip(flights, columns)])  # fmt: skip
        further = [Term("1"), *(Term(c) for c in CHANNELS_OF.get(response, ()) if moves(flights, c))]
        for tried in (named, [*named, *turned], [*named, *turned, *further], [Term("1")]):
            if tried and (weights := _match(list(dict.fromkeys(tried)), flights, y)) is not None:
                found[response] = weights
                break
        else:
            return None
    return found


class _Lifting:
    """A flight with the simulated lift as its channel CL."""

    def __init__(self, flight: Flight):
        self._flight = flight

    def __contains__(self, name: str) -> bool:
        return name == LIFT or name in self._flight

    def __getitem__(self, name: str) -> Array:
        return lift(self._flight) if name == LIFT else self._flight[name]

    def __len__(self) -> int:
        return len(self._flight)


def _match(terms: Sequence[Term], flights: Sequence[Flight], y: Array) -> dict[Term, Array] | None:
    """Weights (k,) of terms whose sums are the columns (n, k); None if there are none."""
    try:
        X = np.concatenate([np.column_stack([t.evaluate(_Lifting(f)) for t in terms]) for f in flights])
    except StructselError:
        return None
    size, largest = np.abs(X).max(axis=0), np.abs(y).max(axis=0)
    if not largest.any():
        return {}
    scaled = X / np.where(size > 0.0, size, 1.0)
    weights = np.linalg.lstsq(scaled, y, rcond=1e-13)[0]
    if (np.abs(y - scaled @ weights).max(axis=0) > _EXACT * largest).any():
        return None
    kept = (np.abs(weights) > _NOTHING * np.where(largest > 0.0, largest, 1.0)).any(axis=1) & (size > 0.0)
    weights = np.linalg.lstsq(scaled[:, kept], y, rcond=1e-13)[0] / size[kept, None]
    return dict(zip([t for t, k in zip(terms, kept) if k], weights))
