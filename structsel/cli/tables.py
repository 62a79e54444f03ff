"""Summaries and tables of results in the terminal, within 80 columns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from structsel.formatting import printable
from structsel.tables import Cell, Column, Summary, Table

_LEAST_WIDTH = 10  # characters of a column of words if the table is too wide
_STYLES = {"good": "green", "bad": "bold red", "warning": "yellow", "dim": "dim", "": ""}


def print_summary(console: Console, summary: Summary) -> None:
    """Print the summary of a result: title, facts, tables, notes and warnings, then the summaries of its parts."""
    if summary.head:
        about = Text(f"  {summary.about}" if summary.title else summary.about)
        console.print(Text(summary.title, "bold") + about)
    for text in summary.alerts:
        indented(console, "!", "red", text)
    if summary.facts:
        console.print(Text("  ").join(Text.assemble((f"{name} ", "dim"), value) for name, value in summary.facts))
    for table in summary.tables:
        print_table(console, table)
    for text in summary.notes:
        console.print(Text(text, "dim"))
    print_warnings(console, summary.warnings)
    console.print()
    for part in summary.parts:
        print_summary(console, part)


def print_table(console: Console, table: Table) -> None:
    """Print a table; columns of detail that do not fit are left out, the last one first."""
    shown = table
    while _width(shown) > console.width and any(column.detail for column in shown.columns):
        shown = shown.without_column(max(j for j, column in enumerate(shown.columns) if column.detail))
    if shown.title:
        console.print(Text(shown.title, "bold"))
    rich = RichTable(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 0, 0, 1), collapse_padding=True)
    folding = _folding_column(shown)
    for j, column in enumerate(shown.columns):
        least = min(_width_of(shown, j), _LEAST_WIDTH) if j == folding else None
        rich.add_column(column.head, justify=column.align, overflow="fold", no_wrap=j != folding, min_width=least)
    for i, row in enumerate(shown.rows):
        if i in shown.rules:
            rich.add_section()
        rich.add_row(*(_cell(column, value) for column, value in zip(shown.columns, row)))
    console.print(rich)
    if shown.legend:
        console.print(Text(shown.legend, "dim"))


def _cell(column: Column, value: object) -> Text:
    return Text(column.show(value), _STYLES[value.tone] if isinstance(value, Cell) else "")


def _width_of(table: Table, j: int) -> int:
    return max(len(table.columns[j].head), *(len(table.columns[j].show(row[j])) for row in table.rows), 0)


def _width(table: Table) -> int:
    return sum(_width_of(table, j) + 2 for j in range(len(table.columns))) - 2


def _folding_column(table: Table) -> int | None:
    """The widest column of words, which is wrapped if the table is too wide."""
    words = [j for j, column in enumerate(table.columns) if column.align == "left"]
    return max(words, key=lambda j: _width_of(table, j), default=None)


def indented(console: Console, mark: str, style: str, text: str) -> None:
    """Print a paragraph after a mark."""
    grid = RichTable.grid(padding=(0, 1, 0, 0))
    grid.add_column(no_wrap=True)
    grid.add_column(overflow="fold")
    grid.add_row(Text(mark, style), Text(text, style))
    console.print(grid)


def print_warnings(console: Console, warnings: Iterable[str]) -> None:
    """Print each warning as a paragraph."""
    for text in warnings:
        indented(console, "!", "yellow", text)


def print_files(console: Console, folder: str, names: Sequence[str]) -> None:
    """Print the names of the files that were written."""
    console.print(Text(printable(f"Written to {folder}: {', '.join(names)}.")), soft_wrap=True)
