"""What every export says of its model, in lines: where it is from, what it is worth, where it holds."""

from __future__ import annotations

import math
from collections.abc import Sequence

from structsel.aircraft import Aircraft
from structsel.model import AeroModel, ResponseModel
from structsel.nomenclature import UNKNOWN, find_channel, is_known


def fact_lines(model: AeroModel, aircraft: Aircraft | None) -> list[str]:
    """The model's own report, then `reference_lines`."""
    return [*map(one_line, str(model).splitlines()), "", *reference_lines(model, aircraft)]


def reference_lines(model: AeroModel, aircraft: Aircraft | None) -> list[str]:
    """The lengths that the coefficients refer to, where they are known, and where the model holds."""
    lines = []
    if aircraft is not None:
        sizes = f"S = {aircraft.S!r} m^2, b = {aircraft.b!r} m, cbar = {aircraft.cbar!r} m"
        lines.append(f"Reference: {sizes} ({one_line(aircraft.name)}).")
    if not model.ranges:
        return [*lines, "The model does not say where it was flown. Inputs are not clipped."]
    ranges = [f"  {one_line(name)} {low!r} to {high!r} {unit_of(name)}" for name, (low, high) in model.ranges.items()]
    outside = "Outside it is an extrapolation. Inputs are not clipped."
    return [*lines, "Flown by every response, and valid, within:", *ranges, outside]


def unit_of(name: str) -> str:
    """Unit of a channel, ``?`` where it is not known."""
    return find_channel(name).unit if is_known(name) else UNKNOWN


def describe_channel(name: str, model: AeroModel, written: str) -> str:
    """Unit and meaning of a channel, its name if it is written otherwise, and where it was flown."""
    said = find_channel(name).meaning if is_known(name) else "as in the recordings"
    said += f", {one_line(name)} in the model" if written != name else ""
    low, high = model.ranges.get(name, (-math.inf, math.inf))
    recorded = f"; flown {low:.6g} to {high:.6g}" if low > -math.inf else ""
    return f"[{unit_of(name)}] {said}{recorded}"


def term_notes(response: ResponseModel) -> list[str]:
    """Per term: its text, the standard error of its value, and whether a refinement held it."""
    errors: Sequence[float] = [] if response.standard_errors is None else response.standard_errors.tolist()
    worth = [f"standard error {e:.3g}" if math.isfinite(e) else "standard error not known" for e in errors]
    held = [" (held)" if term in response.held else "" for term in response.terms]
    return [f"{term}: {known}{mark}" for term, known, mark in zip(response.terms, worth, held)]


def one_line(text: str) -> str:
    """Text that does not break a line of comment, nor anything a compiler reads."""
    return "".join(c if c.isprintable() else " " for c in text).rstrip()
