"""Simulation in windows with aerodynamic coefficients given along time, many windows and variants at once.

`resimulate` simulates a model, whose coefficients are functions of the motion. Here they are tables along the recorded
path, as another simulation or a correction predicts them. Off that path they follow by their slopes: without slopes an
aircraft has neither stiffness nor damping, and drifts off within a second.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from structsel.aircraft import Aircraft
from structsel.numerics import rigid_body as rb
from structsel.numerics.air_data import air_data, air_data_at_sensor, body_velocity
from structsel.numerics.arrays import Array
from structsel.numerics.dynamic_elements import rk4


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows in recordings that stand one behind another.

    Attributes
    ----------
    start, length, recording : (w,) int array
        First sample of each window, samples after it, and number of its recording.
    dt : (w,) array [s]
    """

    start: np.ndarray
    length: np.ndarray
    recording: np.ndarray
    dt: Array

    @classmethod
    def split(cls, samples: Sequence[int], dt: Sequence[float], seconds: float) -> Windows:
        """Each recording cut into equal windows of about so many seconds; neighbours have one sample in common."""
        edges, first = [], 0
        for n, step in zip(samples, dt):
            count = max(1, round((n - 1) * step / seconds))
            edges.append(first + np.linspace(0, n - 1, count + 1).astype(int))
            first += n
        recording = np.repeat(np.arange(len(edges)), [len(e) - 1 for e in edges])
        start = np.concatenate([e[:-1] for e in edges])
        length = np.concatenate([np.diff(e) for e in edges])
        return cls(start, length, recording, np.asarray(dt)[recording])

    @property
    def sample(self) -> np.ndarray:
        """(w, samples) index of each window's samples; the last again where others are longer."""
        steps = np.arange(self.length.max() + 1)
        return self.start[:, None] + np.minimum(steps, self.length[:, None])


@dataclass(frozen=True, eq=False)
class CoefficientTables:
    """Coefficients of each variant along n samples, and the path along which they hold.

    Attributes
    ----------
    aircraft : Aircraft
        With moments of inertia.
    coefficients : (6, variants, n) array
        CX, CY, CZ, Cl, Cm, Cn.
    reading_rates : (5, variants, n) array
        Rates of V, alpha, beta, phi, theta that readings have beyond the motion; zero for perfect instruments.
    environment : (3, n) array
        Density, mass and thrust.
    at_cg : (6, n) array
        V, alpha, beta, p, q, r at the centre of gravity.
    attitude : (2, n) array
        phi and theta.
    slopes : (6, 6, n) array
        Of the coefficients with V, alpha, beta, p, q, r.
    """

    aircraft: Aircraft
    coefficients: Array
    reading_rates: Array
    environment: Array
    at_cg: Array
    attitude: Array
    slopes: Array

    def simulate(self, windows: Windows) -> Array | None:
        """Simulate each window from the state on the path; one step a sample.

        Returns
        -------
        (samples, 8, variants, w) array or None
            V, alpha, beta at the vane, p, q, r, phi, theta; None where a window diverges.
        """
        variants, steps = self.coefficients.shape[1], int(windows.length.max())
        V, alpha, beta, p, q, r = self.at_cg[:, windows.start]
        state = np.stack([*body_velocity(V, alpha, beta), p, q, r, *self.attitude[:, windows.start]])
        x = np.empty((steps + 1, 8, variants, len(windows.start)))
        x[0] = state[:, None]

        def slope(step: float, now: Array) -> Array:
            return self._slope(windows, step, now) * windows.dt

        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            for k in range(steps):
                x[k + 1] = rk4(slope, x[k], k, 1.0)
                if not np.isfinite(x[k + 1]).all():
                    return None
        V, alpha, beta = air_data(x[:, 0], x[:, 1], x[:, 2])
        vane = self.aircraft.position("vane")
        at_vane = air_data_at_sensor(V, alpha, beta, x[:, 3], x[:, 4], x[:, 5], vane)
        return np.stack([*at_vane, *np.moveaxis(x[:, 3:], 1, 0)], axis=1)

    def _slope(self, windows: Windows, step: float, x: Array) -> Array:
        """(8, variants, w) rates of u, v, w, p, q, r, phi, theta, so many samples after each window's start."""
        k = min(int(step), int(windows.length.max()) - 1)
        here, then = (windows.start + np.minimum(i, windows.length) for i in (k, k + 1))

        def at_step(table: Array) -> Array:
            return (k + 1 - step) * table[..., here] + (step - k) * table[..., then]

        rho, mass, thrust = at_step(self.environment)
        aircraft = self.aircraft
        u, v, w = x[:3]
        off_path = np.stack([*air_data(u, v, w), *x[3:6]]) - at_step(self.at_cg)[:, None]
        coefficients = at_step(self.coefficients) + np.einsum("cxw,xsw->csw", at_step(self.slopes), off_path)
        assert aircraft.inertia is not None
        airframe = rb.Airframe(
            mass, aircraft.inertia.tensor, aircraft.S, aircraft.b, aircraft.cbar, aircraft.thrust.offset,
            aircraft.thrust.inclination, aircraft.engine.angular_momentum,
        )  # fmt: skip
        rates = rb.motion_derivative(x, coefficients, rho, airframe, thrust)[:8]
        # Rates of V, alpha, beta as rates of u, v, w.
        dV, dalpha, dbeta, dphi, dtheta = at_step(self.reading_rates)
        level = np.hypot(u, w)
        relative = dV / np.hypot(level, v)
        rates[0] += relative * u - dalpha * w - dbeta * u * v / level
        rates[1] += relative * v + dbeta * level
        rates[2] += relative * w + dalpha * u - dbeta * w * v / level
        rates[6] += dphi
        rates[7] += dtheta
        return rates
