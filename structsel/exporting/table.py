"""A model as CSV: one row per response and term."""

from __future__ import annotations

from pathlib import Path

from structsel.aircraft import Aircraft
from structsel.exporting.header import fact_lines
from structsel.model import AeroModel


def write_csv(model: AeroModel, aircraft: Aircraft | None, path: Path) -> dict[Path, str]:
    """Table below comments, as ``pandas.read_csv(path, comment="#")`` reads it; numbers to the last bit."""
    lines = [f"# {line}".rstrip() for line in fact_lines(model, aircraft)]
    return {path: "\n".join(lines) + "\n" + model.to_frame().to_csv(index=False, lineterminator="\n")}
