"""Summaries of several results side by side, for the command line."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from structsel.formatting import format_decimals, format_number
from structsel.tables import Cell, Column, Summary, Table, text_column

if TYPE_CHECKING:  # each command imports what it shows
    from structsel.inputs import Scatter
    from structsel.reconstruction import Reconstruction
    from structsel.recording import Recording
    from structsel.selection import Selection

_MOTION = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "h", "ax", "ay", "az")
_MAX_PARAMETERS = 5  # in one table


def summarise_methods(response: str, by_method: Mapping[str, Selection]) -> Summary:
    """Terms and estimates of one response by every selection method."""
    chosen = by_method.values()
    terms = ("1", *map(str, sorted({term for s in chosen for term in s.terms})))
    values = [dict(zip(("1", *map(str, s.terms)), s.values)) for s in chosen]
    rows: list[tuple[Any, ...]] = [(term, *(v.get(term, ".") for v in values)) for term in terms]
    rows += [
        ("terms", *(len(s.terms) for s in chosen)),
        ("R2", *(format_decimals(s.r2) for s in chosen)),
        ("cross-validated R2", *(format_decimals(s.held_out_r2) for s in chosen)),
        ("cross-validated rms", *(format_number(s.held_out_rms, 3) for s in chosen)),
        ("highest VIF", *(format_number(float(s.vif.max()), 2) if len(s.vif) else None for s in chosen)),
    ]
    table = Table((text_column("term"), *map(Column, by_method)), tuple(rows), rules=(len(terms),))
    return Summary(response, "estimates of each method; . where the term is not selected", tables=(table,))


def summarise_truth(selection: Selection, truth: Mapping[str, float]) -> Summary:
    """Estimates of a demonstration with the true values."""
    s = selection
    found = {row["term"]: row for row in s.to_frame().to_dict("records")}
    rows: list[tuple[Any, ...]] = []
    for term in dict.fromkeys((*truth, *found)):
        true, row = truth.get(term), found.get(term)
        if row is None:
            rows.append((term, true, "-", "", "", "", "", Cell("missed", "bad")))
            continue
        inside = Cell("false", "bad")
        if true is not None:
            inside = Cell("yes", "good") if row["low95"] <= true <= row["high95"] else Cell("no", "warning")
        rows.append(
            (term, true, *(row[key] for key in ("value", "std_error", "low95", "high95", "probability")), inside)
        )
    columns = (text_column("term"), Column("truth"), Column("estimate"), Column("std error", "2g"),
               Column("95 % low"), Column("95 % high"), Column("prob.", "%"), text_column("inside"))  # fmt: skip
    return Summary(
        s.response,
        f"{len(s.terms)} of {len(s.pool)} candidates kept",
        facts=(("n", str(s.n)), ("R2", f"{s.r2:.4f}"), ("cross-validated R2", f"{s.held_out_r2:.4f}")),
        tables=(Table(columns, tuple(rows)),),
        warnings=s.doubts,
    )


def summarise_reconstructions(by_method: Mapping[str, Reconstruction]) -> Summary:
    """Constants and residuals of one manoeuvre, for each method that could reconstruct it."""
    from structsel.reconstruction import CONSTANTS  # of use to one command

    results = list(by_method.values())
    names = [name for name in CONSTANTS if any(c.name == name for one in results for c in one.constants)]
    numbers = [column for method in by_method for column in (Column(method), Column("std", "2g"))]
    rows = []
    for name in names:
        cells: list[Any] = []
        for one in results:
            constant = next((c for c in one.constants if c.name == name), None)
            cells += [".", ""] if constant is None else [constant.value, constant.std]
        rows.append((name, *cells, CONSTANTS[name][1]))
    constants = Table((text_column("constant"), *numbers, text_column("unit")), tuple(rows))
    residuals = tuple(
        (c.channel, *(one.consistency[c.channel].residual_rms for one in results), _unit(results[0], c.channel))
        for c in results[0].consistency.channels
    )
    columns = (text_column("residual rms"), *(Column(method, "3g") for method in by_method), text_column("unit"))
    warnings: dict[str, list[str]] = {}
    for method, one in by_method.items():
        for text in one.doubts:
            warnings.setdefault(text, []).append(method)
    verdicts = (f"{method}: {one.verdict}" for method, one in by_method.items())
    return Summary(
        results[0].name,
        ", ".join(verdicts),
        alerts=tuple(f"{method}: {reason}" for method, one in by_method.items() for reason in one.distrust),
        tables=(*([constants] if names else []), Table(columns, residuals)),
        notes=tuple(dict.fromkeys(note for one in results for note in one.summary().notes if "not estimated" in note)),
        warnings=tuple(f"{', '.join(methods)}: {text}" for text, methods in warnings.items()),
    )


def _unit(result: Reconstruction, channel: str) -> str:
    return next((level.unit for level in result.noise if level.channel == channel), "")


def summarise_simulation(simulated: Recording, recorded: Recording | None, error: str) -> Summary:
    """Ranges of the channels of a simulation and of the recording."""
    names = [n for n in _MOTION if n in simulated] or list(simulated.names)
    columns = [text_column("channel"), text_column("unit"), Column("start"), Column("min"), Column("max")]
    rows: list[tuple[Any, ...]] = [(n, simulated.unit(n), *_range(simulated[n])) for n in names]
    if recorded is not None:
        columns += [Column("recorded min"), Column("max")]
        rows = [(*row, *_range(recorded[n] if n in recorded else np.empty(0))[1:]) for n, row in zip(names, rows)]
    return Summary(
        simulated.name,
        f"{len(simulated)} samples, t = {simulated.t[0]:g} to {simulated.t[-1]:g} s",
        alerts=(f"STOPPED EARLY at t = {simulated.t[-1]:g} s",) if error else (),
        tables=(Table(tuple(columns), tuple(rows)),),
    )


def _range(values: np.ndarray) -> tuple[float, float, float]:
    finite = values[np.isfinite(values)]
    return (float(values[0]), float(finite.min()), float(finite.max())) if len(finite) else (math.nan,) * 3


def summarise_scatter(found: Sequence[Scatter]) -> Summary:
    """Scatter of the estimates of repeated simulations over the Cramer-Rao bound, for each input."""
    names = found[0].parameters
    tables = []
    for first in range(0, len(names), _MAX_PARAMETERS):
        some = slice(first, first + _MAX_PARAMETERS)
        rows = tuple((one.name, len(one.estimates), one.lost, *(one.std / one.crlb)[some]) for one in found)
        numbers = (Column("simulations"), Column("lost"), *(Column(name, "3f") for name in names[some]))
        tables.append(Table((text_column("input"), *numbers), rows))
    error = 1.0 / math.sqrt(2.0 * (len(found[0].estimates) - 1))
    return Summary(
        "Repeated simulations",
        "standard deviation of the estimates over the Cramer-Rao bound",
        tables=tuple(tables),
        notes=(
            f"Output error with known noise; 1 within {error:.2g}, one standard deviation, if the bound is reached.",
        ),
    )
