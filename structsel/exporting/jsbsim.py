"""A model as the aerodynamics of JSBSim, forces and moments in body axes.

Each response becomes a property ``aero/coefficient/...``, and every channel that JSBSim does not hold as it is one
``aero/function/...``; the axes then read them.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from structsel.aircraft import Aircraft
from structsel.candidates import Term
from structsel.candidates.formula import Node
from structsel.candidates.parse import parse_formula
from structsel.errors import ModelError
from structsel.exporting.code_writer import plain
from structsel.exporting.header import describe_channel, fact_lines, term_notes
from structsel.exporting.jsbsim_aircraft import FOOT, POUND, aircraft_around
from structsel.exporting.jsbsim_pieces import comment, joined, number, op, prop
from structsel.model import AeroModel, ResponseModel
from structsel.nomenclature import EULER_ANGLES, suggest
from structsel.simulation.compile_model import has_wind_axes
from structsel.simulation.jsbsim.fdm import EXTERNAL

_SLUG = POUND / FOOT
# Property of JSBSim, and what makes it SI with our sign.
_PROPERTIES: dict[str, tuple[str, float]] = {
    "t": ("simulation/sim-time-sec", 1.0),
    "V": ("velocities/vt-fps", FOOT),
    "alpha": ("aero/alpha-rad", 1.0),
    "beta": ("aero/beta-rad", 1.0),
    "qbar": ("aero/qbar-psf", POUND / FOOT**2),
    "mach": ("velocities/mach", 1.0),
    **{c: (f"attitude/{c}-rad", 1.0) for c in EULER_ANGLES},
    **{c: (f"velocities/{c}-aero-rad_sec", 1.0) for c in "pqr"},
    **{c: (f"velocities/{c}-aero-fps", FOOT) for c in "uvw"},
    "vn": ("velocities/v-north-fps", FOOT),
    "ve": ("velocities/v-east-fps", FOOT),
    "vd": ("velocities/v-down-fps", FOOT),
    "gamma": ("flight-path/gamma-rad", 1.0),
    "de": ("fcs/elevator-pos-rad", 1.0),
    "da": ("fcs/left-aileron-pos-rad", -1.0),  # ours is (right - left) / 2
    "dr": ("fcs/rudder-pos-rad", 1.0),
    "df": ("fcs/flap-pos-rad", 1.0),
    "gear": ("gear/gear-pos-norm", 1.0),
    "throttle": ("fcs/throttle-pos-norm", 1.0),
    "thrust": (f"{EXTERNAL}/magnitude", POUND),
    "mass": ("inertia/mass-slugs", _SLUG),
    "rho": ("atmosphere/rho-slugs_ft3", _SLUG / FOOT**3),
    "pressure": ("atmosphere/P-psf", POUND / FOOT**2),
    "temperature": ("atmosphere/T-R", 5.0 / 9.0),
    "h": ("position/h-sl-ft", FOOT),
    "h_agl": ("position/h-agl-ft", FOOT),
    "alpha_dot": ("aero/alphadot-rad_sec", 1.0),
    "beta_dot": ("aero/betadot-rad_sec", 1.0),
}
# A rate of ours, and the length that makes it dimensionless.
_REDUCED = {
    "p_hat": ("p", "metrics/bw-ft"),
    "q_hat": ("q", "metrics/cbarw-ft"),
    "r_hat": ("r", "metrics/bw-ft"),
    "alpha_dot_hat": ("alpha_dot", "metrics/cbarw-ft"),
    "beta_dot_hat": ("beta_dot", "metrics/bw-ft"),
}
_QBAR, _AREA = "aero/qbar-psf", "metrics/Sw-sqft"
_AXES: dict[str, tuple[str, Sequence[str]]] = {
    "CX": ("X", ()),
    "CY": ("Y", ()),
    "CZ": ("Z", ()),
    "Cl": ("ROLL", ("metrics/bw-ft",)),
    "Cm": ("PITCH", ("metrics/cbarw-ft",)),
    "Cn": ("YAW", ("metrics/bw-ft",)),
}
_FUNCTIONS = {"abs": "abs", "sqrt": "sqrt", "sin": "sin", "cos": "cos", "tan": "tan", "exp": "exp", "log": "ln"}
_SATURATED = 20.0  # from here on tanh is 1 to the last bit


def write_jsbsim(
    model: AeroModel,
    aircraft: Aircraft | None,
    path: Path,
    definitions: Mapping[str, str],
    properties: Mapping[str, str],
) -> dict[Path, str]:
    """Section ``<aerodynamics>``; with an aircraft, the complete aircraft around it.

    Raises
    ------
    ModelError
        A response that is no coefficient, body and wind axes mixed, a channel that JSBSim does not have, or
        definitions in a circle or of a complete aircraft's thrust; or another suffix than ``.xml``.
    AircraftError
        The aircraft has no mass or no inertia.
    """
    _require_coefficients(model)
    if path.suffix != ".xml":
        raise ModelError(f"JSBSim reads files that end in .xml; '{path}' does not. Name it {path.stem}.xml.")
    if aircraft is not None and "thrust" in definitions:
        raise ModelError(
            f"The thrust of a whole aircraft is set from outside, as {EXTERNAL}/magnitude [lb]; it cannot be defined.\n"
            "Leave the definition out, or export the aerodynamics alone, without an aircraft."
        )
    section = _Section(model, aircraft, definitions, properties)
    root = section.element
    if aircraft is not None:
        root = aircraft_around(root, aircraft, path.stem, properties.values())
    said = [*fact_lines(model, aircraft), "", *_REMARKS]
    if aircraft is None:
        said += ["Areas and lengths are those of the aircraft that it is included in, by <aerodynamics file=...>."]
    root.insert(0, comment("\n" + "\n".join(f"    {line}".rstrip() for line in said) + "\n  "))
    ET.indent(root)
    return {path: '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"}


def force_functions(
    model: AeroModel, definitions: Mapping[str, str], held: Mapping[str, tuple[str, float]], under: str
) -> tuple[list[ET.Element], dict[str, str]]:
    """Functions of JSBSim with a model's forces [lb] and moments [lb ft], for the aerodynamics of another aircraft.

    Parameters
    ----------
    model : AeroModel
        Coefficients in body axes, of the areas and lengths of the aircraft that the functions go to.
    definitions : mapping of channel to formula
    held : mapping of channel to (property, factor)
        Properties that hold channels, and what makes them SI with our sign, before those known for any aircraft.
    under : str
        Where the functions' properties stand.

    Returns
    -------
    list of Element
        In the order in which each needs those before it.
    mapping of axis to property
        ``X``, ``Y``, ``Z``, ``ROLL``, ``PITCH``, ``YAW``, as far as the model has them.

    Raises
    ------
    ModelError
        A channel that JSBSim does not have.
    """
    made = _Section(model, None, definitions, {}, held, under).element
    free = [child for child in made if child.tag == "function"]
    names = {}
    for axis in made.findall("axis"):
        for function in axis:
            free.append(function)
            names[str(axis.get("name"))] = str(function.get("name"))
    return free, names


_REMARKS = (
    "Inputs are SI and radians, body axes; positive de, da and dr make negative moments, so da is minus the left",
    "aileron. Moments are about AERORP, which belongs where the model has its moments: the centre of gravity.",
    "Rates of angle of attack and sideslip, where the model has them, are those of JSBSim's step before.",
)


def _require_coefficients(model: AeroModel) -> None:
    known = (*_AXES, "CL", "CD")
    if unknown := [name for name in model if name not in known]:
        raise ModelError(
            f"JSBSim flies the coefficients {', '.join(known)}; the model has the response '{unknown[0]}'."
            f"{suggest(unknown[0], known)}\nLeave it out of the model, or export it to another target."
        )
    has_wind_axes(model)


class _Section:
    """Makes the section: functions in the order in which each needs those before it, then the axes."""

    def __init__(
        self,
        model: AeroModel,
        aircraft: Aircraft | None,
        definitions: Mapping[str, str],
        properties: Mapping[str, str],
        held: Mapping[str, tuple[str, float]] | None = None,
        under: str = "aero",
    ):
        self.model, self.under = model, under
        self.own = {c: (name, 1.0) for c, name in properties.items()}
        # An aircraft without engines has the thrust we give it, and no throttle; for others it is the other way round.
        lacks = "throttle" if aircraft is not None else "thrust"
        self.held = {c: held for c, held in _PROPERTIES.items() if c != lacks} | self.own | dict(held or {})
        self.formulas = dict(definitions)
        if aircraft is not None and aircraft.V0 is not None:
            self.formulas.setdefault("V_ratio", f"V/{aircraft.V0!r}")
        self.made: dict[str, str] = {}
        self.element = ET.Element("aerodynamics")
        for response, one in model.responses.items():
            self._define(
                f"{self.under}/coefficient/{response}", self._total(one), describe_channel(response, model, response)
            )
        for response in self._body_axes():
            axis, lengths = _AXES[response]
            coefficient = prop(f"{self.under}/coefficient/{response}")
            force = op("product", prop(_QBAR), prop(_AREA), *map(prop, lengths), coefficient)
            # At rest reduced rates are not finite, and forces zero all the same.
            guarded = op("ifthen", op("gt", prop(_QBAR), number(0.0)), force, number(0.0))
            holder = ET.SubElement(self.element, "axis", name=axis)
            kind = "moment" if lengths else "force"
            ET.SubElement(holder, "function", name=f"{self.under}/{kind}/{axis}").append(guarded)

    def _body_axes(self) -> list[str]:
        """Coefficients in body axes, those that the model has in wind axes turned."""
        if not {"CL", "CD"} & set(self.model):
            return [name for name in _AXES if name in self.model]
        given = {name: (f"{self.under}/coefficient/{name}", 1.0) for name in ("CL", "CD", "CY") if name in self.model}
        self.held |= given
        CL, CD, CY = (name if name in given else "0" for name in ("CL", "CD", "CY"))
        drag = f"({CD} + {CY}*sin(beta))/cos(beta)"
        for name, text in {
            "CX": f"{CL}*sin(alpha) - {drag}*cos(alpha)",
            "CZ": f"-{CL}*cos(alpha) - {drag}*sin(alpha)",
        }.items():
            self._define(
                f"{self.under}/coefficient/{name}", self.node(parse_formula(text), name), "turned from wind axes"
            )
        return [name for name in _AXES if name in self.model or name in ("CX", "CZ")]

    def _total(self, held: ResponseModel) -> ET.Element:
        """Sum of the terms, each below a comment with its standard error."""
        terms = [self._term(term, value) for term, value in zip(held.terms, held.values.tolist())]
        total = joined("sum", terms)
        if len(terms) > 1:
            for k, note in enumerate(term_notes(held)):
                total.insert(2 * k, comment(note))
        return total

    def _term(self, term: Term, value: float) -> ET.Element:
        parts = [number(value)]
        for factor, power in term.factors:
            if factor.node.kind == "channel" or power == 1:
                parts += [self.node(factor.node, str(term)) for _ in range(power)]
            else:
                parts.append(op("pow", self.node(factor.node, str(term)), number(float(power))))
        return joined("product", parts)

    def _define(self, name: str, content: ET.Element, says: str) -> None:
        function = ET.SubElement(self.element, "function", name=name)
        ET.SubElement(function, "description").text = says
        function.append(content)

    def channel(self, name: str, needed_by: str, inside: tuple[str, ...] = ()) -> ET.Element:
        """Property that holds a channel, its function made first where JSBSim has it otherwise."""
        if name in self.made:
            return prop(self.made[name])
        if name in inside:
            raise ModelError(f"The definitions go in a circle: {' -> '.join((*inside, name))}.")
        if name in self.formulas and name not in self.own:
            content = self.node(parse_formula(self.formulas[name]), needed_by, (*inside, name))
        elif name in self.held:
            found, factor = self.held[name]
            if factor in (1.0, -1.0):
                return prop(found, factor)
            content = op("product", number(factor), prop(found))
        elif name in _REDUCED:
            rate, length = _REDUCED[name]
            above = op("product", self.channel(rate, needed_by, (*inside, name)), prop(length))
            content = op("quotient", above, op("product", number(2.0), prop("velocities/vt-fps")))
        elif name == "CT" and "thrust" in self.held | self.formulas:
            content = self.node(parse_formula("thrust/qbar"), needed_by, (*inside, name))
            content = op("quotient", content, op("product", number(FOOT**2), prop(_AREA)))
        else:
            self._refuse(name, needed_by)
        path = f"{self.under}/function/{plain(name)}"
        while path in self.made.values():
            path += "_"
        self.made[name] = path
        self._define(path, content, describe_channel(name, self.model, name))
        return prop(path)

    def _refuse(self, name: str, needed_by: str) -> None:
        thrust = " Without an aircraft it is not known which property has the thrust." * (name in ("thrust", "CT"))
        V0 = " The aircraft says no V0." * (name == "V_ratio")
        raise ModelError(
            f"Term '{needed_by}' needs channel '{name}', which is not known to be one of JSBSim's.{thrust}{V0}\n"
            f"Say among the properties which will hold it ({name}=aero/input/{name}), or among the definitions which "
            "formula it follows from; or leave the term out."
        )

    def node(self, node: Node, needed_by: str, inside: tuple[str, ...] = ()) -> ET.Element:
        """One formula as JSBSim reads it."""

        def of(child: Node) -> ET.Element:
            return self.node(child, needed_by, inside)

        match node.kind:
            case "number":
                return number(node.value)
            case "channel":
                return self.channel(node.name, needed_by, inside)
            case "plus":
                return op("max", of(node.children[0]), number(0.0))
            case "power":
                return op("pow", of(node.children[0]), number(node.value))
            case "call" if node.name in _FUNCTIONS:
                return op(_FUNCTIONS[node.name], of(node.children[0]))
            case "call":
                return _CALLS[node.name](lambda: of(node.children[0]))
        gathered, parted, nothing = ("sum", "difference", 0.0) if node.kind == "sum" else ("product", "quotient", 1.0)
        first = [of(n) for s, n in zip(node.signs, node.children) if s > 0] or [number(nothing)]
        then = [of(n) for s, n in zip(node.signs, node.children) if s < 0]
        above = joined(gathered, first)
        return op(parted, above, joined(gathered, then)) if then else above


# --- functions that JSBSim does not have ----------------------------------------------------------------


def _tanh(argument: Callable[[], ET.Element]) -> ET.Element:
    held = op("min", op("max", argument(), number(-_SATURATED)), number(_SATURATED))
    below = op("sum", op("exp", op("product", number(2.0), held)), number(1.0))
    return op("difference", number(1.0), op("quotient", number(2.0), below))


def _sign(argument: Callable[[], ET.Element]) -> ET.Element:
    above, below = (op(kind, argument(), number(0.0)) for kind in ("gt", "lt"))
    return op("difference", above, below)


_CALLS: dict[str, Callable[[Callable[[], ET.Element]], ET.Element]] = {
    "tanh": _tanh,
    "sign": _sign,
    "step": lambda argument: op("ge", argument(), number(0.0)),
}
