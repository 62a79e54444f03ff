"""trim(): the controls and attitude of a steady flight."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import least_squares, root

from structsel.aircraft import Aircraft
from structsel.errors import DomainError, ModelError, SimulationError
from structsel.model import AeroModel
from structsel.nomenclature import CONTROL_SURFACES, LATERAL_COEFFICIENTS
from structsel.numerics import rigid_body as rb
from structsel.numerics.atmosphere import G0
from structsel.numerics.flight_model import OUTPUTS
from structsel.numerics.flight_simulation import state_derivatives
from structsel.simulation.atmosphere import Atmosphere
from structsel.simulation.flight_setup import FlightSetup, prepare
from structsel.simulation.steady_flight import Trim

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
_EQUATIONS = ("u_dot", "v_dot", "w_dot", "p_dot", "q_dot", "r_dot", "climb")
_KEPT = ("ax", "ay", "az", "rho", "qbar", "mach", "thrust", "mass", "CX", "CY", "CZ", "Cl", "Cm", "Cn")


def trim(
    model: AeroModel,
    aircraft: Aircraft,
    V: float,
    h: float,
    *,
    climb: float | None = 0.0,
    turn_rate: float | None = None,
    bank: float | None = None,
    sideslip: float | None = None,
    controls: Mapping[str, float] | None = None,
    free: Sequence[str] | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
    definitions: Mapping[str, str] | None = None,
    air: Atmosphere | None = None,
) -> Trim:
    """Find a steady flight: straight and level, climbing, or turning.

    Of bank, rate of turn and sideslip two are set and the third is found: by default there is no turn and no
    sideslip, and the bank is what that takes; with a `bank` the rate of turn is found; with `bank` and `turn_rate`
    the sideslip.

    Parameters
    ----------
    model, aircraft
        As `simulate` takes them; states of the model's own are where they are when nothing changes.
    V : float [m/s]
    h : float [m]
    climb : float or None [rad]
        Angle of climb; with None it is found, for a throttle or thrust among the `controls` (a glide, for one).
    turn_rate : float, optional [rad/s]
        Of the heading, positive to the right.
    bank, sideslip : float, optional [rad]
    controls : mapping of channel to value, optional
        Those that stay as given; df, gear and surfaces not named are zero unless they are free.
    free : sequence of str, optional
        Controls to find: by default those of de, da, dr, throttle and thrust that are not given and that the
        coefficients depend on.
    limits : mapping of str to (low, high), optional
        Of controls, alpha, theta, phi, beta, turn_rate. By default surfaces within 0.7 rad, throttle 0 to 1, thrust
        above zero, alpha -0.5 to 0.6 rad.
    definitions, air
        As `simulate` takes them; gusts have no part in a trim.

    Returns
    -------
    Trim

    Raises
    ------
    SimulationError
        No trim exists within the limits; ``.partial`` is the nearest found, a `Trim`.
    ModelError
        There are fewer controls to find than the flight has equations, or turning is asked of a model without
        lateral coefficients.
    DomainError
        V is not above zero.

    References
    ----------
    [KM16] ch. 3.
    """
    if not V > 0.0:
        raise DomainError(f"trim needs an airspeed V above zero; it is {V:g} m/s.")
    search = _Search(model, aircraft, V, h, climb, turn_rate, bank, sideslip, definitions, air, controls, free, limits)
    return search.run()


class _Search:
    """The unknowns of a trim, and what they leave unbalanced."""

    def __init__(
        self,
        model: AeroModel,
        aircraft: Aircraft,
        V: float,
        h: float,
        climb: float | None,
        turn_rate: float | None,
        bank: float | None,
        sideslip: float | None,
        definitions: Mapping[str, str] | None,
        air: Atmosphere | None,
        controls: Mapping[str, float] | None,
        free: Sequence[str] | None,
        limits: Mapping[str, tuple[float, float]] | None,
    ):
        self.V, self.h = V, h
        lateral = any(name in model for name in LATERAL_COEFFICIENTS)
        given = dict(controls or {})
        self.ready = _still(model, aircraft, V, h, given, free, definitions, air)
        plan = self.ready.compiled
        chosen = tuple(free or ())
        if free is None:
            surfaces = CONTROL_SURFACES if lateral else ("de",)
            chosen = tuple(c for c in (*surfaces, *_PROPULSION) if c in plan.controls and c not in given)
        self.free = chosen
        if strange := [c for c in self.free if c not in plan.controls]:
            raise ModelError(f"'{strange[0]}' cannot be trimmed: the model flies on {', '.join(plan.controls)}.")
        self.settled = {c: given.get(c, 0.0) for c in plan.controls}
        self.attitude, unknown = _attitude(turn_rate, bank, sideslip, lateral)
        self.attitude["climb"] = climb or 0.0
        self.unknowns = ("alpha", "theta", *unknown, *(("climb",) if climb is None else ()), *self.free)
        rows = range(len(_EQUATIONS)) if lateral else (0, 2, 4, 6)
        self.rows = np.array(list(rows))
        if len(self.unknowns) < len(self.rows):
            raise ModelError(
                f"A steady flight has {len(self.rows)} equations, and only {', '.join(self.unknowns)} to fulfil them. "
                f"Free more controls with free=(...); the model flies on {', '.join(plan.controls)}."
            )
        bounds = {**_LIMITS, **(limits or {})}
        self.bounds = np.array([bounds.get(name, (-math.inf, math.inf)) for name in self.unknowns]).T
        # A thrust is found to a tenth of the weight as an angle is to a tenth of a radian.
        weight = float(self.ready.manoeuvre.conditions[0, 0]) * G0
        self.scale = np.array([weight if name == "thrust" else 1.0 for name in self.unknowns])

    def assemble(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, float, float]:
        """State, controls, rate of turn and climb of scaled unknowns."""
        held = {**self.settled, **self.attitude, **dict(zip(self.unknowns, z * self.scale))}
        phi, theta, turn = held["phi"], held["theta"], held["turn_rate"]
        velocity = [float(x) for x in rb.body_velocity(self.V, held["alpha"], held["beta"])]
        rates = [
            0.0 - turn * math.sin(theta),
            turn * math.sin(phi) * math.cos(theta),
            turn * math.cos(phi) * math.cos(theta),
        ]
        state = np.array([*velocity, *rates, phi, theta, 0.0, 0.0, 0.0, self.h])
        return state, np.array([held[c] for c in self.ready.compiled.controls]), turn, held["climb"]

    def unbalance(self, z: np.ndarray) -> np.ndarray:
        """(7,) accelerations and error of the rate of climb."""
        state, controls, _, climb = self.assemble(z)
        slope, _ = state_derivatives(self.ready.compiled, self.ready.manoeuvre, state[None], controls[None])
        # The steady wind carries the aircraft along; climbing is meant through the air.
        rise = slope[0, 11] + self.ready.manoeuvre.wind[0, 2]
        return np.array([*slope[0, :6], rise - self.V * math.sin(climb)])

    def residual(self, z: np.ndarray) -> np.ndarray:
        found = self.unbalance(z)[self.rows] / np.array([G0, G0, G0, 1.0, 1.0, 1.0, self.V])[self.rows]
        return np.where(np.isfinite(found), found, 1e3)

    def run(self) -> Trim:
        low, high = self.bounds / self.scale
        guess = dict.fromkeys(self.unknowns, 0.0) | {
            "alpha": 0.05,
            "theta": 0.05 + self.attitude["climb"],
            "climb": 0.0,
            "thrust": 0.1,
        }
        guess |= {"throttle": 0.4, "phi": math.atan(self.V * self.attitude["turn_rate"] / G0)}
        if "turn_rate" in self.unknowns:
            guess["turn_rate"] = G0 * math.tan(self.attitude["phi"]) / self.V
        first = np.clip([guess[name] for name in self.unknowns], low, high)
        inside = lambda z: bool((z >= low - 1e-9).all() and (z <= high + 1e-9).all())  # noqa: E731
        best = first
        if len(self.unknowns) == len(self.rows):
            best = root(self.residual, first, tol=1e-13).x
        if not inside(best) or np.abs(self.residual(best)).max() > _BALANCED:
            starts = [first, np.where(np.isfinite(best), np.clip(best, low, high), first)]
            tried = [
                least_squares(self.residual, np.clip(z, low + 1e-9, high - 1e-9), bounds=(low, high), x_scale=0.1,
                              xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=400)
                for z in starts
            ]  # fmt: skip
            best = min(tried, key=lambda found: found.cost).x
        made = self._trim(best)
        if np.abs(self.residual(best)).max() > _BALANCED:
            raise SimulationError(self._regret(best, low, high), made)
        return made

    def _trim(self, z: np.ndarray) -> Trim:
        state, controls, turn, climb = self.assemble(z)
        _, outputs = state_derivatives(self.ready.compiled, self.ready.manoeuvre, state[None], controls[None])
        return Trim(
            state,
            dict(zip(self.ready.compiled.controls, controls.tolist())),
            self.free,
            climb,
            turn,
            dict(zip(_EQUATIONS, self.unbalance(z).tolist())),
            {name: float(outputs[0, OUTPUTS.index(name)]) for name in _KEPT},
        )

    def _regret(self, z: np.ndarray, low: np.ndarray, high: np.ndarray) -> str:
        left = self.residual(z)
        worst = int(np.argmax(np.abs(left)))
        name = _EQUATIONS[self.rows[worst]]
        unit = "g" if name[0] in "uvw" else "of V" if name == "climb" else "rad/s^2"
        at = [f"{n} = {v * s:.4g}" for n, v, s, a, b in zip(self.unknowns, z, self.scale, low, high)
              if v - a < 1e-6 or b - v < 1e-6]  # fmt: skip
        stuck = f" At a limit: {', '.join(at)}." if at else ""
        return (
            f"No trim exists at V = {self.V:g} m/s, h = {self.h:g} m: the nearest leaves {left[worst]:.3g} {unit} of "
            f"{name}.{stuck}\nTry another airspeed, climb or flap, free another control with free=(...), or widen "
            "limits={...}. The nearest is in the error's .partial."
        )


def _attitude(
    turn_rate: float | None, bank: float | None, sideslip: float | None, lateral: bool
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Bank, turn and sideslip: those that are set, and the one to find."""
    held = {"phi": bank, "turn_rate": turn_rate, "beta": sideslip}
    if not lateral:
        if any(held.values()):
            raise ModelError("A model without CY, Cl and Cn flies straight, without bank and sideslip only.")
        return dict.fromkeys(held, 0.0), ()
    if None not in held.values():
        raise ModelError("Of bank, turn_rate and sideslip a steady flight leaves two to choose; three were given.")
    unknown = "beta" if bank is not None and turn_rate is not None else "turn_rate" if bank is not None else "phi"
    return {name: value or 0.0 for name, value in held.items()}, (unknown,)


def _still(
    model: AeroModel,
    aircraft: Aircraft,
    V: float,
    h: float,
    given: Mapping[str, float],
    free: Sequence[str] | None,
    definitions: Mapping[str, str] | None,
    air: Atmosphere | None,
) -> FlightSetup:
    """A plan whose controls are all there, at values yet to be found."""
    air = air or Atmosphere()
    calm = Atmosphere(air.isa_offset, air.wind, air.heights, rho=air.rho, gravity=air.gravity)
    pushed = ("thrust",) if free is None else tuple(free)
    zero = dict.fromkeys((*CONTROL_SURFACES, "throttle", "df", "gear", *pushed), 0.0)
    start = {"V": V, "alpha": 0.0, "theta": 0.0, "h": h}
    inputs = {"t": np.array([0.0, 1.0]), **zero, **given}
    return prepare(model.quasi_steady(), aircraft, inputs, start=start, air=calm, definitions=definitions)
