"""Result of a selection: terms, values and errors, the steps of the search, and warnings."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from numpy.typing import NDArray

from structsel.candidates import Candidates, Term
from structsel.deprecation import renamed_attribute, warn_deprecated
from structsel.errors import SelectionError
from structsel.formatting import join_names
from structsel.model import AeroModel, ResponseModel
from structsel.numerics.collinearity import ConditionIndices
from structsel.numerics.noise_models import ARNoise
from structsel.recording import Recording, StoredRecording
from structsel.recording.arguments import as_recordings
from structsel.results import Estimates
from structsel.selection.diagnostics import Alias
from structsel.selection.result_tables import (
    as_dict,
    condition_frame,
    correlation_frame,
    parameter_frame,
    sample_series,
    step_frame,
    summarise,
    summarise_search,
)
from structsel.selection.settings import SelectOptions
from structsel.selection.trace import HeldOutPart, TraceStep
from structsel.tables import Summary

if TYPE_CHECKING:
    import pandas as pd

COLUMN_NOTES = (
    "std error and interval include the uncertainty of the structure where the selection was resampled; F: partial F; "
    "prob.: probability that the term belongs in the model, from resampled selections; VIF: variance inflation factor; "
    "cross-validated: each manoeuvre (part of a single one) predicted by a model selected without it."
)
"""Meaning of the columns of a selection."""


@dataclass(frozen=True, repr=False, eq=False)
class Selection(Estimates):
    """Model selected for one response, with the steps of the search.

    Attributes
    ----------
    response : str
    terms : tuple of Term
        Kept, in order of entry, the constant not among them.
    values : (1 + k,) array
        Parameters, the constant first.
    covariance : (1 + k, 1 + k) array
        Given these terms, the autocorrelation of the residuals accounted for.
    textbook_errors : (1 + k,) array
        What the formula for white residuals would have printed; nan for biased estimates.
    standard_errors : (1 + k,) array
        With the structure's own uncertainty: the larger of the conditional one and the scatter over resampled
        selections.
    error_dof : (1 + k,) array
        Degrees of freedom of the standard errors; few where they are mostly scatter between recordings.
    inclusion : mapping of str to float
        Fraction of resampled selections that kept each candidate of the pool; empty without a bootstrap.
    probability : mapping of str to float
        Probability that each candidate belongs in the model: mean over the resampled selections of its posterior
        probability by extended BIC, calibrated on simulated records; empty without a bootstrap. An included term has 1.
    partial_F : (1 + k,) array
        Squares of the values over their standard errors; nan for biased estimates.
    vif : (k,) array
    conditioning : ConditionIndices
        Condition indices and variance proportions of the constant and the kept terms [B80].
    condition : float
        Of the kept terms scaled to unit length, the constant included.
    r2, adjusted_r2, rms, n
        Of the response itself, in its own units.
    held_out : tuple of HeldOutPart
        By models selected without each part.
    held_out_r2, held_out_rms : float
        All parts together; nan without cross-validation.
    linear_held_out_r2 : float
        The same of the model of all linear terms of the pool; nan without cross-validation, or without linear terms.
    constants : mapping of recording to float
        Where each recording has a constant of its own; the first of ``values`` is then their mean by samples, with
        which a new recording is predicted, and every R2 is about the mean of each recording. Empty with one constant.
    noise_models : tuple of ARNoise
        One per recording; empty without prewhitening.
    rows : {"sampled", "causal"}
        Whether values are those of the samples, or of what the past predicts of the candidates.
    cluster_robust : bool
        Whether tests took the scatter between blocks.
    classical : tuple of Term
        Selected with white residuals.
    aliases : tuple of Alias
    dependent : tuple of Term
        Candidates the kept terms explain exactly, or that do not vary.
    trace : tuple of TraceStep
    stop_reason : str
    biased : bool
        True for principal-components and ridge estimates.
    estimator : str
        How the values were estimated.
    pool : Candidates
    options : SelectOptions
    doubts : tuple of str
    region : mapping of channel to (least, greatest)
    recordings : tuple of str
    dt : float [s]
    data : tuple of Recording or StoredRecording
        The recordings themselves, for residuals and figures. A pickled selection is without them; `with_recordings`
        adds them.
    """

    response: str
    terms: tuple[Term, ...]
    values: NDArray[np.float64]
    covariance: NDArray[np.float64]
    textbook_errors: NDArray[np.float64]
    standard_errors: NDArray[np.float64]
    error_dof: NDArray[np.float64]
    inclusion: Mapping[str, float]
    probability: Mapping[str, float]
    partial_F: NDArray[np.float64]
    vif: NDArray[np.float64]
    conditioning: ConditionIndices
    condition: float
    r2: float
    adjusted_r2: float
    rms: float
    n: int
    held_out: tuple[HeldOutPart, ...]
    held_out_r2: float
    held_out_rms: float
    linear_held_out_r2: float
    constants: Mapping[str, float]
    noise_models: tuple[ARNoise, ...]
    cluster_robust: bool
    rows: str
    classical: tuple[Term, ...]
    aliases: tuple[Alias, ...]
    dependent: tuple[Term, ...]
    trace: tuple[TraceStep, ...]
    stop_reason: str
    biased: bool
    estimator: str
    pool: Candidates
    options: SelectOptions
    doubts: tuple[str, ...]
    region: Mapping[str, tuple[float, float]]
    recordings: tuple[str, ...]
    dt: float
    data: tuple[Recording | StoredRecording, ...] = ()

    colours = renamed_attribute("noise_models")
    by_blocks = renamed_attribute("cluster_robust")
    stopped = renamed_attribute("stop_reason")
    estimated = renamed_attribute("estimator")

    def __post_init__(self) -> None:
        """Make the arrays and mappings read-only."""
        for name in ("values", "covariance", "textbook_errors", "standard_errors", "error_dof", "partial_F", "vif"):
            array = np.array(getattr(self, name), dtype=float)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        for name in ("inclusion", "probability", "region", "constants"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "data": ()}  # they may be large, and their owner has them

    def __copy__(self) -> Selection:
        return replace(self)

    def __deepcopy__(self, memo: dict[int, Any]) -> Selection:
        copied = object.__new__(type(self))
        memo[id(self)] = copied
        # Recordings cannot be changed: the copy has the same.
        copied.__setstate__({**deepcopy(self.__getstate__(), memo), "data": self.data})
        return copied

    def with_recordings(self, recordings: Any) -> Selection:
        """Selection with the recordings it was made from, which a pickled selection lacks.

        Parameters
        ----------
        recordings : Recording, DataFrame or sequence of these

        Raises
        ------
        SelectionError
            Their names are not those of the selection.
        """
        given = as_recordings(recordings, "with_recordings")
        if [one.name for one in given] != list(self.recordings):
            raise SelectionError(
                f"the selection is of the recordings {join_names(self.recordings)}, and was given "
                f"{join_names([one.name for one in given])}.",
                remedy="Pass the recordings that it was made from, in the same order.",
            )
        return replace(self, data=tuple(given))

    @property
    def dof(self) -> int:
        """Residual degrees of freedom: samples less terms and constants."""
        return self.n - len(self.terms) - max(len(self.constants), 1)

    def intervals(self, level: float = 0.95) -> NDArray[np.float64]:
        """Two-sided intervals (1 + k, 2) with the structure's uncertainty, the constant first; nan where biased."""
        if self.biased:
            return np.full((self.values.size, 2), np.nan)
        half = scipy.stats.t.ppf(0.5 + level / 2, self.error_dof) * self.standard_errors
        return np.column_stack([self.values - half, self.values + half])

    @property
    def residual_description(self) -> str:
        """How the residuals were treated, in words."""
        if self.rows == "causal":
            return f"causal rows, coloured residuals, {self._ar_orders}"
        if self.cluster_robust:
            return "coloured residuals, cluster-robust tests"
        if not self.noise_models:
            return "white residuals, standard errors corrected for autocorrelation"
        return f"coloured residuals, {self._ar_orders}"

    @property
    def _ar_orders(self) -> str:
        orders = [c.order for c in self.noise_models]
        span = str(orders[0]) if min(orders) == max(orders) else f"{min(orders)} to {max(orders)}"
        return f"AR order {span}"

    def _estimates(self) -> tuple[list[str], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        dof = np.full(self.values.size, np.nan) if self.biased else self.error_dof
        return ["1", *map(str, self.terms)], self.values, self.standard_errors, dof

    @property
    def fittedvalues(self) -> pd.Series:
        """The model on the recordings of the selection, each with its own constant where it has one; see `predict`."""
        return self._over_samples(self._fitted, self.response)

    @property
    def resid(self) -> pd.Series:
        """Response minus `fittedvalues`."""
        return self._over_samples(lambda one: one[self.response] - self._fitted(one), "residual")

    def predict(self, recordings: Any = None) -> pd.Series:
        """Response by the model, with the mean constant.

        Parameters
        ----------
        recordings : Recording, DataFrame or sequence of these, optional
            Without any, `fittedvalues` are returned.

        Returns
        -------
        Series
            By time, or by recording and time if there are several.

        Raises
        ------
        ChannelError, TermError
            A channel is missing, or a formula does not hold.
        """
        if recordings is None:
            return self.fittedvalues
        model = self.to_model()
        return self._over_samples(model.evaluate, self.response, as_recordings(recordings, "predict"))

    def _fitted(self, recording: Recording) -> NDArray[np.float64]:
        """The model on a recording of the selection."""
        own = self.constants.get(recording.name, self.values[0]) - self.values[0]
        return self.to_model().evaluate(recording) + own

    def _over_samples(self, values: Any, name: str, recordings: Any = None) -> pd.Series:
        """Samples of a function of a recording, by time."""
        return sample_series(self.data if recordings is None else recordings, values, name)

    @property
    def model(self) -> AeroModel:
        """The selection as an AeroModel of one response."""
        return AeroModel({self.response: self.to_model()}, recordings=self.recordings)

    def __getitem__(self, response: str) -> Selection:
        """Return the selection itself: `select` with one response returned a mapping before."""
        if response != self.response:
            raise SelectionError(
                f"the selection is of {self.response!r}, not of {response!r}.",
                remedy=f"Select both: select(recordings, [{self.response!r}, {response!r}], candidates).",
            )
        warn_deprecated(f"selection[{response!r}] of one response", "selection")
        return self

    __iter__ = None  # else Python would call __getitem__ with numbers

    def to_model(self) -> ResponseModel:
        """The selection as a model of its response."""
        return ResponseModel(
            terms=(Term("1"), *self.terms),
            values=self.values,
            covariance=self.covariance,
            standard_errors=self.standard_errors,
            error_dof=self.error_dof,
            method=f"{self.options.method}, {self.estimator}",
            residuals=self.residual_description,
            biased=self.biased,
            ranges=self.region,
            n=self.n,
            s2=self.rms**2 * self.n / max(self.dof, 1),
            r2=self.r2,
            constants=self.constants,
        )

    def to_frame(self) -> pd.DataFrame:
        """One row per parameter, the constant first."""
        return parameter_frame(self)

    def collinearity_frame(self) -> pd.DataFrame:
        """Condition indices, ascending, and the fraction of each parameter's variance that comes with each.

        Two or more fractions above 0.5 with an index above 30 name terms that depend on one another [B80].
        """
        return condition_frame(self)

    def correlation_frame(self) -> pd.DataFrame:
        """Correlation of the parameters, the terms taken as given; the constant first."""
        return correlation_frame(self)

    def trace_frame(self) -> pd.DataFrame:
        """One row per move of the search."""
        return step_frame(self)

    def to_dict(self) -> dict[str, Any]:
        """Plain types, for JSON; not a number is None."""
        return as_dict(self)

    def summary(self) -> Summary:
        """Terms, estimates and fit."""
        return summarise(self)

    def search_summary(self) -> Summary:
        """Every move of the search."""
        return summarise_search(self)
