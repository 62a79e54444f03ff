"""Times: windows in which the residual exceeds the noise, and times at which its level changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from structsel.comparison.flight import Flight
from structsel.comparison.locating.windows import Intervals
from structsel.comparison.noise import Noise, bins_of, edge_of
from structsel.numerics.arrays import Array
from structsel.numerics.fourier_series import fast_length, spectrum

_WINDOW = 2.0  # s
_FALSE = 0.05  # fraction of false windows
_CHANGE = 0.01  # probability of any false change in any flight and response
_USUAL = 30.0  # ratio above which a step that every flight has is still one
_BOTH_SIDES = 2.0  # s, least on each side of a change


@dataclass(frozen=True)
class Window:
    """A segment in which the residual of one response exceeds the noise.

    Attributes
    ----------
    flight, response : str
    start, end : float [s]
    times : float
        Rms over that of noise.
    p : float
        Of as large a residual in noise, before allowing for the number of windows.
    """

    flight: str
    response: str
    start: float
    end: float
    times: float
    p: float


@dataclass(frozen=True)
class Change:
    """A time at which the level of the residual steps.

    Attributes
    ----------
    flight, response : str
    time : float [s]
    step : float
        In the response's unit; after less before.
    std : float
    p : float
        Of as large a step in noise, anywhere in any flight and response.
    """

    flight: str
    response: str
    time: float
    step: float
    std: float
    p: float


def whitened(spectrum: Array, std: Array, n: int) -> Array:
    """Residual in time, each frequency scaled to noise of unit variance.

    Parameters
    ----------
    spectrum : (1 + bins,) array
        Cosine coefficients; the level, first, is left out.
    std : (1 + bins,) array
        Of noise.
    n : int
        Samples.
    """
    made = np.zeros(n)
    bins = len(spectrum) - 1
    made[1 : bins + 1] = spectrum[1:] / std[1:] * np.sqrt(n / bins)
    m = fast_length(n)
    made[:m] = scipy.fft.idct(made[:m], norm="ortho")
    return made


def standing_out(powers: Array, ceiling: float = 2.0) -> Array:
    """Probability, for each of many powers, of one as large among them if all were noise.

    Logarithms are taken as normal; their middle and scatter come from the quieter half, which an effect that acts for
    less than half of the time does not reach. The middle is taken as at most `ceiling`: an effect that acts all
    the time is not the usual.
    """
    logs = np.log(np.maximum(powers, 1e-12))
    middle = float(np.median(logs))
    scatter = max(middle - float(np.quantile(logs, 0.1587)), 0.1)
    return np.asarray(scipy.stats.norm.sf((logs - min(middle, np.log(ceiling))) / scatter))


def find_windows(
    flights: Sequence[Flight], spectra: Sequence[Mapping[str, Array]], noise: Noise, responses: Sequence[str]
) -> list[Window]:
    """Windows of 2 s in which the residual is larger than usual, at a nominal rate of one false in twenty.

    The rate holds for lognormal powers. What steps of the controls leave even of a right simulation has a longer tail:
    most such simulations have some window named, of 1 or 2 % of all. A window is a place to look at, not a verdict.

    The mean square of the whitened residual, its logarithm held against that of all windows of the response: noise
    changes with time and manoeuvre by more than chi squared would have it, and the scatter of the quieter half of the
    windows says by how much. Benjamini and Hochberg's rule over windows and responses.

    References
    ----------
    [BH95]
    """
    every: list[Window] = []
    for c in responses:
        mine: list[tuple[str, float, float, float]] = []
        for f, s in zip(flights, spectra):
            width, edge = max(2, round(_WINDOW / f.dt)), edge_of(f)
            e = whitened(s[c], noise.std(f, c, bins_of(f)), len(f))
            for a in range(edge, len(f) - edge - width // 2, width):
                b = min(a + width, len(f) - edge)
                mine.append((f.name, float(f.t[a]), float(f.t[b - 1]), float(np.mean(e[a:b] ** 2))))
        p = standing_out(np.array([power for *_, power in mine]))
        every += [Window(name, c, a, b, power**0.5, float(q)) for (name, a, b, power), q in zip(mine, p)]
    ranked = sorted(every, key=lambda w: w.p)
    passing = [k for k, w in enumerate(ranked, 1) if w.p <= _FALSE * k / len(ranked)]
    return sorted(ranked[: max(passing, default=0)], key=lambda w: (w.flight, w.start, w.response))


def joined(windows: Sequence[Window], flights: Sequence[Flight]) -> Intervals:
    """Windows of all responses joined to intervals, per flight."""
    made: Intervals = {f.name: [] for f in flights}
    for w in windows:
        mine = made[w.flight]
        if mine and w.start <= mine[-1][1] + 0.5 * _WINDOW:
            mine[-1] = (mine[-1][0], max(mine[-1][1], w.end))
        else:
            mine.append((w.start, w.end))
    return made


def find_changes(
    flights: Sequence[Flight], spectra: Sequence[Mapping[str, Array]], noise: Noise, responses: Sequence[str]
) -> list[Change]:
    """Steps in the level of the residual, the likeliest of each flight and response.

    A step is fitted at every time, coefficient by coefficient, each weighted by the noise at its frequency, which
    makes coloured residuals white. The largest ratio of each flight is held against those of all flights and
    responses, drifts and all (see `standing_out`), p multiplied by their number.
    """
    largest: list[tuple[float, str, str, float, float, float]] = []
    for f, s in zip(flights, spectra):
        at, steps = _steps(f)
        if not len(at):
            continue
        for c in responses:
            weight = 1.0 / noise.std(f, c, bins_of(f))[1:]
            H, y = steps * weight[:, None], s[c][1:] * weight
            power = (H**2).sum(axis=0)
            size = (H.T @ y) / power
            gain = size**2 * power
            k = int(np.argmax(gain))
            left = max(float(y @ y - gain[k]) / max(len(y) - 2, 1), 1.0)
            std = float(np.sqrt(left / power[k]))
            largest.append((float(gain[k]) / left, f.name, c, float(f.t[at[k]]), float(size[k]), std))
    if not largest:
        return []
    # In noise the largest over a flight is about twice the logarithm of its independent times.
    p = standing_out(np.array([ratio for ratio, *_ in largest]), ceiling=_USUAL) * len(largest)
    found = [Change(name, c, t, size, std, float(min(q, 1.0))) for (_, name, c, t, size, std), q in zip(largest, p)]
    return sorted((change for change in found if change.p < _CHANGE), key=lambda change: change.p)


def _steps(f: Flight) -> tuple[NDArray[np.int_], Array]:
    """Times of steps that may be, and their (bins, times) cosine coefficients."""
    edge = max(edge_of(f), round(_BOTH_SIDES / f.dt))
    every = max(1, round(0.1 / f.dt))
    at = np.arange(edge, len(f) - edge, every)
    columns = (np.arange(len(f))[:, None] >= at[None, :]).astype(float)
    return at, (spectrum(columns, bins_of(f), edge_of(f))[1:] if len(at) else columns)
