"""What both kinds of truth flights share: coefficients by what was read, slow errors, and what an account gains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.signal import butter, lfilter, sosfiltfilt

from structsel.aircraft import Aircraft
from structsel.numerics import rigid_body as rb

COEFFICIENTS = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")
OFF_BY = (0.0, 0.0, 0.3, 1.0)
"""Of the stated tolerances, by which the parameters of a case's simulation and instruments are off."""
_CUTOFF = 4.0  # Hz; of the rates before they are differentiated


def measured(
    t: np.ndarray,
    held: Mapping[str, np.ndarray],
    aircraft: Aircraft,
    *,
    mass: np.ndarray | float,
    inertia: np.ndarray,
    thrust: np.ndarray,
) -> np.ndarray:
    """(n, 6) coefficients by what is read; rates are smoothed (zero phase, 4 Hz) before they are differentiated."""
    sos = butter(4, _CUTOFF, fs=1.0 / float(t[1] - t[0]), output="sos")
    smooth = [sosfiltfilt(sos, held[n]) for n in "pqr"]
    dots = [np.gradient(x, t, edge_order=2) for x in smooth]
    seat = tuple(aircraft.position("accelerometer"))
    force = rb.acceleration_at_cg(held["ax"], held["ay"], held["az"], smooth, dots, seat)
    qbar, line = held["qbar"], aircraft.thrust
    forces = rb.force_coefficients(*force, qbar, mass, aircraft.S, thrust, line.inclination)
    moments = rb.moment_coefficients(
        smooth, dots, qbar, inertia, aircraft.S, aircraft.b, aircraft.cbar, thrust, line.offset, line.inclination,
        aircraft.engine.angular_momentum,
    )  # fmt: skip
    return np.stack([*forces, *moments], axis=1)


def slow(n: int, rng: np.random.Generator, keeps: float) -> np.ndarray:
    """Unit-variance noise of first order, of which one sample keeps the share `keeps` of the last."""
    made = lfilter([1.0], [1.0, -keeps], rng.standard_normal(n + 200))[200:]
    return np.asarray(made * np.sqrt(1.0 - keeps**2))


def gains(before: Sequence[np.ndarray], after: Sequence[np.ndarray]) -> dict[str, float]:
    """Share by which the rms falls, per coefficient, over all manoeuvres."""
    b, a = (np.sqrt(np.mean(np.concatenate(list(x)) ** 2, axis=0)) for x in (before, after))
    return {axis: float(1.0 - a[k] / b[k]) if b[k] > 0 else 0.0 for k, axis in enumerate(COEFFICIENTS)}
