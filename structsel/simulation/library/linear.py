"""Published linear models, ready to fly: the Hawk and the AS 355."""

from __future__ import annotations

from typing import Literal

import numpy as np

from structsel.errors import ModelError
from structsel.numerics.atmosphere import G0
from structsel.numerics.linear_models import LinearFamily, LinearSystem
from structsel.simulation.dimensional_derivatives import lateral_model, longitudinal_model
from structsel.simulation.linear import LinearModel

KNOT = 1852.0 / 3600.0  # m/s

_HAWK = {
    "mass": 4082.4, "S": 16.6887, "b": 9.3903, "Ix": 5346.7, "Iy": 19534.4, "Iz": 23786.5, "Ixz": 816.74,
}  # fmt: skip
_HAWK_LONGITUDINAL = {
    "xu": -0.016, "xw": 0.026, "xq": 0.0, "xde": 0.0,
    "zu": -0.217, "zw": -1.342, "zq": -1.379, "zde": -21.849,
    "mu": -0.005, "mw": -0.048, "mq": -1.669, "mde": -19.527,
}  # fmt: skip
_HAWK_LATERAL = {
    "yv": -0.212, "yp": 0.0, "yr": 0.0, "yda": 0.0, "ydr": 7.636,
    "lv": -0.085, "lp": -3.780, "lr": 1.038, "lda": -34.842, "ldr": 5.075,
    "nv": 0.040, "np": -0.002, "nr": -0.479, "nda": 2.274, "ndr": -4.711,
}  # fmt: skip

# Columns: 80 kt, 40 kt.
_AS355 = {
    "Xu": (0.0752, -0.0310), "Xw": (0.0765, 0.1882), "Xq": (9.866, 5.840),
    "Zu": (0.1440, 0.0975), "Zw": (-0.0587, -0.0179), "Zq": (29.37, 15.26),
    "Mu": (0.0523, 0.0356), "Mw": (-0.01585, -0.00867), "Mq": (-1.018, -0.8395),
    "Xd": (-0.1010, 0.0995), "Zd": (0.0986, 0.1031), "Md": (0.0906, 0.1153),
    "K_alpha": (0.0720, 0.1378), "tau": (0.284, 0.298),
}  # fmt: skip
_AS355_STATES = ("u", "w", "q", "theta")
_AS355_OUTPUTS = ("alpha", "q", "ax", "az", "theta")


def hawk(
    axis: Literal["longitudinal", "lateral"] = "longitudinal", *, outputs: tuple[str, ...] | None = None
) -> LinearModel:
    """Hawk at 105.5 m/s and sea level, from concise derivatives.

    Parameters
    ----------
    axis : {"longitudinal", "lateral"}
        Inputs ``de``, or ``da`` and ``dr`` [rad].
    outputs : tuple of str, optional
        As `longitudinal_model` and `lateral_model` take them; the states where absent.

    Raises
    ------
    ModelError
        Another axis, or an output there is not.

    References
    ----------
    [C89]. Its second set of modes: short period -1.512 +- 2.231i, phugoid -0.002 +- 0.071i, roll -3.8, spiral
    -0.0005, Dutch roll -0.320 +- 2.090i. These derivatives give -1.508 +- 2.232i, -0.0051 +- 0.0706i, -3.832,
    +0.0005 and -0.320 +- 2.094i.
    """
    notes, condition = ("derivatives of [C89]",), {"h": 0.0, **_HAWK}
    name = f"Hawk, {axis}"
    if axis == "longitudinal":
        reads = outputs or ("u", "w", "q", "theta")
        return longitudinal_model(name, _HAWK_LONGITUDINAL, V=105.5, outputs=reads, condition=condition, notes=notes)
    if axis == "lateral":
        reads = outputs or ("v", "p", "r", "phi")
        return lateral_model(name, _HAWK_LATERAL, V=105.5, outputs=reads, condition=condition, notes=notes)
    raise ModelError(f"hawk has the axes longitudinal and lateral; found '{axis}'.")


def as355(
    speed: Literal["80kt", "40kt"] = "80kt",
    *,
    x_boom: float = 0.0,
    x_acc: float = 0.0,
    z_acc: float = 0.0,
    theta: float = 0.0,
    bias: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    y_ref: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0),
) -> LinearModel:
    """AS 355 F2 helicopter, longitudinal, with the 23 parameters of its output-error estimation.

    ::

        x' = A x + B u(t - tau) + bias              x = u, w, q, theta
        y  = H0 x + H1 x' + y_ref                   y = alpha (boom), q, ax, az, theta

        A = | Xu Xw Xq -g cos(theta_e) |     alpha = K_alpha (w - x_boom q)
            | Zu Zw Zq -g sin(theta_e) |     ax = u' + W_e q + g cos(theta_e) theta + z_acc q'
            | Mu Mw Mq  0              |     az = w' - U_e q + g sin(theta_e) theta - x_acc q'
            | 0  0  1   0              |

    The parameters are the twelve derivatives, tau, K_alpha, four biases (bias_u, ...) and five references
    (ref_alpha, ...). The accelerations of H0 x + H1 x' are what accelerometers at (x_acc, 0, z_acc) read.

    Parameters
    ----------
    speed : {"80kt", "40kt"}
    x_boom : float [m]
        Of the boom with the angle-of-attack vane, ahead of the centre of gravity.
    x_acc, z_acc : float [m]
        Of the accelerometers, ahead of and below it.
    theta : float [rad]
        Pitch attitude of the reference.
    bias : tuple of float
        On u', w', q', theta'.
    y_ref : tuple of float
        On the outputs.

    Notes
    -----
    Lever arms, attitude, biases and references are not among the published numbers at hand, so they are arguments.
    The unit of the control ``dlon`` is not either, nor whether Zq holds the speed: here the matrix entries are the
    published numbers, as the state equation says. K_alpha goes inversely as speed, so it multiplies w itself
    [rad s/m]. Both models have an unstable oscillation.

    Raises
    ------
    ModelError
        A speed there is no model for.

    References
    ----------
    [A10]
    """
    if speed not in ("80kt", "40kt"):
        raise ModelError(f"as355 has models at '80kt' and '40kt'; found '{speed}'.")
    column = 0 if speed == "80kt" else 1
    V = (80.0, 40.0)[column] * KNOT
    Ue, We, gc, gs = V * np.cos(theta), V * np.sin(theta), G0 * np.cos(theta), G0 * np.sin(theta)
    fixed = np.zeros((4, 4))
    fixed[0, 3], fixed[1, 3], fixed[3, 2] = -gc, -gs, 1.0
    H0 = np.zeros((5, 4))
    H0[1, 2] = H0[4, 3] = 1.0
    H0[2, 2:], H0[3, 2:] = (We, gc), (-Ue, gs)
    H1 = np.zeros((5, 4))
    H1[2, 0], H1[2, 2], H1[3, 1], H1[3, 2] = 1.0, z_acc, 1.0, -x_acc
    base = LinearSystem.of(_AS355_STATES, ("dlon",), fixed, np.zeros((4, 1)), outputs=_AS355_OUTPUTS, C=H0 + H1 @ fixed)
    acts: dict[str, dict[str, np.ndarray]] = {}
    for name in _AS355:
        if name == "tau":
            acts[name] = {"delay": np.array(1.0)}
        elif name == "K_alpha":
            acts[name] = {"C": np.outer(np.eye(5)[0], [0.0, 1.0, -x_boom, 0.0])}
        else:
            row = np.eye(4)["XZM".index(name[0])]
            if name[1] == "d":
                acts[name] = {"B": row[:, None], "D": (H1 @ row)[:, None]}
            else:
                dA = np.outer(row, np.eye(4)["uwq".index(name[1])])
                acts[name] = {"A": dA, "C": H1 @ dA}
    for i, state in enumerate(_AS355_STATES):
        acts[f"bias_{state}"] = {"bias": np.eye(4)[i], "y_ref": H1[:, i]}
    for i, output in enumerate(_AS355_OUTPUTS):
        acts[f"ref_{output}"] = {"y_ref": np.eye(5)[i]}
    theta_values = np.array([*(pair[column] for pair in _AS355.values()), *bias, *y_ref])
    return LinearModel(
        f"AS 355, longitudinal, {speed[:2]} kt",
        LinearFamily.of(base, acts),
        theta_values,
        {"V": V, "theta": theta, "x_boom": x_boom, "x_acc": x_acc, "z_acc": z_acc},
        {"dlon": "unit of control"},
        ("estimates of [A10], poor fits by its own words; lever arms, attitude, biases and references are arguments",),
    )
