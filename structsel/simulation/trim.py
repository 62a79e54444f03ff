"""trim(): the controls and attitude of a steady flight."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from structsel.aircraft import Aircraft
from structsel.errors import DomainError, ModelError, SimulationError
from structsel.model import AeroModel
from structsel.nomenclature import CONTROL_SURFACES, LATERAL_COEFFICIENTS
from structsel.numerics.atmosphere import G0
from structsel.numerics.flight_model import OUTPUTS
from structsel.numerics.flight_simulation import state_derivatives
from structsel.options import option, takes_options
from structsel.recording.arguments import require_kind, require_number
from structsel.simulation.atmosphere import Atmosphere
from structsel.simulation.flight_setup import FlightSetup, prepare
from structsel.simulation.missing_responses import warn_missing
from structsel.simulation.steady_flight import EQUATIONS, Trim, TrimProblem

_PROPULSION = ("throttle", "thrust")
_LIMITS = {
    "alpha": (-0.5, 0.6),
    "climb": (-0.8, 0.8),
    "theta": (-1.2, 1.2),
    "phi": (-1.4, 1.4),
    "beta": (-0.5, 0.5),
    "turn_rate": (-2.0, 2.0),
}
_LIMITS |= {**dict.fromkeys(CONTROL_SURFACES, (-0.7, 0.7)), "throttle": (0.0, 1.0), "thrust": (0.0, math.inf)}
_BALANCED = 1e-8  # of g, or rad/s^2
_KEPT = ("ax", "ay", "az", "rho", "qbar", "mach", "thrust", "mass", "CX", "CY", "CZ", "Cl", "Cm", "Cn")


@dataclass(frozen=True)
class TrimOptions:
    """Which steady flight `trim` finds, and with which controls.

    Attributes
    ----------
    climb : float or None [rad]
        Climb angle. With None it is found, for a throttle or thrust among the `controls`, as in a glide.
    turn_rate : float, optional [rad/s]
        Rate of heading, positive to the right.
    bank, sideslip : float, optional [rad]
    controls : mapping of channel to value, optional
        Controls that are held. df, gear and surfaces not named are zero unless they are free.
    free : sequence of str, optional
        Controls to find: by default those of de, da, dr, throttle and thrust that are not given and that the
        coefficients depend on.
    limits : mapping of str to (low, high), optional
        Of controls, alpha, theta, phi, beta, turn_rate. By default surfaces within 0.7 rad, throttle 0 to 1, thrust
        above zero, alpha -0.5 to 0.6 rad.
    definitions, air
        As `simulate` takes them; a trim is in air without gusts.
    """

    climb: float | None = option(0.0)
    turn_rate: float | None = option(None)
    bank: float | None = option(None)
    sideslip: float | None = option(None)
    controls: Mapping[str, float] | None = option(None)
    free: Sequence[str] | None = option(None)
    limits: Mapping[str, tuple[float, float]] | None = option(None)
    definitions: Mapping[str, str] | None = option(None)
    air: Atmosphere | None = option(None)


@takes_options(TrimOptions)
def trim(model: AeroModel, aircraft: Aircraft, V: float, h: float, *, options: TrimOptions) -> Trim:
    """Find a steady flight: straight and level, climbing, or turning.

    Of bank, turn rate and sideslip two are set and the third is found. By default turn rate and sideslip are zero and
    the bank is found; with a `bank` the turn rate is found; with `bank` and `turn_rate` the sideslip.

    Parameters
    ----------
    model, aircraft
        As `simulate` takes them; states of the model's own are in equilibrium.
    V : float [m/s]
    h : float [m]
    options : TrimOptions
        Its fields may be given as keywords too: ``trim(..., climb=0.05)``.

    Returns
    -------
    Trim

    Raises
    ------
    ArgumentError
        The model, the aircraft, V or h are objects of another type.
    SimulationError
        No trim exists within the limits; ``.partial`` is the nearest found, a `Trim`.
    ModelError
        There are fewer controls to find than the flight has equations, or a turn is requested of a model without
        lateral coefficients.
    DomainError
        V is not above zero.

    Warns
    -----
    StructselWarning
        The model lacks a coefficient that the steady flight depends on; it is taken as zero.

    References
    ----------
    [KM16] ch. 3.
    """
    call = "trim(model, aircraft, V, h)"
    require_kind(model, AeroModel, call)
    require_kind(aircraft, Aircraft, call)
    require_number(V, "V", "m/s", call)
    require_number(h, "h", "m", call)
    if not V > 0.0:
        raise DomainError(f"trim needs an airspeed V above zero; it is {V:g} m/s.")
    warn_missing(model, stacklevel=4)  # through takes_options
    lateral = any(name in model for name in LATERAL_COEFFICIENTS)
    given = dict(options.controls or {})
    setup = _at_rest(model, aircraft, {"V": V, "alpha": 0.0, "theta": 0.0, "h": h}, options)
    plant = _SimulatedPlant(setup)
    free = _free_controls(plant, given, options.free, lateral)
    attitude, unknown = _attitude(options, lateral)
    attitude["climb"] = options.climb or 0.0
    unknowns = ("alpha", "theta", *unknown, *(("climb",) if options.climb is None else ()), *free)
    rows = np.arange(len(EQUATIONS)) if lateral else np.array([0, 2, 4, 6])
    if len(unknowns) < len(rows):
        raise ModelError(
            f"A steady flight has {len(rows)} equations, and only {', '.join(unknowns)} to fulfil them.",
            remedy=f"Free more controls with free=(...); the inputs of the model are {', '.join(plant.controls)}.",
            cli_remedy=f"Free more controls with --free; the inputs of the model are {', '.join(plant.controls)}.",
        )
    # A thrust is found to a tenth of the weight as an angle is to a tenth of a radian.
    weight = float(setup.manoeuvre.conditions[0, 0]) * G0
    scale = np.array([weight if name == "thrust" else 1.0 for name in unknowns])
    bounds = {**_LIMITS, **(options.limits or {})}
    within = np.array([bounds.get(name, (-math.inf, math.inf)) for name in unknowns]) / scale[:, None]
    fixed = {**{c: given.get(c, 0.0) for c in plant.controls}, **attitude}
    problem = TrimProblem(plant, V, h, unknowns, fixed, rows, scale, within)
    z = _solve(problem)
    outputs = plant.outputs(problem.state(z), problem.controls(z))
    found = problem.solution(z, {name: float(outputs[OUTPUTS.index(name)]) for name in _KEPT})
    if np.abs(problem.residual(z)).max() > _BALANCED:
        raise SimulationError(
            _why_not(problem, z),
            found,
            remedy="Try another airspeed, climb or flap, free another control with free=(...), or widen limits={...}. "
            "The nearest is in the error's .partial.",
            cli_remedy="Try another airspeed, climb or flap, or free another control with --free. The nearest is "
            "printed.",
        )
    return found


@dataclass(frozen=True)
class _SimulatedPlant:
    """An AeroModel as the plant of a trim."""

    setup: FlightSetup

    @property
    def controls(self) -> tuple[str, ...]:
        return self.setup.compiled.controls

    def accelerations(self, state: np.ndarray, controls: Mapping[str, float]) -> np.ndarray:
        rates, _ = self._evaluate(state, controls)
        # The steady wind carries the aircraft along; the climb is through the air.
        return np.array([*rates[:6], rates[11] + self.setup.manoeuvre.wind[0, 2]])

    def outputs(self, state: np.ndarray, controls: Mapping[str, float]) -> np.ndarray:
        """As `flight_model.OUTPUTS`."""
        return self._evaluate(state, controls)[1]

    def _evaluate(self, state: np.ndarray, controls: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        row = np.array([[controls[c] for c in self.controls]])
        rates, outputs = state_derivatives(self.setup.compiled, self.setup.manoeuvre, state[None], row)
        return rates[0], outputs[0]


def _free_controls(
    plant: _SimulatedPlant, given: Mapping[str, float], free: Sequence[str] | None, lateral: bool
) -> tuple[str, ...]:
    """Controls to find."""
    if free is None:
        surfaces = CONTROL_SURFACES if lateral else ("de",)
        return tuple(c for c in (*surfaces, *_PROPULSION) if c in plant.controls and c not in given)
    if unknown := [c for c in free if c not in plant.controls]:
        raise ModelError(f"'{unknown[0]}' cannot be trimmed: the model flies on {', '.join(plant.controls)}.")
    return tuple(free)


def _solve(problem: TrimProblem) -> np.ndarray:
    """Scaled unknowns: the root of the equations, or the nearest to one within the limits."""
    low, high = problem.limits.T
    fixed, V = problem.fixed, problem.V
    guess = dict.fromkeys(problem.unknowns, 0.0) | {
        "alpha": 0.05,
        "theta": 0.05 + fixed["climb"],
        "climb": 0.0,
        "thrust": 0.1,
        "throttle": 0.4,
        "phi": math.atan(V * fixed["turn_rate"] / G0),
    }
    if "turn_rate" in problem.unknowns:
        guess["turn_rate"] = G0 * math.tan(fixed["phi"]) / V
    first = best = np.clip([guess[name] for name in problem.unknowns], low, high)
    if len(problem.unknowns) == len(problem.rows):
        best = scipy.optimize.root(problem.residual, first, tol=1e-13).x
    inside = bool((best >= low - 1e-9).all() and (best <= high + 1e-9).all())
    if inside and np.abs(problem.residual(best)).max() <= _BALANCED:
        return best
    starts = [first, np.where(np.isfinite(best), np.clip(best, low, high), first)]
    tried = [problem.nearest(np.clip(z, low + 1e-9, high - 1e-9), tolerance=1e-15, evaluations=400) for z in starts]
    return min(tried, key=lambda found: found.cost).x  # type: ignore[no-any-return]


def _why_not(problem: TrimProblem, z: np.ndarray) -> str:
    left = problem.residual(z)
    worst = int(np.argmax(np.abs(left)))
    name = EQUATIONS[problem.rows[worst]]
    unit = "g" if name[0] in "uvw" else "of V" if name == "climb" else "rad/s^2"
    at = [
        f"{n} = {v * s:.4g}"
        for n, v, s, (low, high) in zip(problem.unknowns, z, problem.scale, problem.limits)
        if v - low < 1e-6 or high - v < 1e-6
    ]
    stuck = f" At a limit: {', '.join(at)}." if at else ""
    return (
        f"No trim exists at V = {problem.V:g} m/s, h = {problem.h:g} m: the nearest leaves {left[worst]:.3g} {unit} of "
        f"{name}.{stuck}"
    )


def _attitude(options: TrimOptions, lateral: bool) -> tuple[dict[str, float], tuple[str, ...]]:
    """Bank, turn rate and sideslip: those that are set, and the one to find."""
    bank, turn_rate = options.bank, options.turn_rate
    held = {"phi": bank, "turn_rate": turn_rate, "beta": options.sideslip}
    if not lateral:
        if any(held.values()):
            raise ModelError("A model without CY, Cl and Cn flies straight, without bank and sideslip only.")
        return dict.fromkeys(held, 0.0), ()
    if None not in held.values():
        raise ModelError("Of bank, turn_rate and sideslip a steady flight leaves two to choose; three were given.")
    unknown = "beta" if bank is not None and turn_rate is not None else "turn_rate" if bank is not None else "phi"
    return {name: value or 0.0 for name, value in held.items()}, (unknown,)


def _at_rest(model: AeroModel, aircraft: Aircraft, start: Mapping[str, float], options: TrimOptions) -> FlightSetup:
    """A setup with all controls, at values yet to be found, in air without gusts."""
    air = options.air or Atmosphere()
    calm = Atmosphere(air.isa_offset, air.wind, air.heights, rho=air.rho, gravity=air.gravity)
    propulsion = ("thrust",) if options.free is None else tuple(options.free)
    zero = dict.fromkeys((*CONTROL_SURFACES, "throttle", "df", "gear", *propulsion), 0.0)
    inputs = {"t": np.array([0.0, 1.0]), **zero, **(options.controls or {})}
    return prepare(model.quasi_steady(), aircraft, inputs, start=start, air=calm, definitions=options.definitions)
