"""At which frequencies, and with which input: the coherence of the residual with each channel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from structsel.comparison.flight import Flight
from structsel.comparison.noise import HIGHEST
from structsel.deprecation import renamed_attribute
from structsel.numerics.arrays import Array
from structsel.numerics.spectra import (
    FEWER,
    OVERLAP,
    coherence_squared,
    coherence_threshold,
    harmonics,
    segment_transforms,
)

CHANNELS = ("de", "da", "dr", "throttle", "df", "alpha", "beta", "V")
"""As read. Gyros and accelerometers are left out: the coefficients are computed from them, and have their noise."""

_SEGMENT = 8.0  # s
_FALSE_ALARM = 0.01


@dataclass(frozen=True, eq=False)
class Coherence:
    """Coherence of one response's residual with one channel.

    Attributes
    ----------
    response, channel : str
    f : (k,) array [Hz]
    squared : (k,) array
        Magnitude squared coherence.
    threshold : float
        That independent signals exceed with a probability of 1 %, anywhere in the band.
    fraction : float
        Of the residual's power in the band that goes with the channel, less that of independent signals.
    peak : float [Hz]
        Of the largest coherence.
    delay : float [s]
        By which the residual is behind the channel, from the slope of the phase where coherent; nan where it is not.
    """

    response: str
    channel: str
    f: Array
    squared: Array
    threshold: float
    fraction: float
    peak: float
    delay: float

    share = renamed_attribute("fraction")

    @property
    def significant(self) -> bool:
        """Whether it passes the threshold anywhere."""
        return bool(self.squared.max() > self.threshold)


def coherences(
    flights: Sequence[Flight], residuals: Sequence[Mapping[str, Array]], responses: Sequence[str]
) -> list[Coherence]:
    """Coherence of each response's residual with each channel that moves, largest fraction first.

    The threshold is that of signals without relation. A simulation within its tolerances is not without relation to
    its inputs: one in fifteen passes there, some with a fraction of a quarter and more. It shows where to look.

    Segments of 8 s (half of them overlapping, Hann) of all flights together. With K independent segments, two signals
    without relation pass 1 - a^(1/(K-1)) at one frequency with probability a.

    References
    ----------
    [CKN73]
    """
    made = []
    per = round(min(_SEGMENT, min(0.5 * len(f) * f.dt for f in flights)) / flights[0].dt)
    same = [f for f in flights if abs(f.dt / flights[0].dt - 1.0) < 0.01 and len(f) >= per]
    if per < 16 or not same:
        return []
    names = [c for c in CHANNELS if all(c in f.recorded for f in same)]
    kept = [r for f, r in zip(flights, residuals) if f in same]
    segments = sum(int((len(f) - per) / (per * (1.0 - OVERLAP))) + 1 for f in same)
    free = max(2.0, FEWER * segments)
    moving = [c for c in names if any(np.ptp(f.raw[c]) > 0.0 for f in same)]
    signals_of = {c: [r[c] for r in kept] for c in responses} | {f" {c}": [f.raw[c] for f in same] for c in moving}
    dt = flights[0].dt
    f_hz, Z = _transforms(signals_of, dt, per)
    threshold = coherence_threshold(free, len(f_hz), _FALSE_ALARM)
    for c in responses:
        y = Z[c]
        for channel in moving:
            x = Z[f" {channel}"]
            cross = (np.conj(x) * y).mean(axis=1)
            own, response_power = (np.abs(x) ** 2).mean(axis=1), (np.abs(y) ** 2).mean(axis=1)
            squared = coherence_squared(cross, own, response_power)
            fair = np.maximum((squared - 1.0 / free) / (1.0 - 1.0 / free), 0.0)
            fraction = float(fair @ response_power / max(response_power.sum(), 1e-300))
            peak = float(f_hz[np.argmax(squared)])
            delay = _delay(f_hz, cross, squared > threshold)
            made.append(Coherence(c, channel, f_hz, squared, threshold, fraction, peak, delay))
    return sorted(made, key=lambda x: -x.fraction)


def _transforms(signals: Mapping[str, Sequence[Array]], dt: float, per: int) -> tuple[Array, dict[str, Array]]:
    """Frequencies in the band, and (frequencies, segments) transforms of each signal, all flights side by side."""
    f_hz = harmonics(per, dt)
    band = f_hz <= HIGHEST
    made = {
        name: np.concatenate([segment_transforms(x[:, None], per, OVERLAP)[:, 0, band].T for x in each], axis=1)
        for name, each in signals.items()
    }
    return f_hz[band], made


def _delay(f: Array, cross: Array, coherent: NDArray[np.bool_]) -> float:
    if coherent.sum() < 3:
        return float("nan")
    phase = np.unwrap(np.angle(cross[coherent]))
    return float(-np.polyfit(2.0 * np.pi * f[coherent], phase, 1)[0])
