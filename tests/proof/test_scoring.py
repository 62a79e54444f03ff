"""Scores of diagnoses, on diagnoses and keys written by hand."""

import json
import math
import os
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from proof import run as campaign
from proof.baselines import name_simply
from proof.generate import drawable
from proof.keys import EffectKey, Key
from proof.parameter_names import sizes_put_in
from proof.score import CaseScore, Claim, Sized, overlap, score_case
from proof.summary import reliability, summarise
from proof.tables import page, table
from structsel.diagnosis import EffectSignature
from structsel.effects import EFFECTS
from structsel.errors import DataError
from structsel.numerics.fourier_series import spectrum


def an_effect(name="ground-effect", **more):
    held = {"accept": (name,), "tie": ("wind-shear",), "kinds": ("static",), "axes": ("CZ", "CX")}
    return EffectKey(effect=name, **{**held, **more})


def a_key(*effects, family="single", **more):
    held = {"verdicts": ("mismatch",), "form": "forced", "severity": "easy", "attainable": {"CZ": 0.5, "CX": 0.3}}
    return Key(effects=effects, family=family, source="polynomial/hawk", **{**held, **more})


def a_finding(effect="ground-effect", p=0.9, **more):
    fit = {
        "before": {"CZ": {"rrmse": 0.4}, "CX": {"rrmse": 0.2}},
        "refitted": {"CZ": {"rrmse": 0.35}, "CX": {"rrmse": 0.2}},
        "after": {"CZ": {"rrmse": 0.2}, "CX": {"rrmse": 0.17}},
    }
    others = more.pop("others", [])
    return {
        "axes": ["CZ", "Cm"], "kind": "static", "where": {},
        "physics": [{"effect": effect, "probability": p, "parameters": more.pop("parameters", {})}]
        + [{"effect": o, "probability": 0.01} for o in others],
        "ambiguous_with": [], "fit": {"held_out": fit}, **more,
    }  # fmt: skip


def said(*findings, verdict="mismatch"):
    return {"verdict": verdict, "findings": list(findings)}


def test_the_right_name_first_is_right_by_every_measure():
    score = score_case("a", said(a_finding()), a_key(an_effect()))
    assert (score.top1, score.tie, score.top3, score.kind, score.axis, score.verdict) == (True,) * 6
    assert score.axes == 1.0 / 3.0  # CZ of CZ, Cm and CX
    assert score.claims == (Claim("ground-effect", 0.9, True),)
    assert score.truth == score.named == "ground-effect"


def test_another_name_that_the_key_accepts_is_right():
    key = a_key(an_effect(accept=("ground-effect", "icing")))
    assert score_case("a", said(a_finding("icing")), key).top1


@pytest.mark.parametrize(
    ("first", "similar", "counts"),
    [
        ("wind-shear", ["ground-effect"], True),  # similar, allowed by the key, the right one an alternative
        ("wind-shear", [], False),  # the similar effect alone
        ("icing", ["ground-effect"], False),  # not a similar effect by the key
        ("ground-effect", ["wind-shear"], True),
    ],
)
def test_a_tie_counts_where_the_key_allows_it_and_the_right_name_is_declared(first, similar, counts):
    score = score_case("a", said(a_finding(first, ambiguous_with=similar)), a_key(an_effect()))
    assert score.tie is counts
    assert score.top1 is (first == "ground-effect")


def test_three_names_are_those_of_the_first_finding_likeliest_first():
    key = a_key(an_effect())
    assert score_case("a", said(a_finding("icing", others=["slosh", "ground-effect"])), key).top3
    assert not score_case("a", said(a_finding("icing", others=["slosh", "gust", "ground-effect"])), key).top3
    assert not score_case("a", said(a_finding("icing"), a_finding("ground-effect")), key).top3


def test_no_answer_is_wrong_in_every_figure():
    score = score_case("a", None, a_key(an_effect(intervals={"m01": [(1.0, 2.0)]})))
    assert (score.top1, score.tie, score.top3, score.kind, score.axis, score.verdict) == (False,) * 6
    assert (score.named, score.iou, score.gain, score.claims) == ("no answer", 0.0, 0.0, ())


def test_either_of_a_pair_may_come_first_and_both_count_in_any_order():
    pair = a_key(an_effect(), an_effect("slosh", axes=("CY",)), family="pair")
    both = score_case("a", said(a_finding("slosh"), a_finding("ground-effect")), pair)
    one = score_case("a", said(a_finding("slosh"), a_finding("icing")), pair)
    assert (both.top1, both.both, one.top1, one.both) == (True, True, True, False)
    assert [c.right for c in one.claims] == [True, False]


def test_among_clutter_only_the_main_effect_may_come_first():
    key = a_key(an_effect(), an_effect("slosh", axes=("CY",)), family="clutter")
    score = score_case("a", said(a_finding("slosh")), key)
    assert score.top1 is False
    assert score.claims[0].right  # it is there


@pytest.mark.parametrize(
    ("answer", "alarm"),
    [
        (said(verdict="consistent"), False),
        (said(verdict="undecidable"), False),
        (said(a_finding("turbulence"), verdict="consistent"), False),
        (said(a_finding("icing")), True),
        (said(a_finding("icing"), verdict="consistent"), True),
        (said(verdict="mismatch"), True),
    ],
)
def test_a_null_is_alarmed_by_a_mismatch_or_by_anything_named_but_turbulence(answer, alarm):
    key = a_key(family="null", verdicts=("consistent",), severity="none")
    assert score_case("a", answer, key).alarm is alarm


@pytest.mark.parametrize(
    ("answer", "claimed"),
    [
        (said(a_finding("icing")), True),
        (said(a_finding("unknown")), False),
        (said(a_finding("icing", ambiguous_with=["unknown"])), False),
        (said(verdict="consistent"), False),
        (said(a_finding("icing"), verdict="undecidable"), False),
    ],
)
def test_outside_the_library_a_name_without_warning_is_a_claim(answer, claimed):
    outside = a_key(an_effect("unknown", tie=()), family="outside")
    assert score_case("a", answer, outside).claimed is claimed
    # The same where the hypothesis was taken out: nothing said there counts towards the probabilities.
    without = score_case("a", answer, a_key(an_effect()), without_truth=True)
    assert (without.claimed, without.family, without.claims, without.top1) == (claimed, "without", (), None)


def test_overlap_is_seconds_shared_over_seconds_covered():
    assert_allclose(overlap({"m01": [[0, 4]]}, {"m01": [[2, 6]]}), 2.0 / 6.0)
    assert_allclose(
        overlap({"m01": [[0, 2], [1, 4]]}, {"m01": [[0, 4]], "m02": [[0, 4]]}), 0.5
    )  # stated twice counts once
    assert overlap({}, {"m01": []}) == 1.0
    assert overlap({"m01": [[0, 1]]}, {}) == 0.0


def test_a_finding_without_intervals_covers_the_complete_of_every_recording():
    key = a_key(an_effect(intervals={"m01": [(2.0, 4.0)], "m02": []}))
    spans = {"m01": [0.0, 10.0], "m02": [0.0, 10.0]}
    assert_allclose(score_case("a", said(a_finding()), key, spans).iou, 0.1)
    exact = a_finding(where={"intervals": {"m01": [[2.0, 4.0]]}})
    assert score_case("a", said(exact), key, spans).iou == 1.0
    assert score_case("a", said(exact), a_key(an_effect())).iou is None  # acts all the time


def test_place_is_that_of_the_finding_that_names_the_effect():
    key = a_key(an_effect(intervals={"m01": [(2.0, 4.0)]}))
    other = a_finding("slosh", kind="inertial", axes=["CY"], where={"intervals": {"m01": [[7.0, 9.0]]}})
    right = a_finding(where={"intervals": {"m01": [[2.0, 4.0]]}})
    score = score_case("a", said(other, right), key)
    assert (score.top1, score.kind, score.axis, score.iou) == (False, True, True, 1.0)


def test_gain_is_the_fall_of_held_out_error_over_the_attainable():
    # CZ falls by 1 - 0.2/0.4 = 0.5 of 0.5, CX by 1 - 0.17/0.2 = 0.15 of 0.3: 0.65 of 0.8.
    assert_allclose(score_case("a", said(a_finding()), a_key(an_effect())).gain, 0.65 / 0.8)
    assert score_case("a", said(), a_key(an_effect())).gain == 0.0
    assert score_case("a", said(a_finding()), a_key(an_effect(), attainable={"CZ": 0.01})).gain is None


def test_the_last_finding_tells_the_gain_of_all():
    fit = {w: {c: {"rrmse": x} for c in ("CZ", "CX")} for w, x in (("before", 0.4), ("refitted", 0.4), ("after", 0.1))}
    score = score_case("a", said(a_finding(), a_finding("icing", fit={"held_out": fit})), a_key(an_effect()))
    assert_allclose(score.gain, 1.5 / 0.8)


def test_gain_beyond_a_refit_is_stated_from_a_loss():
    better = score_case("a", said(a_finding()), a_key(an_effect()))  # of CZ only: nothing is stated of Cm
    assert_allclose(better.beyond, 1.0 - 0.2 / 0.35)
    fit = {"held_out": {"before": {}, "refitted": {"CZ": {"rrmse": 0.3}}, "after": {"CZ": {"rrmse": 0.33}}}}
    worse = score_case("a", said(a_finding(fit=fit)), a_key(an_effect()))
    assert_allclose(worse.beyond, -0.1)
    assert summarise([better, worse])["worse than a refit"].value == 0.5


def test_parameters_are_compared_in_size_where_names_correspond():
    effect = an_effect("sensor-scale", parameters={"channel": "alpha", "scale": 0.96})
    stated = {"scale": {"value": -0.042, "std": 0.001, "unit": "-"}, "other": {"value": 3.0, "std": 1.0, "unit": ""}}
    (one,) = score_case("a", said(a_finding("sensor-scale", parameters=stated)), a_key(effect)).sizes
    assert (one.effect, one.name, one.inside) == ("sensor-scale", "scale", False)  # 2 standard deviations off
    assert_allclose(one.error, 0.05, rtol=1e-9)
    stated["scale"]["std"] = 0.002
    assert score_case("a", said(a_finding("sensor-scale", parameters=stated)), a_key(effect)).sizes[0].inside


@pytest.mark.parametrize(
    ("effect", "held", "found"),
    [
        ("mass-error", {"stated over true": 0.8}, {"fraction": 0.25}),
        ("mass-error", {"factor": 0.95}, {"fraction": 0.05}),
        ("inertia-error", {"moment": "Ix", "stated over true": 0.8}, {"Ix": 0.25}),
        ("augmentation", {"surface": "dr", "gain": 0.1, "rate": "r"}, {"gain of r": 0.1}),
        ("slosh", {"slosh_frequency": 2.0 * math.pi}, {"frequency": 1.0}),
        ("sensor-misalignment", {"channel": "ay", "of": "az", "angle": -0.02}, {"about x": 0.02}),
        ("sensor-misalignment", {"channels": "r, p", "angle": 0.02}, {"about y": 0.02}),
        ("wrong-derivative", {"Cm:alpha": -0.2}, {"Cm_alpha": 0.2}),
        ("missing-term", {"CZ:alpha^2": 1.5}, {"CZ: alpha^2": 1.5}),
        ("actuator-saturation", {"channel": "de", "high": 0.1}, {"stop": 0.1}),
        ("actuator-saturation", {"channel": "de", "high": 0.1, "low": -0.2}, {}),
        ("turbulence", {"sigma": 0.3}, {}),
    ],
)
def test_sizes_put_in_are_given_as_a_diagnosis_gives_them(effect, held, found):
    assert_allclose(list(sizes_put_in(an_effect(effect, parameters=held)).values()), list(found.values()))
    assert list(sizes_put_in(an_effect(effect, parameters=held))) == list(found)


# --- many cases ------------------------------------------------------------------------------------------------------


def a_score(k=0, **more):
    held = {"family": "single", "severity": "easy", "truth": "icing", "named": "icing", "verdict": True}
    return CaseScore(name=f"c{k}", source="polynomial/hawk", form="forced", **{**held, **more})


def test_fractions_and_their_intervals_are_those_of_the_binomial():
    summary = summarise([a_score(k, top1=k < 9, tie=True, top3=True) for k in range(10)])
    first = summary["right effect first"]
    assert (first.value, first.of, first.met) == (0.9, 10, True)
    # Clopper and Pearson for 9 of 10 at 90 %: 0.6058 to 0.9949 (scipy.stats.binomtest).
    assert_allclose(first.limits, (0.6058, 0.9949), atol=1e-4)


def test_brier_and_calibration_of_claims_made_by_hand():
    claims = (Claim("icing", 0.9, True), Claim("gust", 0.8, False), Claim("slosh", 0.3, False))
    summary = summarise([a_score(claims=claims)])
    assert_allclose(summary["Brier score"].value, (0.01 + 0.64 + 0.09) / 3.0)
    assert_allclose(summary["expected calibration error"].value, (0.1 + 0.8 + 0.3) / 3.0)
    assert_allclose(summary["wrong among confidently named"].value, 0.5)
    assert [b.count for b in reliability(claims)] == [0, 0, 0, 1, 0, 0, 0, 0, 1, 1]


def test_claims_that_are_right_as_often_as_stated_are_calibrated():
    rng = np.random.default_rng(5)
    p = rng.uniform(0.0, 1.0, 20000)
    claims = tuple(Claim("icing", float(x), bool(rng.random() < x)) for x in p)
    summary = summarise([a_score(claims=claims)])
    assert summary["expected calibration error"].value < 0.02
    assert_allclose(summary["Brier score"].value, 1.0 / 6.0, atol=0.01)  # the mean of p (1 - p)
    assert reliability((Claim("icing", 1.0, True),))[9].count == 1


def test_unknown_is_not_a_confident_name():
    summary = summarise([a_score(claims=(Claim("unknown", 0.95, False),))])
    assert summary["wrong among confidently named"].of == 0


def test_each_figure_counts_the_cases_that_speak_of_it():
    sizes = (Sized("icing", "drag", 0.02, True), Sized("icing", "lift", 0.06, None))
    scores = [
        a_score(0, top1=True, sizes=sizes, gain=0.9),
        a_score(1, family="null", truth="nothing", named="nothing", alarm=False),
        a_score(2, family="null", truth="nothing", named="icing", alarm=True),
        a_score(3, family="outside", truth="unknown", named="unknown", claimed=False),
        a_score(4, family="without", claimed=True),
        a_score(5, family="pair", both=False, top1=True),
        a_score(6, family="pair", both=True, top1=True, each_decided=True),
    ]
    summary = summarise(scores)
    counted = {f.name: (f.value, f.of) for f in summary.figures}
    assert counted["right effect first"] == (1.0, 3)
    assert counted["false alarms on nulls"] == (0.5, 2)
    assert counted["outside the library, named"] == (0.0, 1)
    assert counted["without the true hypothesis, named"] == (1.0, 1)
    assert counted["both of a pair"] == (0.5, 2)
    assert counted["both of a pair, where the data decide each"] == (1.0, 1)
    assert counted["error of parameters, median"] == (0.04, 2)
    assert counted["truth within 90 % intervals"] == (1.0, 1)
    assert summary["truth within 90 % intervals"].met is False  # too wide is missed as well
    assert summary.confusion == {
        "icing": {"icing": 1},
        "nothing": {"nothing": 1, "icing": 1},
        "unknown": {"unknown": 1},
    }


def test_the_lead_over_a_simple_method_is_taken_on_the_same_cases():
    simple = {"largest correlation": (False, True)}
    scores = [a_score(0, top1=True, simple=simple), a_score(1, top1=False, simple=simple), a_score(2, top1=False)]
    summary = summarise(scores)
    assert summary["above largest correlation"].value == 0.5
    assert summary["above largest correlation"].of == 2
    assert summary["largest correlation: right effect among three"].value == 1.0


def test_the_page_holds_every_figure_and_its_columns_line_up():
    text = page(summarise([a_score(top1=True, claims=(Claim("icing", 0.9, True),))]), ["a line"])
    for words in ("right effect first", "Brier score", "| icing", "- a line", "## What was named first"):
        assert words in text
    lines = table(["a", "b"], [["one", "1"], ["three", "22"]]).splitlines()
    assert lines == ["| a     |  b |", "| ----- | -: |", "| one   |  1 |", "| three | 22 |"]


# --- simple ways -----------------------------------------------------------------------------------------------------


def a_comparison(difference, **columns):
    """As much of a comparison as simple methods use: one recording at 25 Hz."""

    def transformed(held):
        return {c: spectrum(x, 8 * len(x) // 25, 25) for c, x in held.items()}

    signatures = [
        EffectSignature(effect, "", ("size",) * next(iter(held.values())).shape[1], (transformed(held),))
        for effect, held in columns.items()
    ]
    return SimpleNamespace(responses=("CZ", "Cm"), transformed=(transformed(difference),), signatures=tuple(signatures))


def test_simple_methods_name_what_their_rules_say():
    rng = np.random.default_rng(2)
    t = 0.04 * np.arange(750)
    a, b, c = np.sin(0.9 * t), np.sin(1.7 * t + 1.0), np.cos(2.9 * t)
    # CZ is a and b alike, Cm is c and a little noise: one column is all of Cm, two are all of CZ.
    compared = a_comparison(
        {"CZ": a + b, "Cm": c + 0.3 * rng.standard_normal(len(t))},
        icing={"CZ": np.column_stack([a, b])},
        gust={"CZ": a[:, None]},
        slosh={"Cm": c[:, None]},
        asymmetry={"CZ": rng.standard_normal((len(t), 1))},
    )
    named = name_simply(compared)
    assert named["largest single fit"] == ["icing", "slosh", "gust", "asymmetry"]
    assert named["largest correlation"][0] == "slosh"
    assert set(named["stepwise and BIC"]) in ({"icing", "slosh"}, {"icing", "slosh", "gust"})
    assert "asymmetry" not in named["stepwise and BIC"]


def test_simple_methods_have_nothing_to_say_without_a_library_or_a_difference():
    nothing = {"CZ": np.zeros(200), "Cm": np.zeros(200)}
    assert set(map(tuple, name_simply(a_comparison(nothing)).values())) == {()}
    column = np.sin(0.1 * np.arange(200.0))[:, None]
    assert set(map(tuple, name_simply(a_comparison(nothing, icing={"CZ": column})).values())) == {()}


# --- campaigns -------------------------------------------------------------------------------------------------------

FAKE = """
import json, os, sys
from pathlib import Path
task = sys.argv[1]
log = Path({log!r})
if task == "draw":
    asked = json.loads(sys.argv[2])
    place = Path(sys.argv[3])
    if asked["seed"] == 3:
        print(json.dumps({{"undrawn": "cannot be flown"}})); sys.exit()
    (place / "case" / asked["name"]).mkdir(parents=True)
    (place / "case" / asked["name"] / "aircraft.toml").write_text("name = 'x'")
    (place / "key").mkdir()
    (place / "key" / (asked["name"] + ".json")).write_text({key!r})
    print("{{}}"); sys.exit()
files = sorted(str(p) for p in Path(".").rglob("*"))
seen = dict(argv=sys.argv[1:], cwd=os.getcwd(), files=files, env=dict(os.environ))
seen["cores"] = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
with log.open("a") as f:
    f.write(json.dumps(seen) + "\\n")
if {crash}:
    sys.exit("broke down")
print("something said by the way")
answer = {{"diagnosis": {{"verdict": "consistent", "findings": []}}, "spans": {{}}, "seconds": 1.0}}
if "simple" in sys.argv:
    answer["simple"] = {{"largest correlation": ["icing"]}}
print(json.dumps(answer))
"""


@pytest.fixture
def fake(tmp_path):
    """A program that draws, diagnoses and notes its arguments; the notes."""
    log = tmp_path / "log"

    def make(crash=False, effect=None):
        script = tmp_path / "fake.py"
        script.write_text(FAKE.format(log=str(log), key=a_key(effect or an_effect()).model_dump_json(), crash=crash))
        return sys.executable, str(script)

    make.notes = lambda: [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    return make


def test_who_diagnoses_is_stated_of_nothing_but_the_case(fake, tmp_path):
    out = tmp_path / "proof"
    draws = campaign.plan({"": 2}, 0, sources=["polynomial"])
    campaign.prove(draws, out, program=fake(), jobs=1, simple=True)
    notes = fake.notes()
    assert len(notes) == 2
    for note in notes:
        assert str(out) not in json.dumps(note)
        assert "polynomial-" not in json.dumps(note)  # the name would tell the seed, and the seed the key
        assert note["files"] == ["case", "case/aircraft.toml"]
        assert note["argv"][1] == "case"
    scores, undrawn = campaign.scores_of(draws, out)
    assert [(s.named, s.top1, s.simple) for s in scores] == [
        ("nothing", False, {"largest correlation": (False, False)})
    ] * 2
    assert not undrawn


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="this system does not report the cores of a process")
def test_each_case_runs_on_one_core_and_cases_use_all_of_them(fake, tmp_path):
    free = os.sched_getaffinity(0)
    draws = campaign.plan({"": 4}, 0, sources=["polynomial"])
    campaign.prove(draws, tmp_path / "proof", program=fake(), jobs=2)
    cores = [note["cores"] for note in fake.notes()]
    assert all(len(c) == 1 for c in cores)
    assert {c[0] for c in cores} <= free
    assert os.sched_getaffinity(0) == free


def test_a_run_broken_off_is_a_fair_sample_of_its_families():
    draws = campaign.plan({"single": 30, "null": 20, "pair": 10, "without": 5}, 0, sources=["polynomial"])
    ordered = campaign.in_turn(draws)
    assert sorted(d.seed for d in ordered) == [d.seed for d in draws]
    for part in (13, 26, 39):
        done = [(d.family, d.without_truth) for d in ordered[:part]]
        assert [done.count(f) for f in (("single", False), ("null", False), ("pair", False), ("single", True))] == [
            pytest.approx(part * n / 65, abs=1.0) for n in (30, 20, 10, 5)
        ]


def test_a_run_goes_on_where_it_stopped(fake, tmp_path):
    program, stated = fake(), []
    campaign.prove(campaign.plan({"": 2}, 0, sources=["polynomial"]), tmp_path, program=program)
    draws = campaign.plan({"": 5}, 0, sources=["polynomial"])
    campaign.prove(draws, tmp_path, program=program, progress=lambda *step: stated.append(step))
    assert len(fake.notes()) == 4  # the first two are not asked again, and one cannot be drawn
    assert stated[-1] == ("cases", 5, 5)
    campaign.prove(draws, tmp_path, program=program, again=True)
    assert len(fake.notes()) == 8
    scores, undrawn = campaign.scores_of(draws, tmp_path)
    assert len(scores) == 4
    assert undrawn == {"polynomial-0000003": "cannot be flown"}


def test_the_true_hypothesis_is_the_one_taken_out(fake, tmp_path):
    draws = campaign.plan({"without": 1}, 0, sources=["polynomial"])
    campaign.prove(draws, tmp_path, program=fake(effect=an_effect(accept=("ground-effect", "icing"))))
    assert fake.notes()[0]["argv"] == ["diagnose", "case", "ground-effect,icing"]
    assert campaign.scores_of(draws, tmp_path)[0][0].family == "without"


def test_a_process_that_breaks_down_or_takes_too_long_is_no_answer(fake, tmp_path):
    draws = campaign.plan({"": 1}, 0, sources=["polynomial"])
    campaign.prove(draws, tmp_path / "a", program=fake(crash=True))
    assert "broke down" in campaign.errors_of(draws, tmp_path / "a")["polynomial-0000000"]
    assert campaign.scores_of(draws, tmp_path / "a")[0][0].named == "no answer"
    campaign.prove(draws, tmp_path / "a", program=fake())  # it may have been stopped from outside: it is asked again
    assert not campaign.errors_of(draws, tmp_path / "a")
    slow = (sys.executable, "-c", "import time; time.sleep(20)")
    problem = campaign._Campaign(tmp_path, 0.2, slow, False, False)
    (tmp_path / "case").mkdir()
    assert problem._ask(tmp_path / "case", "diagnose") == {"error": "no answer within 0.2 s"}


def test_a_diagnosis_stands_though_asking_the_baselines_broke_down(fake, tmp_path):
    draws = campaign.plan({"": 1}, 0, sources=["polynomial"])
    campaign.prove(draws, tmp_path, program=fake())
    campaign.prove(draws, tmp_path, program=fake(crash=True), simple=True)
    assert len(fake.notes()) == 2
    assert not campaign.errors_of(draws, tmp_path)
    campaign.prove(draws, tmp_path, program=fake(), simple=True)  # and they are asked again
    assert "largest correlation" in campaign.scores_of(draws, tmp_path)[0][0].simple
    campaign.prove(draws, tmp_path, program=fake(crash=True), again=True)
    assert campaign.errors_of(draws, tmp_path)


def test_a_folder_whose_cases_were_drawn_otherwise_is_refused(fake, tmp_path):
    campaign.prove(campaign.plan({"": 1}, 0, sources=["polynomial"]), tmp_path, program=fake())
    with pytest.raises(DataError, match="polynomial-0000000 drawn otherwise"):
        campaign.prove(campaign.plan({"null": 1}, 0, sources=["polynomial"]), tmp_path, program=fake())


def test_a_folder_of_version_0_1_0_keeps_its_names(fake, tmp_path):
    former = [replace(d, source="own") for d in campaign.plan({"": 2}, 0, sources=["polynomial"])]
    campaign.prove(former, tmp_path, program=fake())
    draws = campaign.as_stored(campaign.plan({"": 2}, 0, sources=["polynomial"]), tmp_path)
    assert draws == former
    campaign.prove(draws, tmp_path, program=fake())
    assert len(fake.notes()) == 2  # nothing is drawn or diagnosed again
    assert [s.name for s in campaign.scores_of(draws, tmp_path)[0]] == ["own-0000000", "own-0000001"]
    assert campaign.as_stored(former[:0], tmp_path / "new") == []


def test_a_key_of_version_0_1_0_has_the_former_name_of_the_source(tmp_path):
    path = tmp_path / "key.json"
    path.write_text(a_key().model_dump_json().replace("polynomial/hawk", "own/hawk"), encoding="utf-8")
    assert Key.read(path).source == "polynomial/hawk"


def test_seeds_of_development_and_of_evaluation_are_separate():
    polynomial = {"sources": ["polynomial"]}
    with pytest.raises(DataError, match="kept for evaluation: choose judged"):
        campaign.plan({"": 1}, campaign.JUDGED, **polynomial)
    with pytest.raises(DataError, match="99999"):
        campaign.plan({"": 2}, 99_999, **polynomial)
    with pytest.raises(DataError, match="begin at 1000000"):
        campaign.plan({"": 1}, 5, judged=True, **polynomial)
    draws = campaign.plan({"single": 2, "null": 1}, campaign.JUDGED, judged=True, **polynomial)
    assert [(d.seed - campaign.JUDGED, d.family) for d in draws] == [(0, "single"), (1, "single"), (2, "null")]


@pytest.mark.parametrize(
    ("counts", "more", "says"),
    [
        ({"odd": 1}, {}, "no family 'odd'"),
        ({"": 1}, {"sources": ["mine"]}, "no source 'mine'"),
        ({"null": 1}, {"effects": ["icing"]}, "singles only"),
        ({"single": 1}, {"effects": ["magic"], "sources": ["polynomial"]}, "no case of 'magic'"),
    ],
)
def test_what_cannot_be_drawn_is_refused_before_any_work(counts, more, says):
    with pytest.raises(DataError, match=says):
        campaign.plan(counts, 0, **{"sources": ["polynomial"], **more})


def test_effects_and_sources_come_in_turn():
    pytest.importorskip("jsbsim")
    draws = campaign.plan({"single": 6}, 0, effects=["icing", "friction"])
    assert [(d.effect, d.source) for d in draws] == [
        ("icing", "polynomial"), ("icing", "jsbsim"), ("friction", "polynomial"), ("friction", "polynomial"),
        ("icing", "polynomial"), ("icing", "jsbsim"),
    ]  # fmt: skip


def test_every_effect_that_can_be_drawn_can_be_named():
    known = {h.name for h in EFFECTS} | {"turbulence"}
    assert drawable("polynomial") <= known
    assert drawable("jsbsim") <= known
