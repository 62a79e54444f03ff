"""An AeroModel simulated with six degrees of freedom by the compiled kernel."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from structsel.aircraft import Aircraft
from structsel.errors import ModelError
from structsel.model import AeroModel, ResponseModel
from structsel.nomenclature import (
    LATERAL_COEFFICIENTS,
    LATERAL_OUTPUTS,
    LATERAL_STATES,
    LONGITUDINAL_OUTPUTS,
    LONGITUDINAL_STATES,
)
from structsel.numerics.air_data import body_velocity
from structsel.numerics.flight_model import STATES, outputs_index
from structsel.numerics.flight_simulation import Correction, linearise_batch, simulate_batch
from structsel.recording import Recording
from structsel.refinement.filter_kernels import sampled_gain
from structsel.refinement.linear_flight import delayed_inputs
from structsel.refinement.protocols import Simulator
from structsel.simulation.atmosphere import Atmosphere
from structsel.simulation.flight_setup import FlightSetup, prepare, start_from
from structsel.simulation.missing_responses import describe_missing, missing_responses

_OTHER_OUTPUTS = ("psi", "h", "x", "y", "vn", "ve", "vd", "u", "v", "w", "p_dot", "q_dot", "r_dot", "V_dot",
                  "alpha_dot", "beta_dot")  # fmt: skip


class NonlinearFlight:
    """An AeroModel and its aircraft; outputs are what the instruments read at their places.

    A reconstructed recording has its channels at the centre of gravity, and outputs are taken there.
    """

    from_rest = False
    drifting: tuple[str, ...] = ()

    def __init__(
        self,
        model: AeroModel,
        aircraft: Aircraft,
        *,
        air: Atmosphere | None = None,
        definitions: Mapping[str, str] | None = None,
        substeps: int | None = None,
        delayed: Iterable[str] | None = None,
    ):
        self.model, self.aircraft = model, aircraft
        self.delayed = None if delayed is None else tuple(delayed)
        self.air, self.definitions, self.substeps = air, definitions, substeps
        self.name, self.delay = model.name or "model", 0.0
        self.lateral = lateral = any(name in model for name in LATERAL_COEFFICIENTS)
        if not any(name in model for name in ("CZ", "CL")):
            raise ModelError(
                f"refine needs an AeroModel with lift; '{self.name}' has only {', '.join(model)}, and would fall.\n"
                "Add CX, CZ and Cm (or CL, CD and Cm), and name with free=... what is to be estimated."
            )
        missing = describe_missing(model, missing_responses(model))
        self.doubts: tuple[str, ...] = (missing,) if missing else ()
        longitudinal = any(name not in LATERAL_COEFFICIENTS for name in model)
        self.states = (*(LONGITUDINAL_STATES if longitudinal else ()), *(LATERAL_STATES if lateral else ()))
        self.default_outputs = (
            *(LONGITUDINAL_OUTPUTS if longitudinal else ()),
            *(LATERAL_OUTPUTS if lateral else ()),
        )
        self.outputs = tuple(
            dict.fromkeys((*self.default_outputs, *LONGITUDINAL_OUTPUTS, *LATERAL_OUTPUTS, *_OTHER_OUTPUTS))
        )
        self.parameters: Mapping[str, float] = {
            f"{response}:{term}": float(value)
            for response, held in model.responses.items()
            for term, value in zip(held.terms, held.values)
        }

    def simulator(self, recording: Recording) -> Simulator:
        """Simulator of this recording."""
        prepared, names = self.prepare(recording), self.variable
        instruments = not recording.at_cg

        def simulate(values: np.ndarray, start: np.ndarray, drift: np.ndarray, delay: np.ndarray) -> np.ndarray:
            theta = np.column_stack([values, start, np.maximum(delay, 0.0)])
            return prepared.simulate(self.outputs, names, theta, instruments=instruments).outputs

        return simulate

    def states_with_noise(self, outputs: Sequence[str]) -> tuple[str, ...]:
        """States whose process noise these outputs depend on."""
        found: tuple[str, ...] = ()
        if {*LONGITUDINAL_OUTPUTS, "h", "q_dot"} & set(outputs):
            found += LONGITUDINAL_STATES
        if {*LATERAL_OUTPUTS, "psi", "p_dot", "r_dot"} & set(outputs):
            found += LATERAL_STATES
        return tuple(state for state in found if state in self.states)

    def filter_predictor(self, recording: Recording, outputs: list[int]) -> NonlinearFilter:
        """Predictor of this recording."""
        return NonlinearFilter(self, recording, outputs)

    @property
    def variable(self) -> tuple[str, ...]:
        """Parameters of the compiled kernel that `refine` may vary."""
        return (*self.parameters, *(f"start:{state}" for state in self.states), "delay")

    def prepare(self, recording: Recording) -> FlightSetup:
        """The recording prepared for the kernel; the delay is that of the inputs named, or of all but the thrust."""
        start = start_from(self.model, self.aircraft, recording, self.air)
        ready = prepare(
            self.model, self.aircraft, recording, start=start, air=self.air, definitions=self.definitions,
            substeps=self.substeps,
        )  # fmt: skip
        controls = ready.compiled.controls
        # A recorded thrust is the force itself: it contains its delay already.
        named = [name for name in controls if name != "thrust"] if self.delayed is None else self.delayed
        delayed = np.array(delayed_inputs(controls, named, self.name), dtype=bool)
        return replace(ready, manoeuvre=replace(ready.manoeuvre, delayed=delayed))

    def first_state(self, recording: Recording) -> np.ndarray:
        """States of the first sample."""
        ready = self.prepare(recording)
        index = ready.compiled.parameter_index([f"start:{state}" for state in self.states])
        return ready.compiled.parameters(ready.manoeuvre)[index]

    def growth(self, values: np.ndarray) -> np.ndarray:
        """Not known without a trim: NaN."""
        return np.full(len(values), np.nan)

    def held_errors(self, names: Sequence[str]) -> np.ndarray:
        """(k,) standard errors of parameters before the refinement; NaN where not known."""
        known = {
            f"{response}:{term}": error
            for response, held in self.model.responses.items()
            for term, error in zip(held.terms, np.asarray(held.standard_errors))
        }
        return np.array([known[name] for name in names])

    def refined(
        self, values: Mapping[str, float], covariance: np.ndarray, delay: float, method: str, recordings: Sequence[str]
    ) -> AeroModel:
        """The model with the values found; see `refine_response`.

        A response without an estimated term stays as it is, all its terms marked as held. The covariance between
        responses is in the Refinement only. Recordings are those of the model before and of the refinement.
        """
        made, order = {}, list(values)
        for response, held in self.model.responses.items():
            rows = [(i, order.index(n)) for i, n in enumerate(f"{response}:{t}" for t in held.terms) if n in values]
            places, found = [i for i, _ in rows], [j for _, j in rows]
            estimated = dict(zip(places, (values[order[j]] for j in found)))
            made[response] = refine_response(held, estimated, covariance[np.ix_(found, found)], method)
        names = tuple(dict.fromkeys((*self.model.recordings, *recordings)))
        return AeroModel(made, self.model.name, names)


def refine_response(
    before: ResponseModel, estimated: Mapping[int, float], covariance: np.ndarray, method: str
) -> ResponseModel:
    """A response with the values of some terms estimated anew, the others held.

    The covariance is block-wise: that of the refinement for estimated terms, that of the model before for held ones,
    zero between the two. Constants of single recordings are left out where their mean is estimated.

    The estimates depend on the held values, so the zero is an approximation, and the errors of
    the estimates are those for held values that are exact. Where a block is not known, there is no covariance, and the
    standard errors alone are kept.

    Parameters
    ----------
    before : ResponseModel
    estimated : mapping of term's place to value
    covariance : (k, k) array
        Of the estimated values, in their order.
    method : str
    """
    held = [i for i in range(len(before.terms)) if i not in estimated]
    if not estimated:
        return replace(before, held=before.terms)
    places = list(estimated)
    values, errors = np.array(before.values), np.array(before.standard_errors)
    values[places] = list(estimated.values())
    errors[places] = np.sqrt(np.diag(covariance))
    joint: np.ndarray | None = None
    if np.isfinite(covariance).all() and (before.covariance is not None or not held):
        joint = np.zeros((len(values), len(values)))
        joint[np.ix_(places, places)] = covariance
        if before.covariance is not None:
            joint[np.ix_(held, held)] = before.covariance[np.ix_(held, held)]
    dof = None
    if before.error_dof is not None and held:
        dof = np.array(before.error_dof)
        dof[places] = max(before.n, dof.max())  # as many as samples
    return replace(
        before, values=values, covariance=joint, standard_errors=errors, error_dof=dof, method=method,
        residuals="coloured",
        biased=before.biased and bool(held), held=tuple(before.terms[i] for i in held), s2=np.nan, r2=np.nan, n=0,
        constants={} if any(before.terms[i].is_constant for i in places) else before.constants,
    )  # fmt: skip


class NonlinearFilter:
    """Predictions of an AeroModel's flight on one recording; its gain is that of the motion about the mean."""

    def __init__(self, flight: NonlinearFlight, recording: Recording, outputs: list[int]):
        self.ready = ready = flight.prepare(recording)
        if ready.compiled.memory_names:
            raise ModelError(
                f"The state '{ready.compiled.memory_names[0]}' depends on the motion itself; the gain of a "
                "filter is not computed with such states. Refine by output error, or take model.quasi_steady()."
            )
        names = [flight.outputs[i] for i in outputs]
        self.observed = outputs_index(names, instruments=not recording.at_cg)
        self.index = ready.compiled.parameter_index(flight.variable)
        self.states = np.array([STATES.index(name) for name in flight.states])
        self.dt = recording.dt
        means = {name: float(np.nanmean(recording[name])) for name in (*STATES, "V", "alpha", "beta") if
                 name in recording and np.isfinite(recording[name]).any()}  # fmt: skip
        about = ready.manoeuvre.start.copy()
        for name in flight.states:
            about[STATES.index(name)] = means.get(name, about[STATES.index(name)])
        if not {"u", "w"} <= means.keys() and {"V", "alpha"} <= means.keys():
            sideslip = means.get("beta", 0.0) if flight.lateral else 0.0
            about[:3] = body_velocity(means["V"], means["alpha"], sideslip)
        self.about, self.controls = about, ready.manoeuvre.controls.mean(axis=0)

    def _full(self, theta: np.ndarray) -> np.ndarray:
        full = np.tile(self.ready.compiled.parameters(self.ready.manoeuvre), (len(theta), 1))
        full[:, self.index[: theta.shape[1]]] = theta
        return full

    def gain(
        self, values: np.ndarray, delay: np.ndarray, process: np.ndarray, variances: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Steady gain (m, s, o), and the variance of the outputs due to the uncertainty of the states, (m, o)."""
        ready = self.ready
        A, C = linearise_batch(
            ready.compiled, ready.manoeuvre, self._full(values), self.about, self.controls, self.states, self.observed
        )
        return sampled_gain(A, C, process, variances, self.dt)

    def predict(
        self, values: np.ndarray, start: np.ndarray, drift: np.ndarray, delay: np.ndarray, gain: np.ndarray,
        measured: np.ndarray,
    ) -> np.ndarray:  # fmt: skip
        """(m, n, o) outputs predicted for each sample."""
        full = self._full(np.column_stack([values, start, np.maximum(delay, 0.0)]))
        return simulate_batch(
            self.ready.compiled, self.ready.manoeuvre, full, np.arange(full.shape[1]), self.observed,
            substeps=self.ready.substeps, correction=Correction(self.states, gain, measured),
        ).outputs  # fmt: skip
