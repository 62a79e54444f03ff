"""Selections of several responses from the same recordings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from structsel.errors import SelectionError
from structsel.model import AeroModel
from structsel.results import Result
from structsel.selection.result import Selection
from structsel.tables import Summary

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, repr=False, eq=False)
class Selections(Result, Mapping[str, Selection]):
    """Selections of several responses from the same recordings; a mapping by response."""

    by_response: Mapping[str, Selection]

    def __post_init__(self) -> None:
        """Make the mapping read-only."""
        object.__setattr__(self, "by_response", MappingProxyType(dict(self.by_response)))

    def __contains__(self, response: object) -> bool:
        return response in self.by_response

    def __getitem__(self, response: str) -> Selection:
        if response not in self.by_response:
            raise SelectionError(f"No selection for {response!r}; there is one for {', '.join(self.by_response)}.")
        return self.by_response[response]

    def __iter__(self) -> Iterator[str]:
        return iter(self.by_response)

    def __len__(self) -> int:
        return len(self.by_response)

    @property
    def model(self) -> AeroModel:
        """All responses as one model."""
        first = next(iter(self.by_response.values()))
        return AeroModel({r: s.to_model() for r, s in self.items()}, recordings=first.recordings)

    def to_frame(self) -> pd.DataFrame:
        """One row per response and parameter."""
        import pandas as pd

        return pd.concat([s.to_frame() for s in self.values()], ignore_index=True)

    def to_dict(self) -> dict[str, Any]:
        """Plain types, for JSON."""
        return {"schema": "structsel.selection/1", "responses": {r: s.to_dict() for r, s in self.items()}}

    def summary(self) -> Summary:
        """Summaries of the selections."""
        return Summary("", f"Selections of {', '.join(self)}", parts=tuple(s.summary() for s in self.values()))
