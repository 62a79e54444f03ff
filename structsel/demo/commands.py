"""What the demonstration's pilot flies, and the gusts the flights meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from structsel.demo.aircraft import demo_aircraft
from structsel.nomenclature import CONTROL_SURFACES
from structsel.numerics.dynamic_elements import first_order_noise

RATE = 50.0
"""Samples per second."""


@dataclass(frozen=True)
class Plan:
    """A manoeuvre: trim airspeed, and what the pilot commands.

    Each command is (surface, pattern, start [s], unit [s], size [rad]).
    """

    name: str
    V: float
    commands: tuple[tuple[str, str, float, float, float], ...]


_PATTERNS = {"3211": (3, -2, 1, -1), "doublet": (1, -1), "pulse": (1,), "hold": (8,), "121": (1, -2, 1)}
_PLANS = (
    Plan(
        "elevator-3211",
        45.0,
        (("de", "3211", 1.0, 0.5, -0.05), ("de", "3211", 11.0, 0.8, 0.05), ("de", "doublet", 22.0, 1.0, 0.06)),
    ),
    Plan(
        "aileron-rudder",
        42.0,
        (
            ("da", "3211", 1.0, 0.5, 0.15),
            ("dr", "3211", 10.0, 0.7, 0.12),
            ("da", "doublet", 18.0, 1.0, -0.2),
            ("dr", "doublet", 24.0, 0.8, -0.15),
        ),
    ),
    Plan(
        "sideslip-elevator",
        48.0,
        (
            ("dr", "hold", 1.0, 1.5, 0.16),
            ("de", "3211", 4.0, 0.6, 0.05),
            ("dr", "hold", 16.0, 1.5, -0.16),
            ("de", "3211", 19.0, 0.5, -0.05),
        ),
    ),
    Plan(
        "bank-to-bank",
        40.0,
        (
            ("da", "121", 1.0, 1.5, 0.22),
            ("dr", "doublet", 8.0, 0.6, 0.15),
            ("da", "121", 12.0, 2.0, -0.2),
            ("de", "doublet", 20.0, 0.7, -0.06),
            ("da", "doublet", 25.0, 0.6, 0.2),
        ),
    ),
    Plan(
        "slow-pull-up",
        38.0,
        (
            ("de", "hold", 2.0, 0.6, -0.06),
            ("dr", "3211", 5.0, 0.6, 0.12),
            ("de", "doublet", 12.0, 0.5, 0.07),
            ("de", "hold", 16.0, 0.7, -0.05),
            ("da", "3211", 18.0, 0.5, 0.15),
            ("de", "3211", 25.0, 0.4, 0.06),
        ),
    ),
    Plan(
        "all-axes",
        51.0,
        (
            ("de", "3211", 1.0, 0.4, -0.04),
            ("da", "doublet", 3.0, 0.8, 0.12),
            ("dr", "3211", 6.0, 0.6, 0.1),
            ("de", "hold", 12.0, 0.5, 0.04),
            ("da", "3211", 13.0, 0.6, -0.12),
            ("dr", "doublet", 19.0, 1.0, -0.14),
            ("de", "doublet", 22.0, 1.2, -0.05),
            ("da", "pulse", 26.0, 0.5, 0.15),
        ),
    ),
)
FLIGHTS = tuple(plan.name for plan in _PLANS)
"""Names `demo_flight` knows."""


def commands_of(k: int, half_steps: int) -> tuple[Plan, np.ndarray]:
    """Manoeuvre number k and its commands (half_steps, 3) [rad] on the half-step clock."""
    plan = _PLANS[k % len(_PLANS)]
    again = k // len(_PLANS)
    size = 1.0
    if again:
        # Repeats differ from the first round in airspeed and size, equally for every seed.
        rng = np.random.default_rng([k, 9])
        size = rng.uniform(0.7, 1.1) * (-1.0) ** again
        plan = Plan(f"{plan.name}-{again + 1}", plan.V + rng.uniform(-2.0, 3.0), plan.commands)
    out = np.zeros((half_steps, 3))
    for surface, pattern, start, unit, level in plan.commands:
        edge = start
        column = out[:, CONTROL_SURFACES.index(surface)]
        for units in _PATTERNS[pattern]:
            first, last = (round(2 * RATE * s) for s in (edge, edge + abs(units) * unit))
            column[first:last] += size * level * np.sign(units)
            edge += abs(units) * unit
    return plan, out


def turbulence_states(half_steps: int, V: float, rng: np.random.Generator) -> np.ndarray:
    """(half_steps, 6) gusts u v w [m/s] and p q r [rad/s]: first-order, with Dryden's scales at low height."""
    span = demo_aircraft().b
    scale = np.array([200.0, 200.0, 100.0, 4 * span / np.pi, 4 * span / np.pi, 3 * span / np.pi])
    std = np.array([0.8, 0.8, 0.8, 0.012, 0.006, 0.006])
    step = 0.5 / RATE * V / scale
    white = rng.standard_normal((half_steps, 6))
    white[0] = rng.standard_normal(6)
    out = np.empty_like(white)
    for j in range(6):
        out[:, j] = std[j] * first_order_noise(white[:, j], step[j])
    return out
