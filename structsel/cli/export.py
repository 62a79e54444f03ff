"""``structsel export``: a model for the tools that others work in."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from structsel.cli.help_text import page
from structsel.cli.messages import stdout
from structsel.cli.models import Define, read_definitions
from structsel.cli.parsing import split_names
from structsel.cli.recordings import Overwrite, load_aircraft, option
from structsel.exporting import Target, export_model
from structsel.model import AeroModel

EPILOG = page(
    [
        (
            "An aircraft that JSBSim flies",
            "structsel export out/model.json --to jsbsim \\\n    --aircraft aircraft.toml --out craft.xml\n"
            "  structsel simulate jsbsim:$PWD/craft.xml --trim 45,600",
        ),
        ("Its aerodynamics alone, for an aircraft you have", "structsel export out/model.json --out aero.xml"),
        ("A C function and its header", "structsel export out/model.json --to c --out aero.c"),
    ],
    """[bold]jsbsim[/bold]: forces in body axes, as <aerodynamics file="..."> includes them, or a whole aircraft with
    --aircraft. [bold]python[/bold], [bold]c[/bold], [bold]modelica[/bold]: a function of the model's channels, SI, that
    needs nothing else. [bold]latex[/bold]: equations and table. [bold]csv[/bold]: a row per term.
    [bold]summary[/bold]: text as statsmodels prints it.""",
    """Each says the standard errors and the recorded ranges; no function clips its inputs to it.""",
)

_JSBSIM = "For JSBSim"
_AIRCRAFT = (
    "Geometry that the coefficients refer to; for JSBSim also mass, inertia and thrust line of a whole aircraft."
)


def run(
    model: Annotated[Path, typer.Argument(metavar="MODEL.JSON", help="A model as select writes it.")],
    out: Annotated[Path, option("--out", "File to write.", metavar="FILE")],
    to: Annotated[Target, typer.Option("--to", help="What to write.")] = "jsbsim",
    aircraft: Annotated[Path | None, typer.Option("--aircraft", metavar="AIRCRAFT.TOML", help=_AIRCRAFT)] = None,
    define: Define = None,
    properties: Annotated[
        str,
        option(
            "--properties",
            "Properties that hold channels, SI, which JSBSim lacks: rpm=aero/input/rpm",
            _JSBSIM,
            "NAME=PROPERTY,...",
        ),
    ] = "",
    overwrite: Overwrite = False,
) -> None:
    """Write a model for JSBSim, Python, C, Modelica, LaTeX, a spreadsheet, or to be read."""
    written = export_model(
        AeroModel.from_json(model),
        out,
        to=to,
        aircraft=None if aircraft is None else load_aircraft(aircraft),
        definitions=read_definitions(define),
        properties=_read_properties(properties),
        overwrite=overwrite,
    )
    stdout().print(f"Written to {written}.", markup=False, soft_wrap=True)


def _read_properties(text: str) -> dict[str, str]:
    found = {}
    for word in split_names(text):
        name, _, held = (part.strip() for part in word.partition("="))
        if not name or not held:
            raise typer.BadParameter(f"--properties '{word}' is not NAME=PROPERTY.")
        found[name] = held
    return found
