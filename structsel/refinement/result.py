"""Result of a refinement: estimates, their standard errors, and warnings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from structsel.deprecation import renamed_attribute
from structsel.formatting import count_of
from structsel.metrics import MetricValues, compute_metrics, in_tables
from structsel.numerics.global_search import GlobalSearch
from structsel.recording import Recording
from structsel.results import Result
from structsel.tables import Cell, Column, Summary, Table, text_column

CORRELATED = 0.9  # correlation of two estimates above which a warning names them


_PER_RECORDING = ("start", "jump", "drift", "bias")


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


@dataclass(frozen=True, eq=False, repr=False)
class Refinement(Result):
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
        self.freeze()

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

    def summary(self) -> Summary:
        """Estimates with their errors, and the fit of every output."""
        count = len(self.simulated)
        facts = [("steps", str(len(self.costs) - 1)), ("J", f"{self.costs[0]:.6g} to {self.costs[-1]:.6g}")]
        if self.search is not None:
            generations = f"{len(self.search.costs)} generations, {self.search.evaluations} simulations"
            facts.insert(0, ("global search", f"{generations}, J {self.search.cost:.6g}"))
        return Summary(
            self.title,
            f"cost '{self.cost}', {count_of(count, 'recording')}, {count_of(len(self.estimates), 'parameter')}, "
            + ("converged" if self.converged else "NOT CONVERGED"),
            alerts=() if self.converged else (f"{self.message}; the best estimates found are given",),
            facts=tuple(facts),
            tables=tuple(table for table in (*self._estimate_tables(), self._fit_table()) if table.rows),
            warnings=self.doubts,
        )

    def _estimate_tables(self) -> Iterator[Table]:
        """Parameters of the model, then those of single recordings."""
        marks = (Column("95 % low"), Column("95 % high"), Column("start"), text_column(""))
        numbers = (Column("value"), Column("std error", "2g"), Column("CRLB", "2g"))
        rows = tuple(
            (e.name, *_numbers(e), e.value - 1.96 * e.std, e.value + 1.96 * e.std, e.start, _at_bound(e))
            for e in self.estimates
            if e.kind not in _PER_RECORDING
        )
        yield Table((text_column("parameter"), *numbers, *marks), rows)
        own = [e for e in self.estimates if e.kind in _PER_RECORDING]
        parts = [e.name.split(":", 2) for e in own]  # start:m01:w
        each = ((f"{kind} {what}", name, *_numbers(e), _at_bound(e)) for e, (kind, name, what) in zip(own, parts))
        yield Table((text_column("of"), text_column("recording"), *numbers, text_column("")), tuple(each))

    def _fit_table(self) -> Table:
        columns = (text_column("output"), text_column("recording"), Column("n"), Column("rms", "3g"))
        fits = sorted(self.fits, key=lambda f: [*self.noise_std].index(f.output))
        rows = tuple((f.output, f.recording, f.n, f.rms_error, *f.cells()) for f in fits)
        return Table((*columns, *(Column(m.label) for m in in_tables(brief=True))), rows)


def _numbers(estimate: Estimate) -> tuple[float, float, float]:
    return estimate.value, estimate.std, estimate.std_white


def _at_bound(estimate: Estimate) -> Cell:
    return Cell("at its bound" * estimate.at_bound, "warning")


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
