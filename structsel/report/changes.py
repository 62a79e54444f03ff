"""Changes between two results of the same kind: what a page shows of a result before."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from structsel.diagnosis.result import Diagnosis
from structsel.errors import ArgumentError, DataError
from structsel.formatting import count_of, format_decimals, format_estimate, format_number, format_probability
from structsel.reconstruction import Reconstructions
from structsel.refinement import Refinement
from structsel.report.page_model import Section
from structsel.selection import Selections
from structsel.tables import Table, text_column

Result = Diagnosis | Selections | Reconstructions | Refinement
_Facts = Iterator[tuple[tuple[str, str], str]]
_NONE = "-"  # where a result does not have a value
_HELD_OUT_R2 = "R², held-out"


def changes_of(result: Result, before: Any) -> Section:
    """Section with the values that differ from those of a result before.

    Parameters
    ----------
    result : Diagnosis, Selections, Reconstructions or Refinement
    before : same, or str or Path
        A result of the same kind, or the JSON file of one.

    Raises
    ------
    ArgumentError, DataError
        `before` is of another kind, or no file of a result.
    """
    schema, facts_of = _KINDS[type(result)]
    new = dict(facts_of(result.to_dict()))
    old = dict(facts_of(_content(before, type(result), schema)))
    # In the order of the new result; values that only the old one has follow their subject.
    keys = sorted({**new, **old}, key=_order([*new, *old]))
    rows = tuple((*key, old.get(key, _NONE), new.get(key, _NONE)) for key in keys if old.get(key) != new.get(key))
    same = len(keys) - len(rows)
    text = f"{count_of(len(rows), 'value')} differ{'s' * (len(rows) == 1)} from the result before, {same} do not."
    columns = (text_column("result"), text_column("quantity"), text_column("before"), text_column("now"))
    return Section("Changes", text=(text,), tables=(Table(columns, rows),) if rows else ())


def read_result(path: str | Path, schema: str) -> Mapping[str, Any]:
    """Content of the JSON file of a result.

    Raises
    ------
    DataError
        It is no such file.
    """
    path = Path(path)
    try:
        content: Mapping[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        stated = str(content.get("schema", ""))
    except (OSError, ValueError, AttributeError) as error:
        raise DataError(f"'{path}' is no JSON file of a result: {error}.") from error
    if not stated.startswith(f"{schema}/"):
        raise DataError(
            f"'{path}' cannot be compared with this result: its schema is '{stated or 'none'}', not '{schema}'.\n"
            "Give the JSON file that an earlier run of this command wrote."
        )
    return content


def _order(keys: list[tuple[str, str]]) -> Callable[[tuple[str, str]], tuple[int, int]]:
    """Position of a key: that of its subject, then its own."""
    subjects, own = list(dict.fromkeys(subject for subject, _ in keys)), list(dict.fromkeys(keys))
    return lambda key: (subjects.index(key[0]), own.index(key))


def _content(before: Any, kind: type, schema: str) -> Mapping[str, Any]:
    """Content of a result, or of its file."""
    if isinstance(before, kind):
        content: Mapping[str, Any] = before.to_dict()  # type: ignore[attr-defined]
        return content
    if not isinstance(before, str | Path):
        raise ArgumentError(
            f"write_report compares a {kind.__name__} with another one; before= is a {type(before).__name__}.",
            remedy="Pass an earlier result of the same function, or the path of its JSON file.",
        )
    return read_result(before, schema)


def _selections(content: Mapping[str, Any]) -> _Facts:
    for response, one in content["responses"].items():
        held_out = one.get("held_out") or {}
        yield (response, _HELD_OUT_R2), format_decimals(held_out.get("r2"))
        yield (response, "rms error, held-out"), format_number(held_out.get("rms"), 3)
        yield (response, "terms"), str(len(one["parameters"]) - 1)
        for p in one["parameters"]:
            yield (response, p["term"]), _estimate(p["value"], p["std_error"])


def _refinement(content: Mapping[str, Any]) -> _Facts:
    yield ("refined model", "verdict"), content["verdict"]
    if comparison := content.get("comparison"):
        errors = comparison["refined"]
        yield ("refined model", "relative error, held-out"), format_number(sum(errors) / max(len(errors), 1), 3)
    for p in content["parameters"]:
        if p["kind"] == "model":
            yield ("parameters", p["name"]), _estimate(p["value"], p["std"])
    for fit in content["fits"]:
        yield (fit["output"], f"R², {fit['recording']}"), format_decimals(fit["r2"])


def _reconstructions(content: Mapping[str, Any]) -> _Facts:
    for one in content["done"]:
        yield (one["name"], "verdict"), one["verdict"]
        yield (one["name"], "NIS"), format_number(one["consistency"]["nis"], 3)
        for c in one["constants"]:
            yield (one["name"], c["name"]), _estimate(c["value"], c["std"], c["unit"])
    for name in content["failed"]:
        yield (name, "verdict"), "not reconstructed"


def _diagnosis(content: Mapping[str, Any]) -> _Facts:
    yield ("diagnosis", "verdict"), content["verdict"]
    for finding in content["findings"]:
        first = finding["physics"][0]
        yield (first["effect"], "probability"), format_probability(first["probability"])
        for name, p in first["parameters"].items():
            yield (first["effect"], name), _estimate(p["value"], p["std"], p["unit"])
    for response, left in content["remaining"].items():
        yield (response, "RRMSE with the effects, held-out"), format_decimals(left["rrmse"], 3)


def _estimate(value: float | None, std: float | None, unit: str = "") -> str:
    """Value with its standard error, if it is known."""
    if value is None:
        return _NONE
    return format_estimate(value, float("nan") if std is None else std, unit, "±")


_KINDS: dict[type, tuple[str, Callable[[Mapping[str, Any]], _Facts]]] = {
    Diagnosis: ("structsel.diagnosis", _diagnosis),
    Reconstructions: ("structsel.reconstructions", _reconstructions),
    Refinement: ("structsel.refinement", _refinement),
    Selections: ("structsel.selection", _selections),
}
