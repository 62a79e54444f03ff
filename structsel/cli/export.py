"""``structsel export``: a model as code, XML, table or text for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from structsel.cli.help_text import epilog, option
from structsel.cli.messages import stdout
from structsel.cli.models import Define, read_definitions
from structsel.cli.parsing import read_texts, split_names
from structsel.cli.recordings import Overwrite, load_aircraft
from structsel.exporting import Target, export_model
from structsel.model import AeroModel

EPILOG = epilog(
    [
        (
            "A complete aircraft for JSBSim",
            "structsel export out/model.json --to jsbsim \\\n    --aircraft aircraft.toml --out aircraft.xml\n"
            "  structsel simulate jsbsim:$PWD/aircraft.xml --trim 45,600",
        ),
        ("The aerodynamics only, for an existing aircraft of JSBSim", "structsel export out/model.json --out aero.xml"),
        ("A C function and its header", "structsel export out/model.json --to c --out aero.c"),
    ],
    """[bold]jsbsim[/bold]: an XML file for <aerodynamics file="...">, forces in body axes; with --aircraft a complete
    aircraft. [bold]python[/bold], [bold]c[/bold], [bold]modelica[/bold]: a function of the channels of the model in SI
    units, without dependencies. [bold]latex[/bold]: equations and table. [bold]csv[/bold]: one row for each term.
    [bold]summary[/bold]: text in the layout of statsmodels.""",
    """Every file states the standard errors and the recorded ranges. The functions do not clip their inputs to these
    ranges.""",
)

_JSBSIM = "For JSBSim"
_AIRCRAFT = (
    "Reference geometry of the coefficients; for a complete aircraft of JSBSim also mass, inertia and thrust line."
)


def run(
    model: Annotated[Path, typer.Argument(metavar="MODEL.JSON", help="Model file of select or refine.")],
    out: Annotated[Path, option("--out", "File to write.", metavar="FILE")],
    to: Annotated[Target, option("--to", "Format of the file.")] = "jsbsim",
    aircraft: Annotated[Path | None, option("--aircraft", _AIRCRAFT, metavar="AIRCRAFT.TOML")] = None,
    define: Define = None,
    properties: Annotated[
        str,
        option(
            "--properties",
            "Properties, in SI units, for channels that JSBSim does not compute: rpm=aero/input/rpm",
            _JSBSIM,
            "NAME=PROPERTY,...",
        ),
    ] = "",
    overwrite: Overwrite = False,
) -> None:
    """Write a model for JSBSim, Python, C, Modelica, LaTeX or a spreadsheet, or as text."""
    written = export_model(
        AeroModel.from_json(model),
        out,
        to=to,
        aircraft=None if aircraft is None else load_aircraft(aircraft),
        definitions=read_definitions(define),
        properties=read_texts("--properties", split_names(properties), "NAME=PROPERTY"),
        overwrite=overwrite,
    )
    stdout().print(f"Written to {written}.", markup=False, soft_wrap=True)
