"""model.json: its schema, read and written completely or not at all."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Annotated, Any, NoReturn

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from structsel.errors import ModelError
from structsel.files import write_text
from structsel.model.file_checks import ObjectPairs, find_contradictions, find_duplicate_keys

SCHEMA = "structsel.model/1"


class _Strict(BaseModel):
    model_config = ConfigDict(defer_build=True, extra="forbid", strict=True, allow_inf_nan=False)


class _Response(_Strict):
    terms: list[str]
    values: list[float]
    standard_errors: list[float | None] | None = None
    error_dof: list[float] | None = None
    covariance: list[list[float]] | None = None
    method: str = ""
    residuals: str = ""
    biased: bool = False
    region: dict[str, Annotated[list[float], Field(min_length=2, max_length=2)]] = {}
    n: int = Field(default=0, ge=0)
    s2: float | None = None
    r2: float | None = None
    constants: dict[str, float] = {}
    held: list[str] = []


class _Quantity(_Strict):
    value: float
    std: float | None = None
    unit: str = ""


class _State(_Strict):
    kind: str
    input: str
    parameters: dict[str, _Quantity] = {}


class _Model(_Strict):
    schema_: str = Field(alias="schema")
    name: str = ""
    recordings: list[str] = []
    provenance: dict[str, Any] = {}
    states: dict[str, _State] = {}
    responses: dict[str, _Response]


def read(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read and check a model file.

    Raises
    ------
    ModelError
        The file is missing, is not JSON, has another schema or version, does not fit it, has a key twice, or numbers
        that contradict each other; the message names the file and the place in it.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ModelError(f"Model file '{path}' cannot be read: {error}.") from error
    if not text.strip():
        raise ModelError(f"Model file '{path}' is empty. Write it again with AeroModel.to_json().")
    try:
        held = json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=ObjectPairs)
    except (ValueError, RecursionError) as error:
        raise ModelError(f"Model file '{path}' is not JSON: {error}.") from error
    found = held.get("schema") if isinstance(held, dict) else None
    if found != SCHEMA:
        raise ModelError(
            f'Model file \'{path}\' needs "schema": "{SCHEMA}"; it has {json.dumps(found)}. '
            "A file of another kind or version cannot be read as a model."
        )
    if twice := next(find_duplicate_keys(held), ""):
        raise ModelError(f"Model file '{path}': {twice}. Which of the two holds is not known; delete one.")
    try:
        content = _Model.model_validate(held).model_dump(by_alias=True)
    except ValidationError as error:
        faults = [f"  {'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors()[:5]]
        more = f"\n  and {error.error_count() - 5} more" if error.error_count() > 5 else ""
        found = "\n".join(faults) + more
        raise ModelError(f"Model file '{path}' does not fit {SCHEMA}:\n{found}") from error
    if wrong := next(find_contradictions(content["responses"]), ""):
        raise ModelError(f"Model file '{path}', {wrong}. Write the file again with AeroModel.to_json().")
    return content


def write(path: str | os.PathLike[str], content: dict[str, Any], overwrite: bool) -> None:
    """Write a model file; a former one remains until the new one is complete.

    Raises
    ------
    ModelError
        The file exists and ``overwrite`` is False, or it cannot be written.
    """
    path = Path(path)
    if path.exists() and not overwrite:
        raise ModelError(
            f"Model file '{path}' exists.",
            remedy="Choose another name, or pass overwrite=True.",
            cli_remedy="Choose another name, or pass --overwrite.",
        )
    text = json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    try:
        write_text(path, text)
    except OSError as error:
        raise ModelError(f"Model file '{path}' cannot be written: {error.strerror or error}.") from error


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a JSON number; null denotes an unknown value")
