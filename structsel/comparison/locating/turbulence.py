"""Turbulence: differences that no input drives, of the spectrum that moving air has.

A vane reads the gust that the gyros and accelerometers do not: what its rate of change has over theirs is the gust's
derivative. Where no vane feels it, it is not looked for: forces that follow no input may have other causes. Noise of
an instrument may keep for a while as well, but not for as long as it takes to fly through a gust of the atmosphere's
scale, nor equally many metres per second along all axes.

References
----------
[MIL8785] for the spectra.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy

from structsel.comparison.flight import Flight
from structsel.comparison.locating.dryden_fit import PowerBands, dispersion, fit_spectrum, fraction_of_air, largest_peak
from structsel.comparison.noise import bins_of, edge_of, frequencies
from structsel.deprecation import renamed_attribute
from structsel.formatting import format_number
from structsel.nomenclature import FORCE_COEFFICIENTS, INPUTS
from structsel.numerics.arrays import Array
from structsel.numerics.fourier_series import spectrum, taper
from structsel.numerics.signal_quality import white_noise_std

_AXES = {"u": "k_V", "v": "k_beta", "w": "k_alpha"}
_LENGTHS = np.geomspace(80.0, 700.0, 7)  # m
_USUAL, _ABOUT = 300.0, 0.7  # m, and the standard deviation of the logarithm: above it, only sigma^2 / L shows
_TIMES = np.geomspace(0.03, 0.6, 7)  # s that an instrument's own noise may keep
_LOWEST = 0.08  # Hz; below, drifts and residuals of the manoeuvres
_BANDS = 16
_LEAST = 8.0  # log Bayes factor to noise, at least
_LARGEST_RATIO = 3.0  # times that one axis may be more turbulent than another
_FAINT = 0.03  # m/s
_INPUT_FRACTION = 0.35  # fraction of the power that inputs may explain
_PEAK = 6.0  # times the fitted spectrum; more is a resonance
_OCCAM = 2.5  # log Bayes factor that a size free over orders of magnitude costs
_BETWEEN_AXES = 0.35  # standard deviation of the logarithm of the size
_WITHOUT_VANES = 300.0
"""Log Bayes factor of forces that follow the motion and no input, above which the air is the cause."""
_UNCONFIRMED = 32.0
"""The same above which coloured residuals are no evidence of an effect: that from which one would be a mismatch however
little it explains. For a simulation that was identified from flights it is that of the air: its form leaves coloured
residuals."""
_FORCE_FRACTION = 0.5
"""Fraction of the residual of every force that must not be white noise. 0.67 to 0.99 in 20 correct simulations with
coloured noise of the instruments, or with turbulence that no vane feels; at most 0.22 in 85 of 86 other cases."""
_MOTION = (0.1, 2.0)  # Hz, in which gusts move an aircraft
_FORCED = {"v": ("CY", "beta"), "w": ("CZ", "alpha")}


@dataclass(frozen=True)
class TurbulenceEstimate:
    """Moving air that is not in the simulation.

    Attributes
    ----------
    sigma : mapping of axis ("u", "v", "w") to float [m/s]
        Only the axes that show it.
    length : float [m]
        Scale of the Dryden spectrum; NaN where no vane feels it.
    log_bayes_factor : float
        To instrument noise of any autocorrelation; without vanes, of forces that follow the motion and no input.
    probability : float
    input_fraction : float
        Fraction of its power that inputs explain: the rest of other physics.
    explained : float
        Fraction of the variance that is moving air: of the readings of the vanes beyond the inertial motion; without
        vanes, at most that of the residuals of the forces beyond white noise.
    """

    sigma: Mapping[str, float]
    length: float
    log_bayes_factor: float
    probability: float
    input_fraction: float
    explained: float

    nats = renamed_attribute("log_bayes_factor")
    driven = renamed_attribute("input_fraction")

    @property
    def says(self) -> str:
        """One plain sentence."""
        directions = {"u": "along", "v": "across", "w": "up and down"}
        sizes = ", ".join(f"{format_number(s, 2)} m/s {directions[a]}" for a, s in self.sigma.items())
        if np.isnan(self.length):
            return (
                f"The air was turbulent: about {sizes}. No vane feels it, but forces and moments differ in a way that "
                "follows the motion and no input."
            )
        return (
            f"The air was turbulent: {sizes} (Dryden, scale about {format_number(self.length, 2)} m); the vanes read "
            "gusts that accelerometers and gyros do not."
        )

    def __str__(self) -> str:
        return self.says


def find_turbulence(flights: Sequence[Flight], residuals: Sequence[Mapping[str, Array]]) -> TurbulenceEstimate | None:
    """Turbulence, where the residuals show it.

    Parameters
    ----------
    flights : sequence of Flight
    residuals : sequence of mapping of response to (n,) array
        Differences less what tolerances and the effects found explain, per flight.

    Returns
    -------
    TurbulenceEstimate or None
    """
    vanes = {a: b for a, c in _AXES.items() if (b := _of_vane(flights, residuals, a, c)) is not None}
    return _judge(vanes) if "w" in vanes else None


def turbulence_without_vanes(
    flights: Sequence[Flight], residuals: Sequence[Mapping[str, Array]], log_bayes_factor: float
) -> TurbulenceEstimate | None:
    """Turbulence without vanes, where forces follow the motion and no input, and all forces show it.

    Parameters
    ----------
    flights : sequence of Flight
    residuals : sequence of mapping of response to (n,) array
        Differences less what tolerances and the effects found explain, per flight.
    log_bayes_factor : float
        Gain of an effect on the recorded motion that is not confirmed by the response to the recorded inputs.

    Returns
    -------
    TurbulenceEstimate or None
        Its sizes are those of gusts that would make the differences of the forces: noise and tolerances are in them.
    """
    if log_bayes_factor < _WITHOUT_VANES or (explained := _least_coloured(flights, residuals)) < _FORCE_FRACTION:
        return None
    sigma: dict[str, float] = {}
    for axis, (response, angle) in _FORCED.items():
        if all(response in f.difference for f in flights):
            force = [spectrum(f.difference[response], bins_of(f), edge_of(f))[1:] for f in flights]
            slope = float(np.mean([np.abs(f.slope(response, angle)).mean() / f["V"].mean() for f in flights]))
            power = sum(float(x @ x) for x in force) / sum(map(len, flights))
            sigma |= {axis: float(np.sqrt(power)) / slope} if slope > 0.0 else {}
    if not sigma:
        return None
    probability = float(1.0 / (1.0 + np.exp(1.0 - log_bayes_factor / _WITHOUT_VANES)))
    return TurbulenceEstimate(sigma, float("nan"), log_bayes_factor, probability, 0.0, explained)


def has_coloured_forces(
    flights: Sequence[Flight], residuals: Sequence[Mapping[str, Array]], log_bayes_factor: float
) -> bool:
    """Whether the residual of every force is coloured, and makes evidence of effects that the inputs do not confirm.

    The noise of instruments may last, or the air move without a vane that feels it. Both are in the forces and in the
    motion from which effects are computed.

    Parameters
    ----------
    flights, residuals, log_bayes_factor
        As for `turbulence_without_vanes`.
    """
    least = _WITHOUT_VANES if flights[0].is_identified else _UNCONFIRMED
    return log_bayes_factor >= least and _least_coloured(flights, residuals) >= _FORCE_FRACTION


def _least_coloured(flights: Sequence[Flight], residuals: Sequence[Mapping[str, Array]]) -> float:
    """Coloured fraction of the force that has the least; zero without forces."""
    return min(coloured_fractions(flights, residuals).values(), default=0.0)


def coloured_fractions(flights: Sequence[Flight], residuals: Sequence[Mapping[str, Array]]) -> dict[str, float]:
    """Fraction of the power of each force's residual that is not white noise of the instruments.

    In the band of the motion. Moving air acts on all forces; white noise moves no
    aircraft. The level of the white noise is that of the third differences of the measured coefficient.
    """
    made = {}
    for c in FORCE_COEFFICIENTS:
        if not all(c in left and c in f.measured for f, left in zip(flights, residuals)):
            continue
        power = white = 0.0
        for f, left in zip(flights, residuals):
            bins = bins_of(f)
            hz = frequencies(f, bins)
            inside = (hz > _MOTION[0]) & (hz < _MOTION[1])
            x = spectrum(left[c], bins, edge_of(f))[1:][inside]
            power += float(x @ x)
            white += inside.sum() * white_noise_std(f.measured[c]) ** 2
        if power > 0.0:
            made[c] = max(0.0, 1.0 - white / power)
    return made


def _of_vane(
    flights: Sequence[Flight], residuals: Sequence[Mapping[str, Array]], axis: str, response: str
) -> PowerBands | None:
    if any(response not in r for r in residuals):
        return None
    made = [r[response] * (f["V"] if axis != "u" else 1.0) for f, r in zip(flights, residuals)]
    # Gyros (times V) and accelerometers make noise of the rates: far above what motion does, it is theirs alone.
    felt = {"u": (("ax",), ()), "v": (("ay",), ("p", "r")), "w": (("az",), ("q",))}[axis]
    level = []
    for f in flights:
        power = sum(_quick(f, c) ** 2 for c in felt[0]) + sum(
            (float(f["V"].mean()) * _quick(f, c)) ** 2 for c in felt[1]
        )
        level.append(2.0 * f.dt * power)
    return _in_bands(flights, made, max(float(np.median(level)), 1e-12))


def _quick(f: Flight, channel: str) -> float:
    """Noise of a channel from its third differences, which leave nothing of motion; the quieter half of the flight."""
    if channel not in f.raw:
        return 0.0
    return white_noise_std(f.raw[channel])


def _in_bands(flights: Sequence[Flight], signals: Sequence[Array], floor: float) -> PowerBands:
    bins = [bins_of(f) for f in flights]
    y = [spectrum(x, b, edge_of(f))[1:] for f, x, b in zip(flights, signals, bins)]
    X = [spectrum(_inputs(f, flights), b, edge_of(f))[1:] for f, b in zip(flights, bins)]
    hz = [frequencies(f, b) for f, b in zip(flights, bins)]
    left, input_fraction = _without_inputs(y, X, hz)
    highest = min(float(h[-1]) for h in hz)
    edges = np.geomspace(_LOWEST, highest, _BANDS + 1)
    rows = []
    for k, (f, e, h) in enumerate(zip(flights, left, hz)):
        power = 2.0 * f.dt * e**2 / float(np.mean(taper(len(f), edge_of(f)) ** 2))
        for low, high in pairwise(edges):
            near = (h >= low) & (h < high)
            if near.any():
                rows.append((float(h[near].mean()), float(f["V"].mean()), k, near.sum(), float(power[near].mean())))
    hertz, V, flight, count, level = np.array(rows).T
    return PowerBands(hertz, V, flight.astype(int), count, level, floor, input_fraction)


def _inputs(f: Flight, flights: Sequence[Flight]) -> Array:
    """What drives the aircraft, and how the instruments of inertia see it move, with rates."""
    columns = []
    for c in INPUTS:
        if all(c in one.recorded for one in flights) and any(np.ptp(one[c]) > 0.0 for one in flights):
            columns += [f[c], f.rate(f[c])]
    return np.column_stack(columns) if columns else f.t[:, None]


def _without_inputs(y: list[Array], X: list[Array], hz: list[Array]) -> tuple[list[Array], float]:
    """Residual after a regression on the inputs, and the adjusted R2 of it; below 1 Hz, where manoeuvres are."""
    rows, target = np.vstack(X), np.concatenate(y)
    weight = 1.0 / np.sqrt(np.concatenate(hz))
    size = np.sqrt((rows**2).mean(axis=0))
    rows = rows[:, size > 0.0] / size[size > 0.0]
    held = rows * weight[:, None]
    ridge = 1e-6 * len(target) * float((weight**2).mean())
    fit = np.linalg.solve(held.T @ held + ridge * np.eye(rows.shape[1]), held.T @ (target * weight))
    left = target - rows @ fit
    before, after = float((target * weight) @ (target * weight)), float((left * weight) @ (left * weight))
    free = max(1.0 - rows.shape[1] / len(target), 0.1)
    input_fraction = 1.0 - after / free / before if before > 0.0 else 0.0
    return np.split(left, np.cumsum([len(part) for part in y])[:-1]), max(input_fraction, 0.0)


def _averaged(costs: Array) -> float:
    """Cost averaged over a grid: minus the logarithm of the mean likelihood."""
    return -float(scipy.special.logsumexp(-costs) - np.log(len(costs)))


def _cost_of_unequal_axes(sigmas: Sequence[float]) -> float:
    """Cost of unequal axes."""
    logs = np.log(np.maximum(sigmas, 1e-6))
    return float(0.5 * (((logs - logs.mean()) / _BETWEEN_AXES) ** 2).sum())


def _judge(axes: Mapping[str, PowerBands]) -> TurbulenceEstimate | None:
    air = {a: [fit_spectrum(b, a, length, None) for length in _LENGTHS] for a, b in axes.items()}
    total = np.array(
        [
            sum(each[i].cost for each in air.values()) + _cost_of_unequal_axes([each[i].sigma for each in air.values()])
            for i in range(len(_LENGTHS))
        ]
    )
    total += 0.5 * (np.log(_LENGTHS / _USUAL) / _ABOUT) ** 2
    i = int(np.argmin(total))
    best = {a: air[a][i] for a in axes}
    moved = _averaged(total) + _OCCAM
    own = {
        a: _averaged(np.array([fit_spectrum(b, a, None, tau).cost for tau in _TIMES])) + _OCCAM for a, b in axes.items()
    }
    still = sum(min(own[a], fit_spectrum(b, a, None, None).cost) for a, b in axes.items())
    spread = max(1.0, float(np.mean([dispersion(b, best[a].total) for a, b in axes.items()])))
    sigma = {a: best[a].sigma for a in axes}
    log_bayes_factor = float(still - moved) / spread
    input_fraction = max(b.input_fraction for b in axes.values())
    if (
        log_bayes_factor < _LEAST
        or min(sigma.values()) < max(_FAINT, max(sigma.values()) / _LARGEST_RATIO)
        or input_fraction > _INPUT_FRACTION
    ):
        return None
    if any(largest_peak(b, best[a].total) > _PEAK for a, b in axes.items()):
        return None
    probability = float(1.0 / (1.0 + np.exp(-(log_bayes_factor - 0.5 * _LEAST) / 4.0)))
    explained = float(np.mean([fraction_of_air(b, best[a]) for a, b in axes.items()]))
    return TurbulenceEstimate(sigma, float(_LENGTHS[i]), log_bayes_factor, probability, input_fraction, explained)
