"""A model as a Python function that needs nothing but ``math``."""

from __future__ import annotations

import builtins
import keyword
from pathlib import Path

from structsel.aircraft import Aircraft
from structsel.exporting.code_writer import Code, Dialect, Identifiers
from structsel.exporting.header import describe_channel, fact_lines
from structsel.model import AeroModel

_DIALECT = Dialect(
    calls={
        **{name: f"math.{name}({{}})" for name in ("sqrt", "sin", "cos", "tan", "exp", "log", "tanh")},
        "abs": "abs({})",
        "sign": "_sign({})",
        "step": "_step({})",
        # In this order a nan stays one.
        "plus": "max({}, 0.0)",
    },
    power="math.pow({}, {})",
    reserved=frozenset({*keyword.kwlist, *keyword.softkwlist, *dir(builtins), "math", "evaluate"}),
)
_HELPERS = {
    "sign": "def _sign(x):\n    return 1.0 if x > 0.0 else -1.0 if x < 0.0 else x",
    "step": "def _step(x):\n    return 1.0 if x >= 0.0 else 0.0",
}


def write_python(model: AeroModel, aircraft: Aircraft | None, path: Path) -> dict[Path, str]:
    """Module with one function, ``evaluate``, of floats by name."""
    names = Identifiers(_DIALECT)
    inputs = {channel: names.add(channel) for channel in model.channels}
    code = Code(_DIALECT, names, inputs)
    returned = []
    for response, held in model.responses.items():
        returned.append(f"        {response!r}: (")
        returned += [f"            {line}  # {note}" for line, note in code.add_lines(held)]
        returned.append("        ),")
    documented = [f"    {name} : float, {describe_channel(channel, model, name)}" for channel, name in inputs.items()]
    blocks = [
        "\n".join(f"# {line}".rstrip() for line in fact_lines(model, aircraft)),
        "import math",
        *(f"\n{_HELPERS[name]}" for name in sorted(code.used & set(_HELPERS))),
        "\n"
        + "\n".join(
            [
                f"def evaluate({'*, ' * bool(inputs)}{', '.join(inputs.values())}):",
                '    """Return the responses at one state, a dict of floats.',
                "",
                *documented,
                "",
                "    Nothing is clipped. Where a formula does not hold (a negative number's logarithm, division by 0)",
                "    it raises ValueError or ArithmeticError.",
                '    """',
                *(f"    {name} = {text}" for name, text in code.locals.items()),
                "    return {",
                *returned,
                "    }",
            ]
        ),
    ]
    return {path: "\n\n".join(blocks) + "\n"}
