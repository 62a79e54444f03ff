"""The command line: what it prints, writes and refuses.

The expected tables are in tests/golden/; STRUCTSEL_GOLDEN=write writes them.
"""

import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

from structsel import AeroModel, Aircraft, read_recording, write_recording
from structsel.cli import messages
from structsel.coefficients import compute_coefficients
from structsel.demo import demo_flights
from tests.commands import assert_same_text, run

GOLDEN = Path(__file__).parent / "golden"
AIRCRAFT = """
name = "testbed"
mass = 2288.231
S = 23.23
b = 14.63
cbar = 1.5875
V0 = 45.0
[inertia]
Ix = 5368.39
Iy = 6928.93
Iz = 11158.75
Ixz = 117.64
[thrust]
offset = [1.8, 0.0, -0.15]
inclination = 0.03
"""
TRUTH = {"1": 0.08, "alpha": -0.6, "de": -1.9, "q_hat": -30.0}


def flight(k, n=500):
    """Return one synthetic manoeuvre with white noise, its terms known."""
    rng = np.random.default_rng([7, k])
    t = 0.04 * np.arange(n)
    # Steps of a 3-2-1-1 keep angle of attack, rate and elevator apart.
    de = 0.06 * np.sign(np.sin(1.1 * t + k)) * (t % 6 < 4)
    q_hat = 0.004 * np.cos(2.3 * t + 2 * k) + 0.002 * rng.standard_normal(n)
    alpha = 0.12 + 0.05 * np.sin(0.7 * t + 3 * k) + 0.01 * rng.standard_normal(n)
    Cm = sum(v * {"1": 1.0, "alpha": alpha, "de": de, "q_hat": q_hat}[name] for name, v in TRUTH.items())
    Cm = Cm + 0.01 * rng.standard_normal(n)
    return pd.DataFrame({"t": t, "alpha": alpha, "q_hat": q_hat, "de": de, "Cm": Cm})


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flights")
    for k in range(3):
        flight(k).to_csv(folder / f"m{k + 1:02d}.csv", index=False)
    return folder


@pytest.fixture(scope="module")
def raw(tmp_path_factory):
    """Two flights as recorded, without coefficients, and their aircraft file."""
    folder = tmp_path_factory.mktemp("raw")
    recordings, _, _ = demo_flights(2, duration=8.0)
    for recording in recordings:
        write_recording(recording, folder / f"{recording.name}.csv")
    (folder / "aircraft.toml").write_text(AIRCRAFT)
    return folder


SELECT = ("--responses", "Cm", "--candidates", "alpha,q_hat,de", "--degree", 2, "--f-in", "auto", "--bootstrap", 40)


# --- what is printed ------------------------------------------------------------------------------


def compare(name, printed):
    """Compare with a golden file: words exactly, numbers to 3 %, rules and blanks not at all."""
    path = GOLDEN / f"{name}.txt"
    if os.environ.get("STRUCTSEL_GOLDEN") == "write":
        path.write_text("\n".join(line.rstrip() for line in printed.splitlines()) + "\n")
    assert_same_text(printed, path.read_text())


def test_describe_prints_channels_units_ranges_and_findings(files):
    compare("describe", run("describe", files / "m01.csv").stdout)


def test_select_prints_the_terms_the_fit_the_warnings_and_the_search(files):
    result = run("select", files, *SELECT, "--trace")
    compare("select", result.stdout)
    assert result.stderr == ""


def test_every_method_is_compared_in_one_table(files):
    compare("compare", run("select", files, *SELECT, "--method", "all", "--bootstrap", 0).stdout)


def test_validate_prints_scores_of_each_recording_and_of_all(files, tmp_path):
    run("select", files / "m01.csv", *SELECT, "--out", tmp_path / "out", "--no-plots")
    compare("validate", run("validate", tmp_path / "out/model.json", files / "m02.csv", files / "m03.csv").stdout)


@pytest.mark.parametrize("command", [(), ("describe",), ("coefficients",), ("select",), ("validate",), ("demo",)])
def test_every_help_page_holds_an_example_and_fits_80_columns(command):
    printed = run(*command, "--help").stdout
    assert "Example" in printed
    assert f"structsel {' '.join(command)}" in printed
    assert max(map(len, printed.splitlines())) <= 80


def test_nothing_printed_is_wider_than_80_columns(files):
    for line in run("select", files, *SELECT, "--trace", "--held-out", "m03").stdout.splitlines():
        assert len(line) <= 80


def test_the_version_is_the_packages():
    from structsel import __version__

    assert run("--version").stdout == f"structsel {__version__}\n"


# --- what is found ---------------------------------------------------------------------------------


def test_the_selected_terms_are_those_the_flights_were_made_of(files):
    held = json.loads(run("select", files, *SELECT, "--json").stdout)
    assert held["schema"] == "structsel.selection/1"
    found = {row["term"]: row for row in held["responses"]["Cm"]["parameters"]}
    assert set(found) == set(TRUTH)
    for term, value in TRUTH.items():
        # 1500 samples of white noise: within four standard errors, at odds of 1 in 4000 for four terms.
        assert abs(found[term]["value"] - value) < 4.0 * found[term]["std_error"]


def test_recordings_held_out_are_scored_and_not_selected_from(files):
    held = json.loads(run("select", files, *SELECT, "--held-out", "m02", "--json").stdout)
    assert held["responses"]["Cm"]["n"] == 1000
    assert [s["recording"] for s in held["validation"]["scores"]] == ["m02"]
    data = flight(1)
    model = {row["term"]: row["value"] for row in held["responses"]["Cm"]["parameters"]}
    modelled = model["1"] + sum(model[c] * data[c] for c in ("alpha", "de", "q_hat"))
    sse = float(np.sum((data.Cm - modelled) ** 2))
    r2 = 1.0 - sse / float(np.sum((data.Cm - data.Cm.mean()) ** 2))
    assert_allclose(held["validation"]["scores"][0]["r2"], r2, rtol=1e-9)


def test_gaps_make_manoeuvres_which_are_held_out_together(tmp_path):
    parts = [flight(k) for k in range(2)]
    parts[1]["t"] += 100.0
    pd.concat(parts).to_csv(tmp_path / "two.csv", index=False)
    flight(2).to_csv(tmp_path / "m03.csv", index=False)
    result = run("select", tmp_path, *SELECT, "--held-out", "two", "--json")
    held = json.loads(result.stdout)
    assert [s["recording"] for s in held["validation"]["scores"]] == ["two_1", "two_2"]
    assert "read as 2 manoeuvres" in result.stderr


def test_forced_terms_join_the_pool_and_the_model(files):
    held = json.loads(run("select", files, *SELECT, "--include", "alpha*de", "--bootstrap", 0, "--json").stdout)
    assert "alpha*de" in [row["term"] for row in held["responses"]["Cm"]["parameters"]]


def test_splines_join_the_pool(files):
    arguments = ("--responses", "Cm", "--spline", "alpha:0.1,0.15", "--include", "(alpha - 0.1)+", "--bootstrap", 0)
    held = json.loads(run("select", files, *arguments, "--json").stdout)
    assert "(alpha - 0.1)+" in [row["term"] for row in held["responses"]["Cm"]["parameters"]]


def test_latex_goes_to_stdout_alone_and_warnings_to_stderr(files):
    result = run("select", files / "m01.csv", *SELECT, "--latex")
    assert result.stdout.startswith("% stepwise\n\\begin{tabular}")
    assert result.stdout.endswith("\\end{tabular}\n")
    assert "warning: One manoeuvre only" in result.stderr


def test_coefficients_written_read_back_as_the_library_computes_them(raw, tmp_path):
    source = raw / "elevator-3211.csv"
    run("coefficients", source, "--aircraft", raw / "aircraft.toml", "--out", tmp_path / "csv")
    run("coefficients", source, "--aircraft", raw / "aircraft.toml", "--out", tmp_path / "pq", "--format", "parquet")
    expected = compute_coefficients(read_recording(source), Aircraft.from_toml(raw / "aircraft.toml"))
    for path in (tmp_path / "csv/elevator-3211.csv", tmp_path / "pq/elevator-3211.parquet"):
        back = read_recording(path)
        for name in ("CX", "CY", "CZ", "Cl", "Cm", "Cn", "p_hat", "V_ratio"):
            assert_allclose(back[name], expected[name], rtol=1e-12)


def test_units_of_channels_outside_the_nomenclature_are_written(tmp_path):
    frame = flight(0).assign(load=1.0).rename(columns={"load": "load [kN]"})
    frame.to_csv(tmp_path / "a.csv", index=False)
    write_recording(read_recording(tmp_path / "a.csv"), tmp_path / "b.csv")
    back = read_recording(tmp_path / "b.csv")
    assert_allclose(back["load"], 1000.0)
    assert back.unit("load") == read_recording(tmp_path / "a.csv").unit("load")


def test_an_aircraft_makes_select_compute_the_coefficients_first(raw):
    with_aircraft = (raw / "elevator-3211.csv", "--aircraft", raw / "aircraft.toml")
    arguments = ("--responses", "CZ", "--terms", "alpha,de,q_hat", "--bootstrap", 0, "--json")
    held = json.loads(run("select", *with_aircraft, *arguments).stdout)
    assert held["responses"]["CZ"]["fit"]["r2"] > 0.9


# --- what is written --------------------------------------------------------------------------------


def test_out_holds_model_selection_tables_and_plots(files, tmp_path):
    run("select", files, *SELECT, "--held-out", "m03", "--out", tmp_path / "a/b")
    found = {str(p.relative_to(tmp_path / "a/b")) for p in (tmp_path / "a/b").rglob("*") if p.is_file()}
    plots = {f"plots/Cm_{name}.png" for name in ("fit", "choice", "residual")}
    texts = {"model.json", "selection.json", "validation.json", "terms.csv", "terms.tex", "report.txt", "report.html"}
    assert found == texts | plots
    model = AeroModel.from_json(tmp_path / "a/b/model.json")
    table = pd.read_csv(tmp_path / "a/b/terms.csv")
    assert_allclose([model["Cm"][term] for term in table.term], table.value, rtol=1e-12)
    assert os.listdir(tmp_path / "a") == ["b"]


def test_every_method_leaves_its_own_model(files, tmp_path):
    run("select", files, *SELECT, "--method", "all", "--bootstrap", 0, "--out", tmp_path / "o", "--no-plots")
    names = {p.name for p in (tmp_path / "o").glob("model*.json")}
    methods = ("stepwise", "orthogonal", "best_subset", "stepwise_white")
    assert names == {f"model_{method}.json" for method in methods}


def test_what_stands_is_not_overwritten_unless_asked(files, tmp_path):
    out = tmp_path / "o"
    out.mkdir()
    (out / "model.json").write_text("mine")
    (out / "notes.txt").write_text("mine too")
    arguments = ("select", files, *SELECT, "--bootstrap", 0, "--out", out, "--no-plots")
    assert "--overwrite" in run(*arguments, code=1).stderr
    assert (out / "model.json").read_text() == "mine"
    run(*arguments, "--overwrite")
    assert "Cm" in AeroModel.from_json(out / "model.json")
    assert (out / "notes.txt").read_text() == "mine too"


def test_a_failure_while_writing_leaves_nothing_behind(files, tmp_path, monkeypatch):
    def fail(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(pd.DataFrame, "to_csv", fail)
    result = run("select", files, *SELECT, "--bootstrap", 0, "--out", tmp_path / "a/o", code=1)
    assert "No space left on device" in result.stderr
    assert os.listdir(tmp_path) == []


# --- what is refused --------------------------------------------------------------------------------


def _bad(folder, kind):
    """Write a bad file; return the arguments that use it."""
    data, options = flight(0), []
    path = folder / "bad.csv"
    if kind == "missing channel":
        data = data.drop(columns="q_hat")
    elif kind == "NaN":
        data.loc[57, "alpha"] = np.nan
    elif kind == "one sample":
        data = data[:1]
    elif kind == "constant response":
        data["Cm"] = 0.3
    elif kind in ("wrong unit", "column not there"):
        entry = {"wrong unit": 'alpha = { column = "alpha", unit = "m/s" }', "column not there": 'alpha = "AoA"'}
        (folder / "map.toml").write_text(f'[channels]\nt = "t"\nCm = "Cm"\n{entry[kind]}\n')
        options = ["--map", folder / "map.toml"]
    data.to_csv(path, index=False)
    if kind == "empty file":
        path.write_bytes(b"")
    elif kind == "unreadable file":
        path.write_bytes(bytes(range(256)) * 4)
    elif kind == "no file":
        path.unlink()
    return [path, *options]


@pytest.mark.parametrize(
    ("kind", "says"),
    [
        ("missing channel", ["'q_hat'", "'bad'", "It has: t, alpha, de, Cm", "--aircraft"]),
        ("NaN", ["'alpha'", "'bad'", "sample 57", "t = 2.28 s", "rows = [first, last]"]),
        ("one sample", ["bad.csv", "1 sample"]),
        ("constant response", ["'Cm'", "constant (0.3)", "bad", "Check the channel map"]),
        ("wrong unit", ["map.toml", "'alpha'", "'m/s'", "[rad]", "Correct the unit"]),
        ("column not there", ["bad.csv", "'alpha'", "'AoA'", "It has: t, alpha, q_hat", "map"]),
        ("empty file", ["bad.csv", "empty"]),
        ("unreadable file", ["bad.csv"]),
        ("no file", ["bad.csv", "no file"]),
    ],
)
def test_bad_input_is_refused_by_name_with_a_remedy_and_leaves_nothing(kind, says, tmp_path):
    out = tmp_path / "out"
    result = run("select", *_bad(tmp_path, kind), *SELECT, "--out", out, code=1)
    for part in says:
        assert part in result.stderr
    assert result.stderr.startswith("error: ")
    assert result.stdout == ""
    assert not [p.name for p in tmp_path.iterdir() if "out" in p.name]


def test_zero_dynamic_pressure_names_the_recording_the_sample_and_the_remedy(raw, tmp_path):
    data = pd.read_csv(raw / "elevator-3211.csv", comment="#")
    data["qbar"] = 0.5 * data.rho * data.V**2
    data.loc[33, "qbar"] = 0.0
    data.to_csv(tmp_path / "bad.csv", index=False)
    arguments = ("--aircraft", raw / "aircraft.toml", "--out", tmp_path / "out")
    for command in (("coefficients",), ("select", "--responses", "CZ", "--terms", "alpha")):
        result = run(*command, tmp_path / "bad.csv", *arguments, code=1)
        for part in ("'qbar' [Pa]", "'bad'", "sample 33 (t = 0.66 s)", "rows = [first, last]"):
            assert part in result.stderr
    assert os.listdir(tmp_path) == ["bad.csv"]


def test_more_candidates_than_samples_goes_on_with_the_warning_in_plain_sight(tmp_path):
    flight(0)[:9].to_csv(tmp_path / "short.csv", index=False)
    arguments = ("--responses", "Cm", "--candidates", "alpha,q_hat,de", "--degree", 3, "--bootstrap", 0)
    printed = run("select", tmp_path / "short.csv", *arguments).stdout
    assert "! 9 samples for 19 candidates" in printed


def test_warnings_of_a_recording_go_to_stderr_and_json_stays_json(files, tmp_path):
    data = flight(0)
    data["alpha"] = np.rad2deg(data["alpha"])
    data.to_csv(tmp_path / "degrees.csv", index=False)
    result = run("select", tmp_path / "degrees.csv", *SELECT, "--bootstrap", 0, "--json")
    assert "warning: degrees: alpha:" in result.stderr
    assert "degrees fed as radians" in result.stderr
    json.loads(result.stdout)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--responses", "Cm"), "no candidate terms"),
        (("--candidates", "alpha"), "--responses"),
        (("--responses", "Cm", "--candidates", "alpha", "--f-in", "many"), "many"),
        (("--responses", "Cm", "--candidates", "alpha", "--components", "some"), "--components"),
        (("--responses", "Cm", "--candidates", "alpha", "--method", "lasso"), "lasso"),
        (("--responses", "Cm", "--candidates", "alpha", "--spline", "alpha"), "CHANNEL:KNOT"),
        (("--responses", "Cm", "--candidates", "alpha", "--json", "--latex"), "--latex"),
    ],
)
def test_a_command_line_that_cannot_be_read_exits_with_2(files, arguments, says):
    assert says in run("select", files, *arguments, code=2).stderr


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--f-in", 3, "--f-out", 4), "F_out=4 is above F_in=3"),
        (("--held-out", "m09"), "There are: m01, m02, m03"),
        (("--held-out", "m01,m02,m03"), "leaves no recording"),
        (("--include", "alpha*"), "cannot be read"),
    ],
)
def test_a_request_that_cannot_be_meant_exits_with_1(files, arguments, says):
    assert says in run("select", files, *SELECT, *arguments, code=1).stderr


def test_two_files_of_one_name_are_refused(files):
    assert "'m01'" in run("describe", files / "m01.csv", files, code=1).stderr


def _wait(capsys, monkeypatch, patience):
    monkeypatch.setattr(messages, "PROGRESS_DELAY", patience)
    with messages.ProgressBar("working") as waiting:
        time.sleep(0.3)
        waiting("moments", 1, 2)
        time.sleep(0.3)
    captured = capsys.readouterr()
    assert captured.out == ""
    return captured.err


def test_a_progress_bar_appears_on_a_terminal_only_and_only_when_it_takes_long(capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")  # rich takes this for a terminal
    assert "working: moments" in _wait(capsys, monkeypatch, 0.05)
    assert _wait(capsys, monkeypatch, 5.0) == ""
    monkeypatch.delenv("FORCE_COLOR")
    assert _wait(capsys, monkeypatch, 0.05) == ""


# --- as a program -----------------------------------------------------------------------------------


def test_the_installed_program_prints_errors_without_a_traceback_and_without_colours(tmp_path):
    program = [sys.executable, "-c", "from structsel.cli import main; main()", "describe", "nothing.csv"]
    env = {key: value for key, value in os.environ.items() if key != "FORCE_COLOR"} | {"NO_COLOR": "1"}
    done = subprocess.run(program, cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr == "error: there is no file 'nothing.csv'.\n"
    assert done.stdout == ""


def test_the_demo_shows_models_with_their_truth_and_leaves_files_to_continue_with(tmp_path, monkeypatch):
    from structsel.cli import demo

    monkeypatch.setattr(demo, "DEGREE", 1)  # the full pool takes its time, and is what `make demo` is for
    printed = run("demo", "--out", tmp_path / "demo", "--no-plots", "--bootstrap", 0).stdout
    for response in ("CX", "CY", "CZ", "Cl", "Cm", "Cn"):
        assert re.search(rf"^{response}  \d+ of 8 candidates", printed, re.MULTILINE)
    assert "-1.921" in printed  # the truth of Cm's elevator derivative
    go_on = re.findall(r"structsel select (\S+) --aircraft (\S+) \\\n\s+(.*)", printed)
    assert go_on
    flights, aircraft, options = go_on[0]
    run("select", flights, "--aircraft", aircraft, *options.split(), "--bootstrap", 0, "--degree", 1)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="file names of any bytes exist on Linux")
def test_file_names_that_are_not_utf8_are_read_and_written_in_full(tmp_path):
    folder, out = (os.fsdecode(os.fsencode(tmp_path) + name) for name in (b"/d\xff", b"/o\xff"))
    os.mkdir(folder)
    write_recording(demo_flights(1)[0][0], tmp_path / "m.csv")
    os.rename(tmp_path / "m.csv", os.fsdecode(os.fsencode(folder) + b"/m\xff.csv"))
    run("select", folder, "--responses", "az", "--candidates", "alpha", "--bootstrap", "0", "--no-plots", "--out", out)
    model = json.loads((Path(out) / "model.json").read_text(encoding="utf-8"))
    (source,) = model["provenance"]["inputs"]
    assert source["file"].endswith("/d\\xff/m\\xff.csv")
    assert len(source["sha256"]) == 64
