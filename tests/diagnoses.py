"""Diagnoses written by hand, every number known, for their text, figures and files."""

from dataclasses import replace

import numpy as np

from structsel.diagnosis.judging import ResponseFit
from structsel.diagnosis.result import Bars, Diagnosis, EffectFinding, Physics, ToleranceDeviation, Trace
from structsel.effects.base import ParameterEstimate
from structsel.model import AeroModel, ResponseModel

LIFT, HEIGHT = -0.10, 5.0  # what the ground adds to CZ at touch-down, and the height over which it goes [m]
NAMES = tuple(f"m{k:02d}" for k in range(1, 9))


def fits(before, refitted, after):
    """Three bars of given rms errors; R2 and Theil's coefficient as they follow for a fit without bias."""
    made = [ResponseFit(1.0 - e**2, e, e / (1.0 + np.sqrt(max(1.0 - e**2, 0.0)))) for e in (before, refitted, after)]
    return Bars(*made)


def trace(k):
    """One approach: 30 s at 25 Hz, low in the middle, where lift grows."""
    rng = np.random.default_rng([5, k])
    t = np.arange(0.0, 30.0, 0.04)
    h = 1.5 + (0.4 * (t - 15.0 - 0.3 * k)) ** 2 + 60.0 * (k % 2)
    alpha = 0.1 + 0.03 * np.sin(0.8 * t + k)
    noise = 0.004 * rng.standard_normal(t.size)
    delivered = -0.3 - 4.0 * alpha
    more = LIFT * np.exp(-h / HEIGHT)
    CX = -0.03 + 0.5 * alpha**2
    return Trace(
        t=t,
        measured={"CZ": delivered + more + noise, "CX": CX + 0.1 * noise},
        simulated={"CZ": delivered, "CX": CX},
        refitted={"CZ": delivered + 0.1 * more, "CX": CX},
        explained={"CZ": delivered + more, "CX": CX},
        channels={"alpha": alpha, "h_agl": h, "V": 40.0 + 0.0 * t},
    )


GROUND = EffectFinding(
    axes=("CZ", "CX"),
    kind="static",
    physics=(
        Physics(
            "ground-effect",
            0.94,
            "Within one span of the ground lift grows by 0.10 +- 0.004 at touch-down, over a height of 5.0 +- 0.3 m.",
            {"lift": ParameterEstimate(-0.1002, 0.0041, "-"), "height": ParameterEstimate(5.04, 0.31, "m")},
            ("exp(-h_agl/5.0)",),
            check="Which table of ground effect does the simulation read, and over which height?",
        ),
        Physics("configuration-change", 0.05, "The configuration changed, unrecorded."),
        Physics("wind-shear", 0.002, "The wind changes with height."),
    ),
    intervals={"m02": [], "m01": [(12.1, 18.4)], "m03": [(12.5, 19.0), (24.0, 24.5)], "m05": [(13.0, 19.5)]},
    region={"h_agl": (1.5, 5.4)},
    ambiguous_with=(),
    to_separate="",
    bars={"CZ": fits(0.22, 0.21, 0.08), "CX": fits(0.31, 0.30, 0.19)},
    explainable=0.93,
    explained=0.90,
    fraction=0.74,
)
VANE = EffectFinding(
    axes=("CZ", "Cm"),
    kind="sensor",
    physics=(
        Physics(
            "sensor-scale",
            0.52,
            "The angle of attack vane reads too much: by a factor of 1 +0.100 (10 +- 0.4 %).",
            {"scale": ParameterEstimate(0.100, 0.004, "-"), "upwash": ParameterEstimate(0.0021, 0.0004, "rad")},
            plausible="10 % is more than a vane on a boom usually has",
        ),
        Physics("wrong-derivative", 0.41, "The simulation has a wrong value for alpha in CZ."),
    ),
    intervals={},
    region={"alpha": (0.05, 0.20)},
    ambiguous_with=("wrong-derivative",),
    to_separate="A second source of flow angle, or a pull-up in which accelerations give the angle of attack",
    bars={"CZ": fits(0.22, 0.21, 0.05), "CX": fits(0.31, 0.30, 0.18)},
    explainable=0.95,
    explained=0.94,
    fraction=0.26,
)
TURBULENCE = EffectFinding(
    axes=("CZ",), kind="random", physics=(Physics("turbulence", 0.99, "The air is rough: 1.2 m/s rms."),),
    intervals={}, region={}, ambiguous_with=(), to_separate="", bars={"CZ": fits(0.2, 0.2, 0.2)},
    explainable=0.02, explained=0.0, fraction=1.0,
)  # fmt: skip


def model():
    """A model with one response."""
    return AeroModel(
        {"CZ": ResponseModel(("1", "alpha"), np.array([-0.3, -4.0]))}, "the simulation and what was missing"
    )


def diagnosis(*findings, verdict="mismatch", **changes):
    """A diagnosis of eight approaches with these findings, ground effect if none is given."""
    made = Diagnosis(
        verdict=verdict,
        findings=findings or ((GROUND,) if verdict == "mismatch" else ()),
        not_testable={
            "stall-hysteresis": "angle of attack above 10 deg",
            "static-stall": "angle of attack above 10 deg",
            "engine-gyroscopic": "channel rpm",
        },
        remaining={"CZ": (0.08, True), "CX": (0.19, False), "k_alpha": (0.5, True)},
        deviations=(
            ToleranceDeviation("CZ: alpha", 2.3, 0.115, 0.02, "relative"),
            ToleranceDeviation("ay, az turned", -0.4, -0.0014, 0.001, "rad"),
        ),
        remarks=("the clocks of m03 part by 12 ms",),
        form="forced",
        responses=("CX", "CZ"),
        recordings=NAMES,
        model=model(),
        traces={name: trace(k) for k, name in enumerate(NAMES)},
        detects={"ground-effect": {"size": 0.03, "wind-shear": 41.0}, "icing": {"size": 0.35, "mass-error": 2.0}},
        seconds=6.2,
    )
    return replace(made, **changes)


def hostile():
    """A diagnosis whose names come from an unfriendly file."""
    bad = '<script>alert("x")</script>'
    finding = replace(
        GROUND,
        physics=(Physics(bad, 0.9, f"{bad} & 'more'", {bad: ParameterEstimate(1.0, 0.1, bad)}, check=bad),),
        intervals={f"{bad}</script>": [(1.0, 2.0)]},
        region={bad: (0.0, 1.0)},
        ambiguous_with=(bad,),
        to_separate=bad,
    )
    held = trace(0)
    held = replace(held, channels={**held.channels, bad: held.t})
    return diagnosis(
        finding, recordings=(f"{bad}</script>",), traces={f"{bad}</script>": held}, remarks=(bad,), model=None,
        not_testable={bad: bad}, deviations=(ToleranceDeviation(bad, 3.0, 1.0, 0.1, bad),),
        detects={bad: {"size": 0.1}},
    )  # fmt: skip
