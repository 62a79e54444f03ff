"""Forms of effects that are on in some flights only, from a time or until one, with the same size wherever they are on.

Their times are proposed from the differences, before the noise is known, and refined with rows that are white.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from structsel.comparison.flight import Flight
from structsel.comparison.nuisance import Nuisance
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.running_sums import RunningSums
from structsel.diagnosis.scoring import EffectScore, improved, with_better
from structsel.diagnosis.signatures import Library, Signature, acting, spectra_of
from structsel.diagnosis.switch_search import ALWAYS, NEVER, Found, On, Parts, search, spreads
from structsel.diagnosis.weighing import EVIDENT
from structsel.effects.base import Columns, Effect, Variant
from structsel.effects.changes import EDGE
from structsel.effects.operators import shape_of

_COARSE, _FINE = 0.5, 0.1  # s between times that are tried, in the complete flight and then nearby
_NEAR = 1.0  # s, around each time


@dataclass(frozen=True, eq=False)
class SwitchedForm(Signature):
    """Form of an effect that is on in parts of the flights.

    Attributes
    ----------
    always : Variant
        The same, always on.
    on : tuple of On
        When it is on in each flight.
    """

    always: Variant
    on: tuple[On, ...]


def with_proposals(
    library: Library, flights: Sequence[Flight], tolerances: Sequence[Nuisance], found: Sequence[Signature] = ()
) -> Library:
    """Library with the likeliest form of each effect that may be switched, if it explains more than it costs.

    Parameters
    ----------
    library : Library
        Earlier proposals are replaced, except those found.
    flights : sequence of Flight
    tolerances : sequence of Nuisance
    found : sequence of Signature
        Effects that are in the model.
    """
    kept = [s for s in library.signatures if not isinstance(s, SwitchedForm)]
    if not library.switched:
        return library
    sums = RunningSums.of(flights, tolerances, [s.variant for s in found])
    for effect, forms in library.switched:
        form, on, log_evidence = sums.find(forms, effect.may_end, effect.durations)
        if log_evidence > 0.0 and _is_partly(on):
            kept.append(_form(effect, form, flights, on))
    return replace(library, signatures=(*kept, *(s for s in found if isinstance(s, SwitchedForm))))


def refine(problem: DiagnosisProblem, scores: Sequence[EffectScore]) -> list[EffectScore]:
    """Scores with the times of switched forms by the evidence of white rows; the largest evidence first."""
    return improved(scores, EVIDENT, partial(_with_times, problem))


def _with_times(problem: DiagnosisProblem, one: EffectScore) -> EffectScore:
    if not isinstance(one.signature, SwitchedForm):
        return one
    form = _refined(problem, one.signature)
    return with_better(problem, one, form, problem.try_signatures([form])[0])


def _refined(problem: DiagnosisProblem, form: SwitchedForm) -> SwitchedForm:
    effect, flights = form.hypothesis, problem.flights
    options = [_options(one, f, effect.may_end, _duration(form.on)) for one, f in zip(form.on, flights)]
    found = _search(problem, form, options)
    on, spread = [one[k] for one, k in zip(options, found.at)], list[float]()
    for reach, step in ((_NEAR, _FINE), (_FINE, flights[0].dt)):
        options = [_nearby(one, reach, step) for one in on]
        found = _search(problem, form, options)
        on = [one[k] for one, k in zip(options, found.at)]
        # The wider search shows how far a time is known.
        spread = spread or [x for w, v, one in zip(options, found.values, on) for x in spreads(w, v, one, step)]
    return _form(effect, form.always, flights, on, spread) if _is_partly(on) else form


def _duration(on: Sequence[On]) -> float:
    return max(one.duration for one in on)


def _options(one: On, flight: Flight, may_end: bool, duration: float) -> list[On]:
    """The same, always, never, and with another start or end."""
    t = np.arange(float(flight.t[0]) + EDGE, float(flight.t[-1]) - EDGE, _COARSE).tolist()
    if len(one.times) == 2:
        starts = [replace(one, start=x) for x in t if x < one.end]
        return [one, ALWAYS, NEVER, *starts, *(replace(one, end=x) for x in t if x > one.start)]
    ends = [On(end=x, duration=duration) for x in t] if may_end else []
    return [one, ALWAYS, NEVER, *(On(x, duration=duration) for x in t), *ends]


def _nearby(one: On, reach: float, step: float) -> list[On]:
    """The same, and with each time earlier and later."""
    shifts = np.arange(-reach, reach + 0.5 * step, step).tolist()
    moved = [replace(one, **{name: getattr(one, name) + x}) for name in one.finite for x in shifts]
    return [one, *(other for other in moved if other != one)]


def _search(problem: DiagnosisProblem, form: SwitchedForm, tried: Sequence[Sequence[On]]) -> Found:
    """The best of the options tried in each flight, from the first of them."""
    base = problem.base
    parts = []
    for m, (flight, each) in enumerate(zip(problem.flights, tried)):
        known = replace(form.always, columns=partial(_known, form.always.columns(flight)))
        options = [switched_form(known, {flight.name: one}) for one in each]
        products = problem.products(m, spectra_of(options, flight, problem.responses), form.width)
        parts.append(Parts.of(products, each, base.inverse))
    return search(base.factored_y, parts, [0] * len(tried))


def _known(columns: Columns, _: Flight) -> Columns:
    return columns


def _is_partly(on: Sequence[On]) -> bool:
    return set(on) not in ({ALWAYS}, {NEVER})


def _form(
    effect: Effect, always: Variant, flights: Sequence[Flight], on: Sequence[On], spread: Sequence[float] = ()
) -> SwitchedForm:
    variant = switched_form(always, {f.name: one for f, one in zip(flights, on) if one != NEVER})
    variant = replace(variant, spread=dict(zip(variant.times, spread)))
    spectra = [spectra_of([variant], f, f.responses)[0] for f in flights]
    return SwitchedForm(effect, variant, spectra, acting(spectra, flights), always, tuple(on))


def switched_form(variant: Variant, when: Mapping[str, On]) -> Variant:
    """A form where it is on, by the names of flights."""

    def columns(flight: Flight) -> Columns:
        if flight.name not in when:
            return {}
        on = when[flight.name].along(flight.t)[:, None]
        return {c: on * x for c, x in variant.columns(flight).items()}

    times = {
        name if what == "start" else f"{name}, end": getattr(one, what)
        for name, one in when.items()
        for what in one.finite
    }
    shape = shape_of(times)
    searched = tuple(shape)
    duration = _duration([*when.values(), NEVER])
    if duration > 0.0:
        shape["duration"] = duration
    where = ", ".join(f"'{name}'{one.says}" for name, one in when.items())
    within = f", within {duration:g} s" if duration > 0.0 else ""
    says = f"in {where}{within}"
    return replace(
        variant,
        columns=columns,
        shape={**variant.shape, **shape},
        units={**variant.units, **dict.fromkeys(shape, "s")},
        about=f"{variant.about}, {says}" if variant.about else says,
        only_in=tuple(when),
        times=searched,
        words={**variant.words, "when": says},
        again=None,
    )
