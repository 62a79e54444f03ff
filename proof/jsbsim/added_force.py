"""Forces and moments that are added to a JSBSim aircraft step by step: coefficients, with or without memory."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from proof.keys import Kind
from structsel.aircraft import Aircraft

Now = Mapping[str, float]
Six = tuple[float, ...]
"""CX, CY, CZ, Cl, Cm, Cn."""
Memory = dict[str, float]
Formula = Callable[[Now, Memory, float], Six]
"""Of what the aircraft does now, what the formula remembers, and the step [s]."""
Make = Callable[[np.random.Generator, Aircraft, dict[int, float]], tuple[Formula, dict[str, float]]]
"""(rng, aircraft, events) -> formula, parameters; events map the number of a manoeuvre to an instant in it [s]."""


@dataclass(eq=False)
class AddedForce:
    """A formula of what the aircraft does, times a size; satisfies `flight.AddedEffect`.

    Attributes
    ----------
    formula : Formula
    size : float
    memory : dict
        The formula's own, emptied when a manoeuvre begins.
    shape : bool
        The size is in the memory, as "size", instead of a factor.
    """

    formula: Formula
    size: float = 1.0
    memory: Memory = field(default_factory=dict)
    dt: float = 0.01
    shape: bool = False

    def start(self, now: Now, dt: float) -> None:
        """Begin a manoeuvre."""
        self.memory.clear()
        self.memory["size"] = self.size
        self.dt = dt

    def coefficients(self, now: Now) -> np.ndarray:
        """(6,) coefficients."""
        made = np.array(self.formula(now, self.memory, self.dt))
        return made if self.shape else self.size * made


@dataclass(frozen=True)
class AddedForceSpec:
    """An added force as it may be drawn.

    Attributes
    ----------
    make : Make
    kind : str
    needs : tuple of str
        Purposes of manoeuvres that show it.
    tie, accept : tuple of str
    region : str
        Channel that bounds it.
    local : bool
        Acts in intervals of time only.
    power : {"", "propeller", "jet"}
        Only aircraft with this.
    largest, smallest : float
        Sizes that are plausible, and more than a tolerance.
    shape : bool
        As of `AddedForce`.
    lift : (low, high)
        Lift coefficients of its flights.
    """

    make: Make
    kind: Kind
    needs: tuple[str, ...] = ()
    tie: tuple[str, ...] = ()
    accept: tuple[str, ...] = ()
    region: str = ""
    local: bool = False
    power: str = ""
    largest: float = 3.0
    smallest: float = 0.003
    shape: bool = False
    lift: tuple[float, float] = (0.3, 0.6)


def lagged(memory: Memory, name: str, value: float, dt: float, tau: float) -> float:
    """First-order lag of a value, started on it."""
    held = memory.get(name, value)
    held += (value - held) * (1.0 - math.exp(-dt / tau))
    memory[name] = held
    return held


def body_axes(lift: float, drag: float, now: Now) -> tuple[float, float]:
    """CX and CZ of lift and drag coefficients."""
    sa, ca = math.sin(now["alpha"]), math.cos(now["alpha"])
    return lift * sa - drag * ca, -lift * ca - drag * sa
