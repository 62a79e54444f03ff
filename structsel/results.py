"""What every result can do: a line for the prompt, a report for people, a table for notebooks, a copy for a process."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from structsel.tables import Column, Summary, Table, one_line, text_column

if TYPE_CHECKING:
    import pandas as pd


class Summarised:
    """Something that shows itself by its `summary`."""

    def summary(self) -> Summary:
        """What is printed, as data: title, facts, tables, notes and warnings."""
        raise NotImplementedError

    def tables(self) -> tuple[Table, ...]:
        """Tables of the summary."""
        return self.summary().all_tables()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {one_line(self.summary())}>"

    def __str__(self) -> str:
        return self.summary().to_text()

    def _repr_html_(self) -> str:
        return self.summary().to_html()


class Copied:
    """Something whose read-only mappings and arrays do not prevent that it is pickled and copied."""

    def __getstate__(self) -> dict[str, Any]:
        return {name: _thawed(value) for name, value in vars(self).items()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, _restored(value))


class Result(Copied, Summarised):
    """Base of the results: frozen dataclasses whose mappings and arrays are read-only, compared by identity.

    A subclass is declared ``@dataclass(frozen=True, eq=False, repr=False)`` and has a `summary`. In ``__post_init__``
    it may call ``self.freeze()``.
    """

    def freeze(self) -> None:
        """Make mappings and arrays among the fields read-only."""
        for name, value in vars(self).items():
            object.__setattr__(self, name, _frozen(value))

    def to_frame(self) -> pd.DataFrame:
        """First table of the summary as a DataFrame, numbers unrounded; without a table, its facts."""
        import pandas as pd

        if not self.tables():
            return pd.DataFrame(self.summary().facts, columns=["name", "value"])
        table = self.tables()[0]
        return pd.DataFrame(table.rows, columns=[column.name for column in table.columns])

    def plot(self, *arguments: Any, ax: Any = None, **options: Any) -> Any:
        """Draw the result on `ax`, or in a new figure; see `structsel.plotting.plot`."""
        # By name: figures are made in a room above this one, which imports Matplotlib.
        return import_module("structsel.plotting").plot(self, *arguments, ax=ax, **options)


class NamedEstimates:
    """Values and standard errors that are found by the name of their parameter; a base in front of `Result`."""

    names: tuple[str, ...]
    values: np.ndarray
    std: np.ndarray

    def __getitem__(self, name: str) -> tuple[float, float]:
        """Value and standard error of a parameter.

        Raises
        ------
        KeyError
            It is no parameter's name.
        """
        if name not in self.names:
            raise KeyError(name)
        i = self.names.index(name)
        return float(self.values[i]), float(self.std[i])

    def to_frame(self) -> pd.DataFrame:
        """One row for each parameter: name, value, std."""
        import pandas as pd

        return pd.DataFrame({"name": self.names, "value": self.values, "std": self.std})

    def estimate_table(self, head: str, title: str = "") -> Table:
        """Values and standard errors under the heading of the names."""
        columns = (text_column(head), Column("value", "5g"), Column("std error", "2g"))
        return Table(columns, tuple(zip(self.names, self.values.tolist(), self.std.tolist())), title)


class Estimates(Result):
    """Base of results with a value and a standard error for each parameter: what users of statsmodels look for.

    Everything is a pandas object indexed by the names of the parameters. A subclass has `_estimates`.
    """

    def _estimates(self) -> tuple[Sequence[str], Any, Any, Any]:
        """Names (k,), values (k,), standard errors (k,), and degrees of freedom (k,) or a number."""
        raise NotImplementedError

    def _by_name(self, values: Any, name: str) -> pd.Series:
        import pandas as pd

        return pd.Series(
            np.array(values, dtype=float), index=pd.Index(list(self._estimates()[0]), name="term"), name=name
        )

    @property
    def params(self) -> pd.Series:
        """Values by term."""
        return self._by_name(self._estimates()[1], "value")

    @property
    def bse(self) -> pd.Series:
        """Standard errors by term."""
        return self._by_name(self._estimates()[2], "std_error")

    @property
    def tvalues(self) -> pd.Series:
        """Values over their standard errors, by term."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self._by_name(np.divide(self._estimates()[1], self._estimates()[2]), "t")

    @property
    def pvalues(self) -> pd.Series:
        """Two-sided probabilities of a larger ratio of value to standard error if the true value is zero, by term.

        From Student's t with the degrees of freedom of each error. Terms of a selection were chosen for being large:
        their probabilities are smaller than those of terms that were chosen beforehand.
        """
        return self._by_name(2.0 * scipy.stats.t.sf(np.abs(self.tvalues), self._estimates()[3]), "p")

    def conf_int(self, alpha: float = 0.05) -> pd.DataFrame:
        """Two-sided confidence intervals of level ``1 - alpha``: columns ``low`` and ``high``, a row for each term."""
        import pandas as pd

        names, values, errors, dof = self._estimates()
        half = scipy.stats.t.ppf(1.0 - alpha / 2.0, dof) * np.asarray(errors)
        index = pd.Index(list(names), name="term")
        return pd.DataFrame({"low": values - half, "high": values + half}, index=index)


class _ReadOnly(dict[Any, Any]):
    """Stands for a mapping proxy, which cannot be pickled, in a pickled or copied result."""


def _frozen(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
        return value
    if isinstance(value, dict | MappingProxyType):
        return MappingProxyType({key: _frozen(each) for key, each in value.items()})
    return value


def _thawed(value: Any) -> Any:
    if isinstance(value, MappingProxyType):
        return _ReadOnly({key: _thawed(each) for key, each in value.items()})
    return value


def _restored(value: Any) -> Any:
    if isinstance(value, _ReadOnly):
        return MappingProxyType({key: _restored(each) for key, each in value.items()})
    if isinstance(value, np.ndarray):
        value.setflags(write=False)
    return value
