"""The examples run, and their assertions hold."""

import runpy
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.py"))


@pytest.mark.default_cases("01_first_model", "05_explore_residuals", "06_next_flight")
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_the_example_runs_to_its_assertions(path, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # an example that writes does so here
    runpy.run_path(str(path), run_name="__main__")
    plt.close("all")
    assert capsys.readouterr().out


def test_every_example_ends_in_an_assertion():
    assert EXAMPLES
    for path in EXAMPLES:
        assert path.read_text().rstrip().splitlines()[-1].startswith("assert "), path.name
