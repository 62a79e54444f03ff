"""A JSBSim aircraft as a truth: external forces, a store that drops, gusts, and its aerodynamic functions."""

from __future__ import annotations

import math
import os
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from proof.jsbsim.functions import AeroFunction, Property, Table, read_functions, to_xml, walk
from structsel.errors import SimulationError
from structsel.simulation.jsbsim.aircraft import JSBSimAircraft
from structsel.simulation.jsbsim.fdm import silence_output

FLEET = ("c172p", "c172r", "c172x", "pa28", "J3Cub", "t6texan2", "DHC6", "OV10", "global5000", "737", "A320", "B747",
         "MD11", "T37", "A4", "F80C", "f15", "F4N")  # fmt: skip
"""Aircraft of JSBSim that trim and fly well."""
FT, LBF = 0.3048, 4.4482216152605
_FORCES = ("x", "y", "z", "l", "m", "n")
FLAPS = tuple(f"fcs/flap-pos-{unit}" for unit in ("rad", "deg", "norm"))
_FLAP_SPAN = 0.6  # rad, full flap where the aerodynamics read a fraction only


def original(name: str) -> Path:
    """XML of an aircraft that comes with JSBSim."""
    try:
        import jsbsim
    except ImportError as error:
        raise SimulationError('JSBSim is not installed; Install it with: pip install "structsel[jsbsim]".') from error
    return Path(jsbsim.get_default_root_dir()) / "aircraft" / name / f"{name}.xml"


class JSBSimPlant(JSBSimAircraft):
    """One aircraft of JSBSim with what a truth needs besides.

    Parameters
    ----------
    name : str
        Of JSBSim's.
    functions : tuple of AeroFunction, optional
        Aerodynamic functions that take the place of those of the same name.

    Attributes
    ----------
    functions : tuple of AeroFunction
    properties : tuple of str
        Properties that the parts read and nobody but JSBSim knows.
    mass : float [kg]
    flap : float [rad]
        Full flap.
    clearance : float [m]
        From the lowest wheel to the centre of gravity.
    """

    def __init__(self, name: str, functions: tuple[AeroFunction, ...] | None = None):
        source = original(name)
        with silence_output(), tempfile.TemporaryDirectory() as folder:
            super().__init__(_copy(source, Path(folder), functions), None, "flat", None)
        self.name = name
        self.mass = float(self.aircraft.mass or 0.0)
        self.functions = functions or read_functions(source)
        free = {function.name for function in self.functions if not function.axis}
        read = set().union(*(function.reads() for function in self.functions))
        manager = self._fdm.fdm.get_property_manager()
        self.properties = tuple(sorted(p for p in read - free if manager.hasNode(p)))
        if lost := sorted(read - free - set(self.properties)):
            raise SimulationError(f"JSBSim's {name} has no property '{lost[0]}', which its aerodynamics read.")
        self._property_nodes = [manager.get_node(p) for p in self.properties]
        self._force_nodes = [
            manager.get_node(f"external_reactions/push-{c}/magnitude" + ("" if c in "xyz" else "-lbsft"))
            for c in _FORCES
        ]
        self._wind_nodes = [manager.get_node(f"atmosphere/gust-{c}-fps") for c in ("north", "east", "down")]
        self._store = f"inertia/pointmass-weight-lbs[{_count_masses(source)}]"
        for c in "xyz":
            centre = self._fdm.fdm[f"inertia/cg-{c}-in"]
            for push in _FORCES[:3]:
                self._fdm.fdm[f"external_reactions/push-{push}/location-{c}-in"] = centre
        self._flap_nodes = [manager.get_node(p) if manager.hasNode(p) else None for p in FLAPS]
        self.flap = self._flap_span()
        self.clearance = self._lowest()
        self._brakes = [p for p in self.properties if "speedbrake" in p]
        self.has_brake = bool(self._brakes)

    # --- set and read in the loop of a flight ---------------------------------------------------

    def set_external_force(self, force: np.ndarray, moment: np.ndarray) -> None:
        """Force [N] at and moment [N m] about the centre of gravity, from the next step on."""
        for node, value in zip(self._force_nodes, (*(force / LBF), *(moment / (LBF * FT)))):
            node.set_double_value(float(value))

    def set_wind(self, wind: np.ndarray) -> None:
        """Velocity of the air (3,) [m/s], north east down."""
        for node, value in zip(self._wind_nodes, wind):
            node.set_double_value(float(value) / FT)

    @property
    def in_wind(self) -> bool:
        """Whether the air moves."""
        return any(node.get_double_value() for node in self._wind_nodes)

    def set_store_mass(self, mass: float) -> None:
        """Mass [kg] of a store at the centre of gravity."""
        self._fdm.fdm[self._store] = mass * 9.80665 / LBF

    def set_controls(self, settings: Mapping[str, float]) -> None:
        """Surfaces, throttle, and ``df`` [rad], ``gear``, ``brake`` (0..1)."""
        rest = {c: v for c, v in settings.items() if c not in ("df", "brake")}
        self._fdm.set(rest)
        if "df" in settings:
            fraction = settings["df"] / self.flap
            for node, value in zip(self._flap_nodes, (settings["df"], math.degrees(settings["df"]), fraction)):
                if node is not None:
                    node.set_attribute(self._fdm._writable, True)
                    node.set_double_value(value)
                    node.set_attribute(self._fdm._writable, False)
        if "brake" in settings:
            for path in self._brakes:
                scale = math.radians(60.0) if path.endswith("rad") else 1.0
                node = self._fdm.fdm.get_property_manager().get_node(path)
                node.set_attribute(self._fdm._writable, True)
                node.set_double_value(scale * settings["brake"])
                node.set_attribute(self._fdm._writable, False)

    def read_properties(self) -> list[float]:
        """Values of `properties` now, in JSBSim's units."""
        return [node.get_double_value() for node in self._property_nodes]

    @property
    def machine(self) -> Any:
        """JSBSim itself."""
        return self._fdm

    def effectiveness(self, state: np.ndarray, controls: Mapping[str, float]) -> dict[str, float]:
        """Angular acceleration per radian of each surface [1/s^2], as sizes."""
        found = {}
        with silence_output():
            for surface, rate in (("de", "q_dot"), ("da", "p_dot"), ("dr", "r_dot")):
                if surface not in self.controls:
                    continue
                got = []
                for step in (-0.01, 0.01):
                    self._fdm.place(state, {**controls, surface: controls[surface] + step})
                    got.append(self._fdm.value(rate))
                found[surface] = abs(got[1] - got[0]) / 0.02
        return found

    def _flap_span(self) -> float:
        spans = []
        for function in self.functions:
            for table in (n for n in walk(function.node) if isinstance(n, Table)):
                for child, breaks in zip(table.inputs, table.axes):
                    if isinstance(child, Property) and child.name == "fcs/flap-pos-deg":
                        spans.append(math.radians(float(breaks[-1])))
        return max(spans, default=_FLAP_SPAN)

    def _lowest(self) -> float:
        fdm, low = self._fdm.fdm, 1.0
        for i in range(20):
            if not fdm.get_property_manager().hasNode(f"gear/unit[{i}]/z-position"):
                break
            low = max(low, float(self._fdm.from_cg(*(f"gear/unit[{i}]/{c}-position" for c in "xyz"))[2]))
        return low


def _replace(root: ET.Element, functions: tuple[AeroFunction, ...]) -> None:
    new = {function.name: function for function in functions}
    for element in root.iter("function"):
        if function := new.get(str(element.get("name"))):
            for child in list(element):
                element.remove(child)
            element.append(to_xml(function.node))


def _copy(source: Path, folder: Path, functions: tuple[AeroFunction, ...] | None) -> Path:
    """Copy of an aircraft's XML, with its engines and systems, and an external force and a store."""
    tree = ET.parse(source)
    root = tree.getroot()
    if functions:
        _replace(root, functions)
    reactions = root.find("external_reactions")
    if reactions is None:
        reactions = ET.SubElement(root, "external_reactions")
    for k, name in enumerate(_FORCES):
        reaction = ET.SubElement(reactions, "force" if k < 3 else "moment", name=f"push-{name}", frame="BODY")
        if k < 3:
            _vector(ET.SubElement(reaction, "location", unit="IN"), (0.0, 0.0, 0.0))
        _vector(ET.SubElement(reaction, "direction"), tuple(float(i == k % 3) for i in range(3)))
    balance = root.find("mass_balance")
    if balance is None:
        raise SimulationError(f"'{source}' has no mass_balance.")
    centre = next(place for place in balance.findall("location") if place.get("name") == "CG")
    store = ET.SubElement(balance, "pointmass", name="store")
    ET.SubElement(store, "weight", unit="LBS").text = "0"
    spot = ET.SubElement(store, "location", unit=str(centre.get("unit", "IN")))
    for c in "xyz":
        ET.SubElement(spot, c).text = centre.findtext(c)
    for output in root.findall("output"):
        root.remove(output)
    for other in source.parent.iterdir():
        if other != source:
            os.symlink(other, folder / other.name)
    tree.write(folder / source.name)
    return folder / source.name


def _count_masses(source: Path) -> int:
    balance = ET.parse(source).getroot().find("mass_balance")
    return 0 if balance is None else len(balance.findall("pointmass"))


def _vector(element: ET.Element, values: tuple[float, ...]) -> None:
    for c, value in zip("xyz", values):
        ET.SubElement(element, c).text = repr(value)
