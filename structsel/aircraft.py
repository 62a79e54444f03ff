"""Aircraft: geometry, mass, inertia, thrust line, places of the instruments; read from TOML.

SI units and radians; body axes x forward, y right, z down, from the centre of gravity.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from structsel.errors import AircraftError
from structsel.files import write_text
from structsel.readers.channel_map import describe_problems
from structsel.readers.toml import load_toml, toml_text
from structsel.results import Summarised
from structsel.tables import Summary

_PART_OF = {"alpha_vane": "vane", "beta_vane": "vane", "pitot": "vane"}

# Strict: a number in quotes is not a number.
_Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
_Positive = Annotated[float, Field(strict=True, gt=0.0, allow_inf_nan=False)]
_NotNegative = Annotated[float, Field(strict=True, ge=0.0, allow_inf_nan=False)]
Position = tuple[_Finite, _Finite, _Finite]
Tolerance = _NotNegative | Literal["exact", "free"]


class _Table(BaseModel):
    """A table of aircraft.toml: no unknown keys, nothing to change afterwards."""

    model_config = ConfigDict(defer_build=True, extra="forbid", frozen=True, populate_by_name=True)


class Inertia(_Table):
    """Moments and products of inertia about the centre of gravity [kg m^2].

    The products are the integrals of x z, x y and y z over the mass, so they stand with a minus
    sign in the tensor.
    """

    Ix: _Positive
    Iy: _Positive
    Iz: _Positive
    Ixz: _Finite = 0.0
    Ixy: _Finite = 0.0
    Iyz: _Finite = 0.0

    @property
    def tensor(self) -> np.ndarray:
        """(3, 3) array [kg m^2]: angular momentum is ``tensor @ (p, q, r)``."""
        return np.array(
            [
                [self.Ix, -self.Ixy, -self.Ixz],
                [-self.Ixy, self.Iy, -self.Iyz],
                [-self.Ixz, -self.Iyz, self.Iz],
            ]
        )

    @property
    def excess(self) -> float:
        """How far the largest principal moment exceeds the sum of the others, relative; 0 in any body."""
        low, middle, high = np.linalg.eigvalsh(self.tensor)
        return max(0.0, float(high / (low + middle) - 1.0))

    @model_validator(mode="after")
    def _is_a_body(self) -> Inertia:
        if np.linalg.eigvalsh(self.tensor)[0] <= 0.0:
            raise ValueError(
                "the products of inertia are too large for the moments (the tensor is not positive "
                "definite); check their unit"
            )
        return self


class Thrust(_Table):
    """Line of the total thrust.

    Attributes
    ----------
    offset : (x, y, z) [m]
        A point of the line, from the centre of gravity.
    inclination : float [rad]
        Positive tilts the thrust up (-z).
    """

    offset: Position = (0.0, 0.0, 0.0)
    inclination: Annotated[float, Field(strict=True, ge=-math.pi, le=math.pi)] = 0.0

    @property
    def direction(self) -> np.ndarray:
        """(3,) unit vector of the thrust in body axes [-]."""
        return np.array([math.cos(self.inclination), 0.0, -math.sin(self.inclination)])

    @property
    def arm(self) -> np.ndarray:
        """(3,) moment about the centre of gravity per unit of thrust [m], offset x direction."""
        return np.cross(np.array(self.offset), self.direction)


class Sensor(_Table):
    """One instrument.

    Attributes
    ----------
    position : (x, y, z) [m]
        From the centre of gravity.
    noise : dict of str to float
        Standard deviation by channel, in the channel's unit.
    angle : {"sideslip", "flank"}
        What a sideslip vane reads: asin(v/V), or atan(v/u).
    """

    position: Position = (0.0, 0.0, 0.0)
    noise: dict[str, _NotNegative] = Field(default_factory=dict)
    angle: Literal["sideslip", "flank"] = "sideslip"


class Tolerances(_Table):
    """How far off (1 sigma) a simulation and the instruments may be before it is physics.

    Each is a number, ``"exact"`` (cannot be off) or ``"free"`` (may be off by any amount).

    Attributes
    ----------
    main, secondary : relative, main and other derivatives of the simulation
    mass, inertia, thrust, vane_scale : relative
    cg : of cbar
    alignment : [rad], vanes and inertial axes
    delay : [s], between channels
    lever_arm : [m]
    form : relative to the variation of each response
        Rms that terms which the simulation does not have may leave, as its residual does where it was identified.
    """

    main: Tolerance = 0.05
    secondary: Tolerance = 0.15
    mass: Tolerance = 0.01
    inertia: Tolerance = 0.05
    cg: Tolerance = 0.005
    thrust: Tolerance = 0.03
    vane_scale: Tolerance = 0.015
    alignment: Tolerance = 0.005
    delay: Tolerance = 0.005
    lever_arm: Tolerance = 0.15
    form: _NotNegative = 0.0


class Engine(_Table):
    """Rotating parts.

    Attributes
    ----------
    angular_momentum : float [kg m^2/s]
        Along body x, positive as p is.
    """

    angular_momentum: _Finite = 0.0


class Simulation(_Table):
    """What is known of a simulation to compare against.

    Attributes
    ----------
    states : {"reconstructed", "raw"} or None
        The states its coefficients were computed at, where that is known.
    """

    states: Literal["reconstructed", "raw"] | None = None


class Aircraft(Summarised, _Table):
    """An aircraft's constants, validated and frozen.

    Attributes
    ----------
    name : str
    S : float [m^2]
        Reference area.
    b, cbar : float [m]
        Span and mean chord.
    mass : float or None [kg]
        None where the recordings carry a ``mass`` channel.
    inertia : Inertia or None
        None where no moments are wanted.
    thrust : Thrust
    sensors : dict of str to Sensor
        ``accelerometer``, ``vane`` (alpha, beta, V) and others; see `position` and `noise`.
    tolerances : Tolerances
    engine : Engine
    simulation : Simulation
    V0 : float or None [m/s]
        Reference airspeed of ``V_ratio``.

    Raises
    ------
    AircraftError
        When a key is missing, unknown or out of range.
    """

    schema_name: Literal["structsel.aircraft/1"] = Field(default="structsel.aircraft/1", alias="schema")
    name: str
    S: _Positive
    b: _Positive
    cbar: _Positive
    mass: _Positive | None = None
    V0: _Positive | None = None
    inertia: Inertia | None = None
    thrust: Thrust = Field(default_factory=Thrust)
    sensors: dict[str, Sensor] = Field(default_factory=dict)
    tolerances: Tolerances = Field(default_factory=Tolerances)
    engine: Engine = Field(default_factory=Engine)
    simulation: Simulation = Field(default_factory=Simulation)

    def __init__(self, **content: Any) -> None:
        try:
            super().__init__(**content)
        except ValidationError as error:
            raise AircraftError(_explain(error, f"aircraft '{content.get('name', 'without a name')}'")) from error

    @model_validator(mode="after")
    def _states_a_noise_once(self) -> Aircraft:
        owner: dict[str, str] = {}
        for name, sensor in self.sensors.items():
            for channel in sensor.noise:
                if channel in owner:
                    raise ValueError(f"sensors '{owner[channel]}' and '{name}' both state the noise of '{channel}'")
                owner[channel] = name
        return self

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Aircraft:
        """Aircraft from a mapping of the form aircraft.toml has.

        Raises
        ------
        AircraftError
            Naming every key that is missing, unknown or out of range.
        """
        return cls(**dict(content))

    @classmethod
    def from_toml(cls, path: str | Path) -> Aircraft:
        """Aircraft from a TOML file.

        Raises
        ------
        AircraftError
            When the file is missing or no TOML, or for what `from_dict` refuses; the message names
            the file.
        """
        path = Path(path)
        content = load_toml(path, "aircraft file", AircraftError)
        try:
            return cls(**content)
        except AircraftError as error:
            cause = error.__cause__
            if isinstance(cause, ValidationError):
                raise AircraftError(_explain(cause, f"aircraft file '{path}'")) from cause
            raise

    def to_dict(self) -> dict[str, Any]:
        """Content as `from_dict` takes it, defaults written out."""
        return self.model_dump(mode="json", by_alias=True, exclude_none=True)

    def to_toml(self, path: str | Path) -> None:
        """Write the aircraft to a TOML file, which `from_toml` reads; defaults are written out."""
        write_text(Path(path), toml_text(self.to_dict()) + "\n")

    def position(self, sensor: str) -> np.ndarray:
        """(3,) place of an instrument from the centre of gravity [m]; zero if none is given.

        ``alpha_vane``, ``beta_vane`` and ``pitot`` are at the ``vane`` unless they have tables of their own.
        """
        held = self.sensors.get(sensor) or self.sensors.get(_PART_OF.get(sensor, sensor))
        return np.zeros(3) if held is None else np.array(held.position)

    @property
    def noise(self) -> dict[str, float]:
        """Standard deviation of the noise by channel, as far as the sensors' tables state any above zero."""
        return {c: std for sensor in self.sensors.values() for c, std in sensor.noise.items() if std > 0.0}

    def require_inertia(self, by: str) -> Inertia:
        """Inertia, or an error that says who needs it.

        Raises
        ------
        AircraftError
            When there is none.
        """
        if self.inertia is None:
            raise AircraftError(
                f"{by} needs the moments of inertia; aircraft '{self.name}' has none.\n"
                "Add an [inertia] table with Ix, Iy, Iz and Ixz [kg m^2]."
            )
        return self.inertia

    @property
    def remarks(self) -> tuple[str, ...]:
        """What should be doubted in these constants, though it can be used."""
        said = []
        if self.inertia is not None and self.inertia.excess > 1e-3:
            said.append(
                f"the largest principal moment of inertia exceeds the sum of the other two by "
                f"{self.inertia.excess:.1%}, which no body does: Ix, Iy or Iz is off by about that"
            )
        if self.cbar > self.b:
            said.append(f"the chord ({self.cbar:g} m) is longer than the span ({self.b:g} m)")
        aspect = self.b**2 / self.S
        if not 0.3 < aspect < 60.0:
            said.append(f"the aspect ratio b^2/S is {aspect:.3g}: check the units of b and S")
        return tuple(said)

    def summary(self) -> Summary:
        """Geometry, mass, inertia, thrust line and sensors."""
        notes = ["mass from the recordings" if self.mass is None else f"mass = {self.mass:g} kg"]
        if self.inertia is not None:
            parts = [f"{key} = {value:g}" for key, value in self.inertia if value or key in ("Ix", "Iy", "Iz")]
            notes.append("inertia: " + ", ".join(parts) + " kg m^2")
        offset = ", ".join(f"{x:g}" for x in self.thrust.offset)
        notes.append(f"thrust: through ({offset}) m, inclined {self.thrust.inclination:g} rad up")
        for key, sensor in self.sensors.items():
            notes.append(f"{key}: at ({', '.join(f'{x:g}' for x in sensor.position)}) m")
        if self.V0 is not None:
            notes.append(f"reference airspeed V0 = {self.V0:g} m/s")
        about = f"S = {self.S:g} m^2, b = {self.b:g} m, cbar = {self.cbar:g} m"
        return Summary(self.name, about, notes=tuple(notes), warnings=self.remarks)


_TABLES: dict[str, type[_Table]] = {
    "": Aircraft,
    "inertia": Inertia,
    "thrust": Thrust,
    "sensors": Sensor,
    "tolerances": Tolerances,
    "engine": Engine,
    "simulation": Simulation,
}
_KEYS = {
    table: tuple("schema" if key == "schema_name" else key for key in model.model_fields)
    for table, model in _TABLES.items()
}


def _explain(error: ValidationError, what: str) -> str:
    return f"{what} cannot be used.\n{describe_problems(error, _KEYS)}\nUnits are SI and radians."
