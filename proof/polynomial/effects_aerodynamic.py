"""Aerodynamic effects of the polynomial plant: parameters, static effects, and effects with memory.

Their formulas are from the literature and independent of structsel's hypotheses.
"""

from __future__ import annotations

from proof.polynomial.effects import Effect, EffectContext, EffectDesign, Injection, with_terms
from proof.polynomial.flight import InjectedPhysics

_LINEAR = (
    ("CZ", "alpha"), ("Cm", "alpha"), ("Cm", "q_hat"), ("Cm", "de"), ("Cl", "p_hat"), ("Cl", "da"), ("Cl", "beta"),
    ("Cn", "beta"), ("Cn", "dr"), ("Cn", "r_hat"), ("CY", "beta"),
)  # fmt: skip
_LOOKS_LIKE_DERIVATIVE = {
    ("CZ", "alpha"): ("sensor-scale", "mass-error", "position-error"), ("Cm", "alpha"): ("cg-shift",),
    ("Cm", "q_hat"): ("downwash-lag", "augmentation"), ("Cm", "de"): ("inertia-error",),
    ("Cl", "p_hat"): ("augmentation",), ("Cl", "da"): ("inertia-error",), ("Cl", "beta"): ("sensor-scale",),
    ("Cn", "beta"): ("sensor-scale", "cg-shift"), ("Cn", "r_hat"): ("sidewash-lag", "augmentation"),
    ("Cn", "dr"): ("inertia-error",), ("CY", "beta"): ("sensor-scale", "mass-error"),
}  # fmt: skip
_MISSING = (
    ("Cm", "alpha^2"), ("CZ", "alpha^2"), ("Cm", "alpha*q_hat"), ("Cm", "alpha*de"), ("Cn", "beta^3"), ("Cl", "beta^3"),
    ("CY", "da"), ("Cl", "dr"), ("Cn", "da"), ("CX", "de"), ("CY", "p_hat"), ("CZ", "alpha*de"),
)  # fmt: skip
_COUPLED = (
    ("Cm", "beta^2"), ("Cl", "alpha*beta"), ("Cn", "alpha*p_hat"), ("Cn", "alpha*beta"), ("CZ", "beta^2"),
    ("Cm", "r_hat"), ("CX", "beta^2"), ("Cl", "alpha*r_hat"), ("CY", "alpha*p_hat"), ("Cm", "abs_beta"),
)  # fmt: skip


def _wrong_derivative(c: EffectContext) -> EffectDesign:
    there = [pair for pair in _LINEAR if c.truth.value(*pair)]
    axis, text = there[int(c.rng.integers(len(there)))]
    sign, value = c.sign(), c.truth.value(axis, text)
    tie = _LOOKS_LIKE_DERIVATIVE[axis, text] + ("missing-term",)
    return EffectDesign(with_terms((axis, text, sign * value)), (axis,), tie, low=4.0 * c.tolerance("main"), high=0.9)


def _absent(c: EffectContext, pool: tuple[tuple[str, str], ...]) -> tuple[str, str]:
    there = [pair for pair in pool if not c.truth.value(*pair)]
    return there[int(c.rng.integers(len(there)))]


def _missing_term(c: EffectContext) -> EffectDesign:
    axis, text = _absent(c, _MISSING)
    tie: tuple[str, ...] = ("wrong-derivative",)
    tie += ("static-stall",) if text == "alpha^2" else ("control-nonlinearity",) if "de" in text else ()
    tie += ("sensor-misalignment",) if (axis, text) == ("Cn", "da") else ()
    return EffectDesign(with_terms((axis, text, c.sign() * c.equal_scatter(axis, text))), (axis,), tie, high=2.0)


def _cross_coupling(c: EffectContext) -> EffectDesign:
    axis, text = _absent(c, _COUPLED)
    at = with_terms((axis, text, c.sign() * c.equal_scatter(axis, text)))
    tie = ("missing-term", "wrong-derivative") if "alpha" in text else ("missing-term",)
    return EffectDesign(at, (axis,), tie, high=2.0)


def _drag_polar(c: EffectContext) -> EffectDesign:
    # The lift term of the base polar is there already; the truth has more, or less, of it.
    return EffectDesign(
        with_terms(("CX", "CL^2", -c.sign() * 0.05)), ("CX",), ("missing-term", "wrong-derivative"), low=0.01
    )


def _stall_terms(c: EffectContext) -> list[tuple[str, str, float]]:
    slope = c.truth.value("CZ", "alpha")
    drag, moment = c.rng.uniform(0.1, 0.2), c.rng.uniform(0.08, 0.18)
    return [("CZ", "lost*alpha", -slope * 0.8), ("CX", "stall", -drag), ("Cm", "stall", -moment)]


def _static_stall(c: EffectContext) -> EffectDesign:
    settings = {"stall_alpha": c.truth.stall + c.rng.uniform(-0.02, 0.01), "stall_slope": c.rng.uniform(20.0, 45.0)}
    return EffectDesign(
        with_terms(*_stall_terms(c), settings=settings),
        ("CZ", "Cm", "CX"),
        ("stall-hysteresis", "missing-term"),
        low=0.01,
        high=1.6,
        intervals="active",
        region="alpha",
    )


def _stall_hysteresis(c: EffectContext) -> EffectDesign:
    settings = {"stall_alpha": c.truth.stall + c.rng.uniform(-0.02, 0.0), "stall_slope": c.rng.uniform(20.0, 40.0)}
    settings |= {"stall_tau1": c.rng.uniform(0.25, 0.7), "stall_tau2": c.rng.uniform(0.1, 0.35)}
    return EffectDesign(
        with_terms(*_stall_terms(c), settings=settings),
        ("CZ", "Cm", "CX"),
        ("static-stall",),
        low=0.01,
        high=1.6,
        intervals="active",
        region="alpha",
    )


def _compressibility(c: EffectContext) -> EffectDesign:
    lift, pitch = c.truth.value("CZ", "alpha"), c.truth.value("Cm", "alpha")
    mach = c.settings["V0"] / 330.0
    terms = (
        ("CZ", "glauert*alpha", 2.0 * lift),
        ("Cm", "glauert*alpha", 2.0 * pitch + 0.25 * lift),
        ("CX", "rise", -1.0),
    )
    at = with_terms(*terms, settings={"mach_rise": mach})
    return EffectDesign(at, ("CZ", "Cm", "CX"), ("flexibility", "missing-term"), low=0.02, high=4.0)


def _flexibility(c: EffectContext) -> EffectDesign:
    lift, pitch = c.truth.value("CZ", "alpha"), c.truth.value("Cm", "alpha")
    de, da = c.truth.value("Cm", "de"), c.truth.value("Cl", "da")
    terms = (
        ("CZ", "dqbar*alpha", -0.25 * lift),
        ("Cm", "dqbar*alpha", -0.35 * pitch),
        ("Cm", "dqbar*de", -0.2 * de),
        ("Cl", "dqbar*da", -0.25 * da),
    )
    return EffectDesign(
        with_terms(*terms), ("CZ", "Cm", "Cl"), ("compressibility", "control-stretch", "missing-term"), high=3.0
    )


def _control_stretch(c: EffectContext) -> EffectDesign:
    control, axis = [("de", "Cm"), ("da", "Cl"), ("dr", "Cn")][int(c.rng.integers(3))]
    terms = [(axis, f"dqbar*{control}", -0.4 * c.truth.value(axis, control))]
    if control == "de" and c.truth.value("CZ", "de"):
        terms.append(("CZ", "dqbar*de", -0.4 * c.truth.value("CZ", "de")))
    tie = ("flexibility", "compressibility", "missing-term")
    return EffectDesign(with_terms(*terms), (axis,), tie, low=0.02, high=2.5)


def _reynolds(c: EffectContext) -> EffectDesign:
    # Thinner boundary layers: less drag; the lift curve a little steeper.
    terms = (("CX", "lnRe", 0.02), ("CZ", "lnRe*alpha", 0.06 * c.truth.value("CZ", "alpha")))
    return EffectDesign(
        with_terms(*terms), ("CX", "CZ"), ("compressibility", "flexibility", "missing-term"), low=0.02, high=3.0
    )


def _ground_effect(c: EffectContext) -> EffectDesign:
    settings = {"ground_rate": c.rng.uniform(3.0, 6.0)}
    terms = (("CZ", "ground*CL", -0.25), ("CX", "ground*CL*CL", 0.03), ("Cm", "ground", -c.rng.uniform(0.02, 0.06)))
    return EffectDesign(
        with_terms(*terms, settings=settings),
        ("CZ", "Cm", "CX"),
        ("configuration-change", "wind-shear"),
        high=3.0,
        intervals="active",
        region="h_agl",
    )


def _configuration(c: EffectContext, recorded: bool) -> EffectDesign:
    times = c.draw_times(c.choose_manoeuvres(3, 4))
    name = "df" if recorded else "cfg"
    unit = 0.4 if recorded else 1.0
    terms = [
        ("CZ", name, -0.25 / unit),
        ("CX", name, -0.025 / unit),
        ("Cm", name, c.sign() * c.rng.uniform(0.015, 0.04) / unit),
    ]
    schedules = [unit * s for s in c.steps(times, c.rng.choice([0.3, 1.5, 4.0]))]

    def at(size: float) -> Injection:
        scaled = [(a, x, size * v) for a, x, v in terms]
        return Injection(
            InjectedPhysics(scaled, schedules={name: schedules}), parameters={a: v * unit for a, _, v in scaled}
        )

    tie = ("missing-term", "wrong-derivative") if recorded else ("store-release", "gust")
    return EffectDesign(at, ("CZ", "CX", "Cm"), tie, high=3.0, intervals=c.intervals_after(times))


def _flap_recorded(c: EffectContext) -> EffectDesign:
    return _configuration(c, True)


def _configuration_change(c: EffectContext) -> EffectDesign:
    return _configuration(c, False)


def _icing(c: EffectContext) -> EffectDesign:
    first, span = c.rng.uniform(1.0, 3.0), c.rng.uniform(2.0, 4.0)
    terms = (("CX", "ice", -0.02), ("CZ", "ice*alpha", -0.18 * c.truth.value("CZ", "alpha")), ("Cm", "ice", -0.006))
    ice = [(k + p.t.clip(0.0) / p.duration - first) / span for k, p in enumerate(c.manoeuvres)]

    def at(size: float) -> Injection:
        scaled = [(a, x, size * v) for a, x, v in terms]
        return Injection(
            InjectedPhysics(scaled, schedules={"ice": [w.clip(0.0, 1.0) for w in ice]}),
            parameters={a: v for a, _, v in scaled},
        )

    return EffectDesign(at, ("CX", "CZ"), ("mass-error", "configuration-change"), high=3.0, intervals="active")


def _control_nonlinearity(c: EffectContext) -> EffectDesign:
    control, axis = [("de", "Cm"), ("da", "Cl"), ("dr", "Cn")][int(c.rng.integers(3))]
    value = c.truth.value(axis, control)
    largest = float(abs(c.product(control)).max())
    text, power = (f"abs_{control}*{control}", 1) if c.rng.random() < 0.5 else (f"{control}^3", 2)
    terms = [(axis, text, -0.4 * value / largest**power)]
    return EffectDesign(
        with_terms(*terms), (axis,), ("actuator-saturation", "missing-term", "wrong-derivative"), low=0.02, high=2.0
    )


def _downwash_lag(c: EffectContext) -> EffectDesign:
    tail = c.rng.uniform(2.2, 3.5)
    slope = c.rng.uniform(0.8, 1.4)  # of Cm: tail volume times lift slope times downwash slope
    at = with_terms(("Cm", "downwash", -slope), ("CZ", "downwash", -slope / tail), settings={"tail_lag": tail})
    return EffectDesign(at, ("Cm", "CZ"), ("wrong-derivative", "unsteady-lift", "sensor-delay"), low=0.02, high=6.0)


def _sidewash_lag(c: EffectContext) -> EffectDesign:
    at = with_terms(("Cn", "sidewash", 0.08), ("CY", "sidewash", -0.2), settings={"fin_lag": c.rng.uniform(0.3, 0.5)})
    return EffectDesign(at, ("Cn", "CY"), ("wrong-derivative", "sensor-delay"), low=0.02, high=8.0)


def _unsteady_lift(c: EffectContext) -> EffectDesign:
    slope = c.truth.value("CZ", "alpha")
    at = with_terms(("CZ", "wagner", slope), ("Cm", "wagner", 0.1 * slope))
    return EffectDesign(at, ("CZ", "Cm"), ("downwash-lag", "sensor-delay"), low=0.02, high=2.0)


def _asymmetry(c: EffectContext) -> EffectDesign:
    sign = c.sign()
    at = with_terms(("Cl", "1", sign * 0.004), ("Cn", "1", c.sign() * 0.002), ("CY", "1", c.sign() * 0.01))
    return EffectDesign(at, ("Cl", "Cn", "CY"), ("asymmetric-thrust", "sensor-bias", "cg-shift"), low=0.01)


_TWO = ("speeds", "pull-up", "speeds")
EFFECTS = (
    Effect("wrong-derivative", ("parameter",), _wrong_derivative, ("elevator", "aileron", "rudder")),
    Effect("missing-term", ("parameter",), _missing_term, ("pull-up", "large", "sideslip")),
    Effect("cross-coupling", ("static",), _cross_coupling, ("sideslip", "rudder", "pull-up", "sideslip")),
    Effect("drag-polar", ("static",), _drag_polar, ("pull-up", "turns", "pull-up")),
    Effect("static-stall", ("static",), _static_stall, ("stall", "stall", "stall", "pull-up")),
    Effect("stall-hysteresis", ("memory",), _stall_hysteresis, ("stall", "stall", "stall", "stall")),
    Effect("compressibility", ("static",), _compressibility, _TWO, ("hawk", "citation", "hfb320"), 2),
    Effect("flexibility", ("structural",), _flexibility, (*_TWO, "elevator"), ("hawk", "citation", "hfb320"), 2),
    Effect(
        "control-stretch",
        ("structural",),
        _control_stretch,
        (*_TWO, "large", "large"),
        ("hawk", "citation", "hfb320"),
        2,
    ),
    Effect("reynolds", ("static",), _reynolds, _TWO, (), 2),
    Effect("ground-effect", ("static",), _ground_effect, ("low-pass", "low-pass", "low-pass")),
    Effect("configuration-change", ("static",), _configuration_change, ("flap", "flap")),
    Effect(
        "configuration-change",
        ("static",),
        _flap_recorded,
        ("flap", "flap"),
        ("hawk", "citation", "hfb320"),
        channels=("df",),
    ),
    Effect("icing", ("static",), _icing, ("pull-up", "elevator")),
    Effect("control-nonlinearity", ("static",), _control_nonlinearity, ("large", "large", "multisine")),
    Effect("downwash-lag", ("memory",), _downwash_lag, ("elevator", "turns", "pull-up", "multisine")),
    Effect("sidewash-lag", ("memory",), _sidewash_lag, ("rudder", "large", "aileron", "multisine")),
    Effect("unsteady-lift", ("memory",), _unsteady_lift, ("elevator", "multisine", "large", "pull-up")),
    Effect("asymmetry", ("static",), _asymmetry),
)
