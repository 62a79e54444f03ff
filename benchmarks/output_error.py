"""Output error and filter error on the HFB-320 record: the published estimates, time against scipy, poor starts.

The record (hfb320_1_10.asc, supplementary material of [J15]; not ours to ship) and the model of the book's test
case: drag and lift linear in V/V0 and alpha, pitching moment linear in V/V0, alpha, q and elevator; outputs V, alpha,
theta, q, q_dot, ax, az; initial states as the book holds them.

    python benchmarks/output_error.py hfb320_1_10.asc [STARTS]

prints three Markdown tables.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping
from math import cos, sin
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

import structsel as ss
from structsel.errors import RefinementError
from structsel.model import AeroModel, ResponseModel
from structsel.recording import Recording
from structsel.refinement import Refinement, refine
from structsel.simulation.atmosphere import Atmosphere

HERE = Path(__file__).parents[1]
G, RHO, V0, HALF_CHORD = 9.80665, 0.792, 104.67, 1.215
OUTPUTS = ("V", "alpha", "theta", "q", "q_dot", "ax", "az")
FIRST = {"V": 106.023, "alpha": 0.111685, "theta": 0.104887, "q": -3.32659e-3}
"""Initial states of the test case."""
NAMES = (
    *("CD:1", "CD:V_ratio", "CD:alpha", "CL:1", "CL:V_ratio", "CL:alpha"),
    *("Cm:1", "Cm:V_ratio", "Cm:alpha", "Cm:q", "Cm:de"),
)
UNIT = np.array([1.0] * 9 + [HALF_CHORD / V0, 1.0])
"""Cm:q is per rad/s here; the book's is per q 1.215 m / V0."""
BOOK_START = UNIT * np.array(
    [
        5.67516e-3,
        7.72612e-3,
        0.674256,
        -0.318267,
        0.260317,
        5.37576,
        0.0498218,
        0.0189182,
        -0.498586,
        -25.8439,
        -0.990687,
    ]
)
PUBLISHED = UNIT * np.array(
    [0.1226, -0.0645, 0.3200, -0.0929, 0.1489, 4.3278, 0.1119, 0.0039, -0.9678, -34.707, -1.5294]
)


def load(path: Path) -> Recording:
    """The record, its first sample replaced by the book's initial states for the start of the flight."""
    record = ss.read_recording(path, HERE / "examples" / "hfb320_map.toml", name="hfb320")
    first = {}
    for name, value in FIRST.items():
        channel = record[name].copy()
        channel[0] = value
        first[name] = channel
    return record.with_channels(**first)


def aircraft() -> ss.Aircraft:
    """The aircraft's constants."""
    return ss.Aircraft.from_toml(HERE / "examples" / "hfb320.toml")


def model(values: np.ndarray) -> AeroModel:
    """The book's model."""
    three = ("1", "V_ratio", "alpha")
    return AeroModel(
        {
            "CD": ResponseModel(three, values[:3]),
            "CL": ResponseModel(three, values[3:6]),
            "Cm": ResponseModel((*three, "q", "de"), values[6:]),
        },
        name="HFB-320",
    )


def estimate(record: Recording, start: np.ndarray, **options: object) -> Refinement:
    """Output error with structsel."""
    return refine(model(start), aircraft(), record, outputs=OUTPUTS, air=Atmosphere(rho=RHO), substeps=1, **options)  # type: ignore[arg-type]


def scipy_reference(
    record: Recording, start: np.ndarray, std: Mapping[str, float], descend: bool = True
) -> tuple[np.ndarray, float, int]:
    """The same problem by solve_ivp and least_squares: values, sum of squares, and the number of simulations.

    A deliberate reference: what a user would write without structsel.
    """
    plant = aircraft()
    assert plant.mass is not None
    assert plant.inertia is not None
    S, mass, Iy, chord, tilt = plant.S, plant.mass, plant.inertia.Iy, plant.cbar, plant.thrust.inclination
    arm = plant.thrust.arm[1]
    t, de, thrust = record.t, record["de"], record["thrust"]
    weights = np.array([std[name] for name in OUTPUTS])
    y = np.column_stack([record[name] for name in OUTPUTS])
    count, accuracy = [0], 1e-6 if descend else 1e-8

    def coefficients(V, alpha, q, elevator, p):  # type: ignore[no-untyped-def]
        ratio = V / V0
        CD, CL = p[0] + p[1] * ratio + p[2] * alpha, p[3] + p[4] * ratio + p[5] * alpha
        return CD, CL, p[6] + p[7] * ratio + p[8] * alpha + p[9] * q + p[10] * elevator

    def slope(s, x, p):  # type: ignore[no-untyped-def]
        V, alpha, theta, q = x
        T, qbar = np.interp(s, t, thrust), 0.5 * RHO * V * V
        CD, CL, Cm = coefficients(V, alpha, q, np.interp(s, t, de), p)
        return [
            -qbar * S / mass * CD + T / mass * cos(alpha + tilt) + G * sin(alpha - theta),
            -qbar * S / (mass * V) * CL - T / (mass * V) * sin(alpha + tilt) + q + G / V * cos(alpha - theta),
            q,
            (qbar * S * chord * Cm + arm * T) / Iy,
        ]

    def residuals(p):  # type: ignore[no-untyped-def]
        count[0] += 1
        found = solve_ivp(
            slope, (t[0], t[-1]), list(FIRST.values()), t_eval=t, args=(p,), rtol=accuracy, atol=1e-2 * accuracy
        )
        V, alpha, _, q = found.y
        CD, CL, Cm = coefficients(V, alpha, q, de, p)
        qbar = 0.5 * RHO * V**2
        CX, CZ = CL * np.sin(alpha) - CD * np.cos(alpha), -CL * np.cos(alpha) - CD * np.sin(alpha)
        simulated = np.column_stack([
            *found.y, (qbar * S * chord * Cm + arm * thrust) / Iy,
            qbar * S / mass * CX + thrust * np.cos(tilt) / mass, qbar * S / mass * CZ - thrust * np.sin(tilt) / mass,
        ])  # fmt: skip
        return ((y - simulated) / weights).ravel()

    if not descend:
        return start, float(np.sum(residuals(start) ** 2)), count[0]
    # The integrator steps over the inputs' corners with an error that jumps with the parameters and drowns narrow
    # differences: with least_squares' own steps the search stops ten and more standard deviations off.
    found = least_squares(residuals, start, jac="3-point", x_scale="jac", diff_step=1e-2)
    return found.x, 2.0 * float(found.cost), count[0]


def race(record: Recording) -> list[tuple[str, float, float, float]]:
    """Name, CPU seconds, distance from the best [std] and sum of squares of each method."""
    best = estimate(record, BOOK_START)  # compiles too
    std = dict(best.noise_std)
    methods = {
        "structsel, noise estimated": lambda: estimate(record, BOOK_START).values,
        "structsel, weighted": lambda: estimate(record, BOOK_START, cost="weighted", weights=std).values,
        "solve_ivp and least_squares, weighted": lambda: scipy_reference(record, BOOK_START, std)[0],
    }
    rows = []
    for name, run in methods.items():
        times = []
        for _ in range(3 if "structsel" in name else 1):
            begin = time.process_time()
            values = run()
            times.append(time.process_time() - begin)
        squares = scipy_reference(record, values, std, descend=False)[1]
        rows.append((name, float(np.median(times)), float(np.max(np.abs(values - best.values) / best.std)), squares))
    return rows


def poor_start(best: np.ndarray, seed: int) -> np.ndarray:
    """Every parameter off by up to a factor of three, signs at random."""
    rng = np.random.default_rng(seed)
    return best * 3.0 ** rng.uniform(-1.0, 1.0, len(best)) * rng.choice([-1.0, 1.0], len(best))


def convergence(record: Recording, best: Refinement, seed: int, **options: object) -> tuple[bool, float]:
    """Whether a poor start ends at the best estimates, and the CPU seconds it took."""
    begin = time.process_time()
    values = np.array([best[name].value for name in NAMES])
    std = np.array([best[name].std for name in NAMES])
    try:
        found = estimate(record, poor_start(values, seed), seed=seed, iterations=100, **options)
        off = np.abs(np.array([found[name].value for name in NAMES]) - values) / std
        arrived = found.converged and float(off.max()) < 0.1
    except RefinementError:
        arrived = False
    return arrived, time.process_time() - begin


def print_estimates(calm: Refinement, turbulent: Refinement) -> None:
    """Published values beside both methods', in the book's units; how far off in standard deviations of each."""
    head = ("parameter", "published", "output error", "std", "off", "filter error", "std", "off", "off (CRLB)")
    print(f"| {' | '.join(head)} |\n|{' --- |' * len(head)}")
    for name, published, unit in zip(NAMES, PUBLISHED, UNIT):
        a, b = calm[name], turbulent[name]
        cells = [f"{published / unit:.4f}", f"{a.value / unit:.4f}", f"{a.std / unit:.2g}"]
        cells += [f"{(a.value - published) / a.std:+.2f}", f"{b.value / unit:.4f}", f"{b.std / unit:.2g}"]
        cells += [f"{(b.value - published) / b.std:+.2f}", f"{(b.value - published) / b.std_white:+.2f}"]
        print(f"| {name} | {' | '.join(cells)} |")
    noise = ", ".join(f"{e.name} {e.value:.3g}" for e in turbulent.estimates if e.kind == "process")
    print(f"\nCosts: output error {calm.costs[-1]:.0f}, filter error {turbulent.costs[-1]:.0f}. {noise}.")


def main() -> None:
    """Print the tables."""
    record, starts = load(Path(sys.argv[1])), int(sys.argv[2]) if len(sys.argv) > 2 else 20
    rows = race(record)
    print("| method | CPU s | ratio | distance [std] | sum of squares |\n| --- | ---: | ---: | ---: | ---: |")
    for name, seconds, distance, squares in rows:
        print(f"| {name} | {seconds:.3f} | {rows[-1][1] / seconds:.1f} | {distance:.4f} | {squares:.3f} |")
    bests = {noise: estimate(record, BOOK_START, noise=noise) for noise in ("measurement", "process")}
    print()
    print_estimates(*bests.values())
    print("\n| method | search | starts | arrive | CPU s each |\n| --- | --- | ---: | ---: | ---: |")
    for noise, best in bests.items():
        for label, search in (("Levenberg-Marquardt alone", None), ("evolution first", "global")):
            ends = [convergence(record, best, seed, search=search, noise=noise) for seed in range(starts)]
            method = "filter error" if noise == "process" else "output error"
            count, seconds = sum(a for a, _ in ends), np.mean([s for _, s in ends])
            print(f"| {method} | {label} | {starts} | {count} | {seconds:.2f} |", flush=True)


if __name__ == "__main__":
    main()
