"""Effects that are not in the library; the right answer is "unknown"."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.signal import lfilter, sawtooth

from proof.keys import Kind
from proof.polynomial.effects import Effect, EffectContext, EffectDesign, Injection
from proof.polynomial.flight import InjectedPhysics

_ANY: tuple[Kind, ...] = ("static", "memory", "random", "structural", "atmospheric")
Signal = Callable[[np.ndarray, np.random.Generator], np.ndarray]


def _periodic(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.sin(2 * np.pi * 0.37 * t + rng.uniform(0, 2 * np.pi))


def _sawtooth(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return sawtooth(2 * np.pi * t / 9.0 + rng.uniform(0, 2 * np.pi))


def _walk(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    made = lfilter([1.0], [1.0, -0.9995], rng.standard_normal(len(t)))
    return made / 30.0


def _telegraph(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    flips = np.sort(rng.uniform(t[0], t[-1], 7))
    return (-1.0) ** np.searchsorted(flips, t) * 1.0


def _chaos(t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """First coordinate of Lorenz's system, slowed down."""
    x = rng.uniform(-5.0, 5.0, 3) + np.array([0.0, 0.0, 25.0])
    out = np.empty(len(t))
    h = 0.008
    for i in range(len(t)):
        out[i] = x[0]
        x = x + h * np.array([10.0 * (x[1] - x[0]), x[0] * (28.0 - x[2]) - x[1], x[0] * x[1] - 8.0 / 3.0 * x[2]])
    return out / 8.0


def _clocked(
    signal: Signal, pairs: Sequence[tuple[str, str]], tie: tuple[str, ...] = ()
) -> Callable[[EffectContext], EffectDesign]:
    def make(c: EffectContext) -> EffectDesign:
        axis, text = pairs[int(c.rng.integers(len(pairs)))]
        unit = c.sign() * float(
            np.concatenate([f.coefs for f in c.base])[:, ("CX", "CY", "CZ", "Cl", "Cm", "Cn").index(axis)].std()
        )
        if text != "clock":
            unit /= max(float(c.product(text.replace("clock*", "")).std()), 1e-9)
        schedules = [signal(p.t, c.rng) for p in c.manoeuvres]

        def at(size: float) -> Injection:
            value = 0.5 * size * unit
            return Injection(
                InjectedPhysics([(axis, text, value)], schedules={"clock": schedules}),
                parameters={f"{axis}:{text}": value},
            )

        return EffectDesign(at, (axis,), tie)

    return make


def _of(pairs: Sequence[tuple[str, str]]) -> Callable[[EffectContext], EffectDesign]:
    def make(c: EffectContext) -> EffectDesign:
        axis, text = pairs[int(c.rng.integers(len(pairs)))]
        value = c.sign() * c.equal_scatter(axis, text)
        return EffectDesign(
            lambda size: Injection(
                InjectedPhysics([(axis, text, size * value)]), parameters={f"{axis}:{text}": size * value}
            ),
            (axis,),
        )

    return make


_EACH = (("Cm", "clock"), ("Cl", "clock"), ("CX", "clock"), ("CY", "clock"), ("Cn", "clock"))
EFFECTS = (
    Effect("unknown", _ANY, _clocked(_periodic, _EACH), label="periodic forcing at 0.37 Hz, whatever the manoeuvre"),
    Effect("unknown", _ANY, _clocked(_sawtooth, _EACH), label="sawtooth of the time of day, 9 s"),
    Effect(
        "unknown",
        _ANY,
        _clocked(_walk, (("Cm", "clock"), ("CZ", "clock"), ("Cn", "clock")), ("turbulence",)),
        label="random walk of a coefficient",
    ),
    Effect(
        "unknown",
        _ANY,
        _clocked(_telegraph, (("CX", "clock"), ("Cm", "clock"), ("Cl", "clock")), ("configuration-change", "gust")),
        label="coefficient jumps between two values",
    ),
    Effect(
        "unknown",
        _ANY,
        _clocked(_chaos, (("Cm", "clock"), ("Cn", "clock"), ("CY", "clock")), ("turbulence",)),
        label="chaotic forcing",
    ),
    Effect(
        "unknown",
        _ANY,
        _clocked(_periodic, (("Cm", "clock*de"), ("Cl", "clock*da"), ("CZ", "clock*alpha"))),
        ("large", "elevator", "aileron"),
        label="effectiveness that swings at 0.37 Hz",
    ),
    Effect(
        "unknown",
        _ANY,
        _of((("Cn", "heading"), ("CY", "heading"), ("Cm", "heading"))),
        ("turns", "turns", "turns"),
        label="sawtooth of the heading",
    ),
    Effect(
        "unknown",
        _ANY,
        _of((("Cm", "angle_of_bank^2"), ("CX", "angle_of_bank^2"), ("CZ", "angle_of_bank"))),
        ("turns", "turns", "sideslip"),
        label="coefficient follows the bank angle",
    ),
    Effect(
        "unknown",
        _ANY,
        _of((("Cm", "heading*alpha"), ("Cl", "heading*da"), ("Cn", "heading*beta"))),
        ("turns", "turns", "aileron"),
        label="slope that depends on the heading",
    ),
)
