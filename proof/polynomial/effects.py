"""What an effect is to the maker of cases: its key, the manoeuvres it needs, and how it enters at a size."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from proof.keys import Form, Intervals, Kind
from proof.polynomial.aircraft import Craft
from proof.polynomial.flight import Flown, Physics
from proof.polynomial.instruments import Faults
from proof.polynomial.manoeuvres import Plan, Sizes, sizes
from proof.polynomial.terms import AXES, INDEX
from structsel.aircraft import Tolerances


@dataclass(frozen=True, eq=False)
class Context:
    """Where an effect is to act: aircraft, manoeuvres, and the flights without it."""

    craft: Craft
    plans: Sequence[Plan]
    base: Sequence[Flown]
    settings: Mapping[str, float]
    tolerances: Tolerances
    rng: np.random.Generator

    def sign(self) -> float:
        """One way or the other."""
        return float(self.rng.choice([-1.0, 1.0]))

    def allowed(self, name: str) -> float:
        """A tolerance as a number."""
        value = getattr(self.tolerances, name)
        return float(value) if not isinstance(value, str) else {"exact": 0.0, "free": 1.0}[value]

    def product(self, text: str) -> np.ndarray:
        """A term's factors along all flights."""
        whole = np.concatenate([f.table for f in self.base])
        made = np.ones(len(whole))
        for part in text.split("*"):
            name, _, power = part.partition("^")
            made = made * whole[:, INDEX[name]] ** int(power or 1)
        return made

    def worth(self, axis: str, text: str) -> float:
        """The value at which a term scatters as much as the whole coefficient does."""
        values = np.concatenate([f.coefs for f in self.base])[:, AXES.index(axis)]
        return float(values.std() / max(self.product(text).std(), 1e-9))

    def inputs(self, k: int) -> Sizes:
        """Usual inputs in a manoeuvre."""
        plan = self.plans[k]
        return sizes(self.craft, plan.V, plan.h, plan.trim["alpha"])

    def some(self, least: int, most: int) -> list[int]:
        """Some of the manoeuvres."""
        count = int(self.rng.integers(least, most + 1))
        return sorted(int(k) for k in self.rng.choice(len(self.plans), count, replace=False))

    def moments(self, chosen: Sequence[int], low: float = 0.25, high: float = 0.7) -> list[float | None]:
        """A time in each chosen manoeuvre [s], None in the others."""
        return [
            float(p.duration * self.rng.uniform(low, high)) if k in chosen else None for k, p in enumerate(self.plans)
        ]

    def steps(self, times: Sequence[float | None], ramp: float = 0.02) -> list[np.ndarray]:
        """Schedules that rise from 0 to 1 at the times."""
        return [
            np.zeros(len(p.schedules)) if a is None else np.clip((p.t - a) / ramp, 0.0, 1.0)
            for p, a in zip(self.plans, times)
        ]

    def lasting(self, times: Sequence[float | None]) -> Intervals:
        """From each time to the end of its manoeuvre."""
        return {name(k): [] if a is None else [(round(a, 2), self.plans[k].duration)] for k, a in enumerate(times)}


def name(k: int) -> str:
    """Of manoeuvre number k, from 0."""
    return f"m{k + 1:02d}"


@dataclass
class Entry:
    """What enters at one size: into the flight, into the instruments; numbers for the key."""

    physics: Physics = field(default_factory=Physics)
    faults: Faults = field(default_factory=Faults)
    parameters: dict[str, float | str] = field(default_factory=dict)


@dataclass
class Concept:
    """An effect with all drawn but its size.

    Attributes
    ----------
    at : function of the size to Entry
        At size 1 the effect is of ordinary strength.
    axes : tuple of str
        In which it shows, the clearest first.
    accept, tie : tuple of str
        Beside the effect's own name, and those it may be confused with.
    low, high : float
        Sizes between which it is plausible and beyond the tolerances.
    intervals : Intervals or "active" or None
        When it acts; "active" finds that from what it does.
    region : str
        Channel that bounds it, for "active".
    """

    at: Callable[[float], Entry]
    axes: tuple[str, ...]
    tie: tuple[str, ...] = ()
    accept: tuple[str, ...] = ()
    low: float = 0.01
    high: float = 5.0
    intervals: Intervals | str | None = None
    region: str = ""


@dataclass(frozen=True)
class Effect:
    """An effect that can be drawn.

    Attributes
    ----------
    name : str
        Of EFFECTS; "unknown" outside.
    kinds : tuple of str
    make : function of Context to Concept
    needs : purposes the set of manoeuvres must hold
    crafts : names of aircraft it suits; empty suits all
    bands : int
        Of heights, two where density must vary apart from speed.
    channels : what is recorded beside the usual
    form : the form of simulation it takes, None takes either
    label : what it is, for effects outside the library
    """

    name: str
    kinds: tuple[Kind, ...]
    make: Callable[[Context], Concept]
    needs: tuple[str, ...] = ()
    crafts: tuple[str, ...] = ()
    bands: int = 1
    channels: tuple[str, ...] = ()
    form: Form | None = None
    label: str = ""


def with_terms(*terms: tuple[str, str, float], settings: Mapping[str, float] | None = None) -> Callable[[float], Entry]:
    """Terms times the size."""
    held = dict(settings or {})

    def at(size: float) -> Entry:
        scaled = [(axis, text, size * value) for axis, text, value in terms]
        return Entry(Physics(scaled, held), parameters={**{f"{a}:{x}": v for a, x, v in scaled}, **held})

    return at
