"""Evidence of effects on the response to the recorded inputs alone, without turbulence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from structsel.comparison.driving import input_responses
from structsel.comparison.flight import AIRFRAME, Flight
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.scoring import EffectScore, contradiction, judged_by, score_all
from structsel.diagnosis.signatures import Library, Signature, each_spectra
from structsel.diagnosis.weighing import (
    EVIDENT,
    bounded,
    confirmed,
    log_bayes,
    shows,
    with_unconfirmed_weight,
)

_CLEARLY = 3.0  # log Bayes factor by which another form must be better confirmed, to be judged instead
_FORMS = 3  # of an effect, on different parts of the aircraft, that are tested
_MUCH = 100.0  # unconfirmed log Bayes factor from which all forms are tested, if it exceeds every confirmed one
_EXCITED = 0.3  # fraction of the variance of some channel of a motion that the inputs must explain
_MOTIONS = (("alpha", "q"), ("beta", "p", "r"))
_SIDEWAYS = frozenset({"CY", "Cl", "Cn", "k_beta", "k_phi", "k_psi"})


@dataclass(eq=False)
class InputDrivenMotion:
    """Response of the flights to the recorded inputs alone, and the signatures of effects on it.

    Attributes
    ----------
    flights : tuple of Flight
        Empty if no input moves, or if the recordings are not those of an aircraft.
    excited : tuple of bool
        Whether the recorded inputs excite the longitudinal motion, and the lateral motion.
    """

    flights: tuple[Flight, ...]
    excited: tuple[bool, bool]
    _known: dict[Signature, Signature] = field(default_factory=dict, repr=False)
    _start: DiagnosisProblem | None = field(default=None, repr=False)

    @classmethod
    def of(cls, flights: Sequence[Flight]) -> InputDrivenMotion:
        """Response to the inputs of recorded flights."""
        moved = input_responses(flights) if set(AIRFRAME) <= set(flights[0].channels) else ()
        if not moved:
            return cls((), (False, False))
        ahead, sideways = (any(_fraction(flights, moved, c) > _EXCITED for c in motion) for motion in _MOTIONS)
        return cls(moved, (ahead, sideways))

    def confirm(self, problem: DiagnosisProblem, scores: Sequence[EffectScore]) -> list[EffectScore]:
        """Scores with the evidence of each effect on the response to the recorded inputs.

        Noise and turbulence enter both the differences and the form of an effect. They give it evidence on the recorded
        motion, but none on the response to the inputs. Atmospheric effects are not tested, because they follow no
        input, nor are effects on a motion that no recorded input excites.

        Parameters
        ----------
        problem : DiagnosisProblem
        scores : sequence of EffectScore
            Of all effects.
        """
        asked = [s for s in scores if shows(s) and self._can_tell(s)]
        if not asked:
            return list(scores)
        made = self._confirmed(problem, [(s, _likely(s)) for s in asked])
        most = max(map(log_bayes, made.values()))
        lost = max(log_bayes(s) - log_bayes(made[s.effect]) for s in asked)
        # The response to the inputs only lowers evidence: no other effect can exceed the most.
        leading = [s for s in asked if log_bayes(s) > most]
        if leading and lost > max(_MUCH, most):
            made |= self._confirmed(problem, [(s, range(len(s.signatures))) for s in leading])
        known = {s.effect: s for s in with_unconfirmed_weight(problem, list(made.values()))}
        return [known.get(s.effect, s) for s in scores]

    def with_effects(self, accepted: Sequence[Signature]) -> DiagnosisProblem | None:
        """Problem of these flights with effects in the model; None if no effect was tested on them."""
        if self._start is None or not accepted:
            return self._start
        return self._start.with_effects(self._again(accepted), ())

    def _can_tell(self, score: EffectScore) -> bool:
        sides = {response in _SIDEWAYS for response in score.signature.responses}
        return score.hypothesis.kind != "atmospheric" and any(self.excited[side] for side in sides)

    def _confirmed(
        self, problem: DiagnosisProblem, asked: Sequence[tuple[EffectScore, Sequence[int]]]
    ) -> dict[str, EffectScore]:
        """Effects with the evidence of some of their forms there, each judged by the form that is confirmed best."""
        forms = self._again([s.signatures[k] for s, tried in asked for k in tried])
        found = self._again(problem.accepted)
        if self._start is None:
            self._start = DiagnosisProblem.set_up(self.flights, forms, problem.base.groups)
        extended = self._start.with_effects(found, forms) if found else self._start
        there = {s.effect: s for s in score_all(extended, Library(tuple(forms), {}))}
        made = {}
        for score, tried in asked:
            other = there[score.effect]
            mine = [score.trials[k] for k in tried]
            lost = [contradiction(*both) for both in zip(mine, other.trials)]
            gains = [bounded(one.log_bayes, confirmed(t.log_bayes, x)) for one, t, x in zip(mine, other.trials, lost)]
            now, best = list(tried).index(score.best), int(np.argmax(gains))
            if gains[best] > max(EVIDENT, gains[now] + _CLEARLY):
                score, now = judged_by(score, tried[best]), best
            made[score.effect] = replace(score, input_only=other, contradiction=lost[now])
        return made

    def _again(self, signatures: Sequence[Signature]) -> list[Signature]:
        """The same forms on the response to the inputs."""
        new = [s for s in dict.fromkeys(signatures) if s not in self._known]
        spectra = each_spectra([s.variant for s in new], self.flights, self.flights[0].responses)
        self._known |= {s: replace(s, spectra=made) for s, made in zip(new, spectra)}
        return [self._known[s] for s in signatures]


def _likely(score: EffectScore) -> list[int]:
    """The form that is judged, and the most probable forms on other parts of the aircraft."""
    order = [score.best, *np.argsort([-t.log_bayes for t in score.trials]).tolist()]
    first: dict[str, int] = {}
    for k in order:
        first.setdefault(score.signatures[k].variant.about, k)
    return list(first.values())[:_FORMS]


def _fraction(flights: Sequence[Flight], moved: Sequence[Flight], channel: str) -> float:
    """Fraction of the variance of a channel that the inputs explain, all flights together."""
    left = sum(float(np.var(f[channel] - g[channel])) * len(f) for f, g in zip(flights, moved))
    total = sum(float(np.var(f[channel])) * len(f) for f in flights)
    return 1.0 - left / total if total > 0.0 else 0.0
