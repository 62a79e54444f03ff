"""An effect as it is drawn for one aircraft: native, a law or a fault behind one face."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from proof.jsbsim.aircraft import Plane
from proof.jsbsim.catalogue import LAWS, OUTSIDE, LawSpec
from proof.jsbsim.effects_built_in import Native, find_native
from proof.jsbsim.faults import FAULTS, Fault, follow_along
from proof.jsbsim.flight import Flight, Manoeuvre
from proof.jsbsim.functions import Part
from proof.jsbsim.laws import Law
from proof.jsbsim.prescribed_motion import SEEN, coefficients, parts_of
from proof.jsbsim.readings import Chain, channels_of, measured_as_stated, restated
from proof.keys import Kind

_NATIVE_FIRST = 0.7


@dataclass(frozen=True, eq=False)
class Drawn:
    """One effect, and its size once it has one.

    Attributes
    ----------
    name, kind : str
    tie, accept, needs : tuple of str
    native : Native, optional
        `size` is the share left out; a wrong derivative's may be negative.
    law : Law, optional
    fault : callable of size to Fault, optional
    low, high : float
        Between which the size is sought.
    hidden : tuple of str
        Channels that are not recorded.
    local : bool
        Acts in stretches of time only.
    place : int
        Of the law among those of a case.
    gust : (axis, length [s]), optional
        Of body y or z; `size` is its peak [m/s], its instants are `events`, and no vane sees it.
    store_mass : float [kg]
        Carried until the event, if there is one.
    """

    name: str
    kind: Kind
    tie: tuple[str, ...] = ()
    accept: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    native: Native | None = None
    law: Law | None = None
    fault: Callable[[float], Fault] | None = None
    low: float = 0.02
    high: float = 1.0
    size: float = 0.0
    sign: float = 1.0
    region: str = ""
    local: bool = False
    lift: tuple[float, float] = (0.3, 0.6)
    hidden: tuple[str, ...] = ()
    shown: Mapping[str, float] = field(default_factory=dict)
    place: int = 0
    gust: tuple[int, float] | None = None
    store_mass: float = 0.0
    events: Mapping[int, float] = field(default_factory=dict)

    @property
    def flies(self) -> bool:
        """Whether the truth has to be flown with it."""
        return (
            self.law is not None
            or self.gust is not None
            or (self.fault is not None and self.fault(1.0).actuator is not None)
        )

    @property
    def linear(self) -> bool:
        """Whether what it adds goes with its size."""
        return self.native is not None or (self.law is not None and not self.law.shape)

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Surfaces that do not do what is recorded."""
        actuator = None if self.fault is None else self.fault(1.0).actuator
        return (actuator[0],) if actuator else ()

    def at(self, size: float) -> Drawn:
        """The same at a size."""
        return replace(self, size=size)

    def without(self, plane: Plane) -> tuple[Part, ...]:
        """Parts of the simulation that lacks it."""
        return self._left(plane, self.size) if self.native is not None else ()

    def _left(self, plane: Plane, size: float) -> tuple[Part, ...]:
        return () if self.native is None else self.native.left_in(plane, 1.0 - self.sign * size)

    def store(self, manoeuvre: Manoeuvre) -> tuple[float, float] | None:
        """Mass that falls off, and when."""
        if not self.store_mass:
            return None
        return self.store_mass, self.events.get(int(manoeuvre.name[1:]), np.inf)

    def added(self, flight: Flight) -> np.ndarray:
        """Coefficients (n, 6) that the law added to a truth flight."""
        return flight.shares[self.place]

    def wind(self, t: np.ndarray, number: int, psi: float) -> np.ndarray:
        """Velocity of the air (n, 3) [m/s], north east down, of a gust."""
        made = np.zeros((len(t), 3))
        if self.gust is not None and number in self.events:
            axis, length = self.gust
            part = np.clip((t - self.events[number]) / length, 0.0, 1.0)
            peak = self.size * 0.5 * (1.0 - np.cos(2.0 * np.pi * part))
            made[:, 2 if axis == 2 else 0] = -peak if axis == 2 else -np.sin(psi) * peak
            if axis == 1:
                made[:, 1] = np.cos(psi) * peak
        return made

    def along(self, flight: Flight, size: float) -> np.ndarray:
        """The law along a flight (n, 6)."""
        if self.law is None:
            return np.zeros((len(flight.t), 6))
        law = Law(self.law.formula, size, shape=self.law.shape)
        dt = float(flight.t[1] - flight.t[0])
        law.start(flight.now[0], dt)
        return np.array([law.coefficients(now) for now in flight.now])

    def shift(self, plane: Plane, flight: Flight, size: float, chain: Chain) -> np.ndarray:
        """What it adds to measured less simulated (n, 6) along a flight without it."""
        if self.native is not None:
            without = parts_of(plane, self._left(plane, size))
            whole = coefficients(plane, flight, plane.parts)
            return whole - coefficients(plane, flight, without)
        if self.law is not None:
            return self.along(flight, size)
        if self.gust is not None:
            blown = replace(self, size=size).wind(flight.t, int(flight.manoeuvre.name[1:]), np.pi / 2)
            axis = self.gust[0]
            off = {"alpha": -blown[:, 2] / flight["V"]} if axis == 2 else {"beta": blown[:, 0] / flight["V"]}
            return coefficients(plane, flight, plane.parts, off) - coefficients(plane, flight, plane.parts)
        assert self.fault is not None
        return self._fault_shift(plane, flight, self.fault(size), chain)

    def _fault_shift(self, plane: Plane, flight: Flight, fault: Fault, chain: Chain) -> np.ndarray:
        if fault.actuator is not None:
            surface, make = fault.actuator
            real = {surface: follow_along(flight, surface, make) - flight[surface]}
            return coefficients(plane, flight, plane.parts, real) - coefficients(plane, flight, plane.parts)
        clean = channels_of(flight, chain.truth, Fault(), False)
        bad = channels_of(flight, chain.truth, fault, False)
        for held in (clean, bad):
            held["qbar"] = 0.5 * held["rho"] * held["V"] ** 2
        off = {c: bad[c] - clean[c] for c in SEEN if c in clean and np.any(bad[c] != clean[c])}
        stated = measured_as_stated(flight.t, clean, chain.stated)
        more = measured_as_stated(flight.t, bad, restated(chain.stated, fault)) - stated
        told = coefficients(plane, flight, plane.parts, off) - coefficients(plane, flight, plane.parts)
        return np.asarray(more - told)

    def parameters(self) -> dict[str, float | str]:
        """What was put in."""
        if self.native is not None:
            return {"what": self.native.label, "share left in": 1.0 - self.sign * self.size}
        if self.law is not None:
            return {"tau" if self.law.shape else "size": self.size, **self.shown}
        if self.gust is not None:
            return {
                "peak in m/s": self.size,
                "length in s": self.gust[1],
                "axis": "vertical" if self.gust[0] == 2 else "lateral",
            }
        assert self.fault is not None
        return dict(self.fault(self.size).shown)


def effects_of(plane: Plane) -> tuple[str, ...]:
    """Names of the effects that can be concealed with an aircraft."""
    propeller = is_propeller(plane)
    laws = [n for n, specs in LAWS.items() if specs[0].power in ("", "propeller" if propeller else "jet")]
    surfaces = set(plane.controls)
    faults = [n for n in FAULTS if {"de", "da", "dr"} <= surfaces]
    return tuple(sorted({"gust", *(n.effect for n in find_native(plane)), *laws, *faults}))


def is_propeller(plane: Plane) -> bool:
    """Whether propellers pull it."""
    return plane.machine.fdm.get_property_manager().hasNode("propulsion/engine/propeller-rpm")


def choose(plane: Plane, name: str, rng: np.random.Generator) -> Drawn:
    """One effect of a name."""
    if name == "gust":
        events = {int(m): float(rng.uniform(6.0, 16.0)) for m in rng.choice(np.arange(1, 9), 4, replace=False)}
        return Drawn(name, "atmospheric", ("turbulence", "sensor-delay"), (), ("pitch",), low=0.8, high=12.0,
                     local=True,
                     events=events, gust=(int(rng.choice([1, 2, 2])), float(rng.uniform(0.8, 2.0))))  # fmt: skip
    own = [n for n in find_native(plane) if n.effect == name]
    laws = [s for s in LAWS.get(name, ()) if s.power in ("", "propeller" if is_propeller(plane) else "jet")]
    if own and ((not laws and name not in FAULTS) or rng.random() < _NATIVE_FIRST):
        native = own[int(rng.integers(len(own)))]
        wrong = name == "wrong-derivative"
        hidden = (native.region,) if name == "configuration-change" and rng.random() < 0.5 else ()
        return Drawn(
            name, native.kind, native.tie, native.accept, native.needs, native=native, low=0.08 if wrong else 0.03,
            high=0.7 if wrong else 1.0, sign=float(rng.choice([-1.0, 1.0])) if wrong else 1.0, region=native.region,
            local=bool(native.region), lift=native.lift, hidden=hidden,
        )  # fmt: skip
    if laws:
        return _of_law(plane, name, laws[int(rng.integers(len(laws)))], rng)
    spec = FAULTS[name]
    return Drawn(name, spec.kind, spec.tie, spec.accept, spec.needs, fault=spec.make(rng), low=spec.low, high=spec.high)


def unknown_effect(plane: Plane, rng: np.random.Generator) -> Drawn:
    """Something that no name covers."""
    return _of_law(plane, "unknown", OUTSIDE[int(rng.integers(len(OUTSIDE)))], rng)


def _of_law(plane: Plane, name: str, spec: LawSpec, rng: np.random.Generator) -> Drawn:
    count = int(rng.integers(2, 5))
    events = {int(m): float(rng.uniform(6.0, 16.0)) for m in rng.choice(np.arange(1, 9), count, replace=False)}
    formula, shown = spec.make(rng, plane.aircraft, events)
    store = 0.06 * plane.mass if name == "store-release" else 0.0
    return Drawn(
        name, spec.kind, spec.tie, spec.accept, spec.needs, law=Law(formula, shape=spec.shape), low=spec.smallest,
        high=spec.largest, region=spec.region, local=spec.local, lift=spec.lift, shown=shown,
        store_mass=store, events=events,
    )  # fmt: skip
