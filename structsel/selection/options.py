"""What may be asked of a selection, checked before any data is touched."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from structsel.errors import SelectionError

Method = Literal["stepwise", "orthogonal", "best_subset"]
Residuals = Literal["coloured", "robust", "white"]
Criterion = Literal["PSE", "BIC", "AICc", "adj_R2", "manoeuvre"]
Estimate = Literal["least_squares", "principal_components", "ridge"]
Components = Literal["variance", "PSE", "manoeuvre"] | int
Stop = Literal["F", "R2", "PSE"]
Start = Literal["empty", "linear", "all"]

DEFAULT_CRITERION: dict[str, Criterion | None] = {"stepwise": None, "orthogonal": "PSE", "best_subset": "BIC"}


@dataclass(frozen=True)
class Options:
    """How to select; see `select` for what each means."""

    method: Method = "stepwise"
    residuals: Residuals = "coloured"
    F_in: float | Literal["auto", "fdr"] = 4.0
    F_out: float | None = None
    start: Start = "empty"
    stop: Stop = "F"
    r2_change: float = 0.005
    criterion: Criterion | None = None
    sigma_max: Literal["response", "residual"] | float = "response"
    order: Literal["greedy", "given"] = "greedy"
    estimate: Estimate = "least_squares"
    components: Components = "variance"
    correlation_limit: float | None = None
    max_terms: int | None = None
    bootstrap: int = 200
    max_order: int = 24
    seed: int = 0
    workers: int | None = None

    def __post_init__(self) -> None:
        """Refuse what cannot be meant."""
        for name, allowed in (
            ("method", get_args(Method)),
            ("residuals", get_args(Residuals)),
            ("start", get_args(Start)),
            ("stop", get_args(Stop)),
            ("criterion", (None, *get_args(Criterion))),
            ("order", ("greedy", "given")),
            ("estimate", get_args(Estimate)),
        ):
            if getattr(self, name) not in allowed:
                choices = ", ".join(repr(a) for a in allowed)
                raise SelectionError(f"select: {name}={getattr(self, name)!r} is not one of {choices}.")
        if isinstance(self.F_in, str):
            if self.F_in not in ("auto", "fdr"):
                raise SelectionError(f"select: F_in={self.F_in!r}; give a number, 'auto' or 'fdr'.")
        elif not self.F_in > 0:
            raise SelectionError(f"select: F_in must be above zero, not {self.F_in}.")
        elif self.F_out is not None and self.F_out > self.F_in:
            raise SelectionError(
                f"select: F_out={self.F_out:g} is above F_in={self.F_in:g}: a term whose partial F lies between the "
                "two would enter and leave for ever. Lower F_out or raise F_in."
            )
        if self.F_out is not None and self.F_out < 0:
            raise SelectionError(f"select: F_out must not be negative, got {self.F_out:g}.")
        if isinstance(self.sigma_max, str):
            if self.sigma_max not in ("response", "residual"):
                raise SelectionError(f"select: sigma_max={self.sigma_max!r}; give 'response', 'residual' or a number.")
        elif not self.sigma_max > 0:
            raise SelectionError(f"select: sigma_max must be above zero, not {self.sigma_max}.")
        if isinstance(self.components, str) and self.components not in ("variance", "PSE", "manoeuvre"):
            raise SelectionError(
                f"select: components={self.components!r}; give 'variance', 'PSE', 'manoeuvre' or a number."
            )
        if isinstance(self.components, int) and self.components < 1:
            raise SelectionError(f"select: components must be 1 or more, not {self.components}.")
        if self.correlation_limit is not None and not 0 < self.correlation_limit < 1:
            raise SelectionError(
                f"select: correlation_limit={self.correlation_limit} must lie between 0 and 1 (0.9 is usual)."
            )
        for name, least in (("bootstrap", 0), ("max_order", 0), ("max_terms", 1)):
            value = getattr(self, name)
            if value is not None and value < least:
                raise SelectionError(f"select: {name} must be {least} or more, not {value}.")

    @property
    def rule(self) -> Criterion | None:
        """The criterion in force: the one asked for, or the method's own; None where F-tests decide."""
        return self.criterion if self.criterion is not None else DEFAULT_CRITERION[self.method]
