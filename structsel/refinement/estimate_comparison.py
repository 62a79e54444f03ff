"""Estimates of the same parameters by several methods, side by side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from structsel.errors import ModelError
from structsel.formatting import format_number, format_percent
from structsel.model import AeroModel
from structsel.refinement.equation_error import EquationError
from structsel.refinement.result import Refinement
from structsel.results import Result
from structsel.tables import Column, Summary, Table, text_column

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False, repr=False)
class EstimateComparison(Result):
    """Estimates by method, with their standard deviations.

    Attributes
    ----------
    methods, parameters : tuple of str
    values, std : (p, m) array
        NaN where a method has no such parameter.
    truth : (p,) array
        NaN where it is not known.
    level : float
        Of the confidence intervals.
    """

    methods: tuple[str, ...]
    parameters: tuple[str, ...]
    values: np.ndarray
    std: np.ndarray
    truth: np.ndarray
    level: float

    def __post_init__(self) -> None:
        self.freeze()

    @property
    def intervals(self) -> np.ndarray:
        """(p, m, 2) confidence intervals, normal."""
        half = scipy.stats.norm.ppf(0.5 + self.level / 2.0) * self.std
        return np.stack([self.values - half, self.values + half], axis=2)

    @property
    def distance(self) -> np.ndarray:
        """(p, m, m) difference of two methods over the root of their variances' sum.

        Methods that use the same records have the same noise, so this understates the significance of a difference.
        """
        difference = self.values[:, :, None] - self.values[:, None, :]
        with np.errstate(divide="ignore", invalid="ignore"):
            return difference / np.sqrt(self.std[:, :, None] ** 2 + self.std[:, None, :] ** 2)

    def to_frame(self) -> pd.DataFrame:
        """One row for each parameter and method: parameter, method, value, std, low, high, truth."""
        import pandas as pd

        bounds = self.intervals
        rows = [
            {"parameter": name, "method": method, "value": self.values[i, j], "std": self.std[i, j],
             "low": bounds[i, j, 0], "high": bounds[i, j, 1], "truth": self.truth[i]}
            for i, name in enumerate(self.parameters) for j, method in enumerate(self.methods)
        ]  # fmt: skip
        return pd.DataFrame(rows)

    def to_dict(self) -> dict[str, Any]:
        """The table, as to_frame() has it."""
        rows = self.to_frame().to_dict("records")
        return {"schema": "structsel.estimate_comparison/1", "level": self.level, "rows": rows}

    def summary(self) -> Summary:
        """Estimates and half-widths of their intervals, method by method."""
        known = bool(np.isfinite(self.truth).any())
        half = scipy.stats.norm.ppf(0.5 + self.level / 2.0) * self.std
        rows = []
        for i, name in enumerate(self.parameters):
            cells = [self._cell(i, j, half[i, j]) for j in range(len(self.methods))]
            rows.append((name, *([float(self.truth[i])] if known else []), *cells))
        columns = (text_column("parameter"), *([Column("truth", "5g")] if known else []), *map(Column, self.methods))
        note = "; * where the truth lies outside" if known else ""
        table = Table(columns, tuple(rows))
        return Summary("Estimates", f"by method, intervals of {format_percent(self.level)}{note}", tables=(table,))

    def _cell(self, i: int, j: int, half: float) -> str | None:
        value, truth = self.values[i, j], self.truth[i]
        if np.isnan(value):
            return None
        return f"{value:.5g} +- {format_number(half, 2)}{' *' if abs(value - truth) > half else ''}"


Estimates = Refinement | EquationError | AeroModel | Mapping[str, tuple[float, float]]


def compare_estimates(
    estimates: Mapping[str, Estimates], *, truth: Mapping[str, float] | None = None, level: float = 0.95
) -> EstimateComparison:
    """Compare estimates of the same parameters by several methods.

    Parameters
    ----------
    estimates : mapping of method to Refinement, EquationError, AeroModel or mapping of parameter to (value, std)
        ``{"equation error": model, "two-step": model, "output error": refinement}``; a model's terms are called
        "Cm:alpha" as in a refinement of it.
    truth : mapping of parameter to float, optional
        As far as it is known.
    level : float
        Of the confidence intervals.

    Returns
    -------
    EstimateComparison
        Of the parameters of the models that at least one method has; recordings' own constants are left out.

    Raises
    ------
    ModelError
        No methods, or a level that is none.

    References
    ----------
    [K79], [M86].
    """
    if not estimates or not 0.0 < level < 1.0:
        raise ModelError(f"compare_estimates needs estimates and a level between 0 and 1; it was given level={level}.")
    tables = {method: estimates_by_name(each) for method, each in estimates.items()}
    names = list(dict.fromkeys(name for table in tables.values() for name in table))
    values, std = (
        np.array([[tables[m].get(name, (np.nan, np.nan))[i] for m in tables] for name in names]) for i in (0, 1)
    )
    known = np.array([(truth or {}).get(name, np.nan) for name in names], dtype=float)
    return EstimateComparison(tuple(tables), tuple(names), values, std, known, level)


def estimates_by_name(estimates: Estimates) -> dict[str, tuple[float, float]]:
    """Value and standard deviation of each parameter of the model."""
    if isinstance(estimates, Refinement):
        return {e.name: (e.value, e.std) for e in estimates.estimates if e.kind == "model"}
    if isinstance(estimates, EquationError):
        return {name: estimates[name] for name in estimates.names}
    if isinstance(estimates, AeroModel):
        return {
            f"{response}:{term}": (float(value), float(error))
            for response, model in estimates.responses.items()
            for term, value, error in zip(model.terms, model.values, np.asarray(model.standard_errors))
        }
    return {name: (float(value), float(std)) for name, (value, std) in estimates.items()}
