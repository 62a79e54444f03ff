"""Residual that lasts in one response alone: the cause is outside the library.

Moving air, wrong readings and errors of the form act on several responses. Noise of the instruments hardly lasts in
moments; in forces it may last as far as it is white, and only what exceeds that counts. A prediction error does not
show such a residual, because the past of a slow residual predicts the rest of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from structsel.comparison.flight import Flight
from structsel.formatting import format_percent
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array
from structsel.numerics.signal_quality import white_noise_std

_MEAN, _APART = 0.3, 0.6  # s, means of the residual and the time between two of them; noise is shorter
_FEWEST = 3  # responses of which one can be alone
_OTHERS = 2.5
"""Factor on the second largest lasting residual, up to which the largest may have the same cause. Of 30 correct
simulations in turbulence (proof, seeds from 1100000 and 1102000) the largest is 1.8 times the second at most."""
_EVEN, _SCALE = 0.035, 0.003
"""Lasting residual beyond that of the others, relative to the response's variation, at which a mismatch is as probable
as none, and its scale. In moments of 112 correct simulations of the same seeds it is 0.008 at most; of 16 with an
effect outside the library in a moment it is 0.028 or more in ten. Without usual noise of the other instruments it is
0.025 at most (Cl, a free simulation in turbulence) in 179 correct simulations."""
_OF_INSTRUMENTS = {"CX": 0.75, "CY": 0.75, "CZ": 1.75}
"""Lasting residual of a force over its white noise, beyond that of the other of CX and CY, up to which its instruments
may be the cause: accelerometers of one unit have similar noise, and CZ has the noise of alpha too. Of 63 correct
simulations in calm air (development seeds from 93300, and evaluation 1112000) it is 0.5, 0.5 and 1.4 at most where no
other response lasts as much; of eight with an effect outside the library in CX or CZ alone it is 1.0 to 6.3."""
_QUIET = 0.45
"""Fraction of this that does not count in the other responses. Where their instruments have more noise that lasts, so
may those of the response in question: correct simulations with such noise in all instruments have up to 0.045 in Cm."""
_ACCURATE, _ACCURACY_SCALE = 0.02, 0.002
"""Lasting residual of the others up to which they are as accurate as noise and form allow, and its scale. With the
sixteen effects outside the library it is 0.018 at most where the moment shows. On real recordings, where the moment
has 3 to 12 times as much in correct simulations too, it is 0.026 (HFB-320) to 0.05 (ATTAS, Citation)."""


@dataclass(frozen=True)
class IsolatedResidual:
    """The response whose residual lasts most of all coefficients.

    Attributes
    ----------
    response : str
    size, others : float [-]
        Its lasting residual; and the largest of the other coefficients beyond usual noise of their instruments, or
        what the form of the simulation leaves of one, if that is more; each over the rms by which it varies.
    expected : float [-]
        What instruments, and the form of a simulation that is not exact, may leave of it, in the same unit.
    fraction : float [-]
        The lasting residual over that without the effects in the model. An effect that explains most of it is not wrong
        because its form leaves the rest.
    """

    response: str
    size: float
    others: float
    expected: float = 0.0
    fraction: float = 1.0

    @property
    def probability(self) -> float:
        """Probability of a mismatch of this response alone."""
        beyond = np.sqrt(max(0.0, self.size**2 - (_OTHERS * self.others) ** 2 - self.expected**2))
        odds = (beyond - _EVEN) / _SCALE, (_ACCURATE - self.others) / _ACCURACY_SCALE
        return self.fraction * float(np.prod(scipy.special.expit(odds)))

    @property
    def says(self) -> str:
        """One plain sentence."""
        return (
            f"The residual of {self.response} lasts as that of no other response does: {format_percent(self.size)} of "
            f"its variation, where the others have {format_percent(self.others)} at most."
        )


def find_isolated(
    flights: Sequence[Flight], residuals: Sequence[Mapping[str, Array]], form: Mapping[str, float]
) -> IsolatedResidual | None:
    """The response whose residual lasts most; None with too few coefficients.

    Parameters
    ----------
    flights : sequence of Flight
    residuals : sequence of mapping of response to (n,) array
        Per flight.
    form : mapping of response to float
        Rms that the form of the simulation is known to leave, over the rms by which the response varies.
    """
    lasting = lasting_residuals(flights, residuals)
    if len(lasting) < _FEWEST:
        return None
    white = {c: _white(flights, c) for c in _OF_INSTRUMENTS if c in lasting}
    usual = {c: _QUIET * _OF_INSTRUMENTS[c] * white[c] if c in white else 0.0 for c in lasting}
    beyond = {c: float(np.sqrt(max(0.0, x**2 - usual[c] ** 2))) for c, x in lasting.items()}
    first, second, *_ = sorted(beyond, key=lambda c: -beyond[c])
    expected = np.hypot(_of_instruments(lasting, white, first), form.get(first, 0.0))
    inexact = max((x for c, x in form.items() if c in lasting and c != first), default=0.0)
    return IsolatedResidual(first, lasting[first], max(beyond[second], inexact), float(expected))


def _of_instruments(lasting: Mapping[str, float], white: Mapping[str, float], response: str) -> float:
    """Lasting residual that the instruments may cause, over the rms by which the response varies.

    Parameters
    ----------
    lasting : mapping of response to float
    white : mapping of force to float
        See `_white`.
    response : str
    """
    if response not in white:
        return 0.0
    beside = [lasting[c] / white[c] for c in ("CX", "CY") if c in white and c != response]
    return (_OF_INSTRUMENTS[response] + max(beside, default=0.0)) * white[response]


def _white(flights: Sequence[Flight], response: str) -> float:
    """White noise of a coefficient, over the rms by which it varies; infinite of readings that hold their values."""
    levels = np.array([white_noise_std(f.measured[response]) for f in flights])
    if not levels.all():
        return np.inf
    return float(np.sqrt(np.mean(levels**2)) / np.concatenate([f.measured[response] for f in flights]).std())


def lasting_residuals(flights: Sequence[Flight], residuals: Sequence[Mapping[str, Array]]) -> dict[str, float]:
    """Root of the covariance of means of each coefficient's residual, over the rms by which the coefficient varies.

    The means are over 0.3 s, and 0.6 s apart.
    """
    made = {}
    for c in (c for c in COEFFICIENTS if all(c in left and c in f.measured for f, left in zip(flights, residuals))):
        products, samples = 0.0, 0
        for f, left in zip(flights, residuals):
            mean = scipy.ndimage.uniform_filter1d(left[c] - left[c].mean(), max(1, round(_MEAN / f.dt)))
            apart = max(1, round(_APART / f.dt))
            products += float(mean[apart:] @ mean[:-apart])
            samples += max(0, len(mean) - apart)
        varies = float(np.concatenate([f.measured[c] for f in flights]).std())
        if samples and varies > 0.0:
            made[c] = float(np.sqrt(max(0.0, products / samples))) / varies
    return made
