"""What README and tutorial show is what happens."""

import contextlib
import io
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from rich.console import Console
from typer.testing import CliRunner

import structsel
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
ACCURACY = (ROOT / "docs/how-good.md").read_text()
HOW_TO = sorted((ROOT / "docs/how-to").glob("*.md"))
GENERATED = {"gallery.md", "commands.md", "reference.md", "effects.md", "decisions.md"}  # by docs/made.py
BETWEEN = r"\s─,():"


def test_the_library_block_prints_what_the_readme_says():
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(code_blocks(README, "python")[0], {})
    assert_same_text(printed.getvalue(), code_blocks(README, "text")[1], BETWEEN)


def test_the_demo_prints_the_table_the_readme_shows():
    recordings, aircraft, truth = demo_flights(demo.TRAINING, turbulence=demo.TURBULENCE)
    pool = Candidates.polynomial(demo.CHANNELS, demo.DEGREE)
    chosen = select(compute_all(recordings, aircraft), list(truth), pool, F_in="auto", bootstrap=0)
    printed = io.StringIO()
    print_summary(Console(file=printed, width=80, highlight=False), summarise_truth(chosen["CX"], truth["CX"]))
    # Without the repetitions of the demo, to save time: the errors and what follows from them are not compared.
    tables = (printed.getvalue(), code_blocks(README, "text")[0])
    values = [re.findall(r"^(\S+) +(-?\d\S*) +(-?\d\S*)", text, re.MULTILINE) for text in tables]
    assert [row[:2] for row in values[0]] == [row[:2] for row in values[1]]
    found, shown = (np.array([float(row[2]) for row in rows]) for rows in values)
    assert len(found) == 5
    assert_allclose(found, shown, rtol=0.01)
    kept = [len(chosen[response].terms) for response in chosen]
    assert kept == [int(row[1]) for row in _hits(README)[:-1]]


def _hits(page):
    """Rows of the README's table of all six models."""
    shown = page.partition("<!-- from: python docs/demo_summary.py -->")[2].partition("\n\n")[0]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in shown.strip().splitlines()[2:]]


@pytest.mark.slow
def test_the_demo_hits_and_misses_what_the_readme_says(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    import demo_summary

    assert _hits("<!-- from: python docs/demo_summary.py -->\n" + demo_summary.table(demo_summary.run_demo())) == _hits(
        README
    )


def test_the_readmes_table_adds_up():
    rows = _hits(README)
    assert [row[0] for row in rows] == ["CX", "CY", "CZ", "Cl", "Cm", "Cn", "all six"]
    for column in (1, 2, 3):
        assert sum(int(row[column]) for row in rows[:-1]) == int(rows[-1][column])
    fractions = [[int(n) for n in row[4].split(" of ")] for row in rows]
    assert [sum(column) for column in zip(*fractions[:-1])] == fractions[-1]


@pytest.mark.parametrize(
    ("example", "largest_error"),
    [("02_flight_path", 2.0), ("03_simulate_the_model", None)],
    ids=["reconstruction", "refinement"],
)
def test_an_example_prints_the_table_that_the_page_of_accuracy_shows(example, largest_error):
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        runpy.run_path(str(ROOT / f"examples/{example}.py"))
    shown = code_blocks(ACCURACY.partition(f"<!-- from: examples/{example}.py -->")[2], "text")[0]
    start = printed.getvalue().index(shown.splitlines()[0])
    assert_same_text(printed.getvalue()[start:][: len(shown)], shown, BETWEEN)
    if largest_error:  # "all eleven errors are estimated within two standard deviations"
        off = re.findall(r"^\w+ +\S+ +\S+ +\S+ +(-?\d\.\d) +(?:m/s|rad|-)", printed.getvalue(), re.MULTILINE)
        assert len(off) == 11
        assert max(abs(float(value)) for value in off) < largest_error


ALL_COMMANDS = [c for page in (README, *(p.read_text() for p in HOW_TO)) for c in commands_of(page)]


@pytest.mark.parametrize("command", ALL_COMMANDS, ids=" ".join)
def test_the_commands_of_the_readme_and_the_how_to_pages_have_the_options_they_show(command):
    help_page = CliRunner().invoke(app, [command[0], "--help"], env={"COLUMNS": "200"}).stdout
    for word in command:
        if word.startswith("--"):
            assert re.search(rf"{word}\b", help_page), word


def test_the_diagnosis_of_the_readme_is_the_beginning_of_the_tutorials():
    shown = code_blocks(README, "text")[-1]
    assert "MISMATCH" in shown
    assert code_blocks(TUTORIAL, "text")[0].startswith(shown)


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
        if command[0] == "diagnose":
            shown = code_blocks(TUTORIAL, "text")[0]
            printed_first = "\n".join(result.stdout.splitlines()[: len(shown.splitlines())])
            assert_same_text(printed_first, shown, BETWEEN)
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


def _how_to(path):
    """Commands of a page, and the blocks that show what they print."""
    text = path.read_text()
    return code_blocks(text, "sh"), re.findall(
        r"<!-- from: [^>]* -->\n```text\n(.*?)^```$", text, re.MULTILINE | re.DOTALL
    )


@pytest.mark.slow
@pytest.mark.parametrize("path", HOW_TO, ids=lambda path: path.stem)
def test_a_how_to_page_is_followed_by_its_own_text_alone(path, tmp_path):
    commands, shown = _how_to(path)
    assert commands
    assert commands[0].startswith("structsel demo ")
    # The files of the demo are the same without its repetitions and figures, which take most of the time.
    commands[0] = commands[0].replace(
        "structsel demo --out out/demo", "structsel demo --out out/demo --bootstrap 0 --no-plots"
    )
    environment = {**os.environ, "COLUMNS": "80", "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    printed = ""
    for block in commands:
        done = subprocess.run(
            ["bash", "-e", "-c", block], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        printed += done.stdout
    for block in shown:
        assert " ".join(block.split()) in " ".join(printed.split())


@pytest.mark.slow
def test_the_page_of_four_packages_shows_what_its_block_prints(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert CliRunner().invoke(app, ["demo", "--out", "out/demo", "--bootstrap", "0", "--no-plots"]).exit_code == 0
    page = (ROOT / "docs/lines-of-code.md").read_text()
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(code_blocks(page, "python")[0], {})
    assert_same_text(printed.getvalue(), code_blocks(page, "text")[0], BETWEEN)


def test_every_file_the_documents_point_to_is_there():
    for path in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")):
        for target in re.findall(r"\]\(([^)#:]+)\)", path.read_text()):
            if (path.parent / target).exists() or target in GENERATED:
                continue
            raise AssertionError(f"{path.relative_to(ROOT)}: {target}")


def test_every_public_name_is_on_one_page_of_the_reference(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    from public_names import MODULES, TASKS

    names = [name for _, _, page in TASKS.values() for name in page]
    assert sorted([*names, *MODULES]) == sorted(structsel.__all__)


def test_a_link_to_a_file_outside_the_docs_leads_to_its_page_and_a_dead_one_is_found(tmp_path, monkeypatch):
    pytest.importorskip("mkdocs", reason='mkdocs is not installed; pip install "structsel[docs]" installs it')
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    from types import SimpleNamespace

    from links import dead_links, rewrite_links

    page = SimpleNamespace(file=SimpleNamespace(src_uri="how-to/many-flights.md"))
    text = "[a](../../examples/07_many_flights.py) [b](../../benchmarks/README.md#goals) [c](../scale.md)"
    expected = "[a](../gallery/07_many_flights.md) [b](../files/benchmarks/README.md#goals) [c](../scale.md)"
    assert rewrite_links(text, page) == expected
    (tmp_path / "a.html").write_text('<a id="here" href="b.html#there"></a><a href="#here"></a><img src="none.png">')
    (tmp_path / "b.html").write_text('<a href="a.html#here"></a><a href="https://example.org/#x"></a>')
    assert dead_links(tmp_path) == ["a.html: b.html#there", "a.html: none.png"]


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
