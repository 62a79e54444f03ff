"""An aircraft of JSBSim with the verbs of structsel."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from structsel.errors import ChannelError, SimulationError
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.air_data import body_velocity
from structsel.numerics.rigid_body import G0, STATES
from structsel.recording import Recording
from structsel.simulation.flight_setup import Inputs, Start, first_state
from structsel.simulation.jsbsim.fdm import FlightDynamicsModel, silence_output
from structsel.simulation.jsbsim.flights import make_recording, read_schedule
from structsel.simulation.steady_flight import EQUATIONS, Trim, TrimProblem

_TURNS = {"de": "Cm", "da": "Cl", "dr": "Cn"}
_LONGEST_STEP = 0.002  # s
_BALANCED = 1e-4  # g, rad/s^2; engines converge no closer
_STABILISER = {"de": {"theta": 0.2, "q": 0.2}, "da": {"phi": 0.2, "p": 0.1}, "dr": {"r": 0.2}}


def open_jsbsim(
    aircraft: str | Path,
    *,
    root: str | Path | None = None,
    earth: Literal["flat", "round"] = "flat",
    rho: float | None = None,
) -> JSBSimAircraft:
    """Load an aircraft of JSBSim.

    Parameters
    ----------
    aircraft : str or Path
        A bundled name such as ``"c172p"``, or ``PATH/AIRCRAFT.xml``.
    root : str or Path, optional
        Folder with ``aircraft``, ``engine`` and ``systems``; by default the one that comes with JSBSim.
    earth : {"flat", "round"}
        Flat (a sphere of 3e9 m that does not turn, gravity 9.80665 m/s^2), so that the equations are those of
        `simulate`; or JSBSim's own, which turns and is an ellipsoid.
    rho : float, optional [kg/m^3]
        Density held throughout, instead of the standard atmosphere's at the altitude. (JSBSim takes ``h`` as a
        geometric altitude, `simulate` as a geopotential one: densities differ by 1.5e-5 at 1 km.)

    Returns
    -------
    JSBSimAircraft

    Raises
    ------
    SimulationError
        JSBSim is not installed, or cannot load the aircraft.
    """
    return JSBSimAircraft(aircraft, root, earth, rho)


class JSBSimAircraft:
    """One aircraft of JSBSim; made by `open_jsbsim`.

    Surfaces are set where aerodynamics read angles (``fcs/elevator-pos-rad``, ...); an aircraft whose aerodynamics read
    anything else lacks that control. Some piston engines with governor or supercharger reach no steady state.

    Attributes
    ----------
    name : str
    aircraft : Aircraft
        Mass, inertia about the centre of gravity, S, b, cbar and thrust line, as loaded.
    reference_points : mapping of str to (3,) array [m]
        ``aerodynamic``, ``eyepoint`` and ``visual``: body axes, from the centre of gravity.
    controls : tuple of str
        What can be set: the surfaces that the aerodynamics respond to, ``df``, ``gear``, and ``throttle`` (engines) or
        ``thrust`` [N] (an external force named ``thrust``).
    """

    def __init__(
        self, aircraft: str | Path, root: str | Path | None, earth: Literal["flat", "round"], rho: float | None
    ):
        if earth not in ("flat", "round"):
            raise SimulationError(f"earth={earth!r} is not one of 'flat', 'round'.")
        self.name = Path(aircraft).stem
        self._fdm = FlightDynamicsModel(aircraft, root, earth == "flat", rho)
        from_cg = self._fdm.from_cg
        self.aircraft = self._fdm.describe(self.name)
        self.reference_points = MappingProxyType(
            {
                name: from_cg(*(f"metrics/{key}-{c}-in" for c in "xyz"))
                for name, key in (("aerodynamic", "aero-rp"), ("eyepoint", "eyepoint"), ("visual", "visualrefpoint"))
            }
        )
        power = ("throttle",) if self._fdm.engines else ("thrust",) if self._fdm.pushed else ()
        self.controls = (*self._learn_senses(), "df", "gear", *power)

    def trim(
        self,
        V: float,
        h: float,
        *,
        climb: float | None = 0.0,
        sideslip: float = 0.0,
        controls: Mapping[str, float] | None = None,
    ) -> Trim:
        """Find a steady straight flight, engines in steady state.

        Parameters
        ----------
        V : float [m/s]
        h : float [m]
        climb : float or None [rad]
            With None it is found, for a throttle or thrust among the `controls`, or a glider's.
        sideslip : float [rad]
            The bank that it takes is found.
        controls : mapping of channel to value, optional
            Those that stay as given; flaps and gear are up otherwise.

        Returns
        -------
        Trim

        Raises
        ------
        SimulationError
            There is none to 1e-4 g and rad/s^2; ``.partial`` is the nearest found.
        ChannelError
            A control that the aircraft has not.
        """
        given = dict(controls or {})
        if unknown := [c for c in given if c not in self.controls]:
            has = ", ".join(self.controls)
            raise ChannelError(f"JSBSim's {self.name} has no control '{unknown[0]}'; it has {has}.")
        free = tuple(c for c in self.controls if c not in given and c not in ("df", "gear"))
        unknowns = ("alpha", "theta", "phi", *free, *(("climb",) if climb is None else ()))
        weight = self._fdm.value("mass") * G0
        scale = np.array([weight if c == "thrust" else 1.0 for c in unknowns])
        guess = {"alpha": 0.05, "theta": 0.05 + (climb or 0.0), "throttle": 0.6, "thrust": 0.1}
        wide = {"throttle": (0.0, 1.0), "thrust": (0.0, 10.0), "alpha": (-0.5, 0.6)}
        limits = np.array([wide.get(c, (-0.7, 0.7)) for c in unknowns])
        fixed = {"climb": climb or 0.0, "beta": sideslip, "turn_rate": 0.0, "df": 0.0, "gear": 0.0, **given}
        problem = TrimProblem(self, V, h, unknowns, fixed, np.arange(len(EQUATIONS)), scale, limits)
        # The steady state of an engine is found by iteration: much finer differences would see where it stopped.
        step = 1e-3 if self._fdm.engines else 1e-6
        first = np.clip([guess.get(c, 0.0) for c in unknowns], limits[:, 0] + 1e-6, limits[:, 1] - 1e-6)
        with silence_output():
            z = problem.nearest(first, tolerance=1e-14, evaluations=100, jac="3-point", diff_step=step).x
            left = problem.imbalance(z)
            made = problem.solution(z, self._coefficients(self._fdm.now(), problem.controls(z)))
        relative = np.abs(problem.relative(left))
        if not relative.max() < _BALANCED:
            worst = int(np.argmax(relative))
            silent = " An engine does not run there." if self._fdm.silent() else ""
            at = ", ".join(f"{c} = {made.controls[c]:.4g}" for c in free)
            raise SimulationError(
                f"JSBSim's {self.name} has no steady flight at V = {V:g} m/s, h = {h:g} m: the nearest leaves "
                f"{left[worst]:.3g} of {EQUATIONS[worst]} with {at}."
                f"{silent}",
                made,
                remedy="Try another airspeed or flap, or climb=None with a given throttle. The nearest is in .partial.",
                cli_remedy="Try another airspeed or flap, or another throttle with --controls. The nearest is printed.",
            )
        return made

    def accelerations(self, state: np.ndarray, controls: Mapping[str, float]) -> np.ndarray:
        """(7,) derivatives of u, v, w, p, q, r [m/s^2, rad/s^2] and rate of climb [m/s] at a state.

        The engines are in steady state. JSBSim's own ``do_trim`` moves the pilot's controls through the flight
        control system; surfaces and engines are set past it here.

        Parameters
        ----------
        state : (12,) array
            As `structsel.numerics.rigid_body.STATES`.
        controls : mapping of channel to value
        """
        self._fdm.place(state, controls)
        now = self._fdm.now()
        return np.array([*(now[c] for c in EQUATIONS[:6]), -now["vd"]])

    def fly(
        self,
        inputs: Inputs,
        *,
        start: Start | None = None,
        stabilise: bool | Mapping[str, Mapping[str, float]] = False,
        substeps: int | None = None,
    ) -> Recording:
        """Fly a schedule of inputs in calm standard air.

        Parameters
        ----------
        inputs : Recording or mapping of channel to (n,) array or float
            With ``t``; of `controls` those that are not given are as the trim has them, or zero. Linear between
            samples. Fuel does not burn.
        start : Trim or mapping, optional
            As for `structsel.simulation.simulate`; engines start in steady state.
        stabilise : bool or mapping of surface to {state: gain}
            Adds gain times departure from the start to the surfaces; ``True`` is a light stabiliser of attitude and
            yaw rate. What is recorded is the surface's angle, stabiliser included.
        substeps : int, optional
            Of JSBSim per sample; by default none is above 0.002 s.

        Returns
        -------
        Recording
            States, specific forces and accelerations at the centre of gravity, ``thrust`` along the aircraft's
            thrust line, and CX, CY, CZ, Cl, Cm, Cn: all else but gravity, so a propeller's torque is in them.

        Raises
        ------
        ChannelError, DataError
            As `structsel.simulation.simulate`; or an input that the aircraft has no control for.
        SimulationError
            The flight blew up; ``.partial`` holds it to there.
        """
        t, controls, name = read_schedule(inputs, start, self.controls, self.name)
        state = first_state(inputs, start, self.aircraft, name)
        gains = _STABILISER if stabilise is True else (stabilise or {})
        gains = {surface: gain for surface, gain in gains.items() if surface in self.controls}
        about = dict(zip(STATES, state.tolist()))
        count = substeps or max(1, math.ceil(float(np.diff(t).max()) / _LONGEST_STEP - 1e-9))
        rows: list[dict[str, float]] = []
        applied = dict(zip(self.controls, controls[0].tolist()))
        with silence_output():
            self._fdm.place(state, applied)
            rows.append(self._row(applied))
            for i in range(len(t) - 1):
                for k in range(1, count + 1):
                    command = controls[i] + (controls[i + 1] - controls[i]) * (k / count)
                    applied = dict(zip(self.controls, command.tolist()))
                    for surface, gain in gains.items():
                        applied[surface] += sum(g * self._fdm.change(c, about[c]) for c, g in gain.items())
                    self._fdm.set(applied)
                    self._fdm.step((t[i + 1] - t[i]) / count)
                row = self._row(applied)
                if not all(map(math.isfinite, row.values())):
                    break
                rows.append(row)
        flight = None
        if len(rows) > 1:
            held = {c: np.array([row[c] for row in rows]) for c in rows[0]}
            silent = "; an engine stood still at the end" if self._fdm.silent() else ""
            how = f"{self.name}, {count} steps a sample{silent}"
            flight = make_recording(name, t[: len(rows)], held, self.controls, state, how)
        if flight is None or len(rows) < len(t):
            raise SimulationError(
                f"JSBSim could not fly '{name}' beyond t = {t[len(rows) - 1]:g} s: the states are no longer finite.",
                flight,
                remedy="Start from .trim(), try stabilise=True, or smaller inputs. The flight so far is in .partial.",
                cli_remedy="Start from --trim, try --stabilise, or smaller inputs. With --out the flight so far is "
                "written.",
            )
        return flight

    def coefficients(self, recording: Recording) -> Recording:
        """Coefficients that JSBSim's aerodynamics give at recorded states (a forced simulation).

        Where ``throttle`` was recorded the engines are in steady state, and the coefficients contain the propeller's
        effects other than thrust; else they are of the aerodynamics alone. Rates of angle of attack and sideslip
        are those of JSBSim's own balance of forces at the state.

        Parameters
        ----------
        recording : Recording
            With V, alpha (at the centre of gravity) and h; beta, p, q, r, phi, theta and the controls are zero where
            it has none.

        Returns
        -------
        Recording
            With CX, CY, CZ, Cl, Cm, Cn added or replaced.

        Raises
        ------
        ChannelError, DataError
            V, alpha or h is missing, or a channel used is not finite.
        """
        optional = ("beta", "p", "q", "r", "phi", "theta", "psi", *self.controls)
        used = [c for c in optional if c in recording]
        recording.require("V", "alpha", "h", *used, finite=True, by="JSBSimAircraft.coefficients")
        held = {c: recording[c] if c in recording else np.zeros_like(recording.t) for c in optional}
        states = np.zeros((len(recording.t), 12))
        states[:, :3] = np.column_stack(body_velocity(recording["V"], recording["alpha"], held["beta"]))
        for c in ("p", "q", "r", "phi", "theta", "psi"):
            states[:, STATES.index(c)] = held[c]
        states[:, 11] = recording["h"]
        rows = []
        with silence_output():
            for i, state in enumerate(states):
                controls = {c: float(held[c][i]) for c in self.controls}
                self._fdm.place(state, controls)
                rows.append(self._coefficients(self._fdm.now(), controls, alone="throttle" not in recording))
        made: dict[str, Any] = {c: np.array([row[c] for row in rows]) for c in COEFFICIENTS}
        return recording.with_channels(
            note=f"{', '.join(COEFFICIENTS)} from JSBSim's {self.name} at these states", **made
        )

    def sense(self, control: str) -> float:
        """1 where JSBSim's angle of a surface (of ``da``, the left aileron) has our sign, -1 where the other."""
        return self._fdm.senses.get(control, 1.0)

    def __repr__(self) -> str:
        return f"JSBSimAircraft({self.name!r}, controls={self.controls})"

    # --- what JSBSim has, in our terms ---------------------------------------------------------------

    def _learn_senses(self) -> tuple[str, ...]:
        """Turn each surface so that positive makes a negative moment; those that make one."""
        state = np.zeros(12)
        state[0], state[11] = 60.0, 1000.0
        reached = []
        with silence_output():
            for surface, axis in _TURNS.items():
                moments = []
                for angle in (-0.02, 0.02):
                    self._fdm.place(state, {surface: angle})
                    moments.append(self._coefficients(self._fdm.now(), {}, alone=True)[axis])
                self._fdm.set({surface: 0.0})
                if abs(moments[1] - moments[0]) > 1e-9:
                    reached.append(surface)
                    self._fdm.senses[surface] = math.copysign(1.0, moments[0] - moments[1])
        return tuple(reached)

    def _row(self, controls: Mapping[str, float]) -> dict[str, float]:
        now = self._fdm.now()
        return {**now, **controls, **self._coefficients(now, controls)}

    def _coefficients(
        self, now: Mapping[str, float], controls: Mapping[str, float], *, alone: bool = False
    ) -> dict[str, float]:
        """Thrust and coefficients: of all but gravity and thrust, or of the aerodynamics alone."""
        line = self.aircraft.thrust
        thrust = controls.get("thrust", float(line.direction @ [now["Px"], now["Py"], now["Pz"]]))
        force = np.array([now[f"A{c}" if alone else f"F{c}"] for c in "xyz"])
        moment = np.array([now[f"A{c}" if alone else f"M{c}"] for c in "lmn"])
        if not alone:
            force = force - thrust * line.direction
            moment = moment - thrust * line.arm
        qS = 0.5 * now["rho"] * (now["u"] ** 2 + now["v"] ** 2 + now["w"] ** 2) * self.aircraft.S
        lengths = np.array([self.aircraft.b, self.aircraft.cbar, self.aircraft.b])
        return {
            "thrust": thrust,
            **dict(zip(COEFFICIENTS, [*(force / qS).tolist(), *(moment / (qS * lengths)).tolist()])),
        }
