"""Diagnosis on real recordings: an effect is concealed from a simulation, and must be found; or nothing is.

A case is a function that gives a simulation, recordings, an aircraft and the names that are right. Where the
simulation is correct it was identified from other manoeuvres than those it is compared with.
"""

from __future__ import annotations

import argparse
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator
from scipy.io import loadmat
from scipy.signal import lfilter

import structsel as ss
from structsel.coefficients import compute_all
from structsel.numerics.air_data import body_to_earth, body_velocity
from structsel.numerics.arrays import Array
from structsel.numerics.output_error import fit_output_error
from structsel.numerics.output_error_problem import OutputErrorProblem
from structsel.recording import Recording

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT.parent / "shared" / "data"


@dataclass(frozen=True)
class Case:
    """A simulation beside recordings, and what a diagnosis may rightly say.

    Attributes
    ----------
    concealed : str
        What the simulation lacks; "nothing" where it is correct.
    simulation : any of the five forms
    recordings : list of Recording
    aircraft : Aircraft
    accept : frozenset of str
        Names that are right; empty where the verdict must be "consistent".
    expected : str
        The size it should have, where that is known.
    """

    concealed: str
    simulation: Any
    recordings: list[Recording]
    aircraft: ss.Aircraft
    accept: frozenset[str] = field(default_factory=frozenset)
    expected: str = ""


def rig(name: str, **tolerances: float) -> ss.Aircraft:
    """Stand-in for the constants of something that is no aircraft."""
    return ss.Aircraft.from_dict(
        {"name": name, "mass": 1.0, "S": 1.0, "b": 1.0, "cbar": 1.0, "tolerances": dict(tolerances)}
    )


def cut(recording: Recording, edges: Sequence[tuple[float, float]]) -> list[Recording]:
    """Parts of a recording, each a manoeuvre."""
    made = []
    for k, (start, end) in enumerate(edges, 1):
        part = recording.between(start, end)
        made.append(Recording(f"{recording.name} {k}", part.t, part.channels, part.units, part.provenance))
    return made


def evenly(start: float, end: float, count: int) -> list[tuple[float, float]]:
    """Edges of equal parts."""
    at = np.linspace(start, end, count + 1)
    return [(float(a), float(b)) for a, b in pairwise(at)]


def answers(recordings: Sequence[Recording], channel: str) -> dict[str, Recording]:
    """The forced simulation that each recording carries as ``simulated``."""
    return {r.name: Recording(r.name, r.t, {channel: r["simulated"]}, {channel: r.unit(channel)}) for r in recordings}


def without(recordings: Sequence[Recording], *channels: str) -> list[Recording]:
    """Recordings less some channels."""
    return [
        Recording(r.name, r.t, {c: r[c] for c in r.names if c not in channels}, r.units, r.provenance)
        for r in recordings
    ]


def plant_case(
    concealed: str, parts: list[Recording], channel: str, name: str, accept: Sequence[str] = (), expected: str = ""
) -> Case:
    """Case of recordings that carry what the simulation says of one channel."""
    return Case(concealed, answers(parts, channel), without(parts, "simulated"), rig(name), frozenset(accept), expected)


# ---------------------------------------------------------------- crazyflie: motors


CRAZYFLIE = {"log10": (8.7, 38.7), "log15": (15.8, 50.8)}
"""Windows [s] that the paper used of each log."""


def crazyflie_log(name: str, dt: float = 0.004) -> Recording:
    """A log with the vertical specific force, the motors' commands, their sum and the sum of their squares."""
    motors = {f"m{k}": {"column": f"motor_pwm[{k}]", "scale": 1.0 / 65535.0} for k in range(1, 5)}
    log = ss.read_recording(
        DATA / "crazyflie" / f"{name}.npz",
        {"channels": {"t": "t_s", "az": {"column": "acc_g[3]", "scale": -9.80665}, **motors}},
    )
    start, end = CRAZYFLIE[name]
    t = np.arange(start, end, dt)
    box = np.ones(round(dt / log.dt)) / round(dt / log.dt)  # keeps what is faster than the new clock out of it
    even = {c: np.interp(t, log.t, np.convolve(log[c], box, mode="same")) for c in log.names}
    w = [even[f"m{k}"] for k in range(1, 5)]
    return Recording(name, t, {"az": even["az"], "command": sum(w), "squares": sum(x**2 for x in w)})


def thrust_curve(recordings: Sequence[Recording]) -> ss.AeroModel:
    """Specific force as a quadratic of the four motors' commands."""
    terms = ["command", "squares"]
    return ss.select(recordings, "az", ss.Candidates.parse(terms), include=terms, noise="white", bootstrap=0).model


def lagged(recording: Recording, tau: float) -> Recording:
    """The motors' commands behind a first-order lag."""
    keep = np.exp(-recording.dt / tau)

    def behind(x: Array) -> Array:
        return lfilter([1.0 - keep], [1.0, -keep], x, zi=[keep * x[0]])[0]

    return recording.with_channels(**{c: behind(recording[c]) for c in ("command", "squares")})


def motor_lag(recording: Recording) -> float:
    """Lag [s] with which a quasi-steady thrust curve fits best."""
    spread = {}
    for tau in np.arange(0.02, 0.12, 0.0025):
        delayed = lagged(recording, tau)
        spread[tau] = np.std(delayed["az"] - thrust_curve([delayed]).evaluate(delayed, outside="ignore")["az"])
    return float(min(spread, key=spread.__getitem__))


def crazyflie() -> Case:
    """Quasi-steady thrust, fitted to the flight without a lag, as a user would."""
    log = crazyflie_log("log10")
    log = log.with_channels(simulated=thrust_curve([log]).evaluate(log)["az"])
    parts = cut(log, evenly(8.7, 38.7, 4))
    return plant_case("motor lag", parts, "az", "Crazyflie", ["actuator-lag", "thrust-lag"], "0.06 to 0.07 s")


def crazyflie_correct() -> Case:
    """Curve and lag of the flight's first half, on the second."""
    log = crazyflie_log("log10")
    first, second = cut(log, evenly(8.7, 38.7, 2))
    tau = motor_lag(first)
    delayed = lagged(log, tau)
    curve = thrust_curve([delayed.between(*first.t[[0, -1]])])
    log = log.with_channels(simulated=curve.evaluate(delayed, outside="ignore")["az"])
    return plant_case("nothing", cut(log, evenly(second.t[0], 38.7, 3)), "az", "Crazyflie")


# ---------------------------------------------------------------- silverbox: a cubic spring


def free_run(a: Sequence[float], b: Sequence[float], u: Array, cube: float = 0.0) -> Array:
    """Second-order difference equation with a cubic restoring force, run from rest."""
    if cube == 0.0:
        return lfilter(b, [1.0, *a], u)
    forced = lfilter(b, [1.0], u).tolist()
    y1 = y2 = 0.0
    made = np.empty(len(u))
    a1, a2 = float(a[0]), float(a[1])
    for k, f in enumerate(forced):
        y = f - a1 * y1 - a2 * y2 - cube * y1 * y1 * y1
        made[k], y1, y2 = y, y, y1
        if abs(y) > 1e6:
            made[k:] = np.inf
            break
    return made


def second_order(u: Array, y: Array) -> tuple[list[float], list[float]]:
    """Difference equation of a linear oscillator, by `select` with all its terms forced."""
    lags = {"y1": y[1:-1], "y2": y[:-2], "u0": u[2:], "u1": u[1:-1], "u2": u[:-2]}
    shifted = Recording(
        "lags", np.arange(len(u) - 2.0), {"answer": y[2:], **lags}, dict.fromkeys(("answer", *lags), "-")
    )
    made = ss.select(
        shifted, "answer", ss.Candidates.parse(list(lags)), include=list(lags), noise="white", bootstrap=0
    ).model["answer"]  # fmt: skip
    return [-made["y1"], -made["y2"]], [made["u0"], made["u1"], made["u2"]]


def silverbox_record() -> Recording:
    """Input and output on the benchmark's clock; levels taken out."""
    read = ss.read_recording(
        DATA / "silverbox" / "SNLS80mV.csv.gz",
        {
            "channels": {"u": {"column": "V1", "unit": "m/s"}, "y": {"column": "V2", "unit": "m"}},
            "file": {"dt": 2**14 / 1e7},
        },
    )
    volts = {name: read[name] - read[name][:100].mean() for name in ("u", "y")}
    return Recording("silverbox", read.t, {"input": volts["u"], "output": volts["y"]}, {"input": "V", "output": "V"})


def silverbox() -> Case:
    """A linear oscillator identified where the amplitude is small, before louder inputs."""
    record = silverbox_record()
    a, b = second_order(record["input"][:20000], record["output"][:20000])
    record = record.with_channels(simulated=free_run(a, b, record["input"]))
    parts = cut(record, [(49.0, 55.5), (56.0, 62.5), (75.0, 81.5), (90.0, 96.5), (105.0, 111.5)])
    return plant_case("cubic stiffness", parts, "output", "Silverbox", ["stiffening"])


def silverbox_correct() -> Case:
    """An oscillator with a cubic spring, refined on two realisations of the multisine, on others."""
    record = silverbox_record()
    first = record.between(75.0, 88.0)
    u, y = first["input"], first["output"]
    a, b = second_order(record["input"][:20000], record["output"][:20000])
    start = np.array([*a, *b, 0.0])
    scale = np.array([1.0, 1.0, 0.1, 0.1, 0.1, 1.0])

    def predict(thetas: Array) -> Array:
        return np.stack([free_run(x[:2], x[2:5], u, x[5] or 1e-12)[1000:, None] for x in thetas])

    theta = fit_output_error(OutputErrorProblem(predict, y[1000:, None]), start, scale=scale).theta
    record = record.with_channels(simulated=free_run(theta[:2], theta[2:5], record["input"], theta[5]))
    parts = cut(record, [(105.0, 111.5), (120.0, 126.5), (135.0, 141.5), (150.0, 156.5)])
    return plant_case("nothing", parts, "output", "Silverbox")


# ---------------------------------------------------------------- Bouc-Wen: hysteresis


def boucwen_record() -> Recording:
    """Force and displacement of the training record."""
    read = ss.read_recording(
        DATA / "boucwen" / "train.h5",
        {
            "channels": {"u": {"column": "u", "unit": "m/s"}, "y": {"column": "y", "unit": "m"}},
            "file": {"dt": 1.0 / 750.0, "variable": "multisine"},
        },
    )
    return Recording("boucwen", read.t, {"force": read["u"], "place": read["y"]}, {"force": "N", "place": "m"})


BOUC_WEN = np.array([2.0, 10.0, 5e4, 5e4, 800.0, -1100.0])
"""Mass, damping, stiffness, and alpha, beta gamma, beta delta of the benchmark's law."""


def bouc_wen_run(theta: Array, u: Array, dt: float, parts: int = 4) -> Array:
    """The benchmark's equations by Runge and Kutta, from rest; inputs straight between samples."""
    m, c, k, a, g, d = theta.tolist()

    def slope(y: float, v: float, z: float, f: float) -> tuple[float, float, float]:
        return v, (f - k * y - c * v - z) / m, a * v - g * abs(v) * z - d * v * abs(z)

    h = dt / parts
    y = v = z = 0.0
    made = np.zeros(len(u))
    forces = u.tolist()
    for i in range(1, len(u)):
        for j in range(parts):
            f0, f2 = (forces[i - 1] + (forces[i] - forces[i - 1]) * (j + s) / parts for s in (0.0, 1.0))
            f1 = 0.5 * (f0 + f2)
            k1 = slope(y, v, z, f0)
            k2 = slope(y + 0.5 * h * k1[0], v + 0.5 * h * k1[1], z + 0.5 * h * k1[2], f1)
            k3 = slope(y + 0.5 * h * k2[0], v + 0.5 * h * k2[1], z + 0.5 * h * k2[2], f1)
            k4 = slope(y + h * k3[0], v + h * k3[1], z + h * k3[2], f2)
            y, v, z = (x + h / 6.0 * (p + 2.0 * q + 2.0 * r + w) for x, p, q, r, w in zip((y, v, z), k1, k2, k3, k4))
        made[i] = y
    return made


def boucwen_correct() -> Case:
    """The benchmark's own equations and constants, on a part of the record."""
    record = boucwen_record().between(0.0, 24.0)
    record = record.with_channels(simulated=bouc_wen_run(BOUC_WEN, record["force"], record.dt))
    return plant_case("nothing", cut(record, evenly(6.0, 24.0, 3)), "place", "Bouc-Wen")


def boucwen() -> Case:
    """The best linear oscillator of the first half, on both halves."""
    record = boucwen_record()
    a, b = second_order(record["force"][:20480], record["place"][:20480])
    record = record.with_channels(simulated=free_run(a, b, record["force"]))
    parts = cut(record, [(2.0, 8.0), (12.0, 18.0), (30.0, 36.0), (42.0, 48.0)])
    return plant_case("hysteresis", parts, "place", "Bouc-Wen", ["mechanical-hysteresis"])


# ---------------------------------------------------------------- HFB-320


BOOK = {"CD": ["V_ratio", "alpha"], "CL": ["V_ratio", "alpha"], "Cm": ["V_ratio", "alpha", "V_ratio*q_hat", "de"]}
"""Terms of the published model."""
HFB_PARTS = [(0.0, 15.0), (15.0, 30.0), (30.0, 45.0), (45.0, 60.0)]


def hfb320_record() -> tuple[Recording, ss.Aircraft]:
    """The one record there is."""
    record = ss.read_recording(DATA / "hfb320" / "hfb320_1_10.asc", ROOT / "examples" / "hfb320_map.toml")
    return record, ss.Aircraft.from_toml(ROOT / "examples" / "hfb320.toml")


def fitted(flights: Sequence[Recording], terms: Mapping[str, Sequence[str]]) -> dict[str, ss.ResponseModel]:
    """Responses with exactly these terms."""
    made = {}
    for response, each in terms.items():
        pool = ss.Candidates.parse(list(each))
        made[response] = ss.select(flights, response, pool, include=list(each), noise="white", bootstrap=0).model[
            response
        ]
    return made


def held_at(model: ss.ResponseModel, channel: str, value: float) -> ss.ResponseModel:
    """The response with one channel's linear term frozen at a value: what a simulation without it says."""
    keep = [i for i, term in enumerate(model.terms) if str(term) != channel]
    values = np.array(model.values)
    values[[str(t) for t in model.terms].index("1")] += model[channel] * value
    return ss.ResponseModel(tuple(model.terms[i] for i in keep), values[keep])


def hfb320_speed() -> Case:
    """The published structure, with the airspeed's own terms frozen at the reference."""
    record, aircraft = hfb320_record()
    book = fitted(compute_all([record], aircraft), BOOK)
    frozen = ss.AeroModel({r: held_at(m, "V_ratio", 1.05) for r, m in book.items()}, name="no speed dependence")
    accept = ["missing-term", "compressibility", "flexibility"]  # all three follow the speed at one height
    return Case("speed dependence", frozen, cut(record, HFB_PARTS), aircraft, frozenset(accept))


def hfb320_drag() -> Case:
    """The published structure with a parabola for its drag, and the parabola's square left out."""
    record, aircraft = hfb320_record()
    polar = fitted(compute_all([record], aircraft), {**BOOK, "CD": ["V_ratio", "alpha^2"]})
    middle = float(np.mean(record["alpha"] ** 2))
    flat = ss.AeroModel({**polar, "CD": held_at(polar["CD"], "alpha^2", middle)}, name="no drag due to lift")
    return Case("quadratic drag", flat, cut(record, HFB_PARTS), aircraft, frozenset(["drag-polar"]))


def hfb320_correct() -> Case:
    """The published structure identified on the first half (3-2-1-1), on the second (pulse and phugoid)."""
    record, aircraft = hfb320_record()
    first = compute_all([record.between(0.0, 30.0)], aircraft)
    return Case("nothing", ss.AeroModel(fitted(first, BOOK), name="first half"), cut(record, HFB_PARTS)[2:], aircraft)


# ---------------------------------------------------------------- ATTAS


ATTAS = ("fAttasElv1", "fAttasAil1", "fAttasRud1", "fAttasElv2", "fAttasAilRud2")
STATES = ["alpha", "beta", "p_hat", "q_hat", "r_hat", "de", "da", "dr"]
SIX = ["CX", "CY", "CZ", "Cl", "Cm", "Cn"]


def attas_records() -> tuple[list[Recording], ss.Aircraft]:
    """Three manoeuvres and their repeats."""
    held = [
        part
        for name in ATTAS
        for part in ss.read_recording(
            DATA / "attas-manoeuvres" / f"{name}.mat", ROOT / "examples" / "attas_map.toml"
        ).split()
    ]  # fmt: skip
    return held, ss.Aircraft.from_toml(ROOT / "examples" / "attas.toml")


def chosen(flights: Sequence[Recording], responses: Sequence[str], pool: ss.Candidates) -> ss.AeroModel:
    """Model whose terms `select` chose."""
    return ss.select(flights, list(responses), pool, F_in="auto", bootstrap=0).model


def attas_vane() -> Case:
    """A model about the centre of gravity, evaluated at the readings of the boom's vanes 13 m ahead of it."""
    records, aircraft = attas_records()
    model = chosen(compute_all(records, aircraft), SIX, ss.Candidates.polynomial(STATES, 2))
    content = aircraft.to_dict()
    del content["sensors"]["vane"]
    return Case("vane 13.08 m ahead", model, records, ss.Aircraft.from_dict(content), frozenset(["sensor-position"]),
                "x 13.08 m")  # fmt: skip


def attas_correct() -> Case:
    """Terms chosen on three manoeuvres, on their repeats."""
    records, aircraft = attas_records()
    pool = ss.Candidates.parse([*STATES, "alpha^2", "beta^2"])
    return Case("nothing", chosen(compute_all(records[:3], aircraft), SIX, pool), records[3:], aircraft)


# ---------------------------------------------------------------- UAV-ART


UAV = "ProcessedData_2022_05_07_11_13_57.mat"
ELEVATOR = np.array([
    [22, 19, 17, 11.5, 8, 4, 0, -5.5, -8, -13.5, -20, -24, -30],
    [-4526, -3284, -2843, -1786, -1329, -880, 0, 1482, 1851, 2588, 2820, 3851, 4465],
])  # fmt: skip
LEFT = np.array([
    [-22, -18, -15.5, -10, -6, 0, 4, 9, 14, 18],
    [-4463, -2958, -2558, -1468, -943, 0, 1287, 2627, 3397, 4456],
])  # fmt: skip
RUDDER = np.array([[8, 4.5, 2.5, 0, -3, -6.5, -10], [1251, 722, 353, 0, -499, -964, -1429]])
"""Degrees and counts, as the team measured them."""


def uav_aircraft() -> ss.Aircraft:
    """The team's constants."""
    return ss.Aircraft.from_dict(
        {
            "name": "UAV-ART", "mass": 3.3, "S": 0.384, "b": 1.6, "cbar": 0.24,
            "inertia": {"Ix": 0.170, "Iy": 0.289, "Iz": 0.443, "Ixz": 0.019},
        }
    )  # fmt: skip


def degrees(counts: Array, table: Array) -> Array:
    """Deflection [rad] of a command."""
    order = np.argsort(table[1])
    return np.radians(np.interp(counts, table[1][order], table[0][order]))


def uav_record(manoeuvre: str, own_velocity: bool = False) -> Recording:
    """One manoeuvre; with the file's own (wrong) body velocities in place of air data where asked."""
    deg = {"phi": "roll", "theta": "pitch", "psi": "yaw", "alpha": "AoA", "beta": "beta"}
    plain = {"h": "h", "p": "p", "q": "q", "r": "r", "ax": "ax", "ay": "ay", "az": "az", "V": "Va",
             "vn": "VN", "ve": "VE", "vd": "VD", "ub": "u", "vb": "v", "wb": "w",
             "ce": "delta_e", "ca": "delta_a", "cr": "delta_r", "ct": "delta_t"}  # fmt: skip
    read = ss.read_recording(
        DATA / "uav-art" / UAV,
        {
            "channels": {"t": "time", **{k: {"column": v, "unit": "deg"} for k, v in deg.items()}, **plain},
            "file": {"variable": manoeuvre},
        },
        name=manoeuvre,
    )
    read = Recording(read.name, np.linspace(read.t[0], read.t[-1], len(read)), read.channels, read.units)
    thrust = 0.5 * 1.2682 * 0.0856 * 0.532 * ((34.3 * read["ct"] / 100.0) ** 2 - read["V"] ** 2)
    made = read.unwrap("psi").with_channels(
        de=degrees(read["ce"], ELEVATOR), da=-degrees(read["ca"], LEFT), dr=degrees(read["cr"], RUDDER), thrust=thrust
    )
    if own_velocity:
        speed = np.sqrt(made["ub"] ** 2 + made["vb"] ** 2 + made["wb"] ** 2)
        made = made.with_channels(
            V=speed, alpha=np.arctan2(made["wb"], made["ub"]), beta=np.arcsin(made["vb"] / speed)
        )  # fmt: skip
    return without([made], "ub", "vb", "wb", "ce", "ca", "cr", "ct")[0]


UAV_FIRST, UAV_SECOND = ("el_1", "el_2", "ail_1", "ail_2", "rud_1"), ("el_3", "el_4", "ail_3", "ail_4")


def uav_model() -> ss.AeroModel:
    """Terms chosen on the first manoeuvres of each kind."""
    flights = compute_all([uav_record(m) for m in UAV_FIRST], uav_aircraft())
    return chosen(flights, SIX, ss.Candidates.parse(STATES))


def uav_velocity() -> Case:
    """Air data made from the file's u, v, w, which were turned by degrees taken as radians."""
    records = without([uav_record(m, own_velocity=True) for m in UAV_SECOND], "vn", "ve", "vd")
    return Case(
        "u, v, w wrong", uav_model(), records, uav_aircraft(), frozenset(["refused", "unknown", "sensor-misalignment"])
    )


def uav_wind() -> Case:
    """Velocity over the ground beside the airspeed, on a windy day."""
    records = [uav_record(m) for m in UAV_SECOND]
    return Case("wind", uav_model(), records, uav_aircraft(), frozenset(["steady-wind"]))


def in_still_air(record: Recording) -> dict[str, Array]:
    """Velocity over the ground from airspeed and attitude; along the body axis x where no flow angle is recorded."""
    alpha, beta = (record[c] if c in record.names else 0.0 * record["V"] for c in ("alpha", "beta"))
    body = np.column_stack(body_velocity(record["V"], alpha, beta))
    earth = np.einsum("nij,nj->in", body_to_earth(record["phi"], record["theta"], record["psi"]), body)
    return dict(zip(("vn", "ve", "vd"), earth))


def speed_over_ground(record: Recording) -> dict[str, Array]:
    """Airspeed in still air."""
    return {"V": np.sqrt(record["vn"] ** 2 + record["ve"] ** 2 + record["vd"] ** 2)}


def mean_difference(records: Sequence[Recording], stated: Mapping[str, Mapping[str, Array]]) -> dict[str, float]:
    """Mean over all recordings of each stated channel, as measured less as stated."""
    channels = stated[records[0].name]
    return {c: float(np.concatenate([r[c] - stated[r.name][c] for r in records]).mean()) for c in channels}


def moved(stated: Mapping[str, Mapping[str, Array]], by: Mapping[str, float]) -> dict[str, dict[str, Array]]:
    """Stated channels with a constant added to each."""
    return {name: {c: x + by[c] for c, x in one.items()} for name, one in stated.items()}


def as_simulation(records: Sequence[Recording], stated: Mapping[str, Mapping[str, Array]]) -> dict[str, Recording]:
    """Stated velocities as the simulation of recordings."""
    return {r.name: Recording(r.name, r.t, stated[r.name], dict.fromkeys(stated[r.name], "m/s")) for r in records}


def uav_still_air(manoeuvres: Sequence[str], over_ground: bool, airspeed: bool = False) -> Case:
    """Velocity over the ground from air data and attitude, or airspeed from that velocity, as if no wind blew.

    Or with the mean wind of the day added, which leaves a correct simulation.
    """
    records = without([uav_record(m) for m in manoeuvres], "thrust")  # computed from the airspeed
    said = {r.name: speed_over_ground(r) if airspeed else in_still_air(r) for r in records}
    if over_ground:
        said = moved(said, mean_difference(records, said))
    accept = frozenset() if over_ground else frozenset(["steady-wind"])
    return Case("nothing" if over_ground else "wind", as_simulation(records, said), records, uav_aircraft(), accept)


def uav_ground() -> Case:
    """The velocity over the ground of the first manoeuvres of each kind, by a simulation in still air."""
    return uav_still_air(UAV_FIRST, over_ground=False)


def uav_ground_second() -> Case:
    """The same of the others."""
    return uav_still_air(UAV_SECOND, over_ground=False)


def uav_ground_correct() -> Case:
    """With the mean wind in the simulation."""
    return uav_still_air(UAV_FIRST, over_ground=True)


def uav_ground_second_correct() -> Case:
    """The same of the others."""
    return uav_still_air(UAV_SECOND, over_ground=True)


def uav_airspeed() -> Case:
    """The airspeed, by a simulation in still air."""
    return uav_still_air(UAV_FIRST, over_ground=False, airspeed=True)


def uav_airspeed_second() -> Case:
    """The same of the others."""
    return uav_still_air(UAV_SECOND, over_ground=False, airspeed=True)


def uav_correct() -> Case:
    """Terms chosen on half of the manoeuvres, on the others; commands, not deflections, are recorded."""
    records = without([uav_record(m) for m in UAV_SECOND], "vn", "ve", "vd")
    return Case("nothing (servos)", uav_model(), records, uav_aircraft(),
                frozenset(["actuator-lag", "actuator-rate-limit"]))  # fmt: skip


# ---------------------------------------------------------------- GTM database: stall


STALL = [0.105, 0.14, 0.157, 0.175, 0.192, 0.209, 0.227, 0.244, 0.262, 0.279, 0.314, 0.349, 0.384]
"""Knots [rad] of the table above 6 deg."""


def gtm_aircraft() -> ss.Aircraft:
    """About the constants of the 5.5 per cent model."""
    return ss.Aircraft.from_dict(
        {
            "name": "GTM T2", "mass": 22.5, "S": 0.5483, "b": 2.09, "cbar": 0.279,
            "inertia": {"Ix": 1.80, "Iy": 5.77, "Iz": 7.39, "Ixz": 0.16},
        }
    )  # fmt: skip


def gtm_table() -> Recording:
    """Points of the database at no sideslip, -5 to 24 deg, elevator -20 to 20 deg, as samples."""
    file = loadmat(DATA / "gtm-aero" / "T2_polynomial_aerodatabase.mat", squeeze_me=True, struct_as_record=False)
    base, ele, damp = file["C6_bas"], file["dC3_ele"], file["dC3_q"]
    alphas = np.concatenate([np.arange(-5.0, 6.0, 1.0), np.arange(6.0, 24.1, 0.5)])
    A, E, Q = (x.ravel() for x in np.meshgrid(alphas, [-20.0, -10.0, 0.0, 10.0, 20.0], [-0.005, 0.0, 0.005]))
    level, neutral = list(base.beta).index(0), list(ele.stab).index(0)
    points = {"alpha": np.radians(A), "de": np.radians(E), "q_hat": Q}
    for k, (name, i) in enumerate({"CX": 0, "CZ": 2, "Cm": 4}.items()):
        still = np.interp(A, base.alpha, base.data[:, level, i])
        moved = RegularGridInterpolator((ele.alpha, ele.elev), ele.data[:, level, neutral, :, k])(np.c_[A, E])
        turned = RegularGridInterpolator((damp.alpha, damp.qhat), damp.data[:, :, k])(np.c_[A, Q])
        points[name] = still + moved + turned
    return Recording("database", np.arange(float(len(A))), points)


def gtm_model(terms: Sequence[str], top: float = 24.0) -> ss.AeroModel:
    """The database up to an angle [deg], by given terms."""
    table = gtm_table()
    low = table["alpha"] <= np.radians(top) + 1e-9
    part = Recording("database", np.arange(float(low.sum())), {c: table[c][low] for c in table.names})
    return ss.AeroModel(fitted([part], {c: list(terms) for c in ("CX", "CZ", "Cm")}), name="GTM")


def gtm_flights(count: int = 8) -> list[Recording]:
    """Pull-ups into the stall and steps below it, simulated with the database and recorded with noise."""
    bent = [str(t) for t in ss.Candidates.splines("alpha", STALL)]
    truth = gtm_model(["alpha", *bent, "de", "q_hat", "alpha*de", "de^2", "alpha*q_hat"])
    noise = {"V": 0.1, "alpha": 0.002, "q": 0.003, "theta": 0.001, "ax": 0.03, "az": 0.06}
    flights = []
    for k in range(count):
        speed = (31.0, 34.0, 29.0, 37.0)[k % 4]
        start = ss.trim(truth, gtm_aircraft(), V=speed, h=300.0)
        t = np.arange(0.0, 12.0, 0.02)
        pull_up = np.radians((1.5, 4.0, 6.0, 3.0, 7.0, 5.0, 2.0, 8.0)[k])
        form = np.interp(t, *THREES[k % 2])
        inputs = {"t": t, "de": start.controls["de"] - pull_up * form, "thrust": start.controls["thrust"]}
        simulated = ss.simulate(truth, gtm_aircraft(), inputs, start=start, outside="ignore",
                            instruments=ss.Instruments(noise=noise, seed=k))  # fmt: skip
        keep = ("V", "alpha", "q", "theta", "ax", "az", "de", "thrust", "rho", "h")
        flights.append(Recording(f"m{k + 1:02}", simulated.t, {c: simulated[c] for c in keep}))
    return flights


THREES = (
    ([0, 1, 1.1, 2.2, 2.3, 3.0, 3.1, 3.5, 3.6, 4.0, 4.1, 7, 7.1, 8.5, 8.6, 12],
     [0, 0, 1, 1, -0.7, -0.7, 0.8, 0.8, -0.8, -0.8, 0, 0, 1, 1, 0, 0]),
    ([0, 1, 2.5, 3.5, 4.2, 4.3, 5.3, 5.4, 7, 7.1, 7.7, 7.8, 12],
     [0, 0, 1, 1, 0, -0.5, -0.5, 0, 0, 0.8, 0.8, 0, 0]),
)  # fmt: skip
"""A 3-2-1-1 and a step; a slow pull-up and a doublet: times [s] and fractions of the pull-up."""


def gtm_stall() -> Case:
    """A linear model of the database below 8 deg."""
    return Case("stall", gtm_model(["alpha", "de", "q_hat"], top=8.0), gtm_flights(), gtm_aircraft(),
                frozenset(["static-stall"]), "breaks at 10 to 12 deg")  # fmt: skip


def gtm_correct() -> Case:
    """Terms chosen on four flights, with breaks of slope among the candidates, on four others."""
    flights = gtm_flights()
    pool = ss.Candidates.polynomial(["alpha", "de", "q_hat"], 2) + ss.Candidates.splines("alpha", STALL[::2])
    return Case("nothing", chosen(compute_all(flights[::2], gtm_aircraft()), ["CX", "CZ", "Cm"], pool), flights[1::2],
                gtm_aircraft())  # fmt: skip


CASES: dict[str, Callable[[], Case]] = {
    f.__name__: f
    for f in (
        crazyflie, crazyflie_correct, silverbox, silverbox_correct, boucwen, boucwen_correct,
        hfb320_speed, hfb320_drag, hfb320_correct, attas_vane, attas_correct, uav_velocity, uav_wind, uav_correct,
        uav_ground, uav_ground_second, uav_ground_correct, uav_ground_second_correct, uav_airspeed, uav_airspeed_second,
        gtm_stall, gtm_correct,
    )
}  # fmt: skip
"""Every case by name."""


def judge(case: Case, found: ss.Diagnosis) -> str:
    """Whether a diagnosis is right: "yes", "tie" (declared), "second" (named later), "no"."""
    named = [f for f in found.findings if f.kind != "random"]
    if not case.accept:
        return "yes" if found.verdict == "consistent" else "no"
    if not named:
        return "no"
    if named[0].effect in case.accept:
        return "yes"
    if case.accept & set(named[0].ambiguous_with):
        return "tie"
    return "second" if any(f.effect in case.accept for f in named[1:]) else "no"


HEAD = ["case", "concealed", "verdict", "first finding", "p", "axes", "parameters", "right", "ties", "others",
        "held-out rrmse: delivered, refitted, with physics", "s"]  # fmt: skip


def row_of(name: str, case: Case, found: ss.Diagnosis, seconds: float) -> list[str]:
    """One line of the table."""
    named = [f for f in found.findings if f.kind != "random"]
    rest = [f.effect for f in found.findings if not named or f is not named[0]]
    if not named:
        left = ", ".join(f"{c} {r:.2f}" for c, (r, _) in found.remaining.items())
        return [name, case.concealed, found.verdict, "-", "", "", "", judge(case, found), "", ", ".join(rest), left,
                f"{seconds:.0f}"]  # fmt: skip
    first = named[0]
    physics = first.physics[0]
    values = "; ".join(f"{n} {e.value:.3g} +- {e.std:.1g} {e.unit}" for n, e in physics.parameters.items())
    bars = "; ".join(
        f"{c} {b.delivered.rrmse:.2f}, {b.refitted.rrmse:.2f}, {b.physics.rrmse:.2f}" for c, b in first.bars.items()
    )
    stated = [physics.effect, f"{physics.probability:.2f}", " ".join(first.axes), values, judge(case, found)]
    ties = " ".join(first.ambiguous_with)
    return [name, case.concealed, found.verdict, *stated, ties, ", ".join(rest), bars, f"{seconds:.0f}"]


def run(name: str) -> tuple[list[str], ss.Diagnosis | None]:
    """Build a case, diagnose it, and make its line."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ss.StructselWarning)
        case = CASES[name]()
        begun = time.perf_counter()
        try:
            found = ss.diagnose(case.simulation, case.recordings, case.aircraft)
        except ss.StructselError as error:
            text = " ".join(str(error).split())
            right = "yes" if "refused" in case.accept else "no"
            return [name, case.concealed, "refused", text, "", "", "", right, "", "", "", "0"], None
        return row_of(name, case, found, time.perf_counter() - begun), found


def main() -> None:
    """Run cases and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", default=list(CASES), help="by default all")
    parser.add_argument("--text", action="store_true", help="print the text of each diagnosis")
    a = parser.parse_args()
    rows = []
    for name in a.cases or list(CASES):
        try:
            row, found = run(name)
        except Exception:
            traceback.print_exc(file=sys.stderr)
            continue
        rows.append(row)
        if a.text and found is not None:
            print(f"## {name}\n\n{found}\n", flush=True)
        print(" | ".join(row), file=sys.stderr, flush=True)
    from timing import table

    print(table(HEAD, rows))


if __name__ == "__main__":
    main()
