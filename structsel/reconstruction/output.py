"""The reconstructed flight as a Recording."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from structsel.nomenclature import BODY_RATES
from structsel.numerics import kinematics as fp
from structsel.numerics.air_data import air_data, flow_angle_rates
from structsel.readers.table import MOVED_TO_CG
from structsel.reconstruction.problem import ReconstructionProblem
from structsel.reconstruction.result import Constant
from structsel.reconstruction.settings import INERTIAL
from structsel.reconstruction.ukf import SmootherResult
from structsel.recording import Recording


def output_recording(
    recording: Recording,
    problem_setup: ReconstructionProblem,
    path: np.ndarray,
    smooth: SmootherResult,
    std: np.ndarray,
    method: str,
    constants: Sequence[Constant],
) -> tuple[Recording, dict[str, np.ndarray]]:
    """Recording at the centre of gravity, free of biases, and the standard deviations of its channels."""
    problem, lateral = problem_setup.problem, problem_setup.lateral
    estimated = set(problem_setup.names)
    force = fp.forces(path, problem.inputs, problem.place)
    slope = problem.slopes(path)
    u, v, w = (path[:, j] + path[:, fp.GUST + j] for j in range(3))
    du, dv, dw = (slope[:, j] for j in range(3))
    V, alpha, beta = air_data(u, v, w)
    in_symmetry_plane = u * u + w * w
    alpha_dot, beta_dot, V_dot = flow_angle_rates(u, v, w, du, dv, dw)
    channels = {"u": u, "w": w, "V": V, "alpha": alpha, "theta": path[:, 4]}
    channels |= {"V_dot": V_dot, "alpha_dot": alpha_dot}
    channels["gamma"] = np.arcsin(np.clip((slope[:, 8] + path[:, 17]) / V, -1.0, 1.0))
    kept = [name for j, name in enumerate(INERTIAL) if lateral or name in ("ax", "az", "q")]
    channels |= {name: force[:, INERTIAL.index(name)] for name in kept}
    scale = 1.0 + path[0, fp.INERTIAL_SCALE : fp.GUST]
    channels |= {
        f"{name}_dot": problem_setup.turning[:, j - 3] / scale[j]
        for j, name in enumerate(INERTIAL)
        if name in kept and name in BODY_RATES
    }
    if lateral:
        channels |= {"v": v, "beta": beta, "phi": path[:, 3], "beta_dot": beta_dot}
    channels |= {name: path[:, fp.STATES.index(name)] for name in ("psi", "x", "y", "h") if name in estimated}
    stds = {name: std[:, j].copy() for j, name in enumerate(problem_setup.names) if fp.STATES.index(name) < fp.MOTION}
    for j, name in enumerate(("u", "v", "w")):
        if f"{name}g" in estimated:
            stds[name] *= _with_gust(problem_setup.names, smooth, name)
            channels[f"{name}g"] = path[:, fp.GUST + j]
    su, sv, sw = stds["u"], stds.get("v", np.zeros(len(u))), stds["w"]
    stds["V"] = np.sqrt((u * su) ** 2 + (v * sv) ** 2 + (w * sw) ** 2) / V
    stds["alpha"] = np.sqrt((u * sw) ** 2 + (w * su) ** 2) / in_symmetry_plane
    if lateral:
        stds["beta"] = sv / V
    carried = ["V", "alpha", *(["beta"] if lateral else []), *(name for name in kept if name.startswith("a"))]
    note = f"{MOVED_TO_CG}{', '.join(carried)}; flight path reconstructed, method {method}"
    made = recording.with_channels(note=note, units=None, at_cg=carried, **channels)
    taken = ", ".join(f"{c.name} = {c.value:.6g} {c.unit}" for c in constants)
    return made.with_channels(note=f"reconstructed with {taken}") if taken else made, stds


def _with_gust(names: tuple[str, ...], smooth: SmootherResult, axis: str) -> np.ndarray:
    """Standard deviation of a velocity relative to the moving air, over that relative to calm air."""
    i, j = names.index(axis), names.index(f"{axis}g")
    P = smooth.covariance
    ratio = np.sqrt((P[:, i, i] + 2.0 * P[:, i, j] + P[:, j, j]) / P[:, i, i])
    return np.interp(np.arange(len(smooth.x)), smooth.at, ratio)
