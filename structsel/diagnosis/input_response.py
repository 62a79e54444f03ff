"""What effects bring where their forms are made of what the inputs alone drive."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from structsel.comparison.driving import input_responses
from structsel.comparison.flight import AIRFRAME, Flight
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.scoring import EffectScore, judged_by, score_all
from structsel.diagnosis.signatures import Library, Signature, spectra_of
from structsel.diagnosis.weighing import EVIDENT, bounded, log_bayes, log_bayes_as_given, with_unconfirmed_weight

_CLEARLY = 3.0  # nats, by which another form must be borne out better to be judged instead
_FORMS = 3  # of an effect, of different things, that are asked
_MUCH = 100.0  # nats; where so much is not borne out, and more than is, all forms are asked
_EXCITED = 0.3  # share of its variance, that the inputs must foretell of some channel of a motion
_MOTIONS = (("alpha", "q"), ("beta", "p", "r"))
_SIDEWAYS = frozenset({"CY", "Cl", "Cn", "k_beta", "k_phi", "k_psi"})


@dataclass(eq=False)
class InputDrivenMotion:
    """The same flights as the inputs alone would have them, and signatures there as far as they were asked for.

    Attributes
    ----------
    flights : tuple of Flight
        None of them where nothing can be asked: no input moves, or what flies is no aircraft.
    foretold : tuple of bool
        Whether the inputs that are recorded drive the motion in the plane of symmetry, and that out of it.
    """

    flights: tuple[Flight, ...]
    excited: tuple[bool, bool]
    _known: dict[Signature, Signature] = field(default_factory=dict, repr=False)
    _start: DiagnosisProblem | None = field(default=None, repr=False)

    @classmethod
    def of(cls, flights: Sequence[Flight]) -> InputDrivenMotion:
        """Of flights as recorded."""
        moved = input_responses(flights) if set(AIRFRAME) <= set(flights[0].channels) else ()
        if not moved:
            return cls((), (False, False))
        ahead, sideways = (any(_fraction(flights, moved, c) > _EXCITED for c in motion) for motion in _MOTIONS)
        return cls(moved, (ahead, sideways))

    def confirm(self, problem: DiagnosisProblem, scores: Sequence[EffectScore]) -> list[EffectScore]:
        """Scores that also know what each effect brings where the inputs alone drive the motion.

        Noise and moving air that an effect's form has in common with the differences give it evidence on the recorded
        motion, and none on this. What the air does by itself is not asked: it follows no input. Nor is what acts in a
        motion that no recorded input drives.

        Parameters
        ----------
        bench : Bench
        scores : sequence of EffectScore
            Of all hypotheses.
        """
        asked = [s for s in scores if max(log_bayes(s), log_bayes_as_given(s)) >= EVIDENT and self._can_tell(s)]
        if not asked:
            return list(scores)
        made = self._confirmed(problem, [(s, _likely(s)) for s in asked])
        lost = max(log_bayes(s) - log_bayes(made[s.effect]) for s in asked)
        if lost > max(_MUCH, *map(log_bayes, made.values())):
            made = self._confirmed(problem, [(s, range(len(s.signatures))) for s in asked])
        known = {s.effect: s for s in with_unconfirmed_weight(problem, list(made.values()))}
        return [known.get(s.effect, s) for s in scores]

    def with_effects(self, accepted: Sequence[Signature]) -> DiagnosisProblem | None:
        """Bench of these flights with effects taken in; None where nothing was asked of them."""
        if self._start is None or not accepted:
            return self._start
        return self._start.with_effects(self._again(accepted), ())

    def _can_tell(self, score: EffectScore) -> bool:
        sides = {response in _SIDEWAYS for response in score.signature.responses}
        return score.hypothesis.kind != "atmospheric" and any(self.excited[side] for side in sides)

    def _confirmed(
        self, problem: DiagnosisProblem, asked: Sequence[tuple[EffectScore, Sequence[int]]]
    ) -> Mapping[str, EffectScore]:
        """Effects with what some of their forms bring there, each in the form that is borne out best."""
        forms = self._again([s.signatures[k] for s, tried in asked for k in tried])
        found = self._again(problem.accepted)
        if self._start is None:
            self._start = DiagnosisProblem.set_up(self.flights, forms, problem.base.groups)
        extended = self._start.with_effects(found, forms) if found else self._start
        there = {s.effect: s for s in score_all(extended, Library(tuple(forms), {}))}
        made = {}
        for score, tried in asked:
            other = there[score.effect]
            gains = [bounded(score.trials[k].log_bayes, t.log_bayes) for k, t in zip(tried, other.trials)]
            best = int(np.argmax(gains))
            better = gains[best] > max(EVIDENT, gains[list(tried).index(score.best)] + _CLEARLY)
            made[score.effect] = replace(judged_by(score, tried[best]) if better else score, input_only=other)
        return made

    def _again(self, signatures: Sequence[Signature]) -> list[Signature]:
        """The same forms on flights that move otherwise."""
        for s in (s for s in signatures if s not in self._known):
            self._known[s] = replace(s, spectra=[spectra_of(s.variant, f, f.responses) for f in self.flights])
        return [self._known[s] for s in signatures]


def _likely(score: EffectScore) -> list[int]:
    """The form to judge, and the likeliest of those of something else."""
    order = [score.best, *np.argsort([-t.log_bayes for t in score.trials]).tolist()]
    first: dict[str, int] = {}
    for k in order:
        first.setdefault(score.signatures[k].variant.about, k)
    return list(first.values())[:_FORMS]


def _fraction(flights: Sequence[Flight], moved: Sequence[Flight], channel: str) -> float:
    """Share of a channel's variance, all flights together, that it still has where the inputs alone drive it."""
    left = sum(float(np.var(f[channel] - g[channel])) * len(f) for f, g in zip(flights, moved))
    unconfirmed_weight = sum(float(np.var(f[channel])) * len(f) for f in flights)
    return 1.0 - left / unconfirmed_weight if unconfirmed_weight > 0.0 else 0.0
