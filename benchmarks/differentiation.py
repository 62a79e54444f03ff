"""How far each method's first derivative is from the exact one, over noise levels and signals.

    python benchmarks/differentiation.py --seeds 20 --out differentiation.md

The figure is the rms error over the rms of the exact derivative, in per cent, ends included, the mean square over
the seeds. The noise is white, its standard deviation given relative to the signal's. Signals are sines, whose
speed is given in samples per cycle, and a short period x' = A x + B u after a 3-2-1-1 of the elevator, computed by
scipy.signal.lsim with the input's edges on samples, so that it is exact; the derivative follows from the state
equation; where that of the pitch rate jumps, at the edges, the mean of both sides counts as right.
The local polynomial has its default window, or the one of least error, which nobody knows in flight.
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable

import numpy as np
from scipy.signal import lsim
from timing import machine, one_blas_thread, publish, say, table

from structsel.errors import StructselWarning
from structsel.numerics.differentiation import differentiate

DT, SECONDS = 0.04, 20.0
LEVELS = (0.0, 0.001, 0.01, 0.05)
WINDOWS = range(5, 63, 4)
METHODS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "central h2": lambda x: differentiate(x, DT, "central", 2),
    "central h4": lambda x: differentiate(x, DT, "central", 4),
    "forward h": lambda x: differentiate(x, DT, "forward", 1),
    "forward h2": lambda x: differentiate(x, DT, "forward", 2),
    "backward h": lambda x: differentiate(x, DT, "backward", 1),
    "backward h2": lambda x: differentiate(x, DT, "backward", 2),
    "local polynomial, 9": lambda x: differentiate(x, DT, "local-polynomial", 3),
    "spline": lambda x: differentiate(x, DT, "spline"),
    "fourier": lambda x: differentiate(x, DT, "fourier"),
}


def signals() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Exact signals and derivatives by name."""
    t = DT * np.arange(round(SECONDS / DT) + 1)
    made = {}
    for samples in (200, 50, 20, 10, 5):
        w = 2.0 * np.pi / (samples * DT)
        made[f"sine, {samples} samples a cycle"] = np.sin(w * t + 0.3), w * np.cos(w * t + 0.3)
    A, B = np.array([[-1.0, 1.0], [-6.0, -1.4]]), np.array([[-0.1], [-8.0]])
    u = np.zeros(t.size)
    first = 50
    for units, sign in zip((3, 2, 1, 1), (1.0, -1.0, 1.0, -1.0)):
        u[first : first + 18 * units] = 0.05 * sign
        first += 18 * units
    # The input held over each sample, which is what its steps are.
    _, _, x = lsim((A, B, np.eye(2), np.zeros((2, 1))), u, t, interp=False)
    rate = x @ A.T + 0.5 * (u + np.concatenate(([0.0], u[:-1])))[:, None] @ B.T
    made["3-2-1-1, angle of attack"] = x[:, 0], rate[:, 0]
    made["3-2-1-1, pitch rate"] = x[:, 1], rate[:, 1]
    return made


def errors(x: np.ndarray, rate: np.ndarray, level: float, seeds: int) -> list[float]:
    """Relative rms error of every method, the best local polynomial last [%]."""
    square: dict[str, float] = dict.fromkeys([*METHODS, *map(str, WINDOWS)], 0.0)
    count = seeds if level else 1
    for seed in range(count):
        noisy = x + level * x.std() * np.random.default_rng(seed).standard_normal(x.size)
        for name, method in METHODS.items():
            square[name] += np.mean((method(noisy) - rate) ** 2)
        for window in WINDOWS:
            made = differentiate(noisy, DT, "local-polynomial", 3, window=window)
            square[str(window)] += np.mean((made - rate) ** 2)
    relative = {name: float(100.0 * np.sqrt(s / count / np.mean(rate**2))) for name, s in square.items()}
    return [*(relative[name] for name in METHODS), min(relative[str(w)] for w in WINDOWS)]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--out")
    options = parser.parse_args()
    rows = []
    with one_blas_thread(), warnings.catch_warnings():
        # The spline says that five samples a cycle are too few; the table shows it.
        warnings.simplefilter("ignore", StructselWarning)
        for name, (x, rate) in signals().items():
            for level in LEVELS:
                rows.append([name, f"{100 * level:g} %", *errors(x, rate, level, options.seeds)])
            say(name)
    head = ["signal", "noise", *METHODS, "local polynomial, best window"]
    text = f"Relative rms error of the first derivative [%], {options.seeds} seeds, dt {DT} s, {SECONDS:g} s"
    publish(f"{text}\n\n{table(head, rows)}\n\n{machine()}", options.out)


if __name__ == "__main__":
    main()
