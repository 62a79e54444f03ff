"""A model as CSV: one row per response and term."""

from __future__ import annotations

from pathlib import Path

from structsel.aircraft import Aircraft
from structsel.exporting.header import fact_lines
from structsel.model import AeroModel
from structsel.tables import csv_of_frame


def write_csv(model: AeroModel, aircraft: Aircraft | None, path: Path) -> dict[Path, str]:
    """Table below comments, as ``pandas.read_csv(path, comment="#")`` reads it; numbers to the last bit."""
    lines = [f"# {line}".rstrip() for line in fact_lines(model, aircraft)]
    table = csv_of_frame(model.to_frame(), lineterminator="\n") or ""
    return {path: "\n".join(lines) + "\n" + table}
