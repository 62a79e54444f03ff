"""A model as a Modelica function, which every Modelica tool flies, and turns into an FMU where one is wanted."""

from __future__ import annotations

from pathlib import Path

from structsel.aircraft import Aircraft
from structsel.exporting.code_writer import Code, Dialect, Identifiers
from structsel.exporting.header import describe_channel, fact_lines
from structsel.model import AeroModel

_WORDS = """algorithm and annotation assert block break class connect connector constant constrainedby der discrete
each else elseif elsewhen encapsulated end enumeration equation expandable extends external false final flow for
function if import impure in initial inner input loop model not operator or outer output package parameter partial
protected public pure record redeclare replaceable return stream then true type when while within"""
_BUILT_IN = """Real Integer Boolean String abs sign sqrt sin cos tan asin acos atan atan2 sinh cosh tanh exp log log10
div mod rem ceil floor integer max min sum product time delay pre edge change reinit sample initial terminal noEvent
smooth size fill zeros ones vector matrix transpose identity diagonal linspace scalar cross skew symmetric ndims cat
array promote semiLinear homotopy spatialDistribution cardinality actualStream inStream terminate getInstanceName"""

_DIALECT = Dialect(
    calls={
        **{name: f"{name}({{}})" for name in ("abs", "sign", "sqrt", "sin", "cos", "tan", "exp", "log", "tanh")},
        "step": "(if {} >= 0.0 then 1.0 else 0.0)",
        "plus": "max({}, 0.0)",
    },
    power="(({})^({}))",
    reserved=frozenset({*_WORDS.split(), *_BUILT_IN.split()}),
)


def write_modelica(model: AeroModel, aircraft: Aircraft | None, path: Path) -> dict[Path, str]:
    """One function, called as the file is."""
    names = Identifiers(_DIALECT)
    own = names.add(path.stem)
    inputs = {channel: names.add(channel) for channel in model.channels}
    outputs = {response: names.add(response) for response in model}
    code = Code(_DIALECT, names, inputs)
    body = []
    for response, held in model.responses.items():
        lines = [f"    {line} // {note}" for line, note in code.add_lines(held)]
        body += [f"  {outputs[response]} :=", *lines, "    ;"]
    title = f"Model {model.name}" if model.name else "An aerodynamic model"
    lines = [
        *(f"// {line}".rstrip() for line in fact_lines(model, aircraft)),
        f"function {own} {_text(title)}",
        "  // Nothing is clipped.",
        *(f"  input Real {name} {_text(describe_channel(c, model, name))};" for c, name in inputs.items()),
        *(f"  output Real {name} {_text(describe_channel(c, model, name))};" for c, name in outputs.items()),
        *(["protected"] if code.locals else []),
        *(f"  Real {name};" for name in code.locals),
        "algorithm",
        *(f"  {name} := {text};" for name, text in code.locals.items()),
        *body,
        f"end {own};",
    ]
    return {path: "\n".join(lines) + "\n"}


def _text(words: str) -> str:
    """A Modelica string."""
    return '"' + " ".join(words.split()).replace("\\", "/").replace('"', "'") + '"'
