"""The simulation itself with the physics that it left out: a patched aircraft of JSBSim.

Terms become functions that add to the axes that the aircraft has. What a surface does with what is asked of it becomes
a channel of the flight control, and the aerodynamics read its output in the surface's place. Those are functions of
the step ``simulation/dt`` and not JSBSim's own filters: a ``lag_filter`` counts in the step that it was loaded with,
and does not settle where an aircraft is put into a state, when that step is zero.
"""

from __future__ import annotations

import shutil
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from structsel.aircraft import Aircraft
from structsel.comparison.flight import Flight
from structsel.diagnosis.adding import Addition
from structsel.diagnosis.extending import Extended
from structsel.errors import ModelError, StructselError
from structsel.exporting.jsbsim import force_functions
from structsel.exporting.jsbsim_aircraft import POUND
from structsel.exporting.jsbsim_pieces import comment, number, op, prop
from structsel.model import AeroModel, ResponseModel, State
from structsel.nomenclature import COEFFICIENTS
from structsel.simulation.jsbsim import JSBSimAircraft, open_jsbsim
from structsel.simulation.jsbsim.fdm import silence_output

_UNDER = "found"
_WHERE = "model.json holds it"
_SIDES = {
    "de": {"elevator": 1.0}, "da": {"left-aileron": 1.0, "right-aileron": -1.0}, "dr": {"rudder": 1.0},
    "df": {"flap": 1.0},
}  # fmt: skip
"""Surfaces of a control, and the sense in which each moves, before that of the aircraft."""
_UNITS = {"rad": 1.0, "deg": 180.0 / np.pi}
_DIMENSIONED = ("rate", "width", "low", "high")
_FORCES = {
    "X": {"LIFT": ("sin", "1", 1.0), "DRAG": ("cos", "cos", -1.0), "SIDE": ("cos", "sin", -1.0)},
    "Y": {"DRAG": ("1", "sin", -1.0), "SIDE": ("1", "cos", 1.0)},
    "Z": {"LIFT": ("cos", "1", -1.0), "DRAG": ("sin", "cos", -1.0), "SIDE": ("sin", "sin", -1.0)},
}
"""Of a force in body axes: functions of alpha and of beta, and the sign, by which it adds to those in wind axes."""
_ARMS = {
    "ROLL": (("y", "Z", -1.0), ("z", "Y", 1.0)),
    "PITCH": (("z", "X", -1.0), ("x", "Z", 1.0)),
    "YAW": (("x", "Y", -1.0), ("y", "X", 1.0)),
}
"""Less the moment that JSBSim makes of a force at the aerodynamic reference point: arm, force, sign."""


@dataclass(frozen=True)
class Patched:
    """An aircraft file of JSBSim.

    Attributes
    ----------
    name : str
        Of the aircraft; empty where there is none.
    text : str
        Content of its file.
    beside : mapping of str to Path
        Systems and engines of the original's own: where they go, and where they are.
    remarks : tuple of str
        What could not be written, and why.
    """

    name: str = ""
    text: str = ""
    beside: Mapping[str, Path] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    def write(self, folder: Path) -> Path:
        """Write the aircraft into a folder of its name, as JSBSim keeps them; the path of its file."""
        place = folder / self.name
        for name, path in self.beside.items():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, place / name)
        place.mkdir(parents=True, exist_ok=True)
        (place / f"{self.name}.xml").write_text(self.text, encoding="utf-8")
        return place / f"{self.name}.xml"


def patched_aircraft(
    simulation: str, additions: Sequence[Addition], aircraft: Aircraft, flights: Sequence[Flight]
) -> Patched:
    """Aircraft file of JSBSim with effects written into it.

    Parameters
    ----------
    simulation : str
        A bundled name, or ``PATH/AIRCRAFT.xml``.
    additions : sequence of Addition
    aircraft : Aircraft
        What the additions' coefficients refer to.
    flights : sequence of Flight

    Returns
    -------
    Patched
        Without a file where nothing could be written.
    """
    wanted = [a for a in additions if not a.remark]
    if not wanted:
        return Patched()
    source = _file_of(simulation)
    try:
        patch = _Patch(source, open_jsbsim(simulation), aircraft, flights)
        written = [a.effect for a in wanted if patch.take(a)]
        if not written:
            return Patched(remarks=tuple(patch.remarks))
        text = patch.text(written)
        made = Patched(f"{source.stem}-corrected", text, _beside(source), tuple(patch.remarks))
        with silence_output(), tempfile.TemporaryDirectory() as folder:
            open_jsbsim(made.write(Path(folder)))
    except (StructselError, OSError, ET.ParseError) as error:
        return Patched(remarks=(f"no aircraft of JSBSim was written: {' '.join(str(error).split())}",))
    return made


def _file_of(simulation: str) -> Path:
    import jsbsim  # it was loaded before, or the simulation could not have been opened

    if simulation.endswith(".xml"):
        return Path(simulation)
    return Path(jsbsim.get_default_root_dir()) / "aircraft" / simulation / f"{simulation}.xml"


def _beside(source: Path) -> dict[str, Path]:
    """Files of an aircraft's own that its file reads."""
    own = [path for path in source.parent.iterdir() if path.is_dir() and path.name.lower() in ("systems", "engines")]
    found = [path for folder in own for path in sorted(folder.rglob("*.xml"))]
    named = {str(e.get("file")) for e in ET.parse(source).iter() if e.get("file")}
    found += [path for path in sorted(source.parent.glob("*.xml")) if {path.name, path.stem} & named]
    return {str(path.relative_to(source.parent)): path for path in found}


def _parse(path: Path) -> ET.Element:
    return ET.parse(path, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))).getroot()


class _Patch:
    """An aircraft's XML, effects written into it one after another."""

    def __init__(self, source: Path, plane: JSBSimAircraft, aircraft: Aircraft, flights: Sequence[Flight]):
        self.root = _parse(source)
        self.plane, self.aircraft, self.folder = plane, aircraft, source.parent
        self.remarks: list[str] = []
        self.terms = Extended({c: ResponseModel((), np.empty(0)) for c in COEFFICIENTS}, flights)
        self.air = self._section("aerodynamics")
        self.axes = {str(axis.get("name")): axis for axis in self.air.findall("axis")}
        if odd := [n for n, axis in self.axes.items() if n not in _KNOWN or axis.get("frame")]:
            raise ModelError(f"'{source}' has the axis '{odd[0]}', of a kind that nothing is added to here.")

    def _section(self, name: str) -> ET.Element:
        section = self.root.find(name)
        if section is None:
            section = ET.SubElement(self.root, name)
        if name_there := section.attrib.pop("file", ""):
            places = [self.folder / sub / name_there for sub in ("", "Systems")]
            found = [p for place in places for p in (place, Path(f"{place}.xml")) if p.is_file()]
            if not found:
                raise ModelError(f"The section <{name}> stands in the file '{name_there}', which is not beside it.")
            section[:] = [*_parse(found[0]), *section]
        return section

    def take(self, one: Addition) -> bool:
        """Write an effect, or say why it cannot be."""
        if not one.is_known:
            self.remarks.append(f"{one.effect} has no terms or states, so it is not in JSBSim's aircraft; {_WHERE}")
            return False
        if one.terms and not one.states:
            read = {c for mine in one.terms.values() for term in mine for c in term.channels}
            if dead := sorted((read & set(_SIDES)) - set(self.plane.controls)):
                self.remarks.append(f"{one.effect}: JSBSim's aircraft has no control {dead[0]}; {_WHERE}")
                return False
            return self.terms.take(one)
        controls = {channel for swaps in one.replaced.values() for channel in swaps}
        if one.terms or one.fixed or not controls <= set(_SIDES):
            what = ", ".join(f"{s.kind} of {s.input}" for s in one.states.values())
            self.remarks.append(f"{one.effect} ({what}) cannot be written into JSBSim's aircraft; {_WHERE}")
            return False
        if why := next(filter(None, map(self._unwritable, one.states.values())), ""):
            self.remarks.append(f"{one.effect}: {why}; {_WHERE}")
            return False
        for state in one.states.values():
            self._follow(state)
        return True

    def text(self, effects: Sequence[str]) -> str:
        """The whole file."""
        self._add_terms()
        said = f"With {', '.join(effects)}, as structsel found it missing."
        self.root.insert(0, comment(said))
        ET.indent(self.root)
        return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(self.root, encoding="unicode") + "\n"

    # --- terms -----------------------------------------------------------------------------------------

    def _add_terms(self) -> None:
        found = {c: m for c, m in self.terms.responses().items() if m.terms}
        if not found:
            return
        here = self.plane.aircraft
        lengths = {"Cl": _ratio(self.aircraft.b, here.b), "Cn": _ratio(self.aircraft.b, here.b),
                   "Cm": _ratio(self.aircraft.cbar, here.cbar)}  # fmt: skip
        ratio = _ratio(self.aircraft.S, here.S)
        scaled = {
            c: ResponseModel(m.terms, m.values * ratio * lengths.get(c, 1.0), standard_errors=m.standard_errors)
            for c, m in found.items()
        }
        functions, names = force_functions(AeroModel(scaled), self._definitions(), self._held(), _UNDER)
        self._insert(functions)
        forces = {axis: name for axis, name in names.items() if axis in _FORCES}
        if forces:
            self._insert([_function(f"{_UNDER}/arm/{c}", _arm(c)) for c in "xyz"])
        parts: dict[str, list[ET.Element]] = {a: [prop(n)] for a, n in names.items() if a not in _FORCES}
        for axis, name in forces.items():
            for to, part in self._in_own_axes(axis, name):
                parts.setdefault(to, []).append(part)
        for axis, arms in _ARMS.items():
            parts.setdefault(axis, []).extend(
                op("product", number(sign), prop(f"{_UNDER}/arm/{c}"), prop(forces[force]))
                for c, force, sign in arms
                if force in forces
            )
        for axis, mine in parts.items():
            if mine:
                holder = self.axes[axis] if axis in self.axes else ET.SubElement(self.air, "axis", name=axis)
                total = mine[0] if len(mine) == 1 else op("sum", *mine)
                holder.append(_function(f"{_UNDER}/axis/{axis}", total))

    def _in_own_axes(self, axis: str, name: str) -> list[tuple[str, ET.Element]]:
        """A force in body axes as parts of the axes that the aircraft has."""
        if not {"LIFT", "DRAG"} & set(self.axes):
            return [(axis, prop(name))]
        made = []
        for to, (of_alpha, of_beta, sign) in _FORCES[axis].items():
            turns = [op(f, prop(f"aero/{angle}-rad")) for f, angle in ((of_alpha, "alpha"), (of_beta, "beta"))
                     if f != "1"]  # fmt: skip
            made.append((to, op("product", number(sign), prop(name), *turns)))
        return made

    def _insert(self, functions: Sequence[ET.Element]) -> None:
        """Put functions before the axes, after those that are there."""
        at = next((i for i, child in enumerate(self.air) if child.tag == "axis"), len(self.air))
        for k, function in enumerate(functions):
            self.air.insert(at + k, function)

    def _definitions(self) -> dict[str, str]:
        b, c, S = (repr(x) for x in (self.aircraft.b, self.aircraft.cbar, self.aircraft.S))
        made = {
            **{f"{rate}_hat": f"{rate}*{length}/(2*V)" for rate, length in (("p", b), ("q", c), ("r", b))},
            "alpha_dot_hat": f"alpha_dot*{c}/(2*V)",
            "beta_dot_hat": f"beta_dot*{b}/(2*V)",
            "CT": f"thrust/(qbar*{S})",
        }
        if self.aircraft.V0 is not None:
            made["V_ratio"] = f"V/{self.aircraft.V0!r}"
        if "throttle" in self.plane.controls:
            x, y, z = (repr(float(d)) for d in self.aircraft.thrust.direction)
            made["thrust"] = f"({x})*push_x + ({y})*push_y + ({z})*push_z"
        return made

    def _held(self) -> dict[str, tuple[str, float]]:
        made = {f"push_{c}": (f"forces/fb{c}-prop-lbs", POUND) for c in "xyz"}
        if "thrust" in self.plane.controls:
            made["thrust"] = ("external_reactions/thrust/magnitude", POUND)
        for control, sides in _SIDES.items():
            side = next(iter(sides))
            made[control] = (f"fcs/{side}-pos-rad", self.plane.sense(control))
        return made

    # --- surfaces --------------------------------------------------------------------------------------

    def _unwritable(self, state: State) -> str:
        """Why a state cannot be put between a control's surfaces and the aerodynamics; empty where it can."""
        places = self._read_by_aerodynamics(state.input)
        if not places:
            return f"JSBSim's aerodynamics read no angle of {state.input}"
        if state.kind == "delay":
            return "JSBSim counts a delay in the steps that it was loaded with, so it is not in its aircraft"
        if any(unit not in _UNITS for _, unit, _ in places) and set(state.parameters) & set(_DIMENSIONED):
            return f"JSBSim's aerodynamics read a share of {state.input}, no angle"
        return ""

    def _follow(self, state: State) -> None:
        """Put a state between a control's surfaces and the aerodynamics."""
        control = self._section("flight_control")
        channel = ET.SubElement(control, "channel", name=f"{_UNDER} {state.kind} of {state.input}")
        for path, unit, sense in self._read_by_aerodynamics(state.input):
            output = path.replace("fcs/", f"fcs/{_UNDER}/")
            share = state["fraction"] if "fraction" in state.parameters else 1.0
            follower = output if share == 1.0 else f"{output}-whole"
            _component(channel, follower, _following(state, path, follower, _UNITS.get(unit, 1.0), sense))
            if share != 1.0:
                part = op("product", number(share), op("difference", prop(follower), prop(path)))
                _component(channel, output, op("sum", prop(path), part))
            for element in self.air.iter():
                text = (element.text or "").strip()
                if element.tag in ("property", "p", "independentVar") and text.lstrip("-") == path:
                    element.text = text.replace(path, output)

    def _read_by_aerodynamics(self, control: str) -> list[tuple[str, str, float]]:
        """Properties of a control that the aerodynamics read: path, unit, and its sense in ours."""
        read = {(e.text or "").strip().lstrip("-") for e in self.air.iter() if isinstance(e.tag, str)}
        made = []
        for side, sense in _SIDES[control].items():
            for unit in (*_UNITS, "norm"):
                if (path := f"fcs/{side}-pos-{unit}") in read:
                    made.append((path, unit, sense * self.plane.sense(control)))
        return made


_KNOWN = ("X", "Y", "Z", "LIFT", "DRAG", "SIDE", "ROLL", "PITCH", "YAW")


def _ratio(ours: float, theirs: float) -> float:
    """Of two areas or lengths; exactly one where they differ by rounding of units only."""
    return 1.0 if abs(ours / theirs - 1.0) < 1e-9 else ours / theirs


def _following(state: State, path: str, output: str, unit: float, sense: float) -> ET.Element:
    """What follows a property, as a function of it and of itself a step before; at once where no time passes."""
    of = {name: q.value * (unit if name in _DIMENSIONED else 1.0) for name, q in state.parameters.items()}
    x, y, dt = prop(path), prop(output), prop("simulation/dt")
    match state.kind:
        case "lag":
            gone = op("difference", number(1.0), op("exp", op("product", number(-1.0 / of["tau"]), dt)))
            then = op("sum", y, op("product", op("difference", x, y), gone))
        case "rate limit":
            most, least = (op("product", number(s * of["rate"]), dt) for s in (1.0, -1.0))
            then = op("sum", y, op("max", least, op("min", most, op("difference", x, y))))
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


def _arm(c: str) -> ET.Element:
    """From the centre of gravity to the aerodynamic reference point [ft], body axes."""
    ends = [prop(f"metrics/aero-rp-{c}-in"), prop(f"inertia/cg-{c}-in")]
    if c != "y":
        ends.reverse()
    return op("quotient", op("difference", *ends), number(12.0))


def _component(channel: ET.Element, output: str, content: ET.Element) -> None:
    ET.SubElement(ET.SubElement(channel, "fcs_function", name=output), "function").append(content)


def _function(name: str, content: ET.Element) -> ET.Element:
    made = ET.Element("function", name=name)
    made.append(content)
    return made
