"""Content of a page of results as data: sections with tables, warnings, and which data and methods were used."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from structsel.formatting import count_of, format_number, join_names
from structsel.provenance import file_of, sha256_of
from structsel.recording import Recording
from structsel.tables import Bar, Column, Table, text_column

Status = Literal["good", "bad", "warning"]
INTERVAL = Column("95 % interval")
"""Column of bars that `interval_bar` makes."""
INTERVAL_NOTE = (
    "Bars show the interval relative to the estimate, with a line at zero. An interval that contains zero is red: the "
    "parameter may be zero."
)


# The summary has two pages of A4, some 120 lines of 9 pt: verdict and reasons take up to 25, the time histories 40.
_PRINTED_LINES = 55
_CHART_LINES = 15
_PRINTED_COLUMNS = 90  # characters of a row of a table, above which it has two lines


@dataclass(frozen=True)
class Section:
    """A part of a page: title with badges, warnings, sentences, tables, and charts by their name.

    With `after` it is below the time histories.
    """

    title: str
    badges: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    text: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    charts: tuple[str, ...] = ()
    folded: bool = False
    after: bool = False

    @property
    def lines(self) -> int:
        """Approximate number of lines on paper."""
        tables = sum(3 + sum(1 + len("".join(row)) // _PRINTED_COLUMNS for row in one.texts()) for one in self.tables)
        return 2 + len(self.warnings) + 2 * len(self.text) + tables + _CHART_LINES * len(self.charts)


@dataclass(frozen=True)
class Part:
    """A section with its place on the page: name of its anchor, and whether the printed summary omits it."""

    section: Section
    anchor: str
    detail: bool


@dataclass(frozen=True)
class Note:
    """A sentence and its subject, which may be empty."""

    subject: str
    text: str


@dataclass(frozen=True)
class Page:
    """A page of results.

    Attributes
    ----------
    verdict, status : str
        Verdict in a word or two, and whether it is good, bad or a warning.
    headline : str
        Main result in one sentence.
    summary : tuple of str
        Further results, a sentence each.
    about : str
        Data that the result is from.
    reasons : tuple of str
        Reasons why the result is not valid; shown first.
    sections : tuple of Section
    warnings, notes : tuple of Note
    method : tuple of str
        Sentences on what was done.
    sources : Table
        Recordings and their files.
    history : tuple of Note
        Processing of the recordings before.
    data : dict
        Data of the charts.
    legend : str
        Meaning of abbreviations.
    """

    verdict: str
    status: Status
    headline: str
    summary: tuple[str, ...]
    about: str
    reasons: tuple[str, ...]
    sections: tuple[Section, ...]
    warnings: tuple[Note, ...]
    notes: tuple[Note, ...]
    method: tuple[str, ...]
    sources: Table
    history: tuple[Note, ...]
    data: dict[str, Any]
    legend: str = ""


def place_sections(sections: Sequence[Section]) -> tuple[Part, ...]:
    """Sections with their anchors; those above the time histories are printed as long as two pages have room."""
    parts, room = [], _PRINTED_LINES
    for number, one in enumerate(sections, 1):
        detail = one.after or one.folded or one.lines > room
        room -= 0 if detail else one.lines
        parts.append(Part(one, f"part-{number}", detail))
    return tuple(parts)


def bar_columns(table: Table) -> frozenset[int]:
    """Places of the columns that hold bars."""
    return frozenset(j for row in table.rows for j, cell in enumerate(row) if isinstance(cell, Bar))


def interval_bar(name: str, value: float, low: float, high: float) -> Bar | None:
    """Interval relative to its estimate: zero is at 25 % of the width, the estimate at 50 %."""
    if not value or not (abs(low) < float("inf") and abs(high) < float("inf")):
        return None
    ends = sorted((low / value, high / value))
    a, b = (round(min(100.0, max(0.0, 25.0 + 25.0 * x)), 1) for x in ends)
    style = "physics" if ends[0] > 0.0 else "delivered"
    text = f"95 % interval of {name}: {format_number(low)} to {format_number(high)}"
    # A narrow interval is drawn at least 1 % wide, so that it is visible.
    return Bar(min(a, 99.0), max(b, min(a, 99.0) + 1.0), text, style, 25.0)


def merge_notes(pairs: Iterable[tuple[str, str]]) -> tuple[Note, ...]:
    """Notes from pairs of subject and text; equal texts become one note with several subjects."""
    by_text: dict[str, list[str]] = {}
    for subject, text in pairs:
        subjects = by_text.setdefault(text, [])
        if subject and subject not in subjects:
            subjects.append(subject)
    return tuple(Note(join_names(subjects), text) for text, subjects in by_text.items())


def list_sources(recordings: Sequence[Recording], names: Sequence[str] = (), held_out: Sequence[str] = ()) -> Table:
    """Table of recordings with their files, samples and times.

    Parameters
    ----------
    recordings : sequence of Recording
    names : sequence of str
        Names of the recordings, if the recordings themselves are not given.
    held_out : sequence of str
        Those that were used for validation only.
    """
    if not recordings:
        return Table((text_column("recording"),), tuple((name,) for name in names), "Data")
    hashes: dict[Path, str] = {}
    rows = []
    for one in recordings:
        path = file_of(one.provenance)
        if path is not None and path not in hashes:
            hashes[path] = (sha256_of(path) or "-")[:16]
        file, sha256 = ("-", "-") if path is None else (path.name, hashes[path])
        use = "validation" if one.name in held_out else "used"
        times = f"{format_number(float(one.t[0]))} to {format_number(float(one.t[-1]))} s"
        rows.append((one.name, use, file, sha256, len(one), times, f"{format_number(one.dt, 3)} s"))
    words = map(text_column, ("recording", "use", "file", "SHA-256"))
    columns = (*words, Column("samples"), Column("time"), Column("interval"))
    note = f"{count_of(len(rows), 'recording')}, {sum(len(r) for r in recordings)} samples."
    return Table(columns, tuple(rows), "Data", note=note)


def list_history(recordings: Iterable[Recording]) -> tuple[Note, ...]:
    """Processing of the recordings before, from their provenance; equal lines together."""
    return merge_notes((one.name, note) for one in recordings for note in one.provenance if file_of([note]) is None)
