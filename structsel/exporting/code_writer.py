"""Terms as text of a programming language: Python, C and Modelica differ in little."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from structsel.candidates import Factor, Term
from structsel.candidates.formula import Node
from structsel.exporting.header import term_notes
from structsel.model import ResponseModel


@dataclass(frozen=True)
class Dialect:
    """How one language writes what is not an operator.

    Attributes
    ----------
    calls : mapping of function to str
        Pattern of each of `structsel.candidates.formula.FUNCTIONS`, its argument at ``{}``, and of ``plus``.
    power : str
        Pattern of base and exponent.
    reserved : frozenset of str
        Words that cannot name an input.
    """

    calls: Mapping[str, str]
    power: str
    reserved: frozenset[str]


def plain(name: str) -> str:
    """A name in the letters that every language takes."""
    made = re.sub(r"\W", "_", name, flags=re.ASCII)
    return made if made[:1].isalpha() else f"n{made}"


class Identifiers:
    """Names as a language takes them, each another one."""

    def __init__(self, dialect: Dialect):
        self._taken = set(dialect.reserved)

    def add(self, name: str) -> str:
        """The name, with what a language does not take replaced, and underscores where it is taken."""
        made = plain(name)
        while made in self._taken:
            made += "_"
        self._taken.add(made)
        return made


@dataclass
class Code:
    """Collects the code of a model's responses; each factor that is more than a channel is computed once.

    Attributes
    ----------
    dialect : Dialect
    identifiers : Identifiers
    channels : mapping of channel to identifier or other access to it
    locals : dict of identifier to code
        Of the factors, in the order in which they were needed.
    used : set of str
        Functions called.
    """

    dialect: Dialect
    identifiers: Identifiers
    channels: Mapping[str, str]
    locals: dict[str, str] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)
    _factors: dict[Factor, str] = field(default_factory=dict)

    def add_lines(self, response: ResponseModel) -> list[tuple[str, str]]:
        """A response as a sum: per term a line that begins with its sign, and what to note of it."""
        lines = []
        for term, value in zip(response.terms, response.values.tolist()):
            sign = "-" if value < 0 else "+"
            lines.append(f"{sign} {' * '.join([repr(abs(value)), *self._signals(term)])}")
        return list(zip(lines, term_notes(response))) or [("+ 0.0", "no terms")]

    def _signals(self, term: Term) -> Iterable[str]:
        for factor, power in term.factors:
            if factor.node.kind == "channel":
                name = self.channels[factor.node.name]
            elif factor in self._factors:
                name = self._factors[factor]
            else:
                name = self._factors[factor] = self.identifiers.add(f"factor_{len(self._factors) + 1}")
                self.locals[name] = self.node(factor.node)
            yield from [name] * power

    def node(self, node: Node) -> str:
        """Code of one formula."""
        match node.kind:
            case "number":
                return repr(node.value)
            case "channel":
                return self.channels[node.name]
            case "call" | "plus":
                function = node.name or node.kind
                self.used.add(function)
                return self.dialect.calls[function].format(self.node(node.children[0]))
            case "power":
                return self.dialect.power.format(self._bracketed(node.children[0]), repr(node.value))
        plus, minus = (" + ", " - ") if node.kind == "sum" else (" * ", " / ")
        parts = [(plus if s > 0 else minus) + self._bracketed(n) for s, n in zip(node.signs, node.children)]
        text = "".join(parts)
        if node.signs[0] > 0:
            return text.removeprefix(plus)
        return text.lstrip().replace("- ", "-", 1) if node.kind == "sum" else "1.0" + text

    def _bracketed(self, node: Node) -> str:
        text = self.node(node)
        return f"({text})" if node.kind in ("sum", "product") else text
