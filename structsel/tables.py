"""Content of a printed result as data: title, facts, tables, notes and warnings; and the same as text and as HTML.

A result builds one `Summary`. Plain text, a notebook, the terminal and an HTML report all show that summary.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

from structsel.formatting import UNDEFINED, csv_text, format_decimals, format_number, format_percent, printable

if TYPE_CHECKING:
    from jinja2 import Template

Tone = Literal["", "good", "bad", "warning", "dim"]
_MAX_ROWS = 60  # of a table in a notebook


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Attributes
    ----------
    name : str
        Heading of the column.
    format : str
        Format of the numbers: ``"4g"`` four significant digits, ``"3f"`` three decimals, ``"%"`` a fraction in percent.
        None, nan and infinity are shown as a dash.
    unit : str
        Shown behind the name; empty where rows have units of their own.
    align : {"right", "left"}
    detail : bool
        Whether to omit the column where a terminal is too narrow for the table.
    wrap : bool
        Whether a cell may take several lines of a page.
    note : str
        Meaning of the column; shown below the table.
    """

    name: str
    format: str = "4g"
    unit: str = ""
    align: Literal["right", "left"] = "right"
    detail: bool = False
    wrap: bool = False
    note: str = ""

    @property
    def head(self) -> str:
        """Name and unit."""
        return printable(f"{self.name} [{self.unit}]" if self.unit else self.name)

    def show(self, value: Any) -> str:
        """Return a cell of this column as text."""
        if isinstance(value, Cell):
            return self.show(value.value)
        if value is None:
            return UNDEFINED
        if isinstance(value, Bar | Link):
            return printable(value.text)
        if isinstance(value, bool) or type(value).__name__ == "bool_":
            return "yes" if value else "no"
        if isinstance(value, int) or not isinstance(value, float):
            # A name with a line break must not look like a row of its own.
            return printable(str(value)) if self.wrap else " ".join(printable(str(value)).split("\n"))
        if self.format == "%":
            return format_percent(value)
        digits, kind = int(self.format[:-1]), self.format[-1]
        return (format_number if kind == "g" else format_decimals)(float(value), digits)


def text_column(name: str, **options: Any) -> Column:
    """Column of words, aligned left."""
    return Column(name, align="left", **options)


@dataclass(frozen=True)
class Cell:
    """A value with a tone: where colours can be shown, good is green, bad red and warning yellow."""

    value: Any
    tone: Tone


@dataclass(frozen=True)
class Bar:
    """A cell that an HTML page draws as a bar; elsewhere its text is shown.

    Attributes
    ----------
    low, high : float
        Ends of the bar, in percent of the width of the cell.
    text : str
        The same in words, for screen readers and for plain text.
    style : str
        CSS class of the bar: which stage of a model it belongs to.
    zero, mark : float or None
        Positions of a thin line at zero and of a thick mark, in percent of the width.
    """

    low: float
    high: float
    text: str
    style: str = "physics"
    zero: float | None = None
    mark: float | None = None


@dataclass(frozen=True)
class Link:
    """A cell that refers to another page in the same folder."""

    text: str
    page: str


@dataclass(frozen=True)
class Table:
    """Rows under columns.

    Attributes
    ----------
    columns : tuple of Column
    rows : tuple of tuple
        Strings, numbers, None, `Cell`, `Bar` or `Link`, one for each column.
    title : str
        Shown above the table.
    rules : tuple of int
        Rows that an empty line precedes.
    note : str
        Shown below the table.
    """

    columns: tuple[Column, ...]
    rows: tuple[tuple[Any, ...], ...]
    title: str = ""
    rules: tuple[int, ...] = ()
    note: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "title", printable(self.title))
        object.__setattr__(self, "note", printable(self.note))

    @classmethod
    def from_records(cls, columns: Mapping[str, Column], records: Iterable[Mapping[str, Any]], **options: Any) -> Table:
        """Table of records, the cell of each column found under its key."""
        rows = tuple(tuple(record[key] for key in columns) for record in records)
        return cls(tuple(columns.values()), rows, **options)

    @property
    def legend(self) -> str:
        """Meaning of the columns that have a note, and the note of the table."""
        columns = "; ".join(f"{column.name}: {column.note}" for column in self.columns if column.note)
        return " ".join(text for text in (f"{columns}." if columns and self.note else columns, self.note) if text)

    def with_column(self, place: int, column: Column, cells: Iterable[Any]) -> Table:
        """Table with one more column in front of the one at `place`."""
        rows = tuple((*row[:place], cell, *row[place:]) for row, cell in zip(self.rows, cells, strict=True))
        return replace(self, columns=(*self.columns[:place], column, *self.columns[place:]), rows=rows)

    def without_column(self, place: int) -> Table:
        """Table without the column at `place`."""
        rows = tuple(row[:place] + row[place + 1 :] for row in self.rows)
        return replace(self, columns=self.columns[:place] + self.columns[place + 1 :], rows=rows)

    def texts(self) -> list[list[str]]:
        """Cells as text, row by row."""
        return [[column.show(cell) for column, cell in zip(self.columns, row)] for row in self.rows]

    def to_text(self, indent: str = "") -> str:
        """Plain text, columns aligned."""
        rows = [[column.head for column in self.columns], *self.texts()]
        widths = [max(len(row[j]) for row in rows) for j in range(len(self.columns))]
        lines = [
            "  ".join(
                cell.ljust(width) if column.align == "left" else cell.rjust(width)
                for cell, width, column in zip(row, widths, self.columns)
            ).rstrip()
            for row in rows
        ]
        for rule in reversed(self.rules):
            lines.insert(1 + rule, "")
        title = [self.title] if self.title else []
        return "\n".join(f"{indent}{line}".rstrip() for line in (*title, *lines))


@dataclass(frozen=True)
class Summary:
    """Content of a printed result.

    Attributes
    ----------
    title : str
        Subject of the result: a response, a recording, a model.
    about : str
        Description in a few words; follows the title.
    alerts : tuple of str
        Restrictions that a reader must know before the numbers; shown first.
    facts : tuple of (name, value)
        Scalars.
    tables : tuple of Table
    notes : tuple of str
        Meaning of the columns, and further steps that were done.
    warnings : tuple of str
        Reasons why a number may be wrong.
    parts : tuple of Summary
        Summaries of the parts of a result that has several.
    """

    title: str
    about: str = ""
    alerts: tuple[str, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()
    tables: tuple[Table, ...] = ()
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    parts: tuple[Summary, ...] = ()

    def __post_init__(self) -> None:
        for field in ("title", "about"):
            object.__setattr__(self, field, printable(getattr(self, field)))
        for field in ("alerts", "notes", "warnings"):
            object.__setattr__(self, field, tuple(map(printable, getattr(self, field))))
        object.__setattr__(self, "facts", tuple((printable(name), printable(value)) for name, value in self.facts))

    @property
    def head(self) -> str:
        """Title and description on one line."""
        return f"{self.title}: {self.about}" if self.title and self.about else self.title or self.about

    @property
    def fact_line(self) -> str:
        """Facts on one line."""
        return "   ".join(f"{name} {value}" for name, value in self.facts)

    @property
    def caption(self) -> str:
        """Lines above the numbers of the first table."""
        titles = [self.tables[0].title] if self.tables else []
        return "\n".join(line for line in (self.head, *self.alerts, self.fact_line, *titles) if line)

    def all_tables(self) -> tuple[Table, ...]:
        """Tables of this summary and of its parts."""
        return self.tables + tuple(table for part in self.parts for table in part.all_tables())

    def to_text(self) -> str:
        """Plain text; a warning begins with an exclamation mark."""
        opening = [self.head] if self.head else []
        opening += [f"  ! {text}" for text in self.alerts]
        opening += [f"  {self.fact_line}"] if self.facts else []
        legends = dict.fromkeys(table.legend for table in self.tables if table.legend)
        closing = [*legends, *self.notes, *(f"  ! {text}" for text in self.warnings)]
        blocks = ["\n".join(opening), *(table.to_text("  ") for table in self.tables), "\n".join(closing)]
        own = ("\n\n" if len(self.tables) > 1 else "\n").join(block for block in blocks if block)
        return "\n\n".join([*([own] if own else []), *(part.to_text() for part in self.parts)])

    def to_html(self) -> str:
        """HTML for part of a page, such as a notebook cell; text from data is escaped."""
        return _template().render(summary=self, max_rows=_MAX_ROWS, zip=zip)


# Colours are those of the notebook, so that a dark theme applies to the table too.
_TEMPLATE = """\
{% macro show(table, caption) %}
<table style="border-collapse: collapse; font-variant-numeric: tabular-nums">
<caption style="caption-side: top; text-align: left; white-space: pre-line; font-weight: bold">{{ caption }}</caption>
{% if table %}
<thead><tr>
{% for column in table.columns %}
<th scope="col" style="text-align: {{ column.align }}">{{ column.head }}</th>
{% endfor %}
</tr></thead>
<tbody>
{% for row in table.texts()[:max_rows] %}
<tr>
{% for cell, column in zip(row, table.columns) %}
<td style="text-align: {{ column.align }}">{{ "\N{EN DASH}" if cell == "-" else cell }}</td>
{% endfor %}
</tr>
{% endfor %}
</tbody>
{% endif %}
</table>
{% if table and table.legend %}
<p>{{ table.legend }}</p>
{% endif %}
{% if table and table.rows|length > max_rows %}
<p>{{ table.rows|length - max_rows }} more rows are not shown.</p>
{% endif %}
{% endmacro %}
{% macro write(summary) %}
{{ show(summary.tables[0] if summary.tables else none, summary.caption) }}
{% for table in summary.tables[1:] %}
{{ show(table, table.title) }}
{% endfor %}
{% if summary.notes or summary.warnings %}
<ul>
{% for note in summary.warnings + summary.notes %}
<li>{{ note }}</li>
{% endfor %}
</ul>
{% endif %}
{% for part in summary.parts %}
{{ write(part) }}
{% endfor %}
{% endmacro %}
{{ write(summary) }}
"""


@cache
def _template() -> Template:
    # Jinja takes a while to import, and only notebooks need it here.
    from jinja2 import Environment

    return Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True).from_string(_TEMPLATE)


def rows_of_frame(frame: Any, columns: Mapping[str, Column]) -> tuple[tuple[Any, ...], ...]:
    """Rows of a DataFrame with these columns, in this order."""
    return tuple(frame[list(columns)].itertuples(index=False, name=None))


def table_of_frame(frame: Any, digits: int = 4) -> Table:
    """Table of the columns of a DataFrame, numbers with `digits` digits and words aligned left."""
    numeric = {name: frame[name].dtype.kind in "iuf" for name in frame.columns}
    columns = {
        name: Column(str(name), f"{digits}g") if numeric[name] else text_column(str(name)) for name in frame.columns
    }
    return Table(tuple(columns.values()), rows_of_frame(frame, columns))


def csv_of_frame(frame: Any, path: Any = None, **options: Any) -> str | None:
    """Write a DataFrame as CSV without its index, or return the text; no cell is a formula to a spreadsheet."""
    words = frame.select_dtypes(exclude="number").columns
    safe = frame.copy()
    for name in words:
        safe[name] = safe[name].map(_csv_cell)
    written: str | None = safe.rename(columns=_csv_cell).to_csv(path, index=False, **options)
    return written


def _csv_cell(value: Any) -> Any:
    return csv_text(printable(value)) if isinstance(value, str) else value


def one_line(summary: Summary) -> str:
    """Title of a summary on one line of at most 160 characters."""
    text = " ".join(summary.head.split())
    return text if len(text) <= 160 else f"{text[:157]}..."
