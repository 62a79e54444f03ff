"""Reconstructions as tables that fit 80 columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from rich.console import Console
from rich.text import Text

from structsel.cli.tables import fact_line, indented, plain_table, print_doubts
from structsel.cli.terminal import in_commands
from structsel.formatting import format_number
from structsel.reconstruction import CONSTANTS, Reconstruction, Reconstructions

LEGEND = (
    "std: of the estimate, with allowance for coloured residuals; residual: rms of measured less reconstructed; "
    "var. and corr.: of the normalised innovations, their variance (1 is right) and the correlation of neighbours "
    "(0 is right); rej.: readings outside the gate, not used."
)


def print_reconstruction(console: Console, result: Reconstruction) -> None:
    """Print one manoeuvre: verdict, constants, what was not estimated, channels, doubts."""
    _print_verdict(console, result)
    if result.constants:
        table = plain_table("constant", "meaning", "value", "std", "unit", words=_meanings(), left=2)
        table.columns[-1].justify = "left"
        for c in result.constants:
            table.add_row(c.name, CONSTANTS[c.name][0], format_number(c.value), format_number(c.std, 2), f" {c.unit}")
        console.print(table)
    _print_fixed(console, [result])
    _print_channels(console, result)
    print_doubts(console, map(in_commands, result.doubts))
    for finding in result.findings:
        if finding.severity == "note":
            indented(console, "-", "dim", in_commands(str(finding).removeprefix("note: ")))
    console.print()


def print_methods(console: Console, by_method: Mapping[str, Reconstruction]) -> None:
    """Print one manoeuvre by every method that could reconstruct it, side by side."""
    results = list(by_method.values())
    for result in results:
        _print_verdict(console, result)
    names = [name for name in CONSTANTS if any(c.name == name for one in results for c in one.constants)]
    heads = [head for method in by_method for head in (method, "std")]
    if names:
        table = plain_table("constant", *heads, "unit", words=names)
        table.columns[-1].justify = "left"
        for name in names:
            figures = []
            for one in results:
                mine = next((c for c in one.constants if c.name == name), None)
                figures += [format_number(mine.value), format_number(mine.std, 2)] if mine is not None else [".", ""]
            table.add_row(name, *figures, f" {CONSTANTS[name][1]}")
        console.print(table)
    _print_fixed(console, results)
    table = plain_table("residual rms", *by_method, "unit", words=["residual rms"])
    table.columns[-1].justify = "left"
    for channel in results[0].consistency.channels:
        left = (format_number(one.consistency[channel.channel].residual_rms, 3) for one in results)
        table.add_row(channel.channel, *left, f" {_unit(results[0], channel.channel)}")
    console.print(table)
    said: dict[str, list[str]] = {}
    for method, one in by_method.items():
        for doubt in one.doubts:
            said.setdefault(in_commands(doubt), []).append(method)
    print_doubts(console, (f"{', '.join(methods)}: {doubt}" for doubt, methods in said.items()))
    console.print()


def print_constants(console: Console, results: Reconstructions, method: str) -> None:
    """Print what became of each of several manoeuvres, and their constants together."""
    console.print(Text.assemble(("All manoeuvres", "bold"), f"  {method}"))
    names = [*(one.name for one in results), *results.failed]
    table = plain_table("manoeuvre", "s", "NIS", "verdict", words=names)
    table.columns[-1].justify = "left"
    for one in results:
        verdict = Text(" trusted", "green") if one.trusted else Text(" NOT TRUSTED", "bold red")
        table.add_row(Text(one.name), f"{one.recording.duration:.1f}", f"{one.consistency.nis:.3f}", verdict)
    for name in results.failed:
        table.add_row(Text(name), "-", "-", Text(" not reconstructed", "red"))
    console.print(table)
    trusted = [one for one in results if one.trusted]
    if len(trusted) > 1:
        about = f"{len(trusted)} trusted manoeuvres" if len(trusted) < len(results) else "all"
        console.print(Text(f"Constants of {about}; one that scatters far beyond its std is not constant", "dim"))
        table = plain_table("constant", "n", "mean", "scatter", "mean std", "unit", words=CONSTANTS)
        table.columns[-1].justify = "left"
        for name in CONSTANTS:
            found = [c for one in trusted for c in one.constants if c.name == name]
            if not found:
                continue
            values = np.array([c.value for c in found])
            scatter = float(values.std(ddof=1)) if len(found) > 1 else float("nan")
            std = float(np.mean([c.std for c in found]))
            unit = f" {CONSTANTS[name][1]}"
            table.add_row(
                name,
                str(len(found)),
                format_number(float(values.mean())),
                format_number(scatter, 2),
                format_number(std, 2),
                unit,
            )
        console.print(table)
    console.print()


def _print_verdict(console: Console, result: Reconstruction) -> None:
    r = result.recording
    about = f"  {len(r)} samples, {r.duration:.1f} s, {result.method}  "
    verdict = ("trusted", "green") if result.trusted else ("NOT TRUSTED", "bold red")
    console.print(Text.assemble((result.name, "bold"), about, verdict))
    for reason in result.distrust:
        indented(console, "!", "red", in_commands(reason))


def _print_fixed(console: Console, results: Sequence[Reconstruction]) -> None:
    said: dict[str, list[str]] = {}
    for name, why in {name: why for one in results for name, why in one.fixed.items()}.items():
        said.setdefault(why, []).append(name)
    for why, names in said.items():
        indented(console, "-", "dim", f"not estimated: {', '.join(names)}: {why}")


def _print_channels(console: Console, result: Reconstruction) -> None:
    heads = ("channel", "unit", "noise", "source", "residual", "var.", "corr.", "rej.")
    units = [level.unit for level in result.noise]
    table = plain_table(*heads, words=units, left=2)
    table.columns[3].justify = "left"
    seen = {c.channel: c for c in result.consistency.channels}
    for level in sorted(result.noise, key=lambda level: level.channel not in seen):
        row = [level.channel, level.unit, format_number(level.std, 3), f" {level.source}"]
        c = seen.get(level.channel)
        if c is not None:
            next_one = float(c.autocorrelation[0]) if len(c.autocorrelation) else float("nan")
            corr = f"{next_one:+.2f}" if np.isfinite(next_one) else "-"
            row += [format_number(c.residual_rms, 3), f"{c.variance:.2f}", corr, str(c.rejected)]
        else:
            row += ["", "", "", ""]
        table.add_row(*row)
    console.print(table)
    together = result.consistency
    low, high = together.nis_band
    facts = [("NIS", f"{together.nis:.3f}"), ("95 % band", f"{low:.3f} to {high:.3f}")]
    if any(result.gust):
        facts.append(("turbulence", ", ".join(format_number(std, 2) for std in result.gust) + " m/s"))
    console.print(fact_line(facts))


def _unit(result: Reconstruction, channel: str) -> str:
    return next((level.unit for level in result.noise if level.channel == channel), "")


def _meanings() -> list[str]:
    return [meaning for meaning, _ in CONSTANTS.values()]
