"""Reconstructed flight paths as a page: what is wrong with each instrument, and how far to trust the rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from structsel.formatting import (
    count_of,
    display_unit,
    format_decimals,
    format_estimate,
    format_in_unit,
    format_number,
    join_names,
)
from structsel.nomenclature import unit_of
from structsel.reconstruction import CONSTANTS, Reconstruction, Reconstructions
from structsel.report.chart_data import ChartFlight, chart_data, moving
from structsel.report.page_model import (
    PageTable,
    Remark,
    Section,
    Sheet,
    columns,
    conversions,
    list_sources,
    merge_remarks,
)

_INPUTS = ("de", "da", "dr", "df", "throttle", "thrust", "qbar", "mach")
_FOUND = 4.0  # standard deviations beyond which a constant is clearly found
_TOLD = 3  # of these in the headline
_WIND = ("wn", "we", "wd")  # no instrument's error
_FEW = 3  # manoeuvres whose tables are not folded away
_METHODS = {
    "unscented": "an unscented Kalman filter and smoother",
    "extended": "an extended Kalman filter and smoother",
    "output-error": "output error, inertial readings taken as free of noise",
}
_LEGEND = (
    "A bias is what the instrument reads too much. ±: one standard deviation, with allowance for coloured residuals. "
    "Residual: rms of measured less reconstructed. Variance and next: of the normalised innovations, their variance "
    "(1 is right) and the correlation of neighbours (0 is right). NIS: normalised innovation squared per reading "
    "(1 is right). Rejected: readings outside the gate, not used. Angles are in degrees."
)


def sheet_of(found: Reconstructions) -> Sheet:
    """The page of one manoeuvre or of several."""
    trusted = [one for one in found if one.trusted]
    doubts = merge_remarks((one.name, text) for one in found for text in one.doubts)
    notes = merge_remarks(
        [
            *((one.name, f"{name} was not estimated: {why}") for one in found for name, why in one.fixed.items()),
            *((one.name, str(f).removeprefix("note: ")) for one in found for f in one.findings),
        ]
    )
    count = len(found) + len(found.failed)
    verdict, tone = ("trusted", "good") if len(trusted) == count else ("not trusted", "bad")
    if trusted and len(trusted) < count:
        verdict, tone = f"{len(trusted)} of {count} trusted", "doubt"
    headline, told = _headline(found, trusted)
    several = [] if count == 1 else [_overview(found), *_constants(trusted)]
    return Sheet(
        verdict=verdict,
        tone=tone,  # type: ignore[arg-type]
        headline=headline,
        lead=(told,),
        about=_about(found),
        reasons=tuple(f"{r.about}: {r.text}" for r in _reasons(found)),
        sections=(*several, *(_section(one, folded=len(found) > _FEW) for one in found)),
        doubts=doubts,
        notes=notes,
        done=_done(found),
        sources=list_sources(found.recordings),
        history=conversions(found.recordings),
        data=_figures(found),
        legend=_LEGEND,
    )


def _headline(found: Reconstructions, trusted: Sequence[Reconstruction]) -> tuple[str, str]:
    count = len(found) + len(found.failed)
    if count == 1:
        first = f"The flight path of {join_names(one.name for one in found)} can{'' if trusted else 'not'} be trusted."
    elif len(trusted) == count:
        first = f"All {count} manoeuvres can be trusted."
    else:
        not_these = [one.name for one in found if not one.trusted]
        told = (
            [f"{join_names(not_these)} contradict{'s itself' if len(not_these) == 1 else ' themselves'}"]
            if not_these
            else []
        )
        told += [f"{join_names(found.failed)} could not be reconstructed"] if found.failed else []
        first = f"{len(trusted)} of {count} manoeuvres can be trusted: {join_names(told)}."
    clear = _clearest(trusted or list(found))
    if not clear:
        return first, f"No error of an instrument stands out{' in all of them alike' * (len(found) > 1)}."
    return first, f"The clearest errors of instruments: {join_names(clear)}."


def _clearest(results: Sequence[Reconstruction]) -> list[str]:
    """Constants furthest from zero in their standard deviations, over the manoeuvres that have them."""
    ranked = []
    for name, values, stds in _by_name(results):
        # What differs from manoeuvre to manoeuvre more than its std is no surer for having been found often.
        each = float(np.sqrt(np.mean(stds**2)))
        scatter = float(values.std(ddof=1)) if len(values) > 1 else 0.0
        std = max(each, scatter) / math.sqrt(len(values))
        value = float(values.mean())
        if name not in _WIND and std > 0.0 and abs(value) > _FOUND * std:
            ranked.append(
                (abs(value) / std, f"{CONSTANTS[name][0]} {format_estimate(value, std, CONSTANTS[name][1], '±')}")
            )
    return [text for _, text in sorted(ranked, reverse=True)[:_TOLD]]


def _by_name(results: Sequence[Reconstruction]) -> list[tuple[str, np.ndarray, np.ndarray]]:
    made = []
    for name in CONSTANTS:
        mine = [c for one in results for c in one.constants if c.name == name]
        if mine:
            made.append((name, np.array([c.value for c in mine]), np.array([c.std for c in mine])))
    return made


def _about(found: Reconstructions) -> str:
    flown = found.recordings
    seconds = sum(r.duration for r in flown)
    return f"{count_of(len(flown), 'manoeuvre')}, {sum(map(len, flown))} samples, {format_number(seconds)} s in all."


def _reasons(found: Reconstructions) -> tuple[Remark, ...]:
    said = [(one.name, text) for one in found for text in one.distrust]
    return merge_remarks([*said, *((name, f"not reconstructed: {why}") for name, why in found.failed.items())])


def _overview(found: Reconstructions) -> Section:
    rows = []
    for one in found:
        low, high = one.consistency.nis_band
        gust = " ".join(format_number(std, 2) for std in one.gust) if any(one.gust) else "none"
        mine = (f"{one.recording.duration:.1f}", str(len(one.recording)), format_decimals(one.consistency.nis, 3))
        band = f"{format_decimals(low, 3)} to {format_decimals(high, 3)}"
        rows.append((one.name, *mine, band, gust, "trusted" if one.trusted else "NOT TRUSTED"))
    rows += [(name, "-", "-", "-", "-", "-", "not reconstructed") for name in found.failed]
    heads = columns(
        manoeuvre="name", s="number", samples="number", NIS="number", **{"95 % band": "word"},
        **{"turbulence x y z, m/s": "word"}, verdict="word",
    )  # fmt: skip
    return Section("All manoeuvres", tables=(PageTable(heads, tuple(rows)),))


def _constants(trusted: Sequence[Reconstruction]) -> list[Section]:
    rows = []
    for name, values, stds in _by_name(trusted):
        meaning, unit = CONSTANTS[name]
        scatter = format_in_unit(float(values.std(ddof=1)), unit, 2) if len(values) > 1 else "-"
        rows.append((name, str(len(values)), format_in_unit(float(values.mean()), unit), scatter,
                     format_in_unit(float(stds.mean()), unit, 2), meaning))  # fmt: skip
    if not rows or len(trusted) < 2:
        return []
    heads = columns(constant="name", manoeuvres="number", mean="number", scatter="number", mean_std="number",
                    meaning="text")  # fmt: skip
    note = "One that scatters far beyond its standard deviation is not constant."
    return [Section("Constants of the trusted manoeuvres", tables=(PageTable(heads, tuple(rows), "", note),))]


def _section(one: Reconstruction, *, folded: bool) -> Section:
    tables = []
    if one.constants:
        errors = tuple(
            (c.name, format_estimate(c.value, c.std, c.unit, "±"), CONSTANTS[c.name][0]) for c in one.constants
        )
        tables.append(
            PageTable(columns(constant="name", value="number", meaning="text"), errors, "Errors of the instruments")
        )
    tables.append(_channels(one))
    late = [d for d in one.delays if d.significant]
    if late:
        delays = tuple((d.channel, format_estimate(1e3 * d.delay, 1e3 * d.std, "ms", "±")) for d in late)
        tables.append(PageTable(columns(channel="name", late_by="number"), delays, "Delays"))
    low, high = one.consistency.nis_band
    text = [f"NIS {format_decimals(one.consistency.nis, 3)}; expected {low:.3f} to {high:.3f}."]
    if any(one.gust):
        each = ", ".join(format_number(std, 2) for std in one.gust)
        text.append(
            f"Turbulence allowed for: {each} m/s along x, y and z, dying away in {format_number(one.gust_time, 2)} s."
        )
    chips = ("trusted" if one.trusted else "NOT TRUSTED", f"{one.recording.duration:.1f} s")
    return Section(one.name, chips, (), tuple(text), tuple(tables), (), folded)


def _channels(one: Reconstruction) -> PageTable:
    seen = {c.channel: c for c in one.consistency.channels}
    rows = []
    for level in sorted(one.noise, key=lambda level: level.channel not in seen):
        row = (level.channel, format_in_unit(level.std, level.unit), level.source)
        if (c := seen.get(level.channel)) is None:
            rows.append((*row, "", "", "", ""))
            continue
        next_one = float(c.autocorrelation[0]) if len(c.autocorrelation) else math.nan
        follows = f"{next_one:+.2f}" if math.isfinite(next_one) else "-"
        rows.append(
            (*row, format_in_unit(c.residual_rms, level.unit), format_decimals(c.variance, 2), follows, str(c.rejected))
        )
    heads = columns(channel="name", noise="number", source="word", residual="number", variance="number", next="number",
                    rejected="number")  # fmt: skip
    return PageTable(heads, tuple(rows), "Channels")


def _done(found: Reconstructions) -> tuple[str, ...]:
    said = []
    for method in dict.fromkeys(one.method for one in found):
        mine = [one for one in found if one.method == method]
        states = list(dict.fromkeys(name for one in mine for name in one.states))
        said.append(f"Flight paths by {_METHODS[method]}. Estimated: {join_names(states, 40)}.")
    return tuple(said)


def _figures(found: Reconstructions) -> dict[str, Any]:
    results = list(found)
    held: list[dict[str, Any]] = [dict(one.recording.channels) for one in results]
    every = dict.fromkeys(c for one in results for c in (s.channel for s in one.consistency.channels))
    channels = [c for c in (*_INPUTS, *every) if moving(c, held)]
    flights = {}
    for one in results:
        measured = [s.channel for s in one.consistency.channels if s.channel in one.readings]
        each = {}
        for c in measured:
            surprise = one.innovations[c] / one.innovation_std[c]
            each[c] = {"measured": one.readings[c] + one.residuals[c], "physics": one.readings[c], "surprise": surprise}
        flights[one.name] = ChartFlight(one.recording.t, each, {c: one.recording[c] for c in channels})
    own = results[0].recording.units if results else {}
    names = {*channels, *(r for one in flights.values() for r in one.responses)}
    units = {name: display_unit(unit_of(name, own)) for name in names}
    stages = {"physics": "reconstructed"}
    return chart_data(flights, stages, units, verb="reconstructed", surprise="Normalised innovation")
