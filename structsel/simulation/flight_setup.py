"""Lays out one manoeuvre for the simulation: model, aircraft, inputs, initial state, atmosphere."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy

from structsel.aircraft import Aircraft
from structsel.candidates.formula import Node, evaluate
from structsel.errors import AircraftError, ChannelError, DataError, ModelError
from structsel.model import AeroModel
from structsel.nomenclature import LATERAL_COEFFICIENTS, LATERAL_STATES
from structsel.numerics import kinematics
from structsel.numerics.air_data import air_data_at_cg, body_velocity
from structsel.numerics.flight_model import CONDITIONS, STATES, CompiledAircraft, ManoeuvreInputs, outputs_index
from structsel.numerics.flight_simulation import BatchResult, simulate_batch
from structsel.recording import Recording
from structsel.recording.arguments import as_one_recording
from structsel.simulation.atmosphere import Atmosphere
from structsel.simulation.compile_model import Formulas, compile_aircraft, needed_inputs
from structsel.simulation.instruments import Actuator
from structsel.simulation.steady_flight import Trim

Between = Literal["linear", "hold"]
Inputs = Recording | Mapping[str, Any]
Start = Trim | Mapping[str, float]
_INERTIA = ("Ix", "Iy", "Iz", "Ixz", "Ixy", "Iyz")
_LONGEST_STEP = 0.02  # s; the roll mode of a light aeroplane, 10 1/s, is then followed to 1e-6


@dataclass(frozen=True, eq=False)
class FlightSetup:
    """One manoeuvre ready to simulate, with one or many parameter sets.

    Attributes
    ----------
    name : str
    compiled : CompiledAircraft
    manoeuvre : ManoeuvreInputs
    formulas : Formulas
    substeps : int
        Steps of the integration per sample.
    """

    name: str
    compiled: CompiledAircraft
    manoeuvre: ManoeuvreInputs
    formulas: Formulas
    substeps: int

    def simulate(
        self,
        outputs: Sequence[str],
        parameters: Sequence[str] = (),
        theta: np.ndarray | None = None,
        *,
        instruments: bool = False,
    ) -> BatchResult:
        """Outputs of many parameter sets; NaN from where a simulation stopped.

        Parameters
        ----------
        outputs : sequence of str
            Channels of the flight.
        parameters : sequence of str
            Parameters that change, as `CompiledAircraft.parameter_names`: ``"Cm:alpha"``, ``"start:w"``, ...
        theta : (m, k) array, optional
            Their values, a row for each set.
        instruments : bool
            Outputs as read at the instruments' positions.

        Returns
        -------
        BatchResult

        Raises
        ------
        ModelError, ChannelError
            For an unknown parameter or output.
        """
        if theta is None:
            theta = np.empty((1, 0))
        index = self.compiled.parameter_index(parameters)
        observed = outputs_index(outputs, instruments=instruments)
        return simulate_batch(self.compiled, self.manoeuvre, theta, index, observed, substeps=self.substeps)


def prepare(
    model: AeroModel,
    aircraft: Aircraft,
    inputs: Inputs,
    *,
    start: Start | None = None,
    air: Atmosphere | None = None,
    actuators: Mapping[str, Actuator] | None = None,
    definitions: Mapping[str, str] | None = None,
    between: Between = "linear",
    substeps: int | None = None,
    vanes: np.ndarray | None = None,
) -> FlightSetup:
    """Lay out a manoeuvre for the simulation; the parameters are those of `simulate`.

    Parameters
    ----------
    model, aircraft, inputs, start, air, actuators, definitions, between, substeps
        As `simulate` takes them.
    vanes : (5,) array, optional
        Errors of vanes and airspeed, as `structsel.numerics.flight_model.VANES`.

    Returns
    -------
    FlightSetup

    Raises
    ------
    ChannelError, DataError, ModelError, AircraftError
        As `simulate`.
    """
    air = air or Atmosphere()
    formulas = Formulas(aircraft, definitions)
    t, given, name = _schedule(inputs)
    trimmed = dict(start.controls) if isinstance(start, Trim) else {}
    needed = needed_inputs(model, formulas)
    controls = tuple(dict.fromkeys([*needed, *(c for c in ("thrust",) if c in given or c in trimmed)]))
    if "thrust" in formulas:
        controls = tuple(c for c in controls if c != "thrust")
    columns = [_column(c, t, given, trimmed, name) for c in controls]
    if between not in ("linear", "hold"):
        raise ModelError(f"between={between!r} is not one of 'linear', 'hold'.")
    for commanded, actuator in (actuators or {}).items():
        if commanded not in controls:
            raise ChannelError(f"There is an actuator for '{commanded}', but the model flies on {', '.join(controls)}.")
        j = controls.index(commanded)
        columns[j] = actuator.follow(t, columns[j], hold=between == "hold")
    memory = {}
    given_now = dict(zip(controls, columns))
    for state_name, one in model.states.items():
        if set(formulas.needs(one.channels)) <= set(given_now):
            held = {c: evaluate(formulas.expand(Node("channel", name=c)), given_now, state_name) for c in one.channels}
            columns.append(one.along(t, held, hold=between == "hold"))
        else:
            memory[state_name] = one
            columns.append(np.zeros(len(t)))
    compiled = compile_aircraft(model, aircraft, formulas, (*controls, *model.states), memory)
    state = first_state(inputs, start, aircraft, name)
    V = float(np.linalg.norm(state[:3]))
    conditions = np.empty((len(t), len(CONDITIONS)))
    conditions[:, 0] = _mass(t, given, aircraft, name)
    conditions[:, 1:7] = _inertia(t, given, aircraft)
    conditions[:, 7:13] = air.motion(t, V, float(state[11]), aircraft.b)
    conditions[:, 13] = math.nan if air.rho is None else air.rho
    vane = aircraft.sensors.get("beta_vane") or aircraft.sensors.get("vane")
    manoeuvre = ManoeuvreInputs(
        t=t,
        controls=np.column_stack(columns) if columns else np.zeros((len(t), 0)),
        conditions=conditions,
        start=state,
        hold=between == "hold",
        vanes=np.zeros(5) if vanes is None else vanes,
        heights=air.heights,
        wind=air.wind,
        isa_offset=air.isa_offset,
        gravity=air.gravity,
        sensor_positions=np.array([aircraft.position(place) for place in kinematics.PLACES]),
        flank_angle_vane=vane is not None and vane.angle == "flank",
    )
    step = float(np.diff(t).max())
    steps = substeps or max(1, math.ceil(step / _LONGEST_STEP - 1e-9))
    return FlightSetup(name, compiled, manoeuvre, formulas, steps)


def first_state(inputs: Inputs, start: Start | None, aircraft: Aircraft, name: str) -> np.ndarray:
    """(12,) state a flight starts from: the one given, or the first sample of the recording.

    Raises
    ------
    ChannelError
        There is neither, or it lacks what a state needs.
    DataError
        The first sample is not finite.
    """
    if isinstance(start, Trim):
        return start.state
    if start is None and not isinstance(inputs, Recording):
        raise ChannelError(
            "simulate needs a start where the inputs are no Recording: give a Trim, or V, alpha, theta, h."
        )
    held: dict[str, float]
    if start is None:
        assert isinstance(inputs, Recording)
        held = {c: float(inputs[c][0]) for c in (*STATES, "V", "alpha", "beta") if c in inputs}
    else:
        held = {c: float(v) for c, v in start.items()}
        if unknown := [c for c in held if c not in (*STATES, "V", "alpha", "beta")]:
            raise ChannelError(f"A start has no '{unknown[0]}'; it may have V, alpha, beta, {', '.join(STATES)}.")
    from_velocity = {"u", "v", "w"} <= held.keys()
    lacking = [c for c in ("theta", "h", *(() if from_velocity else ("V", "alpha"))) if c not in held]
    if lacking:
        raise ChannelError(
            f"The start of a flight needs V and alpha (or u, v, w), theta and h; '{name}' lacks {', '.join(lacking)}.",
            remedy="Give start={...}, or start from trim(...). What else is not given starts at zero.",
            cli_remedy="Start from --trim. What else is not given starts at zero.",
        )
    if wrong := [c for c, v in held.items() if not math.isfinite(v)]:
        raise DataError(f"'{name}': the flight cannot start, since {wrong[0]} is not finite at the first sample.")
    state = np.array([held.get(c, 0.0) for c in STATES])
    if not from_velocity:
        V, alpha, beta = held["V"], held["alpha"], held.get("beta", 0.0)
        if start is None and not (isinstance(inputs, Recording) and inputs.at_cg):
            # Measured at the vane; the state is that of the centre of gravity.
            p, q, r = state[3:6]
            at_cg = air_data_at_cg(V, alpha, beta, p, q, r, aircraft.position("vane"))
            V, alpha, beta = (float(x) for x in at_cg)
        state[:3] = body_velocity(V, alpha, beta)
    return state


def start_from(
    model: AeroModel, aircraft: Aircraft, recording: Recording, air: Atmosphere | None = None
) -> dict[str, float]:
    """Initial state of a simulation by name: the first sample of a recording, at the centre of gravity.

    A model without lateral coefficients is simulated without sideslip, at the recorded airspeed: nothing would end a
    lateral motion. In air of a given density the altitude has no effect, and is zero where it was not recorded.

    Raises
    ------
    ChannelError, DataError
        The recording lacks what a simulation starts from, or that is not finite.
    """
    if air is not None and air.rho is not None and "h" not in recording:
        recording = recording.with_channels(h=0.0)
    state = first_state(recording, None, aircraft, recording.name)
    if not any(name in model for name in LATERAL_COEFFICIENTS):
        u, w = state[0], state[2]
        state[[0, 2]] *= np.linalg.norm(state[:3]) / np.hypot(u, w)
        state[[STATES.index(name) for name in LATERAL_STATES]] = 0.0
    return dict(zip(STATES, state.tolist()))


def as_inputs(given: Any, call: str) -> Inputs:
    """Inputs as a Recording or a mapping; a data frame becomes a Recording.

    Raises
    ------
    ArgumentError
        They are something else.
    """
    return given if isinstance(given, Mapping) else as_one_recording(given, call)


def _schedule(inputs: Inputs) -> tuple[np.ndarray, Mapping[str, Any], str]:
    """Clock, channels and name of the inputs."""
    if isinstance(inputs, Recording):
        return inputs.t, inputs.channels, inputs.name
    if "t" not in inputs:
        raise ChannelError(f"The inputs need a clock 't' [s]; they have {', '.join(map(str, inputs)) or 'nothing'}.")
    t = np.array(inputs["t"], dtype=float)
    if t.ndim != 1 or len(t) < 2 or not (np.diff(t) > 0.0).all():
        raise DataError("The clock 't' of the inputs must ascend, over two samples at least.")
    return t, {c: v for c, v in inputs.items() if c != "t"}, "simulated"


def _column(
    channel: str, t: np.ndarray, given: Mapping[str, Any], trimmed: Mapping[str, float], name: str
) -> np.ndarray:
    if channel not in given and channel not in trimmed:
        raise ChannelError(
            f"The model flies on '{channel}'; '{name}' has none.\nIt has: {', '.join(given) or 'nothing'}. Give it "
            "with the inputs (a number is held), start from a trim that sets it, or define it by a formula."
        )
    values = np.asarray(given[channel] if channel in given else trimmed[channel], dtype=float)
    if values.ndim and values.shape != t.shape:
        raise DataError(f"'{name}': input '{channel}' has shape {values.shape}, the clock {t.shape}.")
    values = np.broadcast_to(values, t.shape)
    if not np.isfinite(values).all():
        i = int(np.argmin(np.isfinite(values)))
        raise DataError(
            f"'{name}': input '{channel}' is {values[i]} at sample {i} (t = {t[i]:g} s). Interpolate it first."
        )
    return values


def _mass(t: np.ndarray, given: Mapping[str, Any], aircraft: Aircraft, name: str) -> np.ndarray:
    """Mass along the flight [kg]: recorded, or the aircraft's less the fuel burnt."""
    if "mass" in given:
        return _column("mass", t, given, {}, name)
    if aircraft.mass is None:
        raise AircraftError(
            f"simulate needs a mass; aircraft '{aircraft.name}' has none and '{name}' has no channel 'mass' [kg]."
        )
    mass = np.full(len(t), aircraft.mass)
    if "fuel_flow" in given:
        flow = _column("fuel_flow", t, given, {}, name)
        mass[1:] -= scipy.integrate.cumulative_trapezoid(flow, t)
        if not mass[-1] > 0.0:
            raise DataError(f"'{name}': the fuel flow exceeds the mass of the aircraft. Check its unit, kg/s.")
    return mass


def _inertia(t: np.ndarray, given: Mapping[str, Any], aircraft: Aircraft) -> np.ndarray:
    """(n, 6) Ix, Iy, Iz, Ixz, Ixy, Iyz: recorded where they are, else the aircraft's."""
    inertia = aircraft.require_inertia("simulate")
    return np.column_stack([_column(c, t, given, {c: getattr(inertia, c)}, "inputs") for c in _INERTIA])
