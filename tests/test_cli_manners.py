"""What every command takes and honours: a file of defaults, quiet and verbose, colours, completion, examples."""

import hashlib
import json
import logging
import re

import numpy as np
import pandas as pd
import pytest
from typer.main import get_command
from typer.testing import CliRunner

from structsel import AeroModel, Term, __version__
from structsel.cli import app
from structsel.model import ResponseModel
from tests.commands import run

COMMANDS = [name for name, command in get_command(app).commands.items() if not command.hidden]
SELECT = ("select", "flights", "--responses", "Cm", "--candidates", "alpha,de", "--bootstrap", "0")


@pytest.fixture(autouse=True)
def flights(tmp_path, monkeypatch):
    """A folder of two flights, in the folder one works in."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "flights").mkdir()
    for k in range(2):
        t = np.arange(300) * 0.04
        alpha, de = 0.1 + 0.03 * np.sin(0.7 * t + k), 0.05 * np.sign(np.sin(1.1 * t + k))
        noise = 0.001 * np.random.default_rng(k).standard_normal(300)
        Cm = 0.02 - 0.5 * alpha - 1.5 * de + noise
        table = pd.DataFrame({"t": t, "alpha": alpha, "de": de, "Cm": Cm})
        table.to_csv(tmp_path / "flights" / f"m{k + 1:02d}.csv", index=False)
    return tmp_path / "flights"


def selected(printed):
    """Terms and the method's options, as far as the JSON of a selection says them."""
    held = json.loads(printed)["responses"]["Cm"]
    return [row["term"] for row in held["parameters"]]


# --- a file of defaults ----------------------------------------------------------------------------


def test_a_file_of_defaults_sets_options_and_the_command_line_wins(tmp_path):
    (tmp_path / "structsel.toml").write_text(
        'bootstrap = 0\n[select]\nresponses = "Cm"\ncandidates = ["alpha", "de"]\nf-in = 9.5\n'
    )
    stated = run("select", "flights", "--json")
    assert selected(stated.stdout) == ["1", "de", "alpha"]
    assert json.loads(stated.stdout)["responses"]["Cm"]["inclusion"] == {}
    assert stated.stderr == "note: defaults of options are from 'structsel.toml'.\n"
    assert selected(run("select", "flights", "--f-in", "1e9", "--json").stdout) == ["1"]
    (tmp_path / "other.toml").write_text('[select]\nresponses = "Cm"\nterms = "de"\n')
    stated = run("select", "flights", "--config", "other.toml", "--json")
    assert selected(stated.stdout) == ["1", "de"]
    assert {"file": "other.toml", "sha256": digest(tmp_path / "other.toml")} in inputs_of(stated.stdout)


def test_a_switch_is_set_and_an_option_repeated_by_the_file(tmp_path):
    (tmp_path / "structsel.toml").write_text(
        '[select]\nresponses = "Cm"\nspline = ["alpha:0.1", "de:0.0"]\njson = true\nbootstrap = 0\n'
    )
    assert selected(run("select", "flights").stdout) == ["1", "(de)+", "(alpha - 0.1)+"]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[selct]\ndegree = 2\n", "'structsel.toml': there is no command 'selct' for [selct]. Did you mean 'select'?"),
        ("[select]\ndegre = 2\n", "select has no option 'degre' for [select]. Did you mean 'degree'"),
        ("aircaft = 'a.toml'\n", "no command has an option 'aircaft'. Did you mean 'aircraft'?"),
        ("[select]\nplots = 'no'\n", "[select] plots is a switch: true or false, not 'no'."),
        ("[select]\ndegree = true\n", "[select] degree takes text, a number, or a list of these; not True."),
        ("[select]\nterms = [['alpha']]\n", "[select] terms takes text, a number, or a list"),
        ("[select\n", "file of defaults 'structsel.toml' is not TOML"),
        ("[select]\nconfig = 'x'\n", "select has no option 'config'"),
    ],
)
def test_what_a_file_of_defaults_cannot_mean_is_refused_in_words(text, says, tmp_path):
    (tmp_path / "structsel.toml").write_text(text)
    assert says in run(*SELECT, code=1).stderr
    assert "Example" in run("select", "--help").stdout  # help is given all the same


def test_a_value_that_does_not_fit_its_option_is_reported_with_the_file(tmp_path):
    (tmp_path / "structsel.toml").write_text('[select]\ndegree = "many"\n')
    stated = " ".join(run(*SELECT, code=2).stderr.replace("│", " ").split())
    assert "--degree" in stated
    assert "(from structsel.toml)" in stated
    assert "(from" not in run(*SELECT, "--degree", "many", code=2).stderr
    assert "cannot be read" in run(*SELECT, "--config", "absent.toml", code=1).stderr


@pytest.mark.parametrize(
    ("arguments", "says"),
    [(("selct",), "Did you mean 'select'?"), (("select", "flights", "--degre", "2"), "--degree")],
)
def test_a_command_or_option_misspelled_is_refused_with_the_nearest(arguments, says):
    assert says in " ".join(run(*arguments, code=2).stderr.split())


# --- how much is said ------------------------------------------------------------------------------


def test_quiet_leaves_the_bare_result_and_with_out_nothing(tmp_path):
    (tmp_path / "structsel.toml").write_text("[select]\ndegree = 1\n")
    usual, quiet = run(*SELECT), run(*SELECT, "--quiet")
    assert usual.stdout.startswith(quiet.stdout.rstrip())
    assert "VIF" in quiet.stdout
    assert len(quiet.stdout.splitlines()) < len(usual.stdout.splitlines())
    assert "note:" in usual.stderr
    assert quiet.stderr == ""
    written = run(*SELECT, "--quiet", "--no-plots", "--out", "out")
    assert written.output == ""
    assert AeroModel.from_json(tmp_path / "out" / "model.json").responses.keys() == {"Cm"}


def test_quiet_keeps_warnings_errors_and_json(tmp_path):
    table = pd.read_csv(tmp_path / "flights" / "m01.csv")
    table["alpha"] = np.rad2deg(table["alpha"])  # looks like degrees
    table.to_csv(tmp_path / "flights" / "m01.csv", index=False)
    stated = run(*SELECT, "--quiet", "--json")
    assert "de" in selected(stated.stdout)
    assert stated.stderr.startswith("warning: ")
    assert run("describe", "absent.csv", "--quiet", code=1).stderr == "error: there is no file 'absent.csv'.\n"


def test_verbose_says_what_is_done_with_times_on_stderr(tmp_path):
    usual, stated = run(*SELECT), run(*SELECT, "--verbose", "--no-plots", "--out", "out")
    assert stated.stdout.startswith(usual.stdout)
    lines = stated.stderr.splitlines()
    assert all(re.match(r"\d\d:\d\d:\d\d\.\d{3} ", line) for line in lines)
    said = [line.partition(" ")[2] for line in lines]
    assert said[0] == f"structsel {__version__} select"
    assert re.fullmatch(r"read 'flights/m01.csv': 4 columns, 300 rows, in \d+\.\d\d s", said[1])
    assert any(re.fullmatch(r"selecting, stepwise: done in \d+\.\d\d s", text) for text in said)
    assert any(text.startswith("written 'out': model.json, report.html") for text in said)
    assert re.fullmatch(rf"structsel {__version__} select: done in \d+\.\d\d s", said[-1])
    assert logging.getLogger("structsel").handlers == []


def test_a_command_that_fails_says_so_to_the_log_too():
    stated = run("describe", "absent.csv", "--verbose", code=1).stderr
    assert re.search(r"describe: stopped after \d+\.\d\d s\nerror: there is no file", stated)
    assert "not both" in run("describe", "flights", "--quiet", "--verbose", code=2).stderr


# --- colours, completion, pages of help -----------------------------------------------------------


def test_colours_are_used_on_a_terminal_unless_the_user_wants_none():
    arguments = ("select", "flights", "--responses", "Cm", "--candidates", "alpha,de", "--bootstrap", "20")
    terminal = {"COLUMNS": "80", "FORCE_COLOR": "1", "TERM": "xterm-256color", "NO_COLOR": None}
    coloured = re.compile(r"\x1b\[[\d;]*3\dm")
    for asked, code in ((arguments, 0), (("describe", "absent.csv"), 1), (("select", "--help"), 0)):
        assert coloured.search(run(*asked, code=code, env=terminal).output)
        assert not coloured.search(run(*asked, code=code, env={**terminal, "NO_COLOR": "1"}).output)


@pytest.mark.parametrize(
    ("words", "found"), [("structsel sel", "select"), ("structsel select --deg", "--degree"), ("structsel -", "--help")]
)
def test_bash_completes_commands_and_options(words, found):
    env = {"_STRUCTSEL_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(len(words.split()) - 1)}
    stated = CliRunner().invoke(app, [], prog_name="structsel", env=env)
    assert found in stated.stdout.split()


def test_the_script_that_bash_needs_is_printed():
    stated = CliRunner().invoke(app, ["--show-completion"], prog_name="structsel", env={"SHELL": "/bin/bash"})
    assert "--install-completion" in run("--help").stdout
    assert stated.exit_code != 0 or "_STRUCTSEL_COMPLETE=complete_bash" in stated.stdout


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_has_a_page_with_an_example_of_itself(command):
    printed = run(command, "--help").stdout
    examples = printed[printed.index("Example") :]
    assert f"structsel {command} " in examples
    assert all(option in printed for option in ("--config", "--quiet", "--verbose"))
    assert max(map(len, printed.splitlines())) <= 80


# --- what went in ----------------------------------------------------------------------------------


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def inputs_of(printed):
    return json.loads(printed)["provenance"]["inputs"]


def test_every_result_names_its_input_files_with_their_hashes(tmp_path, flights):
    went_in = [{"file": f"flights/{p.name}", "sha256": digest(p)} for p in sorted(flights.iterdir())]
    printed = run(*SELECT, "--held-out", "m02", "--json", "--no-plots", "--out", "out").stdout
    assert inputs_of(printed) == went_in
    for name in ("model.json", "selection.json", "validation.json"):
        assert inputs_of((tmp_path / "out" / name).read_text()) == went_in
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert all(one["sha256"] in page for one in went_in)
    scored = run("validate", "out/model.json", "flights/m01.csv", "--json").stdout
    assert [one["file"] for one in inputs_of(scored)] == ["out/model.json", "flights/m01.csv"]


def test_a_model_written_without_input_files_still_states_its_versions(tmp_path):
    model = AeroModel({"Cm": ResponseModel((Term("1"),), np.array([0.02]))})
    model.to_json(tmp_path / "model.json")
    held = json.loads((tmp_path / "model.json").read_text())["provenance"]
    assert held["versions"]["structsel"] == __version__
    assert held["versions"]["numpy"] == np.__version__
    assert held["inputs"] == []
    assert AeroModel.from_json(tmp_path / "model.json").responses.keys() == {"Cm"}
