"""One small result of every kind, and its report page."""

from functools import cache

import numpy as np

from structsel import (
    AeroModel,
    Candidates,
    Instruments,
    Reconstructions,
    Recording,
    ResponseModel,
    published_aircraft,
    qualify,
    reconstruct,
    refine,
    resimulate,
    select,
    validate,
)
from structsel.demo import demo_instruments
from structsel.inputs import three_two_one_one
from structsel.report import render
from tests.diagnoses import GROUND, VANE, diagnosis

TRUTH = {"1": 0.08, "alpha": -0.6, "de": -1.9, "q_hat": -30.0}


def manoeuvre(k, n=500, name=""):
    """One synthetic manoeuvre with white noise, its terms known; CZ has one that no candidate holds."""
    rng = np.random.default_rng([7, k])
    t = 0.04 * np.arange(n)
    # Steps of a 3-2-1-1 keep angle of attack, rate and elevator apart.
    de = 0.06 * np.sign(np.sin(1.1 * t + k)) * (t % 6 < 4)
    q_hat = 0.004 * np.cos(2.3 * t + 2 * k) + 0.002 * rng.standard_normal(n)
    alpha = 0.12 + 0.05 * np.sin(0.7 * t + 3 * k) + 0.01 * rng.standard_normal(n)
    values = {"1": 1.0, "alpha": alpha, "de": de, "q_hat": q_hat}
    Cm = sum(v * values[term] for term, v in TRUTH.items()) + 0.01 * rng.standard_normal(n)
    CZ = -0.3 - 4.5 * alpha - 0.5 * np.maximum(alpha - 0.15, 0.0) + 0.02 * rng.standard_normal(n)
    channels = {"alpha": alpha, "q_hat": q_hat, "de": de, "Cm": Cm, "CZ": CZ, "V": 45.0 + 100.0 * (alpha - 0.1)}
    return Recording(name or f"m{k + 1:02d}", t, channels, provenance=(f"read from '/flights/m{k + 1:02d}.csv'",))


@cache
def selected():
    """Selections, recordings (the last held out) and its validation."""
    recordings = [manoeuvre(k) for k in range(4)]
    found = select(
        recordings[:3], ["Cm", "CZ"], Candidates.polynomial(["alpha", "q_hat", "de"], 2), F_in="auto", bootstrap=20
    )
    return found, recordings, validate(found.model, recordings[3:])


@cache
def reconstructed():
    """Two manoeuvres, one of them not to be trusted, and one that failed."""
    flight = demo_instruments("all-axes", 2, duration=8.0)
    # Height is read four times a second only.
    h = flight.measured["h"].copy()
    h[np.arange(len(h)) % 12 != 0] = np.nan
    one = reconstruct(flight.measured.with_channels(h=h), flight.aircraft)
    again = Recording("second", one.recording.t, one.recording.channels, one.recording.units, one.recording.provenance)
    changes = {"name": "second", "recording": again, "distrust": ("theta and the accelerometers contradict.",)}
    wrong = type(one)(**{**one.__dict__, **changes})
    return Reconstructions((one, wrong), {"third": "no channel 'V' [m/s]"})


@cache
def refined():
    """Refinement, its recordings, and simulations of another recording before and after."""
    aircraft = published_aircraft("citation")
    start = aircraft.trim()
    flights = []
    for k, size in enumerate((0.02, -0.02), 1):
        u = three_two_one_one("de", size, 0.5, duration=8.0, dt=0.04)
        schedule = Recording(f"m0{k}", u.t, {"de": start["de"] + u["de"]})
        noise = {"V": 0.1, "alpha": 0.001, "q": 0.001, "theta": 0.001, "az": 0.05}
        flights.append(aircraft.simulate(schedule, start=start, instruments=Instruments(noise=noise, seed=k)))
    held = aircraft.model["Cm"]
    off = {"alpha": -0.7, "q_hat": -15.0, "de": -1.0}
    values = np.array([off.get(str(term), value) for term, value in zip(held.terms, held.values)])
    model = AeroModel({**aircraft.model.responses, "Cm": ResponseModel(held.terms, values)}, "off")
    free = ["Cm:1", "Cm:alpha", "Cm:q_hat", "Cm:de"]
    outputs = ["alpha", "q", "theta", "az"]
    found = refine(model, aircraft.aircraft, flights[:1], free=free, outputs=outputs, starts=["w", "q", "theta"])
    pair = {"before": model, "after": found.model}
    return found, flights, {name: resimulate(one, aircraft.aircraft, flights[1:]) for name, one in pair.items()}


@cache
def qualified():
    """Proof of match of one elevator manoeuvre, before and after a correction."""
    true = published_aircraft("citation")
    found, flights, _ = refined()
    return qualify(found.model, true.aircraft, flights[:1], corrected=true.model)


@cache
def pages():
    """HTML of each kind."""
    found, recordings, judged = selected()
    better, flights, replays = refined()
    return {
        "diagnosis": render(diagnosis(GROUND, VANE)),
        "selection": render(found, recordings=recordings, judged=judged),
        "reconstruction": render(reconstructed()),
        "refinement": render(better, recordings=flights[:1], judged=replays),
    }
