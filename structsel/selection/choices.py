"""What a selection carries from step to step: the data, the choice for each response, and its residual."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.arrays import Array
from structsel.numerics.blocks import JobRunner, choose_workers
from structsel.numerics.cross_products import CrossProducts
from structsel.numerics.instrumental import PastFit
from structsel.numerics.noise_models import ARNoise
from structsel.numerics.regressors import DataSource, Scales
from structsel.numerics.residuals import fit_residual_noise
from structsel.selection.constants import without_constants
from structsel.selection.search import Search, model_products, solve
from structsel.selection.search_result import SearchResult
from structsel.selection.settings import SelectOptions

LEAST_INNOVATION = 1e-10  # of the response's scale
MANY_BLOCKS, FEW_BLOCKS = 32, 12  # kept apart, for resampling and tests between blocks
MANY_UP_TO = 200  # candidates; above it blocks take much memory
FEW_TERMS = 30  # that a pass over selected terms is taken to have

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class ResponseModels:
    """Terms and parameters of every response in physical units, the constant first.

    Attributes
    ----------
    exponents : tuple of (k, s) int array
    theta : tuple of (1 + k,) array
    """

    exponents: tuple[NDArray[np.integer], ...]
    theta: tuple[Array, ...]

    def joined(self, other: ResponseModels) -> ResponseModels:
        """Those of both."""
        return ResponseModels(self.exponents + other.exponents, self.theta + other.theta)


NO_MODELS = ResponseModels((), ())


@dataclass(frozen=True)
class FlowAngles:
    """The manoeuvres with alpha and beta, in which turbulence shows.

    Attributes
    ----------
    sources : sequence of DataSource
        Their base signals are those of the candidates, the flow angles, rates and surfaces.
    positions : tuple of int
        Base signals that are flow angles; empty where turbulence is not to be looked for.
    scales : (s,) array, (m,) array, optional
        Where they are known.
    """

    sources: Sequence[DataSource] = ()
    positions: tuple[int, ...] = ()
    scales: Scales | None = None


NO_FLOW_ANGLES = FlowAngles()


@dataclass(frozen=True)
class EngineData:
    """What is read, by whom, with what progress."""

    manoeuvres: Sequence[DataSource]
    exponents: NDArray[np.integer]
    options: SelectOptions
    scales: Scales
    runner: JobRunner
    progress: Progress | None
    companions: Sequence[DataSource] = ()
    flow_angles: FlowAngles = NO_FLOW_ANGLES

    @property
    def blocks(self) -> int:
        """How many to keep apart."""
        return MANY_BLOCKS if len(self.exponents) <= MANY_UP_TO else FEW_BLOCKS

    @property
    def workers(self) -> int:
        """Threads for passes over the selected terms."""
        return choose_workers(self.options.workers, sum(m.n for m in self.manoeuvres), FEW_TERMS)

    @property
    def given(self) -> dict[str, Any]:
        """Arguments of every pass."""
        return {"scales": self.scales, "runner": self.runner}

    @property
    def block_arguments(self) -> dict[str, Any]:
        """Arguments of every pass that forms cross-products, without the scales."""
        return {"blocks": self.blocks, "workers": self.options.workers, "runner": self.runner}

    def stage(self, name: str) -> Callable[[int, int], None] | None:
        """Progress of one pass."""
        progress = self.progress
        return None if progress is None else lambda done, of: progress(name, done, of)


@dataclass(frozen=True)
class Choice:
    """The search whose result is used; see `ArraySelection` for the other fields."""

    search: Search
    result: SearchResult
    noise: tuple[ARNoise, ...] = ()
    converged: bool = True
    prewhitening_dropped: tuple[float, float] | None = None
    past: PastFit | None = None


def fit_noise(
    data: EngineData, choices: Sequence[Choice], responses: Sequence[int], shared: Sequence[CrossProducts]
) -> list[tuple[ARNoise, ...]]:
    """Noise models of the residuals of each choice, manoeuvre by manoeuvre."""
    models, sources = models_of(data, choices, responses, shared)
    return fit_residual_noise(
        sources,
        models.exponents,
        models.theta,
        responses,
        data.options.max_ar_order,
        [LEAST_INNOVATION * float(choices[r].search.products.scale[-1]) for r in responses],
        workers=data.workers,
        progress=data.stage("noise models"),
        **data.given,
    )


def models_of(
    data: EngineData, choices: Sequence[Choice], responses: Sequence[int], shared: Sequence[CrossProducts]
) -> tuple[ResponseModels, Sequence[DataSource]]:
    """Models of these responses, and the manoeuvres less their own constants."""
    terms, theta = [], []
    own: list[tuple[Array, Sequence[int]] | None] = [None] * len(choices)
    for r in responses:
        products, kept = choices[r].search.products, list(choices[r].result.selected)
        scale = products.scale
        past = choices[r].past
        scaled = solve(model_products(products, kept)) if past is None else past.scaled.copy()
        if products.own_constants:
            own[r], scaled[0] = (scaled[1:], kept), 0.0
        theta.append(scaled * scale[-1] / scale[[0, *(j + 1 for j in kept)]])
        terms.append(data.exponents[kept])
    return ResponseModels(tuple(terms), tuple(theta)), without_constants(data.manoeuvres, shared, own)
