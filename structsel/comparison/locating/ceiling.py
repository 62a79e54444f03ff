"""The ceiling: how much of the differences any function of the recorded channels and their recent past explains.

Physics that explains nearly as much with two parameters is better than a regression; a wide gap means unknown physics.
Complete manoeuvres are held out in turn, because samples of one manoeuvre are correlated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
import scipy
from numpy.typing import NDArray

from structsel.comparison.flight import Flight
from structsel.comparison.locating.windows import Flags
from structsel.comparison.noise import HIGHEST, bins_of, edge_of
from structsel.comparison.past_motion import PLANT_PAST, delayed
from structsel.nomenclature import COEFFICIENTS, CONFIGURATION
from structsel.numerics.arrays import Array
from structsel.numerics.fourier_series import fast_length, spectrum

_CHANNELS = (
    "alpha", "beta", "p_hat", "q_hat", "r_hat", "de", "da", "dr", "V", "CT", *CONFIGURATION, "h_agl", "mach",
    "throttle",
    "rpm", "phi", "theta",
)  # fmt: skip
_SQUARED = ("alpha", "beta", "q_hat", "p_hat", "r_hat", "de", "da", "dr", "V", "CT")
_PAST = (0.15, 0.4, 1.0)  # s
_REMEMBERED = ("alpha", "beta", "de", "da", "dr", "CT", "throttle")  # past rates of turn hold the moments' own noise
_HELD_TO = (1.0, 30.0, 1000.0)
_PER_HERTZ = 2.2  # samples kept per hertz of the band
_FOLDS = 4
_SAMPLES = 2500
_RESOLUTION = 1e-6  # of a channel's range: samples closer together are equal, so that no tree splits what is one value


def explainable(
    flights: Sequence[Flight], differences: Sequence[Mapping[str, Array]], responses: Sequence[str] | None = None
) -> dict[str, float]:
    """Fraction of the variance of the differences that a regression model predicts on flights it was not fitted to.

    The better of ridge regression on products and past values, and of boosted trees on what it leaves. Constant
    offsets of each flight are not counted.

    Parameters
    ----------
    flights : sequence of Flight
    differences : sequence of mapping of response to (n,) array
        Per flight: measured minus simulated, or a residual.
    responses : sequence of str, optional
        By default the coefficients, or all where there are none.

    Returns
    -------
    mapping of response to float
        Between 0 and 1; empty with a single flight, which leaves none unseen.
    """
    if len(flights) < 2:
        return {}
    here = [c for c in differences[0] if all(c in d for d in differences)]
    wanted = list(responses) if responses is not None else [c for c in here if c in COEFFICIENTS] or here
    channels = _moving(flights)
    lags = _plant_lags(flights, channels)
    total = sum(_kept(f)[1].sum() for f in flights)
    every = max(1, int(np.ceil(total / _SAMPLES)))
    X, products, y, group = [], [], [], []
    for k, (f, d) in enumerate(zip(flights, differences)):
        step, inside = _kept(f)
        at = np.flatnonzero(inside)[::every]
        plain = np.column_stack([f[c] for c in channels])
        past = _past(f, channels, lags)
        X.append(np.column_stack([plain, past])[::step][at])
        products.append(_in_band(_products(f, channels, past), f)[::step][at])
        y.append(_in_band(np.column_stack([d[c] for c in wanted]), f)[::step][at])
        group.append(np.full(len(at), k))
    Y = np.concatenate([part - part.mean(axis=0) for part in y])
    size = Y.std(axis=0)
    shown = [c for c, s in zip(wanted, size) if s > 0.0]
    Y = Y[:, size > 0.0] / size[size > 0.0]
    found = _predict_held_out(np.concatenate(X), np.concatenate(products), Y, np.concatenate(group))
    return {c: float(min(max(fraction, 0.0), 1.0)) for c, fraction in zip(shown, found)} | dict.fromkeys(
        [c for c in wanted if c not in shown], 0.0
    )


def _moving(flights: Sequence[Flight]) -> list[str]:
    responses = set(flights[0].measured)
    usual = [c for c in _CHANNELS if all(c in f or c in f.channels for f in flights)]
    if not usual:
        usual = sorted(c for c in flights[0].channels if c not in responses and all(c in f.channels for f in flights))
    return [c for c in usual if np.ptp(np.concatenate([f[c] for f in flights])) > 0.0]


def _kept(f: Flight) -> tuple[int, Flags]:
    """Every how many samples are kept, and which of those lie inside the faded ends."""
    highest = min(HIGHEST, bins_of(f) / (2.0 * len(f) * f.dt))
    step = max(1, int(1.0 / (_PER_HERTZ * highest * f.dt)))
    edge = edge_of(f)
    at = np.arange(0, len(f), step)
    return step, (at >= edge) & (at < len(f) - edge)


def _in_band(x: Array, f: Flight) -> Array:
    """Columns in the band that is compared, faded at the ends."""
    made = np.zeros_like(x)
    coefficients = spectrum(x, bins_of(f), edge_of(f))
    n = fast_length(len(x))
    made[1 : len(coefficients)] = coefficients[1:]
    made[:n] = scipy.fft.idct(made[:n], axis=0, norm="ortho")
    return made


def _plant_lags(flights: Sequence[Flight], channels: Sequence[str]) -> list[int]:
    """Samples of its past that a plant may remember, in its own time; none of an aircraft."""
    if set(flights[0].simulated) & set(COEFFICIENTS) or not set(channels).isdisjoint(_CHANNELS):
        return []
    shortest = min(map(len, flights))
    return [0, *sorted({max(1, round(part * shortest)) for part in PLANT_PAST})]


def _past(f: Flight, channels: Sequence[str], lags: Sequence[int]) -> Array:
    """Past values of channels that are remembered; of a plant, of all that move it and of its simulated responses."""
    if lags:
        made = [delayed(x, lag) for x in (*(f[c] for c in channels), *f.simulated.values()) for lag in lags]
    else:
        made = [delayed(f[c], round(lag / f.dt)) for c in channels if c in _REMEMBERED for lag in _PAST]
    return np.column_stack(made) if made else np.zeros((len(f), 0))


def _products(f: Flight, channels: Sequence[str], past: Array) -> Array:
    """Channels, their squares and products and cubes, and past values; each centred and scaled."""
    centred = {c: (f[c] - f[c].mean()) for c in channels}
    squared = [c for c in channels if c in _SQUARED] or list(channels)[:8]
    made = list(centred.values())
    made += [f[a] * f[b] for i, a in enumerate(squared) for b in squared[i:]]
    made += [f[c] ** 3 for c in squared[:2]]
    return np.column_stack([*made, past])


def _predict_held_out(X: Array, products: Array, Y: Array, group: Array) -> Array:
    """Fractions of the variance of each column of Y that are explained, on groups held out."""
    # These libraries take a while to load, and few commands need them.
    from sklearn.ensemble import HistGradientBoostingRegressor
    from sklearn.model_selection import GroupKFold
    from threadpoolctl import threadpool_limits

    scale = products.std(axis=0)
    P = products[:, scale > 0.0] / scale[scale > 0.0]
    folds = list(GroupKFold(min(_FOLDS, len(np.unique(group)))).split(P, groups=group))
    lines = [_ridge(P, Y, train) for train, _ in folds]  # (penalties, samples, columns of Y) of each fold
    straight = np.empty((len(_HELD_TO), *Y.shape))
    for (_, test), line in zip(folds, lines):
        straight[:, test] = line[:, test]
    ridge = np.array([_explained_fractions(Y, prediction, group) for prediction in straight])
    best = np.argmax(ridge, axis=0)
    bent = np.empty_like(Y)
    span = np.ptp(X, axis=0)
    X = np.round((X - X.min(axis=0)) / (_RESOLUTION * np.where(span > 0.0, span, 1.0)))
    trees = HistGradientBoostingRegressor(
        max_iter=40, learning_rate=0.12, max_leaf_nodes=8, min_samples_leaf=25, max_bins=48, early_stopping=False
    )
    with threadpool_limits(1):  # so small are the trees that threads only wait for each other
        for ((train, test), line), j in product(zip(folds, lines), range(Y.shape[1])):
            base = line[best[j], :, j] if ridge[best[j], j] > 0.0 else np.zeros(len(Y))
            bent[test, j] = base[test] + trees.fit(X[train], Y[train, j] - base[train]).predict(X[test])
    return np.maximum(ridge.max(axis=0), _explained_fractions(Y, bent, group))


def _ridge(P: Array, Y: Array, train: NDArray[np.intp]) -> Array:
    """Predictions of all samples by ridge regression on some of them, (penalties, n, columns of Y)."""
    middle, level = P[train].mean(axis=0), Y[train].mean(axis=0)
    columns, responses = P[train] - middle, Y[train] - level
    A, b = columns.T @ columns, columns.T @ responses
    values = [scipy.linalg.solve(A + penalty * np.eye(len(A)), b, assume_a="pos") for penalty in _HELD_TO]
    return np.stack([(P - middle) @ one + level for one in values])


def _explained_fractions(Y: Array, prediction: Array, group: Array) -> Array:
    """1 - error / variance, offsets of each group left out of both."""
    left = Y - prediction
    error, total = np.zeros(Y.shape[1]), np.zeros(Y.shape[1])
    for g in np.unique(group):
        mine = group == g
        error += ((left[mine] - left[mine].mean(axis=0)) ** 2).sum(axis=0)
        total += ((Y[mine] - Y[mine].mean(axis=0)) ** 2).sum(axis=0)
    return 1.0 - error / total
