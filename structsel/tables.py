"""What a result shows, as data: a title, facts, tables, notes and warnings; and the same as text and as HTML.

A result builds one `Summary`. Plain text, a notebook, the terminal and an HTML report all show that summary.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

from structsel.formatting import UNDEFINED, format_decimals, format_number, format_percent

if TYPE_CHECKING:
    from jinja2 import Template

Tone = Literal["", "good", "bad", "warning", "dim"]
_MOST_ROWS = 60


@dataclass(frozen=True)
class Column:
    """One column of a table.

    Attributes
    ----------
    name : str
        Head of the column.
    format : str
        Of its numbers: ``"4g"`` four significant digits, ``"3f"`` three decimals, ``"%"`` percent of a fraction. None
        and what is not finite are a dash.
    unit : str
        Shown behind the name; empty where rows have units of their own.
    align : {"right", "left"}
    detail : bool
        Left out where a terminal is too narrow for the table.
    note : str
        What the column means; shown below the table if the column is.
    """

    name: str
    format: str = "4g"
    unit: str = ""
    align: Literal["right", "left"] = "right"
    detail: bool = False
    note: str = ""

    @property
    def head(self) -> str:
        """Name and unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    def show(self, value: Any) -> str:
        """Return a cell of this column as text."""
        if isinstance(value, Cell):
            return self.show(value.value)
        if value is None:
            return UNDEFINED
        if isinstance(value, bool) or type(value).__name__ == "bool_":
            return "yes" if value else "no"
        if isinstance(value, int) or not isinstance(value, float):
            return str(value)
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
class Table:
    """Rows under columns.

    Attributes
    ----------
    columns : tuple of Column
    rows : tuple of tuple
        Strings, numbers, None or `Cell`, one for each column.
    title : str
        Above the table.
    rules : tuple of int
        Rows before which a line is left free.
    """

    columns: tuple[Column, ...]
    rows: tuple[tuple[Any, ...], ...]
    title: str = ""
    rules: tuple[int, ...] = ()

    @classmethod
    def from_records(cls, columns: Mapping[str, Column], records: Iterable[Mapping[str, Any]], **options: Any) -> Table:
        """Table of records, the cell of each column found under its key."""
        rows = tuple(tuple(record[key] for key in columns) for record in records)
        return cls(tuple(columns.values()), rows, **options)

    @property
    def legend(self) -> str:
        """Meaning of the columns that have a note."""
        return "; ".join(f"{column.name}: {column.note}" for column in self.columns if column.note)

    def texts(self) -> list[list[str]]:
        """Cells as text, row by row."""
        return [[column.show(cell) for column, cell in zip(self.columns, row)] for row in self.rows]

    def to_text(self, indent: str = "") -> str:
        """Lines of aligned columns."""
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
    """What a result shows.

    Attributes
    ----------
    title : str
        What it is about: a response, a recording, a model.
    about : str
        Behind the title, in a few words.
    alerts : tuple of str
        What must be known before the numbers are read; shown first.
    facts : tuple of (name, value)
        Scalars.
    tables : tuple of Table
    notes : tuple of str
        What the columns mean, and what else was done.
    warnings : tuple of str
        Reasons to doubt the numbers.
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

    @property
    def head(self) -> str:
        """Title and what stands behind it, as one line."""
        return f"{self.title}: {self.about}" if self.title and self.about else self.title or self.about

    @property
    def fact_line(self) -> str:
        """Facts as one line."""
        return "   ".join(f"{name} {value}" for name, value in self.facts)

    @property
    def caption(self) -> str:
        """Everything above the numbers of the first table, line by line."""
        titles = [self.tables[0].title] if self.tables else []
        return "\n".join(line for line in (self.head, *self.alerts, self.fact_line, *titles) if line)

    def all_tables(self) -> tuple[Table, ...]:
        """Tables of this summary and of its parts."""
        return self.tables + tuple(table for part in self.parts for table in part.all_tables())

    def to_text(self) -> str:
        """Plain text: warnings stand behind an exclamation mark."""
        opening = [self.head] if self.head else []
        opening += [f"  ! {text}" for text in self.alerts]
        opening += [f"  {self.fact_line}"] if self.facts else []
        legends = dict.fromkeys(table.legend for table in self.tables if table.legend)
        closing = [*legends, *self.notes, *(f"  ! {text}" for text in self.warnings)]
        blocks = ["\n".join(opening), *(table.to_text("  ") for table in self.tables), "\n".join(closing)]
        own = ("\n\n" if len(self.tables) > 1 else "\n").join(block for block in blocks if block)
        return "\n\n".join([*([own] if own else []), *(part.to_text() for part in self.parts)])

    def to_html(self) -> str:
        """HTML that belongs inside a page, such as a notebook's; whatever comes from data is escaped."""
        return _template().render(summary=self, most=_MOST_ROWS, zip=zip)


# Colours are the notebook's own, so that the table is at home on a dark page too.
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
{% for row in table.texts()[:most] %}
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
{% if table and table.rows|length > most %}
<p>{{ table.rows|length - most }} more rows are not shown.</p>
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
    # Templates take a while to load, and only notebooks need them here.
    from jinja2 import Environment

    return Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True).from_string(_TEMPLATE)


def rows_of_frame(frame: Any, columns: Mapping[str, Column]) -> tuple[tuple[Any, ...], ...]:
    """Rows of a DataFrame, the columns chosen and ordered."""
    return tuple(frame[list(columns)].itertuples(index=False, name=None))


def table_of_frame(frame: Any, columns: Mapping[str, Column] | None = None, digits: int = 4, **options: Any) -> Table:
    """Table of a DataFrame; without `columns` all of them, numbers in `digits` digits and words aligned left."""
    if columns is None:
        numeric = {name: frame[name].dtype.kind in "iuf" for name in frame.columns}
        columns = {
            name: Column(str(name), f"{digits}g") if numeric[name] else text_column(str(name)) for name in frame.columns
        }
    return Table(tuple(columns.values()), rows_of_frame(frame, columns), **options)


def one_line(summary: Summary, most: int = 160) -> str:
    """Title of a summary on one line of limited length."""
    text = " ".join(summary.head.split())
    return text if len(text) <= most else f"{text[: most - 3]}..."
