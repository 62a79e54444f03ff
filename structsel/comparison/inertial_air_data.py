"""Smooth channels, and air data that accelerometers and gyros predict, except for slow drifts."""

from __future__ import annotations

import warnings
from collections.abc import Mapping

import numpy as np
import scipy

from structsel.aircraft import Aircraft
from structsel.comparison.responses import KINEMATIC, Rate, predicted_rates
from structsel.errors import StructselError, StructselWarning
from structsel.numerics import rigid_body as rb
from structsel.numerics.air_data import air_data_at_cg, air_data_at_sensor
from structsel.numerics.arrays import Array
from structsel.numerics.signal_quality import estimate_white_noise
from structsel.numerics.smoothing import smooth_spline

_AS_THEY_ARE = ("gear", "throttle", "mode")
_SHARP = ("de", "da", "dr", "df", "thrust")
_SLOW = 0.05  # Hz


def smooth_channel(name: str, x: Array, t: Array) -> Array:
    """Channel by a smoothing spline; constants, steps and controls keep their corners."""
    if name in _AS_THEY_ARE or np.ptp(x) == 0.0 or len(np.unique(x)) < 0.1 * len(x):
        return x
    if name in _SHARP:
        return x - estimate_white_noise(x)  # a smoother would round what jumps
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StructselWarning)  # what it doubts, the comparison's noise will hold
            made = smooth_spline(x, t, order=3)
    except StructselError:
        return x
    return np.array(made.values)


def inertial_channels(
    smooth: dict[str, Array], raw: Mapping[str, Array], aircraft: Aircraft, t: Array
) -> tuple[dict[str, Array], frozenset[str]]:
    """Air data and attitude predicted by accelerometers and gyros, plus the slow part of their error.

    A reading minus its prediction is noise, moving air and slow drifts. Only the drifts are kept: noise and gusts would
    occur twice in the differences. Where the rest is larger than the motion, it is smoothed and kept as well.

    Returns
    -------
    air : dict of channel to (n,) array
        V, alpha and beta with the smoothed rest: the air that the aircraft met.
    inertial : frozenset of str
        Channels with drifts only.
    """
    ch = {**smooth, **raw}
    rates = (ch["p"], ch["q"], ch["r"])
    place = aircraft.position("vane")
    air = air_data_at_cg(ch["V"], ch["alpha"], ch["beta"], *rates, place)
    calm = air_data_at_cg(smooth["V"], smooth["alpha"], smooth["beta"], *rates, place)
    turning = tuple(Rate(float(t[1] - t[0]))(smooth[c]) for c in "pqr")
    force = rb.acceleration_at_cg(ch["ax"], ch["ay"], ch["az"], rates, turning, aircraft.position("accelerometer"))
    predicted = predicted_rates({**smooth, **{c: ch[c] for c in "pqr"}}, calm, force)
    read = {**dict(zip(("V", "alpha", "beta"), air)), **{c: ch[c] for c in ("phi", "theta", "psi")}}
    with_gusts, made, inertial = {}, {}, set()
    for name, x in read.items():
        if name not in raw or not np.ptp(raw[name]) or not set(KINEMATIC[f"k_{name}"]) <= set(raw):
            with_gusts[name] = made[name] = dict(zip(("V", "alpha", "beta"), calm)).get(name, smooth[name])
            continue
        ahead = scipy.integrate.cumulative_simpson(predicted[name], x=t, initial=0.0)
        slow, rest = _drift(x - ahead, t), smooth_channel(name, x - ahead, t)
        if np.std(rest - slow) < np.std(x - _drift(x, t)):
            inertial.add(name)
        with_gusts[name] = ahead + rest
        made[name] = ahead + (slow if name in inertial else rest)
    # With the gyros' noise, a long arm would give the angles' rates the noise of the moments.
    still = (smooth["p"], smooth["q"], smooth["r"])
    air_data = ("V", "alpha", "beta")
    carried = [air_data_at_sensor(x["V"], x["alpha"], x["beta"], *still, place) for x in (with_gusts, made)]
    smooth.update(zip(air_data, carried[1]))
    smooth.update({c: made[c] for c in ("phi", "theta", "psi")})
    return dict(zip(air_data, carried[0])), frozenset(inertial)


def _drift(x: Array, t: Array) -> Array:
    """The slow part of a signal: a line, and waves below `_SLOW`."""
    line = np.polynomial.Polynomial.fit(t, x, 1)(t)
    waves = scipy.fft.dct(x - line, norm="ortho")
    waves[max(1, int(2.0 * (t[-1] - t[0]) * _SLOW)) + 1 :] = 0.0
    return line + np.asarray(scipy.fft.idct(waves, norm="ortho"))
