"""python -m proof: what it prints, writes and refuses."""

import json
import sys
from types import SimpleNamespace

import pytest

from proof import EffectKey, Key
from proof import run as campaign
from proof.__main__ import main

KEY = Key(
    verdicts=("mismatch",),
    form="forced",
    severity="easy",
    attainable={"CX": 0.4},
    effects=(EffectKey(effect="icing", accept=("icing",), kinds=("static",), axes=("CX",)),),
    source="polynomial/hawk",
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
    monkeypatch.setattr(campaign, "PROGRAM", (sys.executable, str(script)))


@pytest.fixture
def run(capsys):
    def call(*arguments, code=0):
        try:
            ended = main([*map(str, arguments)])
        except SystemExit as stopped:
            ended = stopped.code
        said = capsys.readouterr()
        assert ended == code, said
        return SimpleNamespace(stdout=said.out, stderr=said.err)

    return call


def test_the_tables_are_printed_and_written_with_the_command(run, tmp_path):
    out = tmp_path / "proof"
    done = run("--cases", 2, "--seed", 12, "--sources", "polynomial", "--baselines", "--out", out)
    written = (out / "proof.md").read_text()
    assert written in done.stdout
    assert f"python -m proof --cases 2 --seed 12 --sources polynomial --baselines --out {out}" in written
    assert "1 case, seeds 12 to 13, of development; truth by polynomial/hawk" in written
    assert "1 case could not be drawn" in written
    for line in written.splitlines():
        if line.startswith("| right effect first "):
            assert "100.0 %" in line
        if line.startswith("| above largest correlation"):
            assert "+100 points" in line
            assert "reached" in line
    assert "1 of 2 cases done" in done.stderr


def test_json_is_the_proof_and_nothing_else(run, tmp_path):
    done = run("--cases", "single=1,null=1", "--sources", "polynomial", "--out", tmp_path / "p", "--json")
    stated = json.loads(done.stdout)
    assert stated == json.loads((tmp_path / "p" / "proof.json").read_text())
    assert stated["schema"] == "structsel.proof/1"
    assert stated["judged"] is False
    assert [c["name"] for c in stated["cases"]] == ["polynomial-0000000", "polynomial-0000001"]
    figure = next(f for f in stated["figures"] if f["name"] == "held-out gain over the attainable, median")
    assert (figure["value"], figure["met"]) == (1.0, True)  # 1 - 0.3/0.5 of 0.4


def test_what_is_done_so_far_is_scored_and_nothing_else_begun(run, tmp_path):
    out = tmp_path / "p"
    run("--cases", 2, "--sources", "polynomial", "--out", out)
    stated = json.loads(run("--cases", 5, "--sources", "polynomial", "--out", out, "--done", "--json").stdout)
    assert [c["name"] for c in stated["cases"]] == ["polynomial-0000000", "polynomial-0000001"]
    assert "so far: 2 of the 5 requested cases are done" in (out / "proof.md").read_text()
    assert len(list((out / "cases").iterdir())) == 2
    assert "holds no answer" in run("--cases", 2, "--seed", 50, "--out", out, "--done", code=1).stderr
    assert "holds no answer" in run("--cases", 2, "--out", tmp_path / "nowhere", "--done", code=1).stderr
    assert not (tmp_path / "nowhere").exists()


def test_judged_cases_begin_with_their_own_seeds(run, tmp_path):
    run("--cases", 1, "--judged", "--sources", "polynomial", "--out", tmp_path / "p")
    assert (tmp_path / "p" / "cases" / "polynomial-1000000").is_dir()
    assert "for evaluation" in (tmp_path / "p" / "proof.md").read_text()
    assert (
        "choose judged"
        in run("--cases", 1, "--seed", 1000000, "--sources", "polynomial", "--out", tmp_path, code=1).stderr
    )


def test_without_truth_draws_singles_and_takes_their_hypotheses_out(run, tmp_path):
    run("--cases", 1, "--without-truth", "--sources", "polynomial", "--out", tmp_path / "p")
    (asked,) = json.loads((tmp_path / "p" / "plan.json").read_text()).values()
    assert (asked["family"], asked["without_truth"]) == ("single", True)


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (["--cases", "many"], 2, "--cases is a number"),
        (["--cases", "0"], 2, "--cases is a number"),
        (["--cases", "single=3", "--family", "null"], 2, "names families already"),
        (["--severity", "odd"], 2, "invalid choice: 'odd'"),
        (["--family", "odd"], 1, "no family 'odd'"),
        (["--sources", "mine"], 1, "no source 'mine'"),
    ],
)
def test_what_cannot_be_asked_is_refused_and_nothing_is_written(run, tmp_path, arguments, code, says):
    out = tmp_path / "p"
    done = run(*arguments, "--out", out, code=code)
    assert says in " ".join(done.stderr.split())
    assert not out.exists()


def test_without_jsbsim_the_polynomial_plant_is_used_and_it_is_said(run, tmp_path, monkeypatch):
    monkeypatch.setattr("proof.__main__.find_spec", lambda name: None)
    monkeypatch.setattr(campaign, "find_spec", lambda name: None)
    done = run("--cases", 2, "--out", tmp_path / "p")
    assert "JSBSim is not installed: all cases are of the polynomial plant." in done.stderr
    assert set(json.loads((tmp_path / "p" / "plan.json").read_text())) == {"polynomial-0000000", "polynomial-0000001"}
    assert "pip install" in run("--sources", "jsbsim", "--out", tmp_path / "q", code=1).stderr
