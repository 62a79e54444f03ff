"""Modules of benchmarks/, which is no package."""

import importlib.util
import sys
from pathlib import Path

import pytest


def load_benchmark(name):
    """A module of benchmarks/, which may import others of them."""
    path = Path(__file__).parents[1] / "benchmarks" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"benchmark_{name}", path)
    if spec.name not in sys.modules:
        module = importlib.util.module_from_spec(spec)
        sys.modules[spec.name] = module  # dataclasses look their module up
        with pytest.MonkeyPatch.context() as patch:
            patch.syspath_prepend(path.parent)
            spec.loader.exec_module(module)
    return sys.modules[spec.name]
