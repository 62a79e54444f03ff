"""ResponseModel: what was found for one response."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
import scipy

from structsel.candidates import Term
from structsel.candidates.formula import substitute
from structsel.candidates.terms import Factor, product, samples
from structsel.deprecation import renamed_arguments, renamed_attribute
from structsel.errors import ModelError
from structsel.formatting import count_of, finite_or_none
from structsel.model.dynamics import RecordingWithStates, State
from structsel.model.ranges import RangeExcursion, find_excursions
from structsel.nomenclature import unit_of
from structsel.results import Estimates
from structsel.tables import Column, Summary, Table, text_column

_COLUMNS = {
    "term": text_column("term"),
    "value": Column("value", "5g"),
    "std_error": Column("std error", "3g"),
    "t": Column("t", "1f"),
    "low": Column("95 % low", "5g"),
    "high": Column("95 % high", "5g"),
}


@renamed_arguments(region="ranges")
@dataclass(frozen=True, eq=False, repr=False)
class ResponseModel(Estimates):
    """A response as a sum of terms times values.

    Attributes
    ----------
    terms : tuple of Term
        The constant, ``1``, among them where the model has one. Text is read as by `Term.parse`.
    values : (k,) array [response unit per unit of the term]
    covariance : (k, k) array or None
        Of the values; None where it is not known.
    standard_errors : (k,) array
        Square roots of the covariance's diagonal unless given; nan where not known.
    error_dof : (k,) array or None
        Degrees of freedom of the standard errors; n - k where absent.
    method : str
        How the terms were chosen.
    residuals : str
        Noise assumed in the residuals: white, ar, cluster, ...
    biased : bool
        True for principal-components, ridge and other estimates that trade bias for variance.
    ranges : mapping of channel to (least, greatest) [SI]
        Of the recordings it was identified from.
    n : int
        Samples used; 0 where not known.
    s2 : float [response unit^2]
        Residual variance; nan where not known.
    r2 : float
        R^2 over the samples used; nan where not known.
    constants : mapping of recording to float
        Where each recording of the identification has a constant of its own: the constant of the model is their mean.
    states : mapping of name to State
        What the terms name that is no channel; those that no term names are left out.
    held : tuple of Term
        Terms that the last refinement did not estimate: their values, errors and covariance are those of the model
        before it. Tables mark them with "(held)".

    Raises
    ------
    ModelError
        Sizes that do not fit, values that are not finite, a term twice.
    """

    terms: tuple[Term, ...]
    values: np.ndarray
    covariance: np.ndarray | None = None
    standard_errors: np.ndarray | None = None
    error_dof: np.ndarray | None = None
    method: str = ""
    residuals: str = ""
    biased: bool = False
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    n: int = 0
    s2: float = math.nan
    r2: float = math.nan
    constants: Mapping[str, float] = field(default_factory=dict)
    states: Mapping[str, State] = field(default_factory=dict)
    held: tuple[Term, ...] = ()

    region = renamed_attribute("ranges")
    steady = renamed_attribute("quasi_steady")
    leaves_region = renamed_attribute("range_excursions")

    def __post_init__(self) -> None:
        terms = tuple(term if isinstance(term, Term) else Term(term) for term in self.terms)
        k = len(terms)
        if twice := sorted({str(term) for term in terms if terms.count(term) > 1}):
            raise ModelError(f"A response model holds {', '.join(twice)} more than once. Add the values up.")
        held = tuple(term if isinstance(term, Term) else Term(term) for term in self.held)
        if strange := [str(term) for term in held if term not in terms]:
            raise ModelError(f"The held term '{strange[0]}' is not a term of the model: {', '.join(map(str, terms))}.")
        values = _array("values", self.values, (k,))
        if not np.isfinite(values).all():
            i = int(np.argmin(np.isfinite(values)))
            raise ModelError(f"The value of term '{terms[i]}' is {values[i]}. A model needs finite values.")
        covariance = None if self.covariance is None else _array("covariance", self.covariance, (k, k))
        if self.standard_errors is not None:
            errors = _array("standard_errors", self.standard_errors, (k,))
        elif covariance is not None:
            # Rounding can push a variance of almost nothing below zero.
            errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        else:
            errors = np.full(k, np.nan)
        dof = None if self.error_dof is None else _array("error_dof", self.error_dof, (k,))
        ranges = {str(name): (float(low), float(high)) for name, (low, high) in self.ranges.items()}
        for name, (low, high) in ranges.items():
            if not low <= high:
                raise ModelError(f"The range of '{name}' is [{low}, {high}]. Write the least value first.")
        for array in (values, covariance, errors, dof):
            if array is not None:
                array.setflags(write=False)
        object.__setattr__(self, "terms", terms)
        object.__setattr__(self, "held", held)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "covariance", covariance)
        object.__setattr__(self, "standard_errors", errors)
        object.__setattr__(self, "error_dof", dof)
        object.__setattr__(self, "biased", bool(self.biased))
        object.__setattr__(self, "ranges", MappingProxyType(ranges))
        object.__setattr__(self, "n", int(self.n))
        object.__setattr__(self, "s2", float(self.s2))
        object.__setattr__(self, "r2", float(self.r2))
        constants = {str(name): float(value) for name, value in self.constants.items()}
        object.__setattr__(self, "constants", MappingProxyType(constants))
        named = {name for term in terms for name in term.channels}
        states = {name: state for name, state in self.states.items() if name in named}
        object.__setattr__(self, "states", MappingProxyType(states))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ResponseModel):
            return NotImplemented
        return self.to_dict() == other.to_dict() and dict(self.states) == dict(other.states)

    __hash__ = None  # type: ignore[assignment]

    def __getitem__(self, term: str | Term) -> float:
        """Value of a term.

        Raises
        ------
        ModelError
            The model does not hold it.
        """
        wanted = term if isinstance(term, Term) else Term(term)
        if wanted not in self.terms:
            raise ModelError(f"The model has no term '{wanted}'. It has: {', '.join(map(str, self.terms))}.")
        return float(self.values[self.terms.index(wanted)])

    def __contains__(self, term: object) -> bool:
        return (Term(term) if isinstance(term, str) else term) in self.terms

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels the terms and their states need, sorted."""
        named = {name for term in self.terms for name in term.channels} - set(self.states)
        return tuple(sorted(named.union(*(state.channels for state in self.states.values()))))

    @property
    def labels(self) -> tuple[str, ...]:
        """Text of each term for tables, "(held)" behind a held one."""
        return tuple(f"{term} (held)" if term in self.held else str(term) for term in self.terms)

    @property
    def t_values(self) -> np.ndarray:
        """Values over their standard errors, (k,); nan where the error is not known, inf where it is zero."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.values / self._errors

    def intervals(self, level: float = 0.95) -> np.ndarray:
        """Confidence intervals of the values, (k, 2), from Student's t with the degrees of freedom of each error.

        Where neither these nor n are known, from the normal distribution. Nan for biased estimates, whose bias is not
        known.
        """
        freedom = self._estimates()[3]
        quantile = scipy.stats.t.ppf(0.5 + level / 2, freedom)
        return np.column_stack([self.values - quantile * self._errors, self.values + quantile * self._errors])

    def _estimates(self) -> tuple[list[str], np.ndarray, np.ndarray, Any]:
        dof = self.n - len(self.terms)
        freedom: Any = self.error_dof if self.error_dof is not None else dof if dof > 0 else np.inf
        if self.biased:
            freedom = np.nan  # no interval and no probability: the bias is not known
        return [str(term) for term in self.terms], self.values, self._errors, freedom

    @property
    def _errors(self) -> np.ndarray:
        assert self.standard_errors is not None
        return self.standard_errors

    def evaluate(self, source: Any, *, known: dict[Any, np.ndarray] | None = None) -> np.ndarray:
        """Values of the response, (n,), on a recording or mapping of arrays; does not look at the ranges.

        Parameters
        ----------
        source : Recording or mapping of name to (n,) array [SI]
        known : dict, optional
            Factors and states computed so far, added to; responses that are given the same evaluate each once.

        Raises
        ------
        ChannelError, DataError, TermError
            As `Term.evaluate`.
        """
        known = {} if known is None else known
        if self.states:
            source = RecordingWithStates(source, self.states, known)
        total: np.ndarray | None = None
        for term, value in zip(self.terms, self.values):
            for factor, _ in term.factors:
                if factor not in known:
                    known[factor] = factor.evaluate(source, str(term))
            if term.is_constant:
                part = np.full(samples(source), value)
            else:
                part = product((known[factor], power) for factor, power in term.factors)
                part *= value
            total = part if total is None else np.add(total, part, out=total)
        return np.zeros(samples(source)) if total is None else total

    def quasi_steady(self) -> ResponseModel:
        """The response without dynamics: every state at its steady value."""
        if not self.states:
            return self
        constants = {name: state.quasi_steady() for name, state in self.states.items()}
        values: dict[Term, float] = {}
        for term, value in zip(self.terms, self.values.tolist()):
            still = term.replace(lambda factor: Factor(substitute(factor.node, constants)))
            values[still] = values.get(still, 0.0) + value
        return ResponseModel(tuple(values), np.array(list(values.values())), method=self.method, ranges=self.ranges)

    def range_excursions(self, source: Any) -> tuple[RangeExcursion, ...]:
        """Channels the terms need that a recording takes outside the recorded ranges."""
        mine = set(self.channels)
        return find_excursions(source, {name: bounds for name, bounds in self.ranges.items() if name in mine})

    def to_dict(self) -> dict[str, Any]:
        """Return the model as plain lists and numbers, None for what is not known."""
        return {
            "terms": [str(term) for term in self.terms],
            "values": self.values.tolist(),
            "standard_errors": finite_or_none(self._errors.tolist()),
            **({} if self.error_dof is None else {"error_dof": self.error_dof.tolist()}),
            "covariance": None if self.covariance is None else self.covariance.tolist(),
            "method": self.method,
            "residuals": self.residuals,
            "biased": self.biased,
            "region": {name: list(bounds) for name, bounds in self.ranges.items()},
            "n": self.n,
            "s2": finite_or_none(self.s2),
            "r2": finite_or_none(self.r2),
            **({"constants": dict(self.constants)} if self.constants else {}),
            **({"held": [str(term) for term in self.held]} if self.held else {}),
        }

    def summary(self, name: str = "") -> Summary:
        """Terms and estimates, under the name of the response."""
        facts = [count_of(len(self.terms), "term")]
        facts += [f"R2 {self.r2:.4f}"] if math.isfinite(self.r2) else []
        facts += [f"s {math.sqrt(self.s2):.3g}"] if math.isfinite(self.s2) else []
        facts += [f"n {self.n}"] if self.n else []
        facts += [self.method] if self.method else []
        facts += [f"{self.residuals} residuals"] if self.residuals else []
        notes = []
        if self.biased:
            notes.append("Biased estimates: the standard errors leave the bias out, and there are no intervals.")
        if self.constants:
            notes.append(f"Constant: the mean of those of {count_of(len(self.constants), 'recording')}.")
        if self.ranges:
            ranges = "; ".join(f"{n} {lo:.4g} to {hi:.4g} {unit_of(n)}" for n, (lo, hi) in self.ranges.items())
            notes.append("Recorded ranges: " + ranges.replace(" -;", ";").removesuffix(" -"))
        if self.held:
            notes.append("(held): not estimated by the refinement; value and error are those of the model before it.")
        rows = [{**row, "term": label} for row, label in zip(response_rows("", self), self.labels)]
        table = Table.from_records(_COLUMNS, rows)
        return Summary(name, ", ".join(facts), tables=(table,), notes=tuple(notes))


def _array(what: str, values: Any, shape: tuple[int, ...]) -> np.ndarray:
    array = np.array(values, dtype=float)
    if array.shape != shape:
        raise ModelError(f"{what} has shape {array.shape}; {shape[0]} terms need {shape}.")
    return array


def response_rows(name: str, model: ResponseModel) -> list[dict[str, Any]]:
    """One row per term: response, term, value, std_error, t, low, high, held."""
    columns: Sequence[Any] = (model.terms, model.values, model._errors, model.t_values, model.intervals())
    return [
        {
            "response": name,
            "term": str(term),
            "value": float(value),
            "std_error": float(error),
            "t": float(t),
            "low": float(interval[0]),
            "high": float(interval[1]),
            "held": term in model.held,
        }
        for term, value, error, t, interval in zip(*columns)
    ]
