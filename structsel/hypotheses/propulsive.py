"""What propulsion does beside its declared thrust along its declared line."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial

import numpy as np

from structsel.hypotheses.base import Flights, Found, Hypothesis, Parameter, Variant
from structsel.hypotheses.operators import lag, onsets, shape_of, since, spaced, told_onsets
from structsel.hypotheses.signals import available, gathered, lacking, moves, signature
from structsel.mismatch.flight import Flight
from structsel.mismatch.responses import COEFFICIENTS
from structsel.numerics.smoothing.result import Array

Parts = Iterable[tuple[str, int, Array]]
_FORCES = ("CX", "CY", "CZ")
_ONSETS = 5  # manoeuvres in which thrust may become asymmetric


def _variant(
    parameters: tuple[Parameter, ...],
    parts: Callable[[Flight], Parts],
    about: str = "",
    terms: tuple[str, ...] = (),
    times: Mapping[str, float] | None = None,
) -> Variant:
    shape = shape_of(times or {})
    return Variant(
        parameters, lambda f: signature(f, len(parameters), parts(f)), shape, dict.fromkeys(shape, "s"), about, terms
    )


def _thrust_needs(responses: tuple[str, ...]) -> Callable[[Flights], str]:
    return lambda flights: lacking(flights, responses, ("thrust",))


def _along_thrust(flight: Flight, j: int, CT: Array) -> list[tuple[str, int, Array]]:
    """A force along the declared thrust line, of coefficient CT, with its moments."""
    direction, arm = flight.craft.thrust.direction, flight.craft.thrust.arm
    lengths = (flight.craft.b, flight.craft.cbar, flight.craft.b)
    made = [(r, j, CT * d) for r, d in zip(_FORCES, direction)]
    return made + [(r, j, CT * a / length) for r, a, length in zip(("Cl", "Cm", "Cn"), arm, lengths)]


# Slipstream


def _washed_controls(f: Flight) -> list[tuple[str, int, Array]]:
    """More dynamic pressure at the tail: the elevator's and the rudder's share of all coefficients grow with CT."""
    return [
        (r, 0, f["CT"] * sum(f.slope(r, c) * f[c] for c in ("de", "dr") if c in f.recorded))
        for r in COEFFICIENTS
        if r in f.measured
    ]


def _slipstream_variants(flights: Flights) -> list[Variant]:
    controls = Parameter("control power per CT", "-", 1.0, -1.0, 6.0)
    tail = (Parameter("Cm per CT", "-", 0.1), Parameter("Cm per CT*alpha", "1/rad", 0.6))
    wing = (Parameter("CZ per CT", "-", 0.3), Parameter("CZ per CT*alpha", "1/rad", 2.0))
    fin = (
        Parameter("Cn per CT", "-", 0.02),
        Parameter("Cl per CT", "-", 0.02),
        Parameter("Cn per CT*beta", "1/rad", 0.1),
    )

    def pitch(f: Flight, j: int) -> list[tuple[str, int, Array]]:
        return [("Cm", j, f["CT"]), ("Cm", j + 1, f["CT"] * f["alpha"])]

    def lift(f: Flight, j: int) -> list[tuple[str, int, Array]]:
        return [("CZ", j, f["CT"]), ("CZ", j + 1, f["CT"] * f["alpha"])]

    def yaw(f: Flight, j: int) -> list[tuple[str, int, Array]]:
        return [("Cn", j, f["CT"]), ("Cl", j + 1, f["CT"]), ("Cn", j + 2, f["CT"] * f["beta"])]

    made = [
        _variant(tail, lambda f: pitch(f, 0), "at the tailplane", terms=("CT", "CT*alpha")),
        _variant(wing, lambda f: lift(f, 0), "over the wing", terms=("CT", "CT*alpha")),
        _variant(fin, lambda f: yaw(f, 0), "at the fin, turning", terms=("CT", "CT*beta")),
        _variant(tail + wing, lambda f: pitch(f, 0) + lift(f, 2), "over wing and tailplane", ("CT", "CT*alpha")),
    ]
    if any(moves(flights, c) for c in ("de", "dr")):
        washed = ("CT*de", "CT*dr", "CT", "CT*alpha")
        made += [
            _variant((controls,), _washed_controls, "over the controls", terms=("CT*de", "CT*dr")),
            _variant((controls, *tail), lambda f: _washed_controls(f) + pitch(f, 1), "over tailplane and controls",
                washed,
            ),
            _variant(
                (controls, *tail, *wing), lambda f: _washed_controls(f) + pitch(f, 1) + lift(f, 3),
                "over wing, tailplane and controls", washed,
            ),
            _variant(
                (controls, *tail, *wing, *fin),
                lambda f: _washed_controls(f) + pitch(f, 1) + lift(f, 3) + yaw(f, 5), "over all of the aircraft",
                (*washed, "CT*beta"),
            ),
        ]  # fmt: skip
    return made


def _all_parameters(found: Found) -> str:
    return ", ".join(f"{p.name} {found.text(p.name)}" for p in found.variant.parameters)


# Line and size of the thrust


def _line_variants(flights: Flights) -> list[Variant]:
    craft = flights[0].craft
    down = Parameter("offset down", "m", 0.15 * craft.cbar, -craft.cbar, craft.cbar)
    side = Parameter("offset right", "m", 0.05 * craft.b, -0.3 * craft.b, 0.3 * craft.b)
    tilt = Parameter("tilt up", "rad", 0.04, -0.2, 0.2)
    toe = Parameter("toe right", "rad", 0.04, -0.2, 0.2)
    x = craft.thrust.offset[0]
    return [
        _variant((down,), lambda f: [("Cm", 0, f["CT"] / craft.cbar)], "below or above the stated line", ("CT",)),
        _variant((side,), lambda f: [("Cn", 0, -f["CT"] / craft.b)], "beside the stated line", ("CT",)),
        _variant((tilt,), lambda f: [("CZ", 0, -f["CT"]), ("Cm", 0, x * f["CT"] / craft.cbar)], "tilted", ("CT",)),
        _variant((toe,), lambda f: [("CY", 0, f["CT"]), ("Cn", 0, x * f["CT"] / craft.b)], "toed", ("CT",)),
    ]


def _line_says(found: Found) -> str:
    (p,) = found.variant.parameters
    value = found.text(p.name, 180.0 / np.pi, "deg") if p.unit == "rad" else found.text(p.name)
    return f"The thrust does not act along the stated line: {p.name} by {value}."


def _scale_variants(flights: Flights) -> list[Variant]:
    share = Parameter("share", "-", 0.15, -0.8, 0.8)
    V, T = float(gathered(flights, "V").mean()), float(np.abs(gathered(flights, "thrust")).max())
    return [
        _variant((share,), lambda f: _along_thrust(f, 0, f["CT"]), "all of it", terms=("CT",)),
        _variant(
            (share,), lambda f: _along_thrust(f, 0, f["CT"] * (f["V"] / V - 1.0)), "growing with speed", ("CT*V", "CT")
        ),
        _variant(
            (share,), lambda f: _along_thrust(f, 0, f["CT"] * f["thrust"] / T), "growing with thrust", ("CT*thrust",)
        ),
    ]


def _lag_variants(flights: Flights) -> list[Variant]:
    def behind(tau: float) -> Callable[[Flight], Parts]:
        return lambda f: _along_thrust(
            f, 0, (lag(f["thrust"], f.dt, tau) - f["thrust"]) / (f["qbar"] * f.craft.S * tau)
        )

    return [
        _variant((Parameter("lag", "s", tau, 0.4 * tau, 1.7 * tau),), behind(tau))
        for tau in spaced(0.1, 6.0, 11)
    ]  # fmt: skip


# Propeller and rotor


def _propeller_variants(flights: Flights) -> list[Variant]:
    craft = flights[0].craft
    normal = Parameter("force per CT", "1/rad", 1.0, -1.0, 6.0)
    arm = Parameter("moment per CT", "m/rad", 1.0 * craft.cbar)
    factor = Parameter("P-factor", "m/rad", 0.2 * craft.b)
    swirl = (Parameter("Cn per CT", "-", 0.01), Parameter("Cl per CT", "-", 0.01))

    def across(f: Flight) -> list[tuple[str, int, Array]]:
        a, b = f["CT"] * f["alpha"], f["CT"] * f["beta"]
        return [("CZ", 0, -a), ("CY", 0, -b), ("Cm", 1, a / craft.cbar), ("Cn", 1, -b / craft.b)]

    def turning(f: Flight, j: int) -> list[tuple[str, int, Array]]:
        # The blade going down meets more air: the line of thrust moves to its side with alpha, and likewise with beta.
        return [("Cn", j, -f["CT"] * f["alpha"] / craft.b), ("Cm", j, -f["CT"] * f["beta"] / craft.cbar)]

    def swirling(f: Flight, j: int) -> list[tuple[str, int, Array]]:
        return [("Cn", j, f["CT"]), ("Cl", j + 1, f["CT"])]

    turned = ("CT*alpha", "CT*beta")
    return [
        _variant((normal, arm), across, "force across the shaft", terms=("CT*alpha", "CT*beta")),
        _variant((factor,), lambda f: turning(f, 0), "P-factor", terms=("CT*alpha", "CT*beta")),
        _variant(
            (factor, *swirl),
            lambda f: turning(f, 0) + swirling(f, 1),
            "P-factor and swirl",
            ("CT*alpha", "CT*beta", "CT"),
        ),
        _variant(
            (normal, arm, factor), lambda f: across(f) + turning(f, 2), "force across the shaft and P-factor", turned
        ),
    ]


def _gyroscopic(f: Flight, momentum: Array | float) -> Parts:
    # A rotor not allowed for is missing from the moment that the motion is said to need.
    qS = f["qbar"] * f.craft.S
    return [("Cm", 0, -momentum * f["r"] / (qS * f.craft.cbar)), ("Cn", 0, momentum * f["q"] / (qS * f.craft.b))]


def _gyroscopic_variants(flights: Flights) -> list[Variant]:
    inertia = flights[0].craft.inertia
    size = 0.15 * inertia.Ix if inertia is not None else 1.0
    made = [
        _variant(
            (Parameter("angular momentum", "kg m^2/s", size),),
            lambda f: _gyroscopic(f, 1.0),
            "at a constant speed of the rotor",
            ("r/qbar", "q/qbar"),
        )
    ]
    if available(flights, "rpm"):
        fastest = float(np.abs(gathered(flights, "rpm")).max()) * np.pi / 30.0
        if fastest > 0.0:
            made.append(
                _variant(
                    (Parameter("rotor inertia", "kg m^2", size / fastest),),
                    lambda f: _gyroscopic(f, f["rpm"] * np.pi / 30.0), "with its recorded speed",
                    ("r*rpm/qbar", "q*rpm/qbar"),
                )
            )  # fmt: skip
    if moves(flights, "throttle"):
        made.append(
            _variant(
                (Parameter("angular momentum at full throttle", "kg m^2/s", size),),
                lambda f: _gyroscopic(f, f["throttle"]), "growing with throttle",
                ("r*throttle/qbar", "q*throttle/qbar"),
            )
        )  # fmt: skip
    return made


def _gyroscopic_needs(flights: Flights) -> str:
    if missing := lacking(flights, ("Cm", "Cn"), ("q",)):
        return missing
    return "" if moves(flights, "r") or "Cm" not in flights[0].measured else "yaw rate that changes"


# Thrust that differs from side to side


def _asymmetric_variants(flights: Flights) -> list[Variant]:
    craft = flights[0].craft
    arm = Parameter("offset", "m", 0.05 * craft.b, -0.4 * craft.b, 0.4 * craft.b)
    roll = Parameter("rolling moment per CT", "-", 0.02)

    def parts(f: Flight, on: Array | float) -> list[tuple[str, int, Array]]:
        return [("Cn", 0, -on * f["CT"] / craft.b), ("Cl", 1, on * f["CT"])]

    def from_then_on(f: Flight, times: Mapping[str, float]) -> Parts:
        return parts(f, since(f, times))

    made = [_variant((arm, roll), lambda f: parts(f, 1.0), "all the time", ("CT",))]
    if {"thrust_left", "thrust_right"} <= flights[0].recorded:

        def halves(f: Flight) -> list[tuple[str, int, Array]]:
            apart = (f["thrust_left"] - f["thrust_right"]) / (f["qbar"] * f.craft.S)
            return [("Cn", 0, apart / craft.b), ("Cl", 1, apart)]

        made.append(_variant((arm, roll), halves, "as recorded left and right"))
    for times in onsets(flights, ("Cn", "Cl"), _ONSETS):
        made.append(_variant((arm, roll), partial(from_then_on, times=times), told_onsets(times), times=times))
    return made


HYPOTHESES: tuple[Hypothesis, ...] = (
    Hypothesis(
        "slipstream", "propulsive", "The propeller's wash raises the dynamic pressure at wing, tail and controls.",
        _thrust_needs(COEFFICIENTS), _slipstream_variants,
        lambda found: f"The slipstream acts {found.variant.about}: {_all_parameters(found)}.",
        look_alikes=("thrust-line", "wrong-derivative", "propeller-normal-force"),
        separated_by="throttle steps while the elevator moves: a thrust line does not care for the elevator",
        check="control power and trim at idle and at full power, at one speed",
    ),
    Hypothesis(
        "thrust-line", "propulsive", "The thrust acts along another line than stated.",
        _thrust_needs(("Cm", "Cn", "CZ", "CY")), _line_variants, _line_says,
        look_alikes=("slipstream", "asymmetric-thrust", "cg-shift"),
        separated_by="throttle steps at two speeds, with and without elevator activity",
        check="where the engine's line passes the centre of gravity as loaded",
    ),
    Hypothesis(
        "thrust-scale", "propulsive", "The thrust is larger or smaller than stated.",
        _thrust_needs(("CX",)), _scale_variants,
        lambda found: f"The thrust is off by {found.text('share', 100.0, '%')} of the stated ({found.variant.about}).",
        look_alikes=("thrust-lag", "drag-polar", "mass-error"),
        separated_by="throttle steps at one angle of attack",
        check="the thrust table, or the torque and fuel flow behind it",
    ),
    Hypothesis(
        "thrust-lag", "propulsive", "The thrust follows the throttle, or what is recorded of it, late.",
        _thrust_needs(("CX",)), _lag_variants, lambda found: f"The thrust comes late, by a lag of {found.text('lag')}.",
        look_alikes=("thrust-scale", "drag-polar"),
        separated_by="sharp throttle steps up and down",
        check="how the thrust channel is made: from the lever or the engine",
    ),
    Hypothesis(
        "propeller-normal-force", "propulsive", "A propeller in flow across its shaft: force across it, and P-factor.",
        _thrust_needs(("CZ", "CY", "Cm", "Cn")), _propeller_variants,
        lambda found: f"The propeller feels flow across its shaft ({found.variant.about}): {_all_parameters(found)}.",
        look_alikes=("slipstream", "wrong-derivative", "cross-coupling"),
        separated_by="angle of attack and sideslip at idle and at full power",
        check="yaw trim against angle of attack at full power",
    ),
    Hypothesis(
        "engine-gyroscopic", "propulsive", "Rotating parts turn a pitch rate into yaw and a yaw rate into pitch.",
        _gyroscopic_needs, _gyroscopic_variants,
        lambda found: f"The rotating parts have angular momentum not allowed for: {_all_parameters(found)}.",
        look_alikes=("cross-coupling", "inertia-error"),
        separated_by="the same yawing at high and at idle rpm",
        check="sense of rotation and inertia of propeller or rotor",
    ),
    Hypothesis(
        "asymmetric-thrust", "propulsive", "Left and right thrust differ.",
        _thrust_needs(("Cn", "Cl")), _asymmetric_variants,
        lambda found: f"Thrust acts off the plane of symmetry by {found.text('offset')} ({found.variant.about}).",
        look_alikes=("asymmetry", "thrust-line", "propeller-normal-force"), log_prior=1.0,
        separated_by="throttle steps with wings level: an asymmetry of the airframe stays",
        check="both engines' instruments",
    ),
)  # fmt: skip
