"""structsel simulate, inputs, refine and validate --replay: printed text, files and errors."""

import json
import re
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

from structsel import (
    AeroModel,
    Instruments,
    Recording,
    ResponseModel,
    published_aircraft,
    read_recording,
    refine,
    write_recording,
)
from structsel.cli.models import read_trim
from structsel.inputs import three_two_one_one
from tests.commands import run

CITATION = published_aircraft("citation")
TRIM = CITATION.trim()
NOISE = {"V": 0.1, "alpha": 0.001, "q": 0.001, "theta": 0.001, "az": 0.05}
FREE = "Cm:1,Cm:alpha,Cm:q_hat,Cm:de"


def stated(result):
    """Messages of a command on one line."""
    return re.sub(r"[\s│]+", " ", result.stderr)


def write_model(path, **terms):
    """Write the Citation with other values of terms of Cm."""
    held = CITATION.model["Cm"]
    values = [terms.get(str(term), value) for term, value in zip(held.terms, held.values)]
    AeroModel({**CITATION.model.responses, "Cm": ResponseModel(held.terms, np.array(values))}, path.stem).to_json(path)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Aircraft, models and three simulated flights with known noise."""
    made = tmp_path_factory.mktemp("fly")
    CITATION.aircraft.to_toml(made / "aircraft.toml")
    write_model(made / "truth.json")
    write_model(made / "off.json", alpha=-0.7, q_hat=-15.0, de=-1.0)
    write_model(made / "wild.json", alpha=60.0, q_hat=90.0)
    (made / "flights").mkdir()
    for k, size in enumerate((0.02, -0.02, 0.015), 1):
        u = three_two_one_one("de", size, 0.4 + 0.1 * k, duration=12.0, dt=0.04)
        schedule = Recording(f"m0{k}", u.t, {"de": TRIM["de"] + u["de"]})
        flight = CITATION.simulate(schedule, start=TRIM, instruments=Instruments(noise=NOISE, seed=k))
        write_recording(flight, made / "flights" / f"m0{k}.csv")
    return made


@pytest.fixture(scope="module")
def aircraft(folder):
    return ("--aircraft", folder / "aircraft.toml")


@pytest.fixture(scope="module")
def schedules(tmp_path_factory):
    out = tmp_path_factory.mktemp("in") / "in"
    run("inputs", "doublet", "--channel", "de", "--amplitude", 0.02, "--duration", 6, "--out", out, "--no-plots")
    return out


# --- pages ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["simulate", "inputs", "refine", "validate"])
def test_help_pages_hold_examples_and_fit_80_columns(command):
    printed = run(command, "--help").stdout
    assert "Example" in printed
    assert f"structsel {command}" in printed
    assert max(map(len, printed.splitlines())) <= 80


# --- simulate ---------------------------------------------------------------------------------------


def test_trim_and_modes_are_those_of_the_library():
    printed = run("simulate", "builtin:beaver", "--trim", "45,609.6", "--modes").stdout
    beaver = published_aircraft("beaver")
    trim = beaver.trim(45.0, 609.6)
    for name in ("alpha", "de", "manifold_pressure"):
        value = re.search(rf"^{name} +(-?[\d.]+)", printed, re.MULTILINE)[1]
        assert float(value) == pytest.approx(trim[name], rel=1e-3)
    modes = beaver.linearise(trim, axis="lateral").modes()
    row = re.search(r"^Dutch roll +(\S+) +(\S+)", printed, re.MULTILINE)
    z = modes.eigenvalues[modes.names.index("Dutch roll")]
    assert_allclose([float(x) for x in row.groups()], [z.real, z.imag], atol=1e-4)
    assert max(map(len, printed.splitlines())) <= 80


def test_the_old_name_of_a_builtin_aircraft_works_with_a_warning():
    old, new = (run("simulate", f"{kind}:hawk:lateral", "--modes") for kind in ("ready", "builtin"))
    assert old.stdout == new.stdout
    assert stated(old) == "warning: 'ready:hawk:lateral' is deprecated: use 'builtin:hawk:lateral'. "
    assert new.stderr == ""


def test_the_hawks_modes_have_the_published_values():
    held = json.loads(run("simulate", "builtin:hawk:longitudinal", "--modes", "--json").stdout)
    (modes,) = held["modes"].values()
    # [C89]: short period -1.512 +- 2.231i from derivatives rounded to three decimals.
    assert_allclose([modes[0]["re"], modes[0]["im"]], [-1.512, 2.231], atol=0.005)


def test_perturbations_are_simulated_from_trim_with_the_noise_of_the_options(schedules, tmp_path):
    out = tmp_path / "out"
    common = ("simulate", "builtin:citation", "--inputs", schedules / "doublet.csv", "--no-plots")
    run(*common, "--noise", "alpha=0.01", "--out", out)
    noisy = read_recording(out / "flights" / "doublet.csv")
    run(*common, "--out", out, "--overwrite")
    exact = read_recording(out / "flights" / "doublet.csv")
    assert exact["de"][0] == pytest.approx(TRIM["de"])
    assert np.ptp(exact["de"]) == pytest.approx(0.04)
    assert np.std(noisy["alpha"] - exact["alpha"]) == pytest.approx(0.01, rel=0.15)
    assert_allclose(noisy["q"], exact["q"], atol=1e-12)
    held = json.loads((out / "simulation.json").read_text())
    assert held["trim"]["alpha"] == pytest.approx(TRIM["alpha"])
    assert held["unfinished"] == {}


def test_recorded_inputs_are_simulated_from_the_recorded_start(folder, aircraft, tmp_path):
    one = folder / "flights" / "m01.csv"
    printed = run("simulate", folder / "truth.json", *aircraft, "--recordings", one, "--out", tmp_path / "out").stdout
    recorded, simulated = read_recording(one), read_recording(tmp_path / "out" / "flights" / "m01.csv")
    assert_allclose(simulated["de"], recorded["de"], atol=1e-12)
    assert np.std(simulated["q"] - recorded["q"]) < 0.003
    assert (tmp_path / "out" / "plots" / "m01.png").exists()
    assert "recorded min" in printed
    assert max(map(len, printed.splitlines()[:-1])) <= 80


def test_jsbsim_is_simulated_by_the_same_command(tmp_path):
    pytest.importorskip("jsbsim")
    short = ("--width", 0.2, "--start", 0.1, "--duration", 0.6, "--out", tmp_path / "in", "--no-plots")
    run("inputs", "doublet", "--channel", "de", "--amplitude", 0.02, *short)
    schedule = tmp_path / "in" / "doublet.csv"
    arguments = ("jsbsim:c172p", "--trim", "55,1000", "--inputs", schedule, "--stabilise", "--json")
    # JSBSim prints a greeting on Python's stdout, which only a separate process keeps out of the JSON.
    asked = [sys.executable, "-c", "from structsel.cli import main; main()", "simulate", *map(str, arguments)]
    held = json.loads(subprocess.run(asked, capture_output=True, text=True, check=True, timeout=120).stdout)
    assert 0.0 < held["trim"]["throttle"] < 1.0
    assert len(held["flights"]) == 1


def test_linear_models_are_simulated_about_their_reference(schedules):
    printed = run("simulate", "builtin:hawk:longitudinal", "--inputs", schedules / "doublet.csv", "--noise", "q=0.001")
    assert re.search(r"^q +rad/s", printed.stdout, re.MULTILINE)
    assert "leave --trim" in stated(run("simulate", "builtin:hawk:lateral", "--trim", "45,0", code=2))


def test_a_simulation_that_diverges_states_its_end_and_is_written_up_to_there(folder, aircraft, tmp_path):
    out = tmp_path / "out"
    one = ("--recordings", folder / "flights" / "m01.csv")
    result = run("simulate", folder / "wild.json", *aircraft, *one, "--out", out, "--no-plots", code=1)
    until = float(re.search(r"could not be simulated beyond t = ([\d.]+) s", result.stderr)[1])
    assert "STOPPED EARLY" in result.stdout
    assert "With --out the flight so far is written" in stated(result)
    kept = read_recording(out / "flights" / "m01.csv")
    assert kept.t[-1] < until < 3.0
    assert "m01" in json.loads((out / "simulation.json").read_text())["unfinished"]
    # The others are simulated nevertheless.
    held = run("simulate", folder / "wild.json", *aircraft, "--recordings", folder / "flights", "--json", code=1)
    assert len(json.loads(held.stdout)["flights"]) == 3


def test_where_no_trim_exists_the_nearest_is_stated_and_what_to_try():
    result = run("simulate", "builtin:beaver", "--trim", "15,600", code=1)
    assert "No trim exists at V = 15 m/s" in result.stderr
    assert "nearest condition to a trim" in result.stderr
    assert "--free" in result.stderr
    assert "free=(...)" not in result.stderr


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("truth.json", "--trim", "45,600"), "give --aircraft"),
        (("builtin:citation", "--trim", "fast"), "not NAME=NUMBER"),
        (("builtin:citation", "--trim", "V=120,speed=3"), "--trim has no 'speed'"),
        (("builtin:citation", "--wind", "3"), "three numbers"),
        (("builtin:citation", "--define", "thrust"), "NAME=FORMULA"),
        (("builtin:citation", "--inputs", "nothing.csv"), "does not exist"),
        (("builtin:citation", "--stabilise", "--inputs", "flights/m01.csv"), "for JSBSim only"),
    ],
)
def test_what_cannot_be_read_exits_with_2(folder, monkeypatch, arguments, says):
    monkeypatch.chdir(folder)
    assert says in stated(run("simulate", *arguments, code=2))


def test_unknown_aircraft_and_inputs_that_move_nothing_are_refused(schedules):
    assert "Did you mean 'beaver'" in stated(run("simulate", "builtin:beavr", code=1))
    assert "builtin:hawk:lateral" in stated(run("simulate", "builtin:hawk", code=1))
    elevator = ("--inputs", schedules / "doublet.csv")
    assert "'dlon'" in stated(run("simulate", "builtin:as355:80kt", *elevator, code=1))
    result = run(
        "inputs", "doublet", "--channel", "dx", "--amplitude", 1, "--out", schedules.parent / "dx", "--no-plots"
    )
    assert result.exit_code == 0
    moved = run("simulate", "builtin:citation", "--inputs", schedules.parent / "dx" / "doublet.csv", code=1)
    assert "'doublet' has dx, but the controls of the model are" in stated(moved)


def test_a_trim_is_read_by_place_and_by_name():
    assert read_trim("45,600,climb=0.05") == {"V": 45.0, "h": 600.0, "climb": 0.05}
    assert read_trim("h=600,V=45") == {"V": 45.0, "h": 600.0}
    assert read_trim("") == {}


# --- inputs -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("step", ()),
        ("impulse", ()),
        ("doublet", ("--width", 0.6)),
        ("3-2-1-1", ("--width", 0.4, "--start", 2)),
        ("2-1-1-1", ()),
        ("sweep", ("--low", 0.1, "--high", 2, "--law", "linear")),
        ("multisine", ("--low", 0.1, "--high", 2, "--period", 10)),
    ],
)
def test_every_classical_input_is_written_as_a_schedule(kind, options, tmp_path):
    run("inputs", kind, "--channel", "de", "--amplitude", 0.02, *options, "--out", tmp_path / "in", "--no-plots")
    (path,) = (tmp_path / "in").glob("*.csv")
    made = read_recording(path)
    peak = np.abs(made["de"]).max()
    assert peak == pytest.approx(0.02 / 0.02 if kind == "impulse" else 0.02)  # an impulse is its area over a sample
    if "--start" in options:
        assert not made["de"][made.t < 1.99].any()


def test_inputs_are_compared_by_their_bounds_at_equal_energy(tmp_path):
    model = ("--model", "builtin:hawk:longitudinal", "--noise", "w=0.5,q=0.005", "--parameters", "mw,mq,mde")
    arguments = ("inputs", "compare", *model, "--energy", 0.01, "--duration", 10, "--out", tmp_path / "out")
    printed = run(*arguments).stdout
    table = pd.read_csv(tmp_path / "out" / "comparison.csv").set_index("input")
    assert table["A"].idxmin() == "optimal A"
    assert table["D"].idxmin() == "optimal D"
    fraction = re.search(r"^doublet +\S+ +\S+ +\S+ +(\S+)", printed, re.MULTILINE)[1]
    assert float(fraction) == pytest.approx(100.0 * table.loc["doublet", "std_mw"] / 0.048, rel=0.01)
    energies = [
        (read_recording(path)["de"] ** 2).sum() * 0.05 for path in (tmp_path / "out").glob("*.csv")
        if path.stem != "comparison"
    ]  # fmt: skip
    assert len(energies) == 9
    assert_allclose(energies, 0.01, rtol=1e-6)
    assert (tmp_path / "out" / "inputs.png").exists()
    assert max(map(len, printed.splitlines()[:-1])) <= 80


def test_repeated_simulations_scatter_as_the_bound_predicts():
    model = ("--model", "builtin:hawk:longitudinal", "--noise", "w=0.5,q=0.005", "--parameters", "mq,mde")
    arguments = ("--energy", 0.01, "--duration", 10, "--functions", 8, "--runs", 200)
    held = json.loads(run("inputs", "compare", *model, *arguments, "--json").stdout)
    assert len(held["scatter"]) == len(held["inputs"]) == 9
    ratios = [row["ratio"] for one in held["scatter"] for row in one["parameters"]]
    # Each is 1 with a standard deviation of 0.05 (200 flights); every input has the same noise, so they are correlated.
    assert np.max(np.abs(np.array(ratios) - 1.0)) < 0.2


def test_an_optimal_input_keeps_its_limits_and_separates_what_is_requested(folder, aircraft):
    model = ("--model", folder / "truth.json", *aircraft, "--trim", "120,7500", "--noise", "alpha=0.002,q=0.002")
    asked = ("--parameters", "zw,mw,mq,mde", "--energy", 0.003, "--duration", 10, "--functions", 10)
    common = ("inputs", "optimal", *model, *asked)
    held = json.loads(run(*common, "--limits", "alpha=0.03,de=0.03", "--to-separate", "mw,mq", "--json").stdout)
    assert held["criterion"] == "E"
    assert held["of_interest"] == ["mw", "mq"]
    for limit in held["limits"]:
        assert limit["reached"] <= 1.01 * limit["allowed"]
    assert held["information"]["values"]["mq"] < 0.0
    printed = run(*common).stdout
    assert "trace of the covariance" in printed


def test_an_input_that_excites_nothing_names_the_parameters_it_leaves_open():
    model = ("--model", "builtin:hawk:lateral", "--noise", "p=0.01,r=0.01", "--parameters", "lda,lp,nr")
    result = run("inputs", "doublet", "--channel", "da", "--amplitude", 0, *model, code=1)
    assert "does not determine all of lda, lp, nr" in stated(result)
    assert "Excite the motion" in stated(result)
    assert re.search(r"^lda +-34.84 +- ", result.stdout, re.MULTILINE)  # the table stands, without bounds
    fine = run("inputs", "doublet", "--channel", "da", "--amplitude", 0.01, *model)
    assert re.search(r"^lda +-34.84 +\d", fine.stdout, re.MULTILINE)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("doublet", "--channel", "de"), "needs --amplitude"),
        (("doublet", "--amplitude", "1"), "needs --channel"),
        (("doublet", "--channel", "de", "--amplitude", "1", "--low", "1"), "has no --low"),
        (("doublet", "--channel", "de,da", "--amplitude", "1"), "moves one control"),
        (("compare",), "needs --model"),
        (("compare", "--model", "builtin:citation", "--noise", "q=0.01"), "needs --energy"),
        (
            ("compare", "--model", "builtin:citation", "--noise", "q=0.01", "--limits", "de=1"),
            "compare has no --limits",
        ),
        (("optimal", "--model", "builtin:citation", "--noise", "q=0.01", "--width", "1"), "optimal has no --width"),
        (("optimal", "--model", "builtin:citation"), "needs --noise"),
        (("optimal", "--model", "jsbsim:c172p", "--noise", "q=0.01"), "linear model"),
    ],
)
def test_inputs_that_lack_something_exit_with_2(arguments, says):
    assert says in stated(run("inputs", *arguments, code=2))


# --- refine -----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def refined(folder, aircraft, tmp_path_factory):
    out = tmp_path_factory.mktemp("refined") / "out"
    flights = ("--recordings", folder / "flights", "--outputs", "alpha,q,theta,az", "--starts", "u,w,q,theta")
    result = run("refine", folder / "off.json", *aircraft, *flights, "--free", "Cm:", "--held-out", "m03", "--out", out)
    return out, result.stdout


def test_refine_finds_the_truth_and_prints_both_errors(refined, folder):
    out, printed = refined
    model = AeroModel.from_json(out / "model.json")["Cm"]
    found = pd.read_csv(out / "parameters.csv").set_index("name")
    truth = CITATION.model["Cm"]
    for term in ("1", "alpha", "q_hat", "de"):
        row = found.loc[f"Cm:{term}"]
        assert abs(model[term] - truth[term]) < 4.0 * row["std"]
        shown = re.search(rf"^Cm:{term} +(\S+) +(\S+) +(\S+)", printed, re.MULTILINE)
        assert_allclose([float(x) for x in shown.groups()], row[["value", "std", "std_white"]].astype(float), rtol=0.06)
    assert "converged" in printed
    assert max(map(len, printed.splitlines()[:-1])) <= 80


def test_refine_writes_what_the_library_finds(refined, folder):
    out, _ = refined
    held = json.loads((out / "refinement.json").read_text())
    flights = [read_recording(folder / "flights" / f"{name}.csv") for name in ("m01", "m02")]
    found = refine(
        AeroModel.from_json(folder / "off.json"), CITATION.aircraft, flights, free=FREE.split(","),
        outputs=["alpha", "q", "theta", "az"], starts=["u", "w", "q", "theta"],
    )  # fmt: skip
    assert_allclose([p["value"] for p in held["parameters"]], found.values, rtol=1e-6, atol=1e-9)
    assert held["converged"] is True
    assert {p.name for p in (out / "plots").iterdir()} == {"m01.png", "m02.png", "history.png"}
    assert AeroModel.from_json(out / "model.json").recordings == ("m01", "m02")


def test_what_is_held_out_is_simulated_before_and_after(refined):
    held = json.loads((refined[0] / "refinement.json").read_text())["held_out"]
    before, after = (
        next(s for s in held[name]["pooled"] if (s["output"], s["kind"]) == ("q", "whole"))
        for name in ("before", "after")
    )
    assert before["r2"] < 0.9 < 0.98 < after["r2"]
    assert "after the refinement, on the validation recordings" in refined[1]


def test_a_search_that_did_not_converge_says_so_and_marks_the_best_it_writes(folder, aircraft, tmp_path):
    arguments = ("refine", folder / "off.json", *aircraft, "--recordings", folder / "flights", "--free", FREE)
    result = run(*arguments, "--iterations", 1, "--out", tmp_path / "out", "--no-plots")
    assert "NOT CONVERGED" in result.stdout
    assert "warning: NOT CONVERGED" in result.stderr
    assert "NOT CONVERGED" in AeroModel.from_json(tmp_path / "out" / "model.json")["Cm"].method
    assert json.loads((tmp_path / "out" / "refinement.json").read_text())["converged"] is False


def test_a_global_search_keeps_its_bounds_and_its_seed(folder, aircraft):
    one = ("--recordings", folder / "flights" / "m01.csv", "--outputs", "alpha,q")
    bounds = ("--bounds", "Cm:alpha=-2,0", "--bounds", "Cm:q_hat=-60,0", "--free", "Cm:alpha,Cm:q_hat")
    asked = ("--search", "global", "--seed", 3, "--generations", 5, "--json")
    first, again = (
        json.loads(run("refine", folder / "truth.json", *aircraft, *one, *bounds, *asked).stdout) for _ in range(2)
    )
    assert first["generations"] == again["generations"]
    assert len(first["generations"]) <= 6
    for p in first["parameters"]:
        assert p["low"] <= p["value"] <= p["high"]
    assert first["parameters"][0]["low"] == -2.0


def test_filter_error_and_frequencies_are_one_option_away(folder, aircraft):
    one = ("--recordings", folder / "flights" / "m01.csv", "--outputs", "alpha,q,az", "--free", "Cm:alpha")
    held = json.loads(run("refine", folder / "truth.json", *aircraft, *one, "--noise", "process", "--process", "w",
                          "--json").stdout)  # fmt: skip
    assert held["noise"] == "process"
    assert any(p["name"] == "process:w" for p in held["parameters"])
    result = run("refine", folder / "truth.json", *aircraft, *one, "--domain", "frequency", "--band", "0.1,2", code=1)
    assert "linear" in stated(result)
    assert "LOW,HIGH" in stated(run("refine", folder / "truth.json", *aircraft, *one, "--band", "2", code=2))


def test_inputs_that_show_nothing_name_the_parameters_and_the_rest_is_written(folder, aircraft, tmp_path):
    outputs = {name: np.zeros(100) for name in ("u", "w", "q", "theta")}
    quiet = Recording("quiet", 0.04 * np.arange(100), {"de": np.zeros(100), **outputs})
    write_recording(quiet, tmp_path / "quiet.csv")
    arguments = ("refine", "builtin:hawk:longitudinal", "--recordings", tmp_path / "quiet.csv", "--free", "mq,mde")
    result = run(*arguments, "--out", tmp_path / "out", "--no-plots", code=1)
    assert "cannot determine mq, mde" in stated(result)
    assert "rank-deficient" in stated(result)
    held = json.loads((tmp_path / "out" / "refinement.json").read_text())
    assert [p["name"] for p in held["parameters"]] == ["mq", "mde"]
    assert "cannot determine" in held["error"]


def test_a_delay_longer_than_the_record_is_refused_with_the_remedy(folder, aircraft):
    arguments = ("--recordings", folder / "flights", "--free", FREE, "--delay", "all", "--bounds", "delay=0,20")
    result = run("refine", folder / "truth.json", *aircraft, *arguments, code=1)
    assert "they would never act" in stated(result)
    assert "--bounds delay=0,..." in stated(result)


def test_a_start_that_diverges_is_refused_with_a_remedy(folder, aircraft):
    arguments = ("--recordings", folder / "flights", "--free", FREE)
    result = run("refine", folder / "wild.json", *aircraft, *arguments, code=1)
    assert "cannot simulate 'wild' with its start values" in stated(result)
    assert "--search global" in stated(result)
    assert "NOT CONVERGED" in result.stdout


@pytest.mark.parametrize(
    ("options", "says", "code"),
    [
        (("--bounds", "Cm:alpha=-1"), "LOW,HIGH", 2),
        (("--guess", "Cm:alpha"), "NAME=NUMBER", 2),
        (("--free", "Cm:alfa"), "'Cm:alfa'", 1),
        (("--outputs", "qq"), "no output 'qq'", 1),
        (("--held-out", "m09"), "names 'm09'", 1),
    ],
)
def test_refine_names_what_it_cannot_use(folder, aircraft, options, says, code):
    result = run("refine", folder / "truth.json", *aircraft, "--recordings", folder / "flights", *options, code=code)
    assert says in stated(result)


def test_refine_needs_recordings_and_a_model_with_parameters(folder, aircraft):
    assert "needs --recordings" in stated(run("refine", folder / "truth.json", *aircraft, code=2))
    pytest.importorskip("jsbsim")
    arguments = ("--recordings", folder / "flights")
    assert "no parameters to refine" in stated(run("refine", "jsbsim:c172p", *arguments, code=2))


# --- validate --replay ------------------------------------------------------------------------------


def test_replay_scores_every_output_and_writes_table_and_plots(folder, aircraft, tmp_path):
    out = tmp_path / "out"
    flights = [folder / "flights" / f"{name}.csv" for name in ("m01", "m02")]
    asked = ("--replay", "--outputs", "alpha,q", "--out", out)
    result = run("validate", folder / "truth.json", *flights, *aircraft, *asked)
    held = json.loads((out / "replay.json").read_text())
    assert held["schema"] == "structsel.replay/1"
    pooled = {(s["output"], s["kind"]): s for s in held["pooled"]}
    assert pooled["q", "windows"]["r2"] > 0.98
    row = re.findall(r"^q +(\S+) +\S+ +\S+ +(\d+) %", result.stdout, re.MULTILINE)[-1]
    assert float(row[0]) == pytest.approx(pooled["q", "windows"]["r2"], abs=1e-4)
    assert {p.stem for p in (out / "plots").iterdir()} == {"m01", "m02"}
    assert len(pd.read_csv(out / "replay.csv")) == len(held["scores"]) + len(held["pooled"])
    assert max(map(len, result.stdout.splitlines()[:-1])) <= 80


def test_replay_states_where_a_simulation_diverges_instead_of_failing(folder, aircraft):
    result = run("validate", folder / "wild.json", folder / "flights" / "m01.csv", *aircraft, "--replay")
    said = " ".join(result.stdout.split())
    assert re.search(r"'m01', simulated as a whole, diverges at t = [\d.]+ s", said)
    assert "more of its windows diverge" in said
    held = json.loads(run("validate", folder / "wild.json", folder / "flights" / "m01.csv", *aircraft, "--replay",
                          "--json").stdout)  # fmt: skip
    assert held["departures"][0]["kind"] == "whole"


def test_replay_options_need_replay_and_an_aircraft(folder, aircraft):
    flights = folder / "flights"
    assert "needs --aircraft" in stated(run("validate", folder / "truth.json", flights, "--replay", code=2))
    assert "need --replay" in stated(run("validate", folder / "truth.json", flights, "--out", "x", code=2))
    arguments = (folder / "truth.json", flights, *aircraft, "--replay")
    assert "do not apply" in stated(run("validate", *arguments, "--responses", "Cm", code=2))
    assert "no output 'Cm'" in stated(run("validate", *arguments, "--outputs", "Cm", code=1))
