"""Derivatives over many manoeuvres against the condition they were recorded from: angle of attack in trim, airspeed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from structsel.aircraft import Aircraft
from structsel.errors import DataError, ModelError, RefinementError, StructselError
from structsel.formatting import display_unit, format_number, format_percent
from structsel.model import AeroModel
from structsel.nomenclature import unit_of
from structsel.recording import Recording
from structsel.refinement.equation_error import equation_error
from structsel.refinement.estimate_comparison import Estimates, estimates_by_name
from structsel.refinement.parameters import check_recordings
from structsel.refinement.refine import refine
from structsel.refinement.result import Refinement
from structsel.results import Result
from structsel.tables import Column, Summary, Table

if TYPE_CHECKING:
    import pandas as pd

METHODS = ("equation error", "two-step", "output error", "filter error")
_TRIM = 1.0  # s at the start of a manoeuvre, whose median is its condition


@dataclass(frozen=True, eq=False, repr=False)
class Derivatives(Result):
    """Estimates by condition, parameter and method.

    Attributes
    ----------
    against : str
        The channel that distinguishes conditions.
    conditions : (g,) array [SI]
        Its values at the start of the manoeuvres, ascending; the mean of those estimated together.
    recordings : tuple of tuple of str
        Recordings at each.
    parameters, methods : tuple of str
    values, std : (g, p, m) array
        NaN where a method has no answer, std infinite where the manoeuvre does not determine it.
    level : float
        Of the confidence intervals.
    notes : mapping of (condition's number, method) to str
        Why there is no estimate, or a warning.
    """

    against: str
    conditions: np.ndarray
    recordings: tuple[tuple[str, ...], ...]
    parameters: tuple[str, ...]
    methods: tuple[str, ...]
    values: np.ndarray
    std: np.ndarray
    level: float
    notes: Mapping[tuple[int, str], str]

    def __post_init__(self) -> None:
        self.freeze()

    @property
    def half(self) -> np.ndarray:
        """(g, p, m) half widths of the confidence intervals, normal."""
        return scipy.stats.norm.ppf(0.5 + self.level / 2.0) * self.std

    def to_frame(self) -> pd.DataFrame:
        """One row for each condition, parameter and method, with its interval and note."""
        import pandas as pd

        rows = [
            {"recordings": ", ".join(self.recordings[g]), self.against: self.conditions[g], "parameter": name,
             "method": method, "value": self.values[g, i, j], "std": self.std[g, i, j],
             "low": self.values[g, i, j] - self.half[g, i, j], "high": self.values[g, i, j] + self.half[g, i, j],
             "note": self.notes.get((g, method), "")}
            for g in range(len(self.conditions)) for i, name in enumerate(self.parameters)
            for j, method in enumerate(self.methods)
        ]  # fmt: skip
        return pd.DataFrame(rows)

    def summary(self) -> Summary:
        """A table for each parameter: estimates of each method over the condition."""
        factor, unit = display_unit(unit_of(self.against))
        columns = (Column(self.against, unit=unit), *map(Column, self.methods))
        tables = [
            Table(columns, tuple((factor * at, *self._estimates(g, i)) for g, at in enumerate(self.conditions)), name)
            for i, name in enumerate(self.parameters)
        ]
        warnings = (f"{', '.join(self.recordings[g])}, {method}: {text}" for (g, method), text in self.notes.items())
        about = f"over {self.against}, intervals of {format_percent(self.level)}"
        return Summary("Estimates", about, tables=tuple(tables), warnings=tuple(warnings))

    def _estimates(self, g: int, i: int) -> list[str | None]:
        pairs = zip(self.values[g, i], self.half[g, i])
        return [None if np.isnan(value) else f"{value:.4g} +- {format_number(half, 2)}" for value, half in pairs]


def derivatives_by_condition(
    model: AeroModel,
    aircraft: Aircraft,
    recordings: Sequence[Recording],
    *,
    against: str = "alpha",
    parameters: Sequence[str] | None = None,
    methods: Sequence[str] = ("equation error", "two-step", "output error"),
    edges: Sequence[float] | None = None,
    level: float = 0.95,
    **options: Any,
) -> Derivatives:
    """Estimate a local model in each manoeuvre, or each range of conditions, by several methods.

    Parameters
    ----------
    model : AeroModel
        Local: normally linear, with a constant in each response. Output error starts from its values.
    aircraft : Aircraft
    recordings : sequence of Recording
        As read; each begins in the steady flight that is its condition.
    against : str
        Channel whose median over the first second is a manoeuvre's condition: ``"alpha"``, ``"V"``.
    parameters : sequence of str, optional
        Those to report, ``"Cm:alpha"``; all by default.
    methods : sequence of {"equation error", "two-step", "output error", "filter error"}
        Regression on the channels as read; regression after `reconstruct`; `refine`, and the same with process noise.
    edges : sequence of float, optional
        Ascending bounds of the channel [SI]; manoeuvres between two of them are estimated together, those outside are
        left out. By default each manoeuvre is estimated alone.
    level : float
        Of the confidence intervals.
    options
        Of `refine`; ``starts="all"`` unless given.

    Returns
    -------
    Derivatives
        A manoeuvre that a method cannot use has a note, and the best that was found, if anything.

    Raises
    ------
    ModelError
        A method or a parameter that there is not.
    DataError
        No manoeuvre between the edges, or one without the channel's first readings.

    References
    ----------
    [K79], where derivatives of a light aeroplane are set against the angle of attack in trim.
    """
    flights = list(recordings)
    check_recordings(flights)
    names = [f"{response}:{term}" for response, held in model.responses.items() for term in held.terms]
    reported = list(parameters) if parameters is not None else names
    if unknown := [m for m in methods if m not in METHODS] + [p for p in reported if p not in names]:
        raise ModelError(
            f"derivatives_by_condition was given '{unknown[0]}'. Methods: {', '.join(METHODS)}; parameters: "
            f"{', '.join(names)}."
        )
    at = np.array([_condition(r, against) for r in flights])
    groups = _groups(at, edges)
    if not groups:
        raise DataError(
            f"derivatives_by_condition has no manoeuvre between its edges of {against}; they begin at "
            f"{', '.join(f'{value:.4g}' for value in at)}."
        )
    values = np.full((len(groups), len(reported), len(methods)), np.nan)
    std, notes = values.copy(), {}
    for g, members in enumerate(groups):
        recorded = [flights[i] for i in members]
        for j, method in enumerate(methods):
            found, note = _estimate(method, model, aircraft, recorded, options)
            if note:
                notes[g, method] = note
            for i, name in enumerate(reported):
                values[g, i, j], std[g, i, j] = found.get(name, (np.nan, np.nan))
    return Derivatives(
        against, np.array([at[members].mean() for members in groups]),
        tuple(tuple(flights[i].name for i in members) for members in groups), tuple(reported), tuple(methods), values,
        std, level, notes,
    )  # fmt: skip


def _condition(recording: Recording, against: str) -> float:
    recording.require(against, by="derivatives_by_condition")
    first = recording[against][recording.t <= recording.t[0] + _TRIM]
    if not np.isfinite(first).any():
        raise DataError(f"'{recording.name}' has no reading of {against} in its first second, which is its condition.")
    return float(np.nanmedian(first))


def _groups(at: np.ndarray, edges: Sequence[float] | None) -> list[list[int]]:
    """Numbers of the manoeuvres to take together, in ascending condition."""
    order = np.argsort(at, kind="stable").tolist()
    if edges is None:
        return [[i] for i in order]
    bins = [[i for i in order if low <= at[i] < high] for low, high in pairwise(edges)]
    return [members for members in bins if members]


def _estimate(
    method: str, model: AeroModel, aircraft: Aircraft, recorded: list[Recording], options: Mapping[str, Any]
) -> tuple[dict[str, tuple[float, float]], str]:
    """Estimates by name, and a note."""
    from structsel.reconstruction import reconstruct

    try:
        found: Estimates
        if method == "equation error":
            found = equation_error(model, aircraft, recorded)
        elif method == "two-step":
            found = equation_error(model, aircraft, [reconstruct(r, aircraft).recording for r in recorded])
        else:
            noise = "process" if method == "filter error" else "measurement"
            found = refine(model, aircraft, recorded, **{"starts": "all", "noise": noise, **options})
            if not found.converged:
                return estimates_by_name(found), found.message
        return estimates_by_name(found), ""
    except RefinementError as error:
        best = estimates_by_name(error.partial) if isinstance(error.partial, Refinement) else {}
        return best, str(error).splitlines()[0]
    except StructselError as error:
        return {}, str(error).splitlines()[0]
