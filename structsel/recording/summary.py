"""Summary of a recording: its channels with their ranges, and the findings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from structsel.formatting import count_of
from structsel.nomenclature import unit_of
from structsel.recording.finding import Finding
from structsel.tables import Cell, Column, Summary, Table, text_column


def summarise(
    name: str, t: np.ndarray, channels: Mapping[str, np.ndarray], units: Mapping[str, str], findings: Sequence[Finding]
) -> Summary:
    """Channels with their units and ranges, and the findings."""
    kinds: dict[str, list[str]] = {}
    for finding in findings:
        kinds.setdefault(finding.channel, []).append(finding.kind)
    columns = [text_column("channel"), text_column("unit"), Column("min"), Column("mean"), Column("max")]
    rows: list[list[Any]] = [
        [channel, unit_of(channel, units), *range_of(values)] for channel, values in channels.items()
    ]
    if kinds:
        columns.append(text_column("found"))
        for row in rows:
            row.append(Cell(", ".join(dict.fromkeys(kinds.get(str(row[0]), []))), "warning"))
    return Summary(
        name,
        f"{len(t)} samples, t = {t[0]:g} to {t[-1]:g} s, every {np.median(np.diff(t)):g} s, "
        f"{count_of(len(channels), 'channel')}",
        tables=(Table(tuple(columns), tuple(map(tuple, rows))),),
        notes=tuple(f"- {f}" for f in findings if f.severity == "note"),
        warnings=tuple(str(f) for f in findings if f.severity != "note"),
    )


def range_of(values: np.ndarray) -> tuple[float, float, float]:
    """Smallest, mean and largest finite value; NaN if there is none."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return float("nan"), float("nan"), float("nan")
    return float(finite.min()), float(finite.mean()), float(finite.max())
