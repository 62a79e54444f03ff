"""``structsel validate``: a model against recordings it need not have seen."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from structsel.cli.flights import V0, AircraftFile, Files, Json, Map, Reconstruct, read_flights, words
from structsel.cli.pages import page
from structsel.cli.tables import print_validation
from structsel.cli.terminal import print_json, stdout
from structsel.model import AeroModel
from structsel.validation import validate

EPILOG = page(
    [
        (
            "On flights held back",
            "structsel validate out/model.json m05.csv m06.csv --map map.toml \\\n    --aircraft aircraft.toml",
        ),
        ("On files with coefficients", "structsel validate model.json coefficients/ --responses Cm"),
    ],
    """Only whole manoeuvres the model was not identified from judge it; the output says where they were.""",
)


def run(
    model: Annotated[Path, typer.Argument(metavar="MODEL.JSON", help="A model as select writes it.")],
    files: Files,
    channel_map: Map = None,
    aircraft: AircraftFile = None,
    responses: Annotated[str, typer.Option("--responses", help="Those to score; all of the model's if absent.")] = "",
    normaliser: Annotated[
        Literal["rms", "std", "range"], typer.Option("--normaliser", help="What RRMSE is relative to.")
    ] = "rms",
    reconstruct: Reconstruct = False,
    v0: V0 = None,
    json: Json = False,
) -> None:
    """Score a model on recordings: R2, relative rms error, Theil's coefficient, whiteness of the residual."""
    held = AeroModel.from_json(model)
    flown = read_flights(files, channel_map, aircraft, v0, {*held, *held.channels}, reconstruct)
    result = validate(held, flown, responses=words(responses) or None, normaliser=normaliser)
    if json:
        print_json(result.to_dict())
    else:
        print_validation(stdout(), result, f"{model.name} against {len(flown)} recording{'s' * (len(flown) != 1)}")
