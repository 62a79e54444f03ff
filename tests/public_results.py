"""One object of each public type, from cases as small as will do; each is made once, at the first request."""

import tempfile
import warnings
from functools import cache
from pathlib import Path

import numpy as np
import scipy

import structsel as ss
from structsel.demo import demo_instruments
from structsel.simulation.library.linear import hawk
from tests.diagnoses import diagnosis
from tests.linear_flights import helicopter

T = 0.04 * np.arange(200)
POOL = ss.Candidates.parse(["alpha", "q_hat", "de"])


@cache
def _case():
    recordings, aircraft, _ = ss.demo_flights(2, duration=8.0)
    return ss.compute_all(recordings, aircraft), aircraft


@cache
def _selections():
    return ss.select(_case()[0], ["CX", "CZ", "Cm"], POOL, include=POOL.names, bootstrap=0)


@cache
def _beaver():
    published = ss.published_aircraft("beaver")
    return published, published.trim(45.0, 600.0)


@cache
def _linear():
    published, trimmed = _beaver()
    return ss.linearise(published.model, published.aircraft, trimmed, definitions=published.definitions)


@cache
def _response():
    t = 0.02 * np.arange(2000)
    de = np.sin(0.5 * t + 0.05 * t**2)
    sweep = ss.Recording("sweep", t, {"de": de, "q": scipy.signal.lfilter([0.05], [1.0, -1.9, 0.95], de)})
    return ss.frequency_response(sweep, "q", "de", band=(0.6, 4.0))


def _plant():
    """Measured and simulated responses of a test rig in two runs of 12 s."""
    t = 0.05 * np.arange(240)
    recordings, simulated = [], {}
    for k in range(2):
        u = np.sin(0.8 * t + k) + 0.5 * np.sign(np.sin(0.5 * t + k))
        y = 2.0 * u + 0.3 * u**2 + 0.02 * np.random.default_rng(k).standard_normal(t.size)
        recordings.append(ss.Recording(f"run{k}", t, {"u": u, "y": y}))
        simulated[f"run{k}"] = ss.Recording(f"run{k}", t, {"y": 2.0 * u})
    return simulated, recordings


def _estimator():
    found = ss.RecursiveEstimator("Cm", ["alpha", "de"], frequencies=np.arange(0.3, 2.0, 0.1))
    found.feed(_case()[0][0])
    return found


def _regression():
    flights, aircraft = _case()
    return ss.equation_error(_selections().model, aircraft, flights)


@cache
def _short_period():
    return hawk().keep("w", "q")


def _refined():
    inputs = ss.Recording("m1", T, {"de": 0.02 * np.sign(np.sin(1.5 * T))})
    flight = _short_period().simulate(inputs)
    return ss.refine(_short_period(), None, flight, iterations=2)


def _derivatives():
    flights, aircraft = _case()
    return ss.derivatives_by_condition(
        _selections().model, aircraft, flights, parameters=["Cm:alpha", "Cm:de"], methods=["equation error"]
    )


def _stored():
    folder = Path(tempfile.mkdtemp())
    ss.write_recording(ss.Recording("m1", T, {"alpha": np.sin(T)}), folder / "m1.csv")
    return next(iter(ss.stream_recordings(folder)))


def _reconstruction():
    flight = demo_instruments("all-axes", 1, duration=4.0)
    return ss.reconstruct(flight.measured, flight.aircraft, method="output-error")


MAKERS = {
    "Actuator": lambda: ss.Actuator(),
    "AeroModel": lambda: _selections().model,
    "Aircraft": lambda: _case()[1],
    "Atmosphere": lambda: ss.Atmosphere(),
    "Candidates": lambda: POOL,
    "Derivatives": _derivatives,
    "Diagnosis": diagnosis,
    "Ensemble": lambda: ss.ensemble([_selections().model, _selections().model]),
    "EquationError": _regression,
    "EstimateComparison": lambda: ss.compare_estimates({"select": _selections().model, "again": _regression()}),
    "Factor": lambda: POOL.base[0],
    "FrequencyResponse": _response,
    "Gust": lambda: ss.Gust("w", 5.0, 1.0, 2.0),
    "InputComparison": lambda: ss.compare_inputs(
        _short_period(), noise={"w": 0.3, "q": 0.003}, energy=0.01, duration=5.0, dt=0.1
    ),
    "InputDesign": lambda: ss.design_inputs(
        _short_period(), noise={"w": 0.3, "q": 0.003}, energy=0.01, duration=5.0, dt=0.1
    ),
    "Instruments": lambda: ss.Instruments(noise={"alpha": 0.001}),
    "LinearModel": _linear,
    "LinearStructure": helicopter,
    "Mismatch": lambda: ss.compare(*_plant()),
    "PublishedAircraft": lambda: _beaver()[0],
    "Qualification": lambda: ss.qualify(_selections().model, _case()[1], _case()[0]),
    "Reconstruction": _reconstruction,
    "Reconstructions": lambda: ss.Reconstructions((made("Reconstruction"),), {"m2": "no V"}),
    "Recording": lambda: _case()[0][0],
    "RecursiveEstimate": lambda: _estimator().estimate(),
    "RecursiveEstimator": _estimator,
    "Refinement": _refined,
    "Resimulation": lambda: ss.resimulate(_selections().model, _case()[1], _case()[0]),
    "ResponseModel": lambda: _selections().model["Cm"],
    "Selection": lambda: _selections()["Cm"],
    "Selections": _selections,
    "StoredRecording": _stored,
    "StructselError": lambda: ss.StructselError("It failed.", remedy="Call it.", cli_remedy="Run it."),
    "StructselWarning": lambda: ss.StructselWarning("Check it."),
    "Term": lambda: ss.Term("alpha^2"),
    "TransferFunction": lambda: ss.fit_transfer_function(_response(), (1, 2)),
    "Trim": lambda: _beaver()[1],
    "Turbulence": lambda: ss.Turbulence(5.0),
    "Validation": lambda: ss.validate(_selections().model, _case()[0]),
}


@cache
def made(kind):
    """The object of this type."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return MAKERS[kind]()
