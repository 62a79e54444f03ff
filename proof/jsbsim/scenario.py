"""Scenario of a JSBSim case: instruments and their errors, the stated aircraft, tolerances, turbulence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from proof.jsbsim.aircraft import JSBSimPlant
from proof.jsbsim.flight import Manoeuvre, TruthFlight
from proof.jsbsim.instruments import InstrumentSet
from proof.jsbsim.prescribed_motion import contributions
from proof.scenario.errors import BIAS, CONTROLS, NOISE, THRUST_NOISE, TIGHT
from structsel.aircraft import Aircraft, Simulation, Tolerances
from structsel.numerics.atmosphere import dryden_gusts, dryden_scales

_LEVELS = NOISE | dict.fromkeys("pqr", 4e-4) | dict.fromkeys(CONTROLS, 3e-4)
_BIASES = BIAS | dict.fromkeys(CONTROLS, 4e-4)
_MAIN = 0.2  # of its axis' rms; a part above it has the tolerance of a main derivative


def draw_instruments(
    plant: JSBSimPlant, rng: np.random.Generator, *, fraction: float, store: float, null: bool
) -> InstrumentSet:
    """Instruments, and what aircraft.toml says of the aircraft: all off by its tolerances.

    Parameters
    ----------
    plant : JSBSimPlant
    rng : numpy Generator
    fraction : float
        Of the tolerances, by which things are off.
    store : float [kg]
        Carried at the start.
    null : bool
        Whether the air may be turbulent and the noise autocorrelated.
    """
    true, draw = plant.aircraft, rng.standard_normal
    t = {name: fraction * sd for name, sd in TIGHT.items()}
    level = float(rng.uniform(1.0, 1.7))
    seat = np.array([rng.uniform(-0.06, 0.08) * true.b, 0.0, rng.uniform(-0.1, 0.1)])
    boom = np.array([rng.uniform(0.15, 0.35) * true.b, 0.0, 0.0])
    inertia = true.require_inertia("a case").model_dump()
    off_seat, off_boom = t["lever_arm"] * draw(3) * [1, 0, 1], t["lever_arm"] * draw(3) * [1, 0, 0]
    raw = bool(rng.random() < 0.15)
    blind = bool(null and rng.random() < 0.4)
    state_offsets: Literal["raw", "reconstructed"] = "raw" if raw and not blind else "reconstructed"

    def make(name: str, mass: float, moments: dict[str, float], seat: np.ndarray, boom: np.ndarray) -> Aircraft:
        places = {"accelerometer": seat, "vane": boom}
        return Aircraft(
            name=name,
            mass=mass,
            S=true.S,
            b=true.b,
            cbar=true.cbar,
            thrust=true.thrust,
            inertia=moments,
            tolerances=Tolerances(**TIGHT),
            sensors={n: {"position": tuple(place.round(3).tolist())} for n, place in places.items()},
            simulation=Simulation(states=state_offsets if rng.random() < 0.5 else None),
        )

    truth = make("truth", plant.mass, inertia, seat, boom)
    mass = (plant.mass + store) * (1.0 + t["mass"] * float(draw()))
    moments = {c: v * (1.0 + t["inertia"] * float(draw())) for c, v in inertia.items()}
    return InstrumentSet(
        truth=truth,
        stated=make(f"aircraft {int(rng.integers(1, 999)):03d}", mass, moments, seat + off_seat, boom + off_boom),
        noise={c: level * v for c, v in _LEVELS.items()} | {"thrust": THRUST_NOISE},
        bias=_BIASES,
        scale={c: t["vane_scale"] * float(draw()) for c in ("alpha", "beta")},
        delay={c: max(0.0, t["delay"] * float(draw())) for c in ("alpha", "beta", "V", "de", "da", "dr")},
        thrust=t["thrust"] * float(draw()),
        raw=state_offsets == "raw",
        blind=blind,
        correlated=float(rng.uniform(1.0, 2.0)) if null and not blind and rng.random() < 0.4 else 0.0,
        seed=int(rng.integers(2**31)),
    )


def draw_factors(
    plant: JSBSimPlant, flights: Sequence[TruthFlight], fraction: float, rng: np.random.Generator
) -> dict[str, float]:
    """Factor of each part of an axis in the simulation: off by a fraction of the tolerances."""
    held = [contributions(plant, f, plant.functions) for f in flights[:4]]
    axes = {p.name: p.axis for p in plant.functions if p.axis}
    sizes = {n: float(np.sqrt(np.mean(np.concatenate([h[n] for h in held]) ** 2))) for n in axes}
    total = {axis: sum(sizes[n] for n, a in axes.items() if a == axis) for axis in set(axes.values())}
    kinds = {n: "main" if sizes[n] > _MAIN * total[a] else "secondary" for n, a in axes.items()}
    return {n: 1.0 + fraction * TIGHT[kinds[n]] * float(rng.standard_normal()) for n in axes}


def draw_turbulence(manoeuvres: Sequence[Manoeuvre], b: float, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Dryden turbulence for each manoeuvre: velocity of the air (n, 3) [m/s], north east down."""
    found = {}
    for m in manoeuvres:
        lengths, sigmas = dryden_scales(float(m.start[11]), float(rng.uniform(3.0, 9.0)))
        gust = dryden_gusts(m.t - m.t[0], float(np.linalg.norm(m.start[:3])), b, lengths, sigmas, rng)
        c, s = np.cos(m.start[8]), np.sin(m.start[8])
        made = np.column_stack([c * gust[:, 0] - s * gust[:, 1], s * gust[:, 0] + c * gust[:, 1], gust[:, 2]])
        found[m.name] = made * np.clip(m.t - m.t[0], 0.0, 1.0)[:, None]  # calm where the trim is
    return found
