"""Parser of formulas: text to the tree in formula.py.

The text is read with `ast` and only the pieces named here are accepted; nothing is ever executed.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable
from typing import NoReturn

from structsel.candidates.formula import FUNCTIONS, Node, add, channel, multiply, number, plus
from structsel.errors import TermError

_LONGEST = 1000
_DEEPEST = 150
_REMEDY = "Use channel names, numbers, + - * / ^, parentheses and the functions " + ", ".join(FUNCTIONS) + "."


def raise_parse_error(text: str, at: int, found: str, remedy: str) -> NoReturn:
    """Raise the TermError of a text that cannot be read, pointing at the place."""
    where = f"\n  {text}\n  {' ' * at}^\n" if len(text) <= 100 else " "
    raise TermError(f"Term {text[:100]!r} cannot be read at position {at + 1}: {found}.{where}{remedy}")


def parse_formula(text: str) -> Node:
    """Read a formula, as `parse_with_form`.

    Raises
    ------
    TermError
        With the position (1-based) and what to write instead.
    """
    return parse_with_form(text)[0]


def parse_with_form(text: str) -> tuple[Node, bool]:
    """Read a formula, and return whether it is a sum without parentheses, which is more than one term.

    Parameters
    ----------
    text : str
        ``^`` and ``**`` both mean power; ``(...)+`` is the positive part.

    Returns
    -------
    node : Node
    bare : bool
        True where the whole is a sum without parentheses around it.

    Raises
    ------
    TermError
        With the position (1-based) and what to write instead.
    """
    if not isinstance(text, str):
        raise TermError(f"A term is text such as 'alpha*de'; found {text!r} of type {type(text).__name__}.")
    if len(text) > _LONGEST:
        raise_parse_error(text, _LONGEST, f"longer than {_LONGEST} characters", "Split it, or add it as a channel.")
    strange = re.search(r"[^\w\s.()+\-*/^,]", text)
    if strange:
        raise_parse_error(
            text,
            strange.start(),
            f"{strange.group()!r} means nothing here",
            _REMEDY,
        )
    if not text.strip():
        raise TermError("A term is empty. Write a channel such as 'alpha', or '1' for the constant.")
    python, places = _to_python(re.sub(r"\s", " ", text))
    try:
        tree = ast.parse(python, mode="eval").body
    except SyntaxError as error:
        # Offset 0 is Python's way of saying that the text ended too early.
        at = places[min((error.offset or len(places)) - 1, len(places) - 1)]
        found = "it ends too early" if at == len(text.rstrip()) else "this does not follow on"
        raise_parse_error(text, at, found, "Check for a missing factor, sign or parenthesis.")
    except (ValueError, RecursionError, MemoryError):
        raise_parse_error(text, 0, "too deeply nested", "Write it with fewer parentheses, or add it as a channel.")
    encoded = python.encode()

    def place(offset: int) -> int:
        return places[min(len(encoded[:offset].decode()), len(places) - 1)]

    # Parentheses around the whole are outside the node: then it does not begin at the first character.
    bare = isinstance(tree, ast.BinOp) and isinstance(tree.op, ast.Add | ast.Sub) and tree.col_offset == 0
    node = _convert(tree, text, place, 0)
    return node, bare and node.kind == "sum"


def _to_python(text: str) -> tuple[str, list[int]]:
    """Python's spelling of a formula, and for each of its characters the place in ours."""
    out: list[str] = []
    places: list[int] = []
    start = len(text) - len(text.lstrip())
    text = text.rstrip()
    for i in range(start, len(text)):
        piece = text[i]
        if piece == "^":
            piece = "**"
        elif piece == "+" and _is_positive_part(text, i):
            piece = "[0]"  # binds tighter than a power, as the mark of a spline must
        out.append(piece)
        places += [i] * len(piece)
    return "".join(out), [*places, len(text)]


def _is_positive_part(text: str, i: int) -> bool:
    before, after = text[:i].rstrip(), text[i + 1 :].lstrip()
    if not before.endswith(")"):
        return False
    if not after or after[0] in "*^/),":
        return True
    # "(a)+ - b" is a spline less b; "(a) + -b" is a sum.
    return after[0] in "+-" and text[i - 1] == ")" and text[i + 1] == " "


def _convert(tree: ast.expr, text: str, place: Callable[[int], int], depth: int) -> Node:
    at = place(tree.col_offset)
    if depth > _DEEPEST:
        raise_parse_error(text, at, "too deeply nested", "Write it with fewer parentheses, or add it as a channel.")

    def inner(child: ast.expr) -> Node:
        return _convert(child, text, place, depth + 1)

    match tree:
        case ast.Name(id=name):
            return channel(name, at)
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            return number(_finite(value, text, at), at)
        case ast.Subscript(value=child):
            return plus(inner(child))
        case ast.UnaryOp(op=ast.USub(), operand=child):
            return add([(-1, inner(child))], at)
        case ast.UnaryOp(op=ast.UAdd(), operand=child):
            return inner(child)
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() as op, right=right):
            return add([(1, inner(left)), (1 if isinstance(op, ast.Add) else -1, inner(right))], at)
        case ast.BinOp(left=left, op=ast.Mult() | ast.Div() as op, right=right):
            power = 1 if isinstance(op, ast.Mult) else -1
            # Python reads -x*y as (-x)*y; the sign belongs before the product, or -(a - b)*y turns into (b - a)*y.
            minus = left.operand if isinstance(left, ast.UnaryOp) and isinstance(left.op, ast.USub) else None
            product = multiply([(1, inner(minus or left)), (power, inner(right))], at)
            return add([(-1, product)], at) if minus else product
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            exponent = inner(right)
            sign, exponent = (-1, exponent.children[0]) if exponent.signs == (-1,) else (1, exponent)
            if exponent.kind != "number":
                raise_parse_error(text, place(right.col_offset), "a power is a number", "Write for instance alpha^2.")
            return Node("power", (inner(left),), value=sign * exponent.value, at=at)
        case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in FUNCTIONS:
            if isinstance(argument, ast.Starred):
                raise_parse_error(text, at, f"{name} takes one argument", f"Write for instance {name}(alpha).")
            return Node("call", (inner(argument),), name=name, at=at)
        case ast.Call(func=ast.Name(id=name)) if name in FUNCTIONS:
            raise_parse_error(text, at, f"{name} takes one argument", f"Write for instance {name}(alpha).")
        case ast.Call():
            found = ast.unparse(tree.func)
            known = ", ".join(FUNCTIONS)
            raise_parse_error(
                text, at, f"{found!r} is not a function known here", f"Use * to multiply, or one of: {known}."
            )
    kind = type(tree.op).__name__ if isinstance(tree, ast.BinOp | ast.UnaryOp) else type(tree).__name__
    raise_parse_error(text, at, f"{kind} cannot be used", _REMEDY)


def _finite(value: float, text: str, at: int) -> float:
    try:
        value = float(value)
    except OverflowError:
        value = math.inf
    if not math.isfinite(value):
        raise_parse_error(text, at, "the number is too large", "Write one that fits in double precision.")
    return value
