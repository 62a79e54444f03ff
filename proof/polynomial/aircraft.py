"""Base aircraft of the truth flights, after the ready ones.

Beaver: the published polynomials; its slipstream terms are written over the thrust coefficient (the rise of total
pressure is 8.61 CT, so that 0.1161 of it is the thrust, which is declared), the beta-dot term is left out.
Citation: as published. HFB-320: published longitudinally, turned from wind into body axes to the fourth power of
alpha; its lateral derivatives, CZ of pitch rate and of elevator are plausible values for its kind. Hawk: the concise
derivatives at 105.5 m/s turned into coefficients; its drag polar is a plausible one (CD0 0.022, K 0.075).
Thrust of all: static thrust x throttle x density^k / (1 + V/V_t) behind a first-order lag, all plausible values.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import root

from proof.polynomial.equations import CONSTANTS
from proof.polynomial.kernel import GAINS
from proof.polynomial.terms import INDEX, VARIABLES, compile_terms, evaluate
from structsel.aircraft import Aircraft
from structsel.numerics.atmosphere import standard_atmosphere
from structsel.simulation import published_aircraft

Term = tuple[str, str, float]
_MAIN = {
    "CX": ("1", "alpha", "alpha^2", "CT"), "CY": ("beta", "dr"), "CZ": ("1", "alpha", "de", "df"),
    "Cl": ("beta", "p_hat", "da"), "Cm": ("1", "alpha", "q_hat", "de"), "Cn": ("beta", "r_hat", "dr"),
}  # fmt: skip


@dataclass(frozen=True)
class TruthAircraft:
    """An aircraft of the polynomial plant.

    Attributes
    ----------
    name : str
    aircraft : Aircraft
        Geometry, mass, inertia, thrust line.
    terms : tuple of (axis, text, value)
    speeds, heights : (low, high) [m/s, m]
    stall : float [rad]
        Where its wing may be taken to stall.
    engine : mapping
        Entries of `CONSTANTS` after the thrust line.
    propeller : bool
    """

    name: str
    aircraft: Aircraft
    terms: tuple[Term, ...]
    speeds: tuple[float, float]
    heights: tuple[float, float]
    stall: float
    engine: Mapping[str, float]
    propeller: bool = False

    def value(self, axis: str, text: str) -> float:
        """Value of a term; 0 if there is none."""
        return next((v for a, w, v in self.terms if (a, w) == (axis, text)), 0.0)

    def constants(self) -> np.ndarray:
        """As `CONSTANTS`."""
        air, line = self.aircraft, self.aircraft.thrust
        held = {"S": air.S, "b": air.b, "cbar": air.cbar, "tx": line.offset[0], "tz": line.offset[2]}
        held |= {"tilt": line.inclination, "engine_H": 0.0, **self.engine}
        return np.array([held[name] for name in CONSTANTS])

    def perturbed_copy(self, rng: np.random.Generator, spread: float = 0.05) -> TruthAircraft:
        """An aircraft of the same kind, every derivative its own."""
        changed = tuple(
            (a, w, v * (1.0 + spread * float(np.clip(rng.standard_normal(), -2, 2)))) for a, w, v in self.terms
        )
        return replace(self, terms=changed)

    def with_parameter_errors(self, rng: np.random.Generator, main: float, secondary: float) -> tuple[Term, ...]:
        """Terms of a simulation that is off by its tolerances."""
        return tuple(
            (a, w, v * (1.0 + (main if w in _MAIN[a] else secondary) * float(rng.standard_normal())))
            for a, w, v in self.terms
        )

    def trim(self, V: float, h: float, df: float = 0.0) -> dict[str, float]:
        """Straight and level: alpha, de, da, dr, thrust, throttle."""
        air = self.aircraft
        rho = float(_air(h, V)[0])
        qS, g = 0.5 * rho * V**2 * air.S, 9.80665
        rows, values = compile_terms(self.terms)
        line = air.thrust

        def left(z: np.ndarray) -> np.ndarray:
            x = np.zeros((1, len(VARIABLES)))
            for name, value in {
                "1": 1.0,
                "alpha": z[0],
                "de": z[1],
                "CT": z[2],
                "da": z[3],
                "dr": z[4],
                "df": df,
            }.items():
                x[0, INDEX[name]] = value
            CX, _, CZ, Cl, Cm, Cn = evaluate(rows, values, x)[0]
            W = air.mass * g / qS  # type: ignore[operator]
            Tx, Tz = z[2] * np.cos(line.inclination), -z[2] * np.sin(line.inclination)
            return np.array([
                CX + Tx - W * np.sin(z[0]), CZ + Tz + W * np.cos(z[0]),
                Cm + (line.offset[2] * Tx - line.offset[0] * Tz) / air.cbar, Cl, Cn,
            ])  # fmt: skip

        alpha, de, CT, da, dr = root(left, np.array([0.05, 0.0, 0.05, 0.0, 0.0]), tol=1e-10).x
        e = self.engine
        static = e["static_thrust"] * (rho / 1.225) ** e["h_power"] / (1.0 + V / e["V_thrust"])
        return {"alpha": alpha, "de": de, "da": da, "dr": dr, "thrust": CT * qS, "throttle": CT * qS / static, "V": V}

    def gains(self, V: float, h: float) -> np.ndarray:
        """Light stabilisation, as `GAINS`: the same motion on every aircraft."""
        air = self.aircraft
        qS = 0.5 * float(_air(h, V)[0]) * V**2 * air.S
        inertia = air.require_inertia("gains")
        M = qS * air.cbar * abs(self.value("Cm", "de")) / inertia.Iy
        L = qS * air.b * abs(self.value("Cl", "da")) / inertia.Ix
        N = qS * air.b * abs(self.value("Cn", "dr")) / inertia.Iz
        held = {"q": 0.8 / M, "theta": 1.6 / M, "p": 0.8 / L, "phi": 1.3 / L, "r": 0.3 / N, "alpha": 3.0 / M}
        held |= {"h": 0.8 / V, "h_dot": 0.8 / V, "V": 0.05}
        return np.array([held[name] for name in GAINS])


def _air(h: float, V: float) -> tuple[np.ndarray, np.ndarray]:
    _, _, rho, sound = standard_atmosphere(h)
    return rho, V / sound


def _terms(model: Mapping[str, Mapping[str, float]]) -> tuple[Term, ...]:
    return tuple((axis, text, value) for axis, held in model.items() for text, value in held.items() if value)


def _published(name: str) -> dict[str, dict[str, float]]:
    model = published_aircraft(name).model
    assert model is not None
    return {r: {str(t): float(v) for t, v in zip(model[r].terms, model[r].values)} for r in model.responses}


def _beaver() -> TruthAircraft:
    pressure = 1.0 / 0.1161  # rise of total pressure per CT
    made: dict[str, dict[str, float]] = {}
    for axis, held in _published("beaver").items():
        made[axis] = {}
        for text, value in held.items():
            if "beta_dot" in text or (axis == "CX" and text == "dpt"):
                continue
            power = 3 if "dpt^3" in text else 2 if "dpt^2" in text else 1 if "dpt" in text else 0
            made[axis][text.replace("dpt", "CT")] = value * pressure**power
    aircraft = published_aircraft("beaver").aircraft
    assert aircraft is not None
    engine = {"static_thrust": 7500.0, "V_thrust": 60.0, "h_power": 1.0, "spool": 0.25, "rpm_idle": 1500.0,
              "rpm_range": 900.0}  # fmt: skip
    return TruthAircraft("beaver", aircraft, _terms(made), (41.0, 57.0), (500.0, 2500.0), 0.25, engine, propeller=True)


def _citation() -> TruthAircraft:
    aircraft = published_aircraft("citation").aircraft
    assert aircraft is not None
    engine = {"static_thrust": 22000.0, "V_thrust": 500.0, "h_power": 0.8, "spool": 0.8, "rpm_idle": 8000.0,
              "rpm_range": 8000.0}  # fmt: skip
    return TruthAircraft(
        "citation", aircraft, _terms(_published("citation")), (95.0, 150.0), (2500.0, 9000.0), 0.19, engine
    )


def _hfb320() -> TruthAircraft:
    wind = {
        axis: {t.replace("q_ratio", "q_hat"): v for t, v in held.items()} for axis, held in _published("hfb320").items()
    }
    made: dict[str, dict[str, float]] = {"CX": {}, "CZ": {}, "Cm": {}}

    def add(axis: str, text: str, value: float) -> None:
        text = "*".join(sorted(p for p in text.split("*") if p != "1")) or "1"
        made[axis][text] = made[axis].get(text, 0.0) + value

    cosine, sine = {"1": 1.0, "alpha^2": -0.5}, {"alpha": 1.0, "alpha^3": -1.0 / 6.0}
    for text, value in _over_speed(wind["CD"]):
        for power, part in cosine.items():
            add("CX", f"{text}*{power}", -value * part)
        for power, part in sine.items():
            add("CZ", f"{text}*{power}", -value * part)
    for text, value in _over_speed(wind["CL"]):
        for power, part in sine.items():
            add("CX", f"{text}*{power}", value * part)
        for power, part in cosine.items():
            add("CZ", f"{text}*{power}", -value * part)
    for text, value in _over_speed(wind["Cm"]):
        add("Cm", text, value)
    # Powers that meet are written as one.
    made = {axis: {_joined(t): v for t, v in held.items()} for axis, held in made.items()}
    made["CZ"] |= {"q_hat": -6.0, "de": -0.40}
    made["CY"] = {"beta": -0.75, "p_hat": -0.05, "r_hat": 0.30, "dr": 0.17}
    made["Cl"] = {"beta": -0.090, "p_hat": -0.45, "r_hat": 0.15, "da": -0.12, "dr": 0.015}
    made["Cn"] = {"beta": 0.110, "p_hat": -0.04, "r_hat": -0.20, "da": 0.008, "dr": -0.090}
    aircraft = published_aircraft("hfb320").aircraft
    assert aircraft is not None
    engine = {"static_thrust": 36000.0, "V_thrust": 500.0, "h_power": 0.8, "spool": 0.9, "rpm_idle": 7000.0,
              "rpm_range": 9000.0}  # fmt: skip
    return TruthAircraft("hfb320", aircraft, _terms(made), (90.0, 140.0), (1500.0, 7000.0), 0.21, engine)


def _over_speed(held: Mapping[str, float]) -> list[tuple[str, float]]:
    """V_ratio as 1 + dV."""
    out = []
    for text, value in held.items():
        out += [("1", value), ("dV", value)] if text == "V_ratio" else [(text, value)]
    return out


def _joined(text: str) -> str:
    powers: dict[str, int] = {}
    for part in text.split("*"):
        name, _, power = part.partition("^")
        powers[name] = powers.get(name, 0) + int(power or 1)
    return "*".join(name if power == 1 else f"{name}^{power}" for name, power in powers.items())


def _hawk() -> TruthAircraft:
    long, lat = published_aircraft("hawk").linear["longitudinal"], published_aircraft("hawk").linear["lateral"]
    at = long.condition
    m, S, b, Ix, Iy, Iz = (float(at[k]) for k in ("mass", "S", "b", "Ix", "Iy", "Iz"))
    V, c = 105.5, 1.78
    qS = 0.5 * 1.225 * V**2 * S
    d = {**long.parameters, **lat.parameters}
    force = {"v": V * m / qS, "w": V * m / qS, "de": m / qS, "da": m / qS, "dr": m / qS, "q": m / qS * 2 * V / c}
    names = {"w": "alpha", "v": "beta", "q": "q_hat", "p": "p_hat", "r": "r_hat", "de": "de", "da": "da", "dr": "dr"}
    made: dict[str, dict[str, float]] = {
        "CX": {"1": -0.0228, "alpha": 0.025, "alpha^2": 3.1},
        "CZ": {"1": -0.10, **{names[k]: d["z" + k] * force[k] for k in ("w", "q", "de")}},
        "CY": {names[k]: d["y" + k] * force[k] for k in ("v", "dr")},
    }
    for axis, letter, I, length in (("Cl", "l", Ix, b), ("Cm", "m", Iy, c), ("Cn", "n", Iz, b)):
        scale = I / (qS * length)
        factor = {"v": V, "w": V, "p": 2 * V / b, "q": 2 * V / c, "r": 2 * V / b}
        kept = ("w", "q", "de") if letter == "m" else ("v", "p", "r", "da", "dr")
        made[axis] = {names[k]: d[letter + k] * scale * factor.get(k, 1.0) for k in kept}
    made["Cm"]["1"] = 0.02
    aircraft = Aircraft(name="Hawk", mass=m, S=S, b=b, cbar=c, inertia={"Ix": Ix, "Iy": Iy, "Iz": Iz, "Ixz": at["Ixz"]})
    engine = {"static_thrust": 23000.0, "V_thrust": 700.0, "h_power": 0.8, "spool": 0.7, "rpm_idle": 7000.0,
              "rpm_range": 7000.0}  # fmt: skip
    return TruthAircraft("hawk", aircraft, _terms(made), (100.0, 190.0), (1500.0, 8000.0), 0.22, engine)


_MADE = {"beaver": _beaver, "citation": _citation, "hfb320": _hfb320, "hawk": _hawk}
AIRCRAFT_NAMES = tuple(_MADE)
"""Names `truth` knows."""
_HELD: dict[str, TruthAircraft] = {}


def truth_aircraft(name: str) -> TruthAircraft:
    """A base aircraft by name."""
    if name not in _HELD:
        _HELD[name] = _MADE[name]()
    return _HELD[name]
