"""An effect as the generator of cases uses it: its key, the manoeuvres it needs, what it injects at a size."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from proof.keys import Form, Intervals, Kind
from proof.polynomial.aircraft import TruthAircraft
from proof.polynomial.flight import InjectedPhysics, TruthFlight
from proof.polynomial.manoeuvres import Manoeuvre
from proof.polynomial.terms import AXES, INDEX
from proof.scenario.instruments import InstrumentErrors
from structsel.aircraft import Tolerances


@dataclass(frozen=True, eq=False)
class EffectContext:
    """Aircraft, manoeuvres and the flights without the effect that is to be injected."""

    truth: TruthAircraft
    manoeuvres: Sequence[Manoeuvre]
    base: Sequence[TruthFlight]
    settings: Mapping[str, float]
    tolerances: Tolerances
    rng: np.random.Generator

    def sign(self) -> float:
        """1 or -1, drawn."""
        return float(self.rng.choice([-1.0, 1.0]))

    def tolerance(self, name: str) -> float:
        """A tolerance as a number."""
        value = getattr(self.tolerances, name)
        return float(value) if not isinstance(value, str) else {"exact": 0.0, "free": 1.0}[value]

    def product(self, text: str) -> np.ndarray:
        """A term's factors along all flights."""
        table = np.concatenate([f.table for f in self.base])
        made = np.ones(len(table))
        for part in text.split("*"):
            name, _, power = part.partition("^")
            made = made * table[:, INDEX[name]] ** int(power or 1)
        return made

    def equal_scatter(self, axis: str, text: str) -> float:
        """The value at which a term scatters as much as the complete coefficient does."""
        values = np.concatenate([f.coefs for f in self.base])[:, AXES.index(axis)]
        return float(values.std() / max(self.product(text).std(), 1e-9))

    def choose_manoeuvres(self, fewest: int, largest: int) -> list[int]:
        """Some of the manoeuvres."""
        count = int(self.rng.integers(fewest, largest + 1))
        return sorted(int(k) for k in self.rng.choice(len(self.manoeuvres), count, replace=False))

    def draw_times(self, chosen: Sequence[int], low: float = 0.25, high: float = 0.7) -> list[float | None]:
        """A time in each chosen manoeuvre [s], None in the others."""
        return [
            float(p.duration * self.rng.uniform(low, high)) if k in chosen else None
            for k, p in enumerate(self.manoeuvres)
        ]

    def steps(self, times: Sequence[float | None], ramp: float = 0.02) -> list[np.ndarray]:
        """Schedules that rise from 0 to 1 at the times."""
        return [
            np.zeros(len(p.schedules)) if a is None else np.clip((p.t - a) / ramp, 0.0, 1.0)
            for p, a in zip(self.manoeuvres, times)
        ]

    def intervals_after(self, times: Sequence[float | None]) -> Intervals:
        """From each time to the end of its manoeuvre."""
        return {name(k): [] if a is None else [(round(a, 2), self.manoeuvres[k].duration)] for k, a in enumerate(times)}


def name(k: int) -> str:
    """Name of manoeuvre number k, from 0."""
    return f"m{k + 1:02d}"


@dataclass
class Injection:
    """An effect of one size: physics of the flight, errors of the instruments, parameters for the key."""

    physics: InjectedPhysics = field(default_factory=InjectedPhysics)
    errors: InstrumentErrors = field(default_factory=InstrumentErrors)
    parameters: dict[str, float | str] = field(default_factory=dict)


@dataclass
class EffectDesign:
    """An effect with all its properties drawn, except for its size.

    Attributes
    ----------
    at : function of the size to Injection
        At size 1 the effect is of ordinary strength.
    axes : tuple of str
        Coefficients that it changes, the clearest first.
    accept, tie : tuple of str
        Further right names, and names it may be confused with.
    low, high : float
        Sizes between which the effect is plausible and larger than the tolerances.
    intervals : Intervals or "active" or None
        When it acts; "active" finds that from what it does.
    region : str
        Channel that bounds it, for "active".
    """

    at: Callable[[float], Injection]
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
        Name in the library; "unknown" outside it.
    kinds : tuple of str
    make : function of EffectContext to EffectDesign
    needs : purposes the set of manoeuvres must hold
    aircraft : names of aircraft it suits; empty suits all
    bands : int
        Number of height bands: two where density must vary independently of speed.
    channels : further channels that are recorded
    form : form of simulation; None for either
    label : description, for effects outside the library
    """

    name: str
    kinds: tuple[Kind, ...]
    make: Callable[[EffectContext], EffectDesign]
    needs: tuple[str, ...] = ()
    aircraft: tuple[str, ...] = ()
    bands: int = 1
    channels: tuple[str, ...] = ()
    form: Form | None = None
    label: str = ""


def with_terms(
    *terms: tuple[str, str, float], settings: Mapping[str, float] | None = None
) -> Callable[[float], Injection]:
    """Terms times the size."""
    held = dict(settings or {})

    def at(size: float) -> Injection:
        scaled = [(axis, text, size * value) for axis, text, value in terms]
        return Injection(InjectedPhysics(scaled, held), parameters={**{f"{a}:{x}": v for a, x, v in scaled}, **held})

    return at
