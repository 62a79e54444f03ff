"""JSBSim itself: loaded, put into a state, stepped and read, in SI units.

Surfaces are set where the aerodynamics read them, past the aircraft's own control system, so that ``de`` is the
elevator's angle and not the stick's.
"""

from __future__ import annotations

import math
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from structsel.aircraft import Aircraft
from structsel.errors import SimulationError
from structsel.nomenclature import EULER_ANGLES
from structsel.numerics.rigid_body import G0, STATES

_FT, _LBF = 0.3048, 4.4482216152605
_SLUG = _LBF / _FT
_ADAMS_BASHFORTH_4 = 5.0
_RADIUS = 3e9  # m; gravity then turns by 1e-6 rad over 3 km, and positions keep 1e-6 m
_FLAT = f"""<planet name="flat">
<semimajor_axis unit="M">{_RADIUS}</semimajor_axis><semiminor_axis unit="M">{_RADIUS}</semiminor_axis>
<rotation_rate unit="RAD/SEC">0</rotation_rate><GM unit="M3/SEC2">{G0 * _RADIUS**2}</GM><J2>0</J2>
</planet>"""

# Where the aerodynamics read a surface, and the sense in which each side moves.
_SURFACES: dict[str, tuple[tuple[str, float], ...]] = {
    "de": (("fcs/elevator-pos-rad", 1.0),),
    "da": (("fcs/left-aileron-pos-rad", 1.0), ("fcs/right-aileron-pos-rad", -1.0)),
    "dr": (("fcs/rudder-pos-rad", 1.0),),
    "df": (("fcs/flap-pos-rad", 1.0),),
    "gear": (("gear/gear-pos-norm", 1.0),),
}

# Property of JSBSim, and what makes it SI. F, M: forces but gravity, moments; P of propulsion, A of the air.
_READ: dict[str, tuple[str, float]] = {
    **{c: (f"velocities/{c}-fps", _FT) for c in "uvw"},
    **{c: (f"velocities/{c}-rad_sec", 1.0) for c in "pqr"},
    **{c: (f"attitude/{c}-rad", 1.0) for c in EULER_ANGLES},
    "x": ("position/from-start-neu-n-ft", _FT),
    "y": ("position/from-start-neu-e-ft", _FT),
    "h": ("position/h-sl-ft", _FT),
    **{f"{c}_dot": (f"accelerations/{c}dot-ft_sec2", _FT) for c in "uvw"},
    **{f"{c}_dot": (f"accelerations/{c}dot-rad_sec2", 1.0) for c in "pqr"},
    "vn": ("velocities/v-north-fps", _FT),
    "ve": ("velocities/v-east-fps", _FT),
    "vd": ("velocities/v-down-fps", _FT),
    "rho": ("atmosphere/rho-slugs_ft3", _SLUG / _FT**3),
    "mach": ("velocities/mach", 1.0),
    "mass": ("inertia/mass-slugs", _SLUG),
    **{f"F{c}": (f"forces/fb{c}-total-lbs", _LBF) for c in "xyz"},
    **{f"P{c}": (f"forces/fb{c}-prop-lbs", _LBF) for c in "xyz"},
    **{f"A{c}": (f"forces/fb{c}-aero-lbs", _LBF) for c in "xyz"},
    **{f"M{c}": (f"moments/{c}-total-lbsft", _LBF * _FT) for c in "lmn"},
    **{f"A{c}": (f"moments/{c}-aero-lbsft", _LBF * _FT) for c in "lmn"},
}
EXTERNAL = "external_reactions/thrust"
"""An external force of this name is the thrust of an aircraft without engines."""


@contextmanager
def silence_output() -> Iterator[None]:
    """Nothing that JSBSim prints, past Python, reaches the terminal."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [os.dup(1), os.dup(2)]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        yield
    finally:
        for k, descriptor in enumerate(kept):
            os.dup2(descriptor, k + 1)
            os.close(descriptor)
        os.close(nowhere)


class FlightDynamicsModel:
    """One loaded aircraft of JSBSim.

    Parameters
    ----------
    aircraft : str or Path
    root : str or Path or None
    flat : bool
        Over a flat Earth that does not turn.
    rho : float or None [kg/m^3]
        Density held throughout.

    Raises
    ------
    SimulationError
        JSBSim is not installed, or cannot load the aircraft.
    """

    def __init__(self, aircraft: str | Path, root: str | Path | None, flat: bool, rho: float | None):
        try:
            import jsbsim
        except ImportError as error:
            raise SimulationError(
                f"JSBSim is needed for the aircraft '{aircraft}', and is not installed.\n"
                'Install it with: pip install "structsel[jsbsim]"'
            ) from error
        with silence_output():
            self.fdm = _load(jsbsim, aircraft, root, flat)
            manager = self.fdm.get_property_manager()
            self._nodes = {name: (manager.get_node(path), factor) for name, (path, factor) in _READ.items()}
            self._writable = jsbsim.Attribute.WRITE
            self.senses = dict.fromkeys(_SURFACES, 1.0)
            self._sides = {
                channel: [(manager.get_node(path), sense) for path, sense in sides]
                for channel, sides in _SURFACES.items()
            }
            for sides in _SURFACES.values():  # the aircraft's own control system no longer moves them
                for path, _ in sides:
                    for same in {path, path.replace("-rad", "-deg")}:
                        manager.get_node(same).set_attribute(self._writable, False)
            self.engines = int(self.fdm.get_propulsion().get_num_engines())
            self.pushed = not self.engines and manager.hasNode(f"{EXTERNAL}/magnitude")
            for rate in ("rate", "position"):
                for motion in ("rotational", "translational"):
                    self.fdm[f"simulation/integrator/{rate}/{motion}"] = _ADAMS_BASHFORTH_4
            self.fdm["propulsion/fuel_freeze"] = 1.0
            if rho is not None:
                self.fdm["atmosphere/override/density"] = rho * _FT**3 / _SLUG
            self.fdm["ic/long-gc-rad"] = 0.0
            self.fdm["ic/lat-gc-rad"] = 0.0 if flat else math.pi / 4
            self.fdm.run_ic()
            for i in range(self.engines):  # propellers of constant speed at the fastest
                self.fdm[f"fcs/advance-cmd-norm[{i}]"] = 1.0

    def set(self, controls: Mapping[str, float]) -> None:
        """Set surfaces [rad], gear, throttle, thrust [N]."""
        for channel, value in controls.items():
            if channel == "throttle":
                for i in range(self.engines):
                    self.fdm[f"fcs/throttle-cmd-norm[{i}]"] = value
            elif channel == "thrust":
                self.fdm[f"{EXTERNAL}/magnitude"] = value / _LBF
            else:
                for node, sense in self._sides[channel]:
                    node.set_attribute(self._writable, True)
                    node.set_double_value(sense * self.senses[channel] * value)
                    node.set_attribute(self._writable, False)

    def place(self, state: np.ndarray, controls: Mapping[str, float]) -> None:
        """Put the aircraft into a state (12,), its engines in steady state."""
        held = dict(zip(STATES, state.tolist()))
        self.fdm["ic/h-sl-ft"] = held["h"] / _FT
        for name, key in (("phi", "phi"), ("theta", "theta"), ("psi", "psi-true")):
            self.fdm[f"ic/{key}-rad"] = held[name]
        for name in "uvw":
            self.fdm[f"ic/{name}-fps"] = held[name] / _FT
        for name in "pqr":
            self.fdm[f"ic/{name}-rad_sec"] = held[name]
        if self.silent():
            self.fdm["propulsion/set-running"] = -1.0  # started, or started again after it died at idle
        self.set(controls)
        self.fdm.run_ic()
        if self.engines:
            self.fdm.get_propulsion().get_steady_state()
        # The aerodynamics use the rate of the angle of attack of the run before; a few runs make it that of this state.
        for _ in range(4):
            self.fdm.run_ic()

    def silent(self) -> bool:
        """Whether an engine does not run."""
        return any(self.fdm[f"propulsion/engine[{i}]/set-running"] == 0.0 for i in range(self.engines))

    def step(self, dt: float) -> None:
        """Fly on by dt [s]."""
        self.fdm.set_dt(dt)
        self.fdm.run()

    def value(self, name: str) -> float:
        """One of what `now` gives, SI; the heading is from -pi to pi."""
        node, factor = self._nodes[name]
        if node is None:  # without engines there are no properties of a propulsion
            return 0.0
        value = float(node.get_double_value() * factor)
        # JSBSim's heading is from 0 to 2 pi: north, less a rounding error, would be 2 pi.
        return math.remainder(value, 2.0 * math.pi) if name == "psi" else value

    def change(self, name: str, reference: float) -> float:
        """Change of a value from its reference, SI; of a heading from -pi to pi."""
        change = self.value(name) - reference
        return math.remainder(change, 2.0 * math.pi) if name == "psi" else change

    def now(self) -> dict[str, float]:
        """Everything read, SI."""
        return {name: self.value(name) for name in _READ}

    def from_cg(self, *properties: str) -> np.ndarray:
        """Body-axis place (3,) [m] of three structural coordinates [in], from the centre of gravity."""
        centre = np.array([self.fdm[f"inertia/cg-{c}-in"] for c in "xyz"])
        place = np.array([self.fdm[name] for name in properties])
        return (place - centre) * np.array([-1.0, 1.0, -1.0]) * _FT / 12.0

    def describe(self, name: str) -> Aircraft:
        """Aircraft with the constants that JSBSim flies it with."""
        at = [f"propulsion/engine[{i}]" for i in range(self.engines)]
        offset, inclination = np.zeros(3), 0.0
        if at:  # one line, in the middle of them
            places = [self.from_cg(*(f"{path}/{c}-position" for c in "xyz")) for path in at]
            offset = np.mean(places, axis=0)
            inclination = float(np.mean([self.fdm[f"{path}/pitch-angle-rad"] for path in at]))
        elif self.pushed:
            offset = self.from_cg(*(f"{EXTERNAL}/location-{c}-in" for c in "xyz"))
            inclination = math.atan2(-self.fdm[f"{EXTERNAL}/z"], self.fdm[f"{EXTERNAL}/x"])
        # JSBSim gives Ixz as the entry of the tensor, the other products as integrals over the mass.
        signs = {"Ix": 1.0, "Iy": 1.0, "Iz": 1.0, "Ixz": -1.0, "Ixy": 1.0, "Iyz": 1.0}
        inertia = {
            key: sign * self.fdm[f"inertia/i{(key[1:] * 2)[:2]}-slugs_ft2"] * _SLUG * _FT**2
            for key, sign in signs.items()
        }
        return Aircraft(
            name=f"{name} of JSBSim",
            mass=self.value("mass"),
            S=self.fdm["metrics/Sw-sqft"] * _FT**2,
            b=self.fdm["metrics/bw-ft"] * _FT,
            cbar=self.fdm["metrics/cbarw-ft"] * _FT,
            inertia=inertia,
            thrust={"offset": tuple(offset.tolist()), "inclination": inclination},
        )


def _load(jsbsim: Any, aircraft: str | Path, root: str | Path | None, flat: bool) -> Any:
    base = Path(root or jsbsim.get_default_root_dir())
    path = Path(aircraft)
    fdm = jsbsim.FGFDMExec(str(base))
    fdm.set_debug_level(0)
    if flat:
        with tempfile.TemporaryDirectory() as folder:
            planet = Path(folder) / "flat.xml"
            planet.write_text(_FLAT)
            fdm.load_planet(str(planet), False)
        fdm["simulation/gravity-model"] = 0.0
    try:
        if path.suffix == ".xml":
            loaded = path.is_file() and fdm.load_model_with_paths(
                path.stem, str(path.parent.resolve()), str(base / "engine"), str(base / "systems"), False
            )
        else:
            loaded = fdm.load_model(str(aircraft))
    except Exception as error:  # JSBSim has classes of its own, and not the same in every release
        raise SimulationError(f"JSBSim cannot load the aircraft '{aircraft}': {error}") from error
    if not loaded:
        where = path.parent if path.suffix == ".xml" else base / "aircraft"
        raise SimulationError(
            f"JSBSim cannot load the aircraft '{aircraft}'; it was looked for in '{where}'.\n"
            "Give the name of one that comes with JSBSim (c172p, ...), or PATH/AIRCRAFT.xml."
        )
    return fdm
