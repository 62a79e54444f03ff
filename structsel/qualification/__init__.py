"""Proof of match: recorded and simulated manoeuvres within the tolerances for flight simulators."""

from structsel.qualification.qualify import qualify
from structsel.qualification.result import ParameterCheck, Qualification, QualificationTest
from structsel.qualification.tolerances import TESTS, ObjectiveTest, TestTolerance

__all__ = [
    "TESTS",
    "ObjectiveTest",
    "ParameterCheck",
    "Qualification",
    "QualificationTest",
    "TestTolerance",
    "qualify",
]
