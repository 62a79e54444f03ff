"""States of a control surface in an aircraft file of JSBSim: lags, rate limits, backlash and position limits.

A state becomes a channel of the flight control, and the aerodynamics read its output instead of the position of the
surface. It is a function of the step ``simulation/dt``, not a filter of JSBSim: a ``lag_filter`` keeps the step with
which it was loaded, and has no steady state if an aircraft is set to a state with a step of zero.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from structsel.exporting.jsbsim_pieces import number, op, prop
from structsel.model import State

PREFIX = "found"
"""First part of the names of all properties that are added."""
SIDES = {
    "de": {"elevator": 1.0}, "da": {"left-aileron": 1.0, "right-aileron": -1.0}, "dr": {"rudder": 1.0},
    "df": {"flap": 1.0},
}  # fmt: skip
"""Surfaces of a control, and the sign with which each moves, before that of the aircraft."""
_UNITS = {"rad": 1.0, "deg": 180.0 / np.pi}
_DIMENSIONED = ("rate", "width", "low", "high")


def reason_unwritable(air: ET.Element, state: State) -> str:
    """Reason why a state cannot be inserted between a surface and the aerodynamics; empty if it can.

    Parameters
    ----------
    air : Element
        The section ``aerodynamics``.
    state : State
    """
    positions = _positions_read(air, state.input)
    if not positions:
        return f"JSBSim's aerodynamics read no angle of {state.input}"
    if state.kind == "delay":
        return "JSBSim counts a delay in the steps with which it was loaded"
    if any(unit not in _UNITS for _, unit, _ in positions) and set(state.parameters) & set(_DIMENSIONED):
        return f"JSBSim's aerodynamics read a fraction of {state.input}, no angle"
    return ""


def insert_state(air: ET.Element, flight_control: ET.Element, state: State, sense: float) -> None:
    """Insert a state between the surfaces of a control and the aerodynamics.

    Parameters
    ----------
    air, flight_control : Element
        The sections ``aerodynamics`` and ``flight_control``.
    state : State
    sense : float
        Sign of the control in the aircraft file.
    """
    channel = ET.SubElement(flight_control, "channel", name=f"{PREFIX} {state.kind} of {state.input}")
    for path, unit, side in _positions_read(air, state.input):
        output = path.replace("fcs/", f"fcs/{PREFIX}/")
        fraction = state["fraction"] if "fraction" in state.parameters else 1.0
        follower = output if fraction == 1.0 else f"{output}-complete"
        _component(channel, follower, _next_value(state, path, follower, _UNITS.get(unit, 1.0), side * sense))
        if fraction != 1.0:
            part = op("product", number(fraction), op("difference", prop(follower), prop(path)))
            _component(channel, output, op("sum", prop(path), part))
        for element in air.iter():
            text = (element.text or "").strip()
            if element.tag in ("property", "p", "independentVar") and text.lstrip("-") == path:
                element.text = text.replace(path, output)


def _positions_read(air: ET.Element, control: str) -> list[tuple[str, str, float]]:
    """Properties of a control that the aerodynamics read: path, unit, and sign of the side."""
    read = {(e.text or "").strip().lstrip("-") for e in air.iter() if isinstance(e.tag, str)}
    made = []
    for side, sense in SIDES[control].items():
        for unit in (*_UNITS, "norm"):
            if (path := f"fcs/{side}-pos-{unit}") in read:
                made.append((path, unit, sense))
    return made


def _next_value(state: State, path: str, output: str, unit: float, sense: float) -> ET.Element:
    """Output of a state as a function of its input and its last output; at a step of zero, of its input only."""
    of = {name: q.value * (unit if name in _DIMENSIONED else 1.0) for name, q in state.parameters.items()}
    x, y, dt = prop(path), prop(output), prop("simulation/dt")
    match state.kind:
        case "lag":
            gone = op("difference", number(1.0), op("exp", op("product", number(-1.0 / of["tau"]), dt)))
            then = op("sum", y, op("product", op("difference", x, y), gone))
        case "rate limit":
            largest, least = (op("product", number(s * of["rate"]), dt) for s in (1.0, -1.0))
            then = op("sum", y, op("max", least, op("min", largest, op("difference", x, y))))
        case "backlash":
            low, high = (op("sum", x, number(s * 0.5 * of["width"])) for s in (-1.0, 1.0))
            then = op("max", low, op("min", high, y))
        case _:
            then, ends = x, (of.get("low", -np.inf), of.get("high", np.inf))
            ends = ends if sense > 0.0 else (-ends[1], -ends[0])
            for kind, end in zip(("max", "min"), ends):
                then = op(kind, number(end), then) if np.isfinite(end) else then
            return then
    return op("ifthen", op("le", dt, number(0.0)), x, then)


def _component(channel: ET.Element, output: str, content: ET.Element) -> None:
    ET.SubElement(ET.SubElement(channel, "fcs_function", name=output), "function").append(content)
