"""Models to simulate: a model file with its aircraft, a built-in aircraft, one of JSBSim, a linear model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from structsel.cli.help_text import option
from structsel.cli.messages import say
from structsel.cli.parsing import read_numbers, read_texts, split_names
from structsel.cli.recordings import load_aircraft, read_manoeuvres
from structsel.errors import ChannelError, ModelError
from structsel.formatting import join_names
from structsel.model import AeroModel
from structsel.recording import Recording
from structsel.simulation import PUBLISHED_AIRCRAFT, Atmosphere, LinearModel, PublishedAircraft, published_aircraft

if TYPE_CHECKING:
    from structsel.simulation.jsbsim import JSBSimAircraft

SimulationModel: TypeAlias = "PublishedAircraft | LinearModel | JSBSimAircraft"

MODEL_HELP = (
    f"A model file; builtin:NAME, one of {', '.join(PUBLISHED_AIRCRAFT)}, for linear models with axis or speed, "
    "builtin:hawk:lateral; or jsbsim:AIRCRAFT, a name or PATH.xml."
)
AircraftOption = Annotated[
    Path | None,
    option(
        "--aircraft",
        "For a model file: geometry, mass, inertia, thrust line, positions of the instruments.",
        metavar="AIRCRAFT.TOML",
    ),
]
TrimOption = Annotated[
    str,
    option(
        "--trim",
        "Steady flight at airspeed V in m/s and altitude H in m; optionally climb=, turn_rate=, bank=, sideslip= "
        "in rad and rad/s: 45,600,climb=0.05",
        metavar="V,H,...",
    ),
]
Controls = Annotated[
    str,
    option("--controls", "Controls with given values in the trim: df=0.1,rpm=1800", metavar="NAME=VALUE,..."),
]
Free = Annotated[
    str,
    option(
        "--free",
        "Controls that the trim determines; by default those of de da dr throttle thrust that the model has.",
        metavar="NAMES",
    ),
]
Define = Annotated[
    list[str] | None,
    option(
        "--define",
        'Channel computed from others; may be repeated: "thrust=9000*throttle*rho/1.225"',
        metavar="NAME=FORMULA",
    ),
]
Rho = Annotated[float | None, option("--rho", "Constant air density in kg/m^3. Default: standard atmosphere.")]
RecordingsOption = Annotated[
    list[Path] | None,
    option(
        "--recordings", "Files with one manoeuvre each, folders, or patterns in quotes; several.", metavar="FILES..."
    ),
]


@dataclass(frozen=True)
class AircraftModelOptions:
    """Aircraft, derived channels and air density for the simulation of a model file."""

    aircraft: AircraftOption = None
    define: Define = None
    rho: Rho = None

    def open(self, text: str) -> SimulationModel:
        """Open the model of this name with these options, as `open_model`."""
        return open_model(text, self.aircraft, read_definitions(self.define), self.rho)


@dataclass(frozen=True)
class SteadyFlightOptions:
    """The steady flight that a simulation starts from."""

    trim: TrimOption = ""
    controls: Controls = ""
    free: Free = ""


_TRIM = ("V", "h", "climb", "turn_rate", "bank", "sideslip")


def read_trim(text: str) -> dict[str, float]:
    """Arguments of a trim: V and h, by position or name, and others by name.

    Raises
    ------
    BadParameter
        It is not of that form.
    """
    parts = split_names(text)
    named = [part if "=" in part else f"{name}={part}" for name, part in zip(_TRIM, parts)] + parts[len(_TRIM) :]
    found = read_numbers("--trim", ",".join(named), "45,600 or V=45,h=600,climb=0.05")
    if wrong := [name for name in found if name not in _TRIM]:
        raise typer.BadParameter(f"--trim has no '{wrong[0]}'; it has {', '.join(_TRIM)}.")
    return found


def read_definitions(texts: Sequence[str] | None) -> dict[str, str]:
    """Formulas of ``--define`` by channel."""
    return read_texts("--define", texts or (), "NAME=FORMULA")


def open_model(
    text: str, aircraft: Path | None, definitions: Mapping[str, str] | None = None, rho: float | None = None
) -> SimulationModel:
    """Model named by ``MODEL.json``, ``builtin:...`` or ``jsbsim:...``; the old ``ready:...`` works with a warning.

    Raises
    ------
    BadParameter
        A model file without --aircraft, or --aircraft for a model that has its own.
    ModelError, SimulationError
        There is no such model.
    """
    kind, colon, name = text.partition(":")
    if colon and kind == "ready":
        say("warning", f"'{text}' is deprecated: use 'builtin:{name}'.")
        kind = "builtin"
    if colon and kind in ("builtin", "jsbsim") and aircraft is not None:
        raise typer.BadParameter(f"'{text}' has its own aircraft: leave --aircraft out.")
    if colon and kind == "jsbsim":
        from structsel.simulation.jsbsim import open_jsbsim  # an optional package

        return open_jsbsim(name, rho=rho)
    if colon and kind == "builtin":
        return _open_builtin(name, definitions or {}, rho)
    model = AeroModel.from_json(text)
    if aircraft is None:
        raise typer.BadParameter("a model file is simulated with its aircraft: give --aircraft AIRCRAFT.TOML.")
    return PublishedAircraft(
        model.name or Path(text).stem,
        load_aircraft(aircraft),
        model,
        definitions=definitions or {},
        air=Atmosphere(rho=rho),
    )


def _open_builtin(name: str, definitions: Mapping[str, str], rho: float | None) -> PublishedAircraft | LinearModel:
    name, _, which = name.partition(":")
    aircraft_model = published_aircraft(name)
    if aircraft_model.model is None or which:
        if which not in aircraft_model.linear:
            choice = ", ".join(f"builtin:{name}:{key}" for key in aircraft_model.linear)
            raise ModelError(
                f"'builtin:{name}{which and ':' + which}' is not a model; there are {choice or 'builtin:' + name}."
            )
        return aircraft_model.linear[which]
    if definitions or rho is not None:
        air = aircraft_model.air if rho is None else replace(aircraft_model.air, rho=rho)
        aircraft_model = replace(aircraft_model, definitions={**aircraft_model.definitions, **definitions}, air=air)
    return aircraft_model


def trim_model(aircraft_model: PublishedAircraft | JSBSimAircraft, trim: str, controls: str, free: str = "") -> Any:
    """Steady flight of a model, a `Trim`.

    Raises
    ------
    BadParameter
        V and h are neither given nor known for this model, or an option does not apply to it.
    SimulationError
        There is no trim.
    """
    condition: dict[str, Any] = dict(read_trim(trim))
    given = read_numbers("--controls", controls, "df=0.1,rpm=1800")
    default = aircraft_model.condition if isinstance(aircraft_model, PublishedAircraft) else {}
    V, h = condition.pop("V", default.get("V")), condition.pop("h", default.get("h"))
    if V is None or h is None:
        raise typer.BadParameter("--trim needs an airspeed and an altitude: --trim V,H.")
    if not isinstance(aircraft_model, PublishedAircraft) and (
        wrong := [n for n in condition if n not in ("climb", "sideslip")]
    ):
        raise typer.BadParameter(f"an aircraft of JSBSim is trimmed in straight flight only: leave {wrong[0]} out.")
    if isinstance(aircraft_model, PublishedAircraft):
        condition["free"] = split_names(free) or aircraft_model.free or None
    elif free:
        raise typer.BadParameter("an aircraft of JSBSim is trimmed with all its controls: leave --free out.")
    return aircraft_model.trim(V, h, controls=given, **condition)


def read_inputs(files: Sequence[Path], channel_map: Path | None, option: str) -> list[Recording]:
    """Recordings of files and folders.

    Raises
    ------
    BadParameter
        A file does not exist.
    """
    for path in files:
        if not path.exists() and not any(mark in str(path) for mark in "*?["):
            raise typer.BadParameter(f"{option} '{path}' does not exist.")
    return read_manoeuvres(files, channel_map) if files else []


def add_perturbations(inputs: Recording, controls: Mapping[str, float]) -> Recording:
    """Controls of a trim with perturbations added; channels that are not controls are left out.

    Raises
    ------
    ChannelError
        None of the perturbed channels is a control.
    """
    moved = [name for name in controls if name in inputs]
    if not moved:
        raise ChannelError(
            f"'{inputs.name}' has {', '.join(inputs.names)}, but the controls of the model are {', '.join(controls)}."
        )
    if unused := [name for name in inputs.names if name not in controls]:
        which = "it" if len(unused) == 1 else "them"
        say(
            "warning",
            f"'{inputs.name}': {join_names(unused)} left out; no term of the model depends on {which}. "
            f"The controls of the model are {join_names(controls)}.",
        )
    values: dict[str, Any] = {
        name: controls[name] + inputs[name] if name in moved else controls[name] for name in controls
    }
    channels = {name: value + 0.0 * inputs.t for name, value in values.items()}
    return Recording(inputs.name, inputs.t, channels, provenance=(*inputs.provenance, "perturbations from trim"))
