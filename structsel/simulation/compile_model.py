"""Compiles an AeroModel and its Aircraft for the simulation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from structsel.aircraft import Aircraft
from structsel.candidates import Term
from structsel.candidates.formula import Node, channels, to_text
from structsel.candidates.parse import parse_formula
from structsel.errors import ChannelError, ModelError
from structsel.model import AeroModel, State
from structsel.nomenclature import COEFFICIENTS, WIND_AXIS_COEFFICIENTS, suggest
from structsel.numerics.expressions import ProgramMaker
from structsel.numerics.flight_model import CHANNELS, OUTPUTS, AircraftArrays, CompiledAircraft, Memory, no_memory

_RATES = ("alpha_dot_hat", "beta_dot_hat", "alpha_dot", "beta_dot")
# What a flight makes but no coefficient may depend on: it would depend on itself.
_RESULTS = (*(set(OUTPUTS) - set(CHANNELS) - set(_RATES) - {"thrust", "mass"}), "CL", "CD")


class Formulas:
    """Channels that follow from others: the aircraft's dimensionless ones, and definitions of the user's.

    Parameters
    ----------
    aircraft : Aircraft
    definitions : mapping of channel to formula
        Such as ``{"dpt": "0.087 + 382.4*power/(rho*V^3)"}``; a definition may use others.
    """

    def __init__(self, aircraft: Aircraft, definitions: Mapping[str, str] | None = None):
        b, c, S = (f"{size!r}" for size in (aircraft.b, aircraft.cbar, aircraft.S))
        made = {
            "p_hat": f"p*{b}/(2*V)",
            "q_hat": f"q*{c}/(2*V)",
            "r_hat": f"r*{b}/(2*V)",
            "alpha_dot": f"alpha_dot_hat*2*V/{c}",
            "beta_dot": f"beta_dot_hat*2*V/{b}",
            "CT": f"thrust/(qbar*{S})",
        }
        if aircraft.V0 is not None:
            made["V_ratio"] = f"V/{aircraft.V0!r}"
        self.own = dict(definitions or {})
        for name in self.own:
            if name in CHANNELS:
                raise ModelError(f"'{name}' cannot be defined: the flight itself makes it.")
        self._nodes = {name: parse_formula(text) for name, text in {**made, **self.own}.items()}

    def __contains__(self, name: object) -> bool:
        return name in self._nodes

    def expand(self, node: Node, inside: tuple[str, ...] = ()) -> Node:
        """The node with every defined channel replaced by its formula.

        Raises
        ------
        ModelError
            Where definitions go in a circle.
        """
        if node.kind == "channel" and node.name in self._nodes:
            if node.name in inside:
                raise ModelError(f"The definitions go in a circle: {' -> '.join((*inside, node.name))}.")
            return self.expand(self._nodes[node.name], (*inside, node.name))
        return node.map(lambda child: self.expand(child, inside))

    def needs(self, names: Iterable[str]) -> tuple[str, ...]:
        """Channels that remain when these are expanded, sorted."""
        found = {leaf for name in names for leaf in channels(self.expand(Node("channel", name=name)))}
        return tuple(sorted(found))


def needed_inputs(model: AeroModel, formulas: Formulas) -> tuple[str, ...]:
    """Channels a flight of this model must be given, sorted; thrust only where a term or definition uses it.

    Raises
    ------
    ModelError
        A term depends on what the flight only makes from it, such as ``ax``.
    """
    wanted = [*model.channels, *(name for name in ("thrust",) if name in formulas)]
    leaves = formulas.needs(wanted)
    if wrong := [name for name in leaves if name in _RESULTS]:
        raise ModelError(
            f"A term of the model depends on '{wrong[0]}', which a flight makes from the coefficients and not the "
            "other way round. Leave the term out, or write it in states and controls."
        )
    return tuple(name for name in leaves if name not in CHANNELS)


def compile_aircraft(
    model: AeroModel,
    aircraft: Aircraft,
    formulas: Formulas,
    controls: tuple[str, ...],
    memory: Mapping[str, State] | None = None,
) -> CompiledAircraft:
    """An aircraft and its model as the compiled simulation takes them.

    Parameters
    ----------
    model : AeroModel
        Responses CX, CY, CZ, Cl, Cm, Cn, or CD and CL for CX and CZ; those it lacks are zero.
    aircraft : Aircraft
    formulas : Formulas
    controls : tuple of str
        Channels given at each sample, and the model's states; ``thrust`` among them, or defined, acts along the
        aircraft's thrust line.
    memory : mapping of name to State, optional
        States among the controls that the simulation integrates itself.

    Raises
    ------
    ModelError
        A response that is no coefficient, body and wind axes mixed, a term that is not linear in alpha_dot or
        beta_dot, or a state that cannot be integrated with the motion.
    ChannelError
        A term needs a channel that is neither a state, nor defined, nor a control.
    """
    rows = _rows_of(model)
    code = _Code(formulas, (*CHANNELS, *controls))
    names, slots, rates = [], [], []
    for response, terms in model.responses.items():
        for term in terms.terms:
            names.append(f"{response}:{term}")
            rates.append(_rate_of(term, formulas, response))
            slots.append(code.term(term))
    thrust = code.channel("thrust") if "thrust" in formulas or "thrust" in controls else -1
    arrays = AircraftArrays(
        program=code.maker.done(),
        term_slot=np.array(slots, dtype=np.int64),
        term_response=np.array([rows[name.split(":")[0]] for name in names], dtype=np.int64),
        term_rate=np.array(rates, dtype=np.int64),
        implicit=any(rates),
        thrust_slot=thrust,
        wind_axes="CD" in rows,
        S=float(aircraft.S),
        b=float(aircraft.b),
        cbar=float(aircraft.cbar),
        thrust_direction=aircraft.thrust.direction,
        thrust_arm=np.asarray(aircraft.thrust.arm, dtype=float),
        rotor_momentum=float(aircraft.engine.angular_momentum),
        memory=_compile_memory(memory or {}, formulas, controls),
    )
    values = np.concatenate([held.values for held in model.responses.values()])
    return CompiledAircraft(arrays, tuple(names), values, controls)


def _compile_memory(states: Mapping[str, State], formulas: Formulas, controls: tuple[str, ...]) -> Memory:
    """States that depend on the motion itself."""
    if not states:
        return no_memory(len(CHANNELS) + len(controls))
    for name, state in states.items():
        if not state.is_linear:
            raise ModelError(
                f"The state '{name}' is a {state.kind} of '{state.input}', which is simulated and not given; only "
                "lags, delays and separation can depend on the motion itself. Give the channel with the inputs."
            )
    code = _Code(formulas, (*CHANNELS, *controls))
    slots = [code.node(formulas.expand(state.input_formula), name) for name, state in states.items()]
    fraction = [state.fraction for state in states.values()]
    is_delay = [state.kind == "delay" for state in states.values()]
    # A value that passes part of its input on at once must be found together with what that input depends on.
    at_once = {*_RATES, *states}
    implicit = any(
        (delayed or f != 1.0) and at_once & {*state.channels, *formulas.needs(state.channels)}
        for state, delayed, f in zip(states.values(), is_delay, fraction)
    )
    return Memory(
        program=code.maker.done(),
        slot=np.array(slots, dtype=np.int64),
        control=np.array([controls.index(name) for name in states], dtype=np.int64),
        is_delay=np.array(is_delay),
        constant=np.array([state.time_constant for state in states.values()], dtype=float),
        by_distance=np.array([state.by_distance for state in states.values()]),
        fraction=np.array(fraction, dtype=float),
        implicit=bool(implicit),
    )


def _rows_of(model: AeroModel) -> dict[str, int]:
    given = tuple(model.responses)
    if unknown := [name for name in given if name not in (*COEFFICIENTS, *WIND_AXIS_COEFFICIENTS)]:
        raise ModelError(
            f"A flight needs the coefficients {', '.join(COEFFICIENTS)} (or CL and CD for CX and CZ); the model has "
            f"'{unknown[0]}'.{suggest(unknown[0], COEFFICIENTS)}"
        )
    wind = has_wind_axes(model)
    order = WIND_AXIS_COEFFICIENTS if wind else COEFFICIENTS
    rows = {name: order.index(name) for name in given}
    return rows | ({"CD": 0} if wind else {})


def has_wind_axes(model: AeroModel) -> bool:
    """Whether a model has CL or CD; refuses one that has CX or CZ as well."""
    wind, body = [n for n in model if n in ("CL", "CD")], [n for n in model if n in ("CX", "CZ")]
    if wind and body:
        raise ModelError(f"The model mixes wind and body axes: {', '.join(wind + body)}. Keep one pair.")
    return bool(wind)


def _rate_of(term: Term, formulas: Formulas, response: str) -> int:
    """0, or 1 or 2 where the term carries alpha_dot or beta_dot, once and as it is."""
    carriers = []
    for factor, power in term.factors:
        rates = {name[: name.index("_dot")] for name in formulas.needs(factor.channels) if name in _RATES}
        carriers += [(factor.node, rates)] * (power if rates else 0)
    if not carriers:
        return 0
    node, rates = carriers[0]
    if len(carriers) > 1 or node.kind != "channel" or node.name not in _RATES:
        raise ModelError(
            f"{response}: the term '{term}' is not linear in alpha_dot or beta_dot, which a flight needs: the rate "
            "depends on the force it helps to make. Write the rate as one factor of its own."
        )
    return 1 if rates == {"alpha"} else 2


class _Code:
    """Trees to instructions."""

    def __init__(self, formulas: Formulas, inputs: tuple[str, ...]):
        self.formulas, self.inputs = formulas, inputs
        self.maker = ProgramMaker(len(inputs))

    def term(self, term: Term) -> int:
        slot = -1
        for factor, power in term.factors:
            one = self.node(self.formulas.expand(factor.node), str(term))
            for _ in range(power):
                slot = one if slot < 0 else self.maker.emit("multiply", slot, one)
        return self.maker.emit("number", value=1.0) if slot < 0 else slot

    def channel(self, name: str) -> int:
        return self.node(self.formulas.expand(Node("channel", name=name)), name)

    def node(self, node: Node, term: str) -> int:
        emit = self.maker.emit
        match node.kind:
            case "number":
                return emit("number", value=node.value)
            case "channel":
                if node.name not in self.inputs:
                    raise ChannelError(
                        f"Term '{term}' needs channel '{node.name}', which is no state of a flight and not among its "
                        f"inputs ({', '.join(self.inputs[len(CHANNELS) :]) or 'none'}).\nGive it with the inputs, "
                        "define it by a formula, or leave the term out."
                    )
                return self.inputs.index(node.name)
            case "plus":
                return emit("plus", self.node(node.children[0], term))
            case "call":
                return emit(node.name, self.node(node.children[0], term))
            case "power":
                return emit("power", self.node(node.children[0], term), value=node.value)
            case "sum" | "product":
                return self._chain(node, term)
        raise ModelError(
            f"Term '{term}' holds '{to_text(node)}' of kind '{node.kind}', which a flight cannot evaluate."
        )

    def _chain(self, node: Node, term: str) -> int:
        """A sum or product from left to right, as `formulas` evaluates it."""
        emit = self.maker.emit
        plus, minus = ("add", "subtract") if node.kind == "sum" else ("multiply", "divide")
        slot = -1
        for sign, child in zip(node.signs, node.children):
            here = self.node(child, term)
            if slot >= 0:
                slot = emit(plus if sign > 0 else minus, slot, here)
            elif sign > 0:
                slot = here
            elif node.kind == "sum":
                slot = emit("negate", here)
            else:
                slot = emit("divide", emit("number", value=1.0), here)
        return slot
