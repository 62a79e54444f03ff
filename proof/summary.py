"""Figures of many scored cases: rates with confidence limits, groups, calibration, confusions, and their aims."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd
from scipy.stats import binomtest
from sklearn.metrics import brier_score_loss

from proof.score import CONFIDENT, NO_ANSWER, WITHOUT, CaseScore, Claim

NAMED_IN = ("single", "pair", "clutter")
"""Families in which there is an effect of the library to name."""
SCHEMA = "structsel.proof/1"
_BINS = 10
_ROUNDING = 1e-3


@dataclass(frozen=True)
class Figure:
    """One line of the proof.

    Attributes
    ----------
    name : str
    value : float
        nan if no case applies.
    of : int
        Cases, claims or parameters that it counts.
    aim : float or None
    better : {"high", "low"}
    limits : (float, float) or None
        90 % interval of a rate (Clopper and Pearson).
    top : float
        Upper end of a band that `aim` begins; inf where more is better.
    """

    name: str
    value: float
    of: int
    aim: float | None = None
    better: Literal["high", "low"] = "high"
    limits: tuple[float, float] | None = None
    top: float = math.inf

    @property
    def met(self) -> bool | None:
        """Whether the aim is reached; None without one, or without a case."""
        if self.aim is None or not self.of or math.isnan(self.value):
            return None
        if self.better == "low":
            return self.value <= self.aim
        return self.aim <= self.value <= self.top


@dataclass(frozen=True)
class Group:
    """Cases of one effect, severity, source or family.

    Attributes
    ----------
    name : str
    cases : int
    rates : mapping of figure to float
        ``top1``, ``tie``, ``top3``, ``kind``, ``axis``; nan where it does not apply.
    gain, iou : float
        Medians.
    """

    name: str
    cases: int
    rates: Mapping[str, float]
    gain: float
    iou: float


@dataclass(frozen=True)
class Bin:
    """Claims of about one probability: number, mean stated probability, fraction that is right."""

    count: int
    stated: float
    right: float


@dataclass(frozen=True)
class Summary:
    """All figures of a proof.

    Attributes
    ----------
    figures : tuple of Figure
    groups : mapping of "effect", "severity", "source", "family", "form" to tuple of Group
    reliability : tuple of Bin
        Ten, of equal width from 0 to 1.
    confusion : mapping of truth to mapping of what was named first to count
    """

    figures: tuple[Figure, ...]
    groups: Mapping[str, tuple[Group, ...]]
    reliability: tuple[Bin, ...]
    confusion: Mapping[str, Mapping[str, int]]

    def __getitem__(self, name: str) -> Figure:
        return next(f for f in self.figures if f.name == name)

    def to_dict(self) -> dict[str, Any]:
        """For proof.json."""
        return {
            "figures": [{**asdict(f), "top": None if math.isinf(f.top) else f.top, "met": f.met} for f in self.figures],
            "groups": {by: [asdict(g) for g in groups] for by, groups in self.groups.items()},
            "reliability": [asdict(b) for b in self.reliability],
            "confusion": {truth: dict(named) for truth, named in self.confusion.items()},
        }


def summarise(scores: Sequence[CaseScore]) -> Summary:
    """Figures of a set of scored cases."""
    named = [s for s in scores if s.family in NAMED_IN]
    claims = [c for s in scores for c in s.claims]
    return Summary(
        (*_of_names(named, scores), *_of_places(named), *_of_probabilities(claims), *_compared_with_simple(named)),
        {
            "family": _groups(scores, lambda s: s.family),
            "severity": _groups(named, lambda s: s.severity),
            "source": _groups(named, lambda s: s.source),
            "form": _groups(named, lambda s: s.form),
            "effect": _groups([s for s in named if s.family == "single"], lambda s: s.truth),
        },
        reliability(claims),
        _confusion(scores),
    )


# --- figures ---------------------------------------------------------------------------------------------------------


def _rate(
    name: str,
    flags: Iterable[bool | None],
    aim: float | None = None,
    better: Literal["high", "low"] = "high",
    top: float = math.inf,
) -> Figure:
    held = [bool(f) for f in flags if f is not None]
    k, n = sum(held), len(held)
    return Figure(name, k / n if n else math.nan, n, aim, better, _limits(k, n) if n else None, top)


def _limits(k: int, n: int) -> tuple[float, float]:
    """90 % confidence interval of a rate, after Clopper and Pearson."""
    limits = binomtest(k, n).proportion_ci(0.9, method="exact")
    return float(limits.low), float(limits.high)


def _median(
    name: str, values: Iterable[float | None], aim: float | None = None, better: Literal["high", "low"] = "high"
) -> Figure:
    held = [v for v in values if v is not None]
    return Figure(name, float(np.median(held)) if held else math.nan, len(held), aim, better)


def _of_names(named: Sequence[CaseScore], scores: Sequence[CaseScore]) -> list[Figure]:
    decided = [s for s in named if s.decided]
    sure = [c for s in scores for c in s.claims if c.probability >= CONFIDENT and c.effect != "unknown"]
    return [
        _rate("right effect first", (s.top1 for s in named), 0.88),
        _rate("right effect first, or a declared tie", (s.tie for s in named)),
        _rate("right effect first, where the data decide", (s.top1 for s in decided)),
        _rate("the same or a declared tie, where the data decide", (s.tie for s in decided), 0.95),
        _rate("right effect among three", (s.top3 for s in named), 0.98),
        _rate("both of a pair", (s.both for s in named), 0.85),
        _rate("both of a pair, where the data decide each", (s.both for s in named if s.each_decided)),
        _rate("wrong among confidently named", (not c.right for c in sure), 0.02, "low"),
        _rate("false alarms on nulls", (s.alarm for s in scores), 0.02, "low"),
        _rate("outside the library, named", (s.claimed for s in scores if s.family == "outside"), 0.05, "low"),
        _rate("without the true hypothesis, named", (s.claimed for s in scores if s.family == WITHOUT), 0.05, "low"),
        _rate("right verdict", (s.verdict for s in scores if s.family != WITHOUT)),
        _rate("answered", (s.named != NO_ANSWER for s in scores), 1.0),
    ]


def _of_places(named: Sequence[CaseScore]) -> list[Figure]:
    sizes = [x for s in named for x in s.sizes]
    return [
        _rate("right kind", (s.kind for s in named)),
        _rate("clearest response right", (s.axis for s in named)),
        _median("interval overlap, median", (s.iou for s in named), 0.8),
        _median("held-out gain over the attainable, median", (s.gain for s in named), 0.9),
        _median("held-out gain beyond a refit, median", (s.beyond for s in named)),
        _rate("worse than a refit", (None if s.beyond is None else s.beyond < -_ROUNDING for s in named), 0.0, "low"),
        _median("error of parameters, median", (x.error for x in sizes), 0.05, "low"),
        _rate("truth within 90 % intervals", (x.inside for x in sizes), 0.85, top=0.95),
    ]


def _of_probabilities(claims: Sequence[Claim]) -> list[Figure]:
    n, right = len(claims), [c.right for c in claims]
    brier = float(brier_score_loss(right, [c.probability for c in claims], pos_label=True)) if n else math.nan
    off = sum(b.count * abs(b.stated - b.right) for b in reliability(claims) if b.count)
    return [
        Figure("Brier score", brier, n, 0.10, "low"),
        Figure("expected calibration error", off / n if n else math.nan, n, 0.05, "low"),
    ]


def _compared_with_simple(named: Sequence[CaseScore]) -> list[Figure]:
    """Fraction of right first names of each simple method, and the difference from it on the same cases."""
    made = []
    for method in dict.fromkeys(w for s in named for w in s.simple):
        same = [s for s in named if method in s.simple]
        theirs = _rate(f"{method}: right effect first", (s.simple[method][0] for s in same))
        ours = _rate("", (s.top1 for s in same)).value
        made += [
            theirs,
            _rate(f"{method}: right effect among three", (s.simple[method][1] for s in same)),
            Figure(f"above {method}", ours - theirs.value, len(same), 0.25),
        ]
    return made


def reliability(claims: Sequence[Claim]) -> tuple[Bin, ...]:
    """Claims in ten bins of stated probability."""
    frame = pd.DataFrame([(c.probability, c.right) for c in claims], columns=["stated", "right"], dtype=float)
    place = np.clip((frame["stated"] * _BINS).astype(int), 0, _BINS - 1)
    found = frame.groupby(place).agg(["size", "mean"]).reindex(range(_BINS))
    return tuple(
        Bin(0 if math.isnan(count) else int(count), float(stated), float(right))
        for count, stated, right in zip(found["stated", "size"], found["stated", "mean"], found["right", "mean"])
    )


# --- groups ----------------------------------------------------------------------------------------------------------


def _groups(scores: Sequence[CaseScore], by: Callable[[CaseScore], str]) -> tuple[Group, ...]:
    if not scores:
        return ()
    rates, medians = ["top1", "tie", "top3", "kind", "axis"], ["gain", "iou"]
    values = [[getattr(s, f) for f in (*rates, *medians)] for s in scores]
    frame = pd.DataFrame(values, columns=[*rates, *medians], dtype=float)
    return tuple(
        Group(
            str(name), len(held), {f: float(held[f].mean()) for f in rates}, *(float(held[f].median()) for f in medians)
        )
        for name, held in frame.groupby([by(s) for s in scores])
    )


def _confusion(scores: Sequence[CaseScore]) -> dict[str, dict[str, int]]:
    """What was named first, by the largest effect that was there; pairs are left out: either may stand first."""
    made: dict[str, Counter[str]] = {}
    for s in scores:
        if s.family not in ("pair", WITHOUT):
            made.setdefault(s.truth, Counter())[s.truth if s.top1 else s.named] += 1
    return {truth: dict(made[truth].most_common()) for truth in sorted(made)}
