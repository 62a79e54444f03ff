"""simulate(): the response of an AeroModel to given inputs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

import numpy as np

from structsel.aircraft import Aircraft
from structsel.candidates.formula import Node, evaluate
from structsel.errors import SimulationError
from structsel.model import AeroModel
from structsel.model.ranges import check_outside, report_excursions
from structsel.nomenclature import COEFFICIENTS, LATERAL_STATES, WIND_AXIS_COEFFICIENTS
from structsel.numerics.flight_model import READINGS, REASONS, STATES
from structsel.readers.table import MOVED_TO_CG
from structsel.recording import Recording
from structsel.recording.arguments import require_kind
from structsel.simulation.atmosphere import Atmosphere
from structsel.simulation.flight_setup import Between, FlightSetup, Inputs, Start, as_inputs, prepare
from structsel.simulation.instruments import Actuator, Instruments
from structsel.simulation.missing_responses import warn_missing
from structsel.simulation.steady_flight import Trim

if TYPE_CHECKING:
    import pandas as pd

_AT_CG = ("V", "alpha", "beta", "ax", "ay", "az")
_MOTION = ("p", "q", "r", "phi", "theta", "psi", "x", "y", "h", "vn", "ve", "vd", "rho", "qbar", "mach", "mass")
_EXACT = ("u", "v", "w", "p_dot", "q_dot", "r_dot", "V_dot", "alpha_dot", "beta_dot")
_LATERAL = [STATES.index(name) for name in LATERAL_STATES]


def simulate(
    model: AeroModel,
    aircraft: Aircraft,
    inputs: Inputs | pd.DataFrame,
    *,
    start: Start | None = None,
    air: Atmosphere | None = None,
    actuators: Mapping[str, Actuator] | None = None,
    instruments: Instruments | None = None,
    definitions: Mapping[str, str] | None = None,
    between: Between = "linear",
    substeps: int | None = None,
    outside: Literal["warn", "ignore", "raise"] = "warn",
) -> Recording:
    """Simulate a model with six degrees of freedom and given inputs.

    Parameters
    ----------
    model : AeroModel
        Responses CX, CY, CZ, Cl, Cm, Cn, or CL and CD for CZ and CX; those it lacks are zero. Terms may hold any
        state, V, alpha, beta, p_hat, q_hat, r_hat, V_ratio, CT, mach, qbar, rho, h, alpha_dot_hat and beta_dot_hat
        (linearly), and any channel that the inputs hold.
    aircraft : Aircraft
        With mass and inertia; its thrust line, rotor and places of instruments are allowed for.
    inputs : Recording, DataFrame, or mapping of channel to (n,) array or float
        With ``t``, the controls that the model needs, and, where there is thrust, ``thrust`` [N]. ``mass``,
        ``fuel_flow`` [kg/s], ``Ix`` ... ``Iyz`` are used where they are given. States are not: they are simulated.
    start : Trim or mapping, optional
        V, alpha, beta or u, v, w (relative to the air), p, q, r, phi, theta, psi, x, y, h; what is not named is zero,
        but V, alpha, theta and h must be. By default the first sample of the recording. A Trim also gives the
        controls that the inputs lack.
    air : Atmosphere, optional
        Atmosphere, wind, shear, gusts, turbulence; calm standard air by default.
    actuators : mapping of channel to Actuator, optional
        Then those inputs are commands.
    instruments : Instruments, optional
        What is recorded is then what the instruments read at their places. Without it every channel is exact and at
        the centre of gravity, and derivatives, coefficients and u, v, w are there as well.
    definitions : mapping of channel to formula, optional
        Channels that follow from others, such as ``{"thrust": "9000*throttle*rho/1.225"}``.
    between : {"linear", "hold"}
        What the inputs do between samples.
    substeps : int, optional
        Steps of the integration (Runge and Kutta, fourth order) per sample; by default none is above 0.02 s.
    outside : {"warn", "ignore", "raise"}
        What to do where the flight leaves the ranges the model was identified in.

    Returns
    -------
    Recording

    Raises
    ------
    ArgumentError
        The model, the aircraft or the inputs are objects of another type.
    ChannelError, DataError
        An input is missing, not finite or of the wrong length; or there is no start.
    ModelError
        A response that is no coefficient, or a term that cannot be simulated.
    AircraftError
        There is no mass or no inertia.
    SimulationError
        The motion diverged, or became vertical; the message says when, and ``.partial`` holds it to there.

    Warns
    -----
    StructselWarning
        The flight leaves the ranges the model was identified in, or the model lacks a coefficient that the motion
        depends on, which is taken as zero.

    References
    ----------
    [M86], [KM16] ch. 3.
    """
    call = "simulate(model, aircraft, inputs)"
    require_kind(model, AeroModel, call)
    require_kind(aircraft, Aircraft, call)
    inputs = as_inputs(inputs, call)
    if start is not None and not isinstance(start, Mapping):
        require_kind(start, Trim, call, "start, or a mapping of V, alpha, theta and h")
    if instruments is not None:
        require_kind(instruments, Instruments, call)
    check_outside(outside)
    vanes = None if instruments is None else instruments.vane_errors
    setup = prepare(
        model, aircraft, inputs, start=start, air=air, actuators=actuators, definitions=definitions, between=between,
        substeps=substeps, vanes=vanes,
    )  # fmt: skip
    warn_missing(model, lateral=bool(setup.manoeuvre.start[_LATERAL].any()))
    names = _outputs(setup, model, instruments)
    batch = setup.simulate(names, instruments=instruments is not None)
    samples, reason = int(batch.samples[0]), int(batch.reason[0])
    flight = (
        _recording(setup, model, names, batch.outputs[0, :samples], batch.memory[0, :samples], instruments)
        if samples > 1
        else None
    )
    if reason:
        end = float(setup.manoeuvre.t[min(samples, len(setup.manoeuvre.t) - 1)])
        raise SimulationError(
            f"'{setup.name}' could not be simulated beyond t = {end:g} s (sample {samples} of "
            f"{len(setup.manoeuvre.t)}): {REASONS[reason]}.\nThe motion diverges where an aircraft is "
            "unstable without its pilot, or a parameter is far off.",
            flight,
            remedy="Simulate a shorter part, start from trim(), or check the signs of the model's static and damping "
            "terms. The flight so far is in the error's .partial.",
            cli_remedy="Simulate a shorter part, start from --trim, or check the signs of the model's static and "
            "damping terms. With --out the flight so far is written.",
        )
    assert flight is not None
    if outside != "ignore":
        _report_excursions(setup, model, flight, outside)
    return flight


def _outputs(setup: FlightSetup, model: AeroModel, instruments: Instruments | None) -> tuple[str, ...]:
    thrust = ("thrust",) if setup.compiled.has_thrust and "thrust" not in setup.compiled.controls else ()
    if instruments is not None:
        return (*_AT_CG, *_MOTION, *thrust)
    return (*_AT_CG, *_EXACT, *_MOTION, *thrust, *COEFFICIENTS)


def _recording(
    setup: FlightSetup,
    model: AeroModel,
    names: tuple[str, ...],
    outputs: np.ndarray,
    memory: np.ndarray,
    instruments: Instruments | None,
) -> Recording:
    t = setup.manoeuvre.t[: len(outputs)]
    channels = dict(zip(names, outputs.T))
    channels |= dict(zip(setup.compiled.controls, setup.manoeuvre.controls[: len(outputs)].T))
    for name, values in zip(setup.compiled.memory_names, memory.T):
        del channels[name]
        if instruments is None:
            channels[name] = values
    notes = [f"simulated: {model.name or 'a model'}, {setup.substeps} steps a sample"]
    if missing := [a for a, b in zip(COEFFICIENTS, WIND_AXIS_COEFFICIENTS) if a not in model and b not in model]:
        notes.append(f"the model has no {', '.join(missing)}; zero")
    if not setup.compiled.has_thrust:
        notes.append("no thrust given or defined; zero")
    if instruments is None:
        notes.append(f"{MOVED_TO_CG}{', '.join(_AT_CG)}; simulated there")
        for name in setup.formulas.own:
            node = setup.formulas.expand(Node("channel", name=name))
            channels[name] = evaluate(node, channels, name)
    else:
        for name in ("rho", "qbar", "mach", "mass"):  # no instrument reads these by default
            if name not in (*instruments.noise, *instruments.bias, "rho"):
                del channels[name]
        channels = instruments.read(t, channels)
        notes.append(f"read by instruments at their places: {', '.join(n for n in channels if n in READINGS)}")
    at_cg = frozenset(_AT_CG if instruments is None else ())
    return Recording(setup.name, t, channels, provenance=tuple(notes), at_cg=at_cg).check()


def _report_excursions(
    setup: FlightSetup, model: AeroModel, flight: Recording, outside: Literal["warn", "raise"]
) -> None:
    """Report the channels that leave the ranges of the model, computed ones among them."""
    channels = dict(flight.channels)
    for name in model.ranges:
        if name not in channels and name in setup.formulas and set(setup.formulas.needs([name])) <= set(channels):
            channels[name] = evaluate(setup.formulas.expand(Node("channel", name=name)), channels, name)
    report_excursions(f"The simulated flight '{flight.name}'", model.range_excursions(channels), outside, stacklevel=3)
