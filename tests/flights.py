"""Simulated closed-loop flights for tests of the selection: the cases the benchmarks use, and recordings of them."""

import numpy as np

from structsel.candidates import Term
from structsel.numerics.regressors import ArrayData
from structsel.recording import Recording
from tests.benchmark_modules import load_benchmark

cases = load_benchmark("cases")


def signals_of(case):
    """A case's manoeuvres as the engine takes them."""
    return [ArrayData(np.ascontiguousarray(base), responses) for base, responses in case.manoeuvres]


def fly(truth, noise=0.0, noise_model="white", lengths=(2000,), seed=0, response="CZ", **more):
    """Recordings at 50 Hz whose response is the sum of ``truth`` (term to value) and a residual of std ``noise``.

    ``more`` adds channels: name = function of (signals by name, generator).
    """
    recordings = []
    for k, n in enumerate(lengths):
        rng = np.random.default_rng([seed, k])
        channels = dict(zip(cases.SIGNALS, cases.flight_signals(n, 100 * seed + k, 10)))
        for name, make in more.items():
            channels[name] = make(channels, rng)
        y = sum(value * Term(term).evaluate(channels) for term, value in truth.items())
        channels[response] = y + noise * cases.residual(noise_model, n, rng)
        recordings.append(Recording(f"flight_{k + 1}", cases.DT * np.arange(n), channels))
    return recordings
