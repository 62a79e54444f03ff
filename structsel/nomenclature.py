"""The one table of channels: name, symbol, unit, sign, and what is plausible.

SI units and radians; body axes x forward, y right, z down. A channel's name is its symbol in
plain letters. Easily confused, so always spelled this way: ``q`` is pitch rate and ``qbar``
dynamic pressure; ``Cl`` is the rolling moment and ``CL`` lift; ``q_hat`` has the 2 in it.

The plausible range is wide enough for any flying vehicle. A value outside it is reported, never
altered: it usually means a unit or a sign that the channel map should have named.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from structsel.errors import ChannelError

UNKNOWN = "?"
"""Unit of a channel that is neither in the table nor given one by its recording."""


# ---------------------------------------------------------------- groups of channels

FORCE_COEFFICIENTS = ("CX", "CY", "CZ")
MOMENT_COEFFICIENTS = ("Cl", "Cm", "Cn")
COEFFICIENTS = (*FORCE_COEFFICIENTS, *MOMENT_COEFFICIENTS)
"""Body axes, forces first."""
WIND_AXIS_COEFFICIENTS = ("CD", "CY", "CL", *MOMENT_COEFFICIENTS)
"""With drag and lift in place of CX and CZ."""
LONGITUDINAL_COEFFICIENTS = ("CX", "CZ", "Cm")
LATERAL_COEFFICIENTS = ("CY", "Cl", "Cn")
AIR_DATA = ("V", "alpha", "beta")
FLOW_ANGLES = ("alpha", "beta")
EULER_ANGLES = ("phi", "theta", "psi")
BODY_RATES = ("p", "q", "r")
ANGULAR_ACCELERATIONS = ("p_dot", "q_dot", "r_dot")
SPECIFIC_FORCES = ("ax", "ay", "az")
CONTROL_SURFACES = ("de", "da", "dr")
CONFIGURATION = ("df", "gear", "brake", "speedbrake", "speed_brake", "spoiler", "flap", "slat")
"""Channels of what is let down, or held into the stream, now and then."""
INPUTS = (*CONTROL_SURFACES, "throttle", "thrust", *CONFIGURATION)
"""What moves an aircraft by intention."""
LONGITUDINAL_STATES = ("u", "w", "q", "theta")
LATERAL_STATES = ("v", "p", "r", "phi")
LONGITUDINAL_OUTPUTS = ("V", "alpha", "q", "theta", "ax", "az")
"""What instruments read of a longitudinal motion."""
LATERAL_OUTPUTS = ("beta", "p", "r", "phi", "ay")


@dataclass(frozen=True)
class Channel:
    """One row of the table.

    Attributes
    ----------
    name : str
        As written in code, files and terms.
    latex : str
        The symbol, for figures and tables, without dollar signs.
    unit : str
        ``"-"`` where there is none.
    meaning : str
        What it is and which way is positive.
    group : str
        Where it belongs: clock, air data, attitude, rates, motion, controls, configuration,
        propulsion, atmosphere, position, derived, coefficients.
    low, high : float
        Plausible range, in `unit`.
    hint : str
        The likely mistake when the range is left.
    source : str
        What adds the channel when a file has none: ``"reconstruct"``, ``"compute_coefficients"``,
        ``"differentiate"``, or empty.
    """

    name: str
    latex: str
    unit: str
    meaning: str
    group: str
    low: float
    high: float
    hint: str = ""
    source: str = ""


_DEG = "degrees fed as radians"
_PERCENT = "percent fed as a fraction"
_CC = "compute_coefficients"

# fmt: off
# name, latex, unit, meaning, group, low, high, hint, source
_ROWS: tuple[tuple[str, str, str, str, str, float, float, str, str], ...] = (
    ("t", "t", "s", "time", "clock", -1e10, 1e10, "", ""),
    ("V", "V", "m/s", "true airspeed", "air data", 0.0, 2000.0, "a wrong unit", "reconstruct"),
    ("alpha", r"\alpha", "rad", "angle of attack, nose above the flight path", "air data", -1.6, 1.6, _DEG, ""),
    ("beta", r"\beta", "rad", "sideslip, wind from the right", "air data", -1.6, 1.6, _DEG, ""),
    ("qbar", r"\bar q", "Pa", "dynamic pressure", "air data", 0.0, 2e5, "a wrong unit", _CC),
    ("mach", "M", "-", "Mach number", "air data", 0.0, 6.0, "airspeed fed as Mach", _CC),
    ("phi", r"\phi", "rad", "bank angle, right wing down", "attitude", -6.3, 6.3, _DEG, ""),
    ("theta", r"\theta", "rad", "pitch attitude, nose up", "attitude", -1.58, 1.58, _DEG, ""),
    ("psi", r"\psi", "rad", "heading, nose right, north is 0", "attitude", -64.0, 64.0, _DEG, ""),
    ("p", "p", "rad/s", "roll rate, right wing down", "rates", -20.0, 20.0, _DEG, ""),
    ("q", "q", "rad/s", "pitch rate, nose up", "rates", -10.0, 10.0, _DEG, ""),
    ("r", "r", "rad/s", "yaw rate, nose right", "rates", -10.0, 10.0, _DEG, ""),
    ("ax", "a_x", "m/s^2", "specific force, forward", "motion", -150.0, 150.0, "a wrong unit", ""),
    ("ay", "a_y", "m/s^2", "specific force, right", "motion", -150.0, 150.0, "a wrong unit", ""),
    ("az", "a_z", "m/s^2", "specific force, down: -9.8 in level flight", "motion", -300.0, 150.0, "", ""),
    ("u", "u", "m/s", "air-relative velocity along body x", "motion", -2000.0, 2000.0, "", "reconstruct"),
    ("v", "v", "m/s", "air-relative velocity along body y", "motion", -500.0, 500.0, "", "reconstruct"),
    ("w", "w", "m/s", "air-relative velocity along body z", "motion", -500.0, 500.0, "", "reconstruct"),
    ("ug", "u_g", "m/s", "gust: what moving air adds to u", "motion", -100.0, 100.0, "", "reconstruct"),
    ("vg", "v_g", "m/s", "gust: what moving air adds to v", "motion", -100.0, 100.0, "", "reconstruct"),
    ("wg", "w_g", "m/s", "gust: what moving air adds to w", "motion", -100.0, 100.0, "", "reconstruct"),
    ("de", r"\delta_e", "rad", "elevator; positive pitches down", "controls", -1.6, 1.6, _DEG, ""),
    ("da", r"\delta_a", "rad", "aileron; positive rolls left", "controls", -1.6, 1.6, _DEG, ""),
    ("dr", r"\delta_r", "rad", "rudder; positive yaws left", "controls", -1.6, 1.6, _DEG, ""),
    ("df", r"\delta_f", "rad", "flap, trailing edge down", "configuration", -0.8, 1.6, _DEG, ""),
    ("gear", r"\delta_g", "-", "landing gear: 0 up, 1 down", "configuration", 0.0, 1.0, _PERCENT, ""),
    ("mass", "m", "kg", "mass", "configuration", 1e-3, 1e6, "", ""),
    ("throttle", r"\delta_t", "-", "throttle, 0 to 1", "propulsion", -0.05, 1.5, _PERCENT, ""),
    ("thrust", "T", "N", "total thrust along its line, forward", "propulsion", -5e6, 5e6, "", ""),
    ("rpm", r"\Omega", "rpm", "shaft or rotor speed", "propulsion", -2e5, 2e5, "", ""),
    ("rho", r"\rho", "kg/m^3", "air density", "atmosphere", 0.0, 2.0, "a wrong unit", ""),
    ("pressure", "p_s", "Pa", "static pressure", "atmosphere", 0.0, 1.2e5, "a wrong unit", ""),
    ("temperature", "T_s", "K", "static temperature", "atmosphere", 150.0, 340.0, "Celsius as kelvin", ""),
    ("x", "x", "m", "position north", "position", -1e8, 1e8, "", "reconstruct"),
    ("y", "y", "m", "position east", "position", -1e8, 1e8, "", "reconstruct"),
    ("h", "h", "m", "altitude, up", "position", -500.0, 5e4, "feet fed as metres", ""),
    ("h_agl", "h_{agl}", "m", "height above ground, up", "position", -50.0, 5e4, "feet fed as metres", ""),
    ("vn", "v_n", "m/s", "velocity over the ground, north", "position", -2000.0, 2000.0, "a wrong unit", ""),
    ("ve", "v_e", "m/s", "velocity over the ground, east", "position", -2000.0, 2000.0, "a wrong unit", ""),
    ("vd", "v_d", "m/s", "velocity over the ground, down", "position", -500.0, 500.0, "a wrong unit", ""),
    ("gamma", r"\gamma", "rad", "climb angle", "position", -1.6, 1.6, _DEG, "reconstruct"),
    ("p_dot", r"\dot p", "rad/s^2", "roll acceleration", "derived", -300.0, 300.0, _DEG, "differentiate"),
    ("q_dot", r"\dot q", "rad/s^2", "pitch acceleration", "derived", -200.0, 200.0, _DEG, "differentiate"),
    ("r_dot", r"\dot r", "rad/s^2", "yaw acceleration", "derived", -200.0, 200.0, _DEG, "differentiate"),
    ("V_dot", r"\dot V", "m/s^2", "rate of airspeed", "derived", -300.0, 300.0, "", "differentiate"),
    ("alpha_dot", r"\dot\alpha", "rad/s", "rate of the angle of attack", "derived", -50.0, 50.0, _DEG, "differentiate"),
    ("beta_dot", r"\dot\beta", "rad/s", "rate of sideslip", "derived", -50.0, 50.0, _DEG, "differentiate"),
    ("p_hat", r"\hat p", "-", "p b / 2V", "derived", -2.0, 2.0, "", _CC),
    ("q_hat", r"\hat q", "-", "q cbar / 2V", "derived", -2.0, 2.0, "", _CC),
    ("r_hat", r"\hat r", "-", "r b / 2V", "derived", -2.0, 2.0, "", _CC),
    ("alpha_dot_hat", r"\hat{\dot\alpha}", "-", "alpha_dot cbar / 2V", "derived", -2.0, 2.0, "", _CC),
    ("beta_dot_hat", r"\hat{\dot\beta}", "-", "beta_dot b / 2V", "derived", -2.0, 2.0, "", _CC),
    ("V_ratio", "V/V_0", "-", "airspeed over its reference", "derived", 0.0, 20.0, "", _CC),
    ("CT", "C_T", "-", "thrust over qbar S", "coefficients", -5.0, 100.0, "", _CC),
    ("CX", "C_X", "-", "force along body x, forward", "coefficients", -20.0, 20.0, "", _CC),
    ("CY", "C_Y", "-", "force along body y, right", "coefficients", -20.0, 20.0, "", _CC),
    ("CZ", "C_Z", "-", "force along body z, down: lift < 0", "coefficients", -50.0, 50.0, "", _CC),
    ("Cl", "C_l", "-", "rolling moment over qbar S b, right wing down", "coefficients", -5.0, 5.0, "", _CC),
    ("Cm", "C_m", "-", "pitching moment over qbar S cbar, nose up", "coefficients", -20.0, 20.0, "", _CC),
    ("Cn", "C_n", "-", "yawing moment over qbar S b, nose right", "coefficients", -5.0, 5.0, "", _CC),
    ("CL", "C_L", "-", "lift, across the flight path", "coefficients", -50.0, 50.0, "", _CC),
    ("CD", "C_D", "-", "drag, against the flight path", "coefficients", -20.0, 20.0, "", _CC),
)
# fmt: on

_TABLE: dict[str, Channel] = {row[0]: Channel(*row) for row in _ROWS}


def list_channels(group: str | None = None) -> tuple[Channel, ...]:
    """Every channel of the table, or those of one group, in the table's order."""
    return tuple(row for row in _TABLE.values() if group is None or row.group == group)


def is_known(name: str) -> bool:
    """Whether the table holds `name`."""
    return name in _TABLE


def find_channel(name: str) -> Channel:
    """Row of one channel.

    Raises
    ------
    ChannelError
        When the table has no such name; the message gives the nearest ones.
    """
    if name not in _TABLE:
        raise ChannelError(f"nomenclature has no channel '{name}'.{suggest(name, _TABLE)}")
    return _TABLE[name]


def unit_of(name: str, own: Mapping[str, str] | None = None) -> str:
    """Unit of a channel: the table's, else the recording's own, else ``"?"``.

    Parameters
    ----------
    name : str
    own : mapping of str to str, optional
        Units of a recording's channels that the table does not hold.
    """
    if name in _TABLE:
        return _TABLE[name].unit
    return (own or {}).get(name, UNKNOWN)


_LATEX = {c: "\\" + c for c in "_{}%#$"}
_LATEX |= {"\\": r"\backslash ", "^": r"\wedge ", "~": r"\sim ", "&": r"\ and\ "}
"""Characters that have a meaning in LaTeX, as mathematics prints them; Matplotlib does not know an ampersand."""


def latex_of(name: str) -> str:
    r"""Symbol of a channel for figures, without dollar signs; unknown names as upright text, no command among it."""
    if name in _TABLE:
        return _TABLE[name].latex
    return r"\mathrm{" + "".join(_LATEX.get(c, c if c.isprintable() else " ") for c in name) + "}"


def close_names(name: str, among: Iterable[str]) -> list[str]:
    """At most three names in `among` that look like `name`, nearest first, whatever their case.

    A name that carries on after `name`, as ``alpha_deg`` or ``alpha [deg]`` after ``alpha``, is near.
    """
    by_folded: dict[str, list[str]] = {}
    for other in among:
        by_folded.setdefault(other.casefold(), []).append(other)
    folded = name.casefold()
    near = [other for other in by_folded if other.startswith(tuple(f"{folded}{mark}" for mark in "_ [(."))]
    near += difflib.get_close_matches(folded, by_folded, n=3, cutoff=0.6)
    found = [other for key in dict.fromkeys(near) for other in by_folded[key] if other != name]
    return found[:3]


def suggest(name: str, among: Iterable[str]) -> str:
    """Sentence " Did you mean ...?" for a message, or nothing where no name is similar."""
    near = close_names(name, among)
    return f" Did you mean {' or '.join(repr(other) for other in near)}?" if near else ""
