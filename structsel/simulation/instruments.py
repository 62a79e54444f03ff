"""What actuators make of commands, and instruments of a flight."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from structsel.aircraft import Aircraft
from structsel.errors import ChannelError, DomainError
from structsel.nomenclature import suggest
from structsel.numerics.dynamic_elements import actuate, delayed
from structsel.numerics.flight_model import VANES
from structsel.results import Copied


@dataclass(frozen=True)
class Actuator:
    """One actuator between a commanded channel and its surface.

    Attributes
    ----------
    lag : float [s]
        Time constant; 0 follows at once.
    rate : float [rad/s]
        Largest speed.
    backlash : float [rad]
        Whole width of the play, at the command's side.
    low, high : float [rad]
        Stops.
    """

    lag: float = 0.0
    rate: float = np.inf
    backlash: float = 0.0
    low: float = -np.inf
    high: float = np.inf

    def follow(self, t: np.ndarray, command: np.ndarray, *, hold: bool = False) -> np.ndarray:
        """(n,) position under a command; see `structsel.numerics.flight_dynamics.actuate`."""
        return actuate(
            t, command, lag=self.lag, rate=self.rate, backlash=self.backlash, low=self.low, high=self.high, hold=hold
        )


@dataclass(frozen=True, eq=False)
class Instruments(Copied):
    """Faults of the instruments; every channel that is named has its own, the others read true.

    ::

        reading(t) = round((1 + scale) true(t - delay) + bias + noise, to the resolution)

    Attributes
    ----------
    noise : mapping of channel to standard deviation
    bias, scale : mapping of channel to value
    delay : mapping of channel to [s]
        Before the start, the first value.
    resolution : mapping of channel to step
    vanes : mapping
        ``Cup``, ``Calpha0``, ``Csi``, ``Cbeta0``, ``KV``: upwash scale and offset, sidewash scale and offset, scale
        error of the airspeed.
    seed : int
        Of the noise; each channel has a stream of its own, so that one more does not change the others.
    """

    noise: Mapping[str, float] = field(default_factory=dict)
    bias: Mapping[str, float] = field(default_factory=dict)
    scale: Mapping[str, float] = field(default_factory=dict)
    delay: Mapping[str, float] = field(default_factory=dict)
    resolution: Mapping[str, float] = field(default_factory=dict)
    vanes: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0

    def __post_init__(self) -> None:
        for kind in ("noise", "bias", "scale", "delay", "resolution", "vanes"):
            held = {name: float(value) for name, value in getattr(self, kind).items()}
            for name, value in held.items():
                if not np.isfinite(value) or (kind in ("noise", "delay", "resolution") and value < 0.0):
                    raise DomainError(f"Instruments: the {kind} of '{name}' is {value:g}; it must be 0 or more.")
            object.__setattr__(self, kind, MappingProxyType(held))
        if unknown := [name for name in self.vanes if name not in VANES]:
            raise DomainError(f"Instruments have no vane error '{unknown[0]}'; there are {', '.join(VANES)}.")

    @classmethod
    def of(cls, aircraft: Aircraft, *, seed: int = 0) -> Instruments:
        """Instruments with the noise that the aircraft's sensors state, and no other fault."""
        return cls(noise=aircraft.noise, seed=seed)

    @property
    def vane_errors(self) -> np.ndarray:
        """(5,) array, as `VANES`."""
        return np.array([self.vanes.get(name, 0.0) for name in VANES])

    def read(self, t: np.ndarray, channels: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Channels as the instruments give them.

        Parameters
        ----------
        t : (n,) array [s]
        channels : mapping of channel to (n,) array
            At the instruments' places, vane errors included.

        Raises
        ------
        ChannelError
            A fault is stated for a channel that the flight does not give.
        """
        faults = {name for kind in (self.bias, self.scale, self.delay, self.resolution) for name in kind}
        if unknown := sorted(faults - set(channels)):
            raise ChannelError(
                f"Instruments state a fault of '{unknown[0]}', which this flight does not give."
                f"{suggest(unknown[0], channels)}\nIt gives: {', '.join(channels)}."
            )
        made = {}
        for name, values in channels.items():
            if delay := self.delay.get(name):
                values = delayed(values, np.asarray(t, dtype=float), delay)
            values = (1.0 + self.scale.get(name, 0.0)) * values + self.bias.get(name, 0.0)
            if std := self.noise.get(name):
                rng = np.random.default_rng([self.seed, *name.encode()])
                values = values + std * rng.standard_normal(len(t))
            if step := self.resolution.get(name):
                values = step * np.round(values / step)
            made[name] = values
        return made
