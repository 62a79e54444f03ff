"""The air a simulated flight goes through."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from structsel.deprecation import renamed_arguments, renamed_attribute
from structsel.errors import DomainError
from structsel.numerics.atmosphere import G0, dryden_gusts, dryden_scales, log_law, one_minus_cosine, power_law

_AXES = ("u", "v", "w")


@dataclass(frozen=True)
class Gust:
    """A discrete gust (size / 2)(1 - cos) along a body axis.

    Attributes
    ----------
    axis : {"u", "v", "w"}
    size : float [m/s]
        Motion of the air, forward, right, down: one that lifts the aircraft is negative in w.
    start, duration : float [s]
        The duration is the gust's length over the airspeed.
    """

    axis: str
    size: float
    start: float
    duration: float

    def __post_init__(self) -> None:
        if self.axis not in _AXES:
            raise DomainError(f"A gust along '{self.axis}' cannot be; the axes are u, v and w.")


@dataclass(frozen=True)
class Turbulence:
    """Dryden turbulence, drawn for the height and airspeed at the start.

    Attributes
    ----------
    W20 : float [m/s]
        Wind at 20 ft: 7.7 is light, 15.4 moderate, 23.2 severe.
    seed : int
    high : float or None [m/s]
        Intensity above 2000 ft; 0.1 W20 where not given.
    ground : float [m]
        Altitude of the ground below.
    rates : bool
        Whether the air turns as well (p, q, r), by the span.

    References
    ----------
    [MIL8785]
    """

    W20: float
    seed: int = 0
    high: float | None = None
    ground: float = 0.0
    rates: bool = True


@renamed_arguments(warmer="isa_offset")
@dataclass(frozen=True, eq=False)
class Atmosphere:
    """Atmosphere, wind and gusts.

    Attributes
    ----------
    isa_offset : float [K]
        Than the standard atmosphere, at the same pressure altitude.
    wind : (3,) or (k, 3) array-like [m/s]
        Of the air, north, east, down; a row for each of `heights` where it changes with altitude.
    heights : (k,) array-like [m]
        Altitudes of the rows of `wind`, ascending; linear between, constant beyond.
    gusts : tuple of Gust
    turbulence : Turbulence or None
    rho : float or None [kg/m^3]
        Density held throughout, instead of the atmosphere's at the altitude.
    gravity : float [m/s^2]

    Raises
    ------
    DomainError
        Heights that do not ascend, or are not as many as the winds.
    """

    isa_offset: float = 0.0
    wind: Any = (0.0, 0.0, 0.0)
    heights: Any = (0.0,)
    gusts: tuple[Gust, ...] = ()
    turbulence: Turbulence | None = None
    rho: float | None = None
    gravity: float = G0
    warmer = renamed_attribute("isa_offset")

    def __post_init__(self) -> None:
        wind = np.atleast_2d(np.array(self.wind, dtype=float))
        heights = np.atleast_1d(np.array(self.heights, dtype=float))
        if wind.shape != (len(heights), 3) or not np.isfinite(wind).all():
            raise DomainError(
                f"An Atmosphere has wind of shape {wind.shape} at {len(heights)} heights: each height needs its own "
                "north, east and down component."
            )
        if not (np.diff(heights) > 0.0).all():
            raise DomainError("An Atmosphere needs the heights of its wind in ascending order.")
        for array in (wind, heights):
            array.setflags(write=False)
        object.__setattr__(self, "wind", wind)
        object.__setattr__(self, "heights", heights)
        object.__setattr__(self, "gusts", tuple(self.gusts))

    @classmethod
    def sheared(
        cls,
        speed: float,
        direction: float,
        *,
        reference: float = 10.0,
        law: str = "power",
        ground: float = 0.0,
        top: float = 600.0,
        turbulence: Turbulence | None = None,
    ) -> Atmosphere:
        """Atmosphere whose wind grows with height above ground.

        Parameters
        ----------
        speed : float [m/s]
            At the reference height.
        direction : float [rad]
            Where the wind comes from, from north over east.
        reference : float [m]
            Height above ground.
        law : {"power", "log"}
            (h / reference)^(1/7), or ln(h / 0.15 ft).
        ground : float [m]
            Altitude of the ground.
        top : float [m]
            Height above ground from which the wind is constant.
        turbulence : Turbulence, optional

        Raises
        ------
        DomainError
            For another law.
        """
        laws = {"power": power_law, "log": log_law}
        if law not in laws:
            raise DomainError(f"There is no wind law '{law}'; there are {', '.join(laws)}.")
        above = np.concatenate([[0.0], np.geomspace(0.05, top, 200)])
        size = laws[law](above, speed, reference)
        wind = np.column_stack([-size * np.cos(direction), -size * np.sin(direction), np.zeros_like(size)])
        return cls(wind=wind, heights=ground + above, turbulence=turbulence)

    def motion(self, t: np.ndarray, V: float, h: float, b: float) -> np.ndarray:
        """(n, 6) gusts along a flight: u, v, w [m/s], p, q, r [rad/s] of the air in body axes.

        Parameters
        ----------
        t : (n,) array [s]
        V, h : float [m/s, m]
            At the start.
        b : float [m]
            Span.
        """
        out = np.zeros((len(t), 6))
        if self.turbulence is not None:
            rough = self.turbulence
            scales = dryden_scales(h - rough.ground, rough.W20, rough.high)
            out += dryden_gusts(t, V, b, *scales, np.random.default_rng(rough.seed))
            if not rough.rates:
                out[:, 3:] = 0.0
        for gust in self.gusts:
            out[:, _AXES.index(gust.axis)] += one_minus_cosine(t, gust.start, gust.duration, gust.size)
        return out
