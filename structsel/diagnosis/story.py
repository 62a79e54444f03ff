"""A diagnosis as an engineer would tell it: what was found, where, how sure, what it buys, what stays open."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

from structsel.diagnosis.result import LISTED, UNNAMED, Diagnosis, EffectFinding, Physics, Pull
from structsel.effects.base import ParameterEstimate
from structsel.formatting import (
    display_unit,
    format_estimate,
    format_number,
    format_probabilities,
    format_probability,
    format_range,
    join_names,
)
from structsel.nomenclature import COEFFICIENTS

WIDTH = 80
_and = partial(join_names, maximum=None)
HARD_PULL = 2.0
"""Standard deviations beyond which a tolerance was pulled hard."""
_LABEL = 11  # columns that a label stands in
_STRETCHES, _RIVALS, _PULLS, _UNTESTED, _REMARKS, _RESPONSES = 4, 3, 4, 3, 3, 3
_LEAST_PULL = 1.0
_REST = "another effect, or none"
_SMALL = 0.05  # share of a response's rms, at which an effect that would be named is a small one
_TIED = "\N{NO-BREAK SPACE}"
_FORMS = {
    "model": "a model",
    "forced": "its responses along them",
    "free": "its own flights",
    "jsbsim": "JSBSim's aircraft",
    "python": "a function",
}


def tell(diagnosis: Diagnosis) -> str:
    """Tell a diagnosis in plain words that fit on a screen.

    Parameters
    ----------
    diagnosis : Diagnosis

    Returns
    -------
    str
        Lines of at most 80 columns. Angles in degrees; errors are root mean squares over those of what was measured,
        on flights not used for fitting.
    """
    lines = [*_wrap(headline(diagnosis)), *_wrap(about(diagnosis))]
    if diagnosis.verdict == "undecidable":
        lines += [line for remark in diagnosis.remarks for line in _wrap(remark, "- ", "  ")]
    for number, finding in enumerate(shown_findings(diagnosis), 1):
        lines += ["", *_tell_finding(number, finding)]
    return "\n".join([*lines, "", *_tell_rest(diagnosis)])


def headline(diagnosis: Diagnosis) -> str:
    """One sentence: the verdict, and the effects named."""
    chance = [f.effect for f in diagnosis.findings if f.kind == "random"]
    named = [f for f in diagnosis.findings if f.kind != "random"]
    known = [_with_initial_heading(f) for f in named if f.effect != UNNAMED]
    also = f" There was {_and(chance)} besides." if chance else ""
    if diagnosis.verdict == "consistent":
        small = f" What stands out: {_and(known)}." if known else ""
        return f"CONSISTENT{_within(diagnosis.pulls)}.{small}{also}"
    if diagnosis.verdict == "undecidable":
        hint = f" What shows most: {_and(known)}." if known else ""
        return f"UNDECIDABLE: these recordings do not say whether the simulation leaves anything out.{hint}{also}"
    if not known:
        return f"MISMATCH: something is left out that none of the effects known explains.{also}"
    more = " Something else is missing that none of the effects known explains." if len(known) < len(named) else ""
    return f"MISMATCH: the simulation leaves out {_and(known)}.{more}{also}"


def _within(pulls: Sequence[Pull]) -> str:
    """Whether it is the stated tolerances that recordings and simulation agree within."""
    strained = next((p for p in pulls if p.is_strained), None)
    if strained is None:
        return ": recordings and simulation agree within the stated tolerances"
    off = f"'{strained.name}' is off by {strained.deviations:+.1f} of its stated standard deviations"
    return f", but beyond the stated tolerances: no effect is likely to be missing, yet they agree only if {off}"


def about(diagnosis: Diagnosis) -> str:
    """One sentence: what was compared, and which recordings judge."""
    count = len(diagnosis.recordings)
    form = _FORMS.get(diagnosis.form, diagnosis.form)
    if diagnosis.held_out:
        judges = f"{_and(diagnosis.held_out)} held out to judge"
    elif count > 1:
        judges = "each is judged by what the others say"
    else:
        judges = "a single one leaves none to judge by"
    return f"{count} recording{'s' * (count != 1)}, the simulation given as {form}; {judges}."


def no_model(diagnosis: Diagnosis) -> str:
    """Why there is no model; empty where there is one."""
    if diagnosis.model is not None:
        return ""
    if other := [c for c in diagnosis.responses if c not in COEFFICIENTS and not c.startswith("k_")]:
        return f"a model holds aerodynamic coefficients, and {_and(other[:3])} is none"
    if not diagnosis.findings:
        return "nothing was found to add, and the simulation was not given as one"
    return "the simulation with what was found could not be put as the terms of one"


def pull_text(pull: Pull) -> str:
    """How far a tolerance was pulled, in its standard deviations and in its unit."""
    factor, unit = display_unit(pull.unit)
    value = f"{format_number(factor * pull.value, 2, signed=True)} {unit}".strip()
    return f"{pull.name} {pull.deviations:+.1f} sigma ({value})"


def is_shown(finding: EffectFinding) -> bool:
    """Whether a finding has a section: a random effect that explains 0 % has none, no model could predict it."""
    return finding.kind != "random" or not math.isfinite(finding.share) or round(100.0 * finding.share) > 0


def shown_findings(diagnosis: Diagnosis) -> list[EffectFinding]:
    """Findings that have a section, see `is_shown`."""
    return [f for f in diagnosis.findings if is_shown(f)]


def together(finding: EffectFinding) -> float:
    """Probability of the first effect and of those that it cannot be told from, the sum of what is printed."""
    return min(sum(round(100.0 * p.probability) for p in _group(finding)) / 100.0, 1.0)


def _group(finding: EffectFinding) -> list[Physics]:
    group = {finding.effect, *finding.ambiguous_with}
    return [p for p in finding.physics if p.effect in group]


def tied(finding: EffectFinding) -> list[str]:
    """What would do as well as the first effect, in words."""
    return ["something unknown" if e == UNNAMED else e for e in finding.ambiguous_with]


def _with_initial_heading(finding: EffectFinding) -> str:
    if not finding.ambiguous_with:
        return f"{finding.effect} ({format_probability(finding.physics[0].probability)})"
    return f"{_and([finding.effect, *tied(finding)], last='or')} (together {format_probability(together(finding))})"


def _tell_finding(number: int, finding: EffectFinding) -> Iterator[str]:
    first, *others = finding.physics
    share = f"; {100.0 * finding.share:.0f} % of all explained" if finding.share > 0.0 else ""
    head = f"{finding.effect}: {format_probability(first.probability)}, {finding.kind}, in {_and(finding.axes)}{share}"
    yield from _wrap(head, f"{number}. ", "   ")
    yield from _wrap(first.says, "   ", "   ")
    yield from _labelled("where", _places(finding, _STRETCHES if number == 1 else _STRETCHES // 2))
    if number == 1:  # of the others the sentence gives them
        yield from _labelled("values", _values(first.parameters))
    yield from _labelled("but", first.plausible)
    yield from _errors(number, finding)
    if number == 1:
        yield from _labelled("explains", _explains(finding))
    if finding.ambiguous_with:
        others_too = _and(tied(finding), last="or")
        rest = format_probabilities([p.probability for p in _group(finding)])[1]
        remaining = f", {'neither' if len(_group(finding)) == 2 else 'none'} {rest}" if rest else ""
        said = f"{others_too} would do as well (together {format_probability(together(finding))}{remaining})"
        yield from _labelled("tie", said)
    else:
        alternatives = [p for p in others if p.probability > LISTED][:_RIVALS]
        shown, rest = format_probabilities([p.probability for p in (first, *alternatives)])
        named = [f"{p.effect} {text}" for p, text in zip(alternatives, shown[1:])]
        yield from _labelled("or", ", ".join([*named, f"{_REST} {rest}"] if rest and number == 1 else named))
    yield from _labelled("to tell" if finding.ambiguous_with else "to be sure", finding.to_separate)
    if number == 1:
        yield from _labelled("look at", first.check)


def _values(parameters: Mapping[str, ParameterEstimate]) -> str:
    return ", ".join(f"{name} {format_estimate(e.value, e.std, e.unit)}" for name, e in parameters.items())


def _places(finding: EffectFinding, most: int) -> str:
    """Region and stretches of time; the longest where there are too many."""
    parts = [format_range(channel, limits) for channel, limits in finding.region.items()]
    stretches = [(name, a, b) for name, each in finding.intervals.items() for a, b in each]
    longest = sorted(stretches, key=lambda s: s[1] - s[2])[:most]
    shown: dict[str, list[str]] = {}
    for name, a, b in sorted(longest):
        shown.setdefault(name, []).append(f"{a:.1f}-{b:.1f}")
    if shown:
        text = [f"{name} {_and(each)} s" for name, each in shown.items()]
        left = len(stretches) - len(longest)
        parts.append(", ".join(text) + (f", and {left} more" if left else ""))
    return "; ".join(parts) or "everywhere flown, all the time"


def _errors(number: int, finding: EffectFinding) -> Iterator[str]:
    """Three bars as figures: one response a line for the first finding, the clearest for the others."""
    shown = [c for c in finding.axes if c in finding.bars][:_RESPONSES]
    if not shown:
        return
    if number > 1:
        b = finding.bars[shown[0]]
        text = f"{b.delivered.rrmse:.3f} as delivered, {b.refitted.rrmse:.3f} refitted, {b.physics.rrmse:.3f}"
        yield from _labelled("rms error", f"{shown[0]} {text} with 1-{number} together")
        return
    wide = max(map(len, shown))
    yield from _labelled("rms error", f"{'':{wide}}  as delivered  refitted   with it   of measured", plain=True)
    for c in shown:
        b = finding.bars[c]
        row = f"{c:{wide}}  {b.delivered.rrmse:12.3f}  {b.refitted.rrmse:8.3f}  {b.physics.rrmse:8.3f}"
        yield from _labelled("", row, plain=True)


def _explains(finding: EffectFinding) -> str:
    if not math.isfinite(finding.explained):
        return ""
    text = f"{100.0 * finding.explained:.0f} % of the mismatch in {_and(finding.axes[:_RESPONSES])}"
    most = f"; a free learner on all channels {100.0 * finding.explainable:.0f} %"
    return text + most * math.isfinite(finding.explainable)


def _tell_rest(diagnosis: Diagnosis) -> Iterator[str]:
    left = [
        _TIED.join((c, f"{rrmse:.3f}", "white" if white else "coloured"))
        for c, (rrmse, white) in diagnosis.remaining.items()
        if not c.startswith("k_")
    ]
    for finding in diagnosis.findings:
        if not is_shown(finding):
            yield from _labelled(finding.effect, finding.physics[0].says, indent="")
    yield from _labelled("re-flown", _flown_again(diagnosis), indent="")
    yield from _labelled("left", ", ".join(left), indent="")
    pulls = [p for p in diagnosis.pulls if abs(p.deviations) >= _LEAST_PULL][:_PULLS]
    yield from _labelled("pulled", ", ".join(map(pull_text, pulls)) or "no tolerance beyond one sigma", indent="")
    yield from _labelled("not tested", _untested(diagnosis), indent="")
    yield from _labelled("self-test", _self_test(diagnosis), indent="")
    remarks = diagnosis.remarks if diagnosis.verdict != "undecidable" else ()
    for remark in remarks[:_REMARKS]:
        yield from _labelled("note", remark, indent="")
    if len(remarks) > _REMARKS:
        yield from _labelled("", f"and {len(remarks) - _REMARKS} more notes", indent="")
    if why := no_model(diagnosis):
        yield from _labelled("no model", f"{why}.", indent="")


def _flown_again(diagnosis: Diagnosis) -> str:
    """How near the channel that gained most came in short windows."""
    row = diagnosis.replayed.gained if diagnosis.replayed else None
    if row is None or diagnosis.replayed is None:
        return ""
    factor, unit = display_unit(row.unit)
    names = ("as delivered", "refitted", "with it" if len(diagnosis.findings) == 1 else "with all")
    rms = [format_number(factor * near.rms, 2) for near in row.stages.values()]
    text = ", ".join([f"{rms[0]} {unit} rms {names[0]}", *(f"{x} {name}" for x, name in zip(rms[1:], names[1:]))])
    inside = ", ".join(f"{100.0 * near.inside:.0f}" for near in row.stages.values())
    windows = f"{diagnosis.replayed.windows} windows of {diagnosis.replayed.seconds:.1f} s"
    return f"{row.channel} off by {text}; {inside} % within +-{format_number(factor * row.band, 2)} {unit} ({windows})"


def untested(diagnosis: Diagnosis) -> dict[str, list[str]]:
    """Effects that could not be tested, by what they need; what bars most of them first."""
    made: dict[str, list[str]] = {}
    for effect, needs in diagnosis.not_testable.items():
        made.setdefault(needs, []).append(effect)
    return dict(sorted(made.items(), key=lambda item: -len(item[1])))


def _untested(diagnosis: Diagnosis) -> str:
    groups = untested(diagnosis)
    shown = [f"{', '.join(effects)} (needs {needs})" for needs, effects in list(groups.items())[:_UNTESTED]]
    more = sum(map(len, list(groups.values())[_UNTESTED:]))
    return "; ".join(shown) + (f"; and {more} more" if more else "")


def _self_test(diagnosis: Diagnosis) -> str:
    sizes = {e: d["size"] for e, d in diagnosis.detects.items() if "size" in d}
    if not sizes:
        return ""
    small = sum(size <= _SMALL for size in sizes.values())
    hardest = sorted((e for e in sizes if sizes[e] > _SMALL), key=lambda e: -sizes[e])[:_RIVALS]
    least = [f"{e} from {100.0 * sizes[e]:.0f} %" if math.isfinite(sizes[e]) else f"{e} not at all" for e in hardest]
    text = f"{small} of {len(sizes)} effects would be named here at {100.0 * _SMALL:.0f} % of a response's rms"
    return text + (f"; hardest {', '.join(least)}" if least else "")


def _wrap(text: str, first: str = "", then: str = "") -> list[str]:
    tied = re.sub(r"(?<=\d) (?=[%\w/^]{1,6}(?:[\s,;.)]|$))", _TIED, text)  # a number and its unit
    tied = tied.replace(" +- ", f"{_TIED}+-{_TIED}")
    lines = textwrap.wrap(tied, WIDTH, initial_indent=first, subsequent_indent=then, break_on_hyphens=False)
    return [line.replace(_TIED, " ") for line in lines]


def _labelled(label: str, text: str, *, indent: str = "   ", plain: bool = False) -> list[str]:
    """Lines behind a label; none without text."""
    if not text:
        return []
    head = f"{indent}{label:{_LABEL}}"
    return [head + text] if plain else _wrap(text, head, " " * len(head))
