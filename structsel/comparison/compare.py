"""Compares a simulation with recordings: how far apart they are, when, where, at what frequencies, and of what kind."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from structsel.aircraft import Aircraft
from structsel.comparison.flight import AIRFRAME, Flight
from structsel.comparison.locating.ceiling import explainable
from structsel.comparison.locating.changes import find_changes, find_windows, joined
from structsel.comparison.locating.character import characterise
from structsel.comparison.locating.coherence import coherences
from structsel.comparison.locating.refitted import Refitted, refit
from structsel.comparison.locating.region import Bound, bounds_of_flags
from structsel.comparison.locating.turbulence import find_turbulence
from structsel.comparison.noise import bins_of, edge_of
from structsel.comparison.preparing import prepare
from structsel.comparison.result import Mismatch, Size
from structsel.comparison.simulations import require_simulation
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.fourier_series import spectrum
from structsel.recording import Recording
from structsel.recording.arguments import as_recordings, require_kind

if TYPE_CHECKING:
    import pandas as pd

Progress = Callable[[str, int, int], None]

_STEPS = 4


def compare(
    simulation: Any,
    recordings: Recording | pd.DataFrame | Sequence[Recording | pd.DataFrame],
    aircraft: Aircraft | None = None,
    progress: Progress | None = None,
) -> Mismatch:
    """Where, when and how a simulation and recordings part.

    Parameters
    ----------
    simulation : AeroModel, callable, str or Path, or mapping of recording to Recording
        A model or its file; ``"jsbsim:AIRCRAFT"``; ``"python:module:function"``; files (or their folder) with the
        recordings' names that hold coefficients or channels along them (forced), or the simulation's own flights
        (free).
    recordings : Recording, DataFrame, or sequence of these
        One manoeuvre each; for a DataFrame see `Recording.from_frame`.
    aircraft : Aircraft, optional
        With its tolerances. Not needed for plants, whose recordings have no channels of a flight.
    progress : callable, optional
        Called with the step, the amount done, and the total amount.

    Returns
    -------
    Mismatch

    Raises
    ------
    ArgumentError
        The simulation, the recordings or the aircraft are objects of another type.
    DataError
        Names, clocks, channels or envelopes that do not match, samples that are not finite, a simulation that diverged
        or is of another aircraft.
    ModelError
        A simulation that cannot be opened.
    """
    tell = progress or (lambda what, done, of: None)
    call = "compare(simulation, recordings, aircraft)"
    recordings = as_recordings(recordings, call)
    require_simulation(simulation, call)
    if aircraft is not None:
        require_kind(aircraft, Aircraft, call)
    made = prepare(simulation, recordings, aircraft, tell)
    flights = made.flights
    compared = tuple(c for c in flights[0].simulated if c in flights[0].measured)
    tell("locating", 0, _STEPS)
    refitted = refit(flights)
    # A plant has neither kinematics nor air about it.
    flying = set(AIRFRAME) <= set(flights[0].channels)
    turbulence = find_turbulence(flights, refitted.residuals) if flying else None
    tell("locating", 1, _STEPS)
    windows = find_windows(flights, refitted.spectra, refitted.noise, compared)
    changes = find_changes(flights, refitted.spectra, refitted.noise, compared)
    intervals = joined(windows, flights)
    tell("locating", 2, _STEPS)
    found = coherences(flights, refitted.residuals, compared)
    kinds = characterise(flights, refitted.spectra, refitted.noise) if set(compared) & set(COEFFICIENTS) else []
    tell("locating", 3, _STEPS)
    ceiling = explainable(flights, [f.difference for f in flights], compared)
    tell("locating", _STEPS, _STEPS)
    remarks = list(made.remarks)
    if len(flights) == 1:
        remarks.append(
            "a single manoeuvre: nothing can be held out, so neither the ceiling nor the character is judged; what is "
            "said of sizes, times and coherence holds for this manoeuvre only"
        )
    return Mismatch(
        form=made.simulation.form,
        simulation=made.simulation.name,
        recordings=tuple(f.name for f in flights),
        sizes={c: _size(flights, refitted, c) for c in compared},
        windows=tuple(windows),
        intervals={name: tuple(each) for name, each in intervals.items()},
        region=_region(flights, intervals),
        changes=tuple(changes),
        coherences=tuple(found),
        characters=tuple(kinds),
        explainable=ceiling,
        turbulence=turbulence,
        deviations=refitted.deviations,
        remarks=tuple(remarks),
        flights=flights,
        refitted=refitted,
    )


def _size(flights: Sequence[Flight], refitted: Refitted, response: str) -> Size:
    """Rms of one response in the compared band, levels aside."""
    samples = sum(len(f) for f in flights)

    def rms(parts: Sequence[np.ndarray]) -> float:
        return float(np.sqrt(sum(float(x @ x) for x in parts) / samples))

    def banded(each: Sequence[np.ndarray]) -> list[np.ndarray]:
        return [spectrum(x, bins_of(f), edge_of(f))[1:] for f, x in zip(flights, each)]

    return Size(
        measured=rms(banded([f.measured[response] for f in flights])),
        difference=rms(banded([f.difference[response] for f in flights])),
        refitted=rms([s[response][1:] for s in refitted.spectra]),
        noise=refitted.noise_rms[response],
    )


def _region(flights: Sequence[Flight], intervals: Mapping[str, Sequence[tuple[float, float]]]) -> dict[str, Bound]:
    flags = []
    for f in flights:
        on = np.zeros(len(f), dtype=bool)
        for a, b in intervals[f.name]:
            on |= (f.t >= a) & (f.t <= b)
        flags.append(on)
    return bounds_of_flags(flights, flags)
