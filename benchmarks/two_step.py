"""What the first step does for the second: derivatives from readings as they are and from reconstructed flights.

Noise-free simulated flights of a Cessna Citation (the course files de3211_1, da3211_2, dr3211_1 of TU Delft AE4320,
not ours to ship) are given the course's noise, constant biases and a constant wind. Stability and control
derivatives by least squares with given terms are compared with those from the exact flights.

    python benchmarks/two_step.py FOLDER [SEEDS]

prints one Markdown table.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.io import loadmat

import structsel as ss
from structsel.coefficients import compute_all
from structsel.reconstruction import Reconstruction, reconstruct
from structsel.recording import Recording

FLIGHTS = ("de3211_1", "da3211_2", "dr3211_1")
G = 9.7836  # m/s^2; what these simulations used
START_HEIGHT, RHO = 7500.0, 0.5566
ERRORS = {
    "bax": 0.05, "bay": -0.04, "baz": 0.08, "bp": 1.5e-3, "bq": -1.0e-3, "br": 8e-4, "wn": 6.0, "we": -9.0,
}  # fmt: skip
"""Chosen biases [m/s^2, rad/s] and wind [m/s]."""
NOISE = {
    **dict.fromkeys(("ax", "ay", "az"), 0.02),
    **dict.fromkeys(("p", "q", "r"), np.radians(0.003)),
    **dict.fromkeys(("alpha", "beta"), np.radians(0.1)),
    **dict.fromkeys(("phi", "theta", "psi"), np.radians(0.05)),
    **dict.fromkeys(("x", "y", "h"), 2.5),
    **dict.fromkeys(("vn", "ve", "vd"), 0.02),
    "V": 0.1,
}
"""Standard deviations as the course has them."""
TERMS = {
    "CX": ("alpha", "alpha^2", "q_hat"),
    "CZ": ("alpha", "q_hat", "de"),
    "Cm": ("alpha", "q_hat", "de"),
    "CY": ("beta", "p_hat", "r_hat", "dr"),
    "Cl": ("beta", "p_hat", "r_hat", "da", "dr"),
    "Cn": ("beta", "p_hat", "r_hat", "da", "dr"),
}
"""Terms fitted to each response, beside a constant."""


@dataclass(frozen=True)
class Derivative:
    """One derivative from exact flights, from readings as they are, and from reconstructed flights."""

    response: str
    term: str
    truth: float
    before: float
    after: float

    @property
    def errors(self) -> tuple[float, float]:
        """Relative error before and after reconstruction."""
        return abs(self.before / self.truth - 1.0), abs(self.after / self.truth - 1.0)


def citation() -> ss.Aircraft:
    """The aircraft of the course, every instrument at the centre of gravity."""
    return ss.Aircraft.from_dict(
        {
            "schema": "structsel.aircraft/1",
            "name": "Citation",
            "mass": 4500.0,
            "S": 24.99,
            "b": 13.325,
            "cbar": 1.991,
            "inertia": {"Ix": 11187.8, "Iy": 22854.8, "Iz": 31974.8, "Ixz": 1930.1},
            "sensors": {"instruments": {"noise": NOISE}},
        }
    )


def citation_flight(path: Path, seed: int, every: int = 2) -> tuple[Recording, Recording]:
    """Exact flight and the flight as read with noise, biases and wind, every second sample (50 Hz)."""
    file = loadmat(path, squeeze_me=True)
    names = {"ax": "Ax", "ay": "Ay", "az": "Az", "V": "vtas"}
    same = ("p", "q", "r", "phi", "theta", "psi", "alpha", "beta", "de", "da", "dr")
    t = np.asarray(file["t"], dtype=float)
    exact = {name: np.asarray(file[names.get(name, name)], dtype=float) for name in (*names, *same)}
    velocity = {"vn": file["u_n"] + ERRORS["wn"], "ve": file["v_n"] + ERRORS["we"], "vd": np.asarray(file["w_n"])}
    place = {to: cumulative_trapezoid(velocity[of], t, initial=0.0) for to, of in (("x", "vn"), ("y", "ve"))}
    place["h"] = START_HEIGHT - cumulative_trapezoid(velocity["vd"], t, initial=0.0)
    exact |= {"rho": np.full(len(t), RHO), "thrust": np.zeros(len(t)), **velocity, **place}
    rng = np.random.default_rng([seed, FLIGHTS.index(path.stem)])
    read = dict(exact)
    for name, std in NOISE.items():
        read[name] = exact[name] + ERRORS.get(f"b{name}", 0.0) + std * rng.standard_normal(len(t))

    def recording(channels: dict[str, np.ndarray]) -> Recording:
        return Recording(path.stem, t[::every], {name: x[::every] for name, x in channels.items()})

    return recording(exact), recording(read)


def two_step(folder: Path, seed: int) -> tuple[list[Derivative], list[Reconstruction]]:
    """Every derivative three ways, and the reconstructions."""
    aircraft = citation()
    flights = [citation_flight(folder / f"{name}.mat", seed) for name in FLIGHTS]
    done = [reconstruct(read, aircraft, g=G) for _, read in flights]
    truth = fitted([exact for exact, _ in flights], aircraft)
    before = fitted([read for _, read in flights], aircraft)
    after = fitted([one.recording for one in done], aircraft)
    rows = [Derivative(*key, truth[key], before[key], after[key]) for key in truth]
    return rows, done


def fitted(recordings: list[Recording], aircraft: ss.Aircraft) -> dict[tuple[str, str], float]:
    """Least-squares value of every term but the constants."""
    flights = compute_all(recordings, aircraft)
    found = {}
    for response, terms in TERMS.items():
        kept = ss.select(
            flights, response, ss.Candidates.parse(terms), include=terms, noise="white", bootstrap=0, constants="shared"
        ).to_model()  # fmt: skip
        found |= {(response, term): float(kept[term]) for term in terms}
    return found


def main() -> None:
    """Print the table."""
    folder, seeds = Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 1
    runs = [two_step(folder, seed)[0] for seed in range(1, seeds + 1)]
    print("| response | term | exact | error before | error after |\n| --- | --- | ---: | ---: | ---: |")
    for rows in zip(*runs):
        before, after = (float(np.sqrt(np.mean([row.errors[i] ** 2 for row in rows]))) for i in range(2))
        print(f"| {rows[0].response} | {rows[0].term} | {rows[0].truth:.4g} | {before:.2%} | {after:.2%} |")


if __name__ == "__main__":
    main()
