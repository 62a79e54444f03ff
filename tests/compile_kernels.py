"""Compile the kernels once, before the workers of pytest start: each of them would compile all for itself.

Usage: python -m tests.compile_kernels. The compiled kernels are kept in NUMBA_CACHE_DIR or beside their modules.
"""

import warnings
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import structsel as ss
from structsel.demo import demo_flights, demo_instruments, demo_missing_physics

POOL = ss.Candidates.polynomial(["alpha", "q_hat", "de"], 2)


def reconstruction():
    """Filters of the flight path, and the simulation that its test flights come from."""
    flight = demo_instruments("all-axes", 1, duration=4.0)
    for method in ("unscented", "extended", "output-error"):
        ss.reconstruct(flight.measured, flight.aircraft, method=method)


def selection():
    """Cross-products and searches of every method, with every treatment of the residuals."""
    recordings, aircraft, _ = demo_flights(4, duration=6.0)
    ready = ss.compute_all(recordings, aircraft)
    for options in ({}, {"method": "orthogonal"}, {"method": "best_subset"}, {"noise": "cluster"}):
        ss.select(ready, ["CZ", "Cm"], POOL, bootstrap=5, workers=1, **options)


def diagnosis():
    """Equations of motion with their turbulence and instruments, a refinement, and a diagnosis."""
    case = demo_missing_physics(flights=2)
    ss.refine(case.simulation, case.aircraft, case.recordings[0], free=["Cm:alpha"])
    ss.diagnose(case.simulated, list(case.recordings), case.aircraft)


def run(part):
    """One part, in a process of its own."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        part()


if __name__ == "__main__":
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as processes:
        list(processes.map(run, (reconstruction, selection, diagnosis)))
