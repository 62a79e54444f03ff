"""One thing that tolerances allow to be off."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from structsel.numerics.arrays import Array

WITHIN_SAMPLE = 0.29  # of a sampling interval: standard deviation of what lies anywhere in it


@dataclass(frozen=True)
class Nuisance:
    """One thing that may be off, and by how much.

    Attributes
    ----------
    name : str
    sd : float
        1 sigma, in `unit`.
    unit : str
    columns : mapping of response to (n,) array, one mapping per flight
        What one `unit` of it adds to measured less simulated.
    least : float
        Part of `sd` that does not come of a stated tolerance: sampling, noise in the states.
    delivered : bool
        Whether it is free before any refit: a matter of sampling and evaluation, not of the simulation's parameters.
    effect : str
        Name of the effect that it is where it is larger than the tolerance; empty where no tolerance is stated for it.
    absent : str
        Name where it deviates by more than its own value, so that the simulation has nothing of the kind.
    ahead : bool
        Whether its columns contain later samples of the motion, as a rate does.
    constant : bool
        Whether it is a constant error of an instrument.
    response : str
        Response of which it is a fraction, or a fraction of a term; empty for all others.
    """

    name: str
    sd: float
    unit: str
    columns: Sequence[Mapping[str, Array]]
    least: float = 0.0
    delivered: bool = False
    effect: str = ""
    absent: str = ""
    ahead: bool = False
    constant: bool = False
    response: str = ""

    @classmethod
    def of_noise(cls, name: str, columns: Sequence[Mapping[str, Array]], response: str = "") -> Nuisance:
        """Noise of any size, which is free before any refit."""
        return cls(name, 1.0, "relative", columns, 1.0, True, ahead=True, response=response)

    def scale(self, fraction: float) -> float:
        """Factor on `sd` where errors are this fraction of the stated tolerances."""
        least = min(1.0, self.least / self.sd)
        return math.sqrt(least**2 + fraction**2 * (1.0 - least**2))
