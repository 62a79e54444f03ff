"""The page of a proof: one Markdown text that also reads well in a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from proof.summary import Figure, Group, Summary

_COUNTED = ("Brier score", "expected calibration error", "interval overlap, median")
_HEADS = {"family": "Family", "severity": "Severity", "source": "Source", "form": "Form", "effect": "Effect (singles)"}


def page(summary: Summary, about: Sequence[str]) -> str:
    """All tables.

    Parameters
    ----------
    summary : Summary
    about : sequence of str
        Lines above the tables: cases, date, command.
    """
    parts = ["# Proof of the diagnosis", "\n".join(f"- {line}" for line in about), _figures(summary.figures)]
    parts += [_groups(head, summary.groups[by]) for by, head in _HEADS.items() if summary.groups[by]]
    if any(b.count for b in summary.reliability):
        parts.append(_reliability(summary))
    if summary.confusion:
        parts.append(_confusion(summary.confusion))
    return "\n\n".join(parts) + "\n"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Markdown table whose columns line up; all but the first are set to the right."""
    cells = [list(head), *(list(r) for r in rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(head))]
    lines = [[c.ljust(w) if k == 0 else c.rjust(w) for k, (c, w) in enumerate(zip(row, widths))] for row in cells]
    rule = ["-" * w if k == 0 else "-" * (w - 1) + ":" for k, w in enumerate(widths)]
    return "\n".join("| " + " | ".join(row) + " |" for row in (lines[0], rule, *lines[1:]))


def _value(figure: Figure) -> str:
    if math.isnan(figure.value):
        return "-"
    if figure.name.startswith("above "):
        return f"{100.0 * figure.value:+.0f} points"
    return f"{figure.value:.3f}" if figure.name in _COUNTED else _percent(figure.value)


def _percent(x: float) -> str:
    return "-" if math.isnan(x) else f"{100.0 * x:.1f} %"


def _aim(figure: Figure) -> str:
    if figure.aim is None:
        return ""
    if figure.name.startswith("above "):
        return f">= {100.0 * figure.aim:.0f} points"
    shown = f"{figure.aim:g}" if figure.name in _COUNTED else f"{100.0 * figure.aim:g} %"
    if not math.isinf(figure.top):
        return f"{100.0 * figure.aim:g} to {100.0 * figure.top:g} %"
    return f"{'<=' if figure.better == 'low' else '>='} {shown}"


def _figures(figures: Sequence[Figure]) -> str:
    rows = []
    for f in figures:
        limits = "" if f.limits is None else f"{100.0 * f.limits[0]:.1f} to {100.0 * f.limits[1]:.1f} %"
        reached = {True: "reached", False: "missed", None: ""}[f.met]
        rows.append([f.name, _value(f), limits, str(f.of), _aim(f), reached])
    return table(["figure", "value", "90 % interval", "of", "aim", ""], rows)


def _groups(head: str, groups: Sequence[Group]) -> str:
    columns = {"top1": "first", "tie": "or tie", "top3": "of three", "kind": "kind", "axis": "response"}
    rows = [
        [
            g.name,
            str(g.cases),
            *(_percent(g.rates[c]) for c in columns),
            _percent(g.gain),
            "-" if math.isnan(g.iou) else f"{g.iou:.2f}",
        ]
        for g in groups
    ]
    return f"## {head}\n\n" + table([head.split(" (")[0].lower(), "cases", *columns.values(), "gain", "overlap"], rows)


def _reliability(summary: Summary) -> str:
    rows = [
        [f"{k / 10:.1f} to {(k + 1) / 10:.1f}", str(b.count), _percent(b.stated), _percent(b.right)]
        for k, b in enumerate(summary.reliability)
        if b.count
    ]
    return "## Reliability\n\n" + table(["stated probability", "claims", "mean stated", "right"], rows)


def _confusion(confusion: Mapping[str, Mapping[str, int]]) -> str:
    rows = []
    for truth, named in confusion.items():
        total = sum(named.values())
        others = ", ".join(f"{n} {count}" for n, count in named.items() if n != truth)
        rows.append([truth, f"{named.get(truth, 0)} of {total}", others])
    return "## What was named first\n\n" + table(["truth", "right", "otherwise"], rows)
