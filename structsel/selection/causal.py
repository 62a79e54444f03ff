"""Causal rows: what the past predicts of the candidates, where they follow the residual.

`structsel.numerics.instrumental` has the method. Here: which responses need it, and the companions whose residuals show
what acts on several responses at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from structsel.formatting import count_of
from structsel.numerics.arrays import Array
from structsel.numerics.cross_products import CrossProducts, cross_products
from structsel.numerics.instrumental import InstrumentedProducts, PastFit
from structsel.numerics.noise_models import ARNoise
from structsel.numerics.normal_equations import project, solve_normal_equations
from structsel.numerics.past_data import RESIDUAL_LAGS, SIGNAL_LAGS, PastData, past_exponents
from structsel.numerics.prewhitened_products import prewhitened_cross_products
from structsel.numerics.regressors import DataSource, Scales, find_scales
from structsel.numerics.residuals import fit_residual_noise
from structsel.numerics.search_path import SearchStep
from structsel.selection.choices import (
    LEAST_INNOVATION,
    NO_MODELS,
    Choice,
    EngineData,
    FlowAngles,
    ResponseModels,
    fit_noise,
    models_of,
)
from structsel.selection.methods.method import thresholds

PAST_ROUNDS = 4  # of noise models and causal rows; the first eliminates terms
SIGNIFICANCE = 0.01
"""Of the tests of exogeneity (Durbin, Wu and Hausman) and of the instruments (Sargan), by which rows are chosen."""
TURBULENT = 0.01
"""Fraction of the variation of alpha or beta that the past does not predict, from which rows are causal by default. Of
alpha it is 0.004 on the demonstration flights in calm air (vane noise), 0.03, 0.08 and 0.18 in gusts of 0.4, 0.8 and
1.6 m/s. Where it is small the test rejects for other reasons: channels that are delayed by part of a sample."""
MOVES = 0.15
"""Standard deviation of a flow angle, relative to that of the other, below which it shows noise rather than turbulence.
It is 0.08 for beta in Twin Otter's longitudinal manoeuvres, and 0.2 for alpha in the demonstration flights."""
LONGEST_LAG = 0.25
"""Least lag of an instrument [s] that separates turbulence from the motion: below the time constants of short
period and roll. At 10 Hz, half a second, 1 % of alpha is not predicted in calm air either."""
COMPANION_DEGREE = 2  # of the models whose residuals are regressors
SAMPLES_PER_INSTRUMENT = 10
"""With fewer samples for each instrument the prediction approaches the candidates themselves, and corrects little."""


@dataclass(frozen=True)
class CombinedData:
    """A manoeuvre with the responses of two sources; the base signals are those of the first."""

    source: DataSource
    companion: DataSource

    @property
    def n(self) -> int:
        """Number of samples."""
        return self.source.n

    def base(self, start: int, stop: int) -> Array:
        """Base signals of these samples."""
        return self.source.base(start, stop)

    def responses(self, start: int, stop: int) -> Array:
        """Responses of both."""
        return np.concatenate([self.source.responses(start, stop), self.companion.responses(start, stop)])


def fit_companions(companions: Sequence[DataSource], responses: int, max_ar_order: int, **given: Any) -> ResponseModels:
    """Models of the companions' responses: least squares, then once by what the past predicts.

    Terms are the powers of every base signal up to `COMPANION_DEGREE`: misfit in the residual would take its part from
    the instruments. Residuals of least squares are orthogonal to the terms, and show little of what moves the aircraft.
    """
    everyone, scales = range(responses), find_scales(companions)
    signals = scales[0].size
    terms = np.concatenate([power * np.eye(signals, dtype=int) for power in range(1, COMPANION_DEGREE + 1)])
    products = cross_products(companions, terms, scales=scales, **given)
    theta = []
    for r in everyone:
        one = products.of_response(r)
        theta.append(solve_normal_equations(one.total(), range(1 + len(terms))) * one.scale[-1] / one.scale[:-1])
    floors = [LEAST_INNOVATION * scale for scale in scales[1]]
    noise = fit_residual_noise(companions, [terms] * responses, theta, everyone, max_ar_order, floors, scales=scales)
    models = ResponseModels((terms,) * responses, tuple(theta))
    own, powers = [True] * responses, range(signals, len(terms))
    past = instrumented_products(companions, models, everyone, terms, powers, noise, own, scales, **given)
    return ResponseModels(models.exponents, tuple(one.fit_terms(range(len(terms))).theta for one in past))


def enough_samples(samples: float, signals: int, responses: int, terms: int) -> bool:
    """Whether the samples are many times the instruments that these numbers of signals, responses and terms make."""
    instruments = signals * len(SIGNAL_LAGS) + responses * len(RESIDUAL_LAGS) + terms
    return samples >= SAMPLES_PER_INSTRUMENT * instruments


def turbulence_shows(flow: FlowAngles, **given: Any) -> bool:
    """Whether the past of all signals leaves more than `TURBULENT` of a flow angle that moves unpredicted."""
    if not flow.positions:
        return False
    scales = flow.scales or find_scales(flow.sources)
    table, n_instruments, _ = past_exponents(np.eye(scales[0].size, dtype=int)[list(flow.positions)], [], 0)
    data = [PastData(source, (), (), (0,), ()) for source in flow.sources]
    base = np.tile(scales[0], 1 + len(SIGNAL_LAGS))
    products = cross_products(data, table, scales=(base, scales[1][:1]), **given).within_manoeuvres()
    m = len(flow.positions)
    left = project(products.total(), range(1 + m, 1 + m + n_instruments)).remaining[1 : 1 + m]
    total = np.diag(products.total())[1 : 1 + m]
    moved = np.sqrt(total) * scales[0][list(flow.positions)]
    return bool(np.any((left > TURBULENT * total) & (moved > MOVES * moved.max())))


def is_needed(past: PastFit, misfit: bool) -> bool:
    """Whether the terms follow the residual. If the residual may be misfit, the instruments must be valid as well."""
    if misfit and past.test_instruments()[1] < SIGNIFICANCE:
        return False
    return past.test_exogeneity()[1] < SIGNIFICANCE


def instrumented_products(
    manoeuvres: Sequence[DataSource],
    models: ResponseModels,
    responses: Sequence[int],
    pool: NDArray[np.integer],
    products: Sequence[int],
    noise: Sequence[Sequence[ARNoise]],
    own_constants: Sequence[bool],
    scales: Scales,
    **given: Any,
) -> list[InstrumentedProducts]:
    """Prewhitened products of the candidates, their instruments and the other responses' residuals, in one pass.

    Parameters
    ----------
    manoeuvres : sequence of DataSource
        With all responses that have a model.
    models : ResponseModels
    responses : sequence of int
        Those wanted.
    pool : (p, s) int array
    products : sequence of int
        Candidates whose own past is an instrument as well.
    noise : sequence over responses of sequences over manoeuvres
    own_constants : sequence of bool
        Of the responses wanted.
    scales : (s,) array, (m,) array
        Of base signals and responses wanted.
    **given
        Further arguments of `prewhitened_cross_products`.
    """
    others = [j for j in range(len(models.theta)) if any(j != r for r in responses)]  # of one response or another
    table, n_instruments, w = past_exponents(pool, products, len(others))
    data = [PastData(source, models.exponents, models.theta, tuple(responses), tuple(others)) for source in manoeuvres]
    base = np.concatenate([np.tile(scales[0], 1 + len(SIGNAL_LAGS)), np.ones(w)])
    whitened = prewhitened_cross_products(data, table, noise, scales=(base, scales[1]), **given)
    number = np.tile(np.array(others, dtype=int), len(RESIDUAL_LAGS))  # the response to which each residual belongs
    first = 1 + len(pool) + n_instruments
    return [
        InstrumentedProducts(one, len(pool), n_instruments, first + np.flatnonzero(number != r), own)
        for one, r, own in zip(whitened, responses, own_constants, strict=True)
    ]


def use_past(data: EngineData, choices: list[Choice], shared: list[CrossProducts]) -> list[Choice]:
    """Causal rows for the responses whose candidates follow the residual, or for all by option."""
    choices = list(choices)
    companions = data.companions[0].responses(0, 1).shape[0] if data.companions else 0
    signals, terms = data.exponents.shape[1], sum(len(choice.result.selected) for choice in choices)
    pending = [
        r
        for r, choice in enumerate(choices)
        if choice.result.selected
        and choice.search.products.separate
        and enough_samples(choice.search.products.samples(), signals, len(choices) + companions, terms)
    ]
    rows = data.options.rows
    if not data.options.rows_may_be_causal or not pending:
        return choices
    if rows == "auto" and not turbulence_shows(data.flow_angles, **data.block_arguments):
        return choices
    further = NO_MODELS
    if companions:
        further = fit_companions(data.companions, companions, data.options.max_ar_order, **data.block_arguments)
    for number in range(PAST_ROUNDS):
        if not pending:
            break
        noise = fit_noise(data, choices, pending, shared)
        linear = {r: [] if number else _linear(choices[r]) for r in pending}
        pool = sorted({j for r in pending for j in (*choices[r].result.selected, *linear[r])})
        found = _past(data, choices, shared, further, pending, noise, pool)
        for r, past, models in zip(list(pending), found, noise, strict=True):
            if not number and rows == "auto" and not is_needed(past, choices[r].prewhitening_dropped is not None):
                pending.remove(r)
                continue
            before = replace(choices[r], noise=models, past=past, prewhitening_dropped=None)
            choices[r] = _eliminate(before, pool, linear[r])
            if not number and choices[r] is not before:
                # The noise model was that of false terms; the next is that of those kept, as sampled.
                choices[r] = replace(choices[r], past=None)
            elif past.test_instruments()[1] < SIGNIFICANCE:
                # The residual is not that of the truth, and its noise model would change the estimates further.
                pending.remove(r)
    return choices


def _linear(choice: Choice) -> list[int]:
    """Candidates of degree one that may be added: none where the terms are given or limited."""
    search, options = choice.search, choice.search.options
    if search.fixed is not None or options.max_terms is not None or options.correlation_limit is not None:
        return []
    return np.flatnonzero((search.constraints.degrees == 1) & ~search.hidden).tolist()


def _eliminate(choice: Choice, pool: Sequence[int], linear: Sequence[int]) -> Choice:
    """The choice without the terms that causal rows do not show.

    Linear terms are added first: products may have taken their effect in the samples as they are.

    Parameters
    ----------
    choice : Choice
    pool : sequence of int
        Candidates of which the products are.
    linear : sequence of int
        Those to add.
    """
    past, search, result = choice.past, choice.search, choice.result
    if past is None or search.fixed is not None:
        return choice
    place, degrees = {j: i for i, j in enumerate(pool)}, search.constraints.degrees
    selected = [place[j] for j in result.selected]
    added = [place[j] for j in linear if j not in result.selected]
    left = past.source.eliminate(
        [*selected, *added],
        thresholds(search.options, degrees.size, result.dof)[1],
        degrees[list(pool)],
        include=[place[j] for j in search.constraints.include if j in result.selected],
        confounders=[i for i in selected if degrees[pool[i]] == 1],
    )
    fit = left[-1][-1] if left else past.source.fit_terms([*selected, *added])
    leaving = [(i, F, of) for i, F, of in left if i not in added]
    entering = [(i, float(F), fit) for i, F in zip(fit.terms, fit.partial_F, strict=True) if i in added]
    if not leaving and not entering:
        return choice
    steps = [
        SearchStep(action, pool[i], -1, F, np.nan, of.rss, len(of.terms))
        for action, moves in (("leave", leaving), ("enter", entering))
        for i, F, of in moves
    ]
    reason = f"{result.stop_reason}; {count_of(len(leaving), 'term')} not shown by causal rows"
    if entering:
        reason += f", {count_of(len(entering), 'linear term')} shown by them only"
    kept = tuple(pool[i] for i in fit.terms)
    result = replace(result, selected=kept, rss=fit.rss, steps=(*result.steps, *steps), stop_reason=reason)
    return replace(choice, result=result, past=fit)


def _past(
    data: EngineData,
    choices: Sequence[Choice],
    shared: list[CrossProducts],
    further: ResponseModels,
    responses: list[int],
    noise: Sequence[tuple[ARNoise, ...]],
    pool: list[int],
) -> list[PastFit]:
    """The selected terms of these responses estimated by what the past predicts, given the models chosen so far."""
    models, reduced = models_of(data, choices, range(len(choices)), shared)
    sources = [CombinedData(*pair) for pair in zip(reduced, data.companions, strict=True)] if further.theta else reduced
    degrees = data.exponents.sum(axis=1)
    products = instrumented_products(
        sources,
        models.joined(further),
        responses,
        data.exponents[pool],
        [i for i, j in enumerate(pool) if degrees[j] > 1],
        noise,
        [choices[r].search.products.own_constants for r in responses],
        (data.scales[0], data.scales[1][responses]),
        progress=data.stage("causal rows"),
        **data.block_arguments,
    )
    kept = [[pool.index(j) for j in choices[r].result.selected] for r in responses]
    return [one.fit_terms(terms) for one, terms in zip(products, kept, strict=True)]


def constants_of_past(choice: Choice, shared: CrossProducts) -> Array:
    """Constant of each manoeuvre with the slopes of what the past predicts; empty where all have one constant."""
    if choice.past is None or not choice.search.products.own_constants:
        return np.empty(0)
    return shared.constants(choice.past.slopes, [j + 1 for j in choice.result.selected]) * shared.scale[-1]
