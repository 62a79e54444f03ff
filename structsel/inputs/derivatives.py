"""The derivatives of a linear model as parameters by name, for the design of inputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from structsel.errors import ModelError
from structsel.simulation.concise import lateral_model, longitudinal_model
from structsel.simulation.linear import LinearModel

_LONGITUDINAL, _LATERAL = ("u", "w", "q", "theta"), ("v", "p", "r", "phi")
_ZERO = 1e-6  # of the largest in its equation: rounding of the differences where a derivative is zero


def name_derivatives(
    model: LinearModel, *, outputs: Sequence[str] | None = None, inputs: Sequence[str] | None = None
) -> LinearModel:
    """A longitudinal or lateral model, such as `linearise` gives, whose parameters are its concise derivatives.

    Parameters
    ----------
    model : LinearModel
        States u, w, q, theta, or v, p, r, phi; with V, alpha and theta in its condition.
    outputs : sequence of str, optional
        As `longitudinal_model` and `lateral_model` take them; the states by default.
    inputs : sequence of str, optional
        Those to keep; all by default.

    Returns
    -------
    LinearModel
        Parameters ``xu``, ``zw``, ``mde``, ...; of a lateral model with wings level, ``yv``, ``lp``, ``ndr``, ...

    Raises
    ------
    ModelError
        Other states, an unknown input or output, or no airspeed in the condition.
    """
    along, across = model.states == _LONGITUDINAL, model.states == _LATERAL
    if not (along or across) or "V" not in model.condition:
        raise ModelError(
            f"derivatives are named for the states {', '.join(_LONGITUDINAL)} or {', '.join(_LATERAL)} at an airspeed; "
            f"'{model.name}' has {', '.join(model.states)}."
        )
    kept = model.inputs if inputs is None else tuple(inputs)
    if strange := [name for name in kept if name not in model.inputs]:
        raise ModelError(f"'{model.name}' has no input '{strange[0]}'; it has {', '.join(model.inputs)}.")
    held = dict(model.condition)
    V, alpha = held["V"], held.get("alpha", 0.0)
    Ue, We = V * np.cos(alpha), V * np.sin(alpha)
    A = np.array(model.system.A)
    if along:  # without the motion of the axes
        A[0, 2] += We
        A[1, 2] -= Ue
    else:
        A[0, 1] -= We
        A[0, 2] += Ue
    B = model.system.B[:, [model.inputs.index(name) for name in kept]]
    made: dict[str, float] = {}
    for row, letter in enumerate("xzm" if along else "yln"):
        found = dict(zip((*model.states[:3], *kept), [*A[row, :3], *B[row]]))
        least = _ZERO * max(map(abs, found.values()))
        made |= {letter + name: float(value) for name, value in found.items() if abs(value) > least}
    build = longitudinal_model if along else lateral_model
    shown = model.states if outputs is None else outputs
    return build(
        model.name, made, V=V, alpha=alpha, theta=held.get("theta"), outputs=shown, condition=held, notes=model.notes
    )
