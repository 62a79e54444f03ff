"""Result of a reconstruction: path, constants with standard errors, and checks of its consistency."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from structsel.formatting import format_number
from structsel.nomenclature import BODY_RATES, SPECIFIC_FORCES
from structsel.reconstruction.delays import Delay
from structsel.reconstruction.innovations import Consistency
from structsel.reconstruction.observability import Reconstructibility
from structsel.recording import Finding, Recording
from structsel.results import Result
from structsel.tables import Column, Summary, Table, text_column

if TYPE_CHECKING:
    import pandas as pd

CONSTANTS = {
    **{f"b{c}": (f"bias of {c}", "m/s^2") for c in SPECIFIC_FORCES},
    **{f"b{c}": (f"bias of {c}", "rad/s") for c in BODY_RATES},
    "wn": ("wind, the air moving north", "m/s"),
    "we": ("wind, the air moving east", "m/s"),
    "wd": ("wind, the air moving down", "m/s"),
    "Cup": ("upwash at the angle-of-attack vane, scale", "-"),
    "Calpha0": ("angle-of-attack vane, offset", "rad"),
    "Csi": ("sidewash at the sideslip vane, scale", "-"),
    "Cbeta0": ("sideslip vane, offset", "rad"),
    "KV": ("airspeed, scale error", "-"),
    **{f"K{c}": (f"scale error of {c}", "-") for c in ("phi", "theta", *SPECIFIC_FORCES, *BODY_RATES)},
}
"""Meaning and unit of the constants of a manoeuvre."""

ESTIMATED_ONLY = "consistent with estimated noise only"
"""Beginning of a reason that concerns the estimated noise: NIS outside its band, or noise above its upper limit."""


@dataclass(frozen=True)
class Constant:
    """A bias, a wind component or a correction of a vane; for a bias, reading = true value + bias.

    Attributes
    ----------
    name, unit : str
    value, std : float
        At the end of the recording, if it drifts. The standard deviation includes the autocorrelation of the residuals.
    std_white : float
        Standard deviation of the filter, for white innovations.
    """

    name: str
    value: float
    std: float
    std_white: float
    unit: str


@dataclass(frozen=True)
class NoiseLevel:
    """Standard deviation of one channel's noise, and whether it was ``"given"`` or ``"estimated"``."""

    channel: str
    std: float
    unit: str
    source: str


@dataclass(frozen=True, eq=False, repr=False)
class Reconstruction(Result):
    """A consistent flight path, the errors of the instruments, and checks of both.

    Attributes
    ----------
    name, method : str
    recording : Recording
        At the centre of gravity, without biases: u v w V alpha beta, the estimated attitude and position,
        ax ay az p q r, the derivatives V_dot alpha_dot beta_dot (from the kinematics) and p_dot q_dot r_dot
        (smoothed), and all other channels unchanged.
    states : tuple of str
        Estimated states.
    constants : tuple of Constant
    std : mapping of str to (n,) array
        Standard deviations of the reconstructed channels.
    estimates, filtered, filtered_std : (n, L) array
        All states, smoothed; filtered are those from the samples up to each time.
    covariance : (c, L, L) array
        Of the states, at the samples `covariance_at`; these are all samples unless the recording is very long.
    innovations, innovation_std, residuals : mapping of str to (n,) array
        By measured channel: reading minus prediction and its predicted standard deviation, and reading minus
        reconstruction; NaN where there is no reading.
    readings : mapping of str to (n,) array
        Reading of each instrument without errors.
    noise : tuple of NoiseLevel
    gust : (float, float, float) [m/s]
        Standard deviation of the estimated turbulence along x, y and z. u v w V alpha beta include it; the kinematic
        V_dot alpha_dot beta_dot are those of calm air.
    gust_time : float [s]
        Correlation time of the turbulence.
    turning_std : mapping of str to float [rad/s^2]
        Standard deviations of p_dot, q_dot, r_dot.
    consistency : Consistency
    reconstructibility : Reconstructibility
    fixed : mapping of str to str
        States that these data cannot determine, and that were not estimated, with the reasons.
    delays : tuple of Delay
        Of each air-data and attitude channel, after the alignment if there was one.
    log_likelihood : float
    findings : tuple of Finding
        Samples that were not used or interpolated.
    doubts, distrust : tuple of str
        Warnings; and reasons not to use the result.
    """

    name: str
    method: str
    recording: Recording
    states: tuple[str, ...]
    constants: tuple[Constant, ...]
    std: Mapping[str, np.ndarray]
    estimates: np.ndarray
    filtered: np.ndarray
    filtered_std: np.ndarray
    covariance: np.ndarray
    covariance_at: np.ndarray
    innovations: Mapping[str, np.ndarray]
    innovation_std: Mapping[str, np.ndarray]
    residuals: Mapping[str, np.ndarray]
    readings: Mapping[str, np.ndarray]
    noise: tuple[NoiseLevel, ...]
    gust: tuple[float, float, float]
    gust_time: float
    turning_std: Mapping[str, float]
    consistency: Consistency
    reconstructibility: Reconstructibility
    fixed: Mapping[str, str] = field(default_factory=dict)
    delays: tuple[Delay, ...] = ()
    log_likelihood: float = field(default=float("nan"))
    findings: tuple[Finding, ...] = ()
    doubts: tuple[str, ...] = ()
    distrust: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self.freeze()

    @property
    def trusted(self) -> bool:
        """Whether there is no reason not to use the result."""
        return not self.distrust

    @property
    def verdict(self) -> str:
        """``"trusted"``, ``"NOT TRUSTED"``, or ``"consistent with estimated noise only"`` if only that is in doubt."""
        if self.distrust and all(reason.startswith(ESTIMATED_ONLY) for reason in self.distrust):
            return ESTIMATED_ONLY
        return "NOT TRUSTED" if self.distrust else "trusted"

    def __getitem__(self, name: str) -> Constant:
        """One constant by its name.

        Raises
        ------
        KeyError
            When it was not estimated.
        """
        for constant in self.constants:
            if constant.name == name:
                return constant
        raise KeyError(name)

    def nees(self, truth: Mapping[str, np.ndarray | float]) -> np.ndarray:
        """Normalised estimation error squared, e' P^-1 e, against a known truth.

        Parameters
        ----------
        truth : mapping of str to (n,) array or float
            Every state's true value.

        Returns
        -------
        (c,) array [-]
            At the samples `covariance_at`; chi-squared with as many degrees of freedom as there are states, were
            the filter right.
        """
        n = len(self.recording)
        true = np.stack([np.broadcast_to(truth[name], n) for name in self.states], axis=1)
        error = (self.estimates - true)[self.covariance_at]
        solved = np.linalg.solve(self.covariance, error[:, :, None])[:, :, 0]
        return np.sum(error * solved, axis=1)

    def to_frame(self) -> pd.DataFrame:
        """One row for each constant: name, value, std, std_white, unit, meaning."""
        import pandas as pd

        rows = [
            {"name": c.name, "value": c.value, "std": c.std, "std_white": c.std_white, "unit": c.unit,
             "meaning": CONSTANTS[c.name][0]}
            for c in self.constants
        ]  # fmt: skip
        return pd.DataFrame(rows, columns=["name", "value", "std", "std_white", "unit", "meaning"])

    def to_dict(self) -> dict[str, Any]:
        """Everything but the samples."""
        return {
            "schema": "structsel.reconstruction/1",
            "name": self.name,
            "method": self.method,
            "trusted": self.trusted,
            "verdict": self.verdict,
            "distrust": list(self.distrust),
            "doubts": list(self.doubts),
            "samples": len(self.recording),
            "states": list(self.states),
            "constants": self.to_frame().to_dict("records"),
            "fixed": dict(self.fixed),
            "noise": [level.__dict__ for level in self.noise],
            "gust": list(self.gust),
            "gust_time": self.gust_time if any(self.gust) else None,
            "turning_std": dict(self.turning_std),
            "consistency": {
                "nis": self.consistency.nis,
                "nis_band": list(self.consistency.nis_band),
                "channels": [c.to_dict() for c in self.consistency.channels],
            },
            "delays": [d.__dict__ for d in self.delays],
            "log_likelihood": self.log_likelihood,
            "findings": [f.to_dict() for f in self.findings],
            "provenance": list(self.recording.provenance),
        }

    def summary(self) -> Summary:
        """Verdict, constants, channels and warnings."""
        r, c = self.recording, self.consistency
        facts = [("NIS", f"{c.nis:.3f}"), ("95 % band", f"{c.nis_band[0]:.3f} to {c.nis_band[1]:.3f}")]
        if any(self.gust):
            stds = ", ".join(format_number(std, 2) for std in self.gust)
            facts.append(("turbulence", f"{stds} m/s along x, y, z, correlation time {self.gust_time:.2g} s"))
        reasons: dict[str, list[str]] = {}
        for name, reason in self.fixed.items():
            reasons.setdefault(reason, []).append(name)
        remarks = (str(f).removeprefix("note: ") for f in self.findings if f.severity == "note")
        return Summary(
            self.name,
            f"{len(r)} samples, {r.duration:.1f} s, {self.method}, {self.verdict}",
            alerts=self.distrust,
            facts=tuple(facts),
            tables=(*([self._constant_table()] if self.constants else []), self._channel_table()),
            notes=(*(f"not estimated: {', '.join(names)}: {reason}" for reason, names in reasons.items()), *remarks),
            warnings=self.doubts,
        )

    def _constant_table(self) -> Table:
        columns = (text_column("constant"), text_column("meaning"), Column("value"), Column("std", "2g"))
        rows = tuple((c.name, CONSTANTS[c.name][0], c.value, c.std, c.unit) for c in self.constants)
        return Table((*columns, text_column("unit")), rows)

    def _channel_table(self) -> Table:
        """Noise of every channel; residual and innovations of those that the filter was fitted to."""
        seen = {c.channel: c for c in self.consistency.channels}
        rows = []
        for level in sorted(self.noise, key=lambda level: level.channel not in seen):
            row: list[Any] = [level.channel, level.unit, level.std, level.source]
            if (c := seen.get(level.channel)) is not None:
                correlation = float(c.autocorrelation[0]) if len(c.autocorrelation) else None
                row += [c.residual_rms, c.variance, correlation, c.rejected]
            rows.append((*row, *[""] * (8 - len(row))))
        return Table(_CHANNEL_COLUMNS, tuple(rows))


COLUMN_NOTES = (
    "std: of the estimate, for coloured residuals; residual: rms of measured minus reconstructed; "
    "var. and corr.: of the normalised innovations, their variance (1 is right) and the correlation of neighbours "
    "(0 is right); rej.: samples rejected because they are outside the gate."
)
"""Explanation of the columns of a reconstruction."""
_CHANNEL_COLUMNS = (
    text_column("channel"),
    text_column("unit"),
    Column("noise", "3g"),
    text_column("source"),
    Column("residual", "3g"),
    Column("var.", "2f"),
    Column("corr.", "2f"),
    Column("rej."),
)
