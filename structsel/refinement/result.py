"""Result of a refinement: estimates, their standard errors, and warnings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd

from structsel.deprecation import renamed_attribute
from structsel.metrics import MetricValues, compute_metrics, in_tables
from structsel.numerics.global_search import GlobalSearch
from structsel.recording import Recording
from structsel.rich_text import opening, to_html

CORRELATED = 0.9  # correlation of two estimates above which a warning names them


@dataclass(frozen=True)
class Estimate:
    """One parameter.

    Attributes
    ----------
    name, kind : str
    value : float
    std : float
        With the autocorrelation of the residuals; infinite where the recordings do not determine it.
    std_white : float
        The Cramer-Rao bound.
    start, low, high : float
        Start value of the search, and its bounds.
    at_bound : bool
    """

    name: str
    kind: str
    value: float
    std: float
    std_white: float
    start: float
    low: float
    high: float
    at_bound: bool


@dataclass(frozen=True, kw_only=True)
class OutputFit(MetricValues):
    """Metrics of one output of one recording.

    Attributes
    ----------
    recording, output : str
    n : int
        Samples.
    metrics : mapping of str to float
        By name, also as attributes: ``fit.rms_error`` in the unit of the output, ``fit.r2``, ``fit.tic``.
    """

    recording: str
    output: str
    n: int

    rms = renamed_attribute("rms_error")

    def to_dict(self) -> dict[str, Any]:
        """Return the fit as one flat row; ``rms`` is the old name of ``rms_error``."""
        return {
            "recording": self.recording, "output": self.output, "n": self.n, "rms": self.rms_error, **self.metrics
        }  # fmt: skip


def compare_output(recording: str, output: str, measured: np.ndarray, modelled: np.ndarray) -> OutputFit:
    """Fit of one output, over the samples there are."""
    sampled = np.isfinite(measured)
    values = compute_metrics(measured[sampled], modelled[sampled], undefined="nan")
    return OutputFit(recording=recording, output=output, n=int(sampled.sum()), metrics=values)


@dataclass(frozen=True, eq=False)
class Refinement:
    """Parameters of a model, refined on complete recordings by output error or filter error.

    Attributes
    ----------
    model : LinearStructure or AeroModel
        With the parameters found.
    estimates : tuple of Estimate
    crlb, covariance : (k, k) array
        As `structsel.numerics.output_error.OutputErrorFit` has them.
    correlation : (k, k) array
    noise_std : mapping of output to float
        Standard deviation of the residuals.
    fits : tuple of OutputFit
        By recording and output.
    simulated : tuple of Recording
        The recordings with the model's outputs in place of the measured ones.
    residuals : mapping of recording to mapping of output to (n,) array
        Measured less simulated.
    cost : {"ml", "weighted"}
    costs : (i,) array
        At the start of the descent and after each step.
    thetas : (i, k) array
    converged : bool
    message : str
        How the search ended.
    search : GlobalSearch or None
        The global search before the local one.
    doubts : tuple of str
    noise : {"measurement", "process"}
        Output error, or filter error: residuals are then innovations, simulated outputs those expected of each
        sample, and costs and thetas those of all rounds of the iteration of the measurement noise.
    domain : {"time", "frequency"}
        In the frequency domain residuals are complex, of the scaled transforms; `fits` judge these, and the
        recordings are simulated from rest and have the measured means.
    band : (low, high) or None [Hz]
    """

    model: Any
    estimates: tuple[Estimate, ...]
    crlb: np.ndarray
    covariance: np.ndarray
    correlation: np.ndarray
    noise_std: Mapping[str, float]
    fits: tuple[OutputFit, ...]
    simulated: tuple[Recording, ...]
    residuals: Mapping[str, Mapping[str, np.ndarray]]
    cost: str
    costs: np.ndarray
    thetas: np.ndarray
    converged: bool
    message: str
    search: GlobalSearch | None = None
    doubts: tuple[str, ...] = ()
    noise: str = "measurement"
    domain: str = "time"
    band: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for array in (self.crlb, self.covariance, self.correlation, self.costs, self.thetas):
            array.setflags(write=False)
        held = {name: MappingProxyType(dict(each)) for name, each in self.residuals.items()}
        for each in held.values():
            for values in each.values():
                values.setflags(write=False)
        object.__setattr__(self, "residuals", MappingProxyType(held))
        object.__setattr__(self, "noise_std", MappingProxyType(dict(self.noise_std)))

    def __reduce__(self) -> tuple[Any, ...]:  # a mapping proxy does not pickle
        plain = dict(self.__dict__)
        plain["residuals"] = {name: dict(each) for name, each in self.residuals.items()}
        plain["noise_std"] = dict(self.noise_std)
        return _remake, (plain,)

    def __getitem__(self, name: str) -> Estimate:
        """One estimate by its name.

        Raises
        ------
        KeyError
            There is no estimate of that name.
        """
        for estimate in self.estimates:
            if estimate.name == name:
                return estimate
        raise KeyError(name)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the estimated parameters."""
        return tuple(e.name for e in self.estimates)

    @property
    def values(self) -> np.ndarray:
        """(k,) estimates."""
        return np.array([e.value for e in self.estimates])

    @property
    def std(self) -> np.ndarray:
        """(k,) standard deviations, with the autocorrelation of the residuals."""
        return np.array([e.std for e in self.estimates])

    @property
    def title(self) -> str:
        """Name of the method."""
        if self.band is not None:
            return f"Output error from {self.band[0]:g} to {self.band[1]:g} Hz"
        return "Filter error" if self.noise == "process" else "Output error"

    def history(self) -> pd.DataFrame:
        """One row for each step: step, cost, and every parameter."""
        frame = pd.DataFrame(self.thetas, columns=list(self.names))
        frame.insert(0, "cost", self.costs)
        frame.insert(0, "step", np.arange(len(self.costs)))
        return frame

    def to_frame(self) -> pd.DataFrame:
        """One row for each parameter: name, kind, value, std, std_white, low95, high95, start, low, high, at_bound."""
        rows = [
            {"name": e.name, "kind": e.kind, "value": e.value, "std": e.std, "std_white": e.std_white,
             "low95": e.value - 1.96 * e.std, "high95": e.value + 1.96 * e.std, "start": e.start, "low": e.low,
             "high": e.high, "at_bound": e.at_bound}
            for e in self.estimates
        ]  # fmt: skip
        return pd.DataFrame(rows)

    def to_dict(self) -> dict[str, Any]:
        """Everything but the samples."""
        return {
            "schema": "structsel.refinement/1",
            "model": str(getattr(self.model, "name", "")),
            "cost": self.cost,
            "noise": self.noise,
            "domain": self.domain,
            "band": None if self.band is None else list(self.band),
            "converged": self.converged,
            "message": self.message,
            "doubts": list(self.doubts),
            "parameters": self.to_frame().to_dict("records"),
            "noise_std": dict(self.noise_std),
            "fits": [fit.to_dict() for fit in self.fits],
            "costs": self.costs.tolist(),
            "generations": [] if self.search is None else self.search.costs.tolist(),
            "recordings": [r.name for r in self.simulated],
        }

    def __str__(self) -> str:
        ended = "converged" if self.converged else "NOT CONVERGED"
        steps = len(self.costs) - 1
        lines = [
            f"{self.title}, cost '{self.cost}', {len(self.simulated)} recording"
            f"{'s' if len(self.simulated) != 1 else ''}, {len(self.estimates)} parameters: {ended}"
        ]
        if not self.converged:
            lines.append(f"  ! {self.message}; the values are the best found")
        if self.search is not None:
            count = len(self.search.costs)
            lines.append(
                f"  global search: {count} generations, {self.search.evaluations} simulations, J {self.search.cost:.6g}"
            )
        lines.append(f"  local search: {steps} steps, J {self.costs[0]:.6g} to {self.costs[-1]:.6g}")
        wide = max(len(name) for name in self.names)
        lines += ["", f"  {'':<{wide}}{'value':>13}{'std':>11}{'CRLB':>11}{'start':>13}"]
        for e in self.estimates:
            mark = "  at its bound" if e.at_bound else ""
            lines.append(f"  {e.name:<{wide}}{e.value:>13.5g}{e.std:>11.2g}{e.std_white:>11.2g}{e.start:>13.5g}{mark}")
        lines.append("")
        for f in self.fits:
            named = zip((metric.label for metric in in_tables(brief=True)), f.cells(brief=True))
            values = ", ".join(f"{label} {cell}" for label, cell in named)
            lines.append(f"  {f.recording} {f.output:<7} rms {f.rms_error:.3g}, {values}")
        lines += [f"  ! {text}" for text in self.doubts]
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"<Refinement: {', '.join(self.names)}; {'converged' if self.converged else 'not converged'}>"

    def _repr_html_(self) -> str:
        return to_html(self.to_frame(), opening(self), self.doubts)


def _remake(plain: dict[str, Any]) -> Refinement:
    return Refinement(**plain)


def check_estimates(
    estimates: tuple[Estimate, ...], correlation: np.ndarray, converged: bool, message: str
) -> tuple[str, ...]:
    """Warnings about estimates and their search."""
    found = [] if converged else [f"the search did not converge: {message}"]
    for e in estimates:
        if e.kind == "process" and e.at_bound:
            state = e.name.rsplit(":", 1)[1]
            found.append(
                f"process noise of {state} at its upper bound: the filter takes {state} from the measurements"
                if e.value > 0.5 * e.high
                else f"process noise of {state} at its lower bound: none is needed there"
            )
    bounded = [e for e in estimates if e.at_bound and e.kind != "process"]
    if bounded:
        named = ", ".join(f"{e.name} = {e.value:.5g}" for e in bounded)
        found.append(f"at a bound, beyond which the cost may be lower: {named}")
    lost = [e.name for e in estimates if np.isinf(e.std) and not (e.kind == "process" and e.at_bound)]
    if lost:
        found.append(f"these recordings do not determine {', '.join(lost)}")
    weak = [e for e in estimates if e.kind == "model" and np.isfinite(e.std) and e.std > 0.5 * abs(e.value)]
    if weak:
        named = ", ".join(f"{e.name} ({e.value:.3g} +- {e.std:.2g})" for e in weak)
        found.append(f"the outputs hardly depend on {named}: hold them, or record an input that excites them")
    idle = np.array([e.kind == "process" and e.at_bound for e in estimates])
    strong = np.argwhere(np.triu((np.abs(correlation) > CORRELATED) & ~idle & ~idle[:, None], 1))
    order = sorted(strong.tolist(), key=lambda pair: -abs(correlation[pair[0], pair[1]]))
    for i, j in order[:10]:
        found.append(
            f"{estimates[i].name} and {estimates[j].name} are correlated: {correlation[i, j]:+.3f}; these "
            "recordings hardly distinguish them"
        )
    if len(order) > 10:
        found.append(f"{len(order) - 10} more pairs are correlated above {CORRELATED:g}")
    of_interest = [e for e in estimates if e.kind != "process"]
    ratio = [e.std / e.std_white for e in of_interest if np.isfinite(e.std) and e.std_white > 0.0]
    if ratio and max(ratio) > 2.0:
        found.append(
            f"residuals are coloured: standard deviations are up to {max(ratio):.1f} times the Cramer-Rao bound; "
            "a missing term of the model, or turbulence, is in them"
        )
    return tuple(found)
