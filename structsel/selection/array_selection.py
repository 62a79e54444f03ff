"""Result of a selection on arrays: candidates by number, values in the units of base signals and response."""

from __future__ import annotations

from dataclasses import dataclass

from structsel.numerics.arrays import Array
from structsel.numerics.collinearity import ConditionIndices
from structsel.numerics.least_squares import LeastSquaresFit
from structsel.numerics.noise_models import ARNoise
from structsel.selection.aliases import AliasedPair
from structsel.selection.heterogeneity import Heterogeneity
from structsel.selection.resampling import Bootstrap, CrossValidation
from structsel.selection.search_result import SearchResult


@dataclass(frozen=True)
class ArraySelection:
    """Selection of one response, candidates by number.

    Attributes
    ----------
    search, white_noise : SearchResult
        With the noise model used, and with white noise.
    dependent : tuple of int
        Candidates that are constant, or explained by the selected ones.
    noise : tuple of ARNoise
        One per manoeuvre; empty without prewhitening.
    causal : bool
        Candidates were replaced by what the past predicts of them.
    exogeneity, instruments : (float, float), optional
        Of causal rows: F and probability that the selected candidates, and that the instruments, do not follow the
        residual.
    cluster_robust : bool
        Tests took the scatter between blocks.
    n_blocks : int
    converged : bool
        False where terms and noise models did not agree after the last round.
    prewhitening_dropped : (float, float), optional
        Sums of squared errors with prewhitening and of the search used instead.
    fit : LeastSquaresFit
    values, covariance : (1 + k,) array, (1 + k, 1 + k) array
        The constant first.
    constants : (K,) array
        Of each manoeuvre; the first of `values` is then their mean by samples. Empty with one constant.
    biased : str
        How, where the estimate is biased; else empty.
    vif : (k,) array
    conditioning : ConditionIndices
    white_noise_covariance : (1 + k, 1 + k) array
    r2, rms, n
        Of the response itself.
    aliases : tuple of AliasedPair
    cross_validation : CrossValidation or None
    bootstrap : Bootstrap or None
    linear : CrossValidation or None
        Of the model of all linear terms.
    linear_terms : frozenset of int
    heterogeneity : Heterogeneity or None
        Of the kept terms between manoeuvres.
    """

    search: SearchResult
    white_noise: SearchResult
    dependent: tuple[int, ...]
    noise: tuple[ARNoise, ...]
    causal: bool
    exogeneity: tuple[float, float] | None
    instruments: tuple[float, float] | None
    cluster_robust: bool
    n_blocks: int
    converged: bool
    prewhitening_dropped: tuple[float, float] | None
    fit: LeastSquaresFit
    values: Array
    constants: Array
    covariance: Array
    biased: str
    vif: Array
    conditioning: ConditionIndices
    white_noise_covariance: Array
    r2: float
    rms: float
    n: int
    aliases: tuple[AliasedPair, ...]
    cross_validation: CrossValidation | None
    bootstrap: Bootstrap | None
    linear: CrossValidation | None
    linear_terms: frozenset[int]
    heterogeneity: Heterogeneity | None

    @property
    def is_linear(self) -> bool:
        """Whether the model is that of all linear terms."""
        return self.linear_terms == frozenset(self.search.selected)
