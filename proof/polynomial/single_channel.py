"""Plants with one response channel, such as an oscillator, and the physics that the simulation lacks.

Eight recordings each. An oscillator m y'' + c y' + k y = u with an end stop, a cubic spring, Bouc-Wen hysteresis or
friction that the simulation does not have; a rotor whose inflow follows the pitch of its blades late.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from proof.case_files import Case
from proof.keys import EffectKey, Form, Key, Kind
from proof.polynomial.effects import name
from proof.scenario.errors import severity_of
from proof.scenario.sizing import NotAttainable, bisect
from structsel.aircraft import Aircraft, Tolerances
from structsel.numerics.compiling import njit
from structsel.recording import Recording

_SUBSTEPS = 4
Values = dict[str, float]


@dataclass(frozen=True)
class _System:
    """The missing physics, its kind, and the names it is confused with."""

    effect: str
    kind: Kind
    tie: tuple[str, ...]


SINGLE_CHANNEL = {
    p.effect: p
    for p in (
        _System("stiffening", "static", ("missing-term",)),
        _System("mechanical-hysteresis", "memory", ("friction", "backlash")),
        _System("friction", "actuator", ("backlash", "mechanical-hysteresis")),
        _System("saturation", "static", ("control-nonlinearity",)),
        _System("rotor-inflow-lag", "memory", ("actuator-lag", "sensor-delay")),
    )
}


def make_single_channel(effect: str, wanted: float, seed: int, attempt: int, form: Form) -> Case:
    """A case of a response channel.

    Parameters
    ----------
    effect : str
        Of `SINGLE_CHANNEL`.
    wanted : float
        Attainable fraction aimed at.

    Raises
    ------
    NotAttainable
        Where the effect cannot be made that large or small.
    """
    rng = np.random.default_rng([seed, attempt, 5])
    tolerances, drawn = _draw(effect, rng, form)
    # The lag of an inflow is no less than 0.03 s.
    size, _ = bisect(drawn.attained, wanted, 0.15 if drawn.rotor else 1e-3, 8.0, 10)
    recorded, simulated, _ = drawn.at(size)
    fraction = drawn.attained(size)
    if not 0.05 < fraction < 0.97:
        raise NotAttainable(effect)
    channel, plant = drawn.channel, SINGLE_CHANNEL[effect]
    aircraft = Aircraft(
        name=f"plant {seed}", mass=2200.0 if drawn.rotor else 1.0, S=1.0, b=1.0, cbar=1.0, tolerances=tolerances
    )
    kept = ("u", "q", "theta") if drawn.rotor else ("u", "y", "v", "a") if channel == "a" else ("u", "y")
    names = {n: "dlon" if drawn.rotor and n == "u" else n for n in kept}
    recordings = [Recording(name(k), drawn.t, {names[n]: recorded[n][k] for n in kept}) for k in range(8)]
    injection = EffectKey(
        effect=effect, accept=(effect,), tie=plant.tie, kinds=(plant.kind,), axes=(channel,),
        parameters={**_physical(effect, size, drawn.largest), **drawn.p},
    )  # fmt: skip
    key = Key(
        verdicts=("mismatch",), form="forced" if channel == "a" else "free", severity=severity_of(fraction),
        attainable={channel: fraction}, effects=(injection,), seed=seed,
        source=f"polynomial/{'rotor' if drawn.rotor else 'oscillator'}",
    )  # fmt: skip
    outputs = {name(k): {"t": drawn.t, channel: simulated[k]} for k in range(8)}
    return Case(f"case-{seed:05d}", aircraft, recordings, outputs, key)


@dataclass(frozen=True, eq=False)
class _Drawn:
    """A plant with its inputs and all that is drawn but the size of the effect.

    Attributes
    ----------
    number : int
        Of the effect in `SINGLE_CHANNEL`.
    rotor : bool
    channel : str
        The response: ``a`` at the recorded states, ``y`` or ``q`` of a simulation of its own.
    t : (n,) array [s]
    u : (8, n) array
    p, wrong : mapping
        Parameters of the truth, and of the simulation within its tolerances.
    noise : int
        Seed of the readings.
    largest : float
        Largest deflection without the effect.
    """

    number: int
    rotor: bool
    channel: str
    t: np.ndarray
    u: np.ndarray
    p: Values
    wrong: Values
    noise: int
    largest: float

    def at(self, size: float) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
        """Readings, and the response of the simulation without and with the effect."""
        limit = self.largest / (1.0 + size)  # the stop draws nearer as the size grows
        truth = _fly(self.t, self.u, self.p, self.number, size, limit)
        recorded = _read(truth, np.random.default_rng(self.noise))
        if self.channel == "a":
            stated = _forced(self.u, truth, self.wrong)
            return recorded, stated, stated + truth["force"]
        without, perfect = (_fly(self.t, self.u, self.wrong, self.number, x, limit) for x in (0.0, size))
        return recorded, without[self.channel], perfect[self.channel]

    def attained(self, size: float) -> float:
        """Fraction by which the effect lowers the rms of measured minus simulated."""
        recorded, before, after = self.at(size)
        b, a = (float(np.sqrt(np.mean((recorded[self.channel] - s) ** 2))) for s in (before, after))
        return 1.0 - a / b


def _draw(effect: str, rng: np.random.Generator, form: Form) -> tuple[Tolerances, _Drawn]:
    """Stated tolerances and a plant."""
    rotor = effect == "rotor-inflow-lag"
    rate, duration = (50.0, 30.0) if rotor else (100.0, 20.0)
    t = np.arange(round(duration * rate) + 1) / rate
    u = _inputs(t, rng, steps=rotor)
    tolerances = Tolerances() if rng.random() < 0.4 else Tolerances(main=0.01, secondary=0.03)
    p = _rotor(rng) if rotor else _oscillator(rng)
    wrong = {n: v * (1.0 + 0.5 * float(tolerances.main) * float(rng.standard_normal())) for n, v in p.items()}
    channel = "q" if rotor else ("a" if form == "forced" else "y")
    number, noise = list(SINGLE_CHANNEL).index(effect), int(rng.integers(2**31))
    largest = 0.0 if rotor else float(np.abs(_fly(t, u, p, number, 0.0, 0.0)["y"]).max())
    return tolerances, _Drawn(number, rotor, channel, t, u, p, {**p, **wrong}, noise, largest)


def _physical(effect: str, size: float, largest: float) -> Values:
    """The size in terms of the physical parameter."""
    return {
        "stiffening": {"k3/k": 0.3 * size},
        "mechanical-hysteresis": {"kz/k": 0.3 * size},
        "friction": {"force/k": 0.15 * size},
        "saturation": {"limit": largest / (1.0 + size)},
        "rotor-inflow-lag": {"tau": 0.2 * size},
    }[effect]


def _inputs(t: np.ndarray, rng: np.random.Generator, steps: bool) -> np.ndarray:
    """(8, n) inputs of several sizes: multisines, pulses and sweeps."""
    made = []
    for k in range(8):
        size = float(rng.choice([0.4, 0.7, 1.0, 1.4]))
        if k % 3 == 0 or (not steps and k % 3 == 1):
            f = np.arange(1, 36 if steps else 60) / t[-1] * (2 if k % 2 and not steps else 1)
            wave = np.cos(2 * np.pi * np.outer(f, t) + rng.uniform(0, 2 * np.pi, (f.size, 1))).sum(axis=0) / np.sqrt(
                f.size / 2
            )
        elif k % 3 == 1:
            edges = np.sort(rng.uniform(1.0, t[-1] - 1.0, 12))
            wave = np.where(np.searchsorted(edges, t) % 2 == 1, 1.0, -1.0) * (t > edges[0])
        else:
            fast = 1.0 if steps else 2.5
            wave = np.sin(2 * np.pi * (0.1 * t + 0.5 * (fast / t[-1]) * t**2)) * np.clip(t, 0.0, 1.0)
        made.append(size * wave)
    return np.array(made)


def _oscillator(rng: np.random.Generator) -> Values:
    omega = 2 * np.pi * rng.uniform(0.8, 1.8)
    return {"c": float(2 * rng.uniform(0.05, 0.2) * omega), "k": float(omega**2), "g": float(omega**2)}


@njit(cache=True)
def _extra(effect, k, c, y, v, z, size, limit):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Acceleration that the simulation lacks; number of `SINGLE_CHANNEL`."""
    if size <= 0.0:
        return 0.0
    if effect == 0:
        return -size * 0.3 * k * y**3
    if effect == 1:
        return -size * 0.3 * k * z
    if effect == 2:
        return -size * 0.15 * k * np.tanh(v / 0.05) * (1.0 + 0.4 * np.exp(-((v / 0.3) ** 2)))
    if effect == 3 and abs(y) > limit:
        # A stop: a stiff spring, and some loss, beyond the limit.
        return -10.0 * k * (abs(y) - limit) * np.sign(y) - 3.0 * c * v
    return 0.0


@njit(cache=True)
def _slope(rotor, effect, p, size, limit, x, u, out):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    if rotor:
        # Pitch: q' = g tilt - m q - k theta; the tilt follows the actuator by the inflow's lag.
        lag = 0.2 * size
        tilt = x[3] if lag > 1e-4 else x[2]
        out[0], out[1] = p[2] * tilt - p[3] * x[0] - p[1] * x[1], x[0]
        out[2], out[3] = p[4] * (u - x[2]), (x[2] - x[3]) / max(lag, 4e-3)
        return
    y, v, z = x[0], x[1], x[2]
    out[0] = v
    out[1] = p[2] * u - p[0] * v - p[1] * y + _extra(effect, p[1], p[0], y, v, z, size, limit)
    # Bouc-Wen: z' = A v - beta |v| z - gamma v |z|
    out[2], out[3] = 2.0 * v - 1.4 * abs(v) * z - 0.6 * v * abs(z), 0.0


@njit(cache=True)
def _integrate(rotor, effect, p, size, limit, dt, u, substeps):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """(4, recordings, n) states from rest by classical Runge-Kutta, inputs linear between samples."""
    out = np.zeros((4, *u.shape))
    h = dt / substeps
    k1, k2, k3, k4 = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(4)
    for m in range(u.shape[0]):
        x = np.zeros(4)
        for i in range(u.shape[1] - 1):
            rise = u[m, i + 1] - u[m, i]
            for j in range(substeps):
                first = u[m, i] + rise * j / substeps
                middle, last = first + 0.5 * rise / substeps, first + rise / substeps
                _slope(rotor, effect, p, size, limit, x, first, k1)
                _slope(rotor, effect, p, size, limit, x + 0.5 * h * k1, middle, k2)
                _slope(rotor, effect, p, size, limit, x + 0.5 * h * k2, middle, k3)
                _slope(rotor, effect, p, size, limit, x + h * k3, last, k4)
                x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            out[:, m, i + 1] = x
    return out


_ORDER = "ckgma"
"""Parameters in the order in which compiled code takes them."""


def _fly(t: np.ndarray, u: np.ndarray, p: Values, effect: int, size: float, limit: float) -> dict[str, np.ndarray]:
    rotor = "m" in p
    values = np.array([p.get(n, 0.0) for n in _ORDER])
    x = _integrate(rotor, effect, values, size, limit, t[1] - t[0], u, _SUBSTEPS)
    if rotor:
        return {"q": x[0], "theta": x[1], "u": u}
    y, v, z = x[:3]
    force = np.vectorize(_extra)(effect, p["k"], p["c"], y, v, z, size, limit)
    made = {"y": y, "v": v, "force": force, "u": u}
    return {**made, "a": _forced(u, made, p) + force}


def _forced(u: np.ndarray, at: dict[str, np.ndarray], p: Values) -> np.ndarray:
    return p["g"] * u - p["c"] * at["v"] - p["k"] * at["y"]


def _rotor(rng: np.random.Generator) -> Values:
    return {
        "m": float(rng.uniform(1.0, 2.2)),
        "g": float(rng.uniform(0.3, 0.6)),
        "k": float(rng.uniform(0.3, 0.8)),
        "a": float(rng.uniform(25.0, 40.0)),
    }


def _read(truth: dict[str, np.ndarray], rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Readings with noise; the input is known well, biases differ from recording to recording."""
    made = {}
    for channel, values in truth.items():
        scale = float(values.std())
        part = 0.002 if channel == "u" else 0.05 if channel in ("q", "theta") else 0.015
        noise = rng.standard_normal(values.shape) + 0.5 * rng.standard_normal((len(values), 1)) * (channel != "u")
        made[channel] = values + part * scale * noise
    return made
