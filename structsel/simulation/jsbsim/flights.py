"""Schedules of inputs for JSBSim, and Recordings of its flights."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from structsel.errors import ChannelError
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.air_data import air_data, flow_angle_rates
from structsel.numerics.rigid_body import STATES
from structsel.readers.table import MOVED_TO_CG
from structsel.recording import Recording
from structsel.simulation.flight_setup import Inputs, Start
from structsel.simulation.steady_flight import Trim

_AS_READ = (*STATES, "p_dot", "q_dot", "r_dot", "vn", "ve", "vd", "rho", "mach", "mass", "thrust")


def read_schedule(
    inputs: Inputs, start: Start | None, needed: Sequence[str], aircraft: str
) -> tuple[np.ndarray, np.ndarray, str]:
    """Clock (n,) [s], controls (n, k) in the order needed, and name of a schedule of inputs.

    Raises
    ------
    ChannelError, DataError
        There is no clock, a control that the aircraft has not, or a sample that is not finite.
    """
    trimmed = dict(start.controls) if isinstance(start, Trim) else {}
    if isinstance(inputs, Recording):
        recording = inputs
    else:
        if "t" not in inputs:
            raise ChannelError(f"The inputs need a clock 't' [s]; they have {', '.join(inputs) or 'nothing'}.")
        t = np.array(inputs["t"], dtype=float)
        if unknown := [c for c in inputs if c not in ("t", *needed)]:
            raise ChannelError(f"JSBSim's {aircraft} has no control '{unknown[0]}'; it has {', '.join(needed)}.")
        given = {c: np.broadcast_to(np.asarray(v, dtype=float), t.shape) for c, v in inputs.items() if c != "t"}
        recording = Recording("simulated", t, given)
    used = [c for c in needed if c in recording]
    recording.require(*used, finite=True, by="JSBSimAircraft.fly")
    columns = [recording[c] if c in recording else np.full(len(recording.t), trimmed.get(c, 0.0)) for c in needed]
    return recording.t, np.column_stack(columns), recording.name


def make_recording(
    name: str, t: np.ndarray, held: Mapping[str, np.ndarray], controls: Sequence[str], start: np.ndarray, how: str
) -> Recording:
    """Recording of what JSBSim gave.

    Parameters
    ----------
    name : str
    t : (n,) array [s]
    held : mapping of str to (n,) array
        Content of `FlightDynamicsModel.now`, thrust, coefficients and controls.
    controls : sequence of str
    start : (12,) array
        Heading and place are counted from there.
    how : str
        For the provenance.
    """
    channels = {c: held[c] for c in (*_AS_READ, *COEFFICIENTS, *controls)}
    u, v, w, u_dot, v_dot, w_dot = (held[c] for c in ("u", "v", "w", "u_dot", "v_dot", "w_dot"))
    V, alpha, beta = air_data(u, v, w)
    alpha_dot, beta_dot, V_dot = flow_angle_rates(u, v, w, u_dot, v_dot, w_dot)
    channels |= {
        "V": V,
        "alpha": alpha,
        "beta": beta,
        "V_dot": V_dot,
        "alpha_dot": alpha_dot,
        "beta_dot": beta_dot,
        "qbar": 0.5 * held["rho"] * V * V,
    }
    channels |= {f"a{c}": held[f"F{c}"] / held["mass"] for c in "xyz"}
    channels["psi"] = np.unwrap(held["psi"])
    for c in ("psi", "x", "y"):
        turn = 2.0 * math.pi if c == "psi" else 1.0
        away = start[STATES.index(c)] - channels[c][0]
        channels[c] = channels[c] + (round(away / turn) * turn if c == "psi" else away)
    at_cg = ("V", "alpha", "beta", "ax", "ay", "az")
    notes = (f"simulated by JSBSim: {how}", f"{MOVED_TO_CG}{', '.join(at_cg)}; simulated there")
    return Recording(name, t, channels, provenance=notes, at_cg=frozenset(at_cg)).check()
