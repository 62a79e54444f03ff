"""Residuals of a model or a simulation, without and with one term or effect more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from structsel.aircraft import Aircraft
from structsel.candidates import Candidates, Term
from structsel.comparison.flight import Flight
from structsel.comparison.preparing import prepare
from structsel.errors import ChannelError, SelectionError
from structsel.exploring.added_terms import Additions, try_additions
from structsel.model import AeroModel, ResponseModel
from structsel.numerics.arrays import Array
from structsel.recording import Recording
from structsel.tables import Column, Summary, Table, text_column

_DERIVED = ("p_hat", "q_hat", "r_hat", "CT", "mach", "qbar")
_SHOWN = 10  # rows of a table; the menu has all


@dataclass(frozen=True, eq=False)
class ResidualSeries:
    """Residual of one response in one recording.

    Attributes
    ----------
    name : str
        Of the recording.
    t : (n,) array [s]
    channel : (n,) array
        The channel that the residual is drawn against.
    without, with_it : (n,) array
        Residual of the model, and of the model with the term or effect; equal if there is none.
    """

    name: str
    t: Array
    channel: Array
    without: Array
    with_it: Array


class Trials(Protocol):
    """Things that can be added to a model or a simulation, and what each does to the residuals."""

    def names(self, response: str) -> list[str]:
        """What can be added, the best first."""

    def residuals(self, response: str, channel: str, recordings: Sequence[str], added: str) -> list[ResidualSeries]:
        """Residuals of these recordings, with `added` or, if it is empty, with nothing."""

    def summary(self, response: str, added: str) -> Summary:
        """Effect of adding it, and of the best ones."""


def varying_channels(recordings: Sequence[Recording]) -> list[str]:
    """Channels of every recording that are finite, and not constant in all of them."""
    shared = [name for name in recordings[0].names if all(name in one for one in recordings)]
    finite = [name for name in shared if all(np.isfinite(one[name]).all() for one in recordings)]
    return [name for name in finite if any(np.ptp(one[name]) > 0.0 for one in recordings)]


class TermTrials:
    """Terms that may be added to a model; its own terms are refitted by least squares, without and with the new one."""

    def __init__(self, model: AeroModel, recordings: Sequence[Recording], candidates: Candidates):
        self._model, self._recordings, self._candidates = model, list(recordings), candidates
        self._additions: dict[str, Additions | None] = {}

    def additions(self, response: str) -> Additions | None:
        """Effect of every candidate; None if the terms of the model explain them all."""
        if response not in self._additions:
            try:
                found = try_additions(self._model, self._recordings, response, self._candidates)
            except SelectionError:
                found = None
            self._additions[response] = found
        return self._additions[response]

    def names(self, response: str) -> list[str]:
        """Terms, the largest cross-validated R2 first."""
        found = self.additions(response)
        return [] if found is None else [str(term) for term in found.terms]

    def residuals(self, response: str, channel: str, recordings: Sequence[str], added: str) -> list[ResidualSeries]:
        """Residuals after a fit to all recordings, not only to those that are shown."""
        own = Candidates(self._model[response].terms)
        X = [np.column_stack([np.ones(len(r)), own.evaluate(r)]) for r in self._recordings]
        y = [r[response] for r in self._recordings]
        without = _residuals(X, y)
        with_it = without
        if added:
            new = ResponseModel((Term(added),), np.ones(1))
            with_it = _residuals([np.column_stack([x, new.evaluate(r)]) for x, r in zip(X, self._recordings)], y)
        return [
            ResidualSeries(r.name, r.t, r[channel], a, b)
            for r, a, b in zip(self._recordings, without, with_it)
            if r.name in recordings
        ]

    def summary(self, response: str, added: str) -> Summary:
        """Value, partial F, R2, PSE and cross-validated R2."""
        found = self.additions(response)
        if found is None:
            return Summary(response, "no candidate is left: the terms of the model explain them all")
        r2, pse, held_out_r2 = found.before
        own = ("(as it is)", None, None, r2, 0.0, pse, held_out_r2, 0.0)
        shown = [i for i, term in enumerate(found.terms) if (str(term) == added if added else i < _SHOWN)]
        rows = [
            (
                str(found.terms[i]), found.values[i], found.partial_F[i], found.r2[i], found.r2[i] - r2, found.pse[i],
                found.held_out_r2[i], found.held_out_r2[i] - held_out_r2,
            )
            for i in shown
        ]  # fmt: skip
        notes = (
            "Cross-validated: complete recordings, or segments of a single one, are predicted from the others; choose "
            "terms by this R2.",
            "F: partial F of white residuals. PSE: predicted squared error over the variance of the response. "
            "Values are in SI units and radians.",
        )
        table = Table(_TERM_COLUMNS, (own, *rows))
        return Summary(f"{response}: effect of adding {added or 'one term'}", tables=(table,), notes=notes)


def _residuals(X: Sequence[Array], y: Sequence[Array]) -> list[Array]:
    """Residuals of one least-squares fit to all recordings."""
    coefficients = np.linalg.lstsq(np.concatenate(X), np.concatenate(y), rcond=None)[0]
    return [b - a @ coefficients for a, b in zip(X, y)]


_TERM_COLUMNS = (
    text_column("term"),
    Column("value", "4g"),
    Column("F", "3g"),
    Column("R2", "4f"),
    Column("change", "2g"),
    Column("PSE", "3g"),
    Column("cross-validated R2", "4f"),
    Column("change", "2g"),
)
_EFFECT_COLUMNS = (
    text_column("effect"),
    text_column("form"),
    Column("log Bayes factor", "1f"),
    Column("cross-validated", "1f"),
    Column("explained", "%"),
)


class EffectTrials:
    """Effects that may be added to a simulation, as `diagnose` scores each of them alone.

    The flights are prepared when they are first needed, and the effects scored when they are; both take a while.
    """

    def __init__(self, simulation: Any, recordings: Sequence[Recording], aircraft: Aircraft | None):
        self._given = simulation, list(recordings), aircraft

    @cached_property
    def flights(self) -> tuple[Flight, ...]:
        """Recordings with the simulated responses."""
        return prepare(*self._given).flights

    @cached_property
    def _scores(self) -> list[Any]:
        from threadpoolctl import threadpool_limits

        from structsel.diagnosis.diagnose import set_up
        from structsel.diagnosis.scoring import score_all

        with threadpool_limits(1):
            problem, library, _ = set_up(self.flights)
            return score_all(problem, library)

    def names(self, response: str) -> list[str]:
        """Effects that act on the response, the largest evidence first."""
        return [one.effect for one in self._scores if response in one.signature.responses]

    def residuals(self, response: str, channel: str, recordings: Sequence[str], added: str) -> list[ResidualSeries]:
        """Measured minus simulated about the mean over all recordings, with the effect as it is estimated alone."""
        without = [f.difference[response] for f in self.flights]
        with_it = [a - self._contribution(f, response, added) for f, a in zip(self.flights, without)]
        return [
            ResidualSeries(f.name, f.t, _channel(f, channel), a, b)
            for f, a, b in zip(self.flights, _levelled(without), _levelled(with_it))
            if f.name in recordings
        ]

    def _contribution(self, flight: Flight, response: str, added: str) -> Array:
        """What an effect adds to measured minus simulated."""
        for one in self._scores if added else ():
            if one.effect == added:
                variant = one.signature.variant
                columns = variant.columns(flight).get(response)
                if columns is None or (variant.only_in and flight.name not in variant.only_in):
                    break
                sizes = np.array([p.sd for p in variant.parameters]) * one.trials[one.best].theta
                return np.asarray(columns).reshape(len(flight), -1) @ sizes
        return np.zeros(len(flight))

    def summary(self, response: str, added: str) -> Summary:
        """Log Bayes factor, predictive gain and explained fraction of the difference."""
        before = _squares(_levelled([f.difference[response] for f in self.flights]))
        rows = []
        for one in self._scores:
            if response not in one.signature.responses or (added and one.effect != added):
                continue
            after = [f.difference[response] - self._contribution(f, response, one.effect) for f in self.flights]
            explained = 1.0 - _squares(_levelled(after)) / before
            about = one.signature.variant.about
            rows.append((one.effect, about, one.log_evidence, float(np.sum(one.predictive)), explained))
            if len(rows) == _SHOWN:
                break
        return Summary(
            f"{response}: effect of adding {added or 'one effect'}",
            "each effect alone",
            tables=(Table(_EFFECT_COLUMNS, tuple(rows)),),
            notes=(
                "log Bayes factor: natural logarithm of the evidence over all responses, the parameters within the "
                "tolerances of the aircraft free. Cross-validated: gain in log likelihood of recordings predicted from "
                f"the others. Explained: of the variance of {response}. Probabilities need structsel diagnose.",
            ),
        )


def _channel(flight: Flight, name: str) -> Array:
    if name in flight:
        return flight[name]
    raise ChannelError(f"'{flight.name}' has no channel '{name}'.")


def _levelled(parts: Sequence[Array]) -> list[Array]:
    level = float(np.concatenate(parts).mean())
    return [part - level for part in parts]


def _squares(parts: Sequence[Array]) -> float:
    return float(sum(part @ part for part in parts))


def recordings_of(flights: Sequence[Flight]) -> list[Recording]:
    """Differences as recordings: the responses are measured minus simulated, the other channels are smoothed."""
    made = []
    for f in flights:
        channels = {name: f.channels[name] for name in f.channels if name in f.recorded}
        channels |= {name: f[name] for name in _DERIVED if name in f}
        made.append(Recording(f.name, f.t, {**channels, **f.difference}))
    return made


def zero_model(responses: Sequence[str]) -> AeroModel:
    """Model of differences: no term but the constant, which is zero."""
    return AeroModel({name: ResponseModel((Term("1"),), np.zeros(1)) for name in responses}, name="differences")
