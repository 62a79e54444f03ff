"""Physics that depends on where the aircraft is in its envelope, and on nothing past."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from structsel.comparison.flight import Flight
from structsel.effects.base import Columns, Effect, EffectParameter, FittedEffect, Flights, Variant, of_shape
from structsel.effects.signals import (
    Column,
    available,
    from_lift_and_drag,
    gathered,
    held,
    lacking,
    lift,
    lift_line,
    reach,
    signature,
    without_linear_part,
)
from structsel.effects.similarity import SIMILARITY
from structsel.nomenclature import LATERAL_COEFFICIENTS, LONGITUDINAL_COEFFICIENTS
from structsel.numerics.arrays import Array
from structsel.numerics.dynamic_elements import lift_factor, steady_formula, steady_separation_point

_LEAST_STALL_ANGLE = 0.10  # rad, that a stall needs at least
_ANGLES = 7
_SHARPNESS = (15.0, 30.0, 60.0)  # 1/rad, of the separation with angle of attack
_DECAYS = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0)  # of ground effect, per span of height
_LEAST_LIFT = 0.15  # range of CL that shows a drag polar

# --- stall -----------------------------------------------------------------------------------------------------------


def _stalls(flights: Flights) -> list[Variant]:
    alpha = gathered(flights, "alpha")
    slope, zero = lift_line(flights)
    low, high = max(float(np.quantile(alpha, 0.6)), 0.06), reach(flights, "alpha")[1]
    angles = np.linspace(low, max(low + 0.01, 0.98 * high), _ANGLES)
    made = []
    for angle in angles.tolist():
        made += [of_shape(partial(_separated, slope, zero), angle, sharp) for sharp in _SHARPNESS]
        beyond = max(high - angle, 0.01)
        made += [of_shape(partial(_break, power, slope, beyond), angle) for power in (1, 2)]
        made += [of_shape(partial(_kink, flights, response), angle) for response in held(flights, ("CZ", "Cm"))]
    return made


def _separated(slope: float, zero: float, angle: float, sharp: float) -> Variant:
    """Lift of a wing that separates from its trailing edge (Kirchhoff), as a function of the angle of attack."""
    parameters = (
        EffectParameter("lift loss", "-", 0.5, 0.0, 1.6),
        EffectParameter("drag", "-", 0.1, -0.2, 1.0),
        EffectParameter("pitching moment", "-", 0.08, -0.6, 0.6),
    )

    def columns(flight: Flight) -> Columns:
        alpha = flight["alpha"]
        attached = steady_separation_point(alpha, sharp, angle)
        lost = slope * (alpha - zero) * (1.0 - lift_factor(attached))
        gone = 1.0 - attached
        return signature(
            flight,
            3,
            [*from_lift_and_drag(flight, 0, CL=-lost), *from_lift_and_drag(flight, 1, CD=gone), ("Cm", 2, gone)],
        )

    shape = {"stall angle": angle, "sharpness": sharp}
    attached = steady_formula("alpha", sharp, angle)
    terms = (f"(alpha - ({zero!r}))*(1 - (0.5*(1 + sqrt({attached})))^2)", f"(1 - {attached})")
    return Variant(parameters, columns, shape, {"stall angle": "rad", "sharpness": "1/rad"}, "separation", terms)


def _break(power: int, slope: float, beyond: float, angle: float) -> Variant:
    """Slopes that change above an angle, at once or growing."""
    parameters = (
        EffectParameter("lift slope loss", "-", 0.5, 0.0, 2.0),
        EffectParameter("drag slope", "1/rad", 0.4, -1.0, 4.0),
        EffectParameter("moment slope", "1/rad", 0.4, -4.0, 4.0),
    )

    def columns(flight: Flight) -> Columns:
        x = np.maximum(flight["alpha"] - angle, 0.0) ** power / beyond ** (power - 1)
        return signature(
            flight,
            3,
            [*from_lift_and_drag(flight, 0, CL=-slope * x), *from_lift_and_drag(flight, 1, CD=x), ("Cm", 2, x)],
        )

    about = "a break of the slopes" if power == 1 else "slopes that fall off"
    term = f"(alpha - {angle!r})+^{power}"
    return Variant(parameters, columns, {"stall angle": angle}, {"stall angle": "rad"}, about, (term,))


def _kink(flights: Flights, response: str, angle: float) -> Variant:
    slope = lift_line(flights)[0] if response == "CZ" else 1.0

    def columns(flight: Flight) -> Columns:
        return signature(flight, 1, [(response, 0, slope * np.maximum(flight["alpha"] - angle, 0.0))])

    unit = "-" if response == "CZ" else "1/rad"
    parameter = EffectParameter(f"{response} kink", unit, 0.5, *((0.0, 2.0) if response == "CZ" else (-4.0, 4.0)))
    term = f"(alpha - {angle!r})+"
    about = f"a kink in {response} only"
    return Variant((parameter,), columns, {"stall angle": angle}, {"stall angle": "rad"}, about, (term,))


def _needs_stall(flights: Flights) -> str:
    gone = lacking(flights, LONGITUDINAL_COEFFICIENTS, ("alpha",))
    if gone:
        return gone
    return (
        "" if reach(flights, "alpha")[1] > _LEAST_STALL_ANGLE else f"angle of attack above {_LEAST_STALL_ANGLE:g} rad"
    )


def _says_stall(found: FittedEffect) -> str:
    angle = np.rad2deg(found.variant.shape["stall angle"])
    values = [f"{p.name} {found.text(p.name)}" for p in found.variant.parameters]
    return f"Above an angle of attack of {angle:.1f} deg the wing stalls ({found.variant.about}): {', '.join(values)}."


# --- ground ----------------------------------------------------------------------------------------------------------


def _grounds(flights: Flights) -> list[Variant]:
    b = flights[0].aircraft.b
    laws = [("exponential", {"decay": c}, _fading(c), f"exp(-({c / b!r}*(h_agl)+))") for c in _DECAYS]
    laws.append(("McCormick", {}, lambda x: 1.0 / (1.0 + (16.0 * x) ** 2), f"(1/(1 + ({16.0 / b!r}*(h_agl)+)^2))"))
    return [
        _near_ground(flights, about, shape, law, by_lift, (f"{near}*CL", f"{near}*CL^2") if by_lift else (near,))
        for about, shape, law, near in laws
        for by_lift in (True, False)
    ]


def _fading(decay: float) -> Callable[[Array], Array]:
    return lambda x: np.exp(-decay * x)


def _near_ground(
    flights: Flights,
    about: str,
    shape: dict[str, float],
    law: Callable[[Array], Array],
    by_lift: bool,
    terms: tuple[str, ...],
) -> Variant:
    """Increments that fade with height over span; `by_lift` they go with lift and its square, else alone."""
    size = max(float(np.abs(gathered(flights, lift)).mean()), 0.1)
    unit = "of CL" if by_lift else "-"
    parameters = (
        EffectParameter("lift", unit, 0.15 if by_lift else 0.15 * size, 0.0, 1.0),
        EffectParameter("drag", "of CL^2" if by_lift else "-", 0.03 if by_lift else 0.03 * size**2, -0.3, 0.0),
        EffectParameter("pitching moment", unit, 0.05 if by_lift else 0.05 * size, -0.5, 0.1),
    )

    def columns(flight: Flight) -> Columns:
        near = law(np.maximum(flight["h_agl"], 0.0) / flight.aircraft.b)
        CL = lift(flight) if by_lift else np.ones(len(flight))
        return signature(
            flight,
            3,
            [
                *from_lift_and_drag(flight, 0, CL=near * CL),
                *from_lift_and_drag(flight, 1, CD=near * CL**2),
                ("Cm", 2, near * CL),
            ],
        )

    how = "with lift" if by_lift else "whatever the lift"
    return Variant(parameters, columns, shape, dict.fromkeys(shape, "-"), f"{about}, {how}", terms)


def _needs_ground(flights: Flights) -> str:
    gone = lacking(flights, LONGITUDINAL_COEFFICIENTS)
    if gone:
        return gone
    if not available(flights, "h_agl"):
        return "channel h_agl"
    span = flights[0].aircraft.b
    return "" if reach(flights, "h_agl")[0] < span else f"height below one span ({span:.1f} m)"


def _says_ground(found: FittedEffect) -> str:
    gains = [f"{name} {found.text(name, 100.0, '% ' + e.unit if e.unit != '-' else '% of one')}"
             for name, e in found.estimates.items() if name not in found.variant.shape]  # fmt: skip
    return f"Near the ground, below about one span, forces change: {', '.join(gains)} on it ({found.variant.about})."


# --- drag due to lift, asymmetry -------------------------------------------------------------------------------------


def _polars(flights: Flights) -> list[Variant]:
    mean = float(gathered(flights, lift).mean())
    made = []
    for about, where, law in (
        ("CL^2", 0.0, lambda f: lift(f) ** 2),
        ("CL^2 about its mean", mean, lambda f: (lift(f) - mean) ** 2),
        ("alpha^2", None, lambda f: f["alpha"] ** 2),
    ):
        unit, sd = ("1/rad^2", 0.8) if where is None else ("-", 0.03)
        terms = ("alpha^2",) if where is None else ("CL^2", "CL", "1") if where else ("CL^2",)
        shape = {} if where is None else {"least drag at CL": where}
        made.append(_polar(law, about, shape, EffectParameter("drag", unit, sd), terms))
        fitted = without_linear_part(flights, law, ("alpha", "V", "de", "q_hat"))
        about = f"{about}, linear terms fitted without it"
        made.append(
            _polar(fitted, about, shape, EffectParameter("drag", unit, sd), (*terms, "alpha", "V", "de", "q_hat"))
        )
    return [
        *made,
        _parabola("CL", lift, (0.03, 0.03, 0.01)),
        _parabola("alpha", lambda f: f["alpha"], (0.8, 0.1, 0.01)),
    ]


def _polar(
    law: Column, about: str, shape: dict[str, float], parameter: EffectParameter, terms: tuple[str, ...]
) -> Variant:
    def columns(flight: Flight) -> Columns:
        return signature(flight, 1, from_lift_and_drag(flight, 0, CD=law(flight)))

    return Variant((parameter,), columns, shape, dict.fromkeys(shape, "-"), about, terms)


def _parabola(name: str, along: Column, sds: Sequence[float]) -> Variant:
    """Drag that bends where the simulation has a chord, or a line through points of its own choice."""
    unit = {"CL": ("-", "-"), "alpha": ("1/rad^2", "1/rad")}[name]
    parameters = tuple(EffectParameter(p, u, sd) for p, u, sd in zip(("drag", "slope", "level"), (*unit, "-"), sds))

    def columns(flight: Flight) -> Columns:
        x = along(flight)
        parts = [
            part for j, law in enumerate((x**2, x, np.ones(len(x)))) for part in from_lift_and_drag(flight, j, CD=law)
        ]
        return signature(flight, 3, parts)

    return Variant(parameters, columns, about=f"a parabola in {name}", terms=(f"{name}^2", name, "1"))


def _needs_polar(flights: Flights) -> str:
    gone = lacking(flights, ("CX",), ("alpha",))
    if gone:
        return gone
    low, high = reach(flights, lift)
    return "" if high - low > _LEAST_LIFT else f"lift coefficients {_LEAST_LIFT:g} apart"


def _asymmetries(flights: Flights) -> list[Variant]:
    def bent(flight: Flight) -> Columns:
        return signature(flight, 3, [(r, j, np.ones(len(flight))) for j, r in enumerate(LATERAL_COEFFICIENTS)])

    sds = (("CY", 0.01), ("Cl", 0.003), ("Cn", 0.003))
    # What follows the forces, as a load to one side does, is a centre of gravity that is elsewhere.
    return [Variant(tuple(EffectParameter(r, "-", sd) for r, sd in sds), bent, about="a constant", terms=("1",))]


def _says_asymmetry(found: FittedEffect) -> str:
    offsets = (f"{n} {found.text(n)}" for n in LATERAL_COEFFICIENTS if n in found.estimates)
    return f"A constant lateral offset: {', '.join(offsets)}."


EFFECTS: tuple[Effect, ...] = (
    *SIMILARITY,
    Effect(
        "static-stall",
        "static",
        "The lift curve bends above a stall angle, drag and nose-down moment grow, the same on the way up and down.",
        _needs_stall,
        _stalls,
        _says_stall,
        look_alikes=("stall-hysteresis", "missing-term", "icing"),
        separated_by="Slow and fast approaches to the stall, with the recovery.",
        check="Whether the simulation's lift is linear beyond the angles of attack it was made for.",
    ),
    Effect(
        "ground-effect",
        "static",
        "Within about one span of the ground there is more lift, less induced drag and a nose-down moment.",
        _needs_ground,
        _grounds,
        _says_ground,
        look_alikes=("configuration-change", "wind-shear", "drag-polar"),
        separated_by="Level passes at heights of 0.3 and 0.6 spans in one configuration.",
        check="Whether the simulation's aerodynamics ask for the height above ground.",
    ),
    Effect(
        "drag-polar",
        "static",
        "Drag due to lift.",
        _needs_polar,
        _polars,
        lambda found: f"Drag due to lift differs: {found.text('drag')} on the square ({found.variant.about}).",
        look_alikes=("thrust-scale", "missing-term", "sensor-misalignment"),
        separated_by="Push-overs and pull-ups over the range of lift at constant power.",
        check="The polar's curvature: aspect ratio and span efficiency in the simulation.",
    ),
    Effect(
        "asymmetry",
        "static",
        "A constant lateral offset: bent surface, lateral fuel, rigging.",
        lambda flights: lacking(flights, LATERAL_COEFFICIENTS),
        _asymmetries,
        _says_asymmetry,
        look_alikes=("asymmetric-thrust", "sensor-bias", "cg-shift"),
        separated_by="Symmetric flight at two load factors and two powers, and the vane zeroed on the ground.",
        check="Rigging, fuel left and right, trim tabs.",
    ),
)
