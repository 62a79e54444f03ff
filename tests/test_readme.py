"""What README and tutorial show is what happens."""

import contextlib
import io
import re
import runpy
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from rich.console import Console
from typer.testing import CliRunner

from structsel import Candidates, select
from structsel.cli import app, demo
from structsel.cli.comparison_tables import summarise_truth
from structsel.cli.tables import print_summary
from structsel.coefficients import compute_all
from structsel.demo import demo_flights
from tests.commands import assert_same_text, code_blocks, commands_of

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text()
TUTORIAL = (ROOT / "docs/tutorial.md").read_text()
BETWEEN = r"\s─,():"


def test_the_library_block_prints_what_the_readme_says():
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(code_blocks(README, "python")[0], {})
    assert_same_text(printed.getvalue(), code_blocks(README, "text")[1], BETWEEN)


def test_the_demo_prints_the_table_the_readme_shows():
    recordings, aircraft, truth = demo_flights(demo.TRAINING, turbulence=demo.TURBULENCE)
    pool = Candidates.polynomial(demo.CHANNELS, demo.DEGREE)
    chosen = select(compute_all(recordings, aircraft), list(truth), pool, F_in="auto", bootstrap=0)["Cn"]
    printed = io.StringIO()
    print_summary(Console(file=printed, width=80, highlight=False), summarise_truth(chosen, truth["Cn"]))
    # Without the repetitions of the demo, to save time: the errors and what follows from them are not compared.
    tables = (printed.getvalue(), code_blocks(README, "text")[0])
    values = [re.findall(r"^(\S+) +(-?\d\S*) +(-?\d\S*)", text, re.MULTILINE) for text in tables]
    assert [row[:2] for row in values[0]] == [row[:2] for row in values[1]]
    found, shown = (np.array([float(row[2]) for row in rows]) for rows in values)
    assert len(found) == 8
    assert_allclose(found, shown, rtol=0.01)


def test_the_second_example_prints_the_table_the_readme_shows():
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        runpy.run_path(str(ROOT / "examples/02_flight_path.py"))
    shown = code_blocks(README, "text")[2]
    start = printed.getvalue().index(shown.splitlines()[0])
    assert_same_text(printed.getvalue()[start:][: len(shown)], shown, BETWEEN)
    # "all eleven are found within two standard deviations"
    off = re.findall(r"^\w+ +\S+ +\S+ +\S+ +(-?\d\.\d) +(?:m/s|rad|-)", printed.getvalue(), re.MULTILINE)
    assert len(off) == 11
    assert max(abs(float(value)) for value in off) < 2.0


def test_the_third_example_prints_the_table_the_readme_shows():
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        runpy.run_path(str(ROOT / "examples/03_simulate_the_model.py"))
    shown = code_blocks(README, "text")[3]
    start = printed.getvalue().index(shown.splitlines()[0])
    assert_same_text(printed.getvalue()[start:][: len(shown)], shown, BETWEEN)


@pytest.mark.parametrize("command", commands_of(README), ids=" ".join)
def test_the_readmes_commands_have_the_options_they_show(command):
    help_page = CliRunner().invoke(app, [command[0], "--help"], env={"COLUMNS": "200"}).stdout
    for word in command:
        if word.startswith("--"):
            assert re.search(rf"{word}\b", help_page), word


@pytest.mark.slow
def test_the_tutorial_runs_from_end_to_end(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(demo, "DEGREE", 1)  # the demo's own selection is not what is tested here
    asked = commands_of(TUTORIAL)
    assert [command[0] for command in asked].count("select") == 4
    for command in asked:
        faster = ["--bootstrap", "0"] if command[0] in ("demo", "select") else []
        draws = ("demo", "reconstruct", "select", "validate", "simulate", "refine", "inputs")
        drawn = command[0] in draws and "--out" in command
        faster += ["--no-plots"] if drawn else []
        result = CliRunner().invoke(app, [*command, *faster], env={"COLUMNS": "80"})
        assert result.exit_code == 0, result.output
        if "--trace" in command:
            # "beta^2 and r_hat enter, R2 rises to 0.99, and the flights never selected from are predicted as well"
            assert re.search(r"^beta\^2 ", result.stdout, re.MULTILINE)
            assert re.search(r"^r_hat ", result.stdout, re.MULTILINE)
            assert re.search(r"R2 0\.99", result.stdout)
            assert re.search(r"all +3002 +0\.9[89]", result.stdout)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(code_blocks(TUTORIAL, "python")[0], {})
    assert float(printed.getvalue().splitlines()[-1]) == pytest.approx(-1.92, abs=0.02)


def test_every_file_the_documents_point_to_is_there():
    for path in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        for target in re.findall(r"\]\(([^)#:]+)\)", path.read_text()):
            assert (path.parent / target).exists(), f"{path.name}: {target}"


def test_every_test_that_the_list_of_faults_points_to_is_there():
    stated = (ROOT / "docs/robustness.md").read_text().partition("## Damaged files by the thousand")[0]
    # The table of clocks, units and signs is that of test_entry_checks.py.
    stated = re.sub(r"## Clocks, units and signs\n.*?(?=\n## )", "", stated, flags=re.DOTALL)
    rows = re.findall(r"^\|.*\| (`test_.*) \|$", stated, re.MULTILINE)
    assert len(rows) == len(re.findall(r"^\|", stated, re.MULTILINE)) - 2 * stated.count("| shown by |")
    for row in rows:
        for names, files in re.findall(r"((?:`test_\w+`(?:, )?)+) \(([\w, ]+)\)", row):
            for name in re.findall(r"`(\w+)`", names):
                for file in files.split(", "):
                    assert f"def {name}(" in (ROOT / f"tests/test_{file}.py").read_text(), f"{file}: {name}"
