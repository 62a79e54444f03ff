"""Factors and terms: one evaluated signal, and a product of powers of such signals."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, total_ordering
from typing import Any

import numpy as np

from structsel.candidates import formula
from structsel.candidates.formula import Node
from structsel.candidates.parse import parse_with_form, raise_parse_error
from structsel.errors import TermError
from structsel.nomenclature import latex_of

_HIGHEST = 99
_RANK = {"channel": 0, "offset": 1, "spline": 2, "formula": 3}


@total_ordering
@dataclass(frozen=True)
class Factor:
    """One signal a term is built from.

    Parameters
    ----------
    node : Node
        What it evaluates. Made by `Factor.channel`, `Factor.offset`, `Factor.spline`, or by `Term.parse`.

    Notes
    -----
    Ordered by channel, then plain before offset before spline, then by the reference or knot; formulas
    by their text.
    """

    node: Node

    @classmethod
    def channel(cls, name: str) -> Factor:
        """Return a channel as it is."""
        return cls.offset(name, 0.0)

    @classmethod
    def offset(cls, name: str, reference: float) -> Factor:
        """Return ``name - reference``, in the channel's SI unit; prints as ``(alpha - 0.1)``."""
        return cls(formula.shifted(_named(name), _finite(reference, "reference")))

    @classmethod
    def spline(cls, name: str, knot: float) -> Factor:
        """Return max(0, name - knot); prints as ``(alpha - 0.2)+``.

        References
        ----------
        [TP1916], [KM16]: splines of degree m are powers m of it.
        """
        return cls(formula.plus(formula.shifted(_named(name), _finite(knot, "knot"))))

    @classmethod
    def step(cls, name: str, knot: float) -> Factor:
        """Return 1 where the channel is at or above the knot, else 0: the spline of degree zero."""
        return cls(formula.call("step", formula.shifted(_named(name), _finite(knot, "knot"))))

    @cached_property
    def _reading(self) -> tuple[str, str, float]:
        """Kind, channel and reference of the factor."""
        node, kind = self.node, "offset"
        if node.kind == "plus":
            node, kind = node.children[0], "spline"
        if node.kind == "channel":
            return ("channel" if kind == "offset" else kind), node.name, 0.0
        if node.kind == "sum" and [n.kind for n in node.children] == ["channel", "number"] and node.signs[0] > 0:
            return kind, node.children[0].name, -node.signs[1] * node.children[1].value
        return "formula", "", 0.0

    @property
    def kind(self) -> str:
        """``channel``, ``offset``, ``spline`` or ``formula``."""
        return self._reading[0]

    @property
    def reference(self) -> float:
        """Reference of an offset or knot of a spline, SI; zero for the others."""
        return self._reading[2]

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels it needs, sorted."""
        return formula.channels(self.node)

    @cached_property
    def _key(self) -> tuple[str, int, float, str]:
        kind, name, reference = self._reading
        return (name or self._text, _RANK[kind], reference, self._text)

    @cached_property
    def _text(self) -> str:
        return formula.to_text(self.node, 3)

    def __str__(self) -> str:
        return self._text

    def __repr__(self) -> str:
        return f"Factor({self._text!r})"

    def __lt__(self, other: object) -> bool:
        return self._key < other._key if isinstance(other, Factor) else NotImplemented

    def latex(self) -> str:
        """Return the factor in LaTeX."""
        text = formula.latex(self.node, latex_of)
        # V/V_0 squared is not V/V_0^2.
        loose = self.node.kind in ("sum", "product", "power") or (self.kind == "channel" and "/" in text)
        return rf"\left({text}\right)" if loose else text

    def evaluate(self, source: Any, needed_by: str | None = None) -> np.ndarray:
        """Values on a recording or mapping of arrays.

        Parameters
        ----------
        source : Recording or mapping of name to (n,) array [SI]
        needed_by : str, optional
            The term to name in an error; the factor itself by default.

        Returns
        -------
        (n,) float64 array

        Raises
        ------
        ChannelError
            The source lacks a channel.
        DataError
            A channel is not finite somewhere.
        TermError
            The formula is not finite somewhere; names the sample.
        """
        return formula.evaluate(self.node, source, needed_by or self._text)


@total_ordering
@dataclass(frozen=True, init=False, repr=False)
class Term:
    """A product of powers of factors: ``alpha``, ``alpha^2*de``, ``(alpha - 0.2)+*q_hat``.

    ``1`` is the constant. A value: equal and of equal hash whatever the order it was written in.

    Parameters
    ----------
    text : str, Factor or mapping of Factor to power
        Text is read as by `parse`.

    Raises
    ------
    TermError
        The text cannot be read; gives the position and what to write instead.

    Notes
    -----
    Terms are ordered by degree, then as the words their factors spell (alpha^2 is alpha, alpha), factors in
    their own order. Upper case comes before lower case.

    Examples
    --------
    >>> Term("alpha")**2 * Term("de") == Term.parse("de*alpha^2")
    True
    """

    factors: tuple[tuple[Factor, int], ...]

    def __init__(self, text: str | Factor | Mapping[Factor, int] = "1"):
        if isinstance(text, Factor):
            powers: Mapping[Factor, int] = {text: 1}
        elif isinstance(text, Mapping):
            powers = text
        else:
            powers = _read_term(text)
        kept = sorted((factor, int(power)) for factor, power in powers.items() if power)
        object.__setattr__(self, "factors", tuple(kept))
        if self.degree > _HIGHEST:
            raise TermError(f"Term '{self}' has degree {self.degree}; the highest is {_HIGHEST}. Lower the power.")

    @classmethod
    def parse(cls, text: str) -> Term:
        """Read a term from text; ``str`` of the result reads back to the same term.

        Channels, ``*``, ``^`` or ``**``, offsets ``(alpha - 0.1)``, splines ``(alpha - 0.2)+``, and
        formulas with abs, sign, sqrt, sin, cos, tan, exp, log, tanh and step (1 from zero up), such as
        ``abs(de)*de`` or ``tanh(10*(alpha - 0.2))``. A denominator becomes a factor ``(1/V)``.

        Raises
        ------
        TermError
            With the position and what to write instead.
        """
        return cls(text)

    @property
    def degree(self) -> int:
        """Sum of the powers; a formula or spline counts as one signal."""
        return sum(power for _, power in self.factors)

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels it needs, sorted."""
        return tuple(sorted({name for factor, _ in self.factors for name in factor.channels}))

    @property
    def is_constant(self) -> bool:
        """Whether the term is 1."""
        return not self.factors

    @cached_property
    def _key(self) -> tuple[int, tuple[Factor, ...]]:
        return (self.degree, tuple(factor for factor, power in self.factors for _ in range(power)))

    @cached_property
    def _text(self) -> str:
        return "*".join(f"{f}^{power}" if power > 1 else str(f) for f, power in self.factors) or "1"

    def __str__(self) -> str:
        return self._text

    def __repr__(self) -> str:
        return f"Term({self._text!r})"

    def __lt__(self, other: object) -> bool:
        return self._key < other._key if isinstance(other, Term) else NotImplemented

    def __mul__(self, other: Term) -> Term:
        if not isinstance(other, Term):
            return NotImplemented
        powers = dict(self.factors)
        for factor, power in other.factors:
            powers[factor] = powers.get(factor, 0) + power
        return Term(powers)

    def __pow__(self, power: int) -> Term:
        if not isinstance(power, int | np.integer) or power < 0:
            raise TermError(f"Term '{self}' to the power {power!r}: a term's power is 0, 1, 2, ...")
        return Term({factor: own * int(power) for factor, own in self.factors})

    def latex(self) -> str:
        """Return the term in LaTeX, symbols from the nomenclature."""
        return r" \, ".join(f"{f.latex()}^{{{m}}}" if m > 1 else f.latex() for f, m in self.factors) or "1"

    def replace(self, change: Callable[[Factor], Factor]) -> Term:
        """Return the term with every factor passed through ``change``."""
        powers: dict[Factor, int] = {}
        for factor, power in self.factors:
            factor = change(factor)
            powers[factor] = powers.get(factor, 0) + power
        return Term(powers)

    def evaluate(self, source: Any) -> np.ndarray:
        """Values on a recording or mapping of arrays.

        Parameters
        ----------
        source : Recording or mapping of name to (n,) array [SI]

        Returns
        -------
        (n,) float64 array

        Raises
        ------
        ChannelError, DataError, TermError
            As `Factor.evaluate`; the message names the term.
        """
        if self.is_constant:
            return np.ones(samples(source))
        return product([(factor.evaluate(source, self._text), power) for factor, power in self.factors])


def product(signals: Iterable[tuple[np.ndarray, int]]) -> np.ndarray:
    """Return the product of powers of signals, multiplied one by one in the order given.

    Everything that evaluates a term goes through here, so that values agree to the last bit.
    """
    values: np.ndarray | None = None
    for signal, power in signals:
        for _ in range(power):
            if values is None:
                values = np.array(signal, dtype=float)
            else:
                values *= signal
    assert values is not None
    return values


def samples(source: Any) -> int:
    """Return the number of samples of a recording or mapping of arrays."""
    return len(next(iter(source.values()), ())) if isinstance(source, Mapping) else len(source)


def _read_term(text: str) -> dict[Factor, int]:
    node, bare = parse_with_form(text)
    powers = _powers(node, text)
    if bare:
        remedy = f"Write two terms, or parentheses around it if one signal is meant: '({formula.to_text(node)})'."
        raise_parse_error(text, len(text) - len(text.lstrip()), "a sum is more than one term", remedy)
    return powers


def _powers(node: Node, text: str) -> dict[Factor, int]:
    """Split a product into its factors and their powers."""
    if node == Node("number", value=1.0):
        return {}
    if not formula.channels(node):
        remedy = "Its value is what the fit finds: leave it out ('1' is the constant)."
        raise_parse_error(text, node.at, f"{formula.to_text(node)} is only a number", remedy)
    if node.signs == (-1,) and node.kind == "sum":
        raise_parse_error(text, node.at, "a term has no sign of its own", "Leave it out: the fit finds it.")
    powers: dict[Factor, int] = {}
    if node.kind == "product":
        for sign, child in zip(node.signs, node.children):
            for factor, power in _powers(child, text).items():
                kept = factor if sign > 0 else Factor(formula.reciprocal(factor.node))
                powers[kept] = powers.get(kept, 0) + power
        return powers
    if node.kind == "power" and node.value == int(node.value):
        if node.value == 0:
            raise_parse_error(text, node.at, "a power of zero is the constant", "Write '1', or leave it out.")
        if abs(node.value) > _HIGHEST:
            raise_parse_error(text, node.at, f"the power is above {_HIGHEST}", "Lower it.")
        for factor, power in _powers(node.children[0], text).items():
            kept = factor if node.value > 0 else Factor(formula.reciprocal(factor.node))
            powers[kept] = powers.get(kept, 0) + power * abs(int(node.value))
        return powers
    return {Factor(node): 1}


def _named(name: str) -> str:
    if not isinstance(name, str) or not name.isidentifier():
        raise TermError(f"A factor needs a channel's name such as 'alpha'; found {name!r}.")
    return name


def _finite(value: float, what: str) -> float:
    if not np.isfinite(value):
        raise TermError(f"The {what} of a factor must be finite; found {value}.")
    return float(value)
