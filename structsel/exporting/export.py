"""export_model: one verb for every target."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Literal, get_args

from structsel.aircraft import Aircraft
from structsel.errors import DataError, ModelError
from structsel.exporting.c import write_c
from structsel.exporting.jsbsim import write_jsbsim
from structsel.exporting.latex import write_latex
from structsel.exporting.modelica import write_modelica
from structsel.exporting.python import write_python
from structsel.exporting.summary import write_summary
from structsel.exporting.table import write_csv
from structsel.files import replacing
from structsel.model import AeroModel
from structsel.nomenclature import suggest
from structsel.recording.arguments import require_kind

Target = Literal["jsbsim", "python", "c", "modelica", "latex", "csv", "summary"]
TARGETS: tuple[str, ...] = get_args(Target)
"""What `export_model` writes."""

_Written = dict[Path, str]
_WRITERS: dict[str, Callable[[AeroModel, Aircraft | None, Path], _Written]] = {
    "python": write_python,
    "c": write_c,
    "modelica": write_modelica,
    "latex": write_latex,
    "csv": write_csv,
    "summary": write_summary,
}


def export_model(
    model: AeroModel,
    path: str | os.PathLike[str],
    *,
    to: Target = "jsbsim",
    aircraft: Aircraft | None = None,
    definitions: Mapping[str, str] | None = None,
    properties: Mapping[str, str] | None = None,
    overwrite: bool = False,
) -> Path:
    """Write a model for another tool.

    Every export says, in comments or text, where the model is from, the standard error of each value, and the region
    flown. None of the functions clips its inputs to that region.

    Parameters
    ----------
    model : AeroModel
    path : str or path
    to : {"jsbsim", "python", "c", "modelica", "latex", "csv", "summary"}
        ``jsbsim``: section ``<aerodynamics>``, forces and moments in body axes; with an `aircraft` the
        complete aircraft around it, its thrust an external force. ``python``, ``c`` (C99, with its header),
        ``modelica``: a function of the model's channels [SI] that needs nothing else. ``latex``: equations
        and table. ``csv``: one row per term below comments. ``summary``: text as statsmodels prints it.
    aircraft : Aircraft, optional
        For the areas and lengths that the coefficients refer to; for JSBSim with mass and inertia.
    definitions : mapping of channel to formula, optional
        For JSBSim: channels that follow from others, such as ``{"q_ratio": "q*1.215/104.67"}``.
    properties : mapping of channel to str, optional
        For JSBSim: properties that hold channels [SI] which it does not have, or has under another name.
    overwrite : bool
        Replace files that are there. They remain until the new ones are complete.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    ArgumentError
        The model or the aircraft are objects of another type.
    ModelError
        A target that is not known, a model with states, definitions or properties for another than JSBSim; for JSBSim
        also a response that is no coefficient, a channel that it does not have, or a file that does not end in
        ``.xml``.
    TermError
        A definition cannot be read.
    AircraftError
        For JSBSim the aircraft lacks mass or inertia, or has rotating parts.
    DataError
        A file exists and `overwrite` is False, or it cannot be written.
    """
    call = "export_model(model, path)"
    require_kind(model, AeroModel, call)
    if aircraft is not None:
        require_kind(aircraft, Aircraft, call, "aircraft")
    path = Path(path)
    if to not in TARGETS:
        raise ModelError(f"There is no export to '{to}'.{suggest(to, TARGETS)} There are {', '.join(TARGETS)}.")
    if model.states:
        raise ModelError(
            f"The model has states of its own ({', '.join(model.states)}), which no export holds. Export "
            "model.quasi_steady(), where nothing is late, or fly it with simulate()."
        )
    if to == "jsbsim":
        written = write_jsbsim(model, aircraft, path, definitions or {}, properties or {})
    elif definitions or properties:
        raise ModelError(
            f"An export to '{to}' takes the model's channels as they are: leave definitions and "
            "properties out, which are JSBSim's."
        )
    else:
        written = _WRITERS[to](model, aircraft, path)
    if there := [str(file) for file in written if file.exists() and not overwrite]:
        raise DataError(
            f"'{there[0]}' exists already.",
            remedy="Choose another name, or pass overwrite=True.",
            cli_remedy="Choose another name, or pass --overwrite.",
        )
    _write(written)
    return path


def _write(written: _Written) -> None:
    """Write all files, or none."""
    try:
        with ExitStack() as files_to_replace:  # none takes its name before all are written
            for file, text in written.items():
                files_to_replace.enter_context(replacing(file)).write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise DataError(f"'{next(iter(written))}' cannot be written: {error.strerror or error}.") from error
