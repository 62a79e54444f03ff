"""What a page of results is made of: sections of tables, doubts, and what was done with which data."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from structsel.formatting import count_of, format_number, join_names
from structsel.metrics import in_tables
from structsel.provenance import file_of, sha256_of
from structsel.recording import Recording


@dataclass(frozen=True)
class Bar:
    """A stretch of a track, in percent of its length.

    Attributes
    ----------
    low, high : float
    says : str
        For those who do not see it.
    ink : str
    zero : float or None
        Where zero is.
    """

    low: float
    high: float
    says: str
    ink: str = "physics"
    zero: float | None = None


@dataclass(frozen=True)
class Link:
    """A page beside this one."""

    says: str
    page: str


@dataclass(frozen=True)
class PageColumn:
    """Head of a column, and what stands in it; a word does not wrap, a text does."""

    name: str
    kind: Literal["name", "word", "text", "number", "bar", "link"] = "number"


@dataclass(frozen=True)
class PageTable:
    """Rows of strings, and of bars (or None) or links where the column says so."""

    columns: tuple[PageColumn, ...]
    rows: tuple[tuple[str | Bar | Link | None, ...], ...]
    caption: str = ""
    note: str = ""

    @property
    def slim(self) -> bool:
        """Whether it need not be as wide as the page."""
        return all(column.kind != "bar" for column in self.columns)


@dataclass(frozen=True)
class Section:
    """A part of the page: its title, sentences, tables, and figures by their name."""

    title: str
    chips: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    text: tuple[str, ...] = ()
    tables: tuple[PageTable, ...] = ()
    charts: tuple[str, ...] = ()
    folded: bool = False


@dataclass(frozen=True)
class Remark:
    """What is said about something."""

    about: str
    text: str


@dataclass(frozen=True)
class Sheet:
    """A page.

    Attributes
    ----------
    verdict, tone : str
        In a word, and whether it is good, bad or a doubt.
    headline, about : str
        The finding as a person would say it, and what it rests on.
    lead : tuple of str
        What else a person would say at once.
    reasons : tuple of str
        Why not to believe it; said first.
    sections : tuple of Section
    doubts, notes : tuple of Remark
    done : tuple of str
        What was done.
    sources : PageTable
        With which data.
    history : tuple of Remark
        What was done to these before.
    data : dict
        Of the figures.
    legend : str
    """

    verdict: str
    tone: Literal["good", "bad", "doubt"]
    headline: str
    lead: tuple[str, ...]
    about: str
    reasons: tuple[str, ...]
    sections: tuple[Section, ...]
    doubts: tuple[Remark, ...]
    notes: tuple[Remark, ...]
    done: tuple[str, ...]
    sources: PageTable
    history: tuple[Remark, ...]
    data: dict[str, Any]
    legend: str = ""


def columns(**kinds: str) -> tuple[PageColumn, ...]:
    """Columns by name; underscores stand for blanks."""
    return tuple(PageColumn(name.replace("_", " "), kind) for name, kind in kinds.items())  # type: ignore[arg-type]


def metric_columns() -> dict[str, str]:
    """Columns of the metrics in short tables, as `columns` takes them."""
    return {metric.label.replace("R2", "R²"): "number" for metric in in_tables(brief=True)}


def interval_bar(name: str, value: float, low: float, high: float) -> Bar | None:
    """An interval about a value, relative to it: zero stands at a quarter of the track, the value at a half."""
    if not value or not (abs(low) < float("inf") and abs(high) < float("inf")):
        return None
    ends = sorted((low / value, high / value))
    a, b = (round(min(100.0, max(0.0, 25.0 + 25.0 * x)), 1) for x in ends)
    ink = "physics" if ends[0] > 0.0 else "delivered"
    says = f"95 % interval of {name}: {format_number(low)} to {format_number(high)}"
    # A sure value has an interval too narrow to be seen.
    return Bar(min(a, 99.0), max(b, min(a, 99.0) + 1.0), says, ink, 25.0)


def merge_remarks(said: Iterable[tuple[str, str]]) -> tuple[Remark, ...]:
    """Remarks from pairs of what they are about and what they say; alike ones together."""
    about: dict[str, list[str]] = {}
    for name, text in said:
        names = about.setdefault(text, [])
        if name and name not in names:
            names.append(name)
    return tuple(Remark(join_names(names), text) for text, names in about.items())


def list_sources(recordings: Sequence[Recording], names: Sequence[str] = (), held_out: Sequence[str] = ()) -> PageTable:
    """Recordings with their files, samples and span.

    Parameters
    ----------
    recordings : sequence of Recording
    names : sequence of str
        Of recordings that went in, where they are not at hand.
    held_out : sequence of str
        Of them, those that only judge.
    """
    if not recordings:
        head = columns(recording="name")
        return PageTable(head, tuple((name,) for name in names), "The data")
    cached: dict[Path, str] = {}
    rows = []
    for one in recordings:
        path = file_of(one.provenance)
        if path is not None and path not in cached:
            cached[path] = (sha256_of(path) or "-")[:16]
        origin = "-" if path is None else path.name
        use = "validation" if one.name in held_out else "used"
        span = f"{format_number(float(one.t[0]))} to {format_number(float(one.t[-1]))} s"
        rows.append((one.name, use, origin, cached.get(path, "-") if path else "-", str(len(one)), span,
                     f"{format_number(one.dt, 3)} s"))  # fmt: skip
    head = columns(
        recording="name", use="word", file="word", SHA_256="word", samples="number", span="number", every="number"
    )
    note = f"{count_of(len(rows), 'recording')}, {sum(len(r) for r in recordings)} samples."
    return PageTable(head, tuple(rows), "The data", note)


def conversions(recordings: Iterable[Recording]) -> tuple[Remark, ...]:
    """What was done to the recordings before, from their provenance; alike lines together."""
    return merge_remarks((one.name, note) for one in recordings for note in one.provenance if file_of([note]) is None)
