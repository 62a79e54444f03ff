"""What every result can do: a line for the prompt, a report for people, a table for notebooks, a copy for a process."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from structsel.tables import Summary, Table, one_line

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


class Result(Summarised):
    """Base of the results: frozen dataclasses whose mappings and arrays are read-only, compared by identity.

    A subclass is declared ``@dataclass(frozen=True, eq=False, repr=False)`` and has a `summary`. In ``__post_init__``
    it may call ``self.freeze()``.
    """

    def freeze(self) -> None:
        """Make mappings and arrays among the fields read-only."""
        for name, value in vars(self).items():
            object.__setattr__(self, name, _frozen(value))

    def to_frame(self) -> pd.DataFrame:
        """First table of the summary as a DataFrame, numbers unrounded."""
        import pandas as pd

        table = self.tables()[0]
        return pd.DataFrame(table.rows, columns=[column.name for column in table.columns])

    def __getstate__(self) -> dict[str, Any]:
        return {name: _thawed(value) for name, value in vars(self).items()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, _restored(value))


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
