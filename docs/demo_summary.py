"""The table and the picture of the README: `python docs/demo_summary.py` prints the one and writes docs/demo.png.

Both show the result of `structsel demo --json`: all six models, with what was missed.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("agg")

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from typer.testing import CliRunner

from structsel import compute_all, demo_flights
from structsel.cli import app, demo
from structsel.model import AeroModel
from structsel.plotting import plot_fit

PICTURE = Path(__file__).parent / "demo.png"
_GOOD, _BAD = "#00838f", "#c62828"


def run_demo() -> dict[str, Any]:
    """What `structsel demo --json` prints."""
    return json.loads(CliRunner().invoke(app, ["demo", "--json", "--quiet"]).stdout)


def counts(result: dict[str, Any]) -> list[tuple[str, int, int, int, int, int]]:
    """Of each response: terms kept, true terms missed, false terms, intervals that contain the truth, intervals."""
    rows = []
    for response, found in result["responses"].items():
        truth = result["truth"][response]
        terms = {one["term"]: one for one in found["parameters"]}
        inside = sum(one["low95"] <= truth.get(term, 0.0) <= one["high95"] for term, one in terms.items())
        rows.append(
            (response, len(terms) - 1, len(truth.keys() - terms), len(terms.keys() - truth), inside, len(terms))
        )
    return rows


def table(result: dict[str, Any]) -> str:
    """The table in Markdown."""
    lines = ["| response | terms kept of 164 | true terms missed | false terms | 95 % intervals with the truth |"]
    lines.append("| --- | --- | --- | --- | --- |")
    rows = counts(result)
    for response, kept, missed, false, inside, intervals in rows:
        lines.append(f"| {response} | {kept} | {missed} | {false} | {inside} of {intervals} |")
    kept, missed, false, inside, intervals = (sum(row[k] for row in rows) for k in range(1, 6))
    return "\n".join([*lines, f"| all six | {kept} | {missed} | {false} | {inside} of {intervals} |"])


def draw(result: dict[str, Any]) -> Figure:
    """A flight that was held out, and the error of each parameter."""
    figure = Figure(figsize=(9.2, 3.6), layout="constrained", dpi=90)
    left, right = figure.subfigures(1, 2, width_ratios=(1.15, 1.0))
    terms = {r: {p["term"]: p["value"] for p in one["parameters"]} for r, one in result["responses"].items()}
    flights, aircraft, _ = demo_flights(demo.VALIDATION + 1, turbulence=demo.TURBULENCE)
    held = compute_all([*flights[: demo.TRAINING], flights[-1]], aircraft)[-1]
    top, _ = plot_fit(AeroModel.from_terms(terms), held, "Cm", ax=left)
    top.set_title("Pitching moment of a flight that was not used", fontsize=9)
    axes = right.subplots()
    _draw_errors(axes, result)
    return figure


def _draw_errors(axes: Axes, result: dict[str, Any]) -> None:
    """Estimate minus truth in standard errors, one point for each parameter of the six models."""
    place, ticks = 0, []
    for response, found in result["responses"].items():
        first = place
        for one in found["parameters"]:
            half = 0.5 * (one["high95"] - one["low95"])
            middle = 0.5 * (one["high95"] + one["low95"])
            error = (middle - result["truth"][response].get(one["term"], 0.0)) / half
            axes.plot(place, error, "o", ms=4, color=_GOOD if abs(error) <= 1.0 else _BAD)
            if abs(error) > 1.0:
                axes.annotate(
                    f"{response} {one['term']}", (place, error), xytext=(4, 3), textcoords="offset points", fontsize=7
                )
            place += 1
        ticks.append((0.5 * (first + place - 1), response))
        axes.axvline(place - 0.5, color="0.85", lw=0.8)
    axes.axhspan(-1.0, 1.0, color=_GOOD, alpha=0.12, lw=0)
    axes.axhline(0.0, color="0.4", lw=0.8)
    axes.set_xticks([x for x, _ in ticks], [name for _, name in ticks])
    axes.set_xlim(-0.5, place + 1.5)
    axes.margins(y=0.12)  # room for the names of the highest points
    axes.set_ylabel("error / half of the 95 % interval [-]")
    axes.set_title("Estimated minus true value of each parameter", fontsize=9)


if __name__ == "__main__":
    found = run_demo()
    draw(found).savefig(PICTURE, metadata={"Software": None})
    print(table(found))
