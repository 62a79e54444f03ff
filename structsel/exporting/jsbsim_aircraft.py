"""An aircraft of JSBSim around a section of aerodynamics: geometry, mass, inertia, thrust as an external force."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable

from structsel.aircraft import Aircraft
from structsel.errors import AircraftError
from structsel.exporting.header import one_line
from structsel.simulation.jsbsim.fdm import EXTERNAL

FOOT, POUND = 0.3048, 4.4482216152605
"""Metres, newtons; exact by definition."""
_SLUG = POUND / FOOT
_POUNDS_PER_SLUG = 32.174049  # as JSBSim turns weights into masses
_INCH = FOOT / 12.0


def aircraft_around(aerodynamics: ET.Element, aircraft: Aircraft, name: str, inputs: Iterable[str]) -> ET.Element:
    """Whole aircraft; its centre of gravity is the origin, and the moments' centre.

    Parameters
    ----------
    aerodynamics : Element
    aircraft : Aircraft
    name : str
    inputs : iterable of str
        Properties that are to be set from outside.

    Raises
    ------
    AircraftError
        There is no mass or no inertia, or rotating parts, for which JSBSim has no place without an engine.
    """
    inertia = aircraft.require_inertia("The export to JSBSim of a whole aircraft")
    if aircraft.mass is None:
        raise AircraftError(
            f"The export to JSBSim of a whole aircraft needs its mass; aircraft '{aircraft.name}' leaves it to the "
            "recordings.\nAdd mass [kg], or export the aerodynamics alone, without an aircraft."
        )
    if aircraft.engine.angular_momentum:
        raise AircraftError(
            f"Aircraft '{aircraft.name}' has rotating parts, which JSBSim takes from engines only.\n"
            "Export the aerodynamics alone, without an aircraft, and give JSBSim the engine; or leave [engine] out."
        )
    root = ET.Element("fdm_config", name=name, version="2.0", release="ALPHA")
    header = ET.SubElement(root, "fileheader")
    ET.SubElement(header, "description").text = one_line(aircraft.name)
    metrics = ET.SubElement(root, "metrics")
    # In JSBSim's own units, so that nothing is lost to its rounded factors.
    _size(metrics, "wingarea", aircraft.S / FOOT**2, "FT2")
    _size(metrics, "wingspan", aircraft.b / FOOT, "FT")
    _size(metrics, "chord", aircraft.cbar / FOOT, "FT")
    for place in ("AERORP", "EYEPOINT", "VRP"):
        _place(metrics, (0.0, 0.0, 0.0), place)
    balance = ET.SubElement(root, "mass_balance")
    # Ixz as in the tensor, the other products as integrals over the mass.
    signs = {"Ix": 1.0, "Iy": 1.0, "Iz": 1.0, "Ixz": -1.0, "Ixy": 1.0, "Iyz": 1.0}
    for key, sign in signs.items():
        tag = f"i{(key[1:] * 2)[:2]}"
        _size(balance, tag, sign * getattr(inertia, key) / (_SLUG * FOOT**2), "SLUG*FT2")
    _size(balance, "emptywt", aircraft.mass / _SLUG * _POUNDS_PER_SLUG, "LBS")
    _place(balance, (0.0, 0.0, 0.0), "CG")
    ET.SubElement(root, "ground_reactions")
    forces = ET.SubElement(root, "external_reactions")
    force = ET.SubElement(forces, "force", name=EXTERNAL.rpartition("/")[2], frame="BODY")
    x, y, z = aircraft.thrust.offset
    _place(force, (-x, y, -z))  # structural axes point aft and up
    direction = ET.SubElement(force, "direction")
    for axis, part in zip("xyz", aircraft.thrust.direction.tolist()):
        ET.SubElement(direction, axis).text = repr(part + 0.0)
    if declared := list(dict.fromkeys(inputs)):
        system = ET.SubElement(root, "system", name="inputs")
        for own in declared:
            ET.SubElement(system, "property", value="0.0").text = own
    root.append(aerodynamics)
    return root


def _size(parent: ET.Element, tag: str, value: float, unit: str) -> None:
    ET.SubElement(parent, tag, unit=unit).text = repr(value)


def _place(parent: ET.Element, metres: tuple[float, float, float], name: str | None = None) -> None:
    place = ET.SubElement(parent, "location", {"unit": "IN"} if name is None else {"name": name, "unit": "IN"})
    for axis, value in zip("xyz", metres):
        ET.SubElement(place, axis).text = repr(value / _INCH + 0.0)
