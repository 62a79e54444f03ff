"""linearise(): the small motions about a trim."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence

import numpy as np

from structsel.aircraft import Aircraft
from structsel.errors import ModelError, StructselWarning
from structsel.model import AeroModel
from structsel.nomenclature import (
    COEFFICIENTS,
    LATERAL_COEFFICIENTS,
    LATERAL_STATES,
    LONGITUDINAL_COEFFICIENTS,
    LONGITUDINAL_STATES,
)
from structsel.numerics.atmosphere import G0
from structsel.numerics.flight_model import STATES, outputs_index
from structsel.numerics.flight_simulation import central_differences
from structsel.numerics.linear_models import LinearFamily, LinearSystem
from structsel.recording.arguments import require_kind
from structsel.simulation.atmosphere import Atmosphere
from structsel.simulation.flight_setup import prepare
from structsel.simulation.linear import LinearModel
from structsel.simulation.missing_responses import warn_missing
from structsel.simulation.steady_flight import Trim

_AXES = {
    "longitudinal": LONGITUDINAL_STATES,
    "lateral": LATERAL_STATES,
    "coupled": (*LONGITUDINAL_STATES, *LATERAL_STATES),
}
_INPUTS = {"longitudinal": ("de", "df", "throttle", "thrust"), "lateral": ("da", "dr")}
_STEP = 1e-5  # of a state's typical size: central differences are then good to about ten digits


def linearise(
    model: AeroModel,
    aircraft: Aircraft,
    trim: Trim,
    *,
    axis: str = "longitudinal",
    states: Sequence[str] | None = None,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    definitions: Mapping[str, str] | None = None,
    air: Atmosphere | None = None,
) -> LinearModel:
    """Linear model of small departures from a steady flight, by central differences of the compiled slope.

    Parameters
    ----------
    model, aircraft, definitions, air
        As the trim was found with.
    trim : Trim
    axis : {"longitudinal", "lateral", "coupled"}
        States u, w, q, theta; or v, p, r, phi; or all eight. What is left out is held at its trimmed value.
    states : sequence of str, optional
        Any states of the rigid body instead.
    inputs : sequence of str, optional
        Controls; by default those of the axis that the model flies on.
    outputs : sequence of str, optional
        Channels of a flight at the centre of gravity, such as V, alpha, az; the states by default.

    Returns
    -------
    LinearModel
        Its ``modes()`` names and measures the modes.

    Raises
    ------
    ArgumentError
        The model, the aircraft or the trim are objects of another type.
    ModelError
        An axis, a state or an input that there is not.
    ChannelError
        An output that a flight does not give.

    Warns
    -----
    StructselWarning
        The model has states of its own; they follow at once in the linear model. Or it lacks a coefficient of the
        axis, which is taken as zero.
    """
    call = "linearise(model, aircraft, trim)"
    require_kind(model, AeroModel, call)
    require_kind(aircraft, Aircraft, call)
    require_kind(trim, Trim, call)
    if axis not in _AXES:
        raise ModelError(f"axis={axis!r} is not one of {', '.join(map(repr, _AXES))}.")
    chosen = tuple(states or _AXES[axis])
    if wrong := [name for name in chosen if name not in STATES]:
        raise ModelError(f"A flight has no state '{wrong[0]}'; it has {', '.join(STATES)}.")
    needed = {"longitudinal": LONGITUDINAL_COEFFICIENTS, "lateral": LATERAL_COEFFICIENTS}.get(axis, COEFFICIENTS)
    warn_missing(model, lateral=axis != "longitudinal", among=needed if states is None else COEFFICIENTS)
    if model.states:
        warnings.warn(
            f"The linear model holds the states of rigid motion alone; {', '.join(model.states)} follow at once in it, "
            "as they would in slow motion.",
            StructselWarning,
            stacklevel=2,
        )
        model = model.quasi_steady()
    ready = prepare(model, aircraft, trim.inputs(np.array([0.0, 1.0])), start=trim, air=air, definitions=definitions)
    controls = ready.compiled.controls
    if inputs is None:
        kept = _INPUTS.get(axis, controls) if states is None else controls
        inputs = [name for name in controls if name in kept]
    if wrong := [name for name in inputs if name not in controls]:
        raise ModelError(f"The model does not fly on '{wrong[0]}', but on {', '.join(controls)}.")
    shown = chosen if outputs is None else tuple(outputs)
    point = np.concatenate([trim.state, [trim.controls[name] for name in controls]])
    size = np.ones(len(point))
    size[:3] = size[9:12] = np.linalg.norm(trim.state[:3])
    for j, name in enumerate(controls):
        weight = float(ready.manoeuvre.conditions[0, 0]) * G0
        size[12 + j] = weight if name == "thrust" else max(1.0, abs(trim.controls[name]))
    states_at = [STATES.index(name) for name in chosen]
    moved = np.array([*states_at, *(12 + controls.index(name) for name in inputs)])
    rates, seen = central_differences(ready.compiled, ready.manoeuvre, point, moved, _STEP * size[moved])
    ns = len(chosen)
    A, B = rates[states_at, :ns], rates[states_at, ns:]
    C, D = seen[outputs_index(shown), :ns], seen[outputs_index(shown), ns:]
    system = LinearSystem.of(chosen, tuple(inputs), A, B, outputs=shown, C=C, D=D)
    name = f"{model.name or 'model'}, {axis if states is None else ' '.join(chosen)}"
    note = f"linearised at V = {trim['V']:.6g} m/s, h = {trim['h']:.6g} m"
    held = {c: trim[c] for c in ("V", "alpha", "beta", "phi", "theta", "h")}
    return LinearModel(name, LinearFamily.of(system, {}), np.empty(0), held, {}, (note,))
