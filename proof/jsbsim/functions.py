"""The aerodynamic functions of a JSBSim aircraft, read from its XML and evaluated over whole flights at once.

JSBSim simulates the truth; a simulation with other functions is evaluated along that flight as arrays. A function
is a small tree of `Value`, `Property`, `Table` and `Operation`; trees are values, and a changed one is made by
`replace`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

import numpy as np

from structsel.errors import SimulationError

AXES = ("LIFT", "DRAG", "SIDE", "ROLL", "PITCH", "YAW")
H_B = "aero/h_b-mac-ft"
CL_SQUARED = "aero/cl-squared"
_OPERATIONS: dict[str, Callable[..., Any]] = {
    "product": lambda *a: _reduce(np.multiply, a),
    "sum": lambda *a: _reduce(np.add, a),
    "difference": lambda *a: _reduce(np.subtract, a),
    "quotient": np.divide,
    "abs": np.abs,
    "atan2": np.arctan2,
    "pow": np.power,
    "sin": np.sin,
    "cos": np.cos,
    "max": lambda *a: _reduce(np.maximum, a),
    "min": lambda *a: _reduce(np.minimum, a),
}


@dataclass(frozen=True)
class Value:
    """A constant."""

    value: float


@dataclass(frozen=True)
class Property:
    """A property of JSBSim; negative where the XML says ``-name``."""

    name: str
    sign: float = 1.0


@dataclass(frozen=True, eq=False)
class Table:
    """Linear interpolation in one to three properties, held at the ends.

    ``axes`` are breakpoints, ``data`` has one dimension per property: row, column, table.
    """

    inputs: tuple[Node, ...]
    axes: tuple[np.ndarray, ...]
    data: np.ndarray


@dataclass(frozen=True)
class Operation:
    """One of JSBSim's functions of other nodes."""

    kind: str
    of: tuple[Node, ...]


Node = Value | Property | Table | Operation


@dataclass(frozen=True, eq=False)
class AeroFunction:
    """One named function: of an axis, or free (``axis`` is empty) and read by others."""

    name: str
    axis: str
    node: Node

    def reads(self) -> frozenset[str]:
        """Properties that it reads itself."""
        return frozenset(n.name for n in walk(self.node) if isinstance(n, Property))


def walk(node: Node) -> Iterator[Node]:
    """The node and all below it."""
    yield node
    below = node.of if isinstance(node, Operation) else node.inputs if isinstance(node, Table) else ()
    for child in below:
        yield from walk(child)


def replace(node: Node, change: Callable[[Node], Node | None]) -> Node:
    """The tree with each node for which `change` gives another one replaced, from the top."""
    if (other := change(node)) is not None:
        return other
    if isinstance(node, Operation):
        return Operation(node.kind, tuple(replace(child, change) for child in node.of))
    if isinstance(node, Table):
        return Table(tuple(replace(child, change) for child in node.inputs), node.axes, node.data)
    return node


def folded(node: Node) -> Node:
    """The same tree with tables that are looked up at constants reduced by those inputs."""

    def change(node: Node) -> Node | None:
        if not isinstance(node, Table):
            return None
        fixed = [k for k, child in enumerate(node.inputs) if isinstance(child, Value)]
        if not fixed:
            return None
        data, axes, inputs = node.data, list(node.axes), list(node.inputs)
        for k in reversed(fixed):
            at = cast(Value, inputs.pop(k)).value
            x = axes.pop(k)
            cell = int(np.clip(np.searchsorted(x, at, side="right") - 1, 0, max(len(x) - 2, 0)))
            function = float(np.clip((at - x[cell]) / (x[cell + 1] - x[cell]), 0.0, 1.0)) if len(x) > 1 else 0.0
            low, high = np.take(data, cell, axis=k), np.take(data, min(cell + 1, len(x) - 1), axis=k)
            data = low + function * (high - low)
        return Table(tuple(inputs), tuple(axes), data) if inputs else Value(float(data))

    return replace(node, change)


def scaled(node: Node, factor: float) -> Node:
    """The node times a constant."""
    return node if factor == 1.0 else Operation("product", (Value(factor), node))


def blended(node: Node, other: Node, fraction: float) -> Node:
    """`fraction` of the node and the rest of the other."""
    return Operation("sum", (scaled(node, fraction), scaled(other, 1.0 - fraction)))


def evaluate(node: Node, values: Mapping[str, Any]) -> Any:
    """Value of a tree.

    Parameters
    ----------
    node : Node
    values : mapping of property to (n,) array or float

    Raises
    ------
    KeyError
        A property that `values` lacks.
    """
    if isinstance(node, Value):
        return node.value
    if isinstance(node, Property):
        return node.sign * values[node.name]
    if isinstance(node, Operation):
        return _OPERATIONS[node.kind](*(evaluate(child, values) for child in node.of))
    return _look_up([evaluate(child, values) for child in node.inputs], node.axes, node.data)


def to_xml(node: Node) -> ET.Element:
    """The tree as JSBSim reads it."""
    if isinstance(node, Value):
        element = ET.Element("value")
        element.text = repr(node.value)
    elif isinstance(node, Property):
        element = ET.Element("property")
        element.text = ("-" if node.sign < 0 else "") + node.name
    elif isinstance(node, Operation):
        element = ET.Element(node.kind)
        element.extend([to_xml(child) for child in node.of])
    else:
        element = ET.Element("table")
        for child, lookup in zip(node.inputs, ("row", "column", "table")):
            if not isinstance(child, Property):
                raise SimulationError("JSBSim's tables are looked up in properties only.")
            ET.SubElement(element, "independentVar", lookup=lookup).text = child.name
        _write_data(element, node)
    return element


@lru_cache(maxsize=64)
def read_functions(path: Path) -> tuple[AeroFunction, ...]:
    """Aerodynamic functions of an aircraft's XML, in the order in which JSBSim evaluates them.

    Raises
    ------
    SimulationError
        An axis, a function or a table of a kind that is not known here.
    """
    section = ET.parse(path).getroot().find("aerodynamics")
    if section is None:
        raise SimulationError(f"'{path}' has no aerodynamics.")
    found: list[AeroFunction] = []
    for child in section:
        if child.tag == "function":
            found.append(_read_part(child, ""))
        elif child.tag == "axis":
            if child.get("name") not in AXES:
                raise SimulationError(f"'{path}' has an axis '{child.get('name')}'; known are {', '.join(AXES)}.")
            # Functions within an axis that nobody adds up are free too, but no aircraft here has them.
            found += [_read_part(function, str(child.get("name"))) for function in child.findall("function")]
    return tuple(found)


# --- reading and looking up ----------------------------------------------------------------------------


def _read_part(element: ET.Element, axis: str) -> AeroFunction:
    inside = [child for child in element if child.tag != "description"]
    return AeroFunction(str(element.get("name")), axis, _read_node(inside[0]))


def _read_node(element: ET.Element) -> Node:
    text = (element.text or "").strip()
    if element.tag in ("value", "v"):
        return Value(float(text))
    if element.tag in ("property", "p"):
        return Property(text.lstrip("-"), -1.0 if text.startswith("-") else 1.0)
    if element.tag in ("table", "t"):
        return _read_table(element)
    if element.tag in _OPERATIONS:
        return Operation(element.tag, tuple(_read_node(child) for child in element if child.tag != "description"))
    raise SimulationError(f"JSBSim's function '{element.tag}' is not known here.")


def _read_table(element: ET.Element) -> Table:
    places = {"row": 0, "column": 1, "table": 2}
    variables = element.findall("independentVar")
    ordered: dict[int, Node] = {}
    for k, variable in enumerate(variables):
        ordered[places[variable.get("lookup", ("row", "column", "table")[k])]] = Property((variable.text or "").strip())
    inputs = tuple(ordered[k] for k in sorted(ordered))
    sheets = element.findall("tableData")
    if len(inputs) == 1:
        rows = _numbers(sheets[0])
        return Table(inputs, (np.array([r[0] for r in rows]),), np.array([r[1] for r in rows]))
    made = [_read_sheet(sheet) for sheet in sheets]
    rows_at, columns_at, _ = made[0]
    if len(inputs) == 2:
        return Table(inputs, (rows_at, columns_at), made[0][2])
    if any(not (np.array_equal(r, rows_at) and np.array_equal(c, columns_at)) for r, c, _ in made):
        raise SimulationError("A table of three inputs whose sheets have breakpoints of their own is not known here.")
    breaks = np.array([float(sheet.get("breakPoint", "0")) for sheet in sheets])
    return Table(inputs, (rows_at, columns_at, breaks), np.stack([data for _, _, data in made], axis=-1))


def _read_sheet(sheet: ET.Element) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rows = _numbers(sheet)
    return np.array([r[0] for r in rows[1:]]), np.array(rows[0]), np.array([r[1:] for r in rows[1:]])


def _numbers(sheet: ET.Element) -> list[list[float]]:
    return [[float(x) for x in line.split()] for line in (sheet.text or "").splitlines() if line.split()]


def _write_data(element: ET.Element, table: Table) -> None:
    sheets = [table.data] if table.data.ndim < 3 else [table.data[..., k] for k in range(table.data.shape[2])]
    for k, data in enumerate(sheets):
        sheet = ET.SubElement(element, "tableData")
        if table.data.ndim == 3:
            sheet.set("breakPoint", repr(float(table.axes[2][k])))
        if data.ndim == 1:
            lines = [f"{x!r} {y!r}" for x, y in zip(table.axes[0].tolist(), data.tolist())]
        else:
            lines = [" ".join(map(repr, table.axes[1].tolist()))]
            lines += [" ".join(map(repr, [x, *row])) for x, row in zip(table.axes[0].tolist(), data.tolist())]
        sheet.text = "\n" + "\n".join(lines) + "\n"


def _reduce(operation: Callable[..., Any], values: tuple[Any, ...]) -> Any:
    made = values[0]
    for value in values[1:]:
        made = operation(made, value)
    return made


def _look_up(at: list[Any], axes: tuple[np.ndarray, ...], data: np.ndarray) -> Any:
    if len(axes) == 1:
        return np.interp(at[0], axes[0], data)
    total: Any = 0.0
    cells = []
    for x, breaks in zip(at, axes):
        if len(breaks) == 1:
            cells.append((np.zeros(np.shape(x), dtype=int), np.zeros(np.shape(x))))
            continue
        cell = np.clip(np.searchsorted(breaks, x, side="right") - 1, 0, len(breaks) - 2)
        function = np.clip((x - breaks[cell]) / (breaks[cell + 1] - breaks[cell]), 0.0, 1.0)
        cells.append((cell, function))
    for corner in range(2 ** len(axes)):
        weight: Any = 1.0
        index = []
        for k, (cell, function) in enumerate(cells):
            up = corner >> k & 1
            weight = weight * (function if up else 1.0 - function)
            index.append(np.minimum(cell + up, data.shape[k] - 1))
        total = total + weight * data[tuple(index)]
    return total
