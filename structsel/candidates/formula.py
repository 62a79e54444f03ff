"""Formulas as small trees: their text, their LaTeX and their values on a recording.

Trees are canonical: sums and products are flattened and sorted, so ``b + a`` and ``a + b`` are equal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from structsel import nomenclature
from structsel.errors import ChannelError, DataError, TermError

FUNCTIONS: dict[str, Callable[..., Any]] = {
    "abs": np.abs,
    "sign": np.sign,
    "sqrt": np.sqrt,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "exp": np.exp,
    "log": np.log,
    "tanh": np.tanh,
    # 1 from the knot up: Klein's spline of degree zero.
    "step": lambda x: np.where(x >= 0.0, 1.0, 0.0),
}


@dataclass(frozen=True)
class Node:
    """One piece of a formula.

    ``kind`` is ``number``, ``channel``, ``sum``, ``product``, ``power``, ``call`` or ``plus`` (the positive
    part). ``signs`` are +1 or -1 for each child: added or subtracted, multiplied or divided.
    """

    kind: str
    children: tuple[Node, ...] = ()
    signs: tuple[int, ...] = ()
    name: str = ""
    value: float = 0.0
    at: int = field(default=0, compare=False)

    def map(self, change: Callable[[Node], Node]) -> Node:
        """Return the node with `change` applied to its children, in their order."""
        return Node(self.kind, tuple(map(change, self.children)), self.signs, self.name, self.value, self.at)


def number(value: float, at: int = 0) -> Node:
    """Return a number, negative ones as a subtraction from nothing."""
    node = Node("number", value=abs(float(value)), at=at)
    return add([(-1, node)], at) if value < 0 else node


def channel(name: str, at: int = 0) -> Node:
    """Return a channel's node."""
    return Node("channel", name=name, at=at)


def shifted(name: str, reference: float) -> Node:
    """Return ``name - reference``; the channel itself where the reference is zero."""
    if reference == 0:
        return channel(name)
    return add([(1, channel(name)), (-1, number(reference))], 0)


def plus(node: Node) -> Node:
    """Return the positive part, max(0, node)."""
    return Node("plus", (node,), at=node.at)


def call(function: str, node: Node) -> Node:
    """Return a function of a node."""
    return Node("call", (node,), name=function, at=node.at)


def reciprocal(node: Node) -> Node:
    """Return 1 over a node."""
    return multiply([(-1, node)], node.at)


def add(items: Iterable[tuple[int, Node]], at: int = 0) -> Node:
    """Return the sum of nodes, each with its sign, flat and sorted."""
    flat: list[tuple[int, Node]] = []
    for sign, item in items:
        if item.kind == "sum":
            flat += [(sign * s, child) for s, child in zip(item.signs, item.children)]
        else:
            flat.append((sign, item))
    flat = [pair for pair in flat if pair[1] != Node("number")] or flat[:1]  # a zero changes nothing
    # Added before subtracted, channels before numbers, so "alpha - 0.2" and "0.2 - alpha" read as written.
    flat.sort(key=lambda pair: (pair[0] < 0, pair[1].kind == "number", to_text(pair[1])))
    if len(flat) == 1 and flat[0][0] > 0:
        return flat[0][1]
    return Node("sum", tuple(n for _, n in flat), tuple(s for s, _ in flat), at=at)


def multiply(items: Iterable[tuple[int, Node]], at: int = 0) -> Node:
    """Return the product of nodes, each multiplied (+1) or divided (-1), flat and sorted."""
    flat: list[tuple[int, Node]] = []
    sign = 1
    for power, item in items:
        if item.kind == "sum" and set(item.signs) == {-1}:  # the sign goes before the product
            sign, item = -sign, add(((1, child) for child in item.children), item.at)
        if item.kind == "product":
            flat += [(power * s, child) for s, child in zip(item.signs, item.children)]
        else:
            flat.append((power, item))
    flat.sort(key=lambda pair: (pair[0] < 0, pair[1].kind != "number", to_text(pair[1])))
    if len(flat) > 1:  # a factor of one changes nothing
        flat = [p for p in flat if not (p[1].kind == "number" and p[1].value == 1.0)] or flat[:1]
    if len(flat) == 1 and (flat[0][0] > 0 or flat[0][1] == Node("number", value=1.0)):
        node = flat[0][1]
    else:
        node = Node("product", tuple(n for _, n in flat), tuple(s for s, _ in flat), at=at)
    return node if sign > 0 else add([(-1, node)], at)


# --- writing ---------------------------------------------------------------------------------------

_STRENGTH = {"sum": 1, "product": 2, "power": 3}


def shortest_number(value: float) -> str:
    """Return the shortest text of a number that reads back to the same double."""
    return repr(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))


def to_text(node: Node, inside: int = 0) -> str:
    """Return a node's text, in parentheses where what it stands inside binds as strongly or more."""
    match node.kind:
        case "number":
            return shortest_number(node.value)
        case "channel":
            return node.name
        case "call":
            return f"{node.name}({to_text(node.children[0])})"
        case "plus":
            return f"({to_text(node.children[0])})+"
        case "sum":
            text = " ".join(f"{'-' if s < 0 else '+'} {to_text(n, 1)}" for s, n in zip(node.signs, node.children))
            text = text[2:] if text[0] == "+" else "-" + text[2:]
        case "product":
            above = [to_text(n, 2) for s, n in zip(node.signs, node.children) if s > 0]
            below = [to_text(n, 2) for s, n in zip(node.signs, node.children) if s < 0]
            text = "/".join(["*".join(above) or "1", *below])
        case _:
            exponent = shortest_number(node.value)
            text = f"{to_text(node.children[0], 3)}^{exponent}"
    return f"({text})" if inside >= _STRENGTH[node.kind] else text


def latex(node: Node, symbol: Callable[[str], str]) -> str:
    r"""Return a node in LaTeX; ``symbol`` gives a channel's."""
    match node.kind:
        case "number":
            return shortest_number(node.value)
        case "channel":
            return symbol(node.name)
        case "call":
            return _latex_call(node.name, latex(node.children[0], symbol))
        case "plus":
            return rf"\left({latex(node.children[0], symbol)}\right)_+"
        case "sum":
            signs = ["-" if s < 0 else "+" for s in node.signs]
            parts = [f"{s} {_bracket(n, 1, symbol)}" for s, n in zip(signs, node.children)]
            return " ".join(parts).removeprefix("+ ")
        case "product":
            above = r" \, ".join(_bracket(n, 2, symbol) for s, n in zip(node.signs, node.children) if s > 0) or "1"
            below = r" \, ".join(_bracket(n, 2, symbol) for s, n in zip(node.signs, node.children) if s < 0)
            return rf"\frac{{{above}}}{{{below}}}" if below else above
        case _:
            return f"{_bracket(node.children[0], 3, symbol)}^{{{shortest_number(node.value)}}}"


def _bracket(node: Node, inside: int, symbol: Callable[[str], str]) -> str:
    text = latex(node, symbol)
    return rf"\left({text}\right)" if inside >= _STRENGTH.get(node.kind, 9) else text


def _latex_call(name: str, argument: str) -> str:
    if name == "abs":
        return rf"\left|{argument}\right|"
    if name == "sqrt":
        return rf"\sqrt{{{argument}}}"
    known = rf"\{name}" if name not in ("sign", "step") else rf"\operatorname{{{name}}}"
    return rf"{known}\left({argument}\right)"


def substitute(node: Node, formulas: Mapping[str, Node]) -> Node:
    """Return a node with channels replaced by formulas, sums and products flat and sorted again."""
    if node.kind == "channel":
        return formulas.get(node.name, node)
    new = node.map(lambda child: substitute(child, formulas))
    if node.kind in ("sum", "product"):
        return (add if node.kind == "sum" else multiply)(zip(new.signs, new.children), node.at)
    return new


# --- values ----------------------------------------------------------------------------------------


def channels(node: Node) -> tuple[str, ...]:
    """Return the names of the channels a node needs, sorted."""
    if node.kind == "channel":
        return (node.name,)
    return tuple(sorted({name for child in node.children for name in channels(child)}))


def get_channel(source: Any, name: str, needed_by: str) -> np.ndarray:
    """Return one channel of a recording or mapping as float64.

    Raises
    ------
    ChannelError
        The source has no such channel; the message names the term that needs it.
    DataError
        The channel holds a value that is not finite; the message names the first sample.
    """
    whose = repr(source.name) if isinstance(getattr(source, "name", None), str) else "the source"
    if name not in source:
        has = list(map(str, source if isinstance(source, Mapping) else getattr(source, "names", ())))
        adds = nomenclature.find_channel(name).source if nomenclature.is_known(name) else ""
        verb, _, of = adds.partition(":")
        first = f"{verb}({of and repr(of)}) adds it" if adds else "Add the channel"
        commands = {"compute_coefficients": "Give --aircraft", "reconstruct": "Give --reconstruct"}
        raise ChannelError(
            f"Term {needed_by!r} needs channel {name!r}; {whose} has none.\n"
            f"It has: {', '.join(has) or 'nothing that could be listed'}.{nomenclature.suggest(name, has)}",
            remedy=f"{first}, or leave the term out: candidates.without({needed_by!r}).",
            cli_remedy=f"{commands.get(verb, 'Add the channel')}, or leave the term out of --candidates and --terms.",
        )
    values = np.asarray(source[name], dtype=float)
    finite = np.isfinite(values)
    if not finite.all():
        raise DataError(
            f"Term {needed_by!r} needs channel {name!r}; {whose} holds {values[~finite][0]} at sample "
            f"{int(np.argmin(finite))} ({int(np.sum(~finite))} such in all). "
            "Remove that interval, or repair the channel."
        )
    return values


def evaluate(node: Node, source: Any, needed_by: str) -> np.ndarray:
    """Return a node's values on a recording or mapping of arrays.

    Raises
    ------
    ChannelError, DataError
        As `get_channel`.
    TermError
        A value is not finite (the logarithm of a negative number, ...); names the term and the first sample.
    """
    arrays = {name: get_channel(source, name, needed_by) for name in channels(node)}
    with np.errstate(all="ignore"):
        values = np.asarray(_values(node, arrays), dtype=float)
    finite = np.isfinite(values)
    if not finite.all():
        i = int(np.argmin(finite))
        at = ", ".join(f"{name} = {float(a.flat[i]):.6g}" for name, a in arrays.items())
        raise TermError(
            f"Term {needed_by!r} is {float(values.flat[i])} at sample {i}, where {at} "
            f"({int(np.sum(~finite))} such in all). {to_text(node)!r} does not hold there: "
            "keep to samples where it does, or leave the term out."
        )
    return values


def _values(node: Node, arrays: Mapping[str, np.ndarray]) -> Any:
    match node.kind:
        case "number":
            return node.value
        case "channel":
            return arrays[node.name]
        case "call":
            return FUNCTIONS[node.name](_values(node.children[0], arrays))
        case "plus":
            return np.maximum(_values(node.children[0], arrays), 0.0)
        case "power":
            return np.power(_values(node.children[0], arrays), node.value)
    total: Any = None
    for sign, child in zip(node.signs, node.children):
        value = _values(child, arrays)
        if node.kind == "sum":
            total = sign * value if total is None else (total + value if sign > 0 else total - value)
        elif total is None:
            total = value if sign > 0 else np.divide(1.0, value)
        else:
            total = total * value if sign > 0 else np.divide(total, value)
    return total
