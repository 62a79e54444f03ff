"""Candidates: the ordered pool of terms a selection chooses from."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from itertools import combinations_with_replacement
from typing import Any, overload

import numpy as np

from structsel.candidates.terms import Factor, Term, product, samples
from structsel.errors import TermError
from structsel.formatting import count_of
from structsel.results import Result
from structsel.tables import Column, Summary, Table, text_column

_LARGEST = 100_000


@dataclass(frozen=True, init=False, repr=False, eq=False)
class Candidates(Result):
    """An immutable pool of terms without duplicates, in the order given.

    `polynomial` and `splines` order their terms by degree and then as `Term` orders; a sum of pools has the terms of
    the first before the new ones of the second. ``select(method="orthogonal", order="given")`` orthogonalises in this
    order. Like dicts, pools of the same terms are equal whatever their order. The constant is always implied and never
    listed: ``"1"`` is accepted and adds nothing.

    Parameters
    ----------
    terms : iterable of Term or str

    Examples
    --------
    >>> pool = Candidates.polynomial(["alpha", "de"], 2) + Candidates.splines("alpha", [0.2])
    >>> pool.names
    ['alpha', 'de', 'alpha^2', 'alpha*de', 'de^2', '(alpha - 0.2)+']
    """

    terms: tuple[Term, ...]

    def __init__(self, terms: Iterable[Term | str] = ()):
        if isinstance(terms, str):
            raise TermError(f"Candidates takes a list of terms; found the text {terms!r}. Write [{terms!r}].")
        unique = dict.fromkeys(term for term in map(_as_term, terms) if not term.is_constant)
        object.__setattr__(self, "terms", tuple(unique))

    @classmethod
    def parse(cls, texts: Iterable[str]) -> Candidates:
        """Read a pool from texts, each as `Term.parse` reads it.

        Raises
        ------
        TermError
            A text cannot be read; gives the position and what to write instead.
        """
        return cls(texts)

    @classmethod
    def polynomial(
        cls,
        channels: Iterable[str],
        degree: int,
        *,
        interactions: bool | int = True,
        max_power: int | None = None,
    ) -> Candidates:
        """Every monomial up to a degree.

        Parameters
        ----------
        channels : iterable of str
            Channels, or anything that stands as one factor: ``"(alpha - 0.1)"``, ``"abs(de)"``.
        degree : int
            Highest total degree, one or more.
        interactions : bool or int
            Products of different channels: True up to ``degree``, False none, a whole number up to that
            total degree.
        max_power : int, optional
            Highest power of any one channel.

        Returns
        -------
        Candidates

        Raises
        ------
        TermError
            A degree below one, a channel that is not one factor, or more than 100 000 terms.
        """
        if isinstance(channels, str):
            raise TermError(f"polynomial() takes a list of channels; found the text {channels!r}.")
        factors = sorted({_as_factor(name) for name in channels})
        _check_integer("degree", degree, 1)
        if max_power is not None:
            _check_integer("max_power", max_power, 1)
        if interactions is True:
            cross = degree
        elif interactions is False:
            cross = 1
        else:
            _check_integer("interactions", interactions, 0)
            cross = min(interactions, degree)
        if (count := math.comb(len(factors) + cross, cross)) > _LARGEST:
            raise TermError(
                f"polynomial() of {len(factors)} channels to degree {cross} would hold {count} terms; "
                f"the most is {_LARGEST}. Lower the degree, or interactions."
            )
        highest = degree if max_power is None else min(max_power, degree)
        terms = [Term({factor: power}) for factor in factors for power in range(1, highest + 1)]
        for total in range(2, cross + 1):
            for word in combinations_with_replacement(factors, total):
                powers: dict[Factor, int] = {}
                for factor in word:
                    powers[factor] = powers.get(factor, 0) + 1
                if max(powers.values()) <= highest:
                    terms.append(Term(powers))
        return cls(sorted(terms))

    @classmethod
    def splines(
        cls, channel: str, knots: Iterable[float], degree: int = 1, times: Iterable[str | Term] = ()
    ) -> Candidates:
        """Klein's spline terms: (channel - knot)+^degree at every knot, and their products.

        Parameters
        ----------
        channel : str
        knots : iterable of float [the channel's SI unit]
        degree : int
            0 is a step from 0 to 1 at the knot, 1 a change of slope, 2 of curvature.
        times : iterable of Term or str
            Each spline also enters multiplied by each of these.

        Returns
        -------
        Candidates

        References
        ----------
        [TP1916], [KM16]
        """
        _check_integer("degree", degree, 0)
        if isinstance(times, str):
            raise TermError(f"splines() takes a list of terms in times; found the text {times!r}.")
        others = [Term(), *map(_as_term, times)]
        if degree == 0:
            own = [Term(Factor.step(channel, knot)) for knot in knots]
        else:
            own = [Term({Factor.spline(channel, knot): degree}) for knot in knots]
        return cls(sorted(spline * other for spline in own for other in others))

    def __add__(self, other: Candidates | Term | str) -> Candidates:
        """Return the union, without duplicates."""
        if isinstance(other, Candidates):
            return Candidates(self.terms + other.terms)
        if isinstance(other, Term | str):
            return Candidates([*self.terms, other])
        return NotImplemented

    def without(self, *which: str | Term | Callable[[Term], bool]) -> Candidates:
        """Return the pool less some terms.

        Parameters
        ----------
        *which : str, Term or function of a Term
            A function says True for the terms to leave out.

        Raises
        ------
        TermError
            A named term is not in the pool; the message lists the nearest.
        """
        gone: set[Term] = set()
        for item in which:
            if not isinstance(item, str | Term):
                gone |= {term for term in self.terms if item(term)}
            elif (term := _as_term(item)) in self:
                gone.add(term)
            else:
                near = get_close_matches(str(term), self.names, n=4) or self.names[:8]
                raise TermError(
                    f"without() was given {str(item)!r}, which is not among the {len(self)} candidates. "
                    f"Nearest: {', '.join(near) or 'none, the pool is empty'}."
                )
        return Candidates(term for term in self.terms if term not in gone)

    def about(self, **references: float) -> Candidates:
        """Return the pool with channels replaced by their offset from a reference: alpha by (alpha - 0.1).

        Parameters
        ----------
        **references : float [the channel's SI unit]
            Splines, formulas and factors that have an offset already keep as they are.

        Raises
        ------
        TermError
            No term holds the channel itself.
        """
        have = {str(factor) for factor in self.base if factor.kind == "channel"}
        if absent := sorted(set(references) - have):
            raise TermError(
                f"about() was given {', '.join(absent)}, which no candidate holds as a plain channel. "
                f"Plain channels: {', '.join(sorted(have)) or 'none'}."
            )
        moved = {Factor.channel(name): Factor.offset(name, value) for name, value in references.items()}
        return Candidates(term.replace(lambda factor: moved.get(factor, factor)) for term in self.terms)

    def __eq__(self, other: object) -> bool:
        return set(self.terms) == set(other.terms) if isinstance(other, Candidates) else NotImplemented

    def __hash__(self) -> int:
        return hash(frozenset(self.terms))

    def __len__(self) -> int:
        return len(self.terms)

    def __iter__(self) -> Iterator[Term]:
        return iter(self.terms)

    def __contains__(self, item: object) -> bool:
        return (_as_term(item) if isinstance(item, str) else item) in self._places

    @overload
    def __getitem__(self, i: int) -> Term: ...
    @overload
    def __getitem__(self, i: slice) -> Candidates: ...
    def __getitem__(self, i: int | slice) -> Term | Candidates:
        return Candidates(self.terms[i]) if isinstance(i, slice) else self.terms[i]

    def index(self, term: Term | str) -> int:
        """Place of a term in the pool.

        Raises
        ------
        TermError
            The term is not in the pool.
        """
        wanted = _as_term(term)
        if wanted not in self._places:
            raise TermError(f"Term '{wanted}' is not among the {len(self)} candidates: {self}.")
        return self._places[wanted]

    @cached_property
    def _places(self) -> dict[Term, int]:
        return {term: i for i, term in enumerate(self.terms)}

    @property
    def names(self) -> list[str]:
        """Texts of the terms, in order."""
        return [str(term) for term in self.terms]

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels the pool needs, sorted."""
        return tuple(sorted({name for term in self.terms for name in term.channels}))

    @cached_property
    def base(self) -> tuple[Factor, ...]:
        """Distinct factors of the terms, in order: the base signals every term is a monomial of."""
        return tuple(sorted({factor for term in self.terms for factor, _ in term.factors}))

    @cached_property
    def exponents(self) -> np.ndarray:
        """Power of each base signal in each term, (p, s) read-only int array."""
        place = {factor: j for j, factor in enumerate(self.base)}
        powers = np.zeros((len(self.terms), len(self.base)), dtype=int)
        for i, term in enumerate(self.terms):
            for factor, power in term.factors:
                powers[i, place[factor]] = power
        powers.setflags(write=False)
        return powers

    def evaluate_base(self, source: Any) -> np.ndarray:
        """Values of the base signals.

        Parameters
        ----------
        source : Recording or mapping of name to (n,) array [SI]

        Returns
        -------
        (s, n) float64 array, C-contiguous
            One row per factor of `base`, time along the last axis.

        Raises
        ------
        ChannelError
            A channel is missing; the message names the first term that needs it.
        DataError
            A channel is not finite somewhere.
        TermError
            A formula is not finite somewhere; names the term and the sample.
        """
        if not self.base:
            return np.empty((0, samples(source)))
        needed_by = [str(self.terms[i]) for i in np.argmax(self.exponents > 0, axis=0)]
        first = self.base[0].evaluate(source, needed_by[0])
        values = np.empty((len(self.base), len(first)))
        values[0] = first
        for j in range(1, len(self.base)):
            values[j] = self.base[j].evaluate(source, needed_by[j])
        return values

    def evaluate(self, source: Any) -> np.ndarray:
        """Values of every term, (n, p) float64 array: for plots and checks, since it forms the complete matrix.

        Raises
        ------
        ChannelError, DataError, TermError
            As `evaluate_base`.
        """
        base = self.evaluate_base(source)
        values = np.empty((base.shape[1], len(self)), order="F")
        for i, powers in enumerate(self.exponents):
            values[:, i] = product((base[j], int(powers[j])) for j in np.flatnonzero(powers))
        return values

    def summary(self) -> Summary:
        """Terms and their degrees."""
        shown = self.names if len(self) <= 8 else [*self.names[:7], "...", self.names[-1]]
        rows = tuple((str(term), term.degree) for term in self)
        table = Table((text_column("term"), Column("degree")), rows)
        return Summary(count_of(len(self), "candidate term"), ", ".join(shown), tables=(table,))

    def __str__(self) -> str:
        return ", ".join(self.names)


def _as_term(item: Any) -> Term:
    return item if isinstance(item, Term) else Term(item)


def _as_factor(name: Any) -> Factor:
    term = _as_term(name)
    if term.degree != 1:
        raise TermError(f"polynomial() takes single channels or factors; found '{term}', of degree {term.degree}.")
    return term.factors[0][0]


def _check_integer(what: str, value: Any, least: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise TermError(f"{what} is a whole number, {least} or more; found {value!r}.")
