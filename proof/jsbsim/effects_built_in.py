"""Effects that a JSBSim aircraft itself has, found in its functions, and those functions without them.

They are JSBSim's own tables and formulas: independent of structsel in every respect.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from proof.jsbsim.aircraft import JSBSimPlant
from proof.jsbsim.functions import (
    CL_SQUARED,
    H_B,
    AeroFunction,
    Node,
    Operation,
    Property,
    Table,
    Value,
    blended,
    folded,
    scaled,
    walk,
)
from proof.jsbsim.functions import replace as replace_nodes
from proof.keys import Kind

ALPHA, BETA, MACH = ("aero/alpha-rad", "aero/alpha-deg"), ("aero/beta-rad", "aero/beta-deg"), ("velocities/mach",)
SIDESLIP = (*BETA, "aero/mag-beta-rad")
FLAP = ("fcs/flap-pos-rad", "fcs/flap-pos-deg", "fcs/flap-pos-norm")
GEAR = ("gear/gear-pos-norm",)
BRAKE = ("fcs/speedbrake-pos-norm", "fcs/speedbrake-pos-rad")
WASH = ("propulsion/engine/prop-induced-velocity_fps", "systems/propulsion/thrust-coefficient",
        "propulsion/engine[0]/thrust-coefficient")  # fmt: skip
_LONG = ("LIFT", "DRAG", "PITCH")
_LATERAL = ("SIDE", "ROLL", "YAW")
_RATES = {f"velocities/{c}{kind}-rad_sec": c for c in "pqr" for kind in ("", "-aero")}
_CONTROLS = ("elevator", "aileron", "rudder")


@dataclass(frozen=True, eq=False)
class BuiltInEffect:
    """One piece of an aircraft's own physics.

    Attributes
    ----------
    effect : str
    functions : tuple of AeroFunction
        As a simulation without it has them.
    needs : tuple of str
        Purposes of manoeuvres that show it.
    tie : tuple of str
    kind : str
    label : str
        What is left out.
    region : str
        Channel that bounds it; empty where it acts everywhere.
    """

    effect: str
    functions: tuple[AeroFunction, ...]
    needs: tuple[str, ...] = ()
    tie: tuple[str, ...] = ()
    kind: Kind = "static"
    label: str = ""
    region: str = ""
    lift: tuple[float, float] = (0.3, 0.6)
    accept: tuple[str, ...] = ()

    def left_in(self, plant: JSBSimPlant, fraction: float) -> tuple[AeroFunction, ...]:
        """The parts with a fraction of the physics left in."""
        own = {function.name: function for function in plant.functions}
        return tuple(replace(p, node=blended(own[p.name].node, p.node, fraction)) for p in self.functions)


def find_built_in(plant: JSBSimPlant) -> list[BuiltInEffect]:
    """All that can be left out of an aircraft, by the structure of its functions."""
    found: list[BuiltInEffect] = []
    for find in (_ground, _mach, _polar, _stall, _hysteresis, _configuration, _wake, _wash, _crossing, _curved_control,
                 _wrong, _reynolds):  # fmt: skip
        found += find(plant)
    return found


def _frozen(functions: tuple[AeroFunction, ...], values: dict[str, float]) -> tuple[AeroFunction, ...]:
    """Those of the parts that read a property, with its value in its place."""

    def change(node: Node) -> Node | None:
        return Value(node.sign * values[node.name]) if isinstance(node, Property) and node.name in values else None

    return tuple(replace(p, node=folded(replace_nodes(p.node, change))) for p in functions if p.reads() & set(values))


def _without(plant: JSBSimPlant, reads: tuple[str, ...], axes: tuple[str, ...] = ()) -> tuple[AeroFunction, ...]:
    return tuple(
        replace(p, node=scaled(p.node, 0.0))
        for p in plant.functions
        if p.axis and p.reads() & set(reads) and (not axes or p.axis in axes)
    )


def _ground(plant: JSBSimPlant) -> list[BuiltInEffect]:
    functions = _frozen(plant.functions, {H_B: 5.0})
    needs = ("low", "low", "low")
    return (
        [BuiltInEffect("ground-effect", functions, needs, (), label="in all axes", region="h_agl")] if functions else []
    )


def _mach(plant: JSBSimPlant) -> list[BuiltInEffect]:
    functions = _frozen(plant.functions, {MACH[0]: 0.2})
    tie = ("wrong-derivative", "flexibility", "drag-polar")
    return (
        [
            BuiltInEffect(
                "compressibility", functions, ("speed", "speed"), tie, label="Mach held at 0.2", lift=(0.12, 0.6)
            )
        ]
        if functions
        else []
    )


def _polar(plant: JSBSimPlant) -> list[BuiltInEffect]:
    made = []
    functions = _without(plant, (CL_SQUARED,), ("DRAG",))
    if functions:
        made.append(
            BuiltInEffect("drag-polar", functions, ("pull-up", "speed"), ("missing-term",), label="CL squared in drag")
        )
    for function in plant.functions:
        if function.axis == "DRAG" and function.reads() & set(ALPHA) and not function.reads() & set(MACH):
            straight = _straightened(function, ALPHA, 0.0, 0.14)
            if straight is not None:
                made.append(
                    BuiltInEffect(
                        "drag-polar",
                        (straight,),
                        ("pull-up", "speed"),
                        ("missing-term", "static-stall"),
                        label="curvature of drag with angle of attack",
                    )
                )
    return made


def _straightened(
    function: AeroFunction, names: tuple[str, ...], low: float, high: float, extend: bool = False
) -> AeroFunction | None:
    """The part with each table in one of the names made linear in it, or its line from low to high kept beyond."""
    hit = False

    def change(node: Node) -> Node | None:
        nonlocal hit
        if not isinstance(node, Table):
            return None
        rows = node.inputs[0]
        if not (isinstance(rows, Property) and rows.name in names):
            return None
        unit = 57.29578 if rows.name.endswith("deg") else 1.0
        x = node.axes[0]
        inside = (x >= low * unit - 1e-9) & (x <= high * unit + 1e-9)
        if inside.sum() < 2 or (not extend and inside.sum() < 3):
            return None
        centred = x[inside] - x[inside].mean()
        data = node.data.reshape(len(x), -1)
        slope = (centred @ data[inside]) / (centred @ centred)
        middle = data[inside].mean(axis=0)
        line = middle + (x[:, None] - x[inside].mean()) * slope
        if extend:
            keep = x <= high * unit + 1e-9
            line[keep] = data[keep]
            last = np.flatnonzero(keep)[-1]
            line[~keep] = data[last] + (x[~keep, None] - x[last]) * slope
            far = np.append(x, x[-1] + 0.3 * unit)  # tables are held beyond their ends; a line is not
            line = np.vstack([line, line[-1] + 0.3 * unit * slope])
            hit = True
            return Table(node.inputs, (far, *node.axes[1:]), line.reshape(len(far), *node.data.shape[1:]))
        hit = True
        return Table(node.inputs, node.axes, line.reshape(node.data.shape))

    made = replace_nodes(function.node, change)
    return replace(function, node=made) if hit else None


def _stall(plant: JSBSimPlant) -> list[BuiltInEffect]:
    """Lift tables go on as they started, and drag and moment tables with them."""
    functions = []
    for function in plant.functions:
        if function.axis == "LIFT" and function.reads() & set(ALPHA):
            made = _straightened(function, ALPHA, 0.0, 0.16, extend=True)
            if made is not None:
                functions.append(made)
    if not functions:
        return []
    hold = {"aero/stall-hyst-norm": 0.0}
    functions = [next(iter(_frozen((p,), hold)), p) for p in functions]
    tie = ("missing-term", "stall-hysteresis")
    return [
        BuiltInEffect(
            "static-stall",
            tuple(functions),
            ("stall", "stall", "stall"),
            tie,
            label="lift continues to rise beyond 9 deg",
            region="alpha",
        )
    ]


def _hysteresis(plant: JSBSimPlant) -> list[BuiltInEffect]:
    functions = _frozen(plant.functions, {"aero/stall-hyst-norm": 0.0})
    return [BuiltInEffect("stall-hysteresis", functions, ("stall", "stall", "stall"), ("static-stall",), "memory",
                   "lower branch of lift", "alpha")] if functions else []  # fmt: skip


def _configuration(plant: JSBSimPlant) -> list[BuiltInEffect]:
    made = []
    for which, names in (("df", FLAP), ("gear", GEAR), ("brake", BRAKE)):
        functions = _without(plant, names, _LONG)
        functions = tuple(p for p in functions if not _mixed(plant, p, names))
        if functions:
            made.append(BuiltInEffect("configuration-change", functions, (which,) * 4, (), label=which, region=which))
    return made


def _mixed(plant: JSBSimPlant, function: AeroFunction, names: tuple[str, ...]) -> bool:
    """Whether the part would act without what is moved, too."""
    own = next(p for p in plant.functions if p.name == function.name)
    zero = replace_nodes(own.node, lambda n: Value(0.0) if isinstance(n, Property) and n.name in names else None)
    tables = [n for n in walk(zero) if isinstance(n, Table)]
    product = isinstance(zero, Operation) and zero.kind == "product"
    factors = zero.of if isinstance(zero, Operation) else ()
    gone = product and any(isinstance(n, Value) and n.value == 0.0 for n in factors)
    held = product and any(
        isinstance(n, Table) and len(n.inputs) == 1 and isinstance(n.inputs[0], Value)
        and abs(float(np.interp(0.0, n.axes[0], n.data))) < 1e-9
        for n in tables
    )  # fmt: skip
    return not (gone or held)


def _wake(plant: JSBSimPlant) -> list[BuiltInEffect]:
    functions = _without(plant, ("aero/alphadot-rad_sec",))
    tie = ("wrong-derivative", "unsteady-lift", "sensor-delay")
    return (
        [BuiltInEffect("downwash-lag", functions, ("pitch", "pull-up", "turn"), tie, "memory", "alpha-dot terms")]
        if functions
        else []
    )


def _wash(plant: JSBSimPlant) -> list[BuiltInEffect]:
    values = {name: 0.0 for name in WASH if name in plant.properties}
    functions = _frozen(plant.functions, values) if values else ()
    tie = ("wrong-derivative", "thrust-line", "thrust-scale")
    return [BuiltInEffect("slipstream", functions, ("throttle", "throttle", "throttle", "speed"), tie, "propulsive",
                   "the propeller's wash")] if functions else []  # fmt: skip


def _crossing(plant: JSBSimPlant) -> list[BuiltInEffect]:
    made = []
    functions = _without(plant, SIDESLIP, _LONG)
    if functions:
        made.append(
            BuiltInEffect(
                "cross-coupling", functions, ("lateral", "lateral"), ("missing-term",), label="sideslip in drag"
            )
        )
    bent = []
    for function in plant.functions:
        if (
            function.axis in _LATERAL
            and function.reads() & set(ALPHA)
            and (function.reads() & ({*SIDESLIP} | set(_RATES)))
        ):
            bent.append(
                next(iter(_frozen((function,), {name: 0.05 * (57.3 if "deg" in name else 1) for name in ALPHA})))
            )
    if bent:
        made.append(BuiltInEffect("cross-coupling", tuple(bent), ("lateral", "turn", "stall"),
                           ("missing-term", "wrong-derivative"),
                           label="angle of attack in lateral derivatives"))  # fmt: skip
    return made


def _curved_control(plant: JSBSimPlant) -> list[BuiltInEffect]:
    made = []
    for function in plant.functions:
        names = tuple(n for n in function.reads() if "pos-rad" in n and any(c in n for c in _CONTROLS))
        if function.axis in ("PITCH", "ROLL", "YAW") and names:
            straight = _straightened(function, names, -0.12, 0.12, extend=False)
            if straight is not None:
                shown = ("pull-up", "lateral")
                made.append(BuiltInEffect("control-nonlinearity", (straight,), shown, ("missing-term",),
                                   label=function.name))  # fmt: skip
    return made


def _wrong(plant: JSBSimPlant) -> list[BuiltInEffect]:
    """Each derivative that can be wrong."""
    made = []
    for function in plant.functions:
        reads = function.reads()
        wanted = reads & ({*ALPHA, *BETA} | set(_RATES)) or any(c in n for n in reads for c in _CONTROLS)
        if (
            function.axis in ("LIFT", "SIDE", "ROLL", "PITCH", "YAW")
            and wanted
            and "aero/alphadot-rad_sec" not in reads
        ):
            needs = ("pitch", "pull-up") if function.axis in _LONG else ("lateral", "lateral")
            tie: tuple[str, ...] = ("inertia-error",) if function.axis in ("ROLL", "PITCH", "YAW") else ("mass-error",)
            if function.axis == "PITCH":
                tie = (*tie, "cg-shift", "downwash-lag")
            made.append(
                BuiltInEffect(
                    "wrong-derivative",
                    (replace(function, node=scaled(function.node, 0.0)),),
                    needs,
                    tie,
                    "parameter",
                    function.name,
                )
            )
    return made


def _reynolds(plant: JSBSimPlant) -> list[BuiltInEffect]:
    functions = _frozen(plant.functions, {"aero/Re": 3e6})
    return [BuiltInEffect("reynolds", functions, ("speed", "speed"), ("compressibility", "wrong-derivative"),
                   label="Re held at 3e6")] if functions else []  # fmt: skip
