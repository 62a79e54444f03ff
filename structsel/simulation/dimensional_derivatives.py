"""Linear models from dimensional derivatives in concise form.

Concise derivatives are the coefficients of

    u' = xu u + xw w + xq q + xde de - We q - g cos(theta_e) theta
    w' = zu u + zw w + zq q + zde de + Ue q - g sin(theta_e) theta
    q' = mu u + mw w + mq q + mde de,    theta' = q

and

    v' = yv v + yp p + yr r + yda da + ydr dr + We p - Ue r + g cos(theta_e) phi
    p' = lv v + lp p + ...,    r' = nv v + np p + ...,    phi' = p + r tan(theta_e)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from structsel.errors import ModelError
from structsel.nomenclature import LATERAL_STATES, LONGITUDINAL_STATES
from structsel.numerics.atmosphere import G0
from structsel.numerics.linear_models import LinearFamily, LinearSystem
from structsel.simulation.linear import LinearModel

_ZERO = 1e-6  # of the largest in its equation: rounding of the differences where a derivative is zero


def longitudinal_model(
    name: str,
    derivatives: Mapping[str, float],
    *,
    V: float,
    alpha: float = 0.0,
    theta: float | None = None,
    outputs: Sequence[str] = LONGITUDINAL_STATES,
    condition: Mapping[str, float] | None = None,
    notes: tuple[str, ...] = (),
) -> LinearModel:
    """Longitudinal model from concise derivatives.

    Parameters
    ----------
    derivatives : mapping of str to float
        ``xu``, ``xw``, ``xq``, ``xde`` and so for z and m: accelerations per m/s, rad/s and rad. What follows the
        first letter and is no state is an input, in order of appearance. The motion of the axes (-We q, Ue q) is
        *not* in xq and zq; derivatives not given are zero and no parameters.
    V, alpha, theta : float [m/s, rad, rad]
        Airspeed, angle of attack and pitch attitude of the reference; theta is alpha (level flight) where absent.
    outputs : sequence of str
        Of u, w, q, theta, V, alpha, ax and az; accelerations at the centre of gravity.

    Raises
    ------
    ModelError
        A derivative or output with another name, or a reference without speed.
    """
    theta = alpha if theta is None else theta
    Ue, We = V * np.cos(alpha), V * np.sin(alpha)
    A = np.zeros((4, 4))
    A[0, 2:], A[1, 2:], A[3, 2] = (-We, -G0 * np.cos(theta)), (Ue, -G0 * np.sin(theta)), 1.0
    reads = {
        "V": np.array([np.cos(alpha), np.sin(alpha), 0.0, 0.0]),
        "alpha": np.array([-np.sin(alpha), np.cos(alpha), 0.0, 0.0]) / V if V > 0.0 else np.zeros(4),
    }
    rows = _Rows(LONGITUDINAL_STATES, {"x": 0, "z": 1, "m": 2}, A, reads, {"ax": 0, "az": 1})
    where = {"V": V, "alpha": alpha, "theta": theta, **(condition or {})}
    return _assemble(name, derivatives, rows, outputs, where, notes)


def lateral_model(
    name: str,
    derivatives: Mapping[str, float],
    *,
    V: float,
    alpha: float = 0.0,
    theta: float | None = None,
    outputs: Sequence[str] = LATERAL_STATES,
    condition: Mapping[str, float] | None = None,
    notes: tuple[str, ...] = (),
) -> LinearModel:
    """Lateral model from concise derivatives.

    Parameters
    ----------
    derivatives : mapping of str to float
        ``yv``, ``yp``, ``yr``, ``yda``, ``ydr`` and so for l and n, as `longitudinal_model` has them; We p and -Ue r
        are not in yp and yr.
    V, alpha, theta : float [m/s, rad, rad]
    outputs : sequence of str
        Of v, p, r, phi, beta and ay.

    Raises
    ------
    ModelError
        A derivative or output with another name, or a reference without speed.
    """
    theta = alpha if theta is None else theta
    A = np.zeros((4, 4))
    A[0, 1:] = V * np.sin(alpha), -V * np.cos(alpha), G0 * np.cos(theta)
    A[3, 1:3] = 1.0, np.tan(theta)
    reads = {"beta": np.array([1.0 / V if V > 0.0 else 0.0, 0.0, 0.0, 0.0])}
    rows = _Rows(LATERAL_STATES, {"y": 0, "l": 1, "n": 2}, A, reads, {"ay": 0})
    where = {"V": V, "alpha": alpha, "theta": theta, **(condition or {})}
    return _assemble(name, derivatives, rows, outputs, where, notes)


@dataclass(frozen=True)
class _Rows:
    """What differs between the two: states, equations by letter, the fixed part, and what can be read."""

    states: tuple[str, ...]
    equations: Mapping[str, int]
    fixed: np.ndarray
    reads: Mapping[str, np.ndarray]
    forces: Mapping[str, int]


def _assemble(
    name: str,
    derivatives: Mapping[str, float],
    rows: _Rows,
    outputs: Sequence[str],
    condition: Mapping[str, float],
    notes: tuple[str, ...],
) -> LinearModel:
    if not condition["V"] > 0.0:
        raise ModelError(f"'{name}' needs an airspeed above zero; found V = {condition['V']} m/s.")
    for key in derivatives:
        if len(key) < 2 or key[0] not in rows.equations:
            raise ModelError(
                f"'{name}' cannot place derivative '{key}': the first letter is the equation "
                f"({', '.join(rows.equations)}), the rest a state ({', '.join(rows.states)}) or an input."
            )
    moving = rows.states[:3]
    inputs = tuple(dict.fromkeys(k[1:] for k in derivatives if k[1:] not in moving))
    C = np.zeros((len(outputs), 4))
    for i, output in enumerate(outputs):
        if output in rows.states:
            C[i, rows.states.index(output)] = 1.0
        elif output in rows.reads:
            C[i] = rows.reads[output]
        elif output not in rows.forces:
            raise ModelError(
                f"'{name}' has no output '{output}'; it has {', '.join((*rows.states, *rows.reads, *rows.forces))}."
            )
    base = LinearSystem.of(rows.states, inputs, rows.fixed, np.zeros((4, len(inputs))), outputs=tuple(outputs), C=C)
    acts: dict[str, dict[str, np.ndarray]] = {}
    for key in derivatives:
        row, what = rows.equations[key[0]], key[1:]
        feels = np.array([1.0 if rows.forces.get(o) == row else 0.0 for o in outputs])
        if what in moving:
            unit, state, force = moving.index(what), "A", "C"
            size = 4
        else:
            unit, state, force = inputs.index(what), "B", "D"
            size = len(inputs)
        column = np.eye(size)[unit]
        acts[key] = {state: np.outer(np.eye(4)[row], column), force: np.outer(feels, column)}
    family = LinearFamily.of(base, acts)
    return LinearModel(name, family, np.array(list(derivatives.values())), condition, notes=notes)


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
    along, across = model.states == LONGITUDINAL_STATES, model.states == LATERAL_STATES
    if not (along or across) or "V" not in model.condition:
        raise ModelError(
            f"derivatives are named for the states {', '.join(LONGITUDINAL_STATES)} or {', '.join(LATERAL_STATES)} at "
            f"an airspeed; '{model.name}' has {', '.join(model.states)}."
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
