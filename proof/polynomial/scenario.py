"""From effects and a seed to a scenario: aircraft, manoeuvres, instruments, and errors within the tolerances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from proof.polynomial.aircraft import Term, TruthAircraft
from proof.polynomial.effects import Effect, Injection
from proof.polynomial.flight import InjectedPhysics, settings_of
from proof.polynomial.manoeuvres import Manoeuvre, draw_manoeuvres
from proof.scenario.errors import BETWEEN, BIAS, NOISE, OFF_BY, THRUST_NOISE, TIGHT
from proof.scenario.instruments import InstrumentErrors
from structsel.aircraft import Aircraft, Tolerances

_EVENTS = ("configuration-change", "store-release")


@dataclass
class Scenario:
    """Everything that is drawn before the size of an effect.

    Attributes
    ----------
    truth : TruthAircraft
    aircraft : Aircraft
        As it is stated.
    manoeuvres : list of Manoeuvre
    settings : dict
        As `equations.SETTINGS`.
    ground : float [m]
    rate : float [1/s]
    states : {"raw", "reconstructed"}
        At which the simulation is evaluated.
    channels : tuple of str
        Recorded in addition to the usual ones.
    sim_terms : tuple of (axis, text, value)
        Of the simulation, off within the tolerances.
    background : Injection
        Errors within the tolerances; the perfect model of the effect has them too.
    noise : dict
    biases : list of dict
        Of each manoeuvre.
    wrong : dict
        Scale and delay errors within the tolerances.
    seed : int
    """

    truth: TruthAircraft
    aircraft: Aircraft
    manoeuvres: list[Manoeuvre]
    settings: dict[str, float]
    ground: float
    rate: float
    states: str
    channels: tuple[str, ...]
    sim_terms: tuple[Term, ...]
    background: Injection
    noise: dict[str, float]
    biases: list[dict[str, float]]
    wrong: dict[str, dict[str, float]]
    seed: int


def draw_scenario(effects: Sequence[Effect], base: TruthAircraft, seed: int, states: str, attempt: int = 0) -> Scenario:
    """Aircraft, manoeuvres, instruments and errors within the tolerances."""
    rng = np.random.default_rng([seed, attempt, 1])
    truth = base.perturbed_copy(rng)
    tolerances = Tolerances(**[TIGHT, BETWEEN, {}][rng.choice(3, p=[0.5, 0.25, 0.25])])  # type: ignore[arg-type]
    ground = float(rng.uniform(0.0, 800.0))
    rate = float(rng.choice([25.0, 50.0]))
    duration = float(rng.integers(22, 36))
    needed = [purpose for effect in effects for purpose in effect.needs]
    low, high = base.heights
    bands = None
    if max((e.bands for e in effects), default=1) > 1:
        bands = [(low, low + 0.1 * (high - low)), (high - 0.1 * (high - low), high)]
    manoeuvres = draw_manoeuvres(truth, needed[:7], rng, duration=duration, ground=ground, bands=bands)
    aircraft = _stated_aircraft(base.aircraft, tolerances, states, seed, rng)
    level = float(rng.uniform(1.0, 1.7))
    fraction = float(rng.choice(OFF_BY))
    wrong, background = _background_errors(tolerances, 0.5 * fraction, base.aircraft.cbar, rng)
    biases = [{n: s * float(rng.standard_normal()) for n, s in BIAS.items()} for _ in manoeuvres]
    terms = truth.with_parameter_errors(rng, fraction * float(tolerances.main), fraction * float(tolerances.secondary))  # type: ignore[arg-type]
    channels = _further_channels(effects, truth, manoeuvres, duration, rng)
    settings = settings_of(truth, manoeuvres, ground)
    noise = {n: s * level for n, s in NOISE.items()} | {"thrust": THRUST_NOISE}
    return Scenario(
        *(truth, aircraft, manoeuvres, settings, ground, rate, states, channels, terms, background, noise, biases),
        *(wrong, seed),
    )


def _stated_aircraft(
    stated: Aircraft, tolerances: Tolerances, states: str, seed: int, rng: np.random.Generator
) -> Aircraft:
    """Aircraft of the case's file, with positions of the instruments."""
    seat = (float(rng.uniform(-0.8, 1.1)), 0.0, float(rng.uniform(-0.1, 0.1)))
    boom = (float(rng.uniform(2.0, 4.5)) * stated.cbar * 0.8, 0.0, 0.0)
    return Aircraft.from_dict(
        stated.to_dict()
        | {
            "name": f"aircraft {seed}",
            "tolerances": tolerances.model_dump(),
            "sensors": {"accelerometer": {"position": seat}, "vane": {"position": boom}},
            "simulation": {"states": states} if rng.random() < 0.5 else {},
        }
    )


def _background_errors(
    tolerances: Tolerances, half: float, cbar: float, rng: np.random.Generator
) -> tuple[dict[str, dict[str, float]], Injection]:
    """Scale and delay errors; errors of mass, inertia, centre of gravity and positions: normal, `half` a tolerance."""

    def error(name: str) -> float:
        return half * float(getattr(tolerances, name)) * float(rng.standard_normal())

    wrong = {
        "scale": {n: 1.0 + error("vane_scale") - 1.0 for n in ("alpha", "beta")},
        "delay": {n: abs(1.0 + error("delay") - 1.0) for n in ("alpha", "beta", "V")},
    }
    shift = [half * float(tolerances.lever_arm) * float(z) * 0.5 for z in rng.standard_normal(3)]  # type: ignore[arg-type]
    physics = InjectedPhysics(
        mass=1.0 + error("mass"),
        inertia={k: 1.0 + error("inertia") for k in ("Ix", "Iy", "Iz")},
        settings={"arm_x": error("cg") * cbar},
    )
    errors = InstrumentErrors(place={"accelerometer": (shift[0], 0.0, 0.0)}, mix=(("ax", "az", error("alignment")),))
    return wrong, Injection(physics, errors)


def _further_channels(
    effects: Sequence[Effect],
    truth: TruthAircraft,
    manoeuvres: Sequence[Manoeuvre],
    duration: float,
    rng: np.random.Generator,
) -> tuple[str, ...]:
    """Channels that the effects need, which other cases have as well; a flap that the simulation knows may move."""
    channels = {c for e in effects for c in e.channels}
    if truth.propeller or rng.random() < 0.3:
        channels.add("rpm")
    if rng.random() < 0.2:
        channels.add("vn")
    if truth.value("CZ", "df") and rng.random() < 0.4 and not any(e.name in _EVENTS for e in effects):
        channels.add("df")
        for k in rng.choice(len(manoeuvres), 2, replace=False):
            if manoeuvres[k].purpose not in ("stall", "low-pass"):
                start = float(rng.uniform(0.3, 0.6)) * duration
                manoeuvres[k].ramp("df", start, start + 3.0, 0.12)
    return tuple(sorted(channels))
