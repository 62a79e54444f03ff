"""Residual where an effect acts, relative to the noise: how far its evidence depends on the estimated noise.

A log Bayes factor holds if the noise is the estimated one. Slow errors of reconstructed states, gusts, and errors of a
simulation's form last, and are larger at some frequencies and in some manoeuvres than elsewhere. The variance of an
estimate is then larger than the usual one, and by how much shows the residual itself [W80, Theorem 1].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.signatures import Signature
from structsel.numerics.arrays import Array


@dataclass(frozen=True)
class Dispersion:
    """Residual beside one effect, where it acts.

    Attributes
    ----------
    ratio : float [-]
        Its mean square in units of the noise, weighted with the squared effect: the ratio of the variance of the
        effect's size, with the noise that the residual shows there, to that with the estimated noise.
    power : float [-]
        Sum of squares of the change that the effect makes to the residual, in units of the noise.
    """

    ratio: float = 1.0
    power: float = 0.0

    @classmethod
    def of(cls, problem: DiagnosisProblem, signature: Signature) -> Dispersion:
        """Dispersion of an effect in one of its forms, with all parameters fitted to all flights.

        Parameters
        ----------
        problem : DiagnosisProblem
            Without the effect.
        signature : Signature
        """
        extended = problem.with_effect(signature)
        pairs = zip(problem.fitted_residuals, extended.fitted_residuals)
        # The constant part of each response is no noise: biases explain it.
        moving = [np.delete(np.stack([one, other]), np.s_[:: r.size], axis=1) for (r, one), (_, other) in pairs]
        before, after = np.concatenate(moving, axis=1)
        return cls.between(before, after)

    @classmethod
    def between(cls, before: Array, after: Array) -> Dispersion:
        """Dispersion from white residuals (n,) without and with an effect."""
        squares = (before - after) ** 2
        power = float(squares.sum())
        return cls(float(squares @ after**2) / power if power > 0.0 else 1.0, power)

    def reduced(self, log_bayes: float) -> float:
        """A log Bayes factor as if the noise were larger by the ratio.

        That of which the effect relieves the tolerances depends on the noise less than the fit to the differences does.

        Parameters
        ----------
        log_bayes : float
            By the estimated noise.
        """
        if log_bayes <= 0.0 or self.ratio <= 1.0:
            return log_bayes
        return max(log_bayes / self.ratio, log_bayes - 0.5 * (1.0 - 1.0 / self.ratio) * self.power)


NOISE_ALONE = Dispersion()
"""Where the residual is noise."""
