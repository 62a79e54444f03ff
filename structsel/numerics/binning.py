"""Means over bins of a signal, with confidence intervals that allow for correlation in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from structsel.errors import DomainError
from structsel.numerics.arrays import Array

_MIN_SEGMENTS = 3  # in a bin with an interval; with two, Student's t has one degree of freedom and a useless interval


@dataclass(frozen=True, eq=False)
class BinMeans:
    """Means of one signal over bins of another, bins in ascending order.

    Attributes
    ----------
    at : (m,) array
        Mean of x in each bin.
    means : (m,) array
        Mean of y.
    half : (m,) array
        Half width of the interval of the mean; nan if fewer than three segments are in the bin.
    counts : (m,) array of int
        Samples.
    """

    at: Array
    means: Array
    half: Array
    counts: np.ndarray


def split_into_segments(lengths: ArrayLike, least: int = 20) -> np.ndarray:
    """Cut concatenated recordings into at least `least` segments in total, at least one for each recording.

    Parameters
    ----------
    lengths : (k,) array of int
        Samples of each recording.
    least : int

    Returns
    -------
    (n,) array of int
        Number of the segment of each sample.
    """
    lengths = np.asarray(lengths, dtype=int)
    each = -(-least // len(lengths))
    parts = [i * each + np.arange(n) * each // n for i, n in enumerate(lengths)]
    return np.concatenate(parts)


def bin_means(x: ArrayLike, y: ArrayLike, segment: ArrayLike, bins: int = 15) -> BinMeans:
    """Mean of y over bins of x that hold equal numbers of samples.

    Samples of one segment are correlated, so a bin of n samples has less than n independent ones. The interval
    follows from the scatter between segments. With c_s samples of segment s in a bin, and S_s the sum of their
    deviations from the mean of the bin, over m segments::

        variance of the mean = m / (m - 1) sum_s S_s^2 / (sum_s c_s)^2

    and Student's t with m - 1 degrees of freedom; the interval is that of 95 %.

    Parameters
    ----------
    x, y : (n,) array
    segment : (n,) array of int
        Number of the segment of each sample, from zero; see `split_into_segments`.
    bins : int
        At least 1; fewer are used if there are few samples.

    Returns
    -------
    BinMeans

    Raises
    ------
    DomainError
        No samples, lengths that differ, or no bins.
    """
    x, y, segment = np.asarray(x, dtype=float), np.asarray(y, dtype=float), np.asarray(segment, dtype=int)
    if not len(x) or not x.shape == y.shape == segment.shape or x.ndim != 1:
        raise DomainError(f"bin_means takes three vectors of one length, not {x.shape}, {y.shape}, {segment.shape}.")
    if bins < 1:
        raise DomainError(f"bin_means needs at least one bin, not {bins}.")
    bins = min(bins, max(len(x) // 2, 1))
    cell = np.empty(len(x), dtype=int)
    cell[np.argsort(x, kind="stable")] = np.arange(len(x)) * bins // len(x)
    counts = np.bincount(cell, minlength=bins)
    means = np.bincount(cell, y) / counts
    owners = int(segment.max()) + 1
    both = cell * owners + segment
    held = np.bincount(both, minlength=bins * owners).reshape(bins, owners) > 0
    off = np.bincount(both, y - means[cell], minlength=bins * owners).reshape(bins, owners)
    m = held.sum(axis=1)
    several = m >= _MIN_SEGMENTS
    half = np.full(bins, np.nan)
    spread = np.sqrt(m[several] / (m[several] - 1.0) * (off[several] ** 2).sum(axis=1)) / counts[several]
    half[several] = scipy.stats.t.ppf(0.975, m[several] - 1) * spread
    return BinMeans(np.bincount(cell, x) / counts, means, half, counts)
