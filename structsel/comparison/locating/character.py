"""Kind of the residual: a function of the state, of its past, of an instrument, a surface, or an inertia."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from structsel.comparison.flight import Flight
from structsel.comparison.noise import Noise, bins_of, edge_of
from structsel.comparison.responses import KINEMATIC
from structsel.deprecation import renamed_attribute
from structsel.nomenclature import COEFFICIENTS, CONFIGURATION
from structsel.numerics.arrays import Array
from structsel.numerics.fourier_series import spectrum

Columns = Callable[[Flight], list[Array]]

_STATES = ("alpha", "beta", "p_hat", "q_hat", "r_hat", "V", "CT", *CONFIGURATION, "h_agl")
_CONTROLS = ("de", "da", "dr")
_BENDING = ("alpha", "beta", "de", "da", "dr")
_PAST = ("alpha", "beta")  # past rates of turn, and their slopes, hold the noise of the moments that are tested
_LAGS = (0.15, 0.4, 1.0)  # s
_SIGNIFICANCE = 0.05
_HELD_TO = 3e-3  # of each column's power, so that columns that nearly coincide have nearly equal values
_MATERIAL = 0.02  # fraction of the residual, below which it is not reported


@dataclass(frozen=True)
class Character:
    """One kind of explanation of the residual of one response.

    Attributes
    ----------
    kind : {"static", "memory", "actuator", "inertial", "kinematic"}
    response : str
    fraction : float
        Of the whitened residual's power that it predicts on flights not used for the fit, beyond the kinds that it was
        tested against; below zero where it predicts nothing.
    statistic : float
        Mean over flights of what it predicts, over its standard error.
    p : float
        Of as much in noise, in any of the tests made.
    """

    kind: str
    response: str
    fraction: float
    statistic: float
    p: float

    share = renamed_attribute("fraction")

    @property
    def significant(self) -> bool:
        """Whether it is significant, and of a size that matters."""
        return self.p < _SIGNIFICANCE and self.fraction > _MATERIAL


def characterise(flights: Sequence[Flight], spectra: Sequence[Mapping[str, Array]], noise: Noise) -> list[Character]:
    """Tests of each kind in each response, largest fraction first.

    Nested sets of columns: functions of the present state; then its recent past (memory); or the rates and recent
    past of the controls (actuator), or the accelerations (inertial). Disagreements of the instruments (``k_...``) are
    tested on the readings and their rates (kinematic). Each flight is predicted from the others, and Student's t
    judges the mean gain over flights, which are independent whatever the autocorrelation of their residuals; p is
    multiplied by the number of tests. With fewer than three flights nothing is tested.

    Parameters
    ----------
    flights : sequence of Flight
    spectra : sequence of mapping of response to (1 + bins,) array
        Cosine coefficients of the residual, per flight.
    noise : Noise
    """
    if len(flights) < 3:
        return []
    cuts = np.cumsum([bins_of(f) for f in flights])[:-1]
    names = [c for c in flights[0].responses if c in spectra[0]]
    forces = [c for c in names if c in COEFFICIENTS]
    made: list[Character] = []
    if forces:
        static, past, surfaces, turning = (
            _spectra(flights, x) for x in (_static, _remembered, _commanded, _accelerations)
        )
        for c in forces:
            y, w = _white(flights, spectra, noise, c)
            base = static * w
            none = np.zeros((len(y), 0))
            for kind, X, others in (
                ("static", static, none),
                ("memory", past, base),
                ("actuator", surfaces, base),
                ("inertial", turning, base),
            ):
                made += _test(kind, c, y, others, X * w, cuts)
        readings = _spectra(flights, _readings)
        for c in names:
            if c in KINEMATIC:
                y, w = _white(flights, spectra, noise, c)
                made += _test("kinematic", c, y, np.zeros((len(y), 0)), readings * w, cuts)
    tests = max(len(made), 1)
    fair = [Character(m.kind, m.response, m.fraction, m.statistic, min(1.0, m.p * tests)) for m in made]
    return sorted(fair, key=lambda m: -m.fraction)


def _white(
    flights: Sequence[Flight], spectra: Sequence[Mapping[str, Array]], noise: Noise, response: str
) -> tuple[Array, Array]:
    w = np.concatenate([1.0 / noise.std(f, response, bins_of(f))[1:] for f in flights])
    return np.concatenate([s[response][1:] for s in spectra]) * w, w[:, None]


def _spectra(flights: Sequence[Flight], columns: Columns) -> Array:
    made = [
        spectrum(np.column_stack([*columns(f), np.zeros(len(f))]), bins_of(f), edge_of(f))[1:, :-1] for f in flights
    ]
    return np.vstack(made)


def _test(kind: str, response: str, y: Array, others: Array, X: Array, cuts: Array) -> list[Character]:
    if not X.shape[1]:
        return []
    before = _predicted_from_others(others, y, cuts) if others.shape[1] else np.zeros(len(y))
    after = _predicted_from_others(np.column_stack([others, X]), y, cuts)
    parts = zip(np.split(y, cuts), np.split(before, cuts), np.split(after, cuts))
    # Relative to each flight's own power: one that is large does not speak for the others.
    gains = np.array([float((a - b) @ (a - b) - (a - c) @ (a - c)) / max(float(a @ a), 1e-300) for a, b, c in parts])
    fraction = float(((y - before) ** 2).sum() - ((y - after) ** 2).sum()) / max(float(y @ y), 1e-300)
    error = float(gains.std(ddof=1)) / np.sqrt(len(gains))
    statistic = float(gains.mean()) / max(error, 1e-12)
    return [Character(kind, response, fraction, statistic, float(scipy.stats.t.sf(statistic, len(gains) - 1)))]


def _predicted_from_others(X: Array, y: Array, cuts: Array) -> Array:
    """Each flight from a ridge regression on the others."""
    size = np.sqrt((X**2).mean(axis=0))
    X = X[:, size > 0.0] / size[size > 0.0]
    rows = list(zip(np.split(X, cuts), np.split(y, cuts)))
    A, b = X.T @ X, X.T @ y
    held = _HELD_TO * len(y) * np.eye(X.shape[1])
    return np.concatenate([x @ np.linalg.solve(A - x.T @ x + held, b - x.T @ part) for x, part in rows])


def _here(f: Flight, names: Sequence[str]) -> list[str]:
    return [c for c in names if c in f or c in f.channels]


def _static(f: Flight) -> list[Array]:
    names = _here(f, (*_STATES, *_CONTROLS))
    bent = _here(f, _BENDING)
    made = [f[c] - f[c].mean() for c in names]
    made += [f[a] * f[b] for i, a in enumerate(bent) for b in bent[i:]]
    # A kink at high angle of attack is a function of the state as well.
    return [*made, f["alpha"] ** 3, *(f["alpha"] * f[c] for c in _here(f, ("p_hat", "q_hat", "r_hat", "V")))]


def _delayed_values(f: Flight, channel: str) -> list[Array]:
    x, made = f[channel], []
    for lag in _LAGS:
        k = min(round(lag / f.dt), len(f) - 1)
        made.append(np.concatenate([np.full(k, x[0]), x[: len(x) - k]]))
    return made


def _remembered(f: Flight) -> list[Array]:
    return [x for c in _here(f, _PAST) for x in (*_delayed_values(f, c), f.rate(f[c]))]


def _commanded(f: Flight) -> list[Array]:
    return [x for c in _here(f, _CONTROLS) for x in (*_delayed_values(f, c), f.rate(f[c]))]


def _accelerations(f: Flight) -> list[Array]:
    return [f.expected[c] for c in ("p_dot", "q_dot", "r_dot", "ax", "ay", "az") if c in f.expected]


def _readings(f: Flight) -> list[Array]:
    names = _here(f, ("p", "q", "r", "V", "alpha", "beta", "phi", "theta"))
    # Rates predicted by the simulation, not those of the readings: those contain the noise that is tested.
    return [f[c] - f[c].mean() for c in names] + [f.expected[c] for c in ("p_dot", "q_dot", "r_dot") if c in f.expected]
