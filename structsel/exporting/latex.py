r"""A model as LaTeX: its equations, and its table of values and standard errors."""

from __future__ import annotations

from pathlib import Path

from structsel.aircraft import Aircraft
from structsel.exporting.header import fact_lines
from structsel.model import AeroModel, ResponseModel
from structsel.nomenclature import latex_of

_TERMS_PER_LINE = 4


def write_latex(model: AeroModel, aircraft: Aircraft | None, path: Path) -> dict[Path, str]:
    """Equations and table, for a document that loads amsmath and booktabs."""
    equations = [_equation(name, held) for name, held in model.responses.items()]
    lines = [
        r"% \usepackage{amsmath, booktabs}",
        *(f"% {line}".rstrip() for line in fact_lines(model, aircraft)),
        r"\begin{align*}",
        (r" \\" + "\n").join(equations),
        r"\end{align*}",
        model.latex(),
    ]
    return {path: "\n".join(lines) + "\n"}


def _equation(name: str, held: ResponseModel) -> str:
    parts = []
    for term, value in zip(held.terms, held.values.tolist()):
        shown = _figure(abs(value)) + ("" if term.is_constant else rf" \, {term.latex()}")
        parts.append(f"{'-' if value < 0 else '+'} {shown}")
    rows = [" ".join(parts[i : i + _TERMS_PER_LINE]) for i in range(0, len(parts), _TERMS_PER_LINE)] or ["0"]
    return f"{latex_of(name)} ={{}}& {rows[0].removeprefix('+ ')}" + "".join(
        f" \\\\\n  &{{}} {row}" for row in rows[1:]
    )


def _figure(value: float) -> str:
    mantissa, _, exponent = f"{value:.5g}".partition("e")
    return rf"{mantissa} \times 10^{{{int(exponent)}}}" if exponent else mantissa
