"""Consistency of a filter: innovations as large as predicted, and white."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from structsel.numerics import kinematics as fp
from structsel.numerics.noise_models import autocorrelation
from structsel.numerics.signal_quality import NOISE_LEVEL_ERROR
from structsel.reconstruction.ukf import FilterResult

_LAGS_SECONDS = 5.0
_FEW_LAGS = 4  # that are summed one by one before all of them are
_COLOURED = 1.5  # variance of a mean over that of white noise, above which standard deviations are increased
_START_UP = 0.05  # fraction of the run in which the filter converges from its initial values


@dataclass(frozen=True)
class ChannelConsistency:
    """Normalised innovations of one measured channel, without the start-up of the filter.

    Attributes
    ----------
    channel : str
    n : int
        Number of readings.
    rejected : int
        Number of readings outside the gate, which were not used.
    mean, variance : float [-]
        Of the normalised innovations; 0 and 1 if the filter is consistent.
    autocorrelation : (lags,) array [-]
        At lags of 1, 2, ... readings.
    bound : float [-]
        95 % limit of the autocorrelations of a white sequence.
    outside : float [-]
        Fraction of the lags outside the bound; 0.05 if the innovations are white.
    residual_rms : float
        Root mean square of measured minus reconstructed, in the channel's unit.
    inflation : float [-]
        Variance of a mean of the residual over that of a white residual of the same variance.
    """

    channel: str
    n: int
    rejected: int
    mean: float
    variance: float
    autocorrelation: np.ndarray
    bound: float
    outside: float
    residual_rms: float
    inflation: float

    @property
    def white(self) -> bool:
        """Whether the innovations are white."""
        return self.outside < 0.2 and (len(self.autocorrelation) == 0 or bool(abs(self.autocorrelation[0]) < 0.2))

    def to_dict(self) -> dict[str, Any]:
        """Fields by name; the autocorrelation as a list."""
        held = {k: v for k, v in self.__dict__.items() if k != "autocorrelation"}
        return {**held, "white": self.white, "autocorrelation": self.autocorrelation.tolist()}


@dataclass(frozen=True)
class Consistency:
    """Consistency of all channels.

    Attributes
    ----------
    channels : tuple of ChannelConsistency
    nis : float [-]
        Mean normalised innovation squared for each reading; 1 if the filter is consistent.
    nis_band : (float, float) [-]
        95 % band of that mean for a consistent filter. The lower limit includes the error of an estimated noise level.
    noise_estimated : bool
        Whether the noise of at least one measurement was estimated.
    """

    channels: tuple[ChannelConsistency, ...]
    nis: float
    nis_band: tuple[float, float]
    noise_estimated: bool = False

    def __getitem__(self, channel: str) -> ChannelConsistency:
        for held in self.channels:
            if held.channel == channel:
                return held
        raise KeyError(channel)

    def with_residuals(self, residuals: np.ndarray, rejected: np.ndarray) -> Consistency:
        """The same innovations with the rms of other residuals (n, 12), rejected ones not counted."""
        channels = []
        for channel in self.channels:
            j = fp.MEASUREMENTS.index(channel.channel)
            used = residuals[np.isfinite(residuals[:, j]) & ~rejected[:, j], j]
            rms = float(np.sqrt(np.mean(used**2))) if used.size else np.nan
            channels.append(replace(channel, residual_rms=rms))
        return replace(self, channels=tuple(channels))

    @property
    def inside(self) -> bool:
        """Whether the mean NIS is in its band."""
        return self.nis_band[0] <= self.nis <= self.nis_band[1]


def check_innovations(
    run: FilterResult, residuals: np.ndarray, measured: tuple[str, ...], dt: float, given: Iterable[str] = ()
) -> Consistency:
    """Consistency of a filter run.

    Parameters
    ----------
    run : FilterResult
    residuals : (n, 12) array
        Measured minus reconstructed.
    measured : tuple of str
    dt : float [s]
    given : iterable of str
        Channels whose noise was stated. An estimated level is at least that of the spectrum of its channel, which may
        be too large by its standard error; the lower limit of the NIS is reduced by the mean of these errors.
    """
    estimated = set(measured) - set(given)
    rows = slice(max(1, int(_START_UP * len(run.nis))), None)
    channels = []
    for j, name in enumerate(fp.MEASUREMENTS):
        if name not in measured:
            continue
        e = run.innovations[rows, j] / run.innovation_std[rows, j]
        e = e[np.isfinite(e) & ~run.rejected[rows, j]]
        used_residuals = residuals[:, j][np.isfinite(residuals[:, j]) & ~run.rejected[:, j]]
        lags = max(1, min(len(e) // 4, round(_LAGS_SECONDS / dt)))
        rho = autocorrelation(e, lags)[1:] if len(e) > 2 else np.zeros(0)
        bound = 1.96 / np.sqrt(max(len(e), 1))
        channels.append(
            ChannelConsistency(
                channel=name,
                n=int(np.isfinite(run.innovations[:, j]).sum()),
                rejected=int(run.rejected[:, j].sum()),
                mean=float(e.mean()) if e.size else np.nan,
                variance=float(e.var()) if e.size else np.nan,
                autocorrelation=rho,
                bound=float(bound),
                outside=float(np.mean(np.abs(rho) > bound)) if rho.size else 0.0,
                residual_rms=float(np.sqrt(np.mean(used_residuals**2))) if used_residuals.size else np.nan,
                inflation=correlation_length(used_residuals),
            )
        )
    used = run.used[rows]
    dof = int(used.sum())
    nis = float(np.nansum(run.nis[rows])) / max(dof, 1)
    low, high = (scipy.stats.chi2.ppf(p, dof) / dof for p in (0.025, 0.975)) if dof else (np.nan, np.nan)
    # A variance is in error by twice as much as its root.
    errors = [
        c.n * (2.0 * NOISE_LEVEL_ERROR / np.sqrt(max(c.n, 1)) if c.channel in estimated else 0.0) for c in channels
    ]
    low *= max(0.0, 1.0 - sum(errors) / max(sum(c.n for c in channels), 1))
    return Consistency(tuple(channels), nis, (float(low), float(high)), bool(estimated))


def widened_noise(std: np.ndarray, consistency: Consistency) -> np.ndarray | None:
    """(12,) noise of the measurements enlarged for the autocorrelation of the innovations; None if all are white."""
    wide = std.copy()
    for channel in consistency.channels:
        excess = max(1.0, channel.variance) if np.isfinite(channel.variance) else 1.0
        if channel.inflation * excess > _COLOURED:
            wide[fp.MEASUREMENTS.index(channel.channel)] *= np.sqrt(channel.inflation * excess)
    return None if np.array_equal(wide, std) else wide


def correlation_length(x: np.ndarray) -> float:
    """Variance inflation of a mean, 1 + 2 sum of the autocorrelations up to the first insignificant one."""
    if len(x) < 10:
        return 1.0
    longest, limit = max(1, len(x) // 5), 1.0 / np.sqrt(len(x))
    # The sum over all lags would be noise: it ends at the first lag that is not significant, often an early one.
    centred = x - np.mean(x)
    square, early = float(centred @ centred), np.zeros(0)
    if square > 0.0 and longest > _FEW_LAGS:
        early = np.array([centred[lag:] @ centred[:-lag] for lag in range(1, 1 + _FEW_LAGS)]) / square
    rho = early if np.any(early < limit) else autocorrelation(x, longest)[1:]
    below = np.flatnonzero(rho < limit)
    last = int(below[0]) if below.size else len(rho)
    return max(1.0, 1.0 + 2.0 * float(np.sum(rho[:last])))
