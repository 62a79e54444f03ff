"""CSV output of JSBSim: names and meaning of its properties and of its groups of columns.

A property's last word is its unit, ``/fdm/jsbsim/velocities/vt-fps``; the columns of a group such as ``<rates>`` state
theirs in brackets. Body axes are forward, right, down.
"""

from __future__ import annotations

from dataclasses import replace

from structsel.readers.standard_maps import StandardChannel, with_standard_map
from structsel.readers.table import FileTable

ROOT = "/fdm/jsbsim/"
_UNITS = {
    "fps": "ft/s", "ft_sec": "ft/s", "ft_sec2": "ft/s^2", "rad_sec": "rad/s", "rad_sec2": "rad/s^2",
    "deg_sec": "deg/s", "rad": "rad", "deg": "deg", "ft": "ft", "lbs": "lbf", "psf": "psf", "slugs": "slug",
    "slugs_ft3": "slug/ft^3", "kts": "kt", "norm": "-", "rpm": "rpm", "sec": "s", "R": "degR", "lbsft": "lbf*ft",
    "in": "inch", "slugs_ft2": "slug*ft^2", "sqft": "ft^2", "m": "m", "mps": "m/s",
}  # fmt: skip
_DELAYED = "JSBSim's Nx, Ny, Nz, which its log gives one frame delayed"
_SURFACE = "as the aircraft's own files define it; most make a positive deflection a negative moment"


def _of(*properties: str) -> tuple[str, ...]:
    return tuple(ROOT + name for name in properties)


_ROLL = {ROOT + "fcs/left-aileron-pos-rad": -0.5, ROOT + "fcs/right-aileron-pos-rad": 0.5}
_USUAL = (
    StandardChannel("t", ("Time",), "s"),
    StandardChannel("V", (*_of("velocities/vt-fps"), "V_{Total} (ft/s)"), "ft/s"),
    StandardChannel("alpha", (*_of("aero/alpha-rad", "aero/alpha-deg"), "Alpha (deg)")),
    StandardChannel("beta", (*_of("aero/beta-rad", "aero/beta-deg"), "Beta (deg)")),
    StandardChannel("qbar", (*_of("aero/qbar-psf"), "q bar (psf)"), "psf"),
    StandardChannel("mach", _of("velocities/mach"), "-"),
    StandardChannel("phi", (*_of("attitude/phi-rad", "attitude/roll-rad", "attitude/phi-deg"), "Phi (deg)")),
    StandardChannel("theta", (*_of("attitude/theta-rad", "attitude/pitch-rad", "attitude/theta-deg"), "Theta (deg)")),
    StandardChannel("psi", (*_of("attitude/psi-rad", "attitude/heading-true-rad", "attitude/psi-deg"), "Psi (deg)")),
    *(StandardChannel(name, (*_of(f"velocities/{name}-rad_sec"), f"{name.upper()} (deg/s)")) for name in "pqr"),
    *(
        StandardChannel(f"{name}_dot", (*_of(f"accelerations/{name}dot-rad_sec2"), f"{name.upper()} dot (deg/s^2)"))
        for name in "pqr"
    ),
    *(StandardChannel(f"a{axis}", (f"BodyAccel_{axis.upper()}",), "ft/s^2") for axis in "xyz"),
    StandardChannel("ax", _of("accelerations/Nx"), "g", assumption=_DELAYED),
    StandardChannel("ay", _of("accelerations/Ny"), "g", assumption=_DELAYED),
    StandardChannel("az", _of("accelerations/Nz"), "g", sign=-1, assumption=_DELAYED),
    *(
        StandardChannel(name, (*_of(f"velocities/{name}-aero-fps"), f"Aero V_{{{axis} Body}} (ft/s)"), "ft/s")
        for name, axis in zip("uvw", "XYZ")
    ),
    StandardChannel("vn", (*_of("velocities/v-north-fps"), "V_{North} (ft/s)"), "ft/s"),
    StandardChannel("ve", (*_of("velocities/v-east-fps"), "V_{East} (ft/s)"), "ft/s"),
    StandardChannel("vd", (*_of("velocities/v-down-fps"), "V_{Down} (ft/s)"), "ft/s"),
    StandardChannel("gamma", _of("flight-path/gamma-rad", "flight-path/gamma-deg")),
    StandardChannel("h", (*_of("position/h-sl-ft"), "Altitude ASL (ft)"), "ft"),
    StandardChannel("h_agl", (*_of("position/h-agl-ft"), "Altitude AGL (ft)"), "ft"),
    StandardChannel("rho", (*_of("atmosphere/rho-slugs_ft3"), "Rho (slugs/ft^3)"), "slug/ft^3"),
    StandardChannel("pressure", _of("atmosphere/P-psf"), "psf"),
    StandardChannel("temperature", _of("atmosphere/T-R"), "degR"),
    StandardChannel("mass", _of("inertia/mass-slugs"), "slug"),
    StandardChannel("thrust", (*_of("forces/fbx-prop-lbs"), *_of("propulsion/engine/thrust-lbs")), "lbf"),
    StandardChannel("rpm", _of("propulsion/engine/propeller-rpm", "propulsion/engine/engine-rpm"), "rpm"),
    StandardChannel("throttle", _of("fcs/throttle-pos-norm", "fcs/throttle-cmd-norm"), "-"),
    StandardChannel("de", _of("fcs/elevator-pos-rad", "fcs/elevator-pos-deg"), assumption=_SURFACE),
    StandardChannel("da", (_ROLL, {ROOT + "fcs/left-aileron-pos-rad": -1.0}), "rad", assumption=_SURFACE),
    StandardChannel("dr", _of("fcs/rudder-pos-rad", "fcs/rudder-pos-deg"), assumption=_SURFACE),
    StandardChannel("df", _of("fcs/flap-pos-rad", "fcs/flap-pos-deg")),
    StandardChannel("gear", _of("gear/gear-pos-norm"), "-"),
    StandardChannel("alpha_dot", _of("aero/alphadot-rad_sec"), "rad/s"),
    StandardChannel("beta_dot", _of("aero/betadot-rad_sec"), "rad/s"),
)
_MARKS = {"V_{Total} (ft/s)", "P (deg/s)", "BodyAccel_X"}
"""Columns of JSBSim's groups by which its output is recognised if it lists no property."""


def with_jsbsim_map(table: FileTable) -> FileTable:
    """Table with units and the standard channel map of JSBSim's output, if it is one; else the table as it is."""
    if not any(name.startswith(ROOT) for name in table.columns) and not table.columns.keys() >= _MARKS:
        return table
    tails = {name: _UNITS.get(name.rpartition("-")[2].partition("[")[0]) for name in table.columns if ROOT in name}
    units = {name: unit for name, unit in tails.items() if unit is not None and "-" in name}
    table = replace(table, units={**table.units, **units})
    return with_standard_map(table, "JSBSim's usual properties", _USUAL, others="keep")
