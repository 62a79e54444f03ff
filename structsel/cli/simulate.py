"""``structsel simulate``: a model with input time histories, or with recorded inputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from structsel.cli.comparison_tables import summarise_simulation
from structsel.cli.dataclass_options import takes_dataclass
from structsel.cli.folders import output_folder, refuse_existing
from structsel.cli.help_text import page
from structsel.cli.messages import Waiting, json_text, print_json, say, stdout
from structsel.cli.models import (
    MODEL_HELP,
    AircraftModelOptions,
    RecordingsOption,
    SimulationModel,
    SteadyFlightOptions,
    departures,
    read_schedules,
    trim_model,
)
from structsel.cli.parsing import read_numbers
from structsel.cli.recordings import OUTPUT, Map, OutputOptions, option
from structsel.cli.tables import print_files, print_summary
from structsel.errors import SimulationError
from structsel.nomenclature import LATERAL_COEFFICIENTS
from structsel.recording import Recording, write_recording
from structsel.simulation import Instruments, LinearModel, PublishedAircraft, Trim, Turbulence
from structsel.simulation.flight_setup import start_from
from structsel.simulation.modes import Modes
from structsel.tables import Summary

EPILOG = page(
    [
        ("Trim and modes of a ready aircraft", "structsel simulate ready:beaver --trim 45,600 --modes"),
        (
            "A doublet of the elevator, simulated and recorded with noise",
            "structsel inputs doublet --channel de --amplitude 0.03 --out in/\n"
            "  structsel simulate ready:beaver --inputs in/doublet.csv \\\n"
            "    --noise alpha=0.002,q=0.001 --turbulence 3 --out simulated/",
        ),
        (
            "Your model with recorded inputs, from the recorded start",
            "structsel simulate out/model.json --aircraft aircraft.toml \\\n    --recordings flights/ --out simulated/",
        ),
        (
            "An aircraft of JSBSim with a light stabiliser",
            "structsel simulate jsbsim:c172p --trim 55,1000 --inputs in/doublet.csv \\\n"
            "    --stabilise --out simulated/",
        ),
    ],
    """[bold]--inputs[/bold] are departures from the trim, as structsel inputs writes them; a ready aircraft has a usual
    trim, a linear model none. [bold]--recordings[/bold] holds the inputs as they were; the states are flown, from the
    first sample on. Without either, only the trim is found.""",
    """A flight that blows up is said with the time, its part to there is written, and the exit code is 1.""",
)

_AIR = "Air and instruments"


@dataclass
class _Flown:
    """What there is to show and to write."""

    trim: Trim | None = None
    modes: dict[str, Modes] = field(default_factory=dict)
    flights: list[Recording] = field(default_factory=list)
    recorded: dict[str, Recording] = field(default_factory=dict)
    broken: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class ScheduleOptions:
    """Inputs of the simulation."""

    inputs: Annotated[
        list[Path] | None,
        option("--inputs", "Schedules, departures from the trim; may be repeated.", metavar="FILES"),
    ] = None
    recordings: RecordingsOption = None
    channel_map: Map = None


@dataclass(frozen=True)
class EnvironmentOptions:
    """Air, instruments, and how inputs are followed."""

    between: Annotated[Literal["linear", "hold"], typer.Option("--between", help="What inputs do between samples.")] = (
        "linear"
    )
    stabilise: Annotated[bool, typer.Option("--stabilise", help="JSBSim only: a light stabiliser on.")] = False
    noise: Annotated[
        str,
        typer.Option(
            "--noise",
            metavar="STD",
            help="stated: instruments at their places with the noise of the aircraft file; or NAME=STD,...",
            rich_help_panel=_AIR,
        ),
    ] = ""
    turbulence: Annotated[
        float | None,
        typer.Option(
            "--turbulence",
            metavar="W20",
            help="Dryden, by the wind at 20 ft in m/s: 7.7 light, 15 moderate, 23 severe.",
            rich_help_panel=_AIR,
        ),
    ] = None
    wind: Annotated[str, option("--wind", "Steady wind in m/s, where to.", _AIR, "N,E,D")] = ""
    seed: Annotated[
        int, typer.Option("--seed", help="Of noise and turbulence; each flight's own after it.", rich_help_panel=_AIR)
    ] = 0


@takes_dataclass()
def run(
    model: Annotated[str, typer.Argument(metavar="MODEL", help=MODEL_HELP)],
    source: AircraftModelOptions,
    schedule: ScheduleOptions,
    steady: SteadyFlightOptions,
    environment: EnvironmentOptions,
    output: OutputOptions,
    modes: Annotated[bool, typer.Option("--modes", help="The modes of small motions about the trim.")] = False,
    out: Annotated[
        Path | None,
        option("--out", "Folder for flights, table and plots.", OUTPUT, "DIR"),
    ] = None,
) -> None:
    """Fly a model: trim, modes, and the motion that inputs make, as recordings."""
    refuse_existing(out, output.overwrite)
    aircraft_model = source.open(model)
    schedules = read_schedules(schedule.inputs or (), schedule.channel_map, "--inputs")
    followed = read_schedules(schedule.recordings or (), schedule.channel_map, "--recordings")
    air = _Environment(environment)
    flown = _Flown(recorded={r.name: r for r in followed})
    if isinstance(aircraft_model, LinearModel):
        if steady.trim or steady.controls:
            raise typer.BadParameter("a linear model flies about its reference; leave --trim and --controls out.")
    elif steady.trim or schedules or not followed:
        flown.trim = _trim(aircraft_model, steady)
    if modes or (isinstance(aircraft_model, LinearModel) and not schedules and not followed):
        flown.modes = _modes(aircraft_model, flown.trim)
    with Waiting("flying") as waiting:
        for i, r in enumerate((*schedules, *followed)):
            _keep(flown, r, lambda: air.fly(aircraft_model, r, flown.trim if i < len(schedules) else None, i))  # noqa: B023
            waiting("flights", i + 1, len(schedules) + len(followed))
    written = _write(out, flown, _as_dict(aircraft_model, flown), output.plots) if out is not None else []
    if output.json:
        print_json(_as_dict(aircraft_model, flown))
    else:
        _print(aircraft_model, flown)
        if out is not None:
            print_files(stdout(), str(out), written)
    if flown.broken:
        raise SimulationError("\n".join(flown.broken.values()))


def _trim(aircraft_model: Any, steady: SteadyFlightOptions) -> Trim:
    try:
        found: Trim = trim_model(aircraft_model, steady.trim, steady.controls, steady.free)
    except SimulationError as error:
        if isinstance(error.partial, Trim):
            say("note", f"the nearest to a trim:\n{error.partial}")
        raise
    return found


def _modes(aircraft_model: SimulationModel, trim: Trim | None) -> dict[str, Modes]:
    """Modes by axis.

    Raises
    ------
    BadParameter
        There is no trim, or JSBSim's aircraft, whose equations are its own.
    """
    if isinstance(aircraft_model, LinearModel):
        return {"": aircraft_model.modes()}
    if trim is None or not isinstance(aircraft_model, PublishedAircraft) or aircraft_model.model is None:
        raise typer.BadParameter("--modes needs --trim, and a model of ours.")
    axes = ["longitudinal"] + ["lateral"] * any(name in aircraft_model.model for name in LATERAL_COEFFICIENTS)
    return {axis: aircraft_model.linearise(trim, axis=axis).modes() for axis in axes}


def _keep(flown: _Flown, recording: Recording, fly: Callable[[], Recording]) -> None:
    """Fly, and keep what there is of a flight that broke off."""
    try:
        flown.flights.append(fly())
    except SimulationError as error:
        flown.broken[recording.name] = error.cli_message
        if isinstance(error.partial, Recording):
            flown.flights.append(error.partial)


class _Environment:
    """Air, instruments and how inputs are followed."""

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

    def fly(self, aircraft_model: SimulationModel, recording: Recording, trim: Trim | None, place: int) -> Recording:
        """One flight; of departures from a trim, or with what was recorded."""
        seed = self.options.seed + place
        if isinstance(aircraft_model, LinearModel):
            return aircraft_model.simulate(recording, hold=self.options.between, noise=self.noise, seed=seed)
        given = recording if trim is None else departures(recording, trim.controls)
        if not isinstance(aircraft_model, PublishedAircraft):
            self._refuse_air()
            return aircraft_model.fly(given, start=trim, stabilise=self.options.stabilise)
        if self.options.stabilise:
            raise typer.BadParameter("--stabilise is JSBSim's; fly departures small enough for the aircraft alone.")
        assert aircraft_model.model is not None
        assert aircraft_model.aircraft is not None
        start: Any = (
            trim
            if trim is not None
            else start_from(aircraft_model.model, aircraft_model.aircraft, given, aircraft_model.air)
        )
        rough = None if self.options.turbulence is None else Turbulence(self.options.turbulence, seed)
        air = replace(aircraft_model.air, wind=self.wind, turbulence=rough)
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
            raise typer.BadParameter("JSBSim flies in calm air, without instruments: no --noise, --turbulence, --wind.")


def _print(aircraft_model: SimulationModel, flown: _Flown) -> None:
    console = stdout()
    if flown.trim is not None:
        print_summary(console, replace(flown.trim.summary(), title=aircraft_model.name))
    for axis, modes in flown.modes.items():
        print_summary(
            console, Summary(f"{aircraft_model.name}{axis and ', ' + axis}", "modes", tables=(modes.table(),))
        )
    for flight in flown.flights:
        recorded, error = flown.recorded.get(flight.name), flown.broken.get(flight.name, "")
        print_summary(console, summarise_simulation(flight, recorded, error))


def _as_dict(aircraft_model: SimulationModel, flown: _Flown) -> dict[str, Any]:
    return {
        "schema": "structsel.simulation/1",
        "model": aircraft_model.name,
        "trim": None if flown.trim is None else flown.trim.to_dict(),
        "modes": {axis or aircraft_model.name: _modes_as_dict(modes) for axis, modes in flown.modes.items()},
        "flights": [flight.to_dict() for flight in flown.flights],
        "unfinished": flown.broken,
    }


def _modes_as_dict(modes: Modes) -> list[dict[str, Any]]:
    names = ("frequency", "damping", "time_constant", "time_to_half", "time_to_double", "period")
    return [
        {"name": modes.names[i], "re": float(z.real), "im": float(z.imag)}
        | {name: float(getattr(modes, name)[i]) for name in names}
        for i, z in enumerate(modes.eigenvalues)
    ]


def _write(out: Path, flown: _Flown, told: Mapping[str, Any], plots: bool) -> list[str]:
    """Write everything, or nothing; return the names written."""
    with output_folder(out) as folder:
        if flown.flights:
            (folder / "flights").mkdir()
        for flight in flown.flights:
            write_recording(flight, folder / "flights" / f"{flight.name}.csv")
        (folder / "simulation.json").write_text(json_text(told), encoding="utf-8")
        if plots and flown.flights:
            _draw(folder / "plots", flown.flights, flown.recorded)
        return [p.name + "/" * p.is_dir() for p in sorted(folder.iterdir())]


def _draw(folder: Path, flights: Sequence[Recording], recorded: Mapping[str, Recording]) -> None:
    from structsel.plotting import draw_flight  # matplotlib takes a while to load

    folder.mkdir()
    for flight in flights:
        draw_flight(flight, recorded.get(flight.name)).savefig(folder / f"{flight.name}.png", dpi=110)
