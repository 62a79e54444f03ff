"""`design_inputs`: the input that determines parameters best, or the difference between some of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from structsel.errors import DomainError, ModelError
from structsel.formatting import format_number
from structsel.inputs.criteria import Criterion, DesignProblem, elementary_matrices
from structsel.inputs.information import Information, information, of_sensitivities, select_parameters, sensitivities
from structsel.inputs.limits import LimitUse, limit_rows, reached
from structsel.inputs.optimal import Optimum, optimise, orthonormal_functions, within_limits
from structsel.inputs.settings import DesignOptions
from structsel.inputs.signals import clock
from structsel.options import takes_options
from structsel.recording import Recording, write_recording
from structsel.recording.arguments import require_kind
from structsel.results import Result
from structsel.simulation.linear import LinearModel
from structsel.tables import Column, Summary, Table, text_column

if TYPE_CHECKING:
    import pandas as pd

_CRITERIA = {
    "A": "trace of the covariance",
    "D": "ln det of the covariance",
    "trace": "trace of the information",
    "E": "largest variance of any combination",
}
_ENERGY_TOLERANCE = 1e-3  # of the energy: a smaller deficit is due to the penalty


@dataclass(frozen=True, eq=False, repr=False)
class InputDesign(Result):
    """An optimal input, with its information.

    Attributes
    ----------
    inputs : Recording
        The input on its clock; held from sample to sample unless `hold` was ``"linear"``.
    information : Information
        Its Cramer-Rao bounds.
    criterion : {"A", "D", "trace", "E"}
    of_interest : tuple of str
        Parameters in the criterion; the others are estimated too.
    value, free_value : float
        Of the criterion, parameters scaled: of the input, and without limits at the given energy.
    energy, energy_asked : float
        Of the input, and as given; nan where only the limits set it.
    basis : str
    coefficients : (inputs, functions) array
    limits : tuple of LimitUse
    history : tuple of (float, float)
        Criterion and slope at each Newton-Raphson step.
    converged : bool
    notes : tuple of str
        Effect of the limits, and other remarks.
    """

    inputs: Recording
    information: Information
    criterion: Criterion
    of_interest: tuple[str, ...]
    value: float
    free_value: float
    energy: float
    energy_asked: float
    basis: str
    coefficients: np.ndarray
    limits: tuple[LimitUse, ...]
    history: tuple[tuple[float, float], ...]
    converged: bool
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        """Make the array read-only."""
        array = np.array(self.coefficients, dtype=float)
        array.setflags(write=False)
        object.__setattr__(self, "coefficients", array)

    def to_recording(self) -> Recording:
        """The input, as `simulate` takes it."""
        return self.inputs

    def write(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write the table of (t, value) as CSV or Parquet; see `write_recording`."""
        return write_recording(self.inputs, path, overwrite=overwrite)

    def to_frame(self) -> pd.DataFrame:
        """One row per parameter: value and Cramer-Rao bound."""
        return self.information.to_frame()

    def to_dict(self) -> dict[str, Any]:
        """Plain types, for JSON."""
        return {
            "criterion": self.criterion,
            "of_interest": list(self.of_interest),
            "value": self.value,
            "free_value": self.free_value,
            "energy": self.energy,
            "basis": self.basis,
            "coefficients": self.coefficients.tolist(),
            "limits": [r.to_dict() for r in self.limits],
            "converged": self.converged,
            "information": self.information.to_dict(),
            "notes": list(self.notes),
        }

    def summary(self) -> Summary:
        """The input, the Cramer-Rao bounds that it reaches, and the limits."""
        aim = "largest" if self.criterion == "trace" else "least"
        shape = f"{self.coefficients.shape[1]} {self.basis} on {', '.join(self.inputs.names)}"
        ended = "converged" if self.converged else "NOT converged: the best found is given"
        rows = tuple((each.what, each.allowed, each.reached) for each in self.limits)
        limits = Table((text_column("limit"), Column("allowed"), Column("reached")), rows)
        return Summary(
            "input",
            f"for the {aim} {_CRITERIA[self.criterion]} of {', '.join(self.of_interest)}",
            facts=(
                ("functions", shape),
                ("duration", f"{self.inputs.duration:g} s"),
                ("energy", format_number(self.energy)),
                ("Newton-Raphson steps", f"{len(self.history)}, {ended}"),
            ),
            tables=(*self.information.tables(), *([limits] if self.limits else [])),
            warnings=(*self.information.unidentifiable, *self.notes),
        )


@takes_options(DesignOptions)
def design_inputs(model: LinearModel, *, noise: Mapping[str, float], options: DesignOptions) -> InputDesign:
    """Design the input that determines a linear model's parameters best [M86].

    A finite sum of orthonormal functions of fixed energy, from a seeded global search and Newton-Raphson with exact
    derivatives; see `structsel.inputs.optimal`.

    Parameters
    ----------
    model : LinearModel
        With the best knowledge of its parameters; all its inputs are designed.
    noise : mapping of str to float
        Standard deviation of white noise on each measured output.
    options : DesignOptions, optional
        Every field may be given as a keyword of its own instead: ``design_inputs(..., criterion="D", energy=0.01)``.

    Returns
    -------
    InputDesign
        Its notes state where limits changed the input, or lowered its energy.

    Raises
    ------
    ArgumentError
        The model is an object of another type.
    ModelError
        Unknown names, neither energy nor limits, a parameter that is zero without a scale, or parameters that no input
        can separate; the message names them.
    """
    require_kind(model, LinearModel, "design_inputs(model, noise=...)")
    names = select_parameters(model, options.parameters)
    criterion, to_separate, energy, dt = options.criterion, options.to_separate, options.energy, options.dt
    limits, rate_limits = options.limits or {}, options.rate_limits or {}
    scales, hold, basis = options.scales or {}, options.hold, options.basis
    if to_separate is not None:
        if len(set(to_separate)) < 2 or not set(to_separate) <= set(names):
            raise ModelError(
                f"to_separate names at least two of the parameters ({', '.join(names)}); found {list(to_separate)}."
            )
        criterion = "E"
    if energy is None and not (limits or rate_limits):
        raise ModelError("design_inputs needs an energy, or limits that set one.")
    if energy is not None and not energy > 0.0:
        raise ModelError(f"design_inputs needs an energy above zero; found {energy}.")
    interest = names if to_separate is None else tuple(dict.fromkeys(to_separate))
    size = parameter_sizes(model, names, options.parameter_scales)
    t = clock(options.duration, dt)
    count = _functions(model, options.duration) if options.functions is None else options.functions
    phi = orthonormal_functions(basis, count, len(t), dt)
    u = _spread(phi, [scales.get(c, 1.0) for c in model.inputs])
    S = sensitivities(model, names, np.concatenate([np.zeros_like(u[:1]), u]), dt, noise, hold)
    S[1:] -= S[0]  # change of the motion due to the input
    complete = of_sensitivities("any input of this kind", names, np.ones(len(names)), S.reshape(-1, len(names)))
    complete.require()
    rows = limit_rows(model, u, options)
    problem = DesignProblem(
        elementary=elementary_matrices(S * size),
        criterion=criterion,
        of_interest=np.array([names.index(p) for p in interest]),
        energy=1.0 if energy is None else energy,
        limits=rows,
    )
    try:
        free = optimise(problem, _starts(problem, phi, len(model.inputs)), seed=options.seed)
    except DomainError as error:
        raise ModelError(f"design_inputs: {error} Parameters: {', '.join(names)}.") from error
    found = within_limits(problem, free, energy)
    a = found.a
    value = float(problem.values(a[None])[0])
    made = np.tensordot(a, u, 1)
    note = f"optimal input: criterion {criterion}, {count} {basis}, energy {float(a @ a):.6g}"
    units = {c: model.unit(c) for c in model.inputs}
    inputs = Recording("optimal", t, {c: made[:, i] for i, c in enumerate(model.inputs)}, units, (note,))
    return InputDesign(
        inputs=inputs,
        information=information(model, inputs, noise=noise, parameters=names, hold=hold),
        criterion=criterion,
        of_interest=interest,
        value=value,
        free_value=np.nan if energy is None else free.value,
        energy=float(a @ a),
        energy_asked=np.nan if energy is None else float(energy),
        basis=basis,
        coefficients=a.reshape(len(model.inputs), count),
        limits=reached(model, made, options),
        history=found.history,
        converged=found.converged,
        notes=tuple(_search_notes(free, found, value, energy)),
    )


def _search_notes(free: Optimum, found: Optimum, value: float, energy: float | None) -> Iterator[str]:
    """Effect of the limits on the input, and whether the search converged."""
    used = float(found.a @ found.a)
    if energy is None:
        yield f"the limits set the energy, {used:.4g}"
    elif used < (1.0 - _ENERGY_TOLERANCE) * energy:
        yield (
            f"within the limits the best energy is {used:.4g}, not the given {energy:.4g}; without limits the "
            f"criterion is {free.value:.4g} instead of {value:.4g}"
        )
    elif found is not free:
        yield f"the limits change this input; without them the criterion is {free.value:.4g} instead of {value:.4g}"
    if not found.converged:
        yield "the search stopped before the gradient was zero; the best input found is given"


def parameter_sizes(
    model: LinearModel, names: tuple[str, ...], scales: Mapping[str, float] | None = None
) -> np.ndarray:
    """Unit of the error of each parameter, (k,): given, else its value.

    Raises
    ------
    ModelError
        A parameter is zero and has no scale.
    """
    size = np.array([abs((scales or {}).get(n, model.parameters[n])) for n in names])
    if (size == 0.0).any():
        zero = [n for n, s in zip(names, size) if s == 0.0]
        raise ModelError(
            f"{', '.join(zero)} of '{model.name}' is zero, so its value is no scale for its error. "
            f"Give parameter_scales for it, as parameter_scales={{'{zero[0]}': 0.1}}."
        )
    return size


def _functions(model: LinearModel, duration: float) -> int:
    fastest = float(model.modes().frequency.max()) / (2.0 * np.pi)
    return int(np.clip(np.ceil(4.0 * fastest * duration), 8, 30))


def _spread(phi: np.ndarray, sizes: Sequence[float]) -> np.ndarray:
    """(inputs * functions, n, inputs) inputs, each of one control."""
    count, n = phi.shape
    u = np.zeros((len(sizes), count, n, len(sizes)))
    for i, size in enumerate(sizes):
        u[i, :, :, i] = size * phi
    return u.reshape(-1, n, len(sizes))


def _starts(problem: DesignProblem, phi: np.ndarray, inputs: int) -> np.ndarray:
    """Start directions: the strongest responses, and doublets and 3-2-1-1s of several widths."""
    T = np.einsum("ijll->ij", problem.elementary[1:, 1:])
    strongest = np.linalg.eigh(T)[1][:, -4:].T
    n = phi.shape[1]
    rows = [*strongest]
    for pattern in ((1, -1), (3, -2, 1, -1)):
        for fraction in (0.1, 0.2, 0.4, 0.8):
            edges = np.round(fraction * n * np.concatenate([[0.0], np.cumsum(np.abs(pattern))]) / np.abs(pattern).sum())
            wave = np.zeros(n)
            for first, last, sign in zip(edges[:-1].astype(int), edges[1:].astype(int), np.sign(pattern)):
                wave[first + n // 20 : last + n // 20] = sign
            row = np.concatenate([np.roll(phi @ wave, i) for i in range(inputs)])
            rows.append(row / np.linalg.norm(row))
    return np.array(rows)
