"""A selection as plain types, as data frames and as tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from structsel.errors import SelectionError
from structsel.formatting import format_number
from structsel.recording import StoredRecording
from structsel.selection.trace import TraceStep
from structsel.tables import Cell, Column, Summary, Table, Tone, text_column

if TYPE_CHECKING:
    import pandas as pd

_COLUMNS = {
    "term": text_column("term"),
    "value": Column("value"),
    "std_error": Column("std error", "2g"),
    "low95": Column("95 % low"),
    "high95": Column("95 % high"),
    "partial_F": Column("F", "3g"),
    "probability": Column("prob.", "%"),
    "vif": Column("VIF", "2g"),
}
_TRACE_COLUMNS = {
    "action": text_column("move"),
    "term": text_column("term"),
    "F": Column("F", "3g"),
    "partial_r": Column("partial r", "3f"),
    "n_terms": Column("terms"),
    "R2": Column("R2", "4f"),
    "PSE": Column("PSE", "3g"),
    "BIC": Column("BIC", "0f"),
}


PRINTED = 0.01  # least probability of a candidate in to_dict()


def _tone(probability: float) -> Tone:
    return "good" if probability >= 0.8 else "bad" if probability < 0.5 else ""


def as_dict(selection: Any) -> dict[str, Any]:
    """Plain types, for JSON; not a number is None."""

    def plain(x: float) -> float | None:
        return float(x) if np.isfinite(x) else None

    frame = selection.to_frame().drop(columns="response")
    rows = [{k: (plain(v) if isinstance(v, float) else v) for k, v in r.items()} for r in frame.to_dict("records")]
    return {
        "response": selection.response,
        "method": selection.options.method,
        "residuals": selection.residual_description,
        "biased": selection.biased,
        "parameters": rows,
        "fit": {k: plain(getattr(selection, k)) for k in ("r2", "adjusted_r2", "rms", "condition")},
        "n": selection.n,
        "condition_indices": [plain(x) for x in selection.conditioning.indices],
        "constants": {name: plain(value) for name, value in selection.constants.items()},
        "held_out": {
            "r2": plain(selection.held_out_r2),
            "linear_r2": plain(selection.linear_held_out_r2),
            "rms": plain(selection.held_out_rms),
            "parts": [{"name": p.name, "r2": plain(p.r2), "rms": plain(p.rms)} for p in selection.held_out],
        },
        "inclusion": {k: float(v) for k, v in selection.inclusion.items() if v > 0},
        "probability": {k: float(v) for k, v in selection.probability.items() if v > PRINTED},
        "classical_terms": [str(t) for t in selection.classical],
        "aliases": [
            {"kept": str(a.kept), "other": str(a.other), "loss": a.loss, "to_separate": a.to_separate}
            for a in selection.aliases
        ],
        "dependent": [str(t) for t in selection.dependent],
        "trace": [str(s) for s in selection.trace],
        "stopped": selection.stop_reason,
        "doubts": list(selection.doubts),
    }


def summarise(selection: Any) -> Summary:
    """Terms, estimates and fit."""
    facts = [("n", str(selection.n)), ("R2", f"{selection.r2:.4f}"), ("adjusted R2", f"{selection.adjusted_r2:.4f}")]
    facts += [("rms", format_number(selection.rms, 3))]
    if np.isfinite(selection.held_out_r2):
        facts += [
            ("cross-validated R2", f"{selection.held_out_r2:.4f}, rms {format_number(selection.held_out_rms, 3)}")
        ]
    if np.isfinite(selection.linear_held_out_r2):
        facts += [("of the linear model", f"{selection.linear_held_out_r2:.4f}")]
    if selection.constants:
        spread = np.std(list(selection.constants.values()), ddof=1) if len(selection.constants) > 1 else 0.0
        facts += [("constants", f"own of each recording, scatter {format_number(float(spread), 3)}")]
    columns = {key: column for key, column in _COLUMNS.items() if key != "probability" or selection.probability}
    records: Any = selection.to_frame().to_dict("records")
    for row in records:
        row["probability"] = Cell(row["probability"], _tone(row["probability"]))
    return Summary(
        selection.response,
        f"{len(selection.terms)} of {len(selection.pool)} candidate terms, {selection.options.method}, "
        f"{selection.residual_description}",
        alerts=(f"BIASED estimates: {selection.estimator}; std error is the scatter about a biased mean",)
        if selection.biased
        else (),
        facts=tuple(facts),
        tables=(Table.from_records(columns, records),),
        warnings=selection.doubts,
    )


def summarise_search(selection: Any) -> Summary:
    """Every move of the search."""
    records = ({**vars(s), "term": f"{s.other} -> {s.term}" if s.other else str(s.term)} for s in selection.trace)
    table = Table.from_records(_TRACE_COLUMNS, records)
    return Summary(selection.response, f"the search; it ended: {selection.stop_reason}", tables=(table,))


def parameter_frame(selection: Any) -> pd.DataFrame:
    """One row per parameter, the constant first."""
    import pandas as pd

    low, high = selection.intervals().T
    names = ["1", *map(str, selection.terms)]
    return pd.DataFrame(
        {
            "response": selection.response,
            "term": names,
            "value": selection.values,
            "std_error": selection.standard_errors,
            "low95": low,
            "high95": high,
            "textbook_error": selection.textbook_errors,
            "partial_F": selection.partial_F,
            "inclusion": [np.nan, *(selection.inclusion.get(n, np.nan) for n in names[1:])],
            "probability": [np.nan, *(selection.probability.get(n, np.nan) for n in names[1:])],
            "vif": [np.nan, *selection.vif],
        }
    )


def condition_frame(selection: Any) -> pd.DataFrame:
    """Condition indices, ascending, and the fraction of each parameter's variance that comes with each."""
    import pandas as pd

    names = ["1", *map(str, selection.terms)]
    fractions = pd.DataFrame(selection.conditioning.proportions, columns=names)
    fractions.insert(0, "condition_index", selection.conditioning.indices)
    return fractions


def correlation_frame(selection: Any) -> pd.DataFrame:
    """Correlation of the parameters, the terms taken as given; the constant first."""
    import pandas as pd

    names = ["1", *map(str, selection.terms)]
    root = np.sqrt(np.diag(selection.covariance))
    root = np.where(root > 0, root, 1.0)
    return pd.DataFrame(selection.covariance / np.outer(root, root), index=names, columns=names)


def step_frame(selection: Any) -> pd.DataFrame:
    """One row per move of the search."""
    import pandas as pd

    rows = [{**vars(s), "term": str(s.term), "other": str(s.other or "")} for s in selection.trace]
    return pd.DataFrame(rows, columns=list(TraceStep.__dataclass_fields__))


def sample_series(recordings: Any, values: Any, name: str) -> pd.Series:
    """Samples of a function of a recording, by time, or by recording and time if there are several."""
    import pandas as pd

    if not recordings:
        raise SelectionError(
            "the selection has no recordings: it was pickled, or not made by select().",
            remedy="Use predict(recordings), or selection.with_recordings(recordings).",
        )
    read = [one.read() if isinstance(one, StoredRecording) else one for one in recordings]
    parts = {one.name: pd.Series(values(one), index=pd.Index(one.t, name="t"), name=name) for one in read}
    return next(iter(parts.values())) if len(parts) == 1 else pd.concat(parts, names=["recording", "t"])
