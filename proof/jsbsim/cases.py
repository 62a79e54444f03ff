"""Builds a JSBSim case: chooses effects, finds their sizes, simulates the truth, writes the key."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Literal, cast

import numpy as np

from proof.case_files import Case
from proof.jsbsim.aircraft import JSBSimPlant
from proof.jsbsim.effects import SelectedEffect, choose, effects_of, unknown_effect
from proof.jsbsim.effects_faults import joined
from proof.jsbsim.flight import Additions, TruthFlight, simulate_manoeuvre
from proof.jsbsim.functions import AeroFunction, scaled
from proof.jsbsim.instruments import channels_of, read, restated, state_offsets
from proof.jsbsim.manoeuvres import plan_flights
from proof.jsbsim.open_loop import simulate_open_loop
from proof.jsbsim.prescribed_motion import coefficients, functions_with
from proof.jsbsim.scenario import draw_factors, draw_instruments, draw_turbulence
from proof.keys import COEFFICIENTS, EffectKey, Key
from proof.scenario.declared import DeclaredEffect
from proof.scenario.errors import EXCLUSIVE_JSBSIM, OFF_BY, SEVERITIES, may_combine, severity_of
from proof.scenario.instruments import coefficients_of
from proof.scenario.intervals import intervals_of
from proof.scenario.sizing import NotAttainable, attainable, bisect
from structsel.errors import SimulationError
from structsel.recording import Recording

Family = Literal["single", "pair", "null", "outside", "clutter"]
Severity = Literal["easy", "medium", "hard"]


@dataclass(eq=False)
class CaseBuilder:
    """Builds one case."""

    plant: JSBSimPlant
    family: Family
    severity: Severity
    wanted: str | None
    seed: int
    rng: np.random.Generator
    declared: Sequence[DeclaredEffect] = ()

    def case(self) -> Case:
        """Draw, simulate, find the sizes, simulate again and assemble.

        Raises
        ------
        SimulationError, AircraftError, NotAttainable
            A flight diverges, an aircraft is impossible, or an effect is too small to be seen.
        """
        rng, plant = self.rng, self.plant
        self.effects = self._choose()
        needs = [p for e in self.effects for p in e.needs]
        if len(self.effects) > 1:  # each of several has its fraction of the eight
            needs = [p for e in self.effects for p in dict.fromkeys(e.needs)]
        if rng.random() < 0.15 and "low" not in needs:
            needs.append("low")
        if plant.has_brake and rng.random() < 0.1:
            needs.append("brake")
        lift = self.effects[0].lift if self.effects else (0.3, 0.6)
        heights = (4000.0, 8500.0) if lift[0] < 0.2 and plant.mass > 2000.0 else (700.0, 2500.0)
        dt = 0.02 if any(e.name == "structural-mode" for e in self.effects) else float(rng.choice([0.04, 0.04, 0.02]))
        plain = plan_flights(plant, needs[:6], dt, rng, lift, heights)
        self.manoeuvres = [f.manoeuvre for f in plain]
        store = sum(e.store_mass for e in self.effects)
        fraction = float(rng.choice(OFF_BY))
        self.instruments = draw_instruments(plant, rng, fraction=fraction, store=store, null=self.family == "null")
        self.wind: dict[str, np.ndarray] = {}
        if self.family == "null" and self.instruments.blind:
            self.wind = draw_turbulence(self.manoeuvres, plant.aircraft.b, rng)
            plain = [simulate_manoeuvre(plant, m, Additions(wind=self.wind)) for m in self.manoeuvres]
        self.factors = draw_factors(plant, plain, fraction, rng)
        for k, selected in enumerate(self.effects):
            band = SEVERITIES[self.severity] if k == 0 or self.family == "pair" else (0.02, 0.05)
            self.effects[k] = self._scaled(selected, plain, float(rng.uniform(*band)))
        flights = plain
        if any(e.needs_simulation for e in self.effects):
            flights = self._simulate_truth()
        return self._assemble(flights)

    # --- choice of effects ------------------------------------------------------------------------

    def _choose(self) -> list[SelectedEffect]:
        if self.family == "null":
            return []
        if self.family == "outside":
            return [unknown_effect(self.plant, self.rng)]
        there = effects_of(self.plant, self.declared)
        if self.wanted is not None and self.wanted not in there:
            raise SimulationError(
                f"{self.plant.name} has no effect '{self.wanted}'; it has {', '.join(sorted(there))}."
            )
        count = {"single": 1, "pair": 2, "clutter": 3}[self.family]
        names = [str(n) for n in self.rng.permutation(sorted(there))]
        if self.wanted is not None:
            names = [self.wanted, *[n for n in names if n != self.wanted]]
        chosen: list[str] = []
        for n in names:
            if len(chosen) < count and may_combine(n, chosen, EXCLUSIVE_JSBSIM):
                chosen.append(n)
        return [choose(self.plant, n, self.rng, self.declared) for n in chosen]

    def _wrong_parts(self, changed: Sequence[AeroFunction] = ()) -> tuple[AeroFunction, ...]:
        """The simulation's parts: some changed, all off by the tolerances."""
        functions = functions_with(self.plant, changed)
        return tuple(replace(p, node=scaled(p.node, self.factors[p.name])) if p.axis else p for p in functions)

    # --- sizes ------------------------------------------------------------------------------------

    def _scaled(self, selected: SelectedEffect, flights: Sequence[TruthFlight], target: float) -> SelectedEffect:
        """The effect at the size that makes the target attainable in its clearest axis, by bisection."""
        rest = self._residuals(flights, [])

        unit = self._contributions(selected, 1.0, flights) if selected.linear else []

        def reached(size: float) -> float:
            contribution = [size * u for u in unit] or self._contributions(selected, size, flights)
            with_it = [r + d for r, d in zip(rest, contribution)]
            return max(attainable(with_it, rest).values())

        low, high = selected.low, selected.high
        largest = reached(high)
        if largest < min(SEVERITIES["hard"][0], target):
            raise NotAttainable(f"'{selected.name}' reaches {largest:.3f} on {self.plant.name}, {target:.2f} is wanted")
        if largest < target:
            return selected.at(high)
        if reached(low) > target:
            return selected.at(low)
        _, high = bisect(reached, target, low, high, 14)
        return selected.at(high)

    def _contributions(self, selected: SelectedEffect, size: float, flights: Sequence[TruthFlight]) -> list[np.ndarray]:
        """(n, 6) contribution of the effect to measured minus simulated, for each flight without it."""
        return [selected.contribution(self.plant, f, size, self.instruments) for f in flights]

    def _residuals(self, flights: Sequence[TruthFlight], effects: Sequence[SelectedEffect]) -> list[np.ndarray]:
        """Measured minus simulated, with the effects."""
        return [m - s for m, s, _ in (self._one(f, k, effects) for k, f in enumerate(flights))]

    def _one(
        self, flight: TruthFlight, k: int, effects: Sequence[SelectedEffect]
    ) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """Measured and simulated coefficients, and readings, with the faults of the effects in place."""
        fault = joined([e.fault(e.size) for e in effects if e.fault is not None])
        stated = restated(self.instruments.stated, fault)
        unseen = any(e.gust is not None for e in self.effects)
        clean = channels_of(flight, self.instruments.truth, vanes_blind=unseen)
        faulty = channels_of(flight, self.instruments.truth, fault.errors, unseen)
        readings = read(flight, faulty, self.instruments, k)
        blind = self.instruments.blind or any(e.gust is not None for e in effects)
        off = state_offsets(flight, clean, faulty, readings, replace(self.instruments, stated=stated, blind=blind), k)
        changed = [p for e in effects for p in e.without(self.plant)]
        simulated = coefficients(self.plant, flight, self._wrong_parts(changed), off)
        return coefficients_of(flight.t, readings, stated), simulated, readings

    # --- the truth and the case -------------------------------------------------------------------

    def _simulate_truth(self) -> list[TruthFlight]:
        lawful = [e for e in self.effects if e.added_force is not None]
        for k, e in enumerate(lawful):
            self.effects[self.effects.index(e)] = replace(e, place=k)
            e.added_force.size = e.size  # type: ignore[union-attr]
        gusts = [e for e in self.effects if e.gust is not None]
        additions = Additions(
            added=[e.added_force for e in self.effects if e.added_force is not None],
            actuators=dict(a for a in (e.fault(e.size).actuator for e in self.effects if e.fault is not None) if a),
            wind={m.name: sum((e.wind(m.t, int(m.name[1:]), float(m.start[8])) for e in gusts), np.zeros((len(m.t), 3)))
                  for m in self.manoeuvres} if gusts else {},
        )  # fmt: skip
        stores = [e for e in self.effects if e.store_mass]
        manoeuvres = [replace(m, store=stores[0].store(m)) if stores else m for m in self.manoeuvres]
        return [simulate_manoeuvre(self.plant, m, additions) for m in manoeuvres]

    def _assemble(self, flights: Sequence[TruthFlight]) -> Case:
        made = [self._one(f, k, self.effects) for k, f in enumerate(flights)]
        before = [m - s for m, s, _ in made]
        after = [self._perfect(f, k, self.effects) for k, f in enumerate(flights)]
        gained = attainable(before, after)
        fault = joined([e.fault(e.size) for e in self.effects if e.fault is not None])
        stated = restated(self.instruments.stated, fault)
        names = [f.manoeuvre.name for f in flights]
        simulated = {
            n: {"t": f.t, **{a: s[:, k] for k, a in enumerate(COEFFICIENTS)}}
            for n, f, (_, s, _) in zip(names, flights, made)
        }
        form: Literal["forced", "free"] = "forced"
        only = self.effects[0] if len(self.effects) == 1 else None
        if (
            only is not None
            and (only.built_in or only.added_force)
            and not only.store_mass
            and self.rng.random() < 0.15
        ):
            simulated_flight = simulate_open_loop(
                self.plant, flights, self._wrong_parts(list(only.without(self.plant))), self.instruments.truth
            )
            if simulated_flight is not None:
                simulated, form = simulated_flight, "free"
        recorded = self._recorded
        recordings = [Recording(n, f.t, recorded(r)) for n, f, (_, _, r) in zip(names, flights, made)]
        size = max(gained.values(), default=0.0)
        severity = "none" if not self.effects else severity_of(size)
        severity = cast(Literal["easy", "medium", "hard", "none"], severity)
        keyed = sorted(((*self._key(e, flights), e) for e in self.effects), key=lambda found: -found[0])
        keys = tuple(found[1] for found in keyed)
        if self.wind:
            keys = (
                EffectKey(
                    effect="turbulence", accept=("turbulence",), tie=("unknown",), kinds=("random",), axes=COEFFICIENTS
                ),
            )
        key = Key(
            verdicts=("mismatch",) if self.effects else ("consistent",), form=form, severity=severity,
            attainable={a: max(0.0, v) for a, v in gained.items()}, effects=keys,
            source=f"jsbsim/{self.plant.name}", family=self.family, seed=self.seed,
        )  # fmt: skip
        contribution = self._contribution(flights, self.effects)
        of_each = [self._contribution(flights, [e]) for *_, e in keyed] if self.family == "pair" else []
        name = f"case-j{self.seed:05d}"
        return Case(name, stated, recordings, simulated, key, contribution=contribution, of_each=of_each)

    def _contribution(
        self, flights: Sequence[TruthFlight], effects: Sequence[SelectedEffect]
    ) -> tuple[np.ndarray, ...]:
        """Contribution (n, 6) of some of the effects to measured minus simulated, for instruments without noise."""
        if not effects:
            return ()
        quiet = copy(self)
        quiet.instruments = replace(self.instruments, noise=dict.fromkeys(self.instruments.noise, 0.0), correlated=0.0)
        others = [e for e in self.effects if e not in effects]
        return tuple(quiet._perfect(f, k, others) - quiet._perfect(f, k, self.effects) for k, f in enumerate(flights))

    def _recorded(self, readings: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Channels that the file has: a configuration that is unrecorded is left out."""
        hidden = {c for e in self.effects for c in e.hidden}
        moved = {c for m in self.manoeuvres for c in ("df", "gear", "brake") if c in m.commands}
        keep = {
            c: v for c, v in readings.items() if c not in ("df", "gear", "brake") or (c in moved and c not in hidden)
        }
        return {("speedbrake" if c == "brake" else c): v for c, v in keep.items()}

    def _perfect(self, flight: TruthFlight, k: int, effects: Sequence[SelectedEffect]) -> np.ndarray:
        """Measured minus simulated with a perfect model of the given effects."""
        gone = [e for e in self.effects if e not in effects]
        m, s, _ = self._one(flight, k, gone)
        surfaces = {
            c: flight[f"real_{c}"] - flight[c] for e in effects for c in e.surfaces if f"real_{c}" in flight.channels
        }
        if surfaces:  # a perfect model responds to the true surface
            real = replace(
                flight, channels={c: v for c, v in flight.channels.items() if c not in {f"real_{x}" for x in surfaces}}
            )
            m, s, _ = self._one(real, k, gone)
        extra = sum((e.added(flight) for e in effects if e.added_force is not None), np.zeros_like(s))
        if any(e.store_mass for e in effects):
            lost = (flight["mass"] / flight["mass"][0] - 1.0)[:, None]
            force = np.column_stack([flight[f"F{c}"] / flight["mass"] for c in "xyz"]) * flight["mass"][0]
            m[:, :3] += lost * force / (flight["qbar"] * self.plant.aircraft.S)[:, None]
        return np.asarray(m - s - extra)

    def _key(self, selected: SelectedEffect, flights: Sequence[TruthFlight]) -> tuple[float, EffectKey]:
        """Size of an effect in its clearest coefficient, and its entry in the key."""
        others = [e for e in self.effects if e is not selected]
        alone = [self._perfect(f, k, self.effects) for k, f in enumerate(flights)]
        missing = [self._perfect(f, k, others) for k, f in enumerate(flights)] if others else \
            [m - s for m, s, _ in (self._one(f, k, self.effects) for k, f in enumerate(flights))]  # fmt: skip
        fractions = attainable(missing, alone)
        clear = sorted(
            (a for a in COEFFICIENTS if fractions[a] > max(0.03, 0.2 * max(fractions.values()))),
            key=lambda a: -fractions[a],
        )
        axes = tuple(clear) or (max(fractions, key=lambda a: fractions[a]),)
        intervals, region = None, None
        if selected.local:
            k = COEFFICIENTS.index(axes[0])
            contribution = [np.abs(b - a)[:, k] for b, a in zip(missing, alone)]
            limit = 0.12 * max(float(s.max()) for s in contribution)
            intervals = {
                f.manoeuvre.name: intervals_of(f.t, s > limit, gap=0.8, shortest=0.2)
                for f, s in zip(flights, contribution)
            }
            if selected.region in ("h_agl", "alpha"):
                seen = np.concatenate(
                    [
                        f["h" if selected.region == "h_agl" else "alpha"][s > limit]
                        for f, s in zip(flights, contribution)
                    ]
                )
                region = {selected.region: (float(seen.min()), float(seen.max()))}
        return max(fractions.values()), EffectKey(
            effect=selected.name,
            accept=(selected.name, *selected.accept),
            tie=selected.tie,
            kinds=(selected.kind,),
            axes=axes,
            region=region,
            parameters=selected.parameters(),
            intervals=intervals,
        )
