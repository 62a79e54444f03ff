"""Recordings with a known response, for all tests of selections."""

import numpy as np

from structsel.candidates import Candidates, Term
from structsel.recording import Recording
from structsel.selection import select

TRUTH = {"1": -0.3, "alpha": -4.0, "alpha^2": 9.0, "de": -0.6, "q_hat": -12.0}
TERMS = {"alpha", "alpha^2", "de", "q_hat"}
POOL = Candidates.polynomial(["alpha", "q_hat", "de"], 3)  # 19 terms
WHITE = {"noise": "white", "bootstrap": 0}


def names(terms):
    return {str(t) for t in terms}


def columns(recordings, terms):
    """The constant and the terms over all recordings, and the response CZ."""
    X = np.vstack([np.column_stack([np.ones(len(r)), *(Term(str(t)).evaluate(r) for t in terms)]) for r in recordings])
    return X, np.concatenate([r["CZ"] for r in recordings])


def made(y, seed=0, n=1500, n_recordings=2, noise=0.1, **more):
    """Recordings of independent, well excited channels; y is a function of them."""
    recordings = []
    for k in range(n_recordings):
        rng = np.random.default_rng([seed, k])
        channels = {name: 0.1 * rng.standard_normal(n) for name in ("alpha", "de", "q_hat")}
        channels |= {name: make(channels, rng) for name, make in more.items()}
        channels["CZ"] = y(channels) + noise * rng.standard_normal(n)
        recordings.append(Recording(f"flight_{k + 1}", 0.02 * np.arange(n), channels))
    return recordings


def warnings_of(recordings, pool=POOL, **options):
    return "\n".join(select(recordings, "CZ", pool, **{"F_in": "auto", "bootstrap": 50, **options}).doubts)
