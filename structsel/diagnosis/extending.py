"""Responses of a simulation, and effects added to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from structsel.candidates import Term
from structsel.candidates.formula import substitute
from structsel.candidates.parse import parse_formula
from structsel.candidates.terms import Factor
from structsel.comparison.flight import Flight
from structsel.comparison.surrogate import Surrogate, identify
from structsel.diagnosis.adding import Addition
from structsel.formatting import format_percent
from structsel.model import ResponseModel, State, recorded_ranges
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array


class Extended:
    """Responses to which effects are added.

    Parameters
    ----------
    base : mapping of response to ResponseModel
        Of body axes, or with CL and CD.
    flights : sequence of Flight
    """

    def __init__(self, base: Mapping[str, ResponseModel], flights: Sequence[Flight]):
        self._base, self._flights = dict(base), flights
        self._states: dict[str, State] = {}
        self._replaced: dict[str, dict[str, str]] = {}
        self._values: dict[str, dict[Term, float]] = {c: {} for c in base}
        self._blocks: dict[str, list[tuple[list[Term], Array]]] = {c: [] for c in base}

    def take(self, one: Addition) -> bool:
        """Add an effect; return False and add nothing if its states replace the same channel as those of another."""
        taken = {(c, channel) for c, swaps in self._replaced.items() for channel in swaps}
        if set(one.states) & set(self._states) or taken & {(c, x) for c, s in one.replaced.items() for x in s}:
            return False
        self._states |= one.states
        for c, swaps in one.replaced.items():
            self._replaced.setdefault(c, {}).update(swaps)
        for c, terms in self._turned(one.terms).items():
            rows = np.array(list(terms.values()))
            self._add(c, list(terms), rows @ one.theta, rows @ one.covariance @ rows.T)
        fixed = {c: {t: np.array([v]) for t, v in terms.items()} for c, terms in one.fixed.items()}
        for c, terms in self._turned(fixed).items():
            values = np.concatenate(list(terms.values()))
            self._add(c, list(terms), values, np.zeros((len(values), len(values))))
        return True

    def add_regression(self, effect: str, added: Sequence[Mapping[str, Array]]) -> str:
        """Add a regression on the states in place of an effect, for these recordings; return the note on it."""
        wanted = sorted({c for each in added for c, x in each.items() if c in COEFFICIENTS and np.any(x)})
        contributions = [{c: each.get(c, np.zeros(len(f))) for c in wanted} for f, each in zip(self._flights, added)]
        stand_in = identify(self._flights, contributions, wanted)
        made = as_models(stand_in, self._flights)
        terms = {c: {t: np.array([v]) for t, v in zip(m.terms, m.values.tolist())} for c, m in made.items()}
        for c, mine in self._turned(terms).items():
            values = np.concatenate(list(mine.values()))
            self._add(c, list(mine), values, np.full((len(values), len(values)), np.nan))
        explained = ", ".join(f"{format_percent(stand_in.r2[c])} in {c}" for c in wanted)
        return (
            f"{effect} has no terms or states of a model in this form: model.json contains a regression on the "
            f"states in its place, for these recordings (explained variance: {explained or 'none'})"
        )

    def responses(self) -> dict[str, ResponseModel]:
        """Models of all responses."""
        return {c: self._response(c, model) for c, model in self._base.items()}

    def _turned(self, terms: Mapping[str, Mapping[Term, Array]]) -> dict[str, dict[Term, Array]]:
        """Terms in the axes of the base, without responses that it lacks."""
        conversion = _TO_WIND if "CL" in self._base else _TO_BODY
        made: dict[str, dict[Term, Array]] = {}
        for c, mine in terms.items():
            for to, by, sign in conversion.get(c, ((c, Term("1"), 1.0),)):
                if to in self._base:
                    held = made.setdefault(to, {})
                    for term, weights in mine.items():
                        held[term * by] = held.get(term * by, 0.0) + sign * weights
        return {c: mine for c, mine in made.items() if mine}

    def _add(self, response: str, terms: list[Term], values: Array, covariance: Array) -> None:
        held = self._values[response]
        for term, value in zip(terms, values.tolist()):
            held[term] = held.get(term, 0.0) + value
        self._blocks[response].append((terms, covariance))

    def _response(self, response: str, own: ResponseModel) -> ResponseModel:
        added, swaps = self._values[response], self._replaced.get(response, {})
        nodes = {channel: parse_formula(text) for channel, text in swaps.items()}
        kept = [t.replace(lambda f: Factor(substitute(f.node, nodes))) for t in own.terms]
        if not added and kept == list(own.terms):
            return own
        values = dict(zip(kept, own.values.tolist()))
        assert own.standard_errors is not None
        errors = dict(zip(kept, own.standard_errors.tolist()))
        terms = list(dict.fromkeys([*kept, *added]))
        place = {t: i for i, t in enumerate(terms)}
        covariance = np.zeros((len(terms), len(terms)))
        for mine, block in self._blocks[response]:
            at = [place[t] for t in mine]
            covariance[np.ix_(at, at)] += block
        for t in added:
            # The value of the simulation is taken as exact: the standard error of the sum is that of the difference.
            errors[t] = float(np.sqrt(max(covariance[place[t], place[t]], 0.0)))
        joint = None
        if own.covariance is not None and np.isfinite(covariance).all():
            alone = [i for i, t in enumerate(kept) if t not in added]
            at = [place[kept[i]] for i in alone]
            covariance[np.ix_(at, at)] = own.covariance[np.ix_(alone, alone)]
            joint = covariance
        named = {c for t in added for c in t.channels} - set(own.ranges)
        recorded = [c for c in sorted(named) if all(c in f or c in f.channels for f in self._flights)]
        region = recorded_ranges([{c: f[c] for c in recorded} for f in self._flights], recorded) if recorded else {}
        return replace(
            own,
            terms=tuple(terms),
            values=np.array([values.get(t, 0.0) + added.get(t, 0.0) for t in terms]),
            covariance=joint,
            standard_errors=np.array([errors[t] for t in terms]),
            error_dof=None,  # those of the added terms are not known
            method=f"{own.method or 'as given'}, physics added",
            ranges={**own.ranges, **region},
            s2=np.nan,
            r2=np.nan,
            states={**own.states, **self._states},
        )


_RATE = "alpha_dot_hat"
_SIN, _COS = Term("sin(alpha)"), Term("cos(alpha)")
_TO_BODY = {
    "CL": (("CX", _SIN, 1.0), ("CZ", _COS, -1.0)),
    "CD": (("CX", _COS, -1.0), ("CZ", _SIN, -1.0)),
}
_TO_WIND = {
    "CX": (("CL", _SIN, 1.0), ("CD", _COS, -1.0)),
    "CZ": (("CL", _COS, -1.0), ("CD", _SIN, -1.0)),
}


def as_models(stand_in: Surrogate, flights: Sequence[Flight]) -> dict[str, ResponseModel]:
    """Models of the responses of a surrogate."""
    made = {}
    for c, terms in stand_in.terms.items():
        texts, values = ["1"], [stand_in.constant[c]]
        for term, value in zip(terms, stand_in.values[c]):
            size = float(value / np.prod([stand_in.scale[f] for f in term]))
            if term == (_RATE,):  # this rate is not centred: it depends on the force
                texts.append(_RATE)
                values[0] -= size * stand_in.centre[_RATE]
            else:
                parts = [
                    (f if f in stand_in.knots else _centred(f, stand_in.centre[f]), term.count(f))
                    for f in sorted(set(term))
                ]
                texts.append("*".join(part + (f"^{n}" if n > 1 else "") for part, n in parts))
            values.append(size)
        region = {
            f: (min(float(x[f].min()) for x in flights), max(float(x[f].max()) for x in flights))
            for f in sorted({stand_in.channel_of(f) for t in terms for f in t})
        }
        made[c] = ResponseModel(
            tuple(Term.parse(t) for t in texts), np.array(values), method="stand-in of a simulation", ranges=region,
            n=sum(len(f) for f in flights), r2=stand_in.r2[c],
        )  # fmt: skip
    return made


def _centred(channel: str, centre: float) -> str:
    return f"({channel} - {centre!r})" if centre >= 0.0 else f"({channel} + {-centre!r})"
