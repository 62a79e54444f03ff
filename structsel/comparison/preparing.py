"""Recordings and a simulation of any form, brought to flights that can be compared."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from structsel.aircraft import Aircraft
from structsel.comparison.aligning import Alignment, Flown, align
from structsel.comparison.checking import check_alike, check_recorded
from structsel.comparison.flight import AIRFRAME, OF_COEFFICIENTS, Flight, prepare_flight
from structsel.comparison.flow_angle_delays import FlowAngleDelay
from structsel.comparison.free_simulation import along_recordings
from structsel.comparison.sequences import join_continued, sequences
from structsel.comparison.simulations import OpenedSimulation, open_simulation
from structsel.comparison.surrogate import find_surrogate
from structsel.errors import DataError
from structsel.model import AeroModel
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array
from structsel.numerics.signal_quality import white_noise_std
from structsel.recording import Recording, warn_of_entry_errors

Progress = Callable[[str, int, int], None]
_ALONG_WIND = {"CX": "CD", "CZ": "CL"}
"""Response of a model in wind axes that is nearly a coefficient in body axes."""


@dataclass(frozen=True, eq=False)
class PreparedComparison:
    """Flights that carry both sides, and what was noticed on the way.

    Attributes
    ----------
    flights : tuple of Flight
    simulation : OpenedSimulation
    remarks : tuple of str
    delays : tuple of FlowAngleDelay
        Those that were removed from the recordings.
    as_recorded : tuple of Flight
        The flights before; empty if no delay was removed.
    """

    flights: tuple[Flight, ...]
    simulation: OpenedSimulation
    remarks: tuple[str, ...]
    delays: tuple[FlowAngleDelay, ...] = ()
    as_recorded: tuple[Flight, ...] = ()


def prepare(
    source: object,
    recordings: Sequence[Recording],
    aircraft: Aircraft | None,
    progress: Progress | None = None,
    *,
    aligned: bool = False,
    but_for: Collection[str] = (),
) -> PreparedComparison:
    """Bring recordings and a simulation together.

    Parameters
    ----------
    source : any of the five forms of a simulation
    recordings : sequence of Recording
    aircraft : Aircraft or None
    progress : callable, optional
    aligned : bool
        Whether recordings that continue each other are joined, where two at least remain, and delays of the flow
        angles are removed.
    but_for : collection of str
        Names of recordings that are not joined.

    Raises
    ------
    DataError
        Names, clocks or channels that do not match; nothing to compare.
    ModelError
        A simulation that cannot be opened.
    """
    if not recordings:
        raise DataError("compare needs at least one recording.")
    names = [r.name for r in recordings]
    if twice := sorted({n for n in names if names.count(n) > 1}):
        raise DataError(f"two recordings are called '{twice[0]}'. Rename one.")
    check_recorded(recordings)
    warn_of_entry_errors(recordings, stacklevel=4)
    aircraft = aircraft or _no_aircraft(recordings)
    simulation = open_simulation(source, recordings, aircraft)
    remarks: list[str] = []
    if aligned:
        recordings, simulation, remarks = _joined(recordings, simulation, but_for)
    compare = partial(_flown, aircraft=aircraft, tell=progress or (lambda what, done, of: None))
    made = compare(recordings, simulation)
    found = align(made, recordings, simulation, compare) if aligned else Alignment(made[0], remarks=tuple(made[1]))
    return PreparedComparison(
        tuple(found.flights), simulation, (*remarks, *found.remarks), found.delays, tuple(found.before)
    )


def _flown(recordings: Sequence[Recording], simulation: OpenedSimulation, aircraft: Aircraft, tell: Progress) -> Flown:
    """Flights with the simulation along them, and remarks."""
    remarks: list[str] = []
    wanted = _wanted(recordings[0], aircraft)
    flights: list[Flight] = []
    for r in recordings:
        nothing = {c: np.zeros(len(r)) for c in wanted}
        flights.append(prepare_flight(r, aircraft, simulation.along.get(r.name, nothing)))
        tell("smoothing", len(flights), len(recordings))
    if simulation.form == "forced" and aircraft.simulation.states != "raw":
        flights = [replace(f, apart=True) for f in flights]
    elif simulation.form == "free":
        flights, remarks = along_recordings(flights, simulation, aircraft, recordings)
    elif simulation.evaluate is not None:
        flights = [_ask(f, simulation, r) for f, r in zip(flights, recordings)]
    shared = [c for c in flights[0].simulated if all(c in f.simulated for f in flights)]
    if not shared:
        raise DataError("the simulation and the recordings have no response in common in all manoeuvres.")
    flights = [replace(f, simulated={c: f.simulated[c] for c in shared}) for f in flights]
    form, fit = _stated_error(flights[0], aircraft.tolerances.form), _fit_error(flights, simulation.model)
    flights = [replace(f, form_error=form, fit_error=fit) for f in flights]
    first_of = {f.name: chain[0].name for chain in sequences(recordings) for f in chain}
    flights = [replace(f, sequence=first_of.get(f.name, "")) for f in flights]
    check_alike(flights, simulation.name)
    if set(AIRFRAME) <= set(flights[0].channels) and set(shared) & set(COEFFICIENTS):
        stand_in = find_surrogate(flights, [c for c in shared if c in COEFFICIENTS])
        flights = [replace(f, surrogate=stand_in) for f in flights]
    common = set.intersection(*(set(f.measured) for f in flights)) - _unmeasured(flights)
    return [replace(f, measured={c: f.measured[c] for c in f.measured if c in common}) for f in flights], remarks


def _joined(
    recordings: Sequence[Recording], simulation: OpenedSimulation, but_for: Collection[str]
) -> tuple[Sequence[Recording], OpenedSimulation, list[str]]:
    """Recordings, the simulation along them and remarks, where two recordings at least remain.

    A free simulation is joined if its own flights have the clock of the recordings and go on as these do. One that
    began anew in each of them does not.
    """
    own = simulation.flights
    if own and not all(np.array_equal(own[r.name].t, r.t) for r in recordings):
        return recordings, simulation, []
    made = join_continued(recordings, {n: f.channels for n, f in own.items()} or simulation.along, but_for)
    if len(made.recordings) in (1, len(recordings)):  # one recording is predicted from another
        return recordings, simulation, []
    if own:
        flights = {r.name: Recording(r.name, r.t, made.simulated[r.name]) for r in made.recordings}
        simulation = replace(simulation, flights=flights)
    else:
        simulation = replace(simulation, along=made.simulated)
    return made.recordings, simulation, list(made.remarks)


def _stated_error(flight: Flight, stated: float) -> dict[str, float]:
    """Rms that the form of the simulation leaves: of a free simulation on its own flights, or as stated, if larger."""
    coefficients = (c for c in flight.simulated if c in COEFFICIENTS)
    more = {c: max(flight.form_error.get(c, 0.0), stated) for c in coefficients} if stated else {}
    return {**flight.form_error, **more}


def _fit_error(flights: Sequence[Flight], model: AeroModel | None) -> dict[str, float]:
    """Rms that a model left where it was identified, from its R2, less the white noise of these recordings."""
    made: dict[str, float] = {}
    if model is None:
        return made
    for c in flights[0].simulated.keys() & set(COEFFICIENTS):
        r2 = next((model[r].r2 for r in (c, _ALONG_WIND.get(c, c)) if r in model), np.nan)
        if 0.0 < r2 < 1.0:
            power = sum(len(f) * float(np.var(f.simulated[c])) for f in flights)
            white = sum(len(f) * white_noise_std(f.measured[c]) ** 2 for f in flights)
            made[c] = float(np.sqrt(max((1.0 - r2) / r2 - white / max(power, 1e-300), 0.0)))
    return made


def _unmeasured(flights: Sequence[Flight]) -> set[str]:
    """Kinematic responses whose channel is constant in all recordings: it was not measured, and has no noise."""
    constant = {c for c in flights[0].raw if all(c in f.raw and not np.ptp(f.raw[c]) for f in flights)}
    return {f"k_{c}" for c in constant}


def _no_aircraft(recordings: Sequence[Recording]) -> Aircraft:
    """Stand-in for plants such as test rigs, and for logs without coefficients, with the default tolerances only.

    Raises
    ------
    DataError
        The recordings are of an aircraft, and have what its coefficients are computed from.
    """
    for recording in recordings:
        if all(name in recording for name in OF_COEFFICIENTS):
            raise DataError(
                f"'{recording.name}' has {', '.join(OF_COEFFICIENTS)}: it is of an aircraft, "
                "whose geometry, mass and inertia are needed.",
                remedy="Pass Aircraft.from_toml(path).",
                cli_remedy="Give --aircraft AIRCRAFT.TOML; structsel aircraft --template prints one to fill in.",
            )
    return Aircraft(name="plant", S=1.0, b=1.0, cbar=1.0)


def _wanted(recording: Recording, aircraft: Aircraft) -> tuple[str, ...]:
    have = [c for c, needs in (("CX", "ax"), ("CY", "ay"), ("CZ", "az")) if needs in recording]
    if aircraft.inertia is not None:
        have += [c for c, needs in (("Cl", "p"), ("Cm", "q"), ("Cn", "r")) if needs in recording]
    return tuple(have)


def smoothed_recording(flight: Flight, recording: Recording) -> Recording:
    """The recording with its smooth channels in place of its raw ones."""
    known = {**flight.channels, **flight.air}
    smooth = {c: known[c] for c in recording.names if c in known}
    return replace(recording, channels=smooth, findings=())


def _ask(flight: Flight, simulation: OpenedSimulation, recording: Recording) -> Flight:
    assert simulation.evaluate is not None
    simulated = simulation.evaluate(smoothed_recording(flight, recording))
    held: dict[str, Array] = {}
    for name, x in simulated.items():
        if name not in flight.measured and name not in recording:
            continue
        values = np.broadcast_to(np.asarray(x, dtype=float), flight.t.shape)
        if not np.isfinite(values).all():
            i = int(np.argmin(np.isfinite(values)))
            raise DataError(
                f"the simulation gives {name} = {values[i]} in '{flight.name}' at t = {flight.t[i]:g} s.\n"
                "It must hold at every recorded state: leave the manoeuvre out, or correct the simulation."
            )
        held[name] = np.array(values)
    measured = {c: x for c, x in flight.measured.items() if c in held or c not in COEFFICIENTS}
    for name in held:
        if name not in measured:
            measured[name] = np.asarray(recording[name])
    return replace(flight, simulated=held, measured=measured)
