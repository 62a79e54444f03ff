"""Result of a refinement: estimates, their standard errors, and warnings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from structsel.deprecation import renamed_attribute
from structsel.formatting import count_of
from structsel.metrics import MetricValues, compute_metrics, in_tables
from structsel.numerics.global_search import GlobalSearch
from structsel.recording import Recording
from structsel.refinement.held_out import HeldOutComparison, Verdict
from structsel.results import Estimates
from structsel.tables import Cell, Column, Summary, Table, text_column

if TYPE_CHECKING:
    import pandas as pd

_PER_RECORDING = ("start", "jump", "drift", "bias")


@dataclass(frozen=True)
class Estimate:
    """One parameter.

    Attributes
    ----------
    name : str
    kind : str
        As `Parameter.kind`; ``"held"`` for a parameter of the model that was not estimated.
    value : float
    std : float
        With the autocorrelation of the residuals; infinite where the recordings do not determine it. Of a held
        parameter that of the model before, NaN where it is not known.
    std_white : float
        The Cramer-Rao bound; NaN for a held parameter.
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
class Refinement(Estimates):
    """Parameters of a model, refined on complete recordings by output error or filter error.

    `converged` tells how the search ended, `verdict` whether the refined model predicts recordings that were held out
    better than the original. Neither follows from the other.

    Attributes
    ----------
    model : LinearStructure or AeroModel
        The model to use: the refined one, or the original where the verdict is "worse", unless ``keep_worse=True``.
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
    refined, original : LinearStructure or AeroModel
        With the parameters found, and as it was given.
    held : tuple of Estimate
        Parameters of the model that were not estimated, of kind "held", with their errors before the refinement.
    comparison : HeldOutComparison or None
        Errors on the recordings held out; None without any.
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
    refined: Any = None
    original: Any = None
    held: tuple[Estimate, ...] = ()
    comparison: HeldOutComparison | None = None

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

    def _estimates(self) -> tuple[tuple[str, ...], np.ndarray, np.ndarray, float]:
        return self.names, self.values, self.std, np.inf

    @property
    def verdict(self) -> Verdict:
        """Better, no better or worse than the original model on held-out recordings; or not validated."""
        return "not validated" if self.comparison is None else self.comparison.verdict

    @property
    def statement(self) -> str:
        """The verdict with its numbers."""
        return state_verdict(self.comparison)

    @property
    def title(self) -> str:
        """Name of the method."""
        if self.band is not None:
            return f"Output error from {self.band[0]:g} to {self.band[1]:g} Hz"
        return "Filter error" if self.noise == "process" else "Output error"

    def history(self) -> pd.DataFrame:
        """One row for each step: step, cost, and every parameter."""
        import pandas as pd

        frame = pd.DataFrame(self.thetas, columns=list(self.names))
        frame.insert(0, "cost", self.costs)
        frame.insert(0, "step", np.arange(len(self.costs)))
        return frame

    def to_frame(self) -> pd.DataFrame:
        """One row for each parameter, the held ones (kind "held") last.

        Columns: name, kind, value, std, std_white, low95, high95, start, low, high, at_bound.
        """
        import pandas as pd

        return pd.DataFrame(_records((*self.estimates, *self.held)))

    def to_dict(self) -> dict[str, Any]:
        """Everything but the samples."""
        return {
            "schema": "structsel.refinement/1",
            "verdict": self.verdict,
            "statement": self.statement,
            "comparison": None if self.comparison is None else self.comparison.to_dict(),
            "model": str(getattr(self.model, "name", "")),
            "cost": self.cost,
            "noise": self.noise,
            "domain": self.domain,
            "band": None if self.band is None else list(self.band),
            "converged": self.converged,
            "message": self.message,
            "doubts": list(self.doubts),
            "parameters": _records(self.estimates),
            "held": _records(self.held),
            "noise_std": dict(self.noise_std),
            "fits": [fit.to_dict() for fit in self.fits],
            "costs": self.costs.tolist(),
            "generations": [] if self.search is None else self.search.costs.tolist(),
            "recordings": [r.name for r in self.simulated],
        }

    def summary(self) -> Summary:
        """Verdict, estimates with their errors, held parameters, and the fit of every output."""
        kept = "The original model is kept."
        alerts = (kept,) if self.verdict == "worse" and self.model is not self.refined else ()
        return Summary("Refinement", self.statement, alerts=alerts, parts=(self._search_summary(),))

    def _search_summary(self) -> Summary:
        """How the search ended, and what it found."""
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
            tables=tuple(
                table for table in (*self._estimate_tables(), self._fit_table(), self._held_table()) if table.rows
            ),
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

    def _held_table(self) -> Table:
        """Parameters of the model that were not estimated."""
        rows = tuple((f"{e.name} (held)", e.value, e.std) for e in self.held)
        note = "(held): not estimated; value and error are those of the model before." if rows else ""
        return Table(
            (text_column("parameter"), Column("value"), Column("std error", "2g")), rows, "Held parameters", note=note
        )

    def _fit_table(self) -> Table:
        columns = (text_column("output"), text_column("recording"), Column("n"), Column("rms", "3g"))
        fits = sorted(self.fits, key=lambda f: [*self.noise_std].index(f.output))
        rows = tuple((f.output, f.recording, f.n, f.rms_error, *f.cells()) for f in fits)
        return Table((*columns, *(Column(m.label) for m in in_tables(brief=True))), rows)


def state_verdict(comparison: HeldOutComparison | None) -> str:
    """Verdict with its numbers, as it is written into the model and its exports."""
    if comparison is None:
        return "not validated (no recordings were held out)"
    where = "" if comparison.verdict == "not validated" else " on held-out recordings"
    return f"{comparison.verdict}{where} ({comparison.reason})"


def _records(estimates: tuple[Estimate, ...]) -> list[dict[str, Any]]:
    return [
        {"name": e.name, "kind": e.kind, "value": e.value, "std": e.std, "std_white": e.std_white,
         "low95": e.value - 1.96 * e.std, "high95": e.value + 1.96 * e.std, "start": e.start, "low": e.low,
         "high": e.high, "at_bound": e.at_bound}
        for e in estimates
    ]  # fmt: skip


def _numbers(estimate: Estimate) -> tuple[float, float, float]:
    return estimate.value, estimate.std, estimate.std_white


def _at_bound(estimate: Estimate) -> Cell:
    return Cell("at its bound" * estimate.at_bound, "warning")
