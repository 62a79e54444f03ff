"""Information of an input about the parameters of a linear model, and their Cramer-Rao bounds.

With S the sensitivities of the outputs and R the covariance of white measurement noise, the information matrix is
M = sum_k S_k' inv(R) S_k, and no unbiased estimate from these outputs scatters less than inv(M) [M86].
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from structsel.deprecation import renamed_attribute
from structsel.errors import ModelError
from structsel.formatting import finite_or_none
from structsel.recording import Recording
from structsel.results import Result
from structsel.simulation.linear import Hold, LinearModel
from structsel.tables import Column, Summary, Table, text_column

if TYPE_CHECKING:
    import pandas as pd

_RANK = 1e-7
"""Singular value of the sensitivities, scaled to unit columns, below which a direction is not determined."""

_NAMED = 0.01  # of the largest component of a direction: parameters with less are not named


@dataclass(frozen=True, eq=False, repr=False)
class Information(Result):
    """Information in one input about parameters.

    Attributes
    ----------
    name : str
        Of the input.
    parameters : tuple of str
    values : (k,) array
    matrix : (k, k) array
        Information matrix.
    covariance : (k, k) array
        Its inverse, the Cramer-Rao bound; nan throughout where the information is rank-deficient.
    unidentifiable : tuple of str
        One sentence on each parameter or combination that the input does not determine; empty where there is none.
    """

    name: str
    parameters: tuple[str, ...]
    values: np.ndarray
    matrix: np.ndarray
    covariance: np.ndarray
    unidentifiable: tuple[str, ...]

    unseen = renamed_attribute("unidentifiable")

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name in ("values", "matrix", "covariance"):
            array = np.array(getattr(self, name), dtype=float)
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def crlb(self) -> np.ndarray:
        """Least standard deviation of each parameter, (k,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> np.ndarray:
        """Correlation of the best estimates, (k, k)."""
        return self.covariance / np.outer(self.crlb, self.crlb)

    def require(self) -> Information:
        """Return itself, if all parameters are identifiable.

        Raises
        ------
        ModelError
            The information is rank-deficient; the message names the parameters.
        """
        if self.unidentifiable:
            raise ModelError(
                f"the input '{self.name}' does not determine all of {', '.join(self.parameters)}:\n"
                + "\n".join(f"  {line}" for line in self.unidentifiable)
                + "\nExcite the motion that these affect, measure more outputs, or hold one of them fixed."
            )
        return self

    def to_frame(self) -> pd.DataFrame:
        """One row per parameter."""
        import pandas as pd

        return pd.DataFrame({"parameter": self.parameters, "value": self.values, "crlb": self.crlb})

    def to_dict(self) -> dict[str, Any]:
        """Plain types, for JSON."""
        bounds = finite_or_none(self.crlb.tolist())
        return {
            "input": self.name,
            "crlb": dict(zip(self.parameters, bounds)),
            "values": dict(zip(self.parameters, self.values.tolist())),
            "matrix": self.matrix.tolist(),
            "unseen": list(self.unidentifiable),
        }

    def summary(self) -> Summary:
        """Cramer-Rao bound of each parameter."""
        percent = [100.0 * std / abs(value) if value else None for value, std in zip(self.values, self.crlb)]
        columns = (text_column("parameter"), Column("value"), Column("bound", "3g"), Column("% of value", "3g"))
        rows = tuple(zip(self.parameters, self.values.tolist(), self.crlb.tolist(), percent))
        return Summary(self.name, "Cramer-Rao bounds", tables=(Table(columns, rows),), warnings=self.unidentifiable)


def information(
    model: LinearModel,
    inputs: Recording,
    *,
    noise: Mapping[str, float],
    parameters: Sequence[str] | None = None,
    hold: Hold = "hold",
) -> Information:
    """Information matrix and Cramer-Rao bounds of an input.

    Parameters
    ----------
    model : LinearModel
        Simulated from the reference condition.
    inputs : Recording
    noise : mapping of str to float
        Standard deviation of white noise on each output measured; outputs not named are not measured.
    parameters : sequence of str, optional
        Estimated together, the others known. By default all whose value is not zero.
    hold : {"hold", "linear"}

    Returns
    -------
    Information
        A rank-deficient one names the parameters in ``.unidentifiable``; ``.require()`` raises on it.

    Raises
    ------
    ModelError
        Names the model does not have, or noise that is not above zero.
    """
    names = select_parameters(model, parameters)
    inputs.require(*model.inputs, finite=True, by="information")
    u = np.column_stack([inputs[c] for c in model.inputs])
    S = sensitivities(model, names, u[None], inputs.dt, noise, hold)[0]
    return of_sensitivities(inputs.name, names, np.array([model.parameters[n] for n in names]), S)


def of_sensitivities(name: str, names: tuple[str, ...], values: np.ndarray, S: np.ndarray) -> Information:
    """Information from sensitivities over the noise's standard deviation, (rows, k)."""
    M = S.T @ S
    lines = unidentifiable(S, names)
    covariance = np.full_like(M, np.nan)
    if not lines:
        scale = 1.0 / np.linalg.norm(S, axis=0)
        R = np.linalg.qr(S * scale, mode="r")
        inverse = scipy.linalg.solve_triangular(R, np.eye(len(names)))
        covariance = inverse @ inverse.T * np.outer(scale, scale)
    return Information(name, names, values, M, covariance, lines)


def unidentifiable(S: np.ndarray, names: tuple[str, ...]) -> tuple[str, ...]:
    """Sentences on what sensitivities (rows, k) leave undetermined."""
    size = np.linalg.norm(S, axis=0)
    silent = size <= 1e-12 * size.max() if size.max() > 0.0 else np.ones(len(names), dtype=bool)
    lines = [f"{n} does not affect the measured outputs" for n in np.array(names, dtype=object)[silent]]
    if (~silent).any():
        rest = np.array(names, dtype=object)[~silent]
        _, values, directions = np.linalg.svd(S[:, ~silent] / size[~silent], full_matrices=False)
        for direction in directions[values < _RANK * values[0]]:
            among = [n for n, d in zip(rest, np.abs(direction)) if d > _NAMED * np.abs(direction).max()]
            lines.append(f"{', '.join(among)} have the same effect: only a combination of them is determined")
        if len(S) < len(rest):
            lines.append(f"{len(S)} values are measured for {len(rest)} parameters")
    return tuple(lines)


def select_parameters(model: LinearModel, parameters: Sequence[str] | None) -> tuple[str, ...]:
    """Given parameters, checked; by default those that are not zero."""
    if parameters is None:
        return tuple(n for n, v in model.parameters.items() if v != 0.0)
    if isinstance(parameters, str) or not len(parameters):
        raise ModelError(f"parameters is a list of names; found {parameters!r}.")
    if missing := [n for n in parameters if n not in model.parameters]:
        raise ModelError(f"'{model.name}' has no parameter {', '.join(missing)}; it has {', '.join(model.parameters)}.")
    return tuple(dict.fromkeys(parameters))


def sensitivities(
    model: LinearModel, names: tuple[str, ...], u: np.ndarray, dt: float, noise: Mapping[str, float], hold: Hold
) -> np.ndarray:
    """Of the measured outputs over their noise, (b, n * outputs, k), for inputs (b, n, ni)."""
    if missing := [o for o in noise if o not in model.outputs]:
        raise ModelError(f"'{model.name}' has no output {', '.join(missing)}; it has {', '.join(model.outputs)}.")
    if not noise or any(not (std > 0.0 and np.isfinite(std)) for std in noise.values()):
        raise ModelError(f"the information needs noise above zero on at least one output; found {dict(noise)}.")
    columns = [model.outputs.index(o) for o in noise]
    family = model.family.keep(names, model.theta)
    theta = np.array([model.parameters[n] for n in names])
    S = family.sensitivities(theta, u, dt, hold=hold)[:, :, columns]
    S /= np.array(list(noise.values()))[:, None]
    return S.reshape(len(u), -1, len(names))
