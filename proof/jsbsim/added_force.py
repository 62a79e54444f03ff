"""Forces and moments that are added to a JSBSim aircraft step by step: coefficients, with or without memory."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

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


def delayed(memory: Memory, name: str, value: float, dt: float, delay: float) -> float:
    """A value some time ago, to a step; the first one before that."""
    step = memory.get(f"{name}: steps", 0.0)
    memory[f"{name}: {step:g}"], memory[f"{name}: steps"] = value, step + 1.0
    return memory[f"{name}: {max(step - round(delay / dt), 0.0):g}"]


def body_axes(lift: float, drag: float, now: Now) -> tuple[float, float]:
    """CX and CZ of lift and drag coefficients."""
    sa, ca = math.sin(now["alpha"]), math.cos(now["alpha"])
    return lift * sa - drag * ca, -lift * ca - drag * sa


Given = dict[str, float]
Static = Callable[[Now, Given, Aircraft], Six]
Term = Callable[[Now, Aircraft], float]

ADDED_FORCES: dict[str, list[AddedForceSpec]] = {}
"""Effect -> its forms."""


def _register(effect: str, make: Make, kind: Kind, needs: tuple[str, ...], tie: tuple[str, ...], more: Any) -> None:
    ADDED_FORCES.setdefault(effect, []).append(AddedForceSpec(make, kind, needs, tie, **more))


def with_memory(
    effect: str, kind: Kind, needs: tuple[str, ...], tie: tuple[str, ...] = (), **more: Any
) -> Callable[[Make], Make]:
    """Enter a maker of a formula under its effect."""

    def enter(make: Make) -> Make:
        _register(effect, make, kind, needs, tie, more)
        return make

    return enter


def static(
    effect: str,
    kind: Kind,
    needs: tuple[str, ...],
    tie: tuple[str, ...] = (),
    draw: Callable[[np.random.Generator], Given] = lambda rng: {},
    **more: Any,
) -> Callable[[Static], Static]:
    """Enter a formula without memory under its effect; `draw` gives its parameters."""

    def enter(build: Static) -> Static:
        def make(rng: np.random.Generator, a: Aircraft, events: dict[int, float]) -> tuple[Formula, Given]:
            given = draw(rng)
            return (lambda now, memory, dt: build(now, given, a)), given

        _register(effect, make, kind, needs, tie, more)
        return build

    return enter


def event(
    effect: str, kind: Kind, tie: tuple[str, ...], takes: tuple[float, float]
) -> Callable[[Callable[[Now, float, Given], Six]], object]:
    """Enter what comes at an instant of some manoeuvres; the formula is given how much of it is there, 0 to 1."""

    def enter(build: Callable[[Now, float, Given], Six]) -> object:
        def make(rng: np.random.Generator, a: Aircraft, events: dict[int, float]) -> tuple[Formula, Given]:
            length = float(rng.uniform(*takes))
            given = {"lift": rng.uniform(0.5, 1.5), "side": float(rng.choice([-1.0, 1.0]))}

            def formula(now: Now, memory: Memory, dt: float) -> Six:
                at = events.get(int(now["number"]))
                fraction = 0.0 if at is None else min(1.0, max(0.0, (now["t"] - at) / length))
                return build(now, fraction, given)

            return formula, {"takes": length}

        _register(effect, make, kind, ("pitch", "pull-up"), tie, {"local": True})
        return build

    return enter


def either_sign(rng: np.random.Generator) -> Given:
    """Parameter "sense": 1 or -1."""
    return {"sense": float(rng.choice([-1.0, 1.0]))}


def _one_term(k: int, term: Term) -> Static:
    """One term of either sign in one coefficient, CX first."""

    def build(now: Now, given: Given, a: Aircraft) -> Six:
        return tuple(given["sense"] * term(now, a) if j == k else 0.0 for j in range(6))

    return build


def term(
    effect: str, kind: Kind, k: int, term: Term, needs: tuple[str, ...], tie: tuple[str, ...], **more: Any
) -> None:
    """Enter one term of either sign in coefficient k, CX first, under its effect."""
    static(effect, kind, needs, tie, either_sign, **more)(_one_term(k, term))
