"""Smooth channels, and air data that accelerometers and gyros predict, except for slow drifts."""

from __future__ import annotations

import warnings
from collections.abc import Mapping

import numpy as np
import scipy

from structsel.aircraft import Aircraft
from structsel.comparison.responses import KINEMATIC, Rate, predicted_rates
from structsel.errors import StructselWarning
from structsel.nomenclature import FLOW_ANGLES, INPUTS
from structsel.numerics import rigid_body as rb
from structsel.numerics.air_data import air_data_at_cg, air_data_at_sensor, body_velocity
from structsel.numerics.arrays import Array
from structsel.numerics.signal_quality import estimate_white_noise
from structsel.numerics.smoothing import smooth_splines

_AS_THEY_ARE = ("gear", "throttle", "mode")
SLOW = 0.05
"""Frequency below which winds and biases make the difference of a reading and its prediction [Hz]."""


def smooth_channels(channels: Mapping[str, Array], t: Array) -> dict[str, Array]:
    """Channels by smoothing splines; constants, steps and controls keep their corners."""
    made = dict(channels)
    moving = {
        name: x
        for name, x in channels.items()
        if name not in _AS_THEY_ARE and np.ptp(x) != 0.0 and len(np.unique(x)) >= 0.1 * len(x)
    }
    # A smoother would round what jumps.
    made |= {name: x - estimate_white_noise(x) for name, x in moving.items() if name in INPUTS}
    splined = [name for name in moving if name not in INPUTS]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StructselWarning)  # what it doubts, the comparison's noise will hold
        made |= zip(splined, (np.array(s.values) for s in smooth_splines([moving[c] for c in splined], t, order=3)))
    return made


def inertial_channels(
    smooth: dict[str, Array], raw: Mapping[str, Array], aircraft: Aircraft, t: Array
) -> tuple[dict[str, Array], frozenset[str], dict[str, Array]]:
    """Air data and attitude predicted by accelerometers and gyros, plus the slow part of their error.

    A reading minus its prediction is noise, moving air and slow drifts. Only the drifts are kept: noise and gusts would
    occur twice in the differences. Where the rest is larger than the motion, it is smoothed and kept as well.

    Returns
    -------
    air : dict of channel to (n,) array
        V, alpha and beta with the smoothed rest: the air that the aircraft met.
    inertial : frozenset of str
        Channels with drifts only.
    ahead : dict of channel to (n,) array
        Predicted changes of alpha and beta at the centre of gravity since the first sample.
    """
    ch = {**smooth, **raw}
    rates = (ch["p"], ch["q"], ch["r"])
    place = aircraft.position("vane")
    air = air_data_at_cg(ch["V"], ch["alpha"], ch["beta"], *rates, place)
    calm = air_data_at_cg(smooth["V"], smooth["alpha"], smooth["beta"], *rates, place)
    turning = tuple(Rate(float(t[1] - t[0]))(smooth[c]) for c in "pqr")
    force = rb.acceleration_at_cg(ch["ax"], ch["ay"], ch["az"], rates, turning, aircraft.position("accelerometer"))
    predicted = predicted_rates({**smooth, **{c: ch[c] for c in "pqr"}}, body_velocity(*calm), force)
    read = {**dict(zip(("V", "alpha", "beta"), air)), **{c: ch[c] for c in ("phi", "theta", "psi")}}
    with_gusts = {name: dict(zip(("V", "alpha", "beta"), calm)).get(name, smooth[name]) for name in read}
    made, inertial = dict(with_gusts), set()
    usable = [c for c in read if c in raw and np.ptp(raw[c]) and set(KINEMATIC[f"k_{c}"]) <= set(raw)]
    ahead = {c: scipy.integrate.cumulative_simpson(predicted[c], x=t, initial=0.0) for c in usable}
    for name, rest in smooth_channels({c: read[c] - ahead[c] for c in usable}, t).items():
        slow = _drift(read[name] - ahead[name], t)
        if np.std(rest - slow) < np.std(read[name] - _drift(read[name], t)):
            inertial.add(name)
        with_gusts[name] = ahead[name] + rest
        made[name] = ahead[name] + (slow if name in inertial else rest)
    # With the gyros' noise, a long arm would give the angles' rates the noise of the moments.
    still = (smooth["p"], smooth["q"], smooth["r"])
    air_data = ("V", "alpha", "beta")
    carried = [air_data_at_sensor(x["V"], x["alpha"], x["beta"], *still, place) for x in (with_gusts, made)]
    smooth.update(zip(air_data, carried[1]))
    smooth.update({c: made[c] for c in ("phi", "theta", "psi")})
    return dict(zip(air_data, carried[0])), frozenset(inertial), {c: x for c, x in ahead.items() if c in FLOW_ANGLES}


def _drift(x: Array, t: Array) -> Array:
    """The slow part of a signal: a line, and waves below `SLOW`."""
    line = np.polynomial.Polynomial.fit(t, x, 1)(t)
    waves = scipy.fft.dct(x - line, norm="ortho")
    waves[max(1, int(2.0 * (t[-1] - t[0]) * SLOW)) + 1 :] = 0.0
    return line + np.asarray(scipy.fft.idct(waves, norm="ortho"))
