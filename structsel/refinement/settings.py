"""Options of `refine`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from structsel.options import option
from structsel.simulation.atmosphere import Atmosphere

Names: TypeAlias = Iterable[str] | Literal["all"]
NoiseKind: TypeAlias = Literal["measurement", "process"]
Domain: TypeAlias = Literal["time", "frequency"]
Cost: TypeAlias = Literal["ml", "weighted"]
Method: TypeAlias = Literal["levenberg-marquardt", "gauss-newton"]
StabilityConstraint: TypeAlias = Literal["stable"] | Callable[[Mapping[str, np.ndarray]], np.ndarray]

_PARAMETERS, _COMPARISON, _SEARCH = "Estimated parameters", "Comparison", "Search"


@dataclass(frozen=True)
class RefineOptions:
    """What `refine` estimates, how it compares model and recordings, and how it searches.

    Attributes
    ----------
    free : iterable of str or "all"
        Parameters of the model to estimate; the others are held. Those of an AeroModel are called "Cm:alpha", the
        constant "Cm:1".
    outputs : iterable of str, optional
        Channels to fit; by default those outputs of the model that all recordings have.
    starts, drifts : iterable of state's name or "all"
        Per recording: states at the first sample, and constants in the state equations.
    biases : iterable of output's name or "all"
        Per recording: constant added to an output.
    references, scales : iterable of output's name or "all"
        Over all recordings: constant added to an output, and its scale factor.
    delay : bool or iterable of input's name
        Estimate one time delay, of all inputs or of these. A recorded thrust is delayed only where it is named.
    noise : {"measurement", "process"}
        ``"measurement"``: output error, for flights in calm air; the difference between model and recording is
        measurement noise. ``"process"``: filter error, for turbulence and a model with missing terms. The
        innovations are fed back through the steady gain of a Kalman filter, the process noise is estimated (its
        parameters are called ``"process:w"``, per root of a second), and residuals are innovations.
    process : iterable of state's name or "all"
        States with process noise; by default all that the outputs depend on.
    domain : {"time", "frequency"}
        ``"frequency"``, for linear models: output error of the Fourier transforms over the band. Constants are not
        estimated; ``starts`` then names states whose first and last values differ (``"jump:m01:w"``).
    band : (low, high) [Hz]
        With ``domain="frequency"``.
    guess : mapping of parameter's name to float, optional
        Start values of the search. By default the model's value; 1 for scale factors; 0 for constants, but the first
        readings for the references of a linear model.
    bounds : mapping of parameter's name to (low, high), optional
        A name that ends in a colon means all that begin so. The delay is bounded by zero and a quarter of the
        shortest recording unless given.
    constraint : "stable" or callable, optional
        ``"stable"``: no mode of a linear model is unstable. A callable takes parameters by name, (m,) each, and
        returns margins (m,) that must not be negative.
    cost : {"ml", "weighted"}
        Maximum likelihood with estimated noise covariance, or weighted residuals.
    weights : mapping of output to float, optional
        Standard deviations for the cost "weighted"; those of the measured channels where not given.
    full_noise : bool
        Estimate the correlation of the noise between outputs too.
    search : "global" or None
        Differential evolution between the bounds before the local search. The range of a model parameter without
        bounds is four times its start value, either sign; starts, drifts, biases and references without bounds are
        held in the global search.
    seed, population, generations : int
        Of the differential evolution.
    polish : int
        Number of best members of the last generation from which the local search starts; the lowest cost wins.
    method : {"levenberg-marquardt", "gauss-newton"}
        Of the local search.
    iterations : int
        Largest number of steps of the local search.
    tolerance : float
        Relative change of the parameters at which the local search has converged.
    keep_worse : bool
        The result's `model` is the refined one even if it predicts the held-out recordings worse than the original.
    air, definitions, substeps
        Of an AeroModel's simulation, as `structsel.simulation.simulate` takes them.
    """

    free: Names = option(
        "all", help="Parameters of the model; the others are held.", group=_PARAMETERS, metavar="NAMES"
    )
    outputs: Iterable[str] | None = option(
        None, help="Channels to fit; by default those that all recordings have.", group=_PARAMETERS, metavar="NAMES"
    )
    starts: Names = option((), help="States at the first sample, or all.", group=_PARAMETERS, metavar="NAMES")
    drifts: Names = option(
        (), help="Constants in a linear model's state equations.", group=_PARAMETERS, metavar="NAMES"
    )
    biases: Names = option((), help="Outputs with a bias per recording.", group=_PARAMETERS, metavar="NAMES")
    references: Names = option(
        (), help="Outputs with a constant over all recordings.", group=_PARAMETERS, metavar="NAMES"
    )
    scales: Names = option((), help="Outputs with a scale factor.", group=_PARAMETERS, metavar="NAMES")
    delay: bool | Iterable[str] = option(
        False, help="Inputs that are delayed, or all; one delay is estimated.", group=_PARAMETERS, metavar="NAMES"
    )
    noise: NoiseKind = option(
        "measurement", help="measurement: output error; process: filter error, for turbulence.", group=_COMPARISON
    )
    process: Names = option("all", help="States with process noise.", group=_COMPARISON, metavar="NAMES")
    domain: Domain = option("time", help="frequency: compare Fourier transforms, for linear models.", group=_COMPARISON)
    band: tuple[float, float] | None = option(
        None, help="Of --domain frequency, in Hz.", group=_COMPARISON, metavar="LOW,HIGH"
    )
    guess: Mapping[str, float] | None = option(
        None, help="Start values of the search.", group=_SEARCH, metavar="NAME=VALUE,..."
    )
    bounds: Mapping[str, tuple[float, float]] | None = option(
        None, help="Cm:alpha=-3,0; may be repeated.", group=_SEARCH, metavar="NAME=LOW,HIGH"
    )
    constraint: StabilityConstraint | None = option(None)
    cost: Cost = option("ml", help="ml: noise estimated; weighted: residuals weighted.", group=_SEARCH)
    weights: Mapping[str, float] | None = option(
        None, help="Standard deviations of outputs, for --cost weighted.", group=_SEARCH, metavar="NAME=STD,..."
    )
    full_noise: bool = option(False, help="Estimate the correlation of the noise between outputs.", group=_SEARCH)
    search: Literal["global"] | None = option(
        None, help="Differential evolution between the bounds first.", group=_SEARCH
    )
    seed: int = option(0, help="Of the differential evolution.", group=_SEARCH)
    population: int = option(8)
    generations: int = option(100, help="Of the differential evolution.", group=_SEARCH)
    polish: int = option(6)
    method: Method = option("levenberg-marquardt")
    iterations: int = option(60, help="Of the local search.", group=_SEARCH)
    tolerance: float = option(1e-5)
    keep_worse: bool = option(
        False, help="Keep the refined model even if it is worse on the held-out recordings.", group=_COMPARISON
    )
    air: Atmosphere | None = option(None)
    definitions: Mapping[str, str] | None = option(None)
    substeps: int | None = option(None)
