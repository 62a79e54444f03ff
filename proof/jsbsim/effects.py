"""An effect as it is selected for one aircraft: built in, an added force, or a fault."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from proof.jsbsim.added_force import AddedForce, AddedForceSpec
from proof.jsbsim.aircraft import FLAPS, JSBSimPlant
from proof.jsbsim.effects_added import ADDED_FORCES, UNMODELLED
from proof.jsbsim.effects_built_in import BuiltInEffect, find_built_in
from proof.jsbsim.effects_declared import declared_force
from proof.jsbsim.effects_faults import FAULTS, Fault, follow_along
from proof.jsbsim.flight import Manoeuvre, TruthFlight
from proof.jsbsim.functions import AeroFunction
from proof.jsbsim.instruments import InstrumentSet, channels_of, restated
from proof.jsbsim.prescribed_motion import SEEN, coefficients, functions_with
from proof.keys import Kind
from proof.scenario.declared import DeclaredEffect
from proof.scenario.instruments import coefficients_of

_NATIVE_FIRST = 0.7


@dataclass(frozen=True, eq=False)
class SelectedEffect:
    """One effect, and its size once it has one.

    Attributes
    ----------
    name, kind : str
    tie, accept, needs : tuple of str
    built_in : BuiltInEffect, optional
        `size` is the fraction left out; a wrong derivative's may be negative.
    added_force : AddedForce, optional
    fault : callable of size to Fault, optional
    low, high : float
        Between which the size is sought.
    hidden : tuple of str
        Channels that are not recorded.
    local : bool
        Acts in intervals of time only.
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
    built_in: BuiltInEffect | None = None
    added_force: AddedForce | None = None
    fault: Callable[[float], Fault] | None = None
    low: float = 0.02
    high: float = 1.0
    size: float = 0.0
    sign: float = 1.0
    region: str = ""
    local: bool = False
    lift: tuple[float, float] = (0.3, 0.6)
    hidden: tuple[str, ...] = ()
    key_parameters: Mapping[str, float] = field(default_factory=dict)
    place: int = 0
    gust: tuple[int, float] | None = None
    store_mass: float = 0.0
    events: Mapping[int, float] = field(default_factory=dict)

    @property
    def needs_simulation(self) -> bool:
        """Whether the truth has to be simulated with it."""
        return (
            self.added_force is not None
            or self.gust is not None
            or (self.fault is not None and self.fault(1.0).actuator is not None)
        )

    @property
    def linear(self) -> bool:
        """Whether what it adds goes with its size."""
        return self.built_in is not None or (self.added_force is not None and not self.added_force.shape)

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Surfaces that do not do what is recorded."""
        actuator = None if self.fault is None else self.fault(1.0).actuator
        return (actuator[0],) if actuator else ()

    def at(self, size: float) -> SelectedEffect:
        """The same at a size."""
        return replace(self, size=size)

    def without(self, plant: JSBSimPlant) -> tuple[AeroFunction, ...]:
        """Parts of the simulation that lacks it."""
        return self._left(plant, self.size) if self.built_in is not None else ()

    def _left(self, plant: JSBSimPlant, size: float) -> tuple[AeroFunction, ...]:
        return () if self.built_in is None else self.built_in.left_in(plant, 1.0 - self.sign * size)

    def store(self, manoeuvre: Manoeuvre) -> tuple[float, float] | None:
        """Mass that falls off, and when."""
        if not self.store_mass:
            return None
        return self.store_mass, self.events.get(int(manoeuvre.name[1:]), np.inf)

    def added(self, flight: TruthFlight) -> np.ndarray:
        """Coefficients (n, 6) that the law added to a truth flight."""
        return flight.fractions[self.place]

    def wind(self, t: np.ndarray, number: int, psi: float) -> np.ndarray:
        """Velocity of the air (n, 3) [m/s], north east down, of a gust."""
        made = np.zeros((len(t), 3))
        if self.gust is not None and number in self.events:
            axis, length = self.gust
            phase = np.clip((t - self.events[number]) / length, 0.0, 1.0)
            peak = self.size * 0.5 * (1.0 - np.cos(2.0 * np.pi * phase))
            made[:, 2 if axis == 2 else 0] = -peak if axis == 2 else -np.sin(psi) * peak
            if axis == 1:
                made[:, 1] = np.cos(psi) * peak
        return made

    def along(self, flight: TruthFlight, size: float) -> np.ndarray:
        """The law along a flight (n, 6)."""
        if self.added_force is None:
            return np.zeros((len(flight.t), 6))
        added_force = AddedForce(self.added_force.formula, size, shape=self.added_force.shape)
        dt = float(flight.t[1] - flight.t[0])
        added_force.start(flight.now[0], dt)
        return np.array([added_force.coefficients(now) for now in flight.now])

    def contribution(
        self, plant: JSBSimPlant, flight: TruthFlight, size: float, instruments: InstrumentSet
    ) -> np.ndarray:
        """(n, 6) contribution to measured minus simulated along a flight without the effect."""
        if self.built_in is not None:
            without = functions_with(plant, self._left(plant, size))
            total = coefficients(plant, flight, plant.functions)
            return total - coefficients(plant, flight, without)
        if self.added_force is not None:
            return self.along(flight, size)
        if self.gust is not None:
            blown = replace(self, size=size).wind(flight.t, int(flight.manoeuvre.name[1:]), np.pi / 2)
            axis = self.gust[0]
            off = {"alpha": -blown[:, 2] / flight["V"]} if axis == 2 else {"beta": blown[:, 0] / flight["V"]}
            return coefficients(plant, flight, plant.functions, off) - coefficients(plant, flight, plant.functions)
        assert self.fault is not None
        return self._fault_shift(plant, flight, self.fault(size), instruments)

    def _fault_shift(
        self, plant: JSBSimPlant, flight: TruthFlight, fault: Fault, instruments: InstrumentSet
    ) -> np.ndarray:
        if fault.actuator is not None:
            surface, make = fault.actuator
            real = {surface: follow_along(flight, surface, make) - flight[surface]}
            return coefficients(plant, flight, plant.functions, real) - coefficients(plant, flight, plant.functions)
        clean = channels_of(flight, instruments.truth)
        bad = channels_of(flight, instruments.truth, fault.errors)
        for held in (clean, bad):
            held["qbar"] = 0.5 * held["rho"] * held["V"] ** 2
        off = {c: bad[c] - clean[c] for c in SEEN if c in clean and np.any(bad[c] != clean[c])}
        stated = coefficients_of(flight.t, clean, instruments.stated)
        more = coefficients_of(flight.t, bad, restated(instruments.stated, fault)) - stated
        state_offsets = coefficients(plant, flight, plant.functions, off) - coefficients(plant, flight, plant.functions)
        return np.asarray(more - state_offsets)

    def parameters(self) -> dict[str, float | str]:
        """Parameters of the injected effect."""
        if self.built_in is not None:
            return {"what": self.built_in.label, "fraction left in": 1.0 - self.sign * self.size}
        if self.added_force is not None:
            return {"tau" if self.added_force.shape else "size": self.size, **self.key_parameters}
        if self.gust is not None:
            return {
                "peak in m/s": self.size,
                "length in s": self.gust[1],
                "axis": "vertical" if self.gust[0] == 2 else "lateral",
            }
        assert self.fault is not None
        return dict(self.fault(self.size).key_parameters)


def effects_of(plant: JSBSimPlant, declared: Sequence[DeclaredEffect] = ()) -> tuple[str, ...]:
    """Names of the effects that an aircraft can have; only those with flaps have what needs a flap."""
    flapped = any(p in plant.properties for p in FLAPS)
    stated = [d.name for d in declared if flapped or not d.needs_flap]
    propeller = is_propeller(plant)
    laws = [n for n, specs in ADDED_FORCES.items() if specs[0].power in ("", "propeller" if propeller else "jet")]
    surfaces = set(plant.controls)
    faults = [n for n in FAULTS if {"de", "da", "dr"} <= surfaces]
    return tuple(sorted({"gust", *(n.effect for n in find_built_in(plant)), *laws, *faults, *stated}))


def is_propeller(plant: JSBSimPlant) -> bool:
    """Whether the engines drive propellers."""
    return plant.machine.fdm.get_property_manager().hasNode("propulsion/engine/propeller-rpm")


def choose(
    plant: JSBSimPlant, name: str, rng: np.random.Generator, declared: Sequence[DeclaredEffect] = ()
) -> SelectedEffect:
    """One effect of a name."""
    if one := next((d for d in declared if d.name == name), None):
        return _of_law(plant, name, declared_force(one), rng)
    if name == "gust":
        events = {int(m): float(rng.uniform(6.0, 16.0)) for m in rng.choice(np.arange(1, 9), 4, replace=False)}
        return SelectedEffect(name, "atmospheric", ("turbulence", "sensor-delay"), (), ("pitch",), low=0.8, high=12.0,
                     local=True,
                     events=events, gust=(int(rng.choice([1, 2, 2])), float(rng.uniform(0.8, 2.0))))  # fmt: skip
    built_ins = [n for n in find_built_in(plant) if n.effect == name]
    laws = [s for s in ADDED_FORCES.get(name, ()) if s.power in ("", "propeller" if is_propeller(plant) else "jet")]
    if built_ins and ((not laws and name not in FAULTS) or rng.random() < _NATIVE_FIRST):
        built_in = built_ins[int(rng.integers(len(built_ins)))]
        wrong = name == "wrong-derivative"
        hidden = (built_in.region,) if name == "configuration-change" and rng.random() < 0.5 else ()
        return SelectedEffect(
            name,
            built_in.kind,
            built_in.tie,
            built_in.accept,
            built_in.needs,
            built_in=built_in,
            low=0.08 if wrong else 0.03,
            high=0.7 if wrong else 1.0,
            sign=float(rng.choice([-1.0, 1.0])) if wrong else 1.0,
            region=built_in.region,
            local=bool(built_in.region),
            lift=built_in.lift,
            hidden=hidden,
        )
    if laws:
        return _of_law(plant, name, laws[int(rng.integers(len(laws)))], rng)
    spec = FAULTS[name]
    return SelectedEffect(
        name, spec.kind, spec.tie, spec.accept, spec.needs, fault=spec.make(rng), low=spec.low, high=spec.high
    )


def unknown_effect(plant: JSBSimPlant, rng: np.random.Generator) -> SelectedEffect:
    """An effect that is not in the library."""
    return _of_law(plant, "unknown", UNMODELLED[int(rng.integers(len(UNMODELLED)))], rng)


def _of_law(plant: JSBSimPlant, name: str, spec: AddedForceSpec, rng: np.random.Generator) -> SelectedEffect:
    count = int(rng.integers(2, 5))
    events = {int(m): float(rng.uniform(6.0, 16.0)) for m in rng.choice(np.arange(1, 9), count, replace=False)}
    formula, key_parameters = spec.make(rng, plant.aircraft, events)
    store = 0.06 * plant.mass if name == "store-release" else 0.0
    return SelectedEffect(
        name,
        spec.kind,
        spec.tie,
        spec.accept,
        spec.needs,
        added_force=AddedForce(formula, shape=spec.shape),
        low=spec.smallest,
        high=spec.largest,
        region=spec.region,
        local=spec.local,
        lift=spec.lift,
        key_parameters=key_parameters,
        store_mass=store,
        events=events,
    )
