"""Places of instruments that the readings contradict."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from structsel.numerics.unscented import KinematicsProblem, ukf_filter
from structsel.reconstruction.noise_levels import most_active_interval

_LEAST_PLACE = 0.25  # m
_SURE = 15.0  # log-likelihood
_INSTRUMENTS = {"accelerometers": [0], "vanes": [1, 2, 3], "static port": [4], "GPS antenna": [5]}


def find_reversed_positions(problem: KinematicsProblem, doubt: float) -> list[str]:
    """Say which instrument's place would be far likelier with the other sign.

    The stretch that moves most is filtered again with each coordinate turned round.

    Parameters
    ----------
    problem : KinematicsProblem
    doubt : float [-]
        How many times less the readings say than they would if they were as good, and as unrelated, as stated.
    """
    part = most_active_interval(problem)
    base = ukf_filter(part, spread=0.0)
    if base.failed >= 0:
        return []
    found = []
    for instrument, rows in _INSTRUMENTS.items():
        for axis, ahead in enumerate(("x (forward)", "y (right)", "z (down)")):
            away = float(part.place[rows[0], axis])
            if abs(away) < _LEAST_PLACE:
                continue
            place = part.place.copy()
            place[np.ix_(rows, [axis])] *= -1.0
            turned = ukf_filter(replace(part, place=place), spread=0.0)
            gain = (turned.log_likelihood - base.log_likelihood) / doubt
            if turned.failed < 0 and gain > _SURE:
                text = (
                    f"the place of the {instrument} seems to have the wrong sign: {ahead} = {-away:+.2f} m explains "
                    f"the readings far better than {away:+.2f} m (log-likelihood +{gain:.0f}; in the aircraft file)"
                )
                found.append((gain, text))
    # One place turned round makes others look wrong, too, but less.
    return [max(found)[1]] if found else []
