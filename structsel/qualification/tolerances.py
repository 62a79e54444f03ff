"""Tolerances of the objective tests of a flight simulator, as one table.

Source: 14 CFR part 60, appendix A, attachment 2, table A2A, "Full Flight Simulator (FFS) Objective Tests", edition of
1 January 2014, printed pages 55, 57 and 58 [FSTD]; the number of each test is its entry number there. Two items are not
from a page that was open: the 5 % of thrust in entry 2.c.5, and the rule that of two tolerances of a parameter the less
restrictive one counts. CS-FSTD(A), appendix 1 to AMC1 FSTD(A).300, has a table of the same tests; it was not compared.
Tolerances on the forces of reversible controls and on trim surfaces are left out: recordings have none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from structsel.numerics.atmosphere import G0

DEG = float(np.pi / 180.0)
KNOT = 0.514444  # m/s
FOOT = 0.3048  # m
How = Literal["history", "value"]

SOURCE = "14 CFR part 60, appendix A, table A2A (1 January 2014); CS-FSTD(A) was not compared"


@dataclass(frozen=True)
class TestTolerance:
    """Tolerance of one parameter.

    Attributes
    ----------
    parameter : str
        A channel, compared over the time of the test, or a measure of the free motion: period, half_time, damping,
        peak_delay. Of a trim, a control or an angle at one time.
    absolute, fraction : float
        Half-width of the band in SI units, and as a fraction of the recorded value. Where both are above zero the
        less restrictive one counts.
    """

    parameter: str
    absolute: float = 0.0
    fraction: float = 0.0

    __test__ = False  # pytest takes the name for that of a test

    def half_width(self, recorded: np.ndarray | float) -> np.ndarray:
        """Half-width of the band around recorded values."""
        return np.asarray(np.maximum(self.absolute, self.fraction * np.abs(recorded)))


@dataclass(frozen=True)
class ObjectiveTest:
    """One entry of the table.

    Attributes
    ----------
    entry : str
        Its number in table A2A.
    title : str
    how : {"history", "value"}
        Compared at every sample, or measured from the motion and compared once.
    tolerances : tuple of tuple of TestTolerance
        All groups must be met; of one group a single member suffices ("or").
    """

    entry: str
    title: str
    how: How
    tolerances: tuple[tuple[TestTolerance, ...], ...]


def _all(*each: TestTolerance) -> tuple[tuple[TestTolerance, ...], ...]:
    return tuple((one,) for one in each)


_CHANGE = _all(
    TestTolerance("V", 3.0 * KNOT), TestTolerance("h", 100.0 * FOOT), TestTolerance("theta", 1.5 * DEG, 0.20)
)
_DECAY = (TestTolerance("half_time", fraction=0.10), TestTolerance("damping", 0.02))

TESTS: Mapping[str, ObjectiveTest] = {
    "power-change": ObjectiveTest("2.c.1", "Power change dynamics", "history", _CHANGE),
    "flap-change": ObjectiveTest("2.c.2", "Flap/slat change dynamics", "history", _CHANGE),
    "gear-change": ObjectiveTest("2.c.4", "Gear change dynamics", "history", _CHANGE),
    "trim": ObjectiveTest(
        "2.c.5",
        "Longitudinal trim",
        "value",
        _all(TestTolerance("de", 1.0 * DEG), TestTolerance("theta", 1.0 * DEG), TestTolerance("thrust", fraction=0.05)),
    ),
    "phugoid": ObjectiveTest("2.c.9", "Phugoid dynamics", "value", ((TestTolerance("period", fraction=0.10),), _DECAY)),
    "short-period": ObjectiveTest(
        "2.c.10",
        "Short period dynamics",
        "history",
        (
            (TestTolerance("theta", 1.5 * DEG), TestTolerance("q", 2.0 * DEG)),
            (TestTolerance("az", 0.10 * G0),),
        ),
    ),
    "roll-response": ObjectiveTest(
        "2.d.2", "Roll response (rate)", "history", _all(TestTolerance("p", 2.0 * DEG, 0.10))
    ),
    "rudder-response": ObjectiveTest("2.d.6", "Rudder response", "history", _all(TestTolerance("r", 2.0 * DEG, 0.10))),
    "dutch-roll": ObjectiveTest(
        "2.d.7",
        "Dutch roll",
        "value",
        ((TestTolerance("period", 0.5, 0.10),), _DECAY, (TestTolerance("peak_delay", 1.0, 0.20),)),
    ),
}
"""Kind of a manoeuvre to its test."""
MEASURES: Mapping[str, tuple[str, str]] = {
    "period": ("period", "s"),
    "half_time": ("time to half amplitude", "s"),
    "damping": ("damping ratio", "-"),
    "peak_delay": ("bank after sideslip", "s"),
}
"""Measure of the free motion to its words and unit."""
