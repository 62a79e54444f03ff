"""Corrected aircraft of JSBSim: the aircraft file of the simulation with the missing effects.

Terms become functions in the axes of the aircraft. States of control surfaces are those of
`structsel.diagnosis.surface_states`.
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
from structsel.diagnosis.surface_states import PREFIX, SIDES, insert_state, reason_unwritable
from structsel.errors import ModelError, StructselError
from structsel.exporting.jsbsim import force_functions
from structsel.exporting.jsbsim_aircraft import POUND
from structsel.exporting.jsbsim_pieces import comment, number, op, prop
from structsel.model import AeroModel, ResponseModel
from structsel.nomenclature import COEFFICIENTS
from structsel.simulation.jsbsim import JSBSimAircraft, open_jsbsim
from structsel.simulation.jsbsim.fdm import silence_output

_WHERE = "model.json contains it"
_FORCES = {
    "X": {"LIFT": ("sin", "1", 1.0), "DRAG": ("cos", "cos", -1.0), "SIDE": ("cos", "sin", -1.0)},
    "Y": {"DRAG": ("1", "sin", -1.0), "SIDE": ("1", "cos", 1.0)},
    "Z": {"LIFT": ("cos", "1", -1.0), "DRAG": ("sin", "cos", -1.0), "SIDE": ("sin", "sin", -1.0)},
}
"""Factors of a force in body axes in each force in wind axes: functions of alpha and of beta, and the sign."""
_ARMS = {
    "ROLL": (("y", "Z", -1.0), ("z", "Y", 1.0)),
    "PITCH": (("z", "X", -1.0), ("x", "Z", 1.0)),
    "YAW": (("x", "Y", -1.0), ("y", "X", 1.0)),
}
"""Minus the moment that JSBSim adds for a force at the aerodynamic reference point: arm, force, sign."""


@dataclass(frozen=True)
class Patched:
    """An aircraft file of JSBSim.

    Attributes
    ----------
    name : str
        Name of the aircraft; empty if there is none.
    text : str
        Content of its file.
    included : mapping of str to Path
        Systems and engines in the folder of the original aircraft: relative path, and source.
    remarks : tuple of str
        Effects that could not be written, and the reasons.
    """

    name: str = ""
    text: str = ""
    included: Mapping[str, Path] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    def write(self, folder: Path) -> Path:
        """Write the aircraft into a folder of its name, as JSBSim requires; return the path of its file."""
        place = folder / self.name
        for name, path in self.included.items():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, place / name)
        place.mkdir(parents=True, exist_ok=True)
        (place / f"{self.name}.xml").write_text(self.text, encoding="utf-8")
        return place / f"{self.name}.xml"


def patched_aircraft(
    simulation: str, additions: Sequence[Addition], aircraft: Aircraft, flights: Sequence[Flight]
) -> Patched:
    """Aircraft file of JSBSim with effects.

    Parameters
    ----------
    simulation : str
        A bundled name, or ``PATH/AIRCRAFT.xml``.
    additions : sequence of Addition
    aircraft : Aircraft
        Reference lengths and area of the coefficients.
    flights : sequence of Flight

    Returns
    -------
    Patched
        Without a file if no effect could be written.
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
        made = Patched(f"{source.stem}-corrected", text, _included_files(source), tuple(patch.remarks))
        with silence_output(), tempfile.TemporaryDirectory() as folder:
            open_jsbsim(made.write(Path(folder)))
    except (StructselError, OSError, ET.ParseError) as error:
        return Patched(remarks=(f"no aircraft of JSBSim was written: {' '.join(str(error).split())}",))
    return made


def _file_of(simulation: str) -> Path:
    import jsbsim  # already imported by the simulation

    if simulation.endswith(".xml"):
        return Path(simulation)
    return Path(jsbsim.get_default_root_dir()) / "aircraft" / simulation / f"{simulation}.xml"


def _included_files(source: Path) -> dict[str, Path]:
    """Files in the folder of an aircraft that its file reads."""
    own = [path for path in source.parent.iterdir() if path.is_dir() and path.name.lower() in ("systems", "engines")]
    found = [path for folder in own for path in sorted(folder.rglob("*.xml"))]
    named = {str(e.get("file")) for e in ET.parse(source).iter() if e.get("file")}
    found += [path for path in sorted(source.parent.glob("*.xml")) if {path.name, path.stem} & named]
    return {str(path.relative_to(source.parent)): path for path in found}


def _parse(path: Path) -> ET.Element:
    return ET.parse(path, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))).getroot()


class _Patch:
    """XML of an aircraft, into which effects are written one by one."""

    def __init__(self, source: Path, jsbsim: JSBSimAircraft, aircraft: Aircraft, flights: Sequence[Flight]):
        self.root = _parse(source)
        self.jsbsim, self.aircraft, self.folder = jsbsim, aircraft, source.parent
        self.remarks: list[str] = []
        self.terms = Extended({c: ResponseModel((), np.empty(0)) for c in COEFFICIENTS}, flights)
        self.air = self._section("aerodynamics")
        self.axes = {str(axis.get("name")): axis for axis in self.air.findall("axis")}
        if odd := [n for n, axis in self.axes.items() if n not in _KNOWN or axis.get("frame")]:
            raise ModelError(f"'{source}' has the axis '{odd[0]}', to which no effect can be added.")

    def _section(self, name: str) -> ET.Element:
        section = self.root.find(name)
        if section is None:
            section = ET.SubElement(self.root, name)
        if name_there := section.attrib.pop("file", ""):
            places = [self.folder / sub / name_there for sub in ("", "Systems")]
            found = [p for place in places for p in (place, Path(f"{place}.xml")) if p.is_file()]
            if not found:
                raise ModelError(f"The section <{name}> is in the file '{name_there}', which does not exist.")
            section[:] = [*_parse(found[0]), *section]
        return section

    def take(self, one: Addition) -> bool:
        """Write an effect; return False and add a remark if this is not possible."""
        if not one.is_known:
            self.remarks.append(f"{one.effect} has no terms or states for the corrected aircraft; {_WHERE}")
            return False
        if one.terms and not one.states:
            read = {c for mine in one.terms.values() for term in mine for c in term.channels}
            if dead := sorted((read & set(SIDES)) - set(self.jsbsim.controls)):
                self.remarks.append(f"{one.effect}: JSBSim's aircraft has no control {dead[0]}; {_WHERE}")
                return False
            return self.terms.take(one)
        controls = {channel for swaps in one.replaced.values() for channel in swaps}
        if one.terms or one.fixed or not controls <= set(SIDES):
            what = ", ".join(f"{s.kind} of {s.input}" for s in one.states.values())
            self.remarks.append(f"{one.effect} ({what}) cannot be written into JSBSim's aircraft; {_WHERE}")
            return False
        if why := next(filter(None, (reason_unwritable(self.air, s) for s in one.states.values())), ""):
            self.remarks.append(f"{one.effect}: {why}; {_WHERE}")
            return False
        for state in one.states.values():
            insert_state(self.air, self._section("flight_control"), state, self.jsbsim.sense(state.input))
        return True

    def text(self, effects: Sequence[str]) -> str:
        """Content of the file."""
        self._add_terms()
        said = f"With {', '.join(effects)}, as estimated by structsel."
        self.root.insert(0, comment(said))
        ET.indent(self.root)
        return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(self.root, encoding="unicode") + "\n"

    # --- terms -----------------------------------------------------------------------------------------

    def _add_terms(self) -> None:
        found = {c: m for c, m in self.terms.responses().items() if m.terms}
        if not found:
            return
        here = self.jsbsim.aircraft
        lengths = {"Cl": _ratio(self.aircraft.b, here.b), "Cn": _ratio(self.aircraft.b, here.b),
                   "Cm": _ratio(self.aircraft.cbar, here.cbar)}  # fmt: skip
        ratio = _ratio(self.aircraft.S, here.S)
        scaled = {
            c: ResponseModel(m.terms, m.values * ratio * lengths.get(c, 1.0), standard_errors=m.standard_errors)
            for c, m in found.items()
        }
        functions, names = force_functions(AeroModel(scaled), self._definitions(), self._held(), PREFIX)
        self._insert(functions)
        forces = {axis: name for axis, name in names.items() if axis in _FORCES}
        if forces:
            self._insert([_function(f"{PREFIX}/arm/{c}", _arm(c)) for c in "xyz"])
        parts: dict[str, list[ET.Element]] = {a: [prop(n)] for a, n in names.items() if a not in _FORCES}
        for axis, name in forces.items():
            for to, part in self._in_own_axes(axis, name):
                parts.setdefault(to, []).append(part)
        for axis, arms in _ARMS.items():
            parts.setdefault(axis, []).extend(
                op("product", number(sign), prop(f"{PREFIX}/arm/{c}"), prop(forces[force]))
                for c, force, sign in arms
                if force in forces
            )
        for axis, mine in parts.items():
            if mine:
                holder = self.axes[axis] if axis in self.axes else ET.SubElement(self.air, "axis", name=axis)
                total = mine[0] if len(mine) == 1 else op("sum", *mine)
                holder.append(_function(f"{PREFIX}/axis/{axis}", total))

    def _in_own_axes(self, axis: str, name: str) -> list[tuple[str, ET.Element]]:
        """Components of a force in body axes along the axes of the aircraft."""
        if not {"LIFT", "DRAG"} & set(self.axes):
            return [(axis, prop(name))]
        made = []
        for to, (of_alpha, of_beta, sign) in _FORCES[axis].items():
            turns = [op(f, prop(f"aero/{angle}-rad")) for f, angle in ((of_alpha, "alpha"), (of_beta, "beta"))
                     if f != "1"]  # fmt: skip
            made.append((to, op("product", number(sign), prop(name), *turns)))
        return made

    def _insert(self, functions: Sequence[ET.Element]) -> None:
        """Insert functions before the axes, after the existing ones."""
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
        if "throttle" in self.jsbsim.controls:
            x, y, z = (repr(float(d)) for d in self.aircraft.thrust.direction)
            made["thrust"] = f"({x})*push_x + ({y})*push_y + ({z})*push_z"
        return made

    def _held(self) -> dict[str, tuple[str, float]]:
        made = {f"push_{c}": (f"forces/fb{c}-prop-lbs", POUND) for c in "xyz"}
        if "thrust" in self.jsbsim.controls:
            made["thrust"] = ("external_reactions/thrust/magnitude", POUND)
        for control, sides in SIDES.items():
            side = next(iter(sides))
            made[control] = (f"fcs/{side}-pos-rad", self.jsbsim.sense(control))
        return made


_KNOWN = ("X", "Y", "Z", "LIFT", "DRAG", "SIDE", "ROLL", "PITCH", "YAW")


def _ratio(ours: float, theirs: float) -> float:
    """Ratio of two areas or lengths; exactly one if they differ only by the rounding of units."""
    return 1.0 if abs(ours / theirs - 1.0) < 1e-9 else ours / theirs


def _arm(c: str) -> ET.Element:
    """Arm from the centre of gravity to the aerodynamic reference point [ft], body axes."""
    ends = [prop(f"metrics/aero-rp-{c}-in"), prop(f"inertia/cg-{c}-in")]
    if c != "y":
        ends.reverse()
    return op("quotient", op("difference", *ends), number(12.0))


def _function(name: str, content: ET.Element) -> ET.Element:
    made = ET.Element("function", name=name)
    made.append(content)
    return made
