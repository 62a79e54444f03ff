"""An AeroModel flown by the compiled flight with six degrees of freedom."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from structsel.aircraft import Aircraft
from structsel.model import AeroModel
from structsel.recording import Recording
from structsel.recording.recording import CARRIED
from structsel.refinement.problem import Flyer
from structsel.simulation.air import Air
from structsel.simulation.preparing import prepare

_ALONG, _ACROSS = ("u", "w", "q", "theta"), ("v", "p", "r", "phi")
_SHOWN_ALONG, _SHOWN_ACROSS = ("V", "alpha", "q", "theta", "ax", "az"), ("beta", "p", "r", "phi", "ay")
_SHOWN = ("psi", "h", "x", "y", "vn", "ve", "vd", "u", "v", "w", "p_dot", "q_dot", "r_dot", "V_dot", "alpha_dot",
          "beta_dot")  # fmt: skip
_LATERAL = ("CY", "Cl", "Cn")
_START = ("V", "alpha", "beta", "u", "v", "w", "p", "q", "r", "phi", "theta", "psi", "x", "y", "h")


class AeroFlight:
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
        air: Air | None = None,
        definitions: Mapping[str, str] | None = None,
        substeps: int | None = None,
    ):
        self.model, self.aircraft = model, aircraft
        self.air, self.definitions, self.substeps = air, definitions, substeps
        self.name, self.delay = model.name or "model", 0.0
        self.lateral = lateral = any(name in model for name in _LATERAL)
        along = any(name not in _LATERAL for name in model)
        self.states = (*(_ALONG if along else ()), *(_ACROSS if lateral else ()))
        self.shown = (*(_SHOWN_ALONG if along else ()), *(_SHOWN_ACROSS if lateral else ()))
        self.outputs = tuple(dict.fromkeys((*self.shown, *_SHOWN_ALONG, *_SHOWN_ACROSS, *_SHOWN)))
        self.parameters: Mapping[str, float] = {
            f"{response}:{term}": float(value)
            for response, held in model.responses.items()
            for term, value in zip(held.terms, held.values)
        }

    def on(self, recording: Recording) -> Flyer:
        """Make ready to fly this recording's inputs."""
        ready = prepare(
            self.model, self.aircraft, recording, start=self._start(recording), air=self.air,
            definitions=self.definitions, substeps=self.substeps,
        )  # fmt: skip
        names = (*self.parameters, *(f"start:{state}" for state in self.states), "delay")
        carried = any(note.startswith(CARRIED) for note in recording.provenance)

        def fly(values: np.ndarray, start: np.ndarray, drift: np.ndarray, delay: np.ndarray) -> np.ndarray:
            theta = np.column_stack([values, start, np.maximum(delay, 0.0)])
            return ready.fly(self.outputs, names, theta, instruments=not carried).outputs

        return fly

    def _start(self, recording: Recording) -> dict[str, float]:
        """What the first sample says.

        Without lateral coefficients nothing would end a lateral motion, so none is started. An altitude that was
        not read does not matter where the density is given.
        """
        wanted = [name for name in _START if self.lateral or name not in (*_ACROSS, "beta")]
        held = {name: float(recording[name][0]) for name in wanted if name in recording}
        held = {name: value for name, value in held.items() if np.isfinite(value)}
        if self.air is not None and self.air.rho is not None:
            held.setdefault("h", 0.0)
        return held

    def first_state(self, recording: Recording) -> np.ndarray:
        """States of the first sample."""
        ready = prepare(self.model, self.aircraft, recording, start=self._start(recording), air=self.air,
                        definitions=self.definitions, substeps=self.substeps)  # fmt: skip
        index = ready.plan.parameter_index([f"start:{state}" for state in self.states])
        return ready.plan.parameters(ready.flight)[index]

    def growth(self, values: np.ndarray) -> np.ndarray:
        """Not known without a trim: NaN."""
        return np.full(len(values), np.nan)

    def refined(self, values: Mapping[str, float], std: Mapping[str, float], delay: float) -> AeroModel:
        """The model with the values found; standard errors are those of the refinement, 0 for what was held."""
        made = {}
        for response, held in self.model.responses.items():
            names = [f"{response}:{term}" for term in held.terms]
            made[response] = replace(
                held, values=np.array([values.get(n, v) for n, v in zip(names, held.values)]), covariance=None,
                standard_errors=np.array([std.get(n, 0.0) for n in names]), method="output error",
                residuals="coloured", s2=np.nan, r2=np.nan, n=0,
            )  # fmt: skip
        return AeroModel(made, self.model.name, self.model.recordings)
