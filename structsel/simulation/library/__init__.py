"""Aircraft ready to fly: constants, models and a usual condition, from the literature."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from structsel.aircraft import Aircraft
from structsel.errors import ModelError
from structsel.model import AeroModel
from structsel.nomenclature import suggest
from structsel.recording import Recording
from structsel.results import Result
from structsel.simulation.atmosphere import Atmosphere
from structsel.simulation.flight_setup import Inputs
from structsel.simulation.library.beaver import POWER, SLIPSTREAM, beaver_aircraft, beaver_model
from structsel.simulation.library.jets import (
    HFB_RATE,
    HFB_RHO,
    citation_aircraft,
    citation_model,
    hfb320_aircraft,
    hfb320_model,
)
from structsel.simulation.library.linear import as355, hawk
from structsel.simulation.linear import LinearModel
from structsel.simulation.linearise import linearise
from structsel.simulation.simulate import simulate
from structsel.simulation.steady_flight import Trim
from structsel.simulation.trim import trim
from structsel.tables import Summary


@dataclass(frozen=True, eq=False, repr=False)
class PublishedAircraft(Result):
    """An aircraft of the library.

    Attributes
    ----------
    name : str
    aircraft : Aircraft or None
        None where only linear models are published.
    model : AeroModel or None
    linear : mapping of str to LinearModel
        By axis or by speed.
    definitions : mapping of channel to formula
        What `simulate` and `trim` need in addition to the model.
    air : Atmosphere
    condition : mapping
        V [m/s] and h [m] of a usual flight.
    controls : mapping of channel to value
        Those a trim holds.
    free : tuple of str
        Those a trim finds.
    limits : mapping of channel to (low, high)
        Of those, where they are not the usual ones.
    notes : tuple of str
        Source of the numbers, and their limits.
    """

    name: str
    aircraft: Aircraft | None = None
    model: AeroModel | None = None
    linear: Mapping[str, LinearModel] = field(default_factory=dict)
    definitions: Mapping[str, str] = field(default_factory=dict)
    air: Atmosphere = field(default_factory=Atmosphere)
    condition: Mapping[str, float] = field(default_factory=dict)
    controls: Mapping[str, float] = field(default_factory=dict)
    free: tuple[str, ...] = ()
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def trim(self, V: float | None = None, h: float | None = None, **more: Any) -> Trim:
        """Steady flight, at the usual condition unless V [m/s] or h [m] is given; more as `trim` takes it."""
        model, aircraft = self._parts("trim")
        more = {
            "definitions": self.definitions,
            "air": self.air,
            "free": self.free or None,
            "limits": self.limits,
            **more,
        }
        more["controls"] = {**self.controls, **(more.get("controls") or {})}
        if more["free"] is not None:
            more["free"] = [name for name in more["free"] if name not in more["controls"]]
        V, h = self.condition["V"] if V is None else V, self.condition["h"] if h is None else h
        return trim(model, aircraft, V, h, **more)

    def simulate(self, inputs: Inputs, **more: Any) -> Recording:
        """Fly a schedule of inputs; more as `simulate` takes it."""
        model, aircraft = self._parts("simulate")
        return simulate(model, aircraft, inputs, **{"definitions": self.definitions, "air": self.air, **more})

    def linearise(self, trimmed: Trim, **more: Any) -> LinearModel:
        """Linear model about a trim; more as `linearise` takes it."""
        model, aircraft = self._parts("linearise")
        return linearise(model, aircraft, trimmed, **{"definitions": self.definitions, "air": self.air, **more})

    def _parts(self, verb: str) -> tuple[AeroModel, Aircraft]:
        if self.model is None or self.aircraft is None:
            raise ModelError(
                f"{verb} needs a nonlinear model, and only linear ones of '{self.name}' are published: "
                f"published_aircraft('{self.name}').linear has {', '.join(self.linear)}, each with a simulate() "
                "of its own."
            )
        return self.model, self.aircraft

    def summary(self) -> Summary:
        """The aircraft, its linear models, derived channels and usual conditions."""
        about = Summary("") if self.aircraft is None else self.aircraft.summary()
        notes = [f"linear model: {key}" for key in self.linear]
        notes += [f"{name} = {text}" for name, text in self.definitions.items()]
        notes += [f"usual {name} = {value:g}" for name, value in {**self.condition, **self.controls}.items()]
        return replace(about, title=about.title or self.name, notes=(*about.notes, *notes, *self.notes))


def _beaver() -> PublishedAircraft:
    return PublishedAircraft(
        "beaver",
        beaver_aircraft(),
        beaver_model(),
        definitions={"power": POWER, "dpt": SLIPSTREAM},
        condition={"V": 45.0, "h": 609.6},
        controls={"df": 0.0, "rpm": 1800.0},
        free=("de", "da", "dr", "manifold_pressure"),
        limits={"manifold_pressure": (8.0, 37.0)},
        notes=(
            "Tjee and Mulder, Delft report LR-556, 1988; valid from 35 to 55 m/s. The engine is set by rpm and "
            "manifold_pressure [inHg]; there is no separate thrust.",
        ),
    )


def _hfb320() -> PublishedAircraft:
    return PublishedAircraft(
        "hfb320",
        hfb320_aircraft(),
        hfb320_model(),
        definitions={"q_ratio": HFB_RATE},
        air=Atmosphere(rho=HFB_RHO),
        condition={"V": 104.67, "h": 4260.0},
        free=("de", "thrust"),
        notes=("published output-error estimates [J15]; longitudinal only; Ix, Iz are assumed, not published",),
    )


def _citation() -> PublishedAircraft:
    return PublishedAircraft(
        "citation",
        citation_aircraft(),
        citation_model(),
        condition={"V": 120.0, "h": 7500.0},
        free=("de", "da", "dr", "thrust"),
        notes=(
            "[H17], means over local models whose spread is wide (CZq -268 to 190); rates taken as q cbar/V, "
            "p b/2V, r b/2V, which [H17] leaves open.",
        ),
    )


def _hawk() -> PublishedAircraft:
    linear = {"longitudinal": hawk("longitudinal"), "lateral": hawk("lateral")}
    return PublishedAircraft("hawk", linear=linear, notes=("[C89]",))


def _as355() -> PublishedAircraft:
    return PublishedAircraft("as355", linear={"80kt": as355("80kt"), "40kt": as355("40kt")}, notes=("[A10]",))


_MAKERS: dict[str, Callable[[], PublishedAircraft]] = {
    "beaver": _beaver,
    "hfb320": _hfb320,
    "citation": _citation,
    "hawk": _hawk,
    "as355": _as355,
}
PUBLISHED_AIRCRAFT: Sequence[str] = tuple(_MAKERS)
"""Names that `ready` knows."""


def published_aircraft(name: str) -> PublishedAircraft:
    """Aircraft of the library by name.

    Parameters
    ----------
    name : {"beaver", "hfb320", "citation", "hawk", "as355"}

    Returns
    -------
    PublishedAircraft

    Raises
    ------
    ModelError
        For another name.
    """
    if name not in _MAKERS:
        raise ModelError(
            f"There is no published aircraft '{name}'.{suggest(name, PUBLISHED_AIRCRAFT)} There are "
            f"{', '.join(PUBLISHED_AIRCRAFT)}."
        )
    return _MAKERS[name]()


__all__ = ["PUBLISHED_AIRCRAFT", "PublishedAircraft", "published_aircraft"]
