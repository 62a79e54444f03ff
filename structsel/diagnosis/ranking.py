"""Finds the physics left out, one effect after another, each held to what it brings on other flights."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import logsumexp

from structsel.diagnosis import judging
from structsel.diagnosis.bench import Bench
from structsel.diagnosis.scoring import Score, score_all
from structsel.diagnosis.signatures import Library
from structsel.mismatch.responses import COEFFICIENTS

MOST = 4
"""Effects that are looked for."""
TEMPERATURE = 4.0
"""By which log evidence is divided: rows are white only as far as the noise is known."""
_NOTHING = 12.0
"""Nats on other flights that misfits of the rows bring by themselves."""
_PULLED = 8.0
"""Nats by which tolerances need be pulled less, for an effect that one of them may imitate: 4 standard deviations."""
_MATERIAL = (0.05, 0.08)  # share by which the rms of some response must fall on other flights, beyond a refit; later
_DELIVERED = 0.10  # the same, beyond the simulation as delivered; of the first effect
_ROUGH = 4.0  # times as much of both, and of the nats, where gusts move states that the simulation was not told of
_EVENT = 0.5  # of its evidence that an effect of one flight may count, which no other flight can foretell
_TRIED = 24
_EXCESS = 2.0  # mean square in units of the noise, from which a misfit is plain whatever its share of the error
_OF_EXCESS = 0.4  # of what is beyond the noise, that an effect must then take
OF_BEST = 0.02
"""Of the best's nats, that the form of any effect may miss by."""
_OF_FIRST = 0.03  # of the first effect's nats: a form that is nearly right leaves about that much of itself

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class Step:
    """One effect taken in, and its rivals at that point.

    Attributes
    ----------
    score : Score
    rivals : tuple of (effect, probability)
        All that were tried, likeliest first, the effect itself among them; "nothing" too.
    ranks : mapping of effect to float
        Nats on other flights.
    bench : Bench
        With the effect taken in.
    gained : mapping of response to float
        Share by which the rms falls on other flights.
    others : tuple of Score
        All that were tried beside it, best first.
    """

    score: Score
    rivals: tuple[tuple[str, float], ...]
    ranks: Mapping[str, float]
    bench: Bench
    gained: Mapping[str, float]
    others: tuple[Score, ...] = ()


@dataclass(frozen=True, eq=False)
class Ranking:
    """Everything found.

    Attributes
    ----------
    start : Bench
        Without any effect.
    steps : tuple of Step
    last : tuple of Score
        Of all hypotheses after the last step: what was still tried, and did not do.
    refused : tuple of (effect, reason)
    """

    start: Bench
    steps: tuple[Step, ...]
    last: tuple[Score, ...]
    refused: tuple[tuple[str, str], ...] = field(default=())

    @property
    def bench(self) -> Bench:
        """With everything found taken in."""
        return self.steps[-1].bench if self.steps else self.start


def rank_of(score: Score) -> float:
    """Nats that a hypothesis brings on flights not used for it."""
    ahead = float(score.predictive.sum()) + min(0.0, score.within)
    if score.hypothesis.event:
        return max(ahead, _EVENT * score.log_evidence) + score.hypothesis.log_prior
    return ahead + score.hypothesis.log_prior


def rank(bench: Bench, library: Library, rough: bool = False, progress: Progress | None = None) -> Ranking:
    """Take effects in one after another while they bring enough on other flights.

    Parameters
    ----------
    bench : Bench
    library : Library
    rough : bool
        Whether the air was turbulent: more is asked for then.
    progress : callable, optional
    """
    tell = progress or (lambda what, done, of: None)
    start = bench
    steps: list[Step] = []
    refused: list[tuple[str, str]] = []
    scores: list[Score] = []
    for k in range(MOST):
        tell("ranking", k, MOST)
        scores = sorted(score_all(bench, library), key=rank_of, reverse=True)
        floor = _OF_FIRST * max(steps[0].ranks.values()) if steps else 0.0
        tried = [s for s in scores if rank_of(s) >= floor or not steps]
        step = _take_best(bench, library, tried, refused, _ROUGH if rough else 1.0)
        if step is None:
            break
        steps.append(step)
        bench = step.bench
    tell("ranking", MOST, MOST)
    return Ranking(start, tuple(steps), tuple(scores), tuple(refused))


def _take_best(
    bench: Bench, library: Library, scores: Sequence[Score], refused: list[tuple[str, str]], strict: float
) -> Step | None:
    """The best hypothesis that holds on other flights and matters; None where there is none.

    An effect that a tolerance can imitate brings little beyond a refit, however large it is. So an effect matters if it
    lowers the error either beyond a refit, or beyond the simulation as delivered while sparing the tolerances.
    """
    able = sorted((s for s in scores if worth(s) > strict - 1.0), key=lambda s: -max(rank_of(s), _pulled(s)))
    if not able:
        return None
    delivered = bench.as_delivered()
    later = min(len(bench.accepted), 1)  # beside another effect, what only spares the tolerances is not trusted
    before, before_delivered = judging.held_out(bench), judging.held_out(delivered)
    told = [c for c in bench.responses if c in COEFFICIENTS] or list(bench.responses)
    small: set[str] = set()
    plain = judging.excess(bench)
    for one in able[:_TRIED]:
        beside = bench.beside(one.signature)
        gained = judging.gains(before, judging.held_out(beside), told)
        in_all = judging.gains(before_delivered, judging.held_out(delivered.beside(one.signature)), told)
        beyond = max(gained.values(), default=0.0)
        small_beyond = beyond < strict * _MATERIAL[later]
        small_in_all = bool(later) or max(in_all.values(), default=0.0) < strict * _DELIVERED
        if small_beyond and small_in_all and not _takes_excess(plain, judging.excess(beside), told):
            refused.append((one.effect, f"{rank_of(one):.0f} nats, but {beyond:.1%} of the error only"))
            small.add(one.effect)
            continue
        new = bench.taking([*bench.accepted, one.signature], library.signatures)
        ranks = {s.effect: max(rank_of(s), _pulled(s)) for s in scores}
        chances = {s.effect: ranks[s.effect] for s in able if s.effect not in small}
        return Step(one, probabilities(chances), ranks, new, in_all, tuple(scores[:12]))
    return None


def worth(score: Score) -> float:
    """Whether a hypothesis brings more than misfits do by themselves: above zero where it does."""
    return max(rank_of(score) / _NOTHING, _pulled(score) / _PULLED) - 1.0


def _takes_excess(before: Mapping[str, float], after: Mapping[str, float], told: Sequence[str]) -> bool:
    """Whether most of a plain misfit goes, though noise elsewhere in the band hides it in the error."""
    return any(before[c] > _EXCESS and before[c] - after[c] > _OF_EXCESS * (before[c] - 1.0) for c in told)


def _pulled(score: Score) -> float:
    """Nats that a hypothesis spares the tolerances (and the fit), one for each further parameter taken off."""
    if float(score.predictive.sum()) < -_PULLED:
        return 0.0
    return score.trial.gain - (score.signature.width - 1.0) + min(0.0, score.within)


def probabilities(ranks: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
    """Probability of each effect in question, and of nothing, likeliest first."""
    nats = {**ranks, "nothing": _PULLED}
    # No form is quite right; with many nats, how nearly right it is decides more than noise does.
    values = np.array(list(nats.values())) / max(TEMPERATURE, OF_BEST * max(nats.values()))
    p = np.exp(values - logsumexp(values))
    return tuple(sorted(zip(nats, map(float, p)), key=lambda item: -item[1]))
