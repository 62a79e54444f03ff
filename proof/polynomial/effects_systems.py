"""Effects of mass, actuators and air in the polynomial plant.

Their formulas are from the literature and independent of structsel's hypotheses.
"""

from __future__ import annotations

import numpy as np

from proof.polynomial.effects import Effect, EffectContext, EffectDesign, Injection, name, with_terms
from proof.polynomial.flight import InjectedPhysics
from proof.scenario.instruments import InstrumentErrors
from structsel.numerics.atmosphere import dryden_gusts, one_minus_cosine

_AXIS = {"de": "Cm", "da": "Cl", "dr": "Cn"}


def _mass_error(c: EffectContext) -> EffectDesign:
    sign, burnt = c.sign(), c.rng.random() < 0.4
    if burnt:
        # Fuel used from one manoeuvre to the next: lighter and lighter.
        fraction = [k / (len(c.manoeuvres) - 1.0) for k in range(len(c.manoeuvres))]

    def at(size: float) -> Injection:
        if not burnt:
            return Injection(
                InjectedPhysics(mass=1.0 + sign * 0.06 * size), parameters={"factor": 1.0 + sign * 0.06 * size}
            )
        of = [np.full(len(p.schedules), 1.0 - 0.1 * size * s) for p, s in zip(c.manoeuvres, fraction)]
        return Injection(InjectedPhysics(mass_of=of), parameters={"burnt": 0.1 * size})

    return EffectDesign(
        at, ("CZ", "CX", "CY"), ("wrong-derivative", "position-error"), low=4.0 * c.tolerance("mass") / 0.06, high=4.0
    )


def _cg_shift(c: EffectContext) -> EffectDesign:
    air, lateral, sign = c.truth.aircraft, c.rng.random() < 0.3, c.sign()
    key, length = ("arm_y", 0.02 * air.b) if lateral else ("arm_x", 0.06 * air.cbar)

    def at(size: float) -> Injection:
        settings = {key: sign * size * length}
        return Injection(
            InjectedPhysics(settings=settings), parameters={"y" if lateral else "x": -sign * size * length}
        )

    low = 4.0 * c.tolerance("cg") * air.cbar / length
    if lateral:
        return EffectDesign(at, ("Cl", "Cn"), ("asymmetry", "cross-coupling"), low=low, high=4.0)
    return EffectDesign(at, ("Cm",), ("wrong-derivative", "thrust-line"), low=low, high=4.0)


def _inertia_error(c: EffectContext) -> EffectDesign:
    key, axis = [("Ix", "Cl"), ("Iy", "Cm"), ("Iz", "Cn")][int(c.rng.integers(3))]
    sign = c.sign()

    def at(size: float) -> Injection:
        factor = 1.0 + sign * 0.25 * size
        return Injection(InjectedPhysics(inertia={key: factor}), parameters={key: factor})

    tie = ("wrong-derivative", "sensor-delay")
    return EffectDesign(at, (axis,), tie, low=4.0 * c.tolerance("inertia") / 0.25, high=2.2)


def _store_release(c: EffectContext) -> EffectDesign:
    times = c.draw_times(c.choose_manoeuvres(3, 4))
    steps, pitch, roll = c.steps(times), c.sign() * 0.012, c.sign() * 0.002

    def at(size: float) -> Injection:
        gone = min(0.06 * size, 0.3)
        terms = [("CX", "cfg", 0.006 * size), ("Cm", "cfg", pitch * size), ("Cl", "cfg", roll * size)]
        physics = InjectedPhysics(
            terms, schedules={"cfg": steps}, mass_of=[1.0 - gone * s for s in steps], after=1.0 - 0.6 * gone
        )
        return Injection(physics, parameters={"mass released": gone * (c.truth.aircraft.mass or 0.0)})

    return EffectDesign(
        at, ("CZ", "Cm", "CX", "Cl"), ("configuration-change",), low=0.05, high=4.0, intervals=c.intervals_after(times)
    )


def _control(c: EffectContext) -> tuple[str, float]:
    """One of the surfaces, and how far it usually goes from its middle."""
    control = str(c.rng.choice(["de", "de", "da", "dr"]))
    values = c.product(control)
    return control, float(np.quantile(np.abs(values - np.median(values)), 0.99))


def _actuator_lag(c: EffectContext) -> EffectDesign:
    control, _ = _control(c)
    key = "lag" if c.rng.random() < 0.7 else "delay"

    def at(size: float) -> Injection:
        return Injection(
            InjectedPhysics(surfaces={control: {key: 0.1 * size}}), parameters={"channel": control, key: 0.1 * size}
        )

    tie = ("sensor-delay", "actuator-rate-limit", "wrong-derivative")
    return EffectDesign(at, (_AXIS[control],), tie, low=max(0.12, 40.0 * c.tolerance("delay")), high=4.0)


def _rate_limit(c: EffectContext) -> EffectDesign:
    control, reach = _control(c)

    def at(size: float) -> Injection:
        rate = reach / (0.25 * size)
        return Injection(
            InjectedPhysics(surfaces={control: {"rate": rate}}), parameters={"channel": control, "rate": rate}
        )

    return EffectDesign(at, (_AXIS[control],), ("actuator-lag",), low=0.15, high=5.0, intervals="active")


def _saturation(c: EffectContext) -> EffectDesign:
    control, _ = _control(c)
    values = c.product(control)
    middle, largest = float(np.median(values)), float(np.abs(values - np.median(values)).max())
    both, upper = c.rng.random() < 0.5, c.rng.random() < 0.5

    def at(size: float) -> Injection:
        reach = largest * (1.0 - min(0.35 * size, 0.85))
        ends = {"high": middle + reach, "low": middle - reach}
        kept = ends if both else {("high" if upper else "low"): ends["high" if upper else "low"]}
        return Injection(InjectedPhysics(surfaces={control: kept}), parameters={"channel": control, **kept})

    return EffectDesign(
        at, (_AXIS[control],), ("control-nonlinearity",), low=0.05, high=2.4, intervals="active", region=control
    )


def _backlash(c: EffectContext) -> EffectDesign:
    control, reach = _control(c)

    def at(size: float) -> Injection:
        width = 0.4 * reach * size
        return Injection(
            InjectedPhysics(surfaces={control: {"backlash": width}}), parameters={"channel": control, "width": width}
        )

    return EffectDesign(at, (_AXIS[control],), ("actuator-lag", "friction"), low=0.05, high=3.5)


def _augmentation(c: EffectContext) -> EffectDesign:
    control, key, rate, axis, kinds = [
        ("de", "aug_q", "q", "Cm", "q"),
        ("da", "aug_p", "p", "Cl", "p"),
        ("dr", "aug_r", "r", "Cn", "r"),
    ][int(c.rng.integers(3))]
    held = float(np.concatenate([f.state(rate) for f in c.base]).std())
    surface = float(c.product(control).std())
    always = c.rng.random() < 0.3
    off = [] if always else c.choose_manoeuvres(3, 5)
    half = {k: float(c.rng.uniform(0.35, 0.65) * c.manoeuvres[k].duration) for k in off if c.rng.random() < 0.5}
    # The plans say "on"; where the system is off that is taken away.
    schedules = [
        -(p.t < half.get(k, np.inf)).astype(float) if k in off else np.zeros(len(p.schedules))
        for k, p in enumerate(c.manoeuvres)
    ]
    intervals = {
        name(k): [(0.0, p.duration)] if k not in off else [(round(half[k], 2), p.duration)] if k in half else []
        for k, p in enumerate(c.manoeuvres)
    }

    def at(size: float) -> Injection:
        gain = 0.5 * size * surface / max(held, 1e-3)
        physics = InjectedPhysics(surfaces={control: {key: gain}}, schedules={"aug": schedules})
        return Injection(physics, parameters={"channel": control, f"gain on {kinds}": gain})

    tie = ("wrong-derivative",) if always else ()
    return EffectDesign(at, (axis,), tie, high=3.0, intervals=None if always else intervals)


def _steady_wind(c: EffectContext) -> EffectDesign:
    direction = float(c.rng.uniform(0.0, 2.0 * np.pi))

    def at(size: float) -> Injection:
        wind = {"wind_n": 8.0 * size * np.cos(direction), "wind_e": 8.0 * size * np.sin(direction)}
        return Injection(InjectedPhysics(settings=wind), parameters=dict(wind))

    return EffectDesign(at, ("vn", "ve"), ("sensor-bias", "wind-shear"), low=0.2, high=2.5)


def _wind_shear(c: EffectContext) -> EffectDesign:
    direction = float(c.rng.uniform(0.0, 2.0 * np.pi))
    still = float(np.mean(np.concatenate([f.state("h") for f in c.base])))  # m, where no wind blows

    def at(size: float) -> Injection:
        shear = {"shear_n": 0.06 * size * np.cos(direction), "shear_e": 0.06 * size * np.sin(direction)}
        return Injection(InjectedPhysics(settings={**shear, "shear_h": still}), parameters=shear)

    return EffectDesign(at, ("vn", "ve"), ("steady-wind", "gust"), low=0.02, high=4.0)


def _gust(c: EffectContext) -> EffectDesign:
    side = c.rng.random() < 0.3
    chosen = c.choose_manoeuvres(3, 5)
    starts, lengths = c.draw_times(chosen, 0.2, 0.8), c.rng.uniform(0.5, 2.0, len(c.manoeuvres))
    signs = [c.sign() for _ in c.manoeuvres]
    unit = [
        np.zeros(len(p.schedules)) if a is None else one_minus_cosine(p.t, a, float(d), s * 0.05 * p.V)
        for p, a, d, s in zip(c.manoeuvres, starts, lengths, signs)
    ]
    intervals = {
        name(k): [] if a is None else [(round(a, 2), round(a + float(lengths[k]), 2))] for k, a in enumerate(starts)
    }

    def at(size: float) -> Injection:
        column = "gv" if side else "gw"
        return Injection(
            InjectedPhysics(schedules={column: [size * u for u in unit]}),
            InstrumentErrors(vanes_blind=True),
            {"angle": 0.05 * size},
        )

    axes = ("CY", "Cn", "Cl") if side else ("CZ", "Cm", "CX")
    return EffectDesign(at, axes, ("turbulence", "configuration-change"), high=3.0, intervals=intervals)


def turbulence_at(c: EffectContext) -> list[np.ndarray]:
    """(steps, 6) gusts of each manoeuvre, of one metre per second along w, scale as at medium height."""
    seeds = c.rng.integers(2**31, size=len(c.manoeuvres))
    scale = float(c.rng.uniform(150.0, 500.0))
    return [
        dryden_gusts(p.t, p.V, c.truth.aircraft.b, np.full(3, scale), np.ones(3), np.random.default_rng(int(s)))
        for p, s in zip(c.manoeuvres, seeds)
    ]


def _turbulence(c: EffectContext) -> EffectDesign:
    gusts, blind = turbulence_at(c), c.rng.random() < 0.3

    def at(size: float) -> Injection:
        schedules = {n: [size * g[:, j] for g in gusts] for j, n in enumerate(("gu", "gv", "gw", "gp", "gq", "gr"))}
        return Injection(
            InjectedPhysics(schedules=schedules),
            InstrumentErrors(vanes_blind=blind, without_gusts=not blind),
            {"sigma": size},
        )

    return EffectDesign(at, ("CZ", "CY", "Cm", "Cl", "Cn", "CX"), ("gust", "unknown"), low=0.05, high=3.0)


def _slosh(c: EffectContext) -> EffectDesign:
    settings = {
        "slosh_frequency": float(c.rng.uniform(2.0, 4.5)),
        "slosh_damping": float(c.rng.uniform(0.03, 0.1)),
        "slosh_length": 0.8,
    }
    force = -0.15
    at = with_terms(("CY", "slosh", force), ("Cl", "slosh", -0.05 * force), settings=settings)
    return EffectDesign(at, ("CY", "Cl"), ("structural-mode",), low=0.02, high=4.0)


_QUICK = ("large", "large", "elevator", "aileron", "rudder")
EFFECTS = (
    Effect("mass-error", ("inertial",), _mass_error, ("pull-up", "turns")),
    Effect("cg-shift", ("inertial",), _cg_shift, ("pull-up", "turns", "large")),
    Effect("inertia-error", ("inertial",), _inertia_error, ("elevator", "aileron", "rudder")),
    Effect("store-release", ("inertial",), _store_release, ("flap", "flap")),
    Effect("actuator-lag", ("actuator",), _actuator_lag, _QUICK),
    Effect("actuator-rate-limit", ("actuator",), _rate_limit, _QUICK),
    Effect("actuator-saturation", ("actuator",), _saturation, _QUICK),
    Effect("backlash", ("actuator",), _backlash, (*_QUICK, "multisine")),
    Effect("augmentation", ("actuator",), _augmentation, _QUICK[2:]),
    Effect("steady-wind", ("atmospheric",), _steady_wind, ("turns", "turns"), channels=("vn",), form="free"),
    Effect(
        "wind-shear", ("atmospheric",), _wind_shear, ("pull-up", "pull-up", "speeds"), channels=("vn",), form="free"
    ),
    Effect("gust", ("atmospheric",), _gust),
    Effect("turbulence", ("random",), _turbulence),
    Effect("slosh", ("inertial",), _slosh, ("rudder", "aileron", "sideslip", "turns")),
)
