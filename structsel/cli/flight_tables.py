"""Trims, modes, flights, replays, inputs and refinements as tables that fit 80 columns."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from rich.console import Console
from rich.text import Text

from structsel.cli.tables import fact_line, plain_table, print_doubts
from structsel.cli.terminal import in_commands
from structsel.formatting import format_number
from structsel.inputs import Information, InputComparison, Scatter
from structsel.metrics import in_tables
from structsel.nomenclature import is_known, unit_of
from structsel.numerics.linear_modes import Modes
from structsel.recording import Recording
from structsel.refinement import Estimate, Refinement
from structsel.simulation import Trim
from structsel.validation import Resimulation
from structsel.validation.resimulation import KINDS, table_heads

_MOTION = ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "h", "ax", "ay", "az")
_PER_RECORDING = ("start", "jump", "drift", "bias")
_TOGETHER = 5  # parameters beside one another
_ANGLES = ("alpha", "beta", "phi", "theta", "p", "q", "r")


def print_trim(console: Console, trim: Trim, name: str) -> None:
    """Print a steady flight: what holds it, and how nearly it is balanced."""
    held = trim.to_dict()
    console.print(Text.assemble((name, "bold"), "  steady flight"))
    facts = [("V", f"{format_number(held['V'])} m/s"), ("h", f"{format_number(held['h'])} m")]
    facts += [("climb", f"{math.degrees(trim.climb):.4g} deg")] * bool(trim.climb)
    facts += [("turn", f"{math.degrees(trim.turn_rate):.4g} deg/s")] * bool(trim.turn_rate)
    console.print(fact_line(facts))
    table = plain_table("quantity", "value", "unit", "degrees", "", words=(*_ANGLES, *trim.controls))
    table.columns[2].justify = table.columns[4].justify = "left"
    for n in _ANGLES:
        if held[n] or n in ("alpha", "theta"):
            table.add_row(n, format_number(held[n]), f" {unit_of(n)}", f"{math.degrees(held[n]):.3f}", "")
    for n, value in trim.controls.items():
        angle = f"{math.degrees(value):.3f}" if unit_of(n) == "rad" else ""
        unit = unit_of(n) if is_known(n) else ""
        table.add_row(n, format_number(value), f" {unit}", angle, " found" if n in trim.free else " given")
    console.print(table)
    worst = max(trim.unbalance, key=lambda n: abs(trim.unbalance[n]))
    console.print(Text(f"unbalanced at most {abs(trim.unbalance[worst]):.1g} in {worst}", "dim"))
    console.print()


def print_modes(console: Console, modes: Modes, title: str) -> None:
    """Print the modes of small motions, the fastest first."""
    console.print(Text.assemble((title, "bold"), "  modes"))
    table = plain_table(
        "mode", "real 1/s", "imag 1/s", "rad/s", "damping", "T s", "half s", "period s", words=modes.names
    )
    table.columns[0].no_wrap = True
    for i, z in enumerate(modes.eigenvalues):
        half = modes.time_to_half[i]
        when = format_number(half, 3) if np.isfinite(half) else f"{format_number(modes.time_to_double[i], 3)} double"
        figures = (
            format_number(modes.frequency[i]),
            f"{modes.damping[i]:.4f}",
            format_number(modes.time_constant[i], 3),
        )
        imaginary = f"{z.imag:.5f}" if z.imag else "-"
        row = (modes.names[i], f"{z.real:.5f}", imaginary, *figures, when, format_number(modes.period[i], 3))
        table.add_row(*row, style="red" if z.real > 0.0 else "")
    console.print(table)
    console.print()


def print_flight(console: Console, flight: Recording, recorded: Recording | None, broken: str) -> None:
    """Print how far a flight went and where it ranged, beside what was recorded."""
    ended = Text(f"  BROKE OFF at t = {flight.t[-1]:g} s", "bold red") if broken else Text("")
    about = f"  {len(flight)} samples, t = {flight.t[0]:g} to {flight.t[-1]:g} s"
    console.print(Text.assemble((flight.name, "bold"), about) + ended)
    names = [n for n in _MOTION if n in flight] or list(flight.names)
    more = ("recorded min", "max") if recorded is not None else ()
    table = plain_table("channel", "unit", "start", "min", "max", *more, words=[flight.unit(n) for n in names], left=2)
    for n in names:
        row = [flight[n][0], flight[n].min(), flight[n].max()]
        if recorded is not None:
            seen = recorded[n][np.isfinite(recorded[n])] if n in recorded else np.empty(0)
            row += [seen.min(), seen.max()] if len(seen) else [math.nan, math.nan]
        table.add_row(n, flight.unit(n), *(format_number(float(x)) for x in row))
    console.print(table)
    console.print()


def print_replay(console: Console, result: Resimulation, title: str) -> None:
    """Print the scores of flights with recorded inputs, in windows and whole, and where they parted."""
    console.print(Text(title, "bold"))
    several = len(result.recordings) > 1
    first, *more = table_heads()
    heads = ("output", f"{result.window:g} s: {first}", *more, f"whole: {first}", *more)
    for name in (*(r.name for r in result.recordings), *(("all",) if several else ())):
        if several:
            console.print(Text(name, "bold" if name == "all" else ""))
        table = plain_table(*heads, words=result.outputs)
        for output in result.outputs:
            both = [x for kind in KINDS for x in result.score(output, name, kind).table_cells()]
            table.add_row(output, *both)
        console.print(table)
    bands = ", ".join(f"{n} {format_number(b, 3)} {unit_of(n)}" for n, b in result.bands.items())
    note = f"{result.window:g} s: windows that each start from what was recorded. whole: from the first sample on. "
    console.print(Text(f"{note}band: share of samples within {bands}.", "dim"))
    print_doubts(console, result.divergence_notes())
    print_doubts(console, result.doubts)
    console.print()


def print_refinement(console: Console, result: Refinement) -> None:
    """Print estimates with their errors, how near the outputs came, and what to doubt."""
    ended = ("converged", "green") if result.converged else ("NOT CONVERGED", "bold red")
    count = len(result.simulated)
    about = f"  {len(result.estimates)} parameters, {count} recording{'s' * (count != 1)}  "
    console.print(Text.assemble((result.title, "bold"), about, ended))
    facts = [("steps", str(len(result.costs) - 1)), ("cost", f"{result.costs[0]:.6g} to {result.costs[-1]:.6g}")]
    if result.search is not None:
        facts.insert(0, ("evolution", f"{len(result.search.costs)} generations, {result.search.evaluations} flights"))
    console.print(fact_line(facts))
    shared = [e for e in result.estimates if e.kind not in _PER_RECORDING]
    heads = ("value", "std error", "CRLB", "95 % low", "95 % high", "start", "")
    table = plain_table("parameter", *heads, words=[e.name for e in shared])
    for e in shared:
        bounds = (format_number(e.value - 1.96 * e.std), format_number(e.value + 1.96 * e.std))
        table.add_row(Text(e.name), *_estimate(e), *bounds, format_number(e.start), _mark(e))
    if shared:
        console.print(table)
    own = [e for e in result.estimates if e.kind in _PER_RECORDING]
    names = [e.name.split(":", 2) for e in own]  # start:m01:w
    table = plain_table("of", "recording", "value", "std error", "CRLB", "", words=[n[1] for n in names], left=2)
    for e, (kind, recording, what) in zip(own, names):
        table.add_row(f"{kind} {what}", Text(recording), *_estimate(e), _mark(e))
    if own:
        console.print(table)
    table = plain_table(
        "output",
        "recording",
        "n",
        "rms",
        *(m.label for m in in_tables(brief=True)),
        words=[f.recording for f in result.fits],
        left=2,
    )
    for f in sorted(result.fits, key=lambda f: [*result.noise_std].index(f.output)):
        table.add_row(
            f.output,
            Text(f.recording),
            str(f.n),
            format_number(f.rms_error, 3),
            *f.cells(brief=True),
        )
    console.print(table)
    print_doubts(console, map(in_commands, result.doubts))
    console.print()


def _estimate(estimate: Estimate) -> tuple[str, str, str]:
    return format_number(estimate.value), format_number(estimate.std, 2), format_number(estimate.std_white, 2)


def _mark(estimate: Estimate) -> Text:
    return Text(" at bound", "yellow") if estimate.at_bound else Text("")


def print_information(console: Console, found: Information) -> None:
    """Print the Cramer-Rao bounds that an input reaches."""
    table = plain_table("parameter", "value", "bound", "% of value", words=found.parameters)
    for name, value, std in zip(found.parameters, found.values, found.crlb):
        table.add_row(
            name,
            format_number(value),
            format_number(std, 3),
            format_number(100.0 * std / abs(value), 3) if value else "-",
        )
    console.print(table)


def print_inputs_compared(console: Console, found: InputComparison) -> None:
    """Print kinds of input at equal energy by what they tell, in % of each parameter."""
    console.print(Text.assemble(("Inputs", "bold"), f"  energy {format_number(found.energy)} each"))
    frame = found.to_frame()
    rows = frame.to_dict("records")
    for first in range(0, len(found.parameters), _TOGETHER):
        some = slice(first, first + _TOGETHER)
        table = plain_table("input", "peak", "A", "D", *found.parameters[some], words=frame["input"])
        for row in rows:
            shares = (100.0 * row[f"std_{p}"] / size for p, size in zip(found.parameters[some], found.sizes[some]))
            figures = (format_number(row[key], 3) for key in ("peak", "A", "D"))
            table.add_row(row["input"], *figures, *(format_number(x, 3) for x in shares))
        console.print(table)
    sizes = ", ".join(f"{p} {format_number(s)}" for p, s in zip(found.parameters, found.sizes))
    note = f"least standard deviation by Cramer and Rao, in % of {sizes}; A: sum of their squares, D: their volume."
    console.print(Text(note, "dim"))
    for u, info in zip(found.inputs, found.found):
        print_doubts(console, (f"{u.name}: {text}" for text in info.unidentifiable))
    console.print()


def print_scatter(console: Console, found: Sequence[Scatter]) -> None:
    """Print how the estimates of repeated flights scattered, over the bound, input by input."""
    names = found[0].parameters
    console.print(Text.assemble(("Repeated flights", "bold"), "  scatter of the estimates over the bound"))
    for first in range(0, len(names), _TOGETHER):
        some = slice(first, first + _TOGETHER)
        table = plain_table("input", "flights", "lost", *names[some], words=[one.name for one in found])
        for one in found:
            ratios = (f"{x:.3f}" for x in (one.std / one.crlb)[some])
            table.add_row(one.name, str(len(one.estimates)), str(one.lost), *ratios)
        console.print(table)
    error = 1.0 / math.sqrt(2.0 * (len(found[0].estimates) - 1))
    console.print(Text(f"output error, noise known; 1 within {error:.2g}, one sigma, where the bound holds.", "dim"))
    console.print()
