"""structsel prove: what it prints, writes and refuses."""

import json
import sys

import pytest
from typer.testing import CliRunner

from structsel.cli import app
from structsel.proving import EffectKey, Key, running

KEY = Key(
    verdicts=("mismatch",),
    form="forced",
    severity="easy",
    attainable={"CX": 0.4},
    effects=(EffectKey(effect="icing", accept=("icing",), kinds=("static",), axes=("CX",)),),
    source="own/hawk",
)
FAKE = """
import json, sys
from pathlib import Path
if sys.argv[1] == "draw":
    asked, place = json.loads(sys.argv[2]), Path(sys.argv[3])
    if asked["seed"] % 10 == 3:
        print(json.dumps({{"undrawn": "cannot be flown"}})); sys.exit()
    (place / "case" / asked["name"]).mkdir(parents=True)
    (place / "key").mkdir()
    (place / "key" / (asked["name"] + ".json")).write_text({key!r})
    print("{{}}")
else:
    finding = {{
        "axes": ["CX"], "kind": "static", "where": {{}}, "ambiguous_with": [],
        "physics": [{{"effect": "icing", "probability": 0.9, "parameters": {{}}}}],
        "fit": {{"held_out": {{
            "before": {{"CX": {{"rrmse": 0.5}}}}, "refitted": {{"CX": {{"rrmse": float("nan")}}}},
            "after": {{"CX": {{"rrmse": 0.3}}}},
        }}}},
    }}
    answer = {{"diagnosis": {{"verdict": "mismatch", "findings": [finding]}}, "spans": {{}}, "seconds": 2.0}}
    if "simple" in sys.argv:
        answer["simple"] = {{"largest correlation": ["gust"]}}
    print(json.dumps(answer))
"""


@pytest.fixture(autouse=True)
def fake(tmp_path, monkeypatch):
    """Cases that are all alike, and a diagnosis that knows them."""
    script = tmp_path / "fake.py"
    script.write_text(FAKE.format(key=KEY.model_dump_json()))
    monkeypatch.setattr(running, "PROGRAM", (sys.executable, str(script)))


def run(*arguments, code=0):
    result = CliRunner().invoke(app, ["prove", *map(str, arguments)], env={"COLUMNS": "80", "NO_COLOR": "1"})
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert result.exit_code == code, result.output
    return result


def test_the_tables_are_printed_and_written_with_the_command(tmp_path):
    out = tmp_path / "proof"
    done = run("--cases", 2, "--seed", 12, "--sources", "own", "--baselines", "--out", out)
    written = (out / "proof.md").read_text()
    assert written in done.stdout
    assert f"structsel prove --cases 2 --seed 12 --sources own --baselines --out {out}" in written
    assert "1 case, seeds 12 to 13, of development; flown by own/hawk" in written
    assert "1 case could not be drawn" in written
    for line in written.splitlines():
        if line.startswith("| right effect first "):
            assert "100.0 %" in line
        if line.startswith("| above largest correlation"):
            assert "+100 points" in line
            assert "reached" in line
    assert "1 of 2 cases done" in done.stderr


def test_json_is_the_proof_and_nothing_else(tmp_path):
    done = run("--cases", "single=1,null=1", "--sources", "own", "--out", tmp_path / "p", "--json")
    told = json.loads(done.stdout)
    assert told == json.loads((tmp_path / "p" / "proof.json").read_text())
    assert told["schema"] == "structsel.proof/1"
    assert told["judged"] is False
    assert [c["name"] for c in told["cases"]] == ["own-0000000", "own-0000001"]
    figure = next(f for f in told["figures"] if f["name"] == "held-out gain over the attainable, median")
    assert (figure["value"], figure["met"]) == (1.0, True)  # 1 - 0.3/0.5 of 0.4


def test_what_is_done_so_far_is_scored_and_nothing_else_begun(tmp_path):
    out = tmp_path / "p"
    run("--cases", 2, "--sources", "own", "--out", out)
    told = json.loads(run("--cases", 5, "--sources", "own", "--out", out, "--done", "--json").stdout)
    assert [c["name"] for c in told["cases"]] == ["own-0000000", "own-0000001"]
    assert "so far: 2 of the 5 cases asked for are done" in (out / "proof.md").read_text()
    assert len(list((out / "cases").iterdir())) == 2
    assert "holds no answer" in run("--cases", 2, "--seed", 50, "--out", out, "--done", code=1).stderr
    assert "holds no answer" in run("--cases", 2, "--out", tmp_path / "nowhere", "--done", code=1).stderr
    assert not (tmp_path / "nowhere").exists()


def test_judged_cases_begin_with_their_own_seeds(tmp_path):
    run("--cases", 1, "--judged", "--sources", "own", "--out", tmp_path / "p")
    assert (tmp_path / "p" / "cases" / "own-1000000").is_dir()
    assert "kept to judge" in (tmp_path / "p" / "proof.md").read_text()
    assert "as judged" in run("--cases", 1, "--seed", 1000000, "--sources", "own", "--out", tmp_path, code=1).stderr


def test_without_truth_draws_singles_and_takes_their_hypotheses_out(tmp_path):
    run("--cases", 1, "--without-truth", "--sources", "own", "--out", tmp_path / "p")
    (asked,) = json.loads((tmp_path / "p" / "plan.json").read_text()).values()
    assert (asked["family"], asked["without_truth"]) == ("single", True)


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (["--cases", "many"], 2, "--cases is a number"),
        (["--cases", "0"], 2, "--cases is a number"),
        (["--cases", "single=3", "--family", "null"], 2, "names families already"),
        (["--severity", "odd"], 2, "easy, medium or hard"),
        (["--family", "odd"], 1, "no family 'odd'"),
        (["--sources", "mine"], 1, "no source 'mine'"),
    ],
)
def test_what_cannot_be_asked_is_refused_and_nothing_is_written(tmp_path, arguments, code, says):
    out = tmp_path / "p"
    done = run(*arguments, "--out", out, code=code)
    assert says in " ".join(done.stderr.replace("│", " ").split())
    assert not out.exists()


def test_without_jsbsim_our_own_models_fly_and_it_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr("structsel.cli.prove.find_spec", lambda name: None)
    monkeypatch.setattr(running, "find_spec", lambda name: None)
    done = run("--cases", 2, "--out", tmp_path / "p")
    assert "JSBSim is not installed: all cases are flown by our own models." in done.stderr
    assert set(json.loads((tmp_path / "p" / "plan.json").read_text())) == {"own-0000000", "own-0000001"}
    assert "pip install" in run("--sources", "jsbsim", "--out", tmp_path / "q", code=1).stderr
