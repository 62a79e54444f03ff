"""Result of a proof of match: each manoeuvre, its test, and pass or fail by parameter."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from structsel.formatting import count_of, display_unit, finite_or_none, format_number
from structsel.nomenclature import unit_of
from structsel.qualification.tolerances import MEASURES, SOURCE, TESTS, ObjectiveTest, TestTolerance
from structsel.recording import Recording
from structsel.results import Result
from structsel.tables import Cell, Column, Summary, Table, text_column

if TYPE_CHECKING:
    import pandas as pd

BEFORE, AFTER = "before", "after"


@dataclass(frozen=True)
class ParameterCheck:
    """One parameter of a test, for one simulation.

    Attributes
    ----------
    group : int
        Of one group a single parameter within its tolerance suffices.
    tolerance : TestTolerance
    recorded, simulated : float
        Value, or of a time history the samples where the error is largest beside its tolerance; NaN if not measured.
    ratio : float
        Largest error over its tolerance; NaN if it could not be measured.
    inside : float
        Fraction of the samples within the tolerance; of a value 0 or 1.
    """

    group: int
    tolerance: TestTolerance
    recorded: float
    simulated: float
    ratio: float
    inside: float

    @property
    def passed(self) -> bool | None:
        """Whether it is within its tolerance, at every sample; None if it could not be measured."""
        return None if math.isnan(self.ratio) else self.ratio <= 1.0


@dataclass(frozen=True, eq=False)
class QualificationTest:
    """One manoeuvre.

    Attributes
    ----------
    name : str
    kind : str
        Key of `TESTS`; empty where the manoeuvre is taken for no test.
    why : str
        Reason for the kind.
    free : float [s]
        Start of the free motion.
    recorded : Recording
    simulated : mapping of "before" and "after" to Recording
    checks : mapping of "before" and "after" to tuple of ParameterCheck
    """

    name: str
    kind: str
    why: str
    free: float
    recorded: Recording
    simulated: Mapping[str, Recording]
    checks: Mapping[str, tuple[ParameterCheck, ...]]

    @property
    def test(self) -> ObjectiveTest | None:
        """Entry of the table."""
        return TESTS.get(self.kind)

    @property
    def title(self) -> str:
        """Entry number and title, or that there is none."""
        return f"{self.test.entry} {self.test.title}" if self.test is not None else "no test of table A2A"

    def passed(self, stage: str) -> bool | None:
        """Whether every group has a parameter within its tolerance; None without a test, or if one is not measured."""
        groups: dict[int, list[bool | None]] = {}
        for check in self.checks.get(stage, ()):
            groups.setdefault(check.group, []).append(check.passed)
        verdicts = [True if True in each else None if None in each else False for each in groups.values()]
        return False if False in verdicts else None if None in verdicts or not verdicts else True


@dataclass(frozen=True, eq=False, repr=False)
class Qualification(Result):
    """Proof of match of a simulation, before and after a correction.

    Attributes
    ----------
    model, corrected : str
        Names of the models; `corrected` is empty if there is one model.
    tests : tuple of QualificationTest
    doubts : tuple of str
        Warnings.
    """

    model: str
    corrected: str
    tests: tuple[QualificationTest, ...]
    doubts: tuple[str, ...] = ()

    @property
    def stages(self) -> tuple[str, ...]:
        """``("before",)`` or ``("before", "after")``."""
        return (BEFORE, AFTER) if self.corrected else (BEFORE,)

    def count(self, stage: str, verdict: bool | None) -> int:
        """Number of tests that passed, failed or could not be judged."""
        return sum(one.passed(stage) is verdict for one in self.tests if one.kind)

    def to_frame(self) -> pd.DataFrame:
        """One row for each manoeuvre, model and parameter; SI units and radians."""
        import pandas as pd

        rows = [
            {
                "manoeuvre": one.name, "kind": one.kind, "entry": one.test.entry if one.test else "", "stage": stage,
                "parameter": check.tolerance.parameter, "group": check.group, "absolute": check.tolerance.absolute,
                "fraction": check.tolerance.fraction, "recorded": check.recorded, "simulated": check.simulated,
                "ratio": check.ratio, "inside": check.inside, "passed": check.passed,
            }
            for one in self.tests for stage in self.stages for check in one.checks[stage]
        ]  # fmt: skip
        return pd.DataFrame(rows)

    def to_dict(self) -> dict[str, Any]:
        """Everything but the samples, for JSON."""
        tests = [
            {
                "manoeuvre": one.name, "kind": one.kind, "title": one.title, "why": one.why,
                "passed": {stage: one.passed(stage) for stage in self.stages},
            }
            for one in self.tests
        ]  # fmt: skip
        frame = self.to_frame()
        checks = frame.astype(object).where(frame.notna(), None).to_dict("records")
        content = {
            "schema": "structsel.qualification/1", "source": SOURCE, "model": self.model, "corrected": self.corrected,
            "tests": tests, "checks": checks, "doubts": list(self.doubts),
        }  # fmt: skip
        found: dict[str, Any] = finite_or_none(content)
        return found

    def overview(self) -> Table:
        """One row for each manoeuvre: its test, the reason, pass or fail."""
        heads, why = (text_column("manoeuvre"), text_column("test")), text_column("taken for it because", wrap=True)
        stages = tuple(text_column(stage if self.corrected else "result") for stage in self.stages)
        rows = tuple(
            (one.name, one.title, *(verdict_cell(one.passed(stage), one.kind) for stage in self.stages), one.why)
            for one in self.tests
        )
        return Table((*heads, *stages, why), rows, "Manoeuvres")

    def table_of(self, one: QualificationTest) -> Table:
        """Parameters of one test: tolerance, error or values, pass or fail."""
        history = one.test is not None and one.test.how == "history"
        columns = [text_column("parameter"), text_column("tolerance")]
        columns += [] if history else [Column("recorded")]
        for stage in self.stages:
            name = stage if self.corrected else "simulated"
            columns += [Column(f"{name}, error" if history else name), Column("of tolerance", "%", detail=True)]
            columns += [text_column("result")]
        rows = []
        for checks in zip(*(one.checks[stage] for stage in self.stages)):
            tolerance = checks[0].tolerance
            row: list[Any] = [parameter_text(tolerance.parameter), tolerance_text(tolerance)]
            row += [] if history else [value_text(tolerance.parameter, checks[0].recorded)]
            for check in checks:
                value = check.simulated - check.recorded if history else check.simulated
                row += [value_text(tolerance.parameter, value), check.ratio]
                row += [verdict_cell(check.passed, one.kind)]
            rows.append(tuple(row))
        groups = one.test.tolerances if one.test is not None else ()
        either = [" or ".join(parameter_text(t.parameter) for t in group) for group in groups if len(group) > 1]
        note = f"One of {'; one of '.join(either)} suffices." if either else ""
        note = f"{note} Largest error and its fraction of the tolerance.".strip() if history else note
        return Table(tuple(columns), tuple(rows), note=note)

    def headline(self) -> str:
        """Tests passed, in one sentence."""
        judged = sum(bool(one.kind) for one in self.tests)
        before = f"{self.count(BEFORE, True)} of {count_of(judged, 'test')} passed"
        if not self.corrected:
            return f"{before}."
        return f"{before} before the correction, {self.count(AFTER, True)} after it."

    def summary(self) -> Summary:
        """Overview, and the parameters of each test."""
        parts = tuple(Summary(one.name, one.title, tables=(self.table_of(one),)) for one in self.tests if one.kind)
        return Summary(
            "Proof of match", self.headline(), tables=(self.overview(),),
            notes=(f"Tolerances: {SOURCE}. A time history passes if every sample is within its tolerance.",),
            warnings=self.doubts, parts=parts,
        )  # fmt: skip


def verdict_cell(passed: bool | None, kind: str) -> Cell:
    """Pass, fail, not measured, or a dash without a test."""
    if not kind:
        return Cell("-", "dim")
    if passed is None:
        return Cell("not measured", "warning")
    return Cell("pass", "good") if passed else Cell("FAIL", "bad")


def unit_shown(parameter: str) -> tuple[float, str]:
    """Factor to the displayed unit of a channel or measure, and the unit; accelerations in m/s^2."""
    if parameter in MEASURES:
        unit = MEASURES[parameter][1]
        return 1.0, "" if unit == "-" else unit
    return display_unit(unit_of(parameter))


def parameter_text(parameter: str) -> str:
    """Words of a measure, or the name of a channel."""
    return MEASURES[parameter][0] if parameter in MEASURES else parameter


def value_text(parameter: str, value: float) -> str:
    """Value in the displayed unit; a dash if it was not measured."""
    factor, unit = unit_shown(parameter)
    return f"{format_number(factor * value, 3)} {unit}".strip() if math.isfinite(value) else "-"


def tolerance_text(tolerance: TestTolerance) -> str:
    """Tolerance in displayed units, ``+-2 deg/s or 10 %``."""
    factor, unit = unit_shown(tolerance.parameter)
    parts = [f"{format_number(factor * tolerance.absolute, 3)} {unit}".strip()] if tolerance.absolute else []
    parts += [f"{100.0 * tolerance.fraction:.0f} %"] if tolerance.fraction else []
    return f"+-{' or '.join(parts)}"


def history_check(group: int, tolerance: TestTolerance, recorded: np.ndarray, simulated: np.ndarray) -> ParameterCheck:
    """Check of a time history: every sample within its tolerance; a simulation that ended is outside."""
    sampled = np.isfinite(recorded)
    if not sampled.any():
        return ParameterCheck(group, tolerance, math.nan, math.nan, math.nan, math.nan)
    y, z = recorded[sampled], simulated[sampled]
    ratio = np.where(np.isfinite(z), np.abs(y - z), np.inf) / tolerance.half_width(y)
    worst = int(np.argmax(ratio))
    return ParameterCheck(
        group, tolerance, float(y[worst]), float(z[worst]), float(ratio[worst]), float(np.mean(ratio <= 1.0))
    )


def value_check(group: int, tolerance: TestTolerance, recorded: float, simulated: float) -> ParameterCheck:
    """Check of one value."""
    width = float(tolerance.half_width(recorded))
    ratio = abs(recorded - simulated) / width if width > 0.0 else math.nan
    inside = math.nan if math.isnan(ratio) else float(ratio <= 1.0)
    return ParameterCheck(group, tolerance, recorded, simulated, ratio, inside)
