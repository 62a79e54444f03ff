"""Text report of a diagnosis: the findings, their evidence, their gain, and what remains open."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

from structsel.comparison.responses import KINEMATIC
from structsel.diagnosis.held_out_result import STAGES
from structsel.diagnosis.result import LISTED, UNNAMED, Diagnosis, EffectFinding, Physics, ToleranceDeviation
from structsel.effects.base import ParameterEstimate
from structsel.formatting import (
    count_of,
    display_unit,
    format_estimate,
    format_number,
    format_percent,
    format_probabilities,
    format_probability,
    format_range,
    join_names,
)
from structsel.nomenclature import COEFFICIENTS

WIDTH = 80
_and = partial(join_names, maximum=None)
LARGE_DEVIATION = 2.0
"""Standard deviations from which the deviation of a parameter is large."""
_LABEL = 12  # width of a label
_INTERVALS, _ALTERNATIVES, _DEVIATIONS, _UNTESTED, _REMARKS, _RESPONSES = 4, 3, 4, 3, 3, 3
_LEAST_DEVIATION = 1.0
_REST = "another effect, or none"
_SMALL = 0.05  # fraction of the rms of a response, below which a detectable effect is small
_TIED = "\N{NO-BREAK SPACE}"
_FORMS = {
    "model": "a model",
    "forced": "responses at the recorded states",
    "free": "flights of its own",
    "jsbsim": "an aircraft of JSBSim",
    "python": "a function",
}


def text_report(diagnosis: Diagnosis) -> str:
    """Text of a diagnosis that fits on a screen.

    Parameters
    ----------
    diagnosis : Diagnosis

    Returns
    -------
    str
        Lines of at most 80 columns. Angles are in degrees. Errors are relative to the rms of the measured response, on
        held-out flights.
    """
    lines = [*_wrap(headline(diagnosis)), *_wrap(about(diagnosis))]
    if diagnosis.verdict == "undecidable":
        lines += [line for remark in diagnosis.remarks for line in _wrap(remark, "- ", "  ")]
    for number, finding in enumerate(shown_findings(diagnosis), 1):
        lines += ["", *_tell_finding(number, finding)]
    return "\n".join([*lines, "", *_tell_rest(diagnosis)])


def headline(diagnosis: Diagnosis) -> str:
    """One sentence: the verdict and the effects."""
    random = [f.effect for f in diagnosis.findings if f.kind == "random"]
    named = [f for f in diagnosis.findings if f.kind != "random"]
    known = [_with_initial_heading(f) for f in named if f.effect != UNNAMED]
    also = f" There was also {_and(random)}." if random else ""
    if diagnosis.verdict == "consistent":
        small = f" Most probable: {_and(known)}." if known else ""
        return f"CONSISTENT{_within(diagnosis.deviations)}.{small}{also}"
    if diagnosis.verdict == "undecidable":
        hint = f" Most probable: {_and(known)}." if known else ""
        return f"UNDECIDABLE: these recordings do not show whether the simulation leaves anything out.{hint}{also}"
    if not known:
        return f"MISMATCH: the simulation leaves out something that no effect in the library explains.{also}"
    more = " Something else is missing that no effect in the library explains." if len(known) < len(named) else ""
    return f"MISMATCH: the simulation leaves out {_and(known)}.{more}{also}"


def _within(deviations: Sequence[ToleranceDeviation]) -> str:
    """Whether recordings and simulation agree within the stated tolerances."""
    beyond = next((p for p in deviations if p.is_exceeded), None)
    if beyond is None:
        return ": recordings and simulation agree within the stated tolerances"
    off = f"'{beyond.name}' deviates by {beyond.deviations:+.1f} stated standard deviations"
    return f", but not within the stated tolerances: no effect is probable, but {off}"


def about(diagnosis: Diagnosis) -> str:
    """One sentence: the recordings, the form of the simulation, and the validation."""
    count = len(diagnosis.recordings)
    form = _FORMS.get(diagnosis.form, diagnosis.form)
    if diagnosis.held_out:
        validation = f"validated by {_and(diagnosis.held_out)}, held out"
    elif count > 1:
        validation = "each is predicted from the others"
    else:
        validation = "no other recording validates the result"
    return f"{count} recording{'s' * (count != 1)}, the simulation given as {form}; {validation}."


def no_model(diagnosis: Diagnosis) -> str:
    """Reason why there is no model; empty if there is one."""
    if diagnosis.model is not None:
        return ""
    if other := [c for c in diagnosis.responses if c not in COEFFICIENTS and c not in KINEMATIC]:
        return f"a model has aerodynamic coefficients as responses, and {_and(other[:3])} is none"
    if not diagnosis.findings:
        return "there is no effect to add, and the simulation was not given as a model"
    return "the simulation with the effects could not be written as terms of a model"


def deviation_text(one: ToleranceDeviation) -> str:
    """Deviation of a parameter in stated standard deviations and in its unit."""
    factor, unit = display_unit(one.unit)
    value = f"{format_number(factor * one.value, 2, signed=True)} {unit}".strip()
    return f"{one.name} {one.deviations:+z.1f} sigma ({value})"


def is_shown(finding: EffectFinding) -> bool:
    """Whether a finding has a section: a random effect that explains 0 % has none."""
    return finding.kind != "random" or not math.isfinite(finding.fraction) or round(100.0 * finding.fraction) > 0


def shown_findings(diagnosis: Diagnosis) -> list[EffectFinding]:
    """Findings that have a section, see `is_shown`."""
    return [f for f in diagnosis.findings if is_shown(f)]


def together(finding: EffectFinding) -> float:
    """Probability of the first effect and of those that are ambiguous with it, the sum of the printed numbers."""
    return min(sum(round(100.0 * p.probability) for p in _group(finding)) / 100.0, 1.0)


def _group(finding: EffectFinding) -> list[Physics]:
    group = {finding.effect, *finding.ambiguous_with}
    return [p for p in finding.physics if p.effect in group]


def tied(finding: EffectFinding) -> list[str]:
    """Effects that are ambiguous with the first, in words."""
    return ["something unknown" if e == UNNAMED else e for e in finding.ambiguous_with]


def _with_initial_heading(finding: EffectFinding) -> str:
    if not finding.ambiguous_with:
        return f"{finding.effect} ({format_probability(finding.physics[0].probability)})"
    return f"{_and([finding.effect, *tied(finding)], last='or')} (together {format_probability(together(finding))})"


def _tell_finding(number: int, finding: EffectFinding) -> Iterator[str]:
    first, *others = finding.physics
    kind = f", {finding.kind}" if finding.kind != finding.effect else ""
    fraction = f"; {format_percent(finding.fraction)} of all explained" if finding.fraction > 0.0 else ""
    head = f"{finding.effect}: {format_probability(first.probability)}{kind}, in {_and(finding.axes)}{fraction}"
    yield from _wrap(head, f"{number}. ", "   ")
    yield from _wrap(first.says, "   ", "   ")
    yield from _labelled("where", _places(finding, _INTERVALS if number == 1 else _INTERVALS // 2))
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
        said = f"{others_too} explains as much (together {format_probability(together(finding))}{remaining})"
        yield from _labelled("tie", said)
    else:
        alternatives = [p for p in others if p.probability > LISTED][:_ALTERNATIVES]
        shown, rest = format_probabilities([p.probability for p in (first, *alternatives)])
        named = [f"{p.effect} {text}" for p, text in zip(alternatives, shown[1:])]
        yield from _labelled("or", ", ".join([*named, f"{_REST} {rest}"] if rest and number == 1 else named))
    yield from _labelled("to separate" if finding.ambiguous_with else "to be sure", finding.to_separate)
    if number == 1:
        yield from _labelled("look at", first.check)


def _values(parameters: Mapping[str, ParameterEstimate]) -> str:
    return ", ".join(f"{name} {format_estimate(e.value, e.std, e.unit)}" for name, e in parameters.items())


def ranges_and_events(finding: EffectFinding) -> list[str]:
    """Ranges of channels in which a finding acts, and its events, in words."""
    ranges = [format_range(channel, limits) for channel, limits in finding.region.items()]
    return [*ranges, *(f"{one.recording} {one.says}" for one in finding.events)]


def _places(finding: EffectFinding, maximum: int) -> str:
    """Ranges of channels, times of events and intervals of time; the longest intervals if there are too many."""
    parts = ranges_and_events(finding)
    intervals = [(name, a, b) for name, each in finding.intervals.items() for a, b in each]
    longest = sorted(intervals, key=lambda s: s[1] - s[2])[:maximum]
    shown: dict[str, list[str]] = {}
    for name, a, b in sorted(longest):
        shown.setdefault(name, []).append(f"{a:.1f}-{b:.1f}")
    if shown:
        text = [f"{name} {_and(each)} s" for name, each in shown.items()]
        left = len(intervals) - len(longest)
        parts.append(", ".join(text) + (f", and {left} more" if left else ""))
    return "; ".join(parts) or "in all recorded conditions, all the time"


def _errors(number: int, finding: EffectFinding) -> Iterator[str]:
    """Errors at the three stages: one line per response for the first finding, the clearest response for the others."""
    shown = [c for c in finding.axes if c in finding.bars][:_RESPONSES]
    if not shown:
        return
    if number > 1:
        b = finding.bars[shown[0]]
        text = f"{b.delivered.rrmse:.3f} as given, {b.refitted.rrmse:.3f} retuned, {b.physics.rrmse:.3f}"
        yield from _labelled("rms error", f"{shown[0]} {text} with findings 1-{number}")
        return
    wide, stages = max(map(len, shown)), stages_of(finding, number)
    names = dict(zip(STAGES, ("as given", "retuned", "with it")))
    head = "  ".join(f"{names[stage]:>8}" for stage in stages)
    yield from _labelled("rms error", f"{'':{wide}}  {head}   of measured", plain=True)
    for c in shown:
        row = "  ".join(f"{getattr(finding.bars[c], stage).rrmse:8.3f}" for stage in stages)
        yield from _labelled("", f"{c:{wide}}  {row}", plain=True)


def stages_of(finding: EffectFinding, number: int) -> tuple[str, ...]:
    """Stages at which errors are shown: none with effects where nothing was added to the simulation."""
    return STAGES if finding.is_fitted or number > 1 else STAGES[:2]


def _explains(finding: EffectFinding) -> str:
    if not math.isfinite(finding.explained) or not finding.is_fitted:
        return ""
    text = f"{format_percent(finding.explained)} of the mismatch in {_and(finding.axes[:_RESPONSES])}"
    regression = f"; a regression on all channels {format_percent(finding.explainable)}"
    return text + regression * math.isfinite(finding.explainable)


def _tell_rest(diagnosis: Diagnosis) -> Iterator[str]:
    left = [
        _TIED.join((c, f"{rrmse:.3f}", "white" if white else "coloured"))
        for c, (rrmse, white) in diagnosis.remaining.items()
        if c not in KINEMATIC
    ]
    for finding in diagnosis.findings:
        if not is_shown(finding):
            yield from _labelled(finding.effect, finding.physics[0].says, indent="")
    yield from _labelled("windows", _in_windows(diagnosis), indent="")
    yield from _labelled("remaining", ", ".join(left), indent="")
    deviations = [p for p in diagnosis.deviations if abs(p.deviations) >= _LEAST_DEVIATION][:_DEVIATIONS]
    yield from _labelled(
        "deviations", ", ".join(map(deviation_text, deviations)) or "no tolerance beyond one sigma", indent=""
    )
    yield from _labelled("not tested", _untested(diagnosis), indent="")
    yield from _labelled("self-test", _self_test(diagnosis), indent="")
    remarks = diagnosis.remarks if diagnosis.verdict != "undecidable" else ()
    for remark in remarks[:_REMARKS]:
        yield from _labelled("note", remark, indent="")
    if len(remarks) > _REMARKS:
        yield from _labelled("", f"and {count_of(len(remarks) - _REMARKS, 'more note')}", indent="")
    if why := no_model(diagnosis):
        yield from _labelled("no model", f"{why}.", indent="")


def _in_windows(diagnosis: Diagnosis) -> str:
    """Errors in short windows of the channel that improves most, or without effects has the largest error."""
    row = diagnosis.replayed.shown if diagnosis.replayed else None
    if row is None or diagnosis.replayed is None:
        return ""
    factor, unit = display_unit(row.unit)
    names = ("as given", "retuned", "with it" if len(diagnosis.findings) == 1 else "with all")
    rms = [format_number(factor * near.rms, 2) for near in row.stages.values()]
    text = ", ".join([f"{rms[0]} {unit} rms {names[0]}", *(f"{x} {name}" for x, name in zip(rms[1:], names[1:]))])
    inside = ", ".join(f"{100.0 * near.inside:.0f}" for near in row.stages.values())
    windows = f"{diagnosis.replayed.windows} windows of {diagnosis.replayed.seconds:.1f} s"
    return f"{row.channel}: {text}; {inside} % within +-{format_number(factor * row.band, 2)} {unit} ({windows})"


def untested(diagnosis: Diagnosis) -> dict[str, list[str]]:
    """Effects that could not be tested, by what they need; the most frequent need first."""
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
    hardest = sorted((e for e in sizes if sizes[e] > _SMALL), key=lambda e: -sizes[e])[:_ALTERNATIVES]
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
