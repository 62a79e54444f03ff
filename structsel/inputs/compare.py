"""Comparison of inputs at equal energy: their Cramer-Rao bounds, and estimates from repeated simulations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from structsel.errors import DomainError, ModelError
from structsel.formatting import count_of, format_number
from structsel.inputs import signals
from structsel.inputs.criteria import Criterion
from structsel.inputs.design import design_inputs, parameter_sizes
from structsel.inputs.information import Information, information, select_parameters
from structsel.inputs.mehra_schulz import mehra, schulz
from structsel.inputs.multisine import multisine
from structsel.inputs.settings import InputOptions
from structsel.numerics.output_error import fit_output_error
from structsel.numerics.output_error_problem import OutputErrorProblem
from structsel.options import takes_options
from structsel.recording import Recording
from structsel.recording.arguments import require_kind
from structsel.results import Result
from structsel.simulation.linear import LinearModel
from structsel.tables import Column, Summary, Table, table_of_frame, text_column

if TYPE_CHECKING:
    import pandas as pd

_WIDTHS = 24  # tried for each kind of pulses


_TOGETHER = 5  # parameters in one table


@dataclass(frozen=True, eq=False, repr=False)
class InputComparison(Result):
    """Inputs of equal energy and their information.

    Attributes
    ----------
    parameters : tuple of str
    sizes : (k,) array
        Unit of the error of each parameter.
    energy : float
    inputs : tuple of Recording
    found : tuple of Information
        One per input.
    """

    parameters: tuple[str, ...]
    sizes: np.ndarray
    energy: float
    inputs: tuple[Recording, ...]
    found: tuple[Information, ...]

    def to_frame(self) -> pd.DataFrame:
        """One row per input: largest amplitude, A (trace of the scaled covariance), D (its k-th root det), bounds.

        The columns ``std_<parameter>`` are in the parameter's unit; nan where the input does not determine all
        parameters.
        """
        import pandas as pd

        rows = []
        for u, info in zip(self.inputs, self.found):
            scaled = info.covariance / np.outer(self.sizes, self.sizes)
            finite = np.isfinite(scaled).all()
            rows.append(
                {
                    "input": u.name,
                    "peak": max(float(np.abs(u[c]).max()) for c in u.names),
                    "A": float(np.trace(scaled)),
                    "D": float(np.exp(np.linalg.slogdet(scaled)[1] / len(self.parameters))) if finite else np.nan,
                    **{f"std_{p}": s for p, s in zip(self.parameters, info.crlb)},
                }
            )
        return pd.DataFrame(rows)

    def ratios(self, to: str = "optimal A") -> pd.DataFrame:
        """Bounds over those of one input, one row per input and one column per parameter.

        Raises
        ------
        ModelError
            No input of that name.
        """
        import pandas as pd

        names = [u.name for u in self.inputs]
        if to not in names:
            raise ModelError(f"there is no input '{to}'; there are {', '.join(names)}.")
        bounds = np.array([info.crlb for info in self.found])
        return pd.DataFrame(bounds / bounds[names.index(to)], index=names, columns=list(self.parameters))

    def to_dict(self) -> dict[str, Any]:
        """Plain types, for JSON."""
        return {"energy": self.energy, "inputs": [info.to_dict() for info in self.found]}

    def summary(self) -> Summary:
        """Cramer-Rao bounds of each input in percent of the parameters; in tables of five parameters."""
        records = self.to_frame().to_dict("records")
        tables = []
        for first in range(0, len(self.parameters), _TOGETHER):
            names, sizes = (each[first : first + _TOGETHER] for each in (self.parameters, self.sizes))
            columns = (text_column("input"), *(Column(name, "3g") for name in ("peak", "A", "D", *names)))
            rows = (
                (r["input"], r["peak"], r["A"], r["D"], *(100.0 * r[f"std_{p}"] / s for p, s in zip(names, sizes)))
                for r in records
            )
            tables.append(Table(columns, tuple(rows)))
        scales = ", ".join(f"{p} {format_number(s)}" for p, s in zip(self.parameters, self.sizes))
        return Summary(
            "Inputs",
            f"energy {format_number(self.energy)} each",
            tables=tuple(tables),
            notes=(f"Cramer-Rao bounds in % of {scales}. A: sum of their squares. D: their volume.",),
            warnings=tuple(f"{u.name}: {line}" for u, i in zip(self.inputs, self.found) for line in i.unidentifiable),
        )


@takes_options(InputOptions)
def compare_inputs(
    model: LinearModel,
    *,
    noise: Mapping[str, float],
    energy: float,
    more: Sequence[Recording] = (),
    options: InputOptions,
) -> InputComparison:
    """Compare kinds of input at equal energy.

    Doublet, 3-2-1-1 and 2-1-1-1 with the best width (least A criterion), one input after the other
    where there are several; sweep, multisine, Mehra, Schulz; and optimal inputs by the A and the D criterion.

    Parameters
    ----------
    model, noise
        As `design_inputs` takes them.
    energy : float
        Integral of the squared inputs over their scales [s].
    more : sequence of Recording
        Other inputs to compare, on the same clock; scaled to the energy.
    options : InputOptions, optional
        Every field may be given as a keyword of its own instead.

    Returns
    -------
    InputComparison

    Raises
    ------
    ArgumentError, ModelError
        As `design_inputs`.
    """
    require_kind(model, LinearModel, "compare_inputs(model, noise=..., energy=...)")
    names = select_parameters(model, options.parameters)
    duration, dt, seed = options.duration, options.dt, options.seed
    sizes = parameter_sizes(model, names, options.parameter_scales)
    size = {c: (options.scales or {}).get(c, 1.0) for c in model.inputs}
    fastest = float(model.modes().frequency.max()) / (2.0 * np.pi)
    low, high = max(1.0 / duration, 0.1 * fastest), min(3.0 * fastest, 0.4 / dt)
    common: dict[str, Any] = {"noise": noise, "parameters": names, "energy": energy, "duration": duration, "dt": dt}

    def with_information(u: Recording) -> tuple[Recording, Information, float]:
        u = signals.with_energy(u, energy, size)
        info = information(model, u, noise=noise, parameters=names)
        A = float(np.trace(info.covariance / np.outer(sizes, sizes)))
        return u, info, A if np.isfinite(A) else np.inf

    def pulses(name: str, pattern: tuple[int, ...]) -> Recording:
        slot = (duration - dt) / len(size)
        units = sum(map(abs, pattern))
        widths = dt * np.unique(np.round(np.geomspace(dt, (slot - 2 * dt) / units, _WIDTHS) / dt))
        tried = []
        for width in widths[widths * units <= slot - dt]:
            one = [
                signals.multistep(c, s, pattern, width, start=dt + i * slot, duration=duration, dt=dt, name=name)
                for i, (c, s) in enumerate(size.items())
            ]
            tried.append(with_information(signals.combine(*one, name=name)))
        return min(tried, key=lambda item: item[2])[0]

    sweeps = [
        signals.frequency_sweep(c, s, low, high, start=i * duration / len(size) / 4, duration=duration, dt=dt)
        for i, (c, s) in enumerate(size.items())
    ]
    inputs = [
        pulses("doublet", (1, -1)),
        pulses("3-2-1-1", (3, -2, 1, -1)),
        pulses("2-1-1-1", (2, -1, 1, -1)),
        signals.combine(*sweeps, name="frequency sweep"),
        multisine(
            tuple(size),
            tuple(size.values()),
            low=low,
            high=high,
            period=signals.whole_steps(duration, dt),
            dt=dt,
            seed=seed,
        ),
        mehra(model, low=1.0 / duration, high=high, scales=size, seed=seed, **common),
        schulz(model, scales=size, parameter_scales=options.parameter_scales, **common),
    ]
    criteria: tuple[Criterion, ...] = ("A", "D")
    for criterion in criteria:
        made = design_inputs(
            model, criterion=criterion, basis=options.basis, functions=options.functions, scales=size,
            parameter_scales=options.parameter_scales, seed=seed, **common,
        )  # fmt: skip
        u = made.inputs
        inputs.append(Recording(f"optimal {criterion}", u.t, u.channels, u.units, u.provenance))
    done = [with_information(u) for u in [*inputs, *more]]
    return InputComparison(names, sizes, energy, tuple(u for u, _, _ in done), tuple(info for _, info, _ in done))


@dataclass(frozen=True, eq=False, repr=False)
class Scatter(Result):
    """Estimates from repeated simulations and the Cramer-Rao bound.

    Attributes
    ----------
    name : str
        Of the input.
    parameters : tuple of str
    truth : (k,) array
    estimates : (runs, k) array
    crlb : (k,) array
    lost : int
        Runs without an estimate, which are left out.
    """

    name: str
    parameters: tuple[str, ...]
    truth: np.ndarray
    estimates: np.ndarray
    crlb: np.ndarray
    lost: int

    @property
    def std(self) -> np.ndarray:
        """Standard deviation of the estimates, (k,)."""
        return self.estimates.std(axis=0, ddof=1)

    @property
    def bias(self) -> np.ndarray:
        """Mean of the estimates less the truth, (k,)."""
        return self.estimates.mean(axis=0) - self.truth

    def to_frame(self) -> pd.DataFrame:
        """One row per parameter; ``ratio_error`` is the sampling error of ``ratio``, one sigma."""
        import pandas as pd

        runs = len(self.estimates)
        return pd.DataFrame(
            {
                "parameter": self.parameters,
                "truth": self.truth,
                "bias": self.bias,
                "bias_error": self.std / np.sqrt(runs),
                "std": self.std,
                "crlb": self.crlb,
                "ratio": self.std / self.crlb,
                "ratio_error": 1.0 / np.sqrt(2.0 * (runs - 1)),
            }
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain types, for JSON."""
        return {"input": self.name, "runs": len(self.estimates), "parameters": self.to_frame().to_dict("records")}

    def summary(self) -> Summary:
        """Bias and scatter of the estimates, and the ratio to the bound."""
        lost = f", {self.lost} without an estimate" * bool(self.lost)
        about = f"{count_of(len(self.estimates), 'simulated recording')}{lost}"
        return Summary(self.name, about, tables=(table_of_frame(self.to_frame()),))


def scatter(
    model: LinearModel,
    inputs: Recording,
    *,
    noise: Mapping[str, float],
    parameters: Sequence[str] | None = None,
    runs: int = 500,
    seed: int = 0,
    estimate: Callable[[Recording], Sequence[float]] | None = None,
) -> Scatter:
    """Simulate the same input many times with new noise, estimate each time, and compare with the bound.

    Parameters
    ----------
    model : LinearModel
        The truth.
    inputs : Recording
    noise, parameters
        As `information` takes them.
    runs, seed : int
    estimate : callable, optional
        Takes the Recording of one simulation and returns the estimates of the parameters; by default output error with
        known noise by Gauss-Newton.

    Raises
    ------
    ModelError
        The input does not determine all parameters; the message names them.
    """
    names = select_parameters(model, parameters)
    info = information(model, inputs, noise=noise, parameters=names).require()
    truth = np.array([model.parameters[n] for n in names])
    flight = model.simulate(inputs)
    rng = np.random.default_rng(seed)
    clean = np.column_stack([flight[o] for o in noise])
    std = np.array(list(noise.values()))
    readings = clean + std * rng.standard_normal((runs, *clean.shape))
    if estimate is None:
        estimates = _output_error(model, names, inputs, readings, tuple(noise), std, truth)
    else:
        estimates = np.array(
            [np.asarray(estimate(flight.with_channels(**dict(zip(noise, y.T)))), dtype=float) for y in readings]
        )
    finite = np.isfinite(estimates).all(axis=1)
    if finite.sum() < 2:
        raise DomainError(f"scatter: {int(finite.sum())} of {runs} simulations gave an estimate. Check the estimator.")
    return Scatter(inputs.name, names, truth, estimates[finite], info.crlb, int((~finite).sum()))


def _output_error(
    model: LinearModel,
    names: tuple[str, ...],
    inputs: Recording,
    readings: np.ndarray,
    measured: tuple[str, ...],
    std: np.ndarray,
    truth: np.ndarray,
) -> np.ndarray:
    """(runs, k) estimates with known noise by Gauss-Newton from the truth; nan where it does not converge."""
    family = model.family.keep(names, model.theta)
    columns = [model.outputs.index(o) for o in measured]
    u = np.column_stack([inputs[c] for c in model.inputs])

    def predict(thetas: np.ndarray) -> np.ndarray:
        return family.simulate(thetas, u, inputs.dt)[:, :, columns]

    def estimate(y: np.ndarray) -> np.ndarray:
        problem = OutputErrorProblem(predict, y, R=std**2, cost="weighted")
        fit = fit_output_error(problem, truth, method="gauss-newton", iterations=30)
        return fit.theta if fit.converged else np.full(len(truth), np.nan)

    return np.array([estimate(y) for y in readings])
