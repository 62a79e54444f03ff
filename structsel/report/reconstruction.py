"""Page of reconstructed flight paths: errors of the instruments, and consistency of the filter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from structsel.formatting import (
    count_of,
    display_unit,
    format_estimate,
    format_in_unit,
    format_number,
    join_names,
)
from structsel.nomenclature import unit_of
from structsel.reconstruction import CONSTANTS, Reconstruction, Reconstructions
from structsel.report.chart_data import ChartFlight, chart_data, is_varying
from structsel.report.page_model import Note, Page, Section, Status, list_history, list_sources, merge_notes
from structsel.tables import Column, Table, text_column

_INPUTS = ("de", "da", "dr", "df", "throttle", "thrust", "qbar", "mach")
_SIGNIFICANT = 4.0  # standard deviations beyond which a constant is in the headline
_MAX_NAMED = 3  # constants in the headline
_WIND = ("wn", "we", "wd")  # not an error of an instrument
_MAX_UNFOLDED = 3  # manoeuvres whose tables are shown at once
_METHODS = {
    "unscented": "an unscented Kalman filter and smoother",
    "extended": "an extended Kalman filter and smoother",
    "output-error": "output error, inertial sensors assumed free of noise",
}
_LEGEND = (
    "Bias: measured minus true value. ±: one standard deviation, with allowance for coloured residuals. Residual: rms "
    "of measured minus reconstructed. Variance and correlation: of the normalised innovations; expected are 1, and 0 "
    "between neighbouring samples. NIS: normalised innovation squared; 1 is expected. Rejected: samples outside the "
    "gate, which were not used. Angles are in degrees."
)


def page_of(found: Reconstructions) -> Page:
    """Page of one manoeuvre or of several."""
    trusted = [one for one in found if one.trusted]
    warnings = merge_notes((one.name, text) for one in found for text in one.doubts)
    notes = merge_notes(
        [
            *((one.name, f"{name} was not estimated: {why}") for one in found for name, why in one.fixed.items()),
            *((one.name, str(f).removeprefix("note: ")) for one in found for f in one.findings),
        ]
    )
    count = len(found) + len(found.failed)
    verdict, status = _verdict(len(trusted), count)
    headline, summary = _headline(found, trusted)
    several = [] if count == 1 else [Section("All manoeuvres", tables=found.summary().tables[:1]), *_constants(trusted)]
    return Page(
        verdict=verdict,
        status=status,
        headline=headline,
        summary=(summary,),
        about=_about(found),
        reasons=tuple(f"{r.subject}: {r.text}" for r in _reasons(found)),
        sections=(*several, *(_section(one, folded=len(found) > _MAX_UNFOLDED) for one in found)),
        warnings=warnings,
        notes=notes,
        method=_method(found),
        sources=list_sources(found.recordings),
        history=list_history(found.recordings),
        data=_figures(found),
        legend=_LEGEND,
    )


def _verdict(trusted: int, count: int) -> tuple[str, Status]:
    if trusted == count:
        return "trusted", "good"
    return (f"{trusted} of {count} trusted", "warning") if trusted else ("not trusted", "bad")


def _headline(found: Reconstructions, trusted: Sequence[Reconstruction]) -> tuple[str, str]:
    count = len(found) + len(found.failed)
    if count == 1:
        first = f"The flight path of {join_names(one.name for one in found)} can{'' if trusted else 'not'} be trusted."
    elif len(trusted) == count:
        first = f"All {count} manoeuvres can be trusted."
    else:
        others = [one.name for one in found if not one.trusted]
        reasons = [f"{join_names(others)} {'is' if len(others) == 1 else 'are'} inconsistent"] if others else []
        reasons += [f"{join_names(found.failed)} could not be reconstructed"] if found.failed else []
        first = f"{len(trusted)} of {count} manoeuvres can be trusted: {join_names(reasons)}."
    clear = _clearest(trusted or list(found))
    if not clear:
        return first, f"No error of an instrument is significant{' in the mean of all manoeuvres' * (len(found) > 1)}."
    return first, f"Most significant errors of the instruments: {join_names(clear)}."


def _clearest(results: Sequence[Reconstruction]) -> list[str]:
    """Constants whose mean differs from zero by the largest number of its standard deviations."""
    ranked = []
    for name, values, stds in _by_name(results):
        # Where estimates scatter by more than their standard deviations, the scatter gives the standard error.
        each = float(np.sqrt(np.mean(stds**2)))
        scatter = float(values.std(ddof=1)) if len(values) > 1 else 0.0
        std = max(each, scatter) / math.sqrt(len(values))
        value = float(values.mean())
        if name not in _WIND and std > 0.0 and abs(value) > _SIGNIFICANT * std:
            ranked.append(
                (abs(value) / std, f"{CONSTANTS[name][0]} {format_estimate(value, std, CONSTANTS[name][1], '±')}")
            )
    return [text for _, text in sorted(ranked, reverse=True)[:_MAX_NAMED]]


def _by_name(results: Sequence[Reconstruction]) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Values and standard deviations of each constant over the manoeuvres that estimated it."""
    found = []
    for name in CONSTANTS:
        mine = [c for one in results for c in one.constants if c.name == name]
        if mine:
            found.append((name, np.array([c.value for c in mine]), np.array([c.std for c in mine])))
    return found


def _about(found: Reconstructions) -> str:
    every = found.recordings
    seconds = format_number(sum(r.duration for r in every))
    return f"{count_of(len(every), 'manoeuvre')}, {sum(map(len, every))} samples, {seconds} s in total."


def _reasons(found: Reconstructions) -> tuple[Note, ...]:
    pairs = [(one.name, text) for one in found for text in one.distrust]
    return merge_notes([*pairs, *((name, f"not reconstructed: {why}") for name, why in found.failed.items())])


def _constants(trusted: Sequence[Reconstruction]) -> list[Section]:
    rows = []
    for name, values, stds in _by_name(trusted):
        meaning, unit = CONSTANTS[name]
        scatter = format_in_unit(float(values.std(ddof=1)), unit, 2) if len(values) > 1 else "-"
        rows.append((name, str(len(values)), format_in_unit(float(values.mean()), unit), scatter,
                     format_in_unit(float(stds.mean()), unit, 2), meaning))  # fmt: skip
    if not rows or len(trusted) < 2:
        return []
    numbers = map(Column, ("manoeuvres", "mean", "scatter", "mean std"))
    note = "A constant that scatters by much more than its standard deviation is not constant."
    table = Table((text_column("constant"), *numbers, text_column("meaning", wrap=True)), tuple(rows), note=note)
    return [Section("Constants of the trusted manoeuvres", tables=(table,))]


def _section(one: Reconstruction, *, folded: bool) -> Section:
    tables = []
    if one.constants:
        rows = ((c.name, format_estimate(c.value, c.std, c.unit, "±"), CONSTANTS[c.name][0]) for c in one.constants)
        heads = (text_column("constant"), Column("value"), text_column("meaning", wrap=True))
        tables.append(Table(heads, tuple(rows), "Errors of the instruments"))
    tables.append(_channels(one))
    delayed = [d for d in one.delays if d.significant]
    if delayed:
        delays = tuple((d.channel, format_estimate(1e3 * d.delay, 1e3 * d.std, "ms", "±")) for d in delayed)
        tables.append(Table((text_column("channel"), Column("delay")), delays, "Delays"))
    facts = dict(one.summary().facts)
    text = [f"NIS {facts['NIS']}; 95 % band {facts['95 % band']}."]
    if "turbulence" in facts:
        text.append(f"Standard deviation of the turbulence: {facts['turbulence']}.")
    badges = (one.verdict, f"{one.recording.duration:.1f} s")
    return Section(one.name, badges, (), tuple(text), tuple(tables), (), folded)


def _channels(one: Reconstruction) -> Table:
    """Noise of every channel; residual and innovations of those that the filter was fitted to."""
    measured = {c.channel: c for c in one.consistency.channels}
    rows: list[tuple[Any, ...]] = []
    for level in sorted(one.noise, key=lambda level: level.channel not in measured):
        row = (level.channel, format_in_unit(level.std, level.unit), level.source)
        if (c := measured.get(level.channel)) is None:
            rows.append((*row, "", "", "", ""))
            continue
        correlation = float(c.autocorrelation[0]) if len(c.autocorrelation) else None
        rows.append((*row, format_in_unit(c.residual_rms, level.unit), c.variance, correlation, c.rejected))
    numbers = (Column("residual"), Column("variance", "2f"), Column("correlation", "2f"), Column("rejected"))
    return Table((text_column("channel"), Column("noise"), text_column("source"), *numbers), tuple(rows), "Channels")


def _method(found: Reconstructions) -> tuple[str, ...]:
    sentences = []
    for method in dict.fromkeys(one.method for one in found):
        mine = [one for one in found if one.method == method]
        states = list(dict.fromkeys(name for one in mine for name in one.states))
        sentences.append(f"Flight paths by {_METHODS[method]}. Estimated: {join_names(states, 40)}.")
    return tuple(sentences)


def _figures(found: Reconstructions) -> dict[str, Any]:
    results = list(found)
    channels_of: list[dict[str, Any]] = [dict(one.recording.channels) for one in results]
    every = dict.fromkeys(c for one in results for c in (s.channel for s in one.consistency.channels))
    channels = [c for c in (*_INPUTS, *every) if is_varying(c, channels_of)]
    flights = {}
    for one in results:
        measured = [s.channel for s in one.consistency.channels if s.channel in one.readings]
        each = {}
        for c in measured:
            innovation = one.innovations[c] / one.innovation_std[c]
            lines = {"measured": one.readings[c] + one.residuals[c], "physics": one.readings[c]}
            each[c] = {**lines, "innovation": innovation}
        flights[one.name] = ChartFlight(one.recording.t, each, {c: one.recording[c] for c in channels})
    own = results[0].recording.units if results else {}
    names = {*channels, *(r for one in flights.values() for r in one.responses)}
    units = {name: display_unit(unit_of(name, own)) for name in names}
    stages = {"physics": "reconstructed"}
    return chart_data(flights, stages, units, verb="reconstructed", innovation="Normalised innovation")
