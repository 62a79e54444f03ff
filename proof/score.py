"""Compares one diagnosis with the key of its case."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from proof.keys import EffectKey, Key
from proof.parameter_names import sizes_put_in

NOTHING, NO_ANSWER = "nothing", "no answer"
CONFIDENT = 0.8
"""Probability from which an effect counts as named with confidence."""
WITHOUT = "without"
"""Family of a single whose own hypothesis was taken out of the library."""
_WORTH = 0.05  # attainable fraction from which a response counts towards the gain
_NINETY = 1.6449  # standard deviations within which 90 % of a normal distribution lie

Spans = Mapping[str, Sequence[float]]
Json = Mapping[str, Any]


@dataclass(frozen=True)
class Claim:
    """An effect that was named.

    Attributes
    ----------
    effect : str
    probability : float
    right : bool
        The key accepts it.
    """

    effect: str
    probability: float
    right: bool


@dataclass(frozen=True)
class Sized:
    """A parameter whose true size is known.

    Attributes
    ----------
    effect, name : str
    error : float
        Of its size, relative.
    inside : bool or None
        The truth lies within the 90 % interval; None where no standard deviation is stated.
    """

    effect: str
    name: str
    error: float
    inside: bool | None


@dataclass(frozen=True)
class CaseScore:
    """Scores of one diagnosis; None where a figure does not apply.

    Attributes
    ----------
    name, source, family, severity, form : str
    truth : str
        The largest effect, or ``nothing``.
    named : str
        First named: an effect, ``nothing`` or ``no answer``.
    verdict : bool
        It is one of those that are right.
    decided : bool
        The data can decide it.
    top1, tie, top3 : bool, optional
        The right effect first; or with a tie declared that the key allows; or among the first three names.
    kind, axis : bool, optional
        Of the finding that is right, or else of the first.
    axes, iou : float, optional
        Intersection over union of the named and the true responses, or seconds.
    alarm : bool, optional
        A null was called a mismatch, or something other than turbulence was named in it.
    claimed : bool, optional
        Something of the library was named where nothing of it can be right.
    both : bool, optional
        Each effect of a pair was named.
    each_decided : bool
        The data can decide each effect of a pair.
    gain : float, optional
        Fraction of the attainable fall of the held-out error that was reached.
    beyond : float, optional
        Relative reduction of the held-out error compared with a refit without the physics; negative if it rises.
    claims : tuple of Claim
    sizes : tuple of Sized
    simple : mapping of baseline to (right first, right among the first three)
    seconds : float
    """

    name: str
    source: str
    family: str
    severity: str
    form: str
    truth: str
    named: str
    verdict: bool
    decided: bool = True
    top1: bool | None = None
    tie: bool | None = None
    top3: bool | None = None
    kind: bool | None = None
    axis: bool | None = None
    axes: float | None = None
    iou: float | None = None
    alarm: bool | None = None
    claimed: bool | None = None
    both: bool | None = None
    each_decided: bool = False
    gain: float | None = None
    beyond: float | None = None
    claims: tuple[Claim, ...] = ()
    sizes: tuple[Sized, ...] = ()
    simple: Mapping[str, tuple[bool, bool]] = field(default_factory=dict)
    seconds: float = math.nan


def score_case(
    name: str,
    diagnosis: Json | None,
    key: Key,
    spans: Spans | None = None,
    *,
    without_truth: bool = False,
    simple: Mapping[str, Sequence[str]] | None = None,
    seconds: float = math.nan,
) -> CaseScore:
    """Compare a diagnosis with its key.

    Parameters
    ----------
    name : str
    diagnosis : mapping, optional
        Content of diagnosis.json; None without an answer.
    key : Key
    spans : mapping of recording to (first, last) [s], optional
        Interval of a finding without intervals of its own.
    without_truth : bool
        The right hypothesis was not in the library.
    simple : mapping of baseline to names, likeliest first, optional
    seconds : float
        Time that the diagnosis took.
    """
    family = WITHOUT if without_truth else key.family
    diagnosed: Json = diagnosis if diagnosis is not None else {"verdict": "", "findings": []}
    findings: list[Json] = list(diagnosed["findings"])
    named = NO_ANSWER if diagnosis is None else effect_of(findings[0]) if findings else NOTHING
    fields: dict[str, Any] = {}
    if family == "null":
        fields["alarm"] = diagnosed["verdict"] == "mismatch" or any(
            effect_of(f) != "turbulence" and not _accepts(key, effect_of(f)) for f in findings
        )
    elif family in ("outside", WITHOUT):
        fields["claimed"] = _claims_library(diagnosed, findings, key)
    else:
        fields |= _named_right(findings, key)
    if key.effects and family != "null":
        fields |= _located(findings, key, spans or {})
        fields["gain"] = _gain(findings, key)
    if findings and family != "null":
        fields["beyond"] = _beyond(findings)
    if family != WITHOUT:
        fields["claims"] = tuple(Claim(effect_of(f), probability_of(f), _accepts(key, effect_of(f))) for f in findings)
        fields["sizes"] = tuple(_sizes(findings, key))
        targets = _targets(key) if family not in ("null", "outside") else ()
        fields["simple"] = {
            method: (any(_right(names[:1], e) for e in targets), any(_right(names[:3], e) for e in targets))
            for method, names in (simple or {}).items()
            if targets
        }
    return CaseScore(
        name, key.source, family, key.severity, key.form, key.effects[0].effect if key.effects else NOTHING, named,
        diagnosed["verdict"] in key.verdicts, key.decided, seconds=seconds, **fields,
    )  # fmt: skip


def effect_of(finding: Json) -> str:
    """Likeliest effect of a finding."""
    return str(finding["physics"][0]["effect"]) if finding.get("physics") else "unknown"


def probability_of(finding: Json) -> float:
    """Probability stated for it."""
    return float(finding["physics"][0]["probability"]) if finding.get("physics") else 0.0


def overlap(found: Mapping[str, Sequence[Sequence[float]]], true: Mapping[str, Sequence[Sequence[float]]]) -> float:
    """Overlap of two sets of intervals: seconds in both over seconds in either; 1 where both are empty."""
    both = either = 0.0
    for recording in {*found, *true}:
        a, b = _joined(found.get(recording, ())), _joined(true.get(recording, ()))
        common = sum(max(0.0, min(x[1], y[1]) - max(x[0], y[0])) for x in a for y in b)
        both += common
        either += sum(x[1] - x[0] for x in (*a, *b)) - common
    return both / either if either > 0.0 else 1.0


def _joined(intervals: Sequence[Sequence[float]]) -> list[tuple[float, float]]:
    """Intervals in order, those that overlap joined."""
    made: list[tuple[float, float]] = []
    for start, end in sorted((float(s[0]), float(s[1])) for s in intervals):
        if made and start <= made[-1][1]:
            made[-1] = (made[-1][0], max(end, made[-1][1]))
        else:
            made.append((start, end))
    return made


# --- names -----------------------------------------------------------------------------------------------------------


def _right(names: Sequence[str], effect: EffectKey) -> bool:
    return any(n in effect.accept for n in names)


def _accepts(key: Key, name: str) -> bool:
    return any(name in e.accept for e in key.effects)


def _targets(key: Key) -> tuple[EffectKey, ...]:
    """Effects that may stand first: either of a pair, otherwise the main one."""
    return key.effects if key.family == "pair" else key.effects[:1]


def _is_tie(finding: Json, effect: EffectKey) -> bool:
    """The right effect first, or a look-alike that the key allows, with the right one declared as an alternative."""
    first = effect_of(finding)
    return first in effect.accept or (first in effect.tie and _right(finding.get("ambiguous_with", ()), effect))


def _offered(finding: Json) -> list[str]:
    """Names that a finding offers, likeliest first, each once."""
    return list(
        dict.fromkeys([*(str(p["effect"]) for p in finding.get("physics", ())), *finding.get("ambiguous_with", ())])
    )


def _named_right(findings: Sequence[Json], key: Key) -> dict[str, Any]:
    targets, first = _targets(key), findings[:1]
    made: dict[str, Any] = {
        "top1": any(_right([effect_of(f)], e) for f in first for e in targets),
        "tie": any(_is_tie(f, e) for f in first for e in targets),
        "top3": any(_right(_offered(f)[:3], e) for f in first for e in targets),
    }
    if key.family == "pair":
        made["both"] = all(any(_right([effect_of(f)], e) for f in findings) for e in key.effects)
        made["each_decided"] = key.each_decided
    return made


def _claims_library(diagnosed: Json, findings: Sequence[Json], key: Key) -> bool:
    """Whether a name of the library is given as the answer where "unknown", or a doubt, is all that can be said."""
    if diagnosed["verdict"] != "mismatch" or not findings:
        return False
    first, alternatives = effect_of(findings[0]), findings[0].get("ambiguous_with", ())
    return first != "unknown" and not _accepts(key, first) and "unknown" not in alternatives


# --- place -----------------------------------------------------------------------------------------------------------


def _matching(findings: Sequence[Json], effect: EffectKey) -> Json | None:
    """The finding that names an effect, or else the first."""
    return next((f for f in findings if _right([effect_of(f)], effect)), findings[0] if findings else None)


def _located(findings: Sequence[Json], key: Key, spans: Spans) -> dict[str, Any]:
    """Kind, responses and intervals of the largest effect."""
    effect = key.effects[0]
    finding = _matching(findings, effect)
    made: dict[str, Any] = {"kind": False, "axis": False, "axes": 0.0}
    if effect.intervals is not None:
        made["iou"] = 0.0
    if finding is None:
        return made
    axes, true = list(finding["axes"]), set(effect.axes)
    made |= {
        "kind": finding["kind"] in effect.kinds,
        "axis": bool(axes) and axes[0] in true,
        "axes": len(true & set(axes)) / len(true | set(axes)),
    }
    if effect.intervals is not None:
        everywhere = {recording: [ends] for recording, ends in spans.items()}
        made["iou"] = overlap(finding.get("where", {}).get("intervals") or everywhere, effect.intervals)
    return made


# --- size ------------------------------------------------------------------------------------------------------------


def _errors(finding: Json, which: str) -> dict[str, float]:
    """Relative rms error of each response on held-out flights."""
    fields = finding.get("fit", {}).get("held_out", {}).get(which, {})
    return {c: float(f["rrmse"]) for c, f in fields.items() if f.get("rrmse") is not None}


def _gain(findings: Sequence[Json], key: Key) -> float | None:
    """Fall of the held-out error over the fall that can be had, summed over the responses in which the error can fall.

    The fit of each finding counts those before it, so that the last one's is of everything found. A response without
    a stated fit has not been improved.
    """
    shown = {c for e in key.effects for c in e.axes}
    worth = {c: a for c, a in key.attainable.items() if a >= _WORTH and c in shown}
    if not worth:
        return None
    if not findings:
        return 0.0
    before, after = _errors(findings[-1], "before"), _errors(findings[-1], "after")
    fallen = sum(1.0 - after[c] / before[c] for c in worth if c in after and before.get(c, 0.0) > 0.0)
    return fallen / sum(worth.values())


def _beyond(findings: Sequence[Json]) -> float | None:
    """Fall of the error of the findings' responses, all that was named against a refit alone."""
    refitted, after = _errors(findings[-1], "refitted"), _errors(findings[-1], "after")
    axes = {c for f in findings for c in f["axes"]} & set(refitted) & set(after)
    if not axes:
        return None
    left = math.sqrt(sum(refitted[c] ** 2 for c in axes))
    return 1.0 - math.sqrt(sum(after[c] ** 2 for c in axes)) / left if left > 0.0 else None


def _sizes(findings: Sequence[Json], key: Key) -> list[Sized]:
    """Parameters of the correctly named effects that correspond to injected values."""
    made = []
    for effect in key.effects:
        finding = next((f for f in findings if effect_of(f) == effect.effect), None)
        if finding is None:
            continue
        found = finding["physics"][0].get("parameters", {})
        for name, size in sizes_put_in(effect).items():
            if name not in found or size == 0.0 or found[name].get("value") is None:
                continue
            off, std = abs(float(found[name]["value"])) - size, found[name].get("std")
            inside = None if not std else abs(off) <= _NINETY * float(std)
            made.append(Sized(effect.effect, name, abs(off) / size, inside))
    return made
