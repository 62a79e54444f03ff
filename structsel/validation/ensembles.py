"""ensemble(): the values of the models of many manoeuvres, side by side."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from structsel.candidates import Term
from structsel.errors import ModelError
from structsel.formatting import count_of
from structsel.model import AeroModel
from structsel.results import Result
from structsel.tables import Column, Summary, Table, text_column

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class TermScatter:
    """One term's values over manoeuvres.

    Attributes
    ----------
    response, term : str
    count : int
        Models that hold the term.
    mean, low, high : float
        Mean, least and greatest value.
    variance : float
        Over manoeuvres, divided by count - 1; nan for a single one.
    std_error : float
        Mean of the standard errors the models estimated; nan where none did.
    ratio : float
        Scatter over manoeuvres, the root of the variance, over ``std_error``. About 1 where the estimated
        errors are honest and the term is the same in every manoeuvre; above, they are too small or it is not.
    """

    response: str
    term: str
    count: int
    mean: float
    low: float
    high: float
    variance: float
    std_error: float
    ratio: float


_COLUMNS = {
    "response": text_column("response"),
    "term": text_column("term"),
    "count": Column("count"),
    "mean": Column("mean"),
    "low": Column("min"),
    "high": Column("max"),
    "variance": Column("variance"),
    "std_error": Column("std error"),
    "ratio": Column("ratio"),
}


@dataclass(frozen=True, repr=False, eq=False)
class Ensemble(Result):
    """Values of one model structure over many manoeuvres.

    Attributes
    ----------
    count : int
        Number of models.
    rows : tuple of TermScatter
    """

    count: int
    rows: tuple[TermScatter, ...]

    def to_frame(self) -> pd.DataFrame:
        """One row per response and term: count, mean, low, high, variance, std_error, ratio."""
        import pandas as pd

        return pd.DataFrame([asdict(row) for row in self.rows], columns=list(TermScatter.__dataclass_fields__))

    def to_dict(self) -> dict[str, Any]:
        """Return the table as plain numbers, None for what is not known."""
        rows = [asdict(row) for row in self.rows]
        for row in rows:
            row.update({k: None for k, v in row.items() if isinstance(v, float) and not math.isfinite(v)})
        return {"schema": "structsel.ensemble/1", "count": self.count, "rows": rows}

    def summary(self) -> Summary:
        """Scatter of each term."""
        table = Table.from_records(_COLUMNS, map(asdict, self.rows))
        note = "ratio: scatter over manoeuvres / mean estimated standard error."
        return Summary("", count_of(self.count, "manoeuvre"), tables=(table,), notes=(note,))


def ensemble(models: Sequence[AeroModel]) -> Ensemble:
    """Mean, least, greatest and variance of every term over models of single manoeuvres.

    Parameters
    ----------
    models : sequence of AeroModel
        One per manoeuvre. They need not hold the same terms; a term is summed up over those that do.

    Returns
    -------
    Ensemble
        Responses in the order first met, terms in their own order.

    Raises
    ------
    ModelError
        No models.

    References
    ----------
    [H17], tables 2 to 8; [M86]
    """
    if not models:
        raise ModelError("ensemble needs at least one model; it was given none.")
    found: dict[str, dict[Term, list[tuple[float, float]]]] = {}
    for model in models:
        for response, part in model.responses.items():
            assert part.standard_errors is not None
            for term, value, error in zip(part.terms, part.values, part.standard_errors):
                found.setdefault(response, {}).setdefault(term, []).append((float(value), float(error)))
    rows = [_scatter(name, term, terms[term]) for name, terms in found.items() for term in sorted(terms)]
    return Ensemble(len(models), tuple(rows))


def _scatter(response: str, term: Term, found: list[tuple[float, float]]) -> TermScatter:
    values, errors = np.array(found).T
    known = errors[np.isfinite(errors)]
    variance = float(np.var(values, ddof=1)) if len(values) > 1 else math.nan
    error = float(np.mean(known)) if len(known) else math.nan
    return TermScatter(
        response,
        str(term),
        len(values),
        float(np.mean(values)),
        float(np.min(values)),
        float(np.max(values)),
        variance,
        error,
        math.sqrt(variance) / error if error > 0 else math.nan,
    )
