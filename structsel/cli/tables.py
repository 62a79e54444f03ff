"""Results as tables that fit 80 columns."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from structsel.formatting import format_number
from structsel.metrics import in_tables
from structsel.recording import Recording
from structsel.selection import Selection
from structsel.validation import Validation

_WORDS = 10
LEGEND = (
    "std error and interval: with the structure's own uncertainty where resampled; F: partial F; "
    "incl.: share of the resampled selections that kept the term; VIF: variance inflation; left out: predicting, in "
    "turn, manoeuvres (parts of a single one) left out of the selection."
)
_GOOD, _POOR = 0.8, 0.5  # inclusion above and below which a term is shown as sure and as doubtful


def plain_table(*heads: str, words: Iterable[str], left: int = 1) -> Table:
    """Make a table whose first columns stand left, the others right.

    Where it is too wide, the last of the left columns, which holds `words`, gives way down to `_WORDS`.
    """
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 0, 0, 1), collapse_padding=True)
    longest = max([len(heads[left - 1]), *map(len, words)])
    for i, head in enumerate(heads):
        least = min(longest, _WORDS) if i == left - 1 else None
        justify: Literal["left", "right"] = "left" if i < left else "right"
        table.add_column(head, justify=justify, overflow="fold", no_wrap=i >= left, min_width=least)
    return table


def fact_line(pairs: Iterable[tuple[str, str]]) -> Text:
    """Return names, dim, and values on one line."""
    return Text("  ", style="").join(Text.assemble((f"{name} ", "dim"), value) for name, value in pairs)


def indented(console: Console, mark: str, style: str, text: str) -> None:
    """Print a paragraph behind a mark."""
    grid = Table.grid(padding=(0, 1, 0, 0))
    grid.add_column(no_wrap=True)
    grid.add_column(overflow="fold")
    grid.add_row(Text(mark, style), Text(text, style))
    console.print(grid)


def print_doubts(console: Console, doubts: Iterable[str]) -> None:
    """Print doubts, a paragraph each."""
    for doubt in doubts:
        indented(console, "!", "yellow", doubt)


def print_selection(console: Console, selection: Selection) -> None:
    """Print the terms kept for one response, the fit, and the doubts."""
    s = selection
    head = Text.assemble((s.response, "bold"), f"  {len(s.terms)} of {len(s.pool)} candidates, {s.options.method}")
    console.print(head + Text(f", {s.residual_description}"))
    if s.biased:
        console.print(Text(f"BIASED estimates: {s.estimator}", "bold red"))
    resampled = bool(s.inclusion)
    table = plain_table(
        "term",
        "value",
        "std error",
        "95 % low",
        "95 % high",
        "F",
        *(["incl."] * resampled),
        "VIF",
        words=map(str, s.terms),
    )
    for row in s.to_frame().to_dict("records"):
        share = row["inclusion"]
        shown = []
        if resampled:
            style = "green" if share >= _GOOD else "red" if share < _POOR else ""
            shown = [Text("-") if math.isnan(share) else Text(f"{100 * share:.0f}%", style)]
        table.add_row(
            Text(row["term"]),
            format_number(row["value"]),
            format_number(row["std_error"], 2),
            format_number(row["low95"]),
            format_number(row["high95"]),
            format_number(row["partial_F"], 3),
            *shown,
            format_number(row["vif"], 2),
        )
    console.print(table)
    fit = [("n", str(s.n)), ("R2", f"{s.r2:.4f}"), ("adj.", f"{s.adjusted_r2:.4f}"), ("rms", format_number(s.rms, 3))]
    if math.isfinite(s.held_out_r2):
        fit += [("left out: R2", f"{s.held_out_r2:.4f}"), ("rms", format_number(s.held_out_rms, 3))]
    console.print(fact_line(fit))
    print_doubts(console, s.doubts)
    console.print()


def print_trace(console: Console, selection: Selection) -> None:
    """Print every move of the search."""
    console.print(Text.assemble((selection.response, "bold"), f"  the search; it ended: {selection.stop_reason}"))
    moved = [f"{s.other} -> {s.term}" if s.other is not None else str(s.term) for s in selection.trace]
    table = plain_table("move", "term", "F", "partial r", "terms", "R2", "PSE", "BIC", words=moved, left=2)
    for term, s in zip(moved, selection.trace):
        figures = (format_number(s.F, 3), f"{s.partial_r:+.3f}", str(s.n_terms), f"{s.R2:.4f}", format_number(s.PSE, 3))
        table.add_row(s.action, Text(term), *figures, f"{s.BIC:.0f}")
    console.print(table)
    console.print()


def print_comparison(console: Console, response: str, by_method: Mapping[str, Selection]) -> None:
    """Print the terms and values of one response by every method, side by side."""
    console.print(Text.assemble((response, "bold"), "  by every method: value, or . where the term is not kept"))
    terms = sorted({term for s in by_method.values() for term in s.terms})
    table = plain_table("term", *by_method, words=("rms, parts left out", *map(str, terms)))
    values = {m: dict(zip(("1", *map(str, s.terms)), s.values)) for m, s in by_method.items()}
    for term in ("1", *map(str, terms)):
        table.add_row(Text(term), *(format_number(v[term]) if term in v else "." for v in values.values()))
    table.add_section()
    chosen = by_method.values()
    table.add_row("terms", *(str(len(s.terms)) for s in chosen))
    table.add_row("R2", *(f"{s.r2:.4f}" for s in chosen))
    table.add_row("R2, parts left out", *(f"{s.held_out_r2:.4f}" for s in chosen))
    table.add_row("rms, parts left out", *(format_number(s.held_out_rms, 3) for s in chosen))
    table.add_row("highest VIF", *(format_number(float(s.vif.max()), 2) if len(s.vif) else "-" for s in chosen))
    console.print(table)
    console.print()


def print_validation(console: Console, validation: Validation, title: str) -> None:
    """Print the scores of a model, response by response."""
    v = validation
    console.print(Text(title, "bold"))
    names = [score.recording for score in v.scores]
    table = plain_table("response", "recording", "n", *(m.label for m in in_tables()), "residual", words=names, left=2)
    alone = len(v.scores) == len(v.pooled)
    for pooled in v.pooled:
        rows = [s for s in v.scores if s.response == pooled.response]
        for s in rows if alone else [*rows, pooled]:
            residual = "white" if s.white else ("coloured" if math.isfinite(s.ljung_box_p) else "-")
            style = "bold" if s is pooled else ""
            table.add_row(s.response, Text(s.recording), str(s.n), *s.cells(), residual, style=style)
    console.print(table)
    size = {"rms": "rms", "std": "standard deviation", "range": "range"}[v.normaliser]
    note = f"RRMSE: rms error over the {size} of the measured response. TIC: 0 perfect, 1 useless."
    console.print(Text(note, "dim"))
    print_doubts(console, v.doubts)
    console.print()


def print_recording(console: Console, recording: Recording) -> None:
    """Print a recording's channels, units and ranges, and what the checks found."""
    r = recording
    about = f"  {len(r)} samples, t = {r.t[0]:g} to {r.t[-1]:g} s, every {r.dt:g} s, {len(r.names)} channels"
    console.print(Text.assemble((r.name, "bold"), about))
    found: dict[str, list[str]] = {}
    for f in r.findings:
        found.setdefault(f.channel, []).append(f.kind)
    table = plain_table(
        "channel", "unit", "min", "mean", "max", "found", words=[r.unit(name) for name in r.names], left=2
    )
    table.columns[-1].justify = "left"
    for name, summary in r.to_dict()["channels"].items():
        numbers = (format_number(summary[key]) for key in ("min", "mean", "max"))
        marks = Text(" " + ", ".join(dict.fromkeys(found.get(name, []))), "yellow")
        table.add_row(Text(name), Text(summary["unit"]), *numbers, marks)
    console.print(table)
    for f in r.findings:
        style = {"error": "red", "warning": "yellow"}.get(f.severity, "dim")
        indented(console, "!" if style != "dim" else "-", style, str(f))
    console.print()


def print_truth(console: Console, selection: Selection, truth: Mapping[str, float]) -> None:
    """Print a demonstration's model beside its truth."""
    s = selection
    console.print(Text.assemble((s.response, "bold"), f"  {len(s.terms)} of {len(s.pool)} candidates kept"))
    rows = {row["term"]: row for row in s.to_frame().to_dict("records")}
    terms = list(dict.fromkeys((*truth, *rows)))
    table = plain_table("term", "truth", "found", "std error", "95 % low", "95 % high", "incl.", "holds", words=terms)
    for term in terms:
        true, row = truth.get(term), rows.get(term)
        if row is None:
            table.add_row(Text(term), format_number(true), "-", "", "", "", "", Text("missed", "red"))
            continue
        if true is None:
            verdict = Text("false", "red")
        else:
            inside = row["low95"] <= true <= row["high95"]
            verdict = Text("yes" if inside else "no", "green" if inside else "yellow")
        share = "-" if math.isnan(row["inclusion"]) else f"{100 * row['inclusion']:.0f}%"
        numbers = (
            format_number(row["value"]),
            format_number(row["std_error"], 2),
            format_number(row["low95"]),
            format_number(row["high95"]),
        )
        table.add_row(Text(term), format_number(true), *numbers, share, verdict)
    console.print(table)
    facts = [("n", str(s.n)), ("R2", f"{s.r2:.4f}"), ("left out: R2", f"{s.held_out_r2:.4f}")]
    console.print(fact_line(facts))
    print_doubts(console, s.doubts)
    console.print()


def print_files(console: Console, folder: str, names: Sequence[str]) -> None:
    """Print what was written where."""
    console.print(Text(f"Written to {folder}: {', '.join(names)}."), soft_wrap=True)
