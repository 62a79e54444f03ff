"""Noise of readings in the differences, for plants that are simulated from readings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from structsel.comparison.flight import Flight
from structsel.comparison.nuisance import WITHIN_SAMPLE, Nuisance
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array
from structsel.numerics.signal_quality import estimate_white_noise, smoothed

_SLOWEST = 1.0 / 16.0  # of the shortest recording: width of the smoother beyond which a signal is no noise of readings


def noisy_responses(nuisances: Sequence[Nuisance]) -> set[str]:
    """Responses of a plant that are simulated from its recorded motion, with its noise."""
    return {c for n in nuisances if n.ahead for one in n.columns for c in one if c not in COEFFICIENTS}


def simulated_noise(flights: Sequence[Flight]) -> dict[str, list[Array]]:
    """White noise in each flight of the channels that are simulated from readings.

    The measured channel does not have it: more than half of it is missing there, or more than half on average over the
    simulated channels, since they come of the same readings. A quick signal, whose samples are alike, is no noise.
    """
    noises, missing = {}, {}
    for response in (c for c in flights[0].simulated if c not in COEFFICIENTS):
        noise = [estimate_white_noise(f.simulated[response]) for f in flights]
        power = sum(float(x @ x) for x in noise)
        product = sum(float(x @ estimate_white_noise(f.difference[response])) for f, x in zip(flights, noise))
        successive = sum(float(x[1:] @ x[:-1]) for x in noise)
        if power and successive <= 0.5 * power:
            noises[response], missing[response] = noise, float(np.clip(-product / power, 0.0, 1.0))
    together = float(np.mean([*missing.values()])) if missing else 0.0
    return {c: x for c, x in noises.items() if max(missing[c], together) >= 0.5}


def readings_columns(flights: Sequence[Flight], response: str, noise: Sequence[Array]) -> list[Nuisance]:
    """Noise and timing of a channel that is simulated from readings.

    The differences contain its noise with the opposite sign, and whatever smooths the simulation, such as a lag, would
    explain it. They do not contain quick signals of a simulation without noise. An acceleration, which is derived from
    readings, is of their time to a part of a sampling interval only.
    """
    quiet = [f.simulated[response] - x for f, x in zip(flights, noise)]
    delayed = [{response: -f.rate(x)} for f, x in zip(flights, quiet)]
    sd = WITHIN_SAMPLE * float(np.median([f.dt for f in flights]))
    return [
        Nuisance.of_noise(f"{response}: noise", [{response: x} for x in noise], response),
        Nuisance(f"{response}: late", sd, "s", delayed, sd, True, ahead=True),
        *_coloured_noise(response, quiet),
    ]


def _coloured_noise(response: str, signals: Sequence[Array]) -> list[Nuisance]:
    """Any part of a signal in bands of an octave: noise of readings is coloured where they are filtered or held.

    Each band may be less in what was measured, but not later: a lag remains one.
    """
    shortest = min(map(len, signals))
    made, width = [], 1.0
    while width < _SLOWEST * shortest:
        smooth = [smoothed(x, width) for x in signals]
        band = [{response: x - y} for x, y in zip(signals, smooth)]
        made.append(Nuisance.of_noise(f"{response}: noise of {width:g} samples", band, response))
        signals, width = smooth, 2.0 * width
    return made
