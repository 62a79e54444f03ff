"""The part of a reading that is likely to be its own noise."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from structsel.numerics.arrays import Array

_NARROWEST, _WIDER, _WIDEST = 0.7, 1.6, 0.125
"""Widths of the smoothers, in samples: of the first, of each over the last, and of the widest over the length."""
_AROUND = 3.0  # widths, over which the power of a band is counted
_MODEST = 2.5  # of the noise's power, up to which all there is counts as noise


def white_std(steps: Array) -> float:
    """Standard deviation of white noise by third differences of a signal, which leave nothing of slow motion."""
    return float(np.sqrt(np.median(steps**2) / 0.4549 / 20.0))  # the median of chi squared, and 1 + 9 + 9 + 1


def white_part(x: Array) -> Array:
    """Estimate of the white noise in a signal, band by band and moment by moment.

    What lies between smoothers of two widths is noise where its power is no more than white noise of the signal's
    finest scale has in that band, and signal where it is much more: a local Wiener filter. A signal at rest is all
    noise at every scale; one that moves keeps what it does.

    Parameters
    ----------
    x : (n,) array
        On an even clock.

    Returns
    -------
    (n,) array
        Zeros where most samples are as the last (a signal that was held, or a coarse digital one).
    """
    steps = np.diff(x, 3)
    if not len(steps) or np.mean(steps != 0.0) < 0.5:
        return np.zeros(len(x))
    sd = white_std(steps[steps != 0.0])
    one = np.zeros(2 * len(x) + 1)
    one[len(x)] = 1.0
    noise = np.zeros(len(x))
    above, of_one, width = np.asarray(x, dtype=float), one, _NARROWEST
    while width < _WIDEST * len(x):
        below, passed = gaussian_filter1d(x, width, mode="nearest"), gaussian_filter1d(one, width)
        band = above - below
        expected = sd**2 * float(((of_one - passed) ** 2).sum())
        power = gaussian_filter1d(band**2, _AROUND * width, mode="nearest")
        share = np.minimum(1.0, _MODEST * expected / np.maximum(power, 1e-300)) ** 2
        noise += share * band
        above, of_one, width = below, passed, _WIDER * width
    return noise
