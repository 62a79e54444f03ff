"""The two sets of tests, and how many random examples each draws.

``make test`` runs the default set (``-m "not slow"``), ``make test-all`` every test. A test whose answer needs minutes
of simulated flight is marked ``slow``. A parametrised test keeps all its cases; ``default_cases`` names those of them
that are in the default set, one of each kind, and the others are slow::

    @pytest.mark.default_cases("alpha", "q")
    @pytest.mark.parametrize("name", ["alpha", "beta", "q"])

A number instead of names keeps the first so many cases.
"""

import os
from collections import defaultdict

import pytest
from hypothesis import settings

settings.register_profile("quick", max_examples=20, deadline=None, derandomize=bool(os.environ.get("CI")))
settings.register_profile("all", deadline=None, derandomize=bool(os.environ.get("CI")))


def pytest_configure(config):
    """Few random examples in the default set; in CI the same ones each time."""
    settings.load_profile("quick" if "not slow" in config.option.markexpr else "all")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Mark as slow the cases of a parametrised test that ``default_cases`` does not name."""
    tests = defaultdict(list)
    for item in items:
        if item.get_closest_marker("default_cases"):
            tests[item.nodeid.partition("[")[0]].append(item)
    for name, cases in tests.items():
        kept = set(cases[0].get_closest_marker("default_cases").args)
        (number,) = kept if all(isinstance(one, int) for one in kept) else (0,)
        for i, item in enumerate(cases):
            if i >= number and item.callspec.id not in kept:
                item.add_marker(pytest.mark.slow)
        ids = {item.callspec.id for item in cases}
        if not number and not kept <= ids and not any("::" in asked for asked in config.args):
            raise pytest.UsageError(f"{name}: default_cases names {kept - ids}, which are no cases of it")


@pytest.fixture
def ax():
    """Axes of a new figure."""
    from matplotlib.figure import Figure

    return Figure().add_subplot()


@pytest.fixture
def close_figures():
    """Close pyplot's figures after the test."""
    yield
    from matplotlib import pyplot as plt

    plt.close("all")


@pytest.fixture(scope="session")
def trimmed():
    """The demonstration aircraft trimmed at 45 m/s and 1000 m."""
    from structsel.demo import demo_aircraft
    from structsel.simulation import trim
    from tests.models import DEMO

    return trim(DEMO, demo_aircraft(), 45.0, 1000.0)
