"""``structsel simulate``: a model with input time histories, or with recorded inputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from structsel.cli.comparison_tables import summarise_simulation
from structsel.cli.dataclass_options import takes_dataclass
from structsel.cli.folders import names_in, output_folder, refuse_existing, save_figures
from structsel.cli.help_text import epilog, option
from structsel.cli.messages import ProgressBar, json_text, print_json, say, stdout
from structsel.cli.models import (
    MODEL_HELP,
    AircraftModelOptions,
    RecordingsOption,
    SimulationModel,
    SteadyFlightOptions,
    add_perturbations,
    read_inputs,
    trim_model,
)
from structsel.cli.parsing import read_numbers
from structsel.cli.recordings import OUTPUT, Map, MoreRecordings, OutputOptions
from structsel.cli.tables import print_files, print_summary
from structsel.errors import SimulationError
from structsel.nomenclature import LATERAL_COEFFICIENTS
from structsel.recording import Recording, write_recording
from structsel.simulation import Instruments, LinearModel, PublishedAircraft, Trim, Turbulence
from structsel.simulation.flight_setup import start_from
from structsel.simulation.modes import Modes
from structsel.tables import Summary

EPILOG = epilog(
    [
        ("Trim and modes of a built-in aircraft", "structsel simulate builtin:beaver --trim 45,600 --modes"),
        (
            "Response to a doublet of the elevator, with measurement noise and turbulence",
            "structsel inputs doublet --channel de --amplitude 0.03 --out in/\n"
            "  structsel simulate builtin:beaver --inputs in/doublet.csv \\\n"
            "    --noise alpha=0.002,q=0.001 --turbulence 3 --out simulated/",
        ),
        (
            "A model file with recorded inputs, from the recorded initial state",
            "structsel simulate out/model.json --aircraft aircraft.toml \\\n    --recordings flights/ --out simulated/",
        ),
        (
            "An aircraft of JSBSim with a stabilising feedback",
            "structsel simulate jsbsim:c172p --trim 55,1000 --inputs in/doublet.csv \\\n"
            "    --stabilise --out simulated/",
        ),
    ],
    """[bold]--inputs[/bold] are perturbations from trim, as structsel inputs writes them. A built-in aircraft has a
    default trim; a linear model needs none. [bold]--recordings[/bold] gives the recorded inputs; the states are
    simulated from the first sample on. Without either option only the trim is computed.""",
    """If a simulation diverges, its time is printed, the part up to there is written, and the exit code is 1.""",
)

_AIR = "Air and instruments"


@dataclass
class _SimulationRun:
    """Results of the command."""

    trim: Trim | None = None
    modes: dict[str, Modes] = field(default_factory=dict)
    flights: list[Recording] = field(default_factory=list)
    recorded: dict[str, Recording] = field(default_factory=dict)
    stopped_early: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class InputFileOptions:
    """Files with the inputs of the simulation."""

    inputs: Annotated[
        list[Path] | None,
        option("--inputs", "Input time histories, as perturbations from trim; several.", metavar="FILES..."),
    ] = None
    recordings: RecordingsOption = None
    channel_map: Map = None


@dataclass(frozen=True)
class EnvironmentOptions:
    """Air, instruments, and interpolation of the inputs."""

    between: Annotated[
        Literal["linear", "hold"], option("--between", "Interpolation of the inputs between samples.")
    ] = "linear"
    stabilise: Annotated[bool, option("--stabilise", "JSBSim only: add a stabilising feedback.")] = False
    noise: Annotated[
        str,
        option(
            "--noise",
            "stated: instruments with the positions and the noise of the aircraft file; or NAME=STD,...",
            _AIR,
            "STD",
        ),
    ] = ""
    turbulence: Annotated[
        float | None,
        option(
            "--turbulence",
            "Dryden turbulence, given by the wind at 20 ft in m/s: 7.7 light, 15 moderate, 23 severe.",
            _AIR,
            "W20",
        ),
    ] = None
    wind: Annotated[str, option("--wind", "Steady wind in m/s, towards north, east, down.", _AIR, "N,E,D")] = ""
    seed: Annotated[
        int,
        option("--seed", "Seed of noise and turbulence; increased by 1 for each flight.", _AIR),
    ] = 0


@takes_dataclass()
def run(
    model: Annotated[str, typer.Argument(metavar="MODEL", help=MODEL_HELP)],
    source: AircraftModelOptions,
    files: InputFileOptions,
    steady: SteadyFlightOptions,
    environment: EnvironmentOptions,
    output: OutputOptions,
    more_files: MoreRecordings = None,
    modes: Annotated[bool, option("--modes", "Print the modes of small perturbations about the trim.")] = False,
    out: Annotated[
        Path | None,
        option("--out", "Folder for flights, table and plots.", OUTPUT, "DIR"),
    ] = None,
) -> None:
    """Simulate a model: trim, modes, and the response to inputs, as recordings."""
    refuse_existing(out, output.overwrite)
    aircraft_model = source.open(model)
    if more_files and bool(files.inputs) == bool(files.recordings):
        raise typer.BadParameter(f"'{more_files[0]}': name it by --inputs or --recordings.")
    inputs, recordings = files.inputs or [], files.recordings or []
    (inputs if files.inputs else recordings).extend(more_files or [])
    perturbed = read_inputs(inputs, files.channel_map, "--inputs")
    recorded = read_inputs(recordings, files.channel_map, "--recordings")
    conditions = _Conditions(environment)
    found = _SimulationRun(recorded={r.name: r for r in recorded})
    if isinstance(aircraft_model, LinearModel):
        if steady.trim or steady.controls:
            raise typer.BadParameter(
                "a linear model is simulated about its reference condition: leave --trim and --controls out."
            )
    elif steady.trim or perturbed or not recorded:
        found.trim = _trim(aircraft_model, steady)
    if modes or (isinstance(aircraft_model, LinearModel) and not perturbed and not recorded):
        found.modes = _modes(aircraft_model, found.trim)
    with ProgressBar("simulating") as progress:
        for i, r in enumerate((*perturbed, *recorded)):
            start = found.trim if i < len(perturbed) else None
            _run_one(found, r, partial(conditions.simulate, aircraft_model, r, start, i))
            progress("flights", i + 1, len(perturbed) + len(recorded))
    written = _write(out, found, _as_dict(aircraft_model, found), output.figures) if out is not None else []
    if output.json:
        print_json(_as_dict(aircraft_model, found))
    else:
        _print(aircraft_model, found)
        if out is not None:
            print_files(stdout(), str(out), written)
    if found.stopped_early:
        raise SimulationError("\n".join(found.stopped_early.values()))


def _trim(aircraft_model: Any, steady: SteadyFlightOptions) -> Trim:
    try:
        trim: Trim = trim_model(aircraft_model, steady.trim, steady.controls, steady.free)
    except SimulationError as error:
        if isinstance(error.partial, Trim):
            say("note", f"nearest condition to a trim:\n{error.partial}")
        raise
    return trim


def _modes(aircraft_model: SimulationModel, trim: Trim | None) -> dict[str, Modes]:
    """Modes by axis.

    Raises
    ------
    BadParameter
        There is no trim, or the model is an aircraft of JSBSim.
    """
    if isinstance(aircraft_model, LinearModel):
        return {"": aircraft_model.modes()}
    if trim is None or not isinstance(aircraft_model, PublishedAircraft) or aircraft_model.model is None:
        raise typer.BadParameter("--modes needs --trim, and a model file or a built-in aircraft.")
    axes = ["longitudinal"] + ["lateral"] * any(name in aircraft_model.model for name in LATERAL_COEFFICIENTS)
    return {axis: aircraft_model.linearise(trim, axis=axis).modes() for axis in axes}


def _run_one(found: _SimulationRun, recording: Recording, simulate: Callable[[], Recording]) -> None:
    """Simulate; of a simulation that stops early keep the part up to there."""
    try:
        found.flights.append(simulate())
    except SimulationError as error:
        found.stopped_early[recording.name] = error.cli_message
        if isinstance(error.partial, Recording):
            found.flights.append(error.partial)


class _Conditions:
    """Air, instruments and interpolation of the inputs, as the simulation takes them."""

    def __init__(self, options: EnvironmentOptions):
        self.options = options
        self.stated = options.noise == "stated"
        self.noise = {} if self.stated else read_numbers("--noise", options.noise, "alpha=0.002,q=0.001")
        wind = options.wind
        try:
            self.wind = tuple(float(word) for word in wind.split(",")) if wind else (0.0, 0.0, 0.0)
        except ValueError:
            self.wind = ()
        if len(self.wind) != 3:
            raise typer.BadParameter(f"--wind '{wind}' is not three numbers, north, east and down.")

    def simulate(
        self, aircraft_model: SimulationModel, recording: Recording, trim: Trim | None, place: int
    ) -> Recording:
        """Response to perturbations from a trim, or to recorded inputs."""
        seed = self.options.seed + place
        if isinstance(aircraft_model, LinearModel):
            return aircraft_model.simulate(recording, hold=self.options.between, noise=self.noise, seed=seed)
        given = recording if trim is None else add_perturbations(recording, trim.controls)
        if not isinstance(aircraft_model, PublishedAircraft):
            self._refuse_air()
            return aircraft_model.fly(given, start=trim, stabilise=self.options.stabilise)
        if self.options.stabilise:
            raise typer.BadParameter("--stabilise is available for JSBSim only; use smaller inputs.")
        assert aircraft_model.model is not None
        assert aircraft_model.aircraft is not None
        start: Any = (
            trim
            if trim is not None
            else start_from(aircraft_model.model, aircraft_model.aircraft, given, aircraft_model.air)
        )
        gusts = None if self.options.turbulence is None else Turbulence(self.options.turbulence, seed)
        air = replace(aircraft_model.air, wind=self.wind, turbulence=gusts)
        return aircraft_model.simulate(
            given,
            start=start,
            air=air,
            instruments=self._instruments(aircraft_model, seed),
            between=self.options.between,
        )

    def _instruments(self, aircraft_model: PublishedAircraft, seed: int) -> Instruments | None:
        if self.stated:
            assert aircraft_model.aircraft is not None
            return Instruments.of(aircraft_model.aircraft, seed=seed)
        return Instruments(noise=self.noise, seed=seed) if self.noise else None

    def _refuse_air(self) -> None:
        if self.noise or self.stated or self.options.turbulence is not None or any(self.wind):
            raise typer.BadParameter(
                "JSBSim is simulated in calm air without instruments: leave --noise, --turbulence and --wind out."
            )


def _print(aircraft_model: SimulationModel, found: _SimulationRun) -> None:
    console = stdout()
    if found.trim is not None:
        print_summary(console, replace(found.trim.summary(), title=aircraft_model.name))
    for axis, modes in found.modes.items():
        print_summary(
            console, Summary(f"{aircraft_model.name}{axis and ', ' + axis}", "modes", tables=(modes.table(),))
        )
    for flight in found.flights:
        recorded, error = found.recorded.get(flight.name), found.stopped_early.get(flight.name, "")
        print_summary(console, summarise_simulation(flight, recorded, error))


def _as_dict(aircraft_model: SimulationModel, found: _SimulationRun) -> dict[str, Any]:
    return {
        "schema": "structsel.simulation/1",
        "model": aircraft_model.name,
        "trim": None if found.trim is None else found.trim.to_dict(),
        "modes": {axis or aircraft_model.name: _modes_as_dict(modes) for axis, modes in found.modes.items()},
        "flights": [flight.to_dict() for flight in found.flights],
        "unfinished": found.stopped_early,
    }


def _modes_as_dict(modes: Modes) -> list[dict[str, Any]]:
    names = ("frequency", "damping", "time_constant", "time_to_half", "time_to_double", "period")
    return [
        {"name": modes.names[i], "re": float(z.real), "im": float(z.imag)}
        | {name: float(getattr(modes, name)[i]) for name in names}
        for i, z in enumerate(modes.eigenvalues)
    ]


def _write(out: Path, found: _SimulationRun, content: Mapping[str, Any], figures: str) -> list[str]:
    """Write everything, or nothing; return the names written."""
    with output_folder(out) as folder:
        if found.flights:
            (folder / "flights").mkdir()
        for flight in found.flights:
            write_recording(flight, folder / "flights" / f"{flight.name}.csv")
        (folder / "simulation.json").write_text(json_text(content), encoding="utf-8")
        if figures and found.flights:
            from structsel.plotting import draw_flight  # matplotlib takes a while to load

            pairs = ((flight, found.recorded.get(flight.name)) for flight in found.flights)
            save_figures(folder / "plots", ((one.name, draw_flight(one, recorded)) for one, recorded in pairs), figures)
        return names_in(folder)
