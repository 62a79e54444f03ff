"""Output error in the frequency domain: the transforms of outputs over a band, of linear models."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from structsel.errors import DataError, ModelError
from structsel.numerics.frequency_regression import as_real, sampled_response
from structsel.numerics.output_error import OutputErrorFit
from structsel.numerics.output_error_problem import Predict
from structsel.numerics.spectra import choose_frequencies
from structsel.recording import Recording
from structsel.refinement.linear_flight import InputResponse, LinearFlight
from structsel.refinement.parameters import Parameter
from structsel.refinement.problem import EstimationProblem, FitsAndResiduals, filled
from structsel.refinement.protocols import RefinableModel
from structsel.refinement.result import OutputFit, compare_output


class FrequencyProblem(EstimationProblem):
    """Fourier transforms of a linear model's outputs at the frequencies of the records in a band.

    They are scaled so that white noise has the same variance in the real and the imaginary part as in a sample.
    Constants have no transform: references, biases and drifts are not estimated. The difference of the states between
    the ends of a record is their jump.
    """

    note = "simulated with the values found in the frequency domain"
    model: LinearFlight

    def __init__(
        self,
        model: RefinableModel,
        recordings: Sequence[Recording],
        outputs: Sequence[str],
        parameters: Sequence[Parameter],
        starts: Mapping[str, np.ndarray],
        band: tuple[float, float],
    ):
        self.band = band
        super().__init__(model, recordings, outputs, parameters, starts)
        self.y = [as_real(w @ y) for w, y in zip(self.weights, self.y)]
        self.start_values = self._with_jumps(super().theta0)

    @property
    def theta0(self) -> np.ndarray:
        """(k,) where the search starts."""
        return self.start_values

    def _with_jumps(self, theta: np.ndarray) -> np.ndarray:
        """Start with the best jumps for its other parameters, by least squares: the outputs are linear in them."""
        jumps = np.array([p.kind == "jump" for p in self.parameters])
        found = np.where(jumps, 0.0, theta)
        for predict, y, r in zip(self.predict(), self.y, self.recordings):
            own = np.flatnonzero(jumps & [p.recording == r.name for p in self.parameters])
            sets = np.tile(found, (1 + own.size, 1))
            sets[1 + np.arange(own.size), own] = 1.0
            outputs = predict(sets)
            if own.size and np.isfinite(outputs).all():
                X = ((outputs[1:] - outputs[0]) / y.std(axis=0)).reshape(own.size, -1)
                found[own] = np.linalg.lstsq(X.T, ((y - outputs[0]) / y.std(axis=0)).ravel(), rcond=None)[0]
        return found

    def prepare_recordings(self) -> list[InputResponse]:
        """Transformed input of each recording."""
        self.weights, self.phasors = [], []
        for r in self.recordings:
            r.require(*self.outputs, finite=True, by="refine in the frequency domain")
            f = choose_frequencies(len(r) * r.dt, *self.band)
            f = f[(f > 0.0) & (f < 0.5 / r.dt * (1.0 - 1e-9))]
            if not f.size:
                raise DataError(
                    f"refine finds no frequency of '{r.name}' between {self.band[0]:g} and {self.band[1]:g} Hz below "
                    f"half its sampling frequency, {0.5 / r.dt:g} Hz. Move the band."
                )
            angle = 2.0 * np.pi * r.dt * f
            self.weights.append(np.sqrt(2.0 / len(r)) * np.exp(-1j * np.outer(angle, np.arange(len(r)))))
            self.phasors.append(np.exp(1j * angle))
        return [InputResponse(self.model, r, w) for r, w in zip(self.recordings, self.weights)]

    def _predict(self, j: int, held: np.ndarray | None, free: np.ndarray | None) -> Predict:
        r, phasor = self.recordings[j], self.phasors[j]
        per_jump = np.sqrt(2.0 / len(r))

        def predict(thetas: np.ndarray) -> np.ndarray:
            thetas = filled(thetas, held, free)
            values, _, _, delay = self.simulation_arguments(thetas, r.name)
            made = self.model.structure.matrices(values)
            jump = per_jump * self._filled(np.zeros(len(self.model.states)), thetas, "jump", self.model.states, r.name)
            Phi, push, feed = self.predictors[j](made, delay)
            C = made.C[:, self.columns]
            found = sampled_response(Phi, push, C, feed[:, :, self.columns], phasor, jump)
            return as_real(self.instrument(thetas, r.name)[0][:, None, :] * found)

        return predict

    def fits_and_residuals(self, fit: OutputErrorFit) -> FitsAndResiduals:
        """Fits and residuals of the transforms; recordings simulated from rest, with the measured means."""
        fits: list[OutputFit] = []
        modelled, residuals = [], {}
        for r, y, z in zip(self.recordings, self.y, fit.outputs):
            fits += [compare_output(r.name, name, y[:, c], z[:, c]) for c, name in enumerate(self.outputs)]
            half = len(y) // 2
            residuals[r.name] = {
                name: y[:half, c] - z[:half, c] + 1j * (y[half:, c] - z[half:, c])
                for c, name in enumerate(self.outputs)
            }
            thetas = fit.theta[None]
            simulated = (
                self.instrument(thetas, r.name)[0][0]
                * self.model.simulator(r)(*self.simulation_arguments(thetas, r.name))[0][:, self.columns]
            )
            means = {name: simulated[:, c] + np.mean(r[name] - simulated[:, c]) for c, name in enumerate(self.outputs)}
            modelled.append(r.with_channels(note=f"outputs {self.note} by refine", **means))  # type: ignore[arg-type]
        return fits, modelled, residuals


def check_frequency(
    flight: RefinableModel, band: tuple[float, float] | None, constants: Mapping[str, Sequence[str]]
) -> tuple[float, float]:
    """The band [Hz], where the frequency domain is possible.

    Raises
    ------
    ModelError
        A model that is not linear, no band, or constants that have no transform.
    """
    if not isinstance(flight, LinearFlight):
        raise ModelError(
            f"the frequency domain needs a linear model; '{flight.name}' is not one. Linearise it "
            "(structsel.simulation.linearise), or refine it in the time domain."
        )
    if band is None or not 0.0 <= band[0] < band[1]:
        raise ModelError(f"domain='frequency' needs band=(low, high) [Hz], such as (0.1, 2.0); it was given {band}.")
    for option, names in constants.items():
        if names:
            raise ModelError(
                f"refine was given {option} ({', '.join(names)}) in the frequency domain, where constants have no "
                "transform. Leave them out; 'starts' lets the ends of a record differ."
            )
    return band
