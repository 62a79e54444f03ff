"""Effects of instruments in the polynomial plant, and vibrations that they feel.

They are independent of structsel's hypotheses of instruments.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import lsim

from proof.polynomial.effects import Effect, EffectContext, EffectDesign, Injection
from proof.scenario.errors import BIAS
from proof.scenario.instruments import InstrumentErrors

_SHOWS = {
    "alpha": ("CZ", "Cm", "CX"), "beta": ("CY", "Cl", "Cn"), "ax": ("CX",), "ay": ("CY",), "az": ("CZ",),
    "q": ("Cm", "CZ"), "p": ("Cl", "Cn", "CY"), "r": ("Cn", "Cl", "CY"),
}  # fmt: skip


def _pick(c: EffectContext, *channels: str) -> str:
    return str(c.rng.choice(channels))


def _bias(c: EffectContext) -> EffectDesign:
    channel = _pick(c, "alpha", "alpha", "beta", "az", "ay", "ax")
    jump = c.rng.random() < 0.7
    times = c.draw_times(c.choose_manoeuvres(3, 5) if jump else range(len(c.manoeuvres)), 0.2, 0.75)
    unit = c.sign() * 10.0 * BIAS[channel]
    on = [
        np.ones(len(f.t)) if not jump else np.zeros(len(f.t)) if a is None else (f.t >= a).astype(float)
        for f, a in zip(c.base, times)
    ]

    def at(size: float) -> Injection:
        errors = InstrumentErrors(bias={channel: [size * unit * x for x in on]})
        return Injection(errors=errors, parameters={"channel": channel, "bias": size * unit})

    tie: tuple[str, ...] = {"alpha": ("wrong-derivative",), "beta": ("asymmetry",), "ay": ("asymmetry",)}.get(
        channel, ()
    )
    tie += ("configuration-change",) if jump and channel in ("alpha", "az", "ax") else ()
    return EffectDesign(
        at,
        _SHOWS[channel],
        tie,
        low=0.3 if jump else 1.0,
        high=6.0,
        intervals=c.intervals_after(times) if jump else None,
    )


def _scale(c: EffectContext) -> EffectDesign:
    channel, sign = _pick(c, "alpha", "alpha", "beta", "az", "q", "p"), c.sign()

    def at(size: float) -> Injection:
        factor = sign * 0.15 * size
        return Injection(
            errors=InstrumentErrors(scale={channel: factor}), parameters={"channel": channel, "scale": 1.0 + factor}
        )

    tie = {
        "az": ("mass-error", "wrong-derivative"),
        "p": ("wrong-derivative", "inertia-error"),
        "q": ("wrong-derivative", "inertia-error"),
    }.get(channel, ("wrong-derivative", "sensor-bias"))
    return EffectDesign(at, _SHOWS[channel], tie, low=4.0 * c.tolerance("vane_scale") / 0.15, high=2.5)


def _delay(c: EffectContext) -> EffectDesign:
    channel = _pick(c, "alpha", "alpha", "beta", "q", "p")

    def at(size: float) -> Injection:
        return Injection(
            errors=InstrumentErrors(delay={channel: 0.12 * size}), parameters={"channel": channel, "delay": 0.12 * size}
        )

    tie = {
        "alpha": ("unsteady-lift", "downwash-lag", "sensor-position"),
        "beta": ("sidewash-lag", "sensor-position"),
    }.get(channel, ("actuator-lag", "inertia-error"))
    return EffectDesign(at, _SHOWS[channel], tie, low=max(4.0 * c.tolerance("delay") / 0.12, 0.15), high=4.0)


def _position(c: EffectContext) -> EffectDesign:
    air = c.truth.aircraft
    which = _pick(c, "accelerometer", "vane")
    unit = c.sign() * (1.0 if which == "accelerometer" else air.cbar * 1.5)
    low = 4.0 * c.tolerance("lever_arm") / abs(unit)

    def at(size: float) -> Injection:
        place = (size * unit, 0.0, 0.0)
        return Injection(
            errors=InstrumentErrors(place={which: place}), parameters={"instrument": which, "x": size * unit}
        )

    if which == "vane":
        return EffectDesign(at, ("CZ", "CY", "Cm", "Cl", "Cn"), ("sensor-delay", "wrong-derivative"), low=low, high=6.0)
    return EffectDesign(at, ("CZ", "CY", "CX"), ("sensor-delay", "wrong-derivative", "downwash-lag"), low=low, high=6.0)


def _misaligned(c: EffectContext) -> EffectDesign:
    channel, other = [("ax", "az"), ("ay", "az"), ("r", "p"), ("p", "r")][int(c.rng.integers(4))]
    sign = c.sign()

    def at(size: float) -> Injection:
        angle = sign * 0.05 * size
        return Injection(
            errors=InstrumentErrors(mix=((channel, other, angle),)),
            parameters={"channel": channel, "of": other, "angle": angle},
        )

    axes = {"ax": ("CX", "CZ"), "ay": ("CY", "CZ"), "r": ("Cn", "Cl", "CY"), "p": ("Cl", "Cn")}[channel]
    tie = {"ax": ("drag-polar", "wrong-derivative"), "ay": ("asymmetry", "sensor-bias", "cross-coupling")}.get(
        channel, ("missing-term", "wrong-derivative", "inertia-error")
    )
    return EffectDesign(at, axes, tie, low=4.0 * c.tolerance("alignment") / 0.05, high=4.0)


def _position_error(c: EffectContext) -> EffectDesign:
    sign = c.sign()

    def at(size: float) -> Injection:
        return Injection(
            errors=InstrumentErrors(scale={"V": sign * 0.05 * size}), parameters={"V scale": 1.0 + sign * 0.05 * size}
        )

    axes = ("CZ", "CX", "Cm", "CY", "Cl", "Cn")
    return EffectDesign(
        at,
        axes,
        ("mass-error", "sensor-scale"),
        ("sensor-scale",),
        low=max(0.3, 2.0 * c.tolerance("vane_scale") / 0.05),
        high=3.0,
    )


def _structural_mode(c: EffectContext) -> EffectDesign:
    """A bending mode driven by elevator and angle of attack (or rudder and sideslip), felt by the instruments."""
    side = c.rng.random() < 0.3
    rate = 1.0 / (c.base[0].t[1] - c.base[0].t[0])
    frequency, damping = float(c.rng.uniform(1.8, 0.16 * rate if rate < 40 else 6.0)), float(c.rng.uniform(0.02, 0.06))
    w = 2.0 * np.pi * frequency
    drive, felt, turned = ("dr", "ay", "r") if side else ("de", "az", "q")
    flow = "beta" if side else "alpha"
    lean = float(c.rng.uniform(0.2, 0.5))
    shake, turn = [], []
    for f in c.base:
        u = f.reads[f"{drive}_true"] - f.reads[f"{drive}_true"][0] + lean * (f.variable(flow) - f.variable(flow)[0])
        # Acceleration of the mode, and its speed.
        _, acceleration, _ = lsim(([w * w, 0.0, 0.0], [1.0, 2.0 * damping * w, w * w]), u, f.t)
        _, speed, _ = lsim(([w * w, 0.0], [1.0, 2.0 * damping * w, w * w]), u, f.t)
        shake.append(np.asarray(acceleration))
        turn.append(np.asarray(speed))
    unit = 0.6 / max(float(np.concatenate(shake).std()), 1e-9)

    def at(size: float) -> Injection:
        # The mode turns the fuselage little where the gyroscopes are.
        errors = InstrumentErrors(
            bias={felt: [size * unit * s for s in shake], turned: [0.002 * size * unit * s for s in turn]}
        )
        return Injection(errors=errors, parameters={"frequency": frequency, "damping": damping})

    axes = ("CY", "Cn") if side else ("CZ", "Cm")
    return EffectDesign(at, axes, ("turbulence", "slosh") if side else ("turbulence", "unsteady-lift"), low=0.02)


EFFECTS = (
    Effect("sensor-bias", ("sensor",), _bias),
    Effect("sensor-scale", ("sensor",), _scale, ("pull-up", "rudder", "elevator")),
    Effect("sensor-delay", ("sensor",), _delay, ("elevator", "large", "multisine", "rudder")),
    Effect("sensor-position", ("sensor",), _position, ("elevator", "rudder", "large")),
    Effect("sensor-misalignment", ("sensor",), _misaligned, ("pull-up", "aileron", "turns")),
    Effect("position-error", ("sensor",), _position_error, ("pull-up", "speeds", "rudder")),
    Effect("structural-mode", ("structural",), _structural_mode, ("elevator", "large", "rudder")),
)
