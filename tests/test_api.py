"""The public names: all there, all documented, one version."""

import tomllib
from importlib.metadata import requires, version
from pathlib import Path

import pytest

import structsel as ss

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("name", ss.__all__)
def test_every_public_name_is_there_and_documented(name):
    thing = getattr(ss, name)
    assert thing.__doc__
    assert len(thing.__doc__) > 30


@pytest.mark.parametrize("name", [n for n in ss.__all__ if callable(getattr(ss, n)) and n[0].islower()])
def test_every_public_verb_says_what_goes_in_comes_out_and_goes_wrong(name):
    text = getattr(ss, name).__doc__
    for section in ("Parameters\n", "Returns\n"):
        assert section in text
    assert "Raises\n" in text or name == "demo_flights"


def test_every_step_of_the_journey_is_at_the_top():
    steps = "read_recording reconstruct compute_coefficients select validate trim linearise simulate refine resimulate"
    more = "compare_estimates design_inputs compare_inputs ready open_jsbsim Air Instruments Refinement Resimulation"
    assert {*steps.split(), *more.split()} <= set(ss.__all__)


def test_the_version_is_the_same_everywhere():
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert ss.__version__ == declared == version("structsel")
    assert declared in (ROOT / "CHANGELOG.md").read_text()


def test_everything_imported_is_declared():
    declared = " ".join(requires("structsel") or [])
    for package in ("numpy", "scipy", "pandas", "scikit-learn", "statsmodels", "numba", "pint", "pydantic", "typer"):
        assert package in declared
