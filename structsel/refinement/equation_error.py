"""Equation error for a structure that is given: a regression for each response, in time or over a band."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from structsel.aircraft import Aircraft
from structsel.coefficients import compute_all
from structsel.errors import DataError, ModelError
from structsel.model import AeroModel
from structsel.numerics import frequency_regression
from structsel.numerics.differentiation import differentiate
from structsel.numerics.score_covariance import coloured_covariance
from structsel.numerics.spectra import choose_frequencies
from structsel.recording import Recording
from structsel.recording.arguments import as_recordings
from structsel.refinement.linear_flight import LinearFlight
from structsel.refinement.linear_structure import LinearStructure
from structsel.refinement.parameters import check_recordings
from structsel.results import Estimates, NamedEstimates
from structsel.simulation.linear import LinearModel
from structsel.tables import Summary


@dataclass(frozen=True, eq=False, repr=False)
class EquationError(NamedEstimates, Estimates):
    """Parameters by regression of each response on its own terms.

    Attributes
    ----------
    names : tuple of str
        As `refine` has them: "Cm:alpha", or a linear structure's own.
    values, std : (k,) array
        In time with the autocorrelation of the residuals, over a band for noise that is white there. NaN for
        constants, which a band does not contain.
    r2 : mapping of response to float
        Fraction of the variance, or of the power over the band.
    model : AeroModel, LinearStructure or LinearModel
        With the values found.
    domain : {"time", "frequency"}
    band : (low, high) or None [Hz]
    recordings : tuple of str
    """

    names: tuple[str, ...]
    values: np.ndarray
    std: np.ndarray
    r2: Mapping[str, float]
    model: Any
    domain: str
    band: tuple[float, float] | None
    recordings: tuple[str, ...]

    def __post_init__(self) -> None:
        self.freeze()

    def _estimates(self) -> tuple[tuple[str, ...], np.ndarray, np.ndarray, float]:
        return self.names, self.values, self.std, np.inf

    def summary(self) -> Summary:
        """Estimates and their standard errors."""
        band = "" if self.band is None else f" from {self.band[0]:g} to {self.band[1]:g} Hz"
        tables = (self.estimate_table("parameter"),)
        notes = tuple(f"{name}: R2 {r2:.4f}" for name, r2 in self.r2.items())
        return Summary(f"Equation error{band}", ", ".join(self.recordings), tables=tables, notes=notes)


def equation_error(
    model: AeroModel | LinearStructure | LinearModel,
    aircraft: Aircraft | None,
    recordings: Recording | Sequence[Recording],
    *,
    domain: Literal["time", "frequency"] = "time",
    band: tuple[float, float] | None = None,
) -> EquationError:
    """Estimate a structure's parameters by equation error, which is fast but biased by noise in the regressors.

    Parameters
    ----------
    model : AeroModel, LinearStructure or LinearModel
        An AeroModel's responses are regressed on its terms; of a linear model each state's derivative on states and
        inputs, and a constant in each recording. Its values do not matter.
    aircraft : Aircraft or None
        To make coefficients that the recordings lack.
    recordings : Recording or sequence of Recording
        Finite throughout. Reconstructed ones make it the two-step method.
    domain, band
        ``"frequency"``: transforms over (low, high) [Hz].

    Returns
    -------
    EquationError

    Raises
    ------
    ModelError
        A band that is none, no aircraft where coefficients are lacking, or a linear structure that is not linear in
        its parameters.
    ChannelError, DataError
        A channel is missing or not finite, or the terms depend on each other.

    References
    ----------
    [K79], [KM16] ch. 5 and frequency-domain methods.
    """
    flights = as_recordings(recordings, "equation_error")
    check_recordings(flights)
    if domain not in ("time", "frequency") or (domain == "frequency") != (band is not None):
        raise ModelError(
            f"equation_error takes domain='time', or domain='frequency' with band=(low, high) [Hz]; it was given "
            f"domain={domain!r}, band={band}."
        )
    equations = _aero(model, aircraft, flights) if isinstance(model, AeroModel) else _linear(model, flights)
    names, values, std, r2 = [], [], [], {}
    for name, equation in equations.items():
        found = _over_band(name, equation, flights, band) if band is not None else _in_time(name, equation)
        names += equation.names
        values += list(found[0])
        std += list(found[1])
        r2[name] = found[2]
    refined = _with(model, dict(zip(names, values)), dict(zip(names, std)))
    names_of_recordings = tuple(r.name for r in flights)
    return EquationError(tuple(names), np.array(values), np.array(std), r2, refined, domain, band, names_of_recordings)


@dataclass(frozen=True)
class _Equation:
    """One response: names of its parameters, and of each recording regressors (n, k) and response (n,)."""

    names: list[str]
    X: list[np.ndarray]
    y: list[np.ndarray]
    constant: bool = False  # and a constant of each recording


def _aero(model: AeroModel, aircraft: Aircraft | None, flights: Sequence[Recording]) -> dict[str, _Equation]:
    if any(name not in r for r in flights for name in (*model, *model.channels)):
        if aircraft is None:
            raise ModelError("equation_error needs the aircraft to compute coefficients; it was given None.")
        flights = compute_all(flights, aircraft)
    for r in flights:
        r.require(*model, finite=True, by="equation_error")
    return {
        name: _Equation(
            [f"{name}:{term}" for term in held.terms],
            [np.column_stack([term.evaluate(r) for term in held.terms]) for r in flights],
            [r[name] for r in flights],
        )
        for name, held in model.responses.items()
    }


def _linear(model: LinearStructure | LinearModel, flights: Sequence[Recording]) -> dict[str, _Equation]:
    flight = LinearFlight(model)
    structure, k = flight.structure, len(flight.parameters)
    made = structure.matrices(np.vstack([np.zeros(k), np.eye(k), np.linspace(0.5, 1.5, k)]))
    both = np.concatenate([made.A, made.B], axis=2)
    parts = both[1:-1] - both[0]
    if not np.allclose(both[-1], both[0] + np.tensordot(np.linspace(0.5, 1.5, k), parts, 1)):
        raise ModelError(
            f"equation_error needs matrices linear in their parameters; those of '{structure.name}' are not."
        )
    acts = np.abs(parts).max(axis=2) > 0.0  # (k, s)
    shared = [name for name, row in zip(flight.parameters, acts) if row.sum() > 1]
    if shared:
        raise ModelError(
            f"equation_error solves each state's equation alone; {', '.join(shared)} of '{structure.name}' occur "
            "in several. Use refine()."
        )
    equations = {}
    for i, state in enumerate(structure.states):
        mine = np.flatnonzero(acts[:, i])
        if not mine.size:
            continue
        X, y = [], []
        for r in flights:
            r.require(*structure.states, finite=True, by="equation_error")
            moved = np.column_stack([*(r[name] for name in structure.states), flight.inputs(r)])
            X.append(moved @ parts[mine, i].T)
            rate = r[f"{state}_dot"] if f"{state}_dot" in r else differentiate(r[state], r.dt)
            y.append(rate - moved @ both[0, i])
        names = list(flight.parameters)
        equations[f"{state}_dot"] = _Equation([names[j] for j in mine], X, y, constant=True)
    return equations


def _in_time(name: str, equation: _Equation) -> tuple[np.ndarray, np.ndarray, float]:
    X, y = equation.X, equation.y
    k = X[0].shape[1]
    if equation.constant:
        own = np.eye(len(X))
        X = [np.column_stack([x, np.tile(row, (len(x), 1))]) for x, row in zip(X, own)]
    pooled, response = np.vstack(X), np.concatenate(y)
    size = np.linalg.norm(pooled, axis=0)
    theta, _, rank, _ = np.linalg.lstsq(pooled / np.where(size > 0.0, size, 1.0), response, rcond=1e-10)
    if rank < pooled.shape[1]:
        lost = [n for n, s in zip(equation.names, size) if s == 0.0]
        raise DataError(
            f"equation_error cannot determine the terms of {name} ({', '.join(lost or equation.names)}): they depend "
            "on each other in these recordings, or are zero. Leave one out, or record an input that separates them."
        )
    theta = theta / size
    residuals = [b - a @ theta for a, b in zip(X, y)]
    loss = float(sum(v @ v for v in residuals))
    spread = float(np.sum((response - response.mean()) ** 2))
    return (
        theta[:k],
        np.sqrt(np.diag(coloured_covariance(X, residuals)))[:k],
        1.0 - loss / spread if spread > 0.0 else np.nan,
    )


def _over_band(
    name: str, equation: _Equation, flights: Sequence[Recording], band: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, float]:
    constant = np.array([all(np.ptp(x[:, j]) == 0.0 for x in equation.X) for j in range(len(equation.names))])
    frequencies = [f[f > 0.0] for f in (choose_frequencies(r.duration, *band) for r in flights)]
    steps = [r.dt for r in flights]
    try:
        fit = frequency_regression.equation_error([x[:, ~constant] for x in equation.X], equation.y, steps, frequencies)
    except DataError as error:
        raise DataError(f"equation_error, {name}: {error}") from error
    values, std = np.full(len(constant), np.nan), np.full(len(constant), np.nan)
    values[~constant], std[~constant] = fit.theta, fit.std
    return values, std, fit.r2


def _with(model: Any, values: Mapping[str, float], std: Mapping[str, float]) -> Any:
    known = {name: value for name, value in values.items() if np.isfinite(value)}
    if isinstance(model, LinearModel):
        return model.with_parameters(known)
    if isinstance(model, LinearStructure):
        return model.replace(known)
    made = {}
    for response, held in model.responses.items():
        names = [f"{response}:{term}" for term in held.terms]
        made[response] = replace(
            held, values=np.array([known.get(n, v) for n, v in zip(names, held.values)]), covariance=None,
            standard_errors=np.array([std.get(n, np.nan) for n in names]), method="equation error",
            residuals="coloured", s2=np.nan, r2=np.nan, n=0,
        )  # fmt: skip
    return AeroModel(made, model.name, model.recordings)
