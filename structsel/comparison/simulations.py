"""The five forms a simulation may come in, each turned into responses along the recordings."""

from __future__ import annotations

import importlib
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from structsel.aircraft import Aircraft
from structsel.coefficients import compute_coefficients
from structsel.comparison.flight import OF_COEFFICIENTS
from structsel.errors import ArgumentError, DataError, ModelError
from structsel.model import AeroModel
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.air_data import body_from_wind_axes
from structsel.numerics.arrays import Array
from structsel.recording import Recording
from structsel.recording.reading import load_recordings

_CLOCK_TOLERANCE = 0.1  # of a sample, by which clocks may differ and still be one

_NO_SIMULATION = {
    **dict.fromkeys(("Selection", "Selections", "Refinement"), "Pass its .model."),
    **dict.fromkeys(
        ("list", "tuple", "Recording"), "Pass simulated recordings by name: {recording.name: recording, ...}."
    ),
}

Evaluate = Callable[[Recording], Mapping[str, Array]]


@dataclass(frozen=True, eq=False)
class OpenedSimulation:
    """A simulation to be compared with recordings.

    Attributes
    ----------
    form : {"model", "forced", "free", "jsbsim", "python"}
    name : str
    along : mapping of recording to mapping of response to (n,) array
        What it says along the recordings, for the form "forced"; else empty.
    flights : mapping of recording to Recording
        Its own flights, for the form "free".
    evaluate : callable or None
        Recording to responses, for the forms that can be asked.
    model : AeroModel or None
    """

    form: str
    name: str
    along: Mapping[str, Mapping[str, Array]] = field(default_factory=dict)
    flights: Mapping[str, Recording] = field(default_factory=dict)
    evaluate: Evaluate | None = None
    model: AeroModel | None = None


def require_simulation(given: Any, call: str) -> None:
    """Refuse an object that is no form of a simulation.

    Raises
    ------
    ArgumentError
        It is something else.
    """
    if not (isinstance(given, AeroModel | str | Path | Mapping) or callable(given)):
        verb, kind = call.partition("(")[0], type(given).__name__
        raise ArgumentError(
            f"{verb} needs a simulation: an AeroModel, a file, a function, or simulated recordings by name, and was "
            f"given an object of type {kind}.",
            remedy=_NO_SIMULATION.get(kind, f"The order is {call}."),
        )


def open_simulation(source: Any, recordings: Sequence[Recording], aircraft: Aircraft) -> OpenedSimulation:
    """Bring any form of simulation to one.

    Parameters
    ----------
    source : AeroModel, callable, str or Path, or mapping of recording to Recording
        A model or its file, ``"jsbsim:AIRCRAFT"``, ``"python:module:function"``, or files (or a folder) with the
        recordings' names.
    recordings : sequence of Recording
    aircraft : Aircraft

    Raises
    ------
    DataError
        Names or clocks that do not match.
    ModelError
        A form that is not known, or cannot be loaded.
    """
    if isinstance(source, AeroModel):
        return OpenedSimulation("model", source.name or "model", evaluate=_of_model(source, aircraft), model=source)
    if callable(source):
        return OpenedSimulation("python", getattr(source, "__name__", "function"), evaluate=source)
    if isinstance(source, Mapping):
        return _of_files(dict(source), recordings, "simulation")
    text = str(source)
    if text.startswith("jsbsim:"):
        from structsel.simulation.jsbsim import open_jsbsim

        jsbsim_aircraft = open_jsbsim(text.removeprefix("jsbsim:"))
        # JSBSim takes alpha and beta at the centre of gravity; a recording has those of its vanes.
        return OpenedSimulation(
            "jsbsim",
            text,
            evaluate=lambda r: _coefficients_of(jsbsim_aircraft.coefficients(compute_coefficients(r, aircraft))),
        )
    if text.startswith("python:"):
        return OpenedSimulation("python", text, evaluate=_load(text))
    path = Path(text)
    if not path.exists():
        raise DataError(f"there is no simulation at '{text}': give a folder, a model.json, jsbsim:... or python:...")
    if path.suffix == ".json":
        model = AeroModel.from_json(path)
        return OpenedSimulation("model", path.name, evaluate=_of_model(model, aircraft), model=model)
    return _of_files({r.name: r for r in load_recordings(path)}, recordings, str(path))


def _coefficients_of(simulated: Recording) -> dict[str, Array]:
    return {name: simulated[name] for name in COEFFICIENTS if name in simulated}


def _load(text: str) -> Evaluate:
    parts = text.split(":")
    if len(parts) != 3 or not all(parts):
        raise ModelError(f"'{text}' is not of the form python:module:function.")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)
    try:
        return getattr(importlib.import_module(parts[1]), parts[2])
    except (ImportError, AttributeError) as error:
        raise ModelError(
            f"simulation '{text}' cannot be loaded: {error}.\nThe module must be importable from here, and hold the "
            "function."
        ) from error


def _of_model(model: AeroModel, aircraft: Aircraft) -> Evaluate:
    def evaluate(recording: Recording) -> dict[str, Array]:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the region left is judged, and said, by the comparison
            complete = set(model.channels) <= set(recording.names)
            held = recording if complete else compute_coefficients(recording, aircraft)
            responses = model.evaluate(held, outside="ignore")
        return body_axes(responses, held["alpha"]) if {"CL", "CD"} & set(responses) else dict(responses)

    return evaluate


def body_axes(responses: Mapping[str, Array], alpha: Array) -> dict[str, Array]:
    """Lift and drag coefficients as CX and CZ; the others as they are."""
    if not {"CL", "CD"} <= set(responses):
        raise ModelError("a simulation that gives one of CL and CD must give both: body axes need them together.")
    CL, CD = responses["CL"], responses["CD"]
    rest = {name: x for name, x in responses.items() if name not in ("CL", "CD")}
    CX, CZ = body_from_wind_axes(CL, CD, alpha)
    return {"CX": CX, "CZ": CZ, **rest}


def _of_files(found: dict[str, Recording], recordings: Sequence[Recording], where: str) -> OpenedSimulation:
    missing = [r.name for r in recordings if r.name not in found]
    if missing:
        raise DataError(
            f"the simulation in '{where}' has no file for {', '.join(missing)}; it has {', '.join(sorted(found))}.\n"
            "Each recording needs a simulated file of its name."
        )
    mine = {r.name: found[r.name] for r in recordings}
    first = next(iter(mine.values()))
    if {*COEFFICIENTS, "CL", "CD"} & set(first.names):
        return OpenedSimulation(
            "forced", where, along={r.name: _aligned(mine[r.name], r, COEFFICIENTS) for r in recordings}
        )
    if set(OF_COEFFICIENTS) <= set(first.names):
        return OpenedSimulation("free", where, flights=mine)
    shared = [c for c in first.names if all(c in r for r in recordings)]
    if not shared:
        raise DataError(
            f"the simulation in '{where}' gives {', '.join(first.names)}: no coefficients, no flight "
            f"({', '.join(OF_COEFFICIENTS)}), and no channel that the recordings have.\nIt must give one of these."
        )
    along = {r.name: _aligned(mine[r.name], r, shared) for r in recordings}
    # A channel copied from the recording is an input, not an answer.
    answers = [c for c in shared if any(not np.allclose(along[r.name][c], r[c], rtol=1e-9) for r in recordings)]
    return OpenedSimulation("forced", where, along={k: {c: v[c] for c in answers or shared} for k, v in along.items()})


def _aligned(simulated: Recording, recording: Recording, wanted: Sequence[str]) -> dict[str, Array]:
    """Channels of a simulated file on the recording's clock.

    Raises
    ------
    DataError
        The clocks do not overlap, or what is simulated is not finite.
    """
    held = {c: np.asarray(simulated[c]) for c in wanted if c in simulated}
    if {"CL", "CD"} & set(simulated.names) and "CZ" not in held:
        held |= body_axes({c: np.asarray(simulated[c]) for c in ("CL", "CD") if c in simulated}, recording["alpha"])
    for name, x in held.items():
        if not np.isfinite(x).all():
            i = int(np.argmin(np.isfinite(x)))
            raise DataError(
                f"the simulation of '{recording.name}' gives {name} = {x[i]} at sample {i} (t = {simulated.t[i]:g} s): "
                "it diverged, or was not finished.\nLeave this manoeuvre out, or correct the simulation."
            )
    t, dt = recording.t, recording.dt
    if len(simulated) == len(recording) and np.abs(simulated.t - t).max() <= _CLOCK_TOLERANCE * dt:
        return held
    if simulated.t[0] > t[0] + dt or simulated.t[-1] < t[-1] - dt:
        raise DataError(
            f"'{recording.name}' runs from {t[0]:g} to {t[-1]:g} s, its simulation from {simulated.t[0]:g} to "
            f"{simulated.t[-1]:g} s: the clocks do not match.\nWrite the simulation on the recording's clock."
        )
    return {name: np.interp(t, simulated.t, x) for name, x in held.items()}
