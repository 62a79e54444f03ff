"""Probability of an effect, from what it explains and its lead over the alternatives, by weights that are learnt."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from structsel.numerics.arrays import Array

FEATURES = ("ahead", "takes", "level", "behind", "event", "further")
"""Features of an effect; the last two count against it. B is its log Bayes factor over the tolerances.

ahead : lead over the best alternative, see `structsel.diagnosis.weighing.lead`.
takes, level : fraction explained beyond the noise, and of the constant parts beyond the biases, with exact tolerances.
behind : B minus that of the best candidate, over 10 or a fiftieth of the latter, at least -3; the factor over the
    simulation as given in place of B if the effect is a candidate by that only.
event : it has event times that were searched in the differences, or acts in one flight only.
further : an effect of another name was found before; another place of the same effect does not count.
"""
AGAINST = ("event", "further")
WEIGHTS = np.array([-3.427, 2.589, 3.653, 1.313, 1.032, -1.429, -2.407])
"""Log odds of an effect without features, and those that a feature of 1 adds. Most probable values on development
cases of both generators, from `proof/calibrate.py` (docs/decisions/0042-six-features-of-an-effect.md)."""
COLOURED, _DECAY = 3.0, 8
"""Log odds that a mismatch loses in the first search where the residual forces contain no white noise and the effect
decreases the error of no response on other flights; times the fraction of coloured noise to this power. Small physics
that is not modelled, and gusts, are then larger than the noise and resemble every effect a little. Twice that is the
most probable on development cases; a lag and a centre of gravity put into real manoeuvres are not found then."""
IDENTIFIED = 1.0
"""Log odds that an effect loses if the simulation was identified from its own flights: the form is not exact.
Of ten correct free simulations of development seeds (polynomial, from 81000) three had odds of 0.54 to 0.60 without."""
_EVEN, _SCALE = 32.0, 3.0
"""Log Bayes factor times the fraction of white noise in the residual forces, at which an effect has probability one
half however little it explains; and its scale. Correct simulations in calm air have at most 26
(34 of the proof's generators, development seeds from 71000)."""
_EVEN_LEVEL, _SCALE_LEVEL = 12.0, 1.5
"""Log Bayes factor of moving air that explains the level of a plant's velocities, at which it has probability one half,
and its scale. Simulations in still air have 11 at most (eight generated, two of a real UAV with its wind taken out)."""
AGREED = 2.0  # log Bayes factor of the size that flights agree on, at which an effect has probability one half


@dataclass(frozen=True, eq=False)
class EffectEvidence:
    """What the probability of an effect is computed from.

    Attributes
    ----------
    features : (f,) array
        See `FEATURES`.
    lead_alone : float
        The first feature if there were no alternatives.
    log_bayes : float
        Over the tolerances.
    max_log_odds : float
        Largest log odds that the agreement of the flights on its size permits, with tolerances free.
    lowers : bool
        Whether it decreases the error on other flights visibly.
    gain : float
        Largest fraction by which it decreases the rms of a response there.
    identified : bool
        Whether the simulation was identified from its own flights.
    of_form : float
        Log Bayes factor of its size, with the form of a plant or of an identified simulation as its error.
    is_plant : bool
        Whether no coefficient is simulated.
    is_tested : bool
        Whether it is tested on the response to the inputs, or is moving air in forces, which no input causes.
    is_air : bool
        Whether it is moving air.
    log_prior : float
        Log frequency with which simulations lack it, relative to other effects.
    weights : (1 + f,) array
        Log odds without features, and those that each feature adds.
    """

    features: Array
    lead_alone: float = 1.0
    log_bayes: float = 0.0
    max_log_odds: float = np.inf
    lowers: bool = True
    gain: float = 1.0
    identified: bool = False
    of_form: float = np.inf
    is_plant: bool = False
    is_tested: bool = True
    is_air: bool = False
    log_prior: float = 0.0
    weights: Array = field(default_factory=lambda: WEIGHTS)

    @property
    def log_odds(self) -> float:
        """Log odds against no effect, with its alternatives."""
        by_level = (self.log_bayes - _EVEN_LEVEL) / _SCALE_LEVEL if self.is_level else -np.inf
        return min(self.max_log_odds, max(by_level, self._of()))

    def log_odds_alone(self, of_noise: float = 0.0) -> float:
        """Log odds against no effect as if it had no alternatives, if it is tested on the response to the inputs.

        An effect that is not tested may be any part of the mismatch with the same motion as its alternatives.

        Parameters
        ----------
        of_noise : float
            See `coloured`.
        """
        if not self.is_tested:
            return self.log_odds
        lost = COLOURED * of_noise * (1.0 - self.gain)
        return min(self.max_log_odds, self._of(ahead=self.lead_alone, behind=0.0) - lost)

    def _of(self, **changed: float) -> float:
        """Log odds with some features changed."""
        x = [changed.get(name, float(value)) for name, value in zip(FEATURES, self.features)]
        return float(self.weights @ [1.0, *x] - IDENTIFIED * self.identified)

    @property
    def constant(self) -> bool:
        """Whether it explains more of the constant part of the flights than of the rest."""
        return self._feature("level") > self._feature("takes")

    @property
    def is_level(self) -> bool:
        """Whether it is steadily moving air that explains the level of a plant's velocities on other flights."""
        return self.is_plant and self.is_air and self.lowers and self.constant and not self._feature("event")

    def _feature(self, name: str) -> float:
        return float(self.features[FEATURES.index(name)])


def coloured(white: float | None) -> float:
    """Fraction of coloured noise to a power, from that of white noise; zero without forces."""
    return 0.0 if white is None else (1.0 - white) ** _DECAY


def first_probabilities(candidates: Sequence[EffectEvidence], white: float | None) -> Array:
    """(1 + n,) probabilities in the first search: of no mismatch, and of each effect.

    The probability of a mismatch is computed from each effect as if it had no alternatives, and then distributed. With
    thousands of samples the evidence is always large. An effect that does not decrease the error visibly therefore
    counts in proportion to the white noise: a coloured residual may have caused the motion. One that does counts less
    where little is white. In a plant it counts in proportion to the decrease of the error on other flights.

    Parameters
    ----------
    candidates : sequence of EffectEvidence
    white : float or None
        Fraction of white noise in the residual forces; None without forces.
    """
    of_noise = coloured(white)
    counts = 0.0 if white is None else white * (1.0 - of_noise**2)
    evidence = [
        min(((c.gain if c.is_plant else counts) * c.log_bayes - _EVEN) / _SCALE, c.of_form - AGREED) for c in candidates
    ]
    as_given = [one.log_odds_alone(of_noise) for one in candidates if one.lowers]
    by_level = [one.log_odds for one in candidates if one.is_level]
    return _distributed([*evidence, *as_given, *by_level], candidates)


def further_probabilities(candidates: Sequence[EffectEvidence]) -> Array:
    """(1 + n,) probabilities in a search after the first: of no further effect, and of each effect."""
    return _distributed([one.log_odds_alone() for one in candidates], candidates)


def _distributed(log_odds: Sequence[float], candidates: Sequence[EffectEvidence]) -> Array:
    """The largest probability that something is missing, distributed over the effects; that of nothing first."""
    if not candidates:
        return np.ones(1)
    some = float(scipy.special.expit(max(log_odds)))
    return np.array([1.0 - some, *(some * distribution(candidates))])


def distribution(candidates: Sequence[EffectEvidence]) -> Array:
    """(n,) probabilities of the effects if one of them is missing, by their log odds and how often each is missing."""
    return np.asarray(scipy.special.softmax([one.log_odds + one.log_prior for one in candidates]))
