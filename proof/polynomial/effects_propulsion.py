"""Effects of propulsion in the polynomial plant.

Their formulas are from the literature and independent of structsel's hypotheses.
"""

from __future__ import annotations

from proof.polynomial.effects import Effect, EffectContext, EffectDesign, Injection, with_terms
from proof.polynomial.flight import InjectedPhysics

JETS = ("citation", "hfb320", "hawk")


def _slipstream(c: EffectContext) -> EffectDesign:
    v = c.truth.value
    terms = (
        ("Cm", "CT*de", 2.0 * v("Cm", "de")),
        ("CZ", "CT*alpha", 0.6 * v("CZ", "alpha")),
        ("Cm", "CT", -0.08),
        ("Cn", "CT*dr", 2.0 * v("Cn", "dr")),
        ("Cn", "CT", -0.02),
    )
    return EffectDesign(with_terms(*terms), ("Cm", "CZ", "Cn"), ("thrust-line", "propeller-normal-force"))


def _thrust_line(c: EffectContext) -> EffectDesign:
    offset = c.sign() * 0.15  # of cbar, down
    tie = ("slipstream",) if c.truth.propeller else ("missing-term",)

    def at(size: float) -> Injection:
        return Injection(
            InjectedPhysics([("Cm", "CT", size * offset)]), parameters={"z": size * offset * c.truth.aircraft.cbar}
        )

    return EffectDesign(at, ("Cm",), tie, high=3.0)


def _thrust_scale(c: EffectContext) -> EffectDesign:
    sign = c.sign()

    def at(size: float) -> Injection:
        factor = 1.0 + sign * 0.15 * size
        return Injection(InjectedPhysics(settings={"thrust_scale": factor}), parameters={"scale": factor})

    return EffectDesign(at, ("CX",), ("thrust-lag", "mass-error"), low=4.0 * c.tolerance("thrust") / 0.15, high=3.0)


def _thrust_lag(c: EffectContext) -> EffectDesign:
    def at(size: float) -> Injection:
        return Injection(InjectedPhysics(settings={"thrust_lag": 0.8 * size}), parameters={"tau": 0.8 * size})

    return EffectDesign(at, ("CX",), ("thrust-scale",), low=0.1, high=4.0)


def _propeller_force(c: EffectContext) -> EffectDesign:
    air, side = c.truth.aircraft, c.sign()
    ratio = air.cbar / air.b
    # Along and across alike: the force acts ahead, and the blade that meets the wind has more of the thrust.
    terms = (
        ("CZ", "CT*alpha", -1.2), ("Cm", "CT*alpha", 0.8), ("CY", "CT*beta", -1.2), ("Cn", "CT*beta", -0.8 * ratio),
        ("Cn", "CT*alpha", side * 0.2), ("Cm", "CT*beta", side * 0.2 / ratio),
    )  # fmt: skip
    return EffectDesign(with_terms(*terms), ("Cn", "Cm", "CZ", "CY"), ("slipstream", "cross-coupling"))


def _gyroscopic(c: EffectContext) -> EffectDesign:
    air = c.truth.aircraft
    inertia = c.sign() * (8.0 if c.truth.propeller else 4.0)  # kg m^2, of the rotor

    def at(size: float) -> Injection:
        H = size * inertia
        terms = [("Cm", "gyro_r", -H / (air.S * air.cbar)), ("Cn", "gyro_q", H / (air.S * air.b))]
        return Injection(InjectedPhysics(terms), parameters={"I_rotor": H})

    return EffectDesign(at, ("Cm", "Cn"), ("cross-coupling", "inertia-error"), high=4.0)


def _asymmetric_thrust(c: EffectContext) -> EffectDesign:
    arm = c.sign() * 0.1  # of the span, times the relative difference of the sides
    chosen = c.choose_manoeuvres(3, 5)
    times = c.draw_times(chosen, 0.05, 0.5)
    clock = c.steps(times, 0.5)

    def at(size: float) -> Injection:
        terms = [("Cn", "clock*CT", size * arm), ("Cl", "clock*CT", 0.1 * size * arm)]
        return Injection(InjectedPhysics(terms, schedules={"clock": clock}), parameters={"y/b": size * arm})

    return EffectDesign(at, ("Cn", "Cl"), ("asymmetry",), high=3.0, intervals=c.intervals_after(times))


_THRUSTS = ("throttle", "throttle", "speeds")
EFFECTS = (
    Effect("slipstream", ("propulsive",), _slipstream, (*_THRUSTS, "throttle"), ("beaver",)),
    Effect("thrust-line", ("propulsive",), _thrust_line, _THRUSTS),
    Effect("thrust-scale", ("propulsive",), _thrust_scale, _THRUSTS),
    Effect("thrust-lag", ("propulsive",), _thrust_lag, (*_THRUSTS, "throttle")),
    Effect(
        "propeller-normal-force", ("propulsive",), _propeller_force, (*_THRUSTS, "pull-up", "sideslip"), ("beaver",)
    ),
    Effect("engine-gyroscopic", ("propulsive",), _gyroscopic, ("throttle", "rudder", "elevator"), channels=("rpm",)),
    Effect("asymmetric-thrust", ("propulsive",), _asymmetric_thrust, ("throttle", "throttle"), JETS),
)
