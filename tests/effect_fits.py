"""Fits of the forms of an effect to differences by least squares, and checks that hold for every form."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from structsel.comparison.flight import Flight
from structsel.effects import EFFECTS
from structsel.effects.base import Effect, FittedEffect, ParameterEstimate, Variant
from structsel.nomenclature import COEFFICIENTS

_SCALE = {"k_V": 0.05, "k_h": 0.3, "k_vn": 0.3, "k_ve": 0.3, "k_vd": 0.3}


class Fit(NamedTuple):
    """A form with the values of its parameters by name, and the fraction of the differences that it explains."""

    variant: Variant
    values: dict[str, float]
    explained: float


def effect_named(name: str) -> Effect:
    """An effect of the library."""
    return next(h for h in EFFECTS if h.name == name)


def explain(flights: Sequence[Flight], variant: Variant, responses: Sequence[str] = ()) -> Fit:
    """Least-squares fit of a form to the differences of some responses, by default of all."""
    rows, target = [], []
    for f in flights:
        columns = variant.columns(f)
        for r in responses or f.difference:
            scale = 0.01 * np.std(f.measured[r]) if r in COEFFICIENTS else _SCALE.get(r, 0.002)
            scale = scale or 1.0
            x, y = columns.get(r, np.zeros((len(f), len(variant.parameters)))), f.difference[r]
            assert x.shape == (len(f), len(variant.parameters))
            assert np.isfinite(x).all()
            rows.append((x - x.mean(axis=0)) / scale)
            target.append((y - y.mean()) / scale)
    X, y = np.vstack(rows), np.concatenate(target)
    sizes = np.linalg.norm(X, axis=0)
    sizes[sizes == 0.0] = 1.0
    values = np.linalg.lstsq(X / sizes, y, rcond=None)[0] / sizes
    left = y - X @ values
    stated = {p.name: p.estimate(float(x), 0.0).value for p, x in zip(variant.parameters, values)}
    return Fit(variant, stated, 1.0 - float(left @ left) / float(y @ y))


def best(flights: Sequence[Flight], effect: Effect, responses: Sequence[str] = ()) -> Fit:
    """Form within its limits that explains most."""
    assert effect.needs(flights) == ""
    fits = [explain(flights, v, responses) for v in effect.variants(flights)]
    within = [f for f in fits if all(p.low <= f.values[p.name] <= p.high for p in f.variant.parameters)]
    return max(within or fits, key=lambda f: f.explained)


def fit_form(flights: Sequence[Flight], effect: str, about: str) -> Fit:
    """Fit of one form of an effect, given by its description."""
    return explain(flights, next(v for v in effect_named(effect).variants(flights) if v.about == about))


def fitted_effect(variant: Variant, values: Mapping[str, float]) -> FittedEffect:
    """Result of a fit, as an effect receives it to describe what was found."""
    shape = {n: ParameterEstimate(x, 0.0, variant.units.get(n, "-")) for n, x in variant.shape.items()}
    fitted = {p.name: ParameterEstimate(values[p.name], 0.1 * abs(values[p.name]), p.unit) for p in variant.parameters}
    return FittedEffect(variant, {**fitted, **shape}, {})


def check_all(flights: Sequence[Flight], effect: Effect) -> None:
    """Every form has finite columns of the right shape, sizes and limits that make sense, and a sentence."""
    variants = effect.variants(flights)
    assert 0 < len(variants) <= 66
    for v in variants:
        for p in v.parameters:
            assert p.sd > 0.0, (effect.name, v.about, p.name)
            assert p.low < p.high, (effect.name, v.about, p.name)
        assert set(v.times) == {n for n in v.shape if n == "time" or n.startswith("time in ")}, (effect.name, v.about)
        for f in flights:
            for r, H in v.columns(f).items():
                assert r in f.measured, (effect.name, r)
                assert H.shape == (len(f), len(v.parameters))
                assert np.isfinite(H).all()
        text = effect.says(fitted_effect(v, {p.name: p.sd for p in v.parameters}))
        assert text.endswith("."), text
