"""Charts of a diagnosis: time histories, residuals over a channel, and windows of the re-simulation."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from structsel.diagnosis.held_out_result import ExampleWindows, HeldOutSimulation
from structsel.diagnosis.result import Diagnosis, EffectFinding, Trace
from structsel.diagnosis.text_report import shown_findings
from structsel.diagnosis.views import (
    STAGES,
    Binned,
    acting_range,
    bin_residuals,
    driving_channel,
    main_recording,
    moving_channels,
    shown_responses,
    shown_stages,
    simulated,
    unit_shown,
    worth_showing,
)
from structsel.formatting import display_unit, format_in_unit
from structsel.nomenclature import unit_of
from structsel.report.chart_data import ChartFlight, chart_data, pack_number, single_chart

STAGE_NAMES = dict(zip(STAGES, ("as given", "retuned", "with the effects")))


def figures_of(diagnosis: Diagnosis) -> dict[str, Any]:
    """Data of the charts, in display units; plain values that JSON holds."""
    responses, channels = shown_responses(diagnosis), moving_channels(diagnosis)
    stages = {stage: STAGE_NAMES[stage] for stage in shown_stages(diagnosis)}
    units = {name: display_unit(unit_shown(name)) for name in (*responses, *channels)}
    ranges = {c: _range(diagnosis, c) for c in channels}
    binned = {
        r: {c: _pack_bins(bin_residuals(diagnosis, r, c, ranges[c]), units[r][0], units[c][0]) for c in channels}
        for r in responses
    }
    flights = {name: _flight(one, responses, channels, stages) for name, one in diagnosis.traces.items()}
    replayed = diagnosis.replayed
    charts = [_windows_chart(replayed, replayed.example)] if replayed and replayed.example else []
    hidden = list(stages)[1:-1]
    data = chart_data(flights, stages, units, verb="simulated", hidden=hidden, binned=binned, charts=charts)
    return {
        **data,
        "first": {c: _first_range(diagnosis, c, ranges[c], units[c][0]) for c in channels},
        "findings": [
            {
                "effect": f.effect,
                "response": next((c for c in f.axes if c in responses), ""),
                "channel": driving_channel(diagnosis, f),
                "recording": main_recording(diagnosis, f),
                "intervals": {name: _shaded(f, name) for name in diagnosis.traces},
                "region": {c: [pack_number(units[c][0] * x) for x in at] for c, at in f.region.items() if c in units},
            }
            for f in shown_findings(diagnosis)
        ],
    }


def _windows_chart(result: HeldOutSimulation, example: ExampleWindows) -> dict[str, Any]:
    """Time history of one channel with its band, in windows of the first and the last stage."""
    band = next(row.band for row in result.rows if row.channel == example.channel)
    unit = unit_of(example.channel)
    factor, shown = display_unit(unit)
    first, last = (list(example.simulated)[i] for i in (0, -1))
    lines = [("band", "other", example.smoothed + edge) for edge in (-band, band)]
    lines += [("measured", "measured", example.measured)]
    lines += [(STAGE_NAMES[stage], stage, example.simulated[stage]) for stage in (first, last)]
    caption = (
        f"{example.channel} of {example.recording} in windows that start from the recorded state: measured, with its "
        f"band of ± {format_in_unit(band, unit, 2)}, {STAGE_NAMES[first]} and {STAGE_NAMES[last]}."
    )
    return single_chart(
        "windows",
        [pack_number(t) or 0.0 for t in example.t],
        [(name, style, [factor * float(y) for y in values]) for name, style, values in lines],
        title=f"{example.recording}: {example.channel} in windows",
        x_label="time [s]",
        y_label=f"{example.channel} [{shown or '-'}]",
        caption=caption,
        integers=False,
    )


def _flight(trace: Trace, responses: list[str], channels: list[str], stages: Iterable[str]) -> ChartFlight:
    lines = {"measured": trace.measured} | {stage: simulated(trace, stage) for stage in stages}
    each = {r: {kind: values[r] for kind, values in lines.items()} for r in responses}
    return ChartFlight(trace.t, each, {c: trace.channels[c] for c in channels})


def _shaded(finding: EffectFinding, recording: str) -> list[list[float]]:
    """Intervals of a recording in which a finding acts, and the times of its events with their standard deviations."""
    events = [(e.t - e.std, e.t + e.std) for e in finding.events if e.recording == recording]
    return [list(span) for span in (*finding.intervals.get(recording, ()), *events)]


def _range(diagnosis: Diagnosis, channel: str) -> tuple[float, float] | None:
    """Range of a channel in which the first finding that it bounds acts."""
    each = (acting_range(diagnosis, f, channel) for f in diagnosis.findings)
    return next((one for one in each if one is not None), None)


def _first_range(
    diagnosis: Diagnosis, channel: str, region: tuple[float, float] | None, factor: float
) -> list[float | None]:
    """Range of a channel that the chart shows first."""
    x = np.concatenate([one.channels[channel] for one in diagnosis.traces.values()])
    return [pack_number(factor * end) for end in worth_showing(x, region)]


def _pack_bins(binned: Binned, response: float, channel: float) -> dict[str, Any]:
    means = {stage: [pack_number(response * x) for x in binned.means[stage]] for stage in STAGES}
    half = {stage: [pack_number(response * x) for x in binned.half[stage]] for stage in STAGES}
    return {"at": [pack_number(channel * x) for x in binned.at], "means": means, "half": half}
