"""The public names: all there, all documented, one version."""

import ast
import inspect
import re
import tomllib
from importlib.metadata import requires, version
from pathlib import Path

import pytest

import structsel as ss
from tests.package_source import imports, modules

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


def test_no_signature_prints_the_contents_of_a_default():
    functions = [getattr(ss, name) for name in ss.__all__ if inspect.isfunction(getattr(ss, name))]
    assert [f.__name__ for f in functions if " at 0x" in str(inspect.signature(f))] == []


def test_every_step_of_the_journey_is_at_the_top():
    steps = "read_recording reconstruct compute_coefficients select validate trim linearise simulate refine resimulate"
    more = "compare_estimates design_inputs compare_inputs published_aircraft open_jsbsim Atmosphere"
    more += " Instruments Refinement Resimulation"
    assert {*steps.split(), *more.split()} <= set(ss.__all__)


def test_the_version_is_the_same_everywhere():
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert ss.__version__ == declared == version("structsel")
    assert declared in (ROOT / "CHANGELOG.md").read_text()


def test_everything_imported_is_declared():
    declared = " ".join(requires("structsel") or [])
    for package in ("numpy", "scipy", "pandas", "scikit-learn", "statsmodels", "numba", "pint", "pydantic", "typer"):
        assert package in declared


# --- the rooms -------------------------------------------------------------------------------------


def test_the_map_of_the_rooms_has_the_order_in_which_they_may_import():
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    (layers,) = (one["layers"] for one in contracts if one["type"] == "layers")
    text = (ROOT / "structsel/README.md").read_text()
    rooms = re.findall(r"^\| `(\w+)/?` \|", text, re.MULTILINE)
    assert [f"structsel.{room}" for room in rooms] == layers[::-1]
    assert len(text.splitlines()) <= 60


# Private names that modules take from others, still. This list only shrinks.
BORROWED: set[str] = set()


def borrowed(module):
    """Names with an underscore that a module takes from another module of the package."""
    local = {}
    for other, name, as_name in imports(module):
        if name is None:
            local[as_name] = other
        elif name.startswith("_") and not name.startswith("__"):
            yield f"{module}: {other}.{name}"
    for node in ast.walk(modules()[module]):
        taken = isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in local
        if taken and node.attr.startswith("_") and not node.attr.startswith("__"):
            yield f"{module}: {local[node.value.id]}.{node.attr}"


def test_no_module_takes_a_private_name_from_another():
    assert {name for module in modules() for name in borrowed(module)} == BORROWED
