"""Everything that a page of the explorer can show, and the numbers of one view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from structsel.aircraft import Aircraft
from structsel.candidates import Candidates
from structsel.errors import DataError, DomainError
from structsel.exploring.trials import (
    EffectTrials,
    ResidualSeries,
    TermTrials,
    Trials,
    recordings_of,
    varying_channels,
    zero_model,
)
from structsel.exploring.view import View
from structsel.formatting import count_of, display_unit, format_number
from structsel.model import AeroModel
from structsel.nomenclature import UNKNOWN, unit_of
from structsel.numerics.arrays import Array
from structsel.numerics.binning import BinMeans, bin_means, split_into_segments
from structsel.numerics.spectra import power_spectrum
from structsel.recording import Recording
from structsel.tables import Summary

_DRIVING = (
    "alpha", "beta", "p_hat", "q_hat", "r_hat", "de", "da", "dr", "df", "CT", "mach", "h_agl", "alpha_dot_hat",
)  # fmt: skip
_SEGMENT = 8.0  # s of a segment of the spectra, as in plotting.plot_spectrum
_SPARE = 0.5  # of the shortest recording, that a segment may have


@dataclass(frozen=True, eq=False)
class Exploration:
    """Recordings, and what can be added to the model or simulation that they are compared with.

    Attributes
    ----------
    title : str
    recordings : tuple of Recording
    responses, channels : tuple of str
    trials : mapping of kind to Trials
        ``"term"``, and ``"effect"`` if the aircraft is known.
    residual : str
        What the residual is, in words.
    """

    title: str
    recordings: tuple[Recording, ...]
    responses: tuple[str, ...]
    channels: tuple[str, ...]
    trials: dict[str, Trials]
    residual: str

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the recordings."""
        return tuple(one.name for one in self.recordings)

    def complete(self, view: View) -> View:
        """View with the first choice where it has none.

        Raises
        ------
        DataError
            It has a recording, response or channel that is not there.
        """
        view = replace(view, recordings=view.recordings or self.names, response=view.response or self.responses[0])
        _require("recording", view.recordings, self.names)
        _require("response", (view.response,), self.responses)
        _require("kind of addition", (view.kind,), ("", *self.trials))
        view = replace(view, channel=view.channel or self._driving(view))
        _require("channel", (view.channel,), self.channels)
        return view

    def _driving(self, view: View) -> str:
        """Channel of the best term, else the first channel."""
        words = " ".join(self.trials["term"].names(view.response)[:1]).replace("^", "*").split("*")
        return next((name for name in words if name in self.channels), self.channels[0])


def _require(what: str, wanted: Sequence[str], there: Sequence[str]) -> None:
    for name in wanted:
        if name not in there:
            raise DataError(f"the view has the {what} '{name}', which is not here. There are: {', '.join(there)}.")


def explore_model(
    model: AeroModel, recordings: Sequence[Recording], candidates: Candidates, aircraft: Aircraft | None = None
) -> Exploration:
    """Exploration of the residuals of a model; effects can be added if the aircraft is known."""
    channels = varying_channels(recordings)
    responses = tuple(name for name in model if all(name in one for one in recordings))
    if not responses:
        raise DataError(
            f"the recordings have no response of the model: {', '.join(model)}.",
            remedy="Call compute_all(recordings, aircraft) first.",
            cli_remedy="Give --aircraft AIRCRAFT.TOML, from which coefficients are computed.",
        )
    trials: dict[str, Trials] = {"term": TermTrials(model, recordings, candidates)}
    if aircraft is not None and aircraft.inertia is not None:
        trials["effect"] = EffectTrials(model, recordings, aircraft)
    title = f"{model.name or 'Model'}, {count_of(len(recordings), 'recording')}"
    about = "recorded response minus model, whose terms are refitted by least squares to all recordings"
    return Exploration(title, tuple(recordings), responses, tuple(channels), trials, about)


def explore_simulation(
    simulation: Any, recordings: Sequence[Recording], aircraft: Aircraft | None, candidates: Candidates | None = None
) -> Exploration:
    """Exploration of the differences between recordings and a simulation."""
    effects = EffectTrials(simulation, recordings, aircraft)
    flights = effects.flights
    differences = recordings_of(flights)
    responses = tuple(flights[0].responses)
    channels = [name for name in varying_channels(differences) if name not in responses]
    driving = [name for name in channels if name in _DRIVING] or channels
    pool = candidates or Candidates.polynomial(driving, 2)
    terms = TermTrials(zero_model(responses), differences, pool)
    name = simulation if isinstance(simulation, str) else getattr(simulation, "name", "") or "simulation"
    return Exploration(
        f"{name}, {count_of(len(flights), 'recording')}", tuple(differences), responses, tuple(channels),
        {"term": terms, "effect": effects}, "recorded minus simulated response, about its mean over all recordings",
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class ViewData:
    """Numbers of one view, in displayed units.

    Attributes
    ----------
    view : View
    series : list of ResidualSeries
    means, means_with : BinMeans
        Of the residual over bins of the channel, without and with what is added.
    frequency : (m,) array [Hz]
        Empty if the recordings are too short or have different sampling intervals.
    density, density_with : (m,) array
        Power spectral density of the residual.
    x_label, y_label, density_label : str
    words : str
        What the figures show, for those who do not see them.
    summary : Summary
        Effect of what is added.
    """

    view: View
    series: list[ResidualSeries]
    means: BinMeans
    means_with: BinMeans
    frequency: Array
    density: Array
    density_with: Array
    x_label: str
    y_label: str
    density_label: str
    words: str
    summary: Summary


def compute_view(exploration: Exploration, view: View) -> ViewData:
    """Compute the residuals of a view, their bin means and spectra."""
    view = exploration.complete(view)
    trials = exploration.trials[view.kind or "term"]
    units = exploration.recordings[0].units
    (x_scale, x_unit), (y_scale, y_unit) = (_displayed(name, units) for name in (view.channel, view.response))
    added = view.added if view.kind else ""
    series = [
        ResidualSeries(s.name, s.t, x_scale * s.channel, y_scale * s.without, y_scale * s.with_it)
        for s in trials.residuals(view.response, view.channel, view.recordings, added)
    ]
    x = np.concatenate([s.channel for s in series])
    segments = split_into_segments([len(s.t) for s in series])
    before, after = (np.concatenate([getattr(s, name) for s in series]) for name in ("without", "with_it"))
    means, means_with = (bin_means(x, y, segments, view.bins) for y in (before, after))
    frequency, density, density_with = _spectra(series)
    return ViewData(
        view, series, means, means_with, frequency, density, density_with,
        f"{view.channel} [{x_unit}]", f"residual of {view.response} [{y_unit}]",
        "density [1/Hz]" if y_unit == "-" else f"density [({y_unit})^2/Hz]",
        _in_words(view, before, after, means, means_with, x_unit, y_unit), trials.summary(view.response, added),
    )  # fmt: skip


def _displayed(name: str, units: Any) -> tuple[float, str]:
    unit = unit_of(name, units)
    scale, shown = display_unit(unit)
    return scale, shown or ("-" if unit != UNKNOWN else "?")


def _spectra(series: Sequence[ResidualSeries]) -> tuple[Array, Array, Array]:
    """Spectra of the residuals; empty where there are none."""
    dt = float(np.median(np.diff(series[0].t)))
    segment = min(_SEGMENT, _SPARE * min(float(s.t[-1] - s.t[0]) for s in series))
    if any(abs(float(np.median(np.diff(s.t))) - dt) > 0.01 * dt for s in series):
        return np.empty(0), np.empty(0), np.empty(0)
    try:
        found = [
            power_spectrum(parts, dt, segment) for parts in ([s.without for s in series], [s.with_it for s in series])
        ]
    except DomainError:
        return np.empty(0), np.empty(0), np.empty(0)
    return found[0][0], found[0][1], found[1][1]


def _in_words(
    view: View, before: Array, after: Array, means: BinMeans, means_with: BinMeans, x_unit: str, y_unit: str
) -> str:
    def with_unit(value: float, unit: str) -> str:
        return f"{format_number(value, 3)} {unit.strip('-?')}".strip()

    def rms(values: Array) -> str:
        return with_unit(float(np.sqrt(np.mean(values**2))), y_unit)

    def largest(found: BinMeans) -> str:
        known = np.isfinite(found.half) if np.isfinite(found.half).any() else np.ones(len(found.half), dtype=bool)
        i = int(np.argmax(np.where(known, np.abs(found.means), -1.0)))
        half = "" if np.isnan(found.half[i]) else f" +- {format_number(float(found.half[i]), 2)}"
        mean = format_number(float(found.means[i]), 3) + half
        return f"{mean} {y_unit.strip('-?')}".strip() + f" at {view.channel} = {with_unit(float(found.at[i]), x_unit)}"

    text = f"Residual of {view.response} in {count_of(len(view.recordings), 'recording')}: rms {rms(before)}"
    text += f", {rms(after)} with {view.added}. " if view.kind else ". "
    text += f"The bin mean farthest from zero is {largest(means)}"
    return text + (f"; with {view.added} it is {largest(means_with)}." if view.kind else ".")
