"""Refinement: what is held keeps its errors, and held-out recordings decide which model is kept."""

import json
import re

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from structsel import AeroModel, Recording, ResponseModel, export_model, published_aircraft, refine, resimulate
from structsel.errors import DataError
from structsel.inputs import three_two_one_one
from structsel.recording import write_recording
from structsel.refinement.held_out import HeldOutComparison, _paired
from structsel.refinement.nonlinear_flight import refine_response
from structsel.simulation import Instruments
from tests.commands import run
from tests.linear_flights import fly_by_solver, helicopter

CITATION = published_aircraft("citation")
TRIM = CITATION.trim()
TRUTH = CITATION.model["Cm"]
ERRORS = np.array([0.002, 0.05, 1.5, 0.09])  # of 1, alpha, q_hat and de
ROOT = np.array([[1.0, 0.0, 0.0, 0.0], [-0.6, 0.8, 0.0, 0.0], [0.1, 0.2, 0.9, 0.0], [0.3, 0.1, 0.1, 0.9]])
SPREAD = (ROOT @ ROOT.T) * np.outer(ERRORS, ERRORS)
OUTPUTS = ["alpha", "q", "theta", "az"]


def record(k, size=0.02, width=0.5, **changes):
    """A simulated recording of 12 s with noise, of the Citation with other values of Cm."""
    u = three_two_one_one("de", size, width, duration=12.0, dt=0.04)
    schedule = Recording(f"m{k:02d}", u.t, {"de": TRIM["de"] + u["de"]})
    noise = {"alpha": 0.001, "q": 0.001, "theta": 0.001, "az": 0.05}
    return CITATION.simulate(schedule, start=TRIM, instruments=Instruments(noise=noise, seed=k))


def model(**changes):
    """The Citation with other values of terms of Cm, and their covariance."""
    values = [changes.get(str(term), value) for term, value in zip(TRUTH.terms, TRUTH.values)]
    wide = 1.2 * np.sqrt(np.diag(SPREAD))  # as a selection widens them
    Cm = ResponseModel(TRUTH.terms, np.array(values), SPREAD, wide, method="stepwise", n=900, s2=1e-4, r2=0.97)
    return AeroModel({**CITATION.model.responses, "Cm": Cm}, "first", ("earlier",))


@pytest.fixture(scope="module")
def refined():
    """Two of four terms of Cm estimated from values that are off; two recordings held out."""
    return refine(
        model(alpha=-0.7, q_hat=-15.0), CITATION.aircraft, [record(1)], free=["Cm:alpha", "Cm:q_hat"], outputs=OUTPUTS,
        held_out=[record(2, -0.02), record(3, 0.015, 0.7)],
    )  # fmt: skip


# --- held parameters --------------------------------------------------------------------------------


def test_held_parameters_keep_value_error_and_covariance_and_nothing_joins_the_two_blocks(refined):
    before, after = refined.original["Cm"], refined.refined["Cm"]
    held, free = [0, 3], [1, 2]
    assert_array_equal(after.values[held], before.values[held])
    assert_array_equal(after.standard_errors[held], before.standard_errors[held])
    assert_array_equal(after.covariance[np.ix_(held, held)], before.covariance[np.ix_(held, held)])
    assert_array_equal(after.covariance[np.ix_(held, free)], np.zeros((2, 2)))
    rows = [refined.names.index(f"Cm:{term}") for term in ("alpha", "q_hat")]
    assert_array_equal(after.covariance[np.ix_(free, free)], refined.covariance[np.ix_(rows, rows)])
    assert_allclose(after.standard_errors[free], refined.std[rows], rtol=1e-12)
    assert [str(term) for term in after.held] == ["1", "de"]


def test_a_response_without_an_estimate_stays_as_it_is_with_all_its_terms_held(refined):
    before, after = refined.original["CZ"], refined.refined["CZ"]
    assert after.held == after.terms
    assert {**after.to_dict(), "held": None} == {**before.to_dict(), "held": None}
    assert refined.refined.recordings == ("earlier", "m01")


def test_held_parameters_are_labelled_in_report_frame_json_and_every_export(refined, tmp_path):
    frame = refined.to_frame().set_index("name")
    assert frame.loc["Cm:de", "kind"] == "held"
    assert frame.loc["Cm:de", "std"] == model()["Cm"].standard_errors[3]
    assert frame.loc["Cm:alpha", "kind"] == "model"
    assert re.search(r"^  Cm:de \(held\) +-1\.25 +0\.1", str(refined), re.MULTILINE)
    assert [row["name"] for row in refined.to_dict()["held"] if row["name"].startswith("Cm")] == ["Cm:1", "Cm:de"]
    refined.model.to_json(tmp_path / "model.json")
    again = AeroModel.from_json(tmp_path / "model.json")
    assert again == refined.model
    assert again["Cm"].held == refined.model["Cm"].held
    for target, label in {
        "python": "de: standard error 0.104 (held)", "c": "de: standard error 0.104 (held)",
        "modelica": "de: standard error 0.104 (held)", "latex": r"$\delta_e$\,(held) & $-1.25$ & $0.104$",
        "jsbsim": "de: standard error 0.104 (held)", "summary": "de (held)",
    }.items():  # fmt: skip
        text = export_model(again, tmp_path / f"{target}.xml", to=target, aircraft=CITATION.aircraft).read_text()
        assert label in text, target
        assert "Refinement: better on held-out recordings" in text[:400], target
    csv = pd.read_csv(export_model(again, tmp_path / "terms.csv", to="csv"), comment="#").set_index(
        ["response", "term"]
    )
    assert csv.loc[("Cm", "de"), "held"]
    assert not csv.loc[("Cm", "alpha"), "held"]
    assert np.isfinite(csv.loc[("Cm", "de"), "t"])


def test_where_a_block_is_not_known_there_is_no_covariance_and_no_error_is_zero():
    alone = ResponseModel(("1", "alpha"), [0.1, -0.5])
    made = refine_response(alone, {1: -0.6}, np.array([[0.04]]), "output error")
    assert made.covariance is None
    assert_array_equal(made.standard_errors, [np.nan, 0.2])
    complete = refine_response(alone, {0: 0.2, 1: -0.6}, np.diag([0.01, 0.04]), "output error")
    assert_array_equal(complete.covariance, np.diag([0.01, 0.04]))
    assert complete.held == ()


def test_a_second_refinement_holds_what_the_first_estimated(refined):
    again = refine(refined.refined, CITATION.aircraft, [record(4)], free=["Cm:1"], outputs=OUTPUTS)
    assert again.refined["Cm"].standard_errors[1] == refined.refined["Cm"].standard_errors[1]
    assert [str(term) for term in again.refined["Cm"].held] == ["alpha", "q_hat", "de"]


# --- verdict ----------------------------------------------------------------------------------------


def test_a_refinement_that_predicts_better_says_so_first_and_is_kept(refined):
    assert refined.verdict == "better"
    assert refined.model is refined.refined
    assert str(refined).splitlines()[0] == f"Refinement: {refined.statement}"
    assert refined.statement.startswith("better on held-out recordings (relative error 0.0")
    assert refined.statement.endswith("over 6 windows of m02 and m03)")
    assert refined.to_dict()["verdict"] == "better"
    assert refined.model.refinement == refined.statement


def test_the_errors_compared_are_those_of_a_resimulation_in_windows(refined):
    held_out = [record(2, -0.02), record(3, 0.015, 0.7)]
    for which in ("original", "refined"):
        replay = resimulate(getattr(refined, which), CITATION.aircraft, held_out, outputs=OUTPUTS, window=4.0)
        size = {name: np.std(np.concatenate([r[name] for r in held_out])) for name in OUTPUTS}
        squares = [
            np.mean([np.mean(((r[n][part] - s[n][part]) / size[n]) ** 2) for n in OUTPUTS])
            for r, s in zip(held_out, replay.windows)
            for part in (slice(0, 100), slice(100, 200), slice(200, None))
        ]
        assert_allclose(getattr(refined.comparison, which), np.sqrt(squares), rtol=1e-9)


def worse(**options):
    """Refined on a recording whose elevator reading has a gain error that the held-out recordings do not have."""
    wrong = record(1)
    wrong = wrong.with_channels(de=TRIM["de"] + 1.3 * (wrong["de"] - TRIM["de"]))
    held_out = [record(k, 0.004 * k) for k in (2, 3, 4)]
    free = ["Cm:de", "Cm:alpha", "Cm:q_hat"]
    return refine(model(), CITATION.aircraft, [wrong], free=free, outputs=OUTPUTS, held_out=held_out, **options)


def test_a_refinement_that_predicts_worse_has_converged_and_the_original_model_is_kept():
    found = worse()
    assert found.converged
    assert found.verdict == "worse"
    assert found.model == found.original
    assert found.model["Cm"]["de"] == TRUTH["de"]
    assert found.refined["Cm"]["de"] == pytest.approx(TRUTH["de"] / 1.3, rel=0.05)
    assert found.model.refinement == f"{found.statement}; this is the original model"
    assert str(found).splitlines()[:2] == [f"Refinement: {found.statement}", "  ! The original model is kept."]
    assert "over 3 recordings of m02, m03 and m04" in found.statement


def test_the_worse_model_is_kept_on_request():
    found = worse(keep_worse=True)
    assert found.verdict == "worse"
    assert found.model is found.refined
    assert "kept" not in str(found)


@pytest.mark.parametrize(
    ("original", "refined", "diverged", "verdict"),
    [
        # Differences -0.1, -0.2, -0.3: mean -0.2, standard error 0.1/sqrt(3) = 0.058.
        ((0.5, 0.5, 0.5), (0.4, 0.3, 0.2), (0, 0), "better"),
        ((0.4, 0.3, 0.2), (0.5, 0.5, 0.5), (0, 0), "worse"),
        # Differences 0.1, -0.1, 0.1: mean 0.033, standard error 0.067.
        ((0.4, 0.5, 0.4), (0.5, 0.4, 0.5), (0, 0), "no better"),
        ((0.4, 0.5), (0.4, 0.5), (0, 0), "no better"),
        ((0.5,), (0.1,), (0, 0), "not validated"),
        ((), (), (2, 2), "not validated"),
        ((0.5, 0.5, 0.5), (0.1, 0.2, 0.1), (0, 1), "worse"),
        ((0.1, 0.2, 0.1), (0.5, 0.5, 0.5), (2, 1), "better"),
    ],
)
def test_the_verdict_is_the_mean_difference_against_its_standard_error(original, refined, diverged, verdict):
    found = HeldOutComparison(("m01",), ("q",), "window", original, refined, diverged)
    assert found.verdict == verdict
    assert found.reason
    if len(original) == 3:
        d = np.subtract(refined, original)
        assert found.standard_error == pytest.approx(np.sqrt(((d - d.mean()) ** 2).sum() / 2.0 / 3.0))


def test_differences_scatter_over_recordings_from_three_on_and_diverged_windows_are_counted_separately():
    window = np.array([[0.04, 0.01], [0.16, 0.01]])
    few, many = (_paired(["a", "b", "c"][:n], ["q"], [window] * n) for n in (2, 3))
    assert (few.unit, len(few.original)) == ("window", 4)
    assert many.unit == "recording"
    assert_allclose(many.original, [np.sqrt(0.1)] * 3)
    lost = _paired(["a"], ["q"], [np.array([[0.04, np.inf], [0.04, 0.01]])])
    assert lost.diverged == (0, 1)
    assert lost.original == (0.2,)


def test_without_held_out_recordings_it_is_not_validated():
    found = refine(model(), CITATION.aircraft, [record(1)], free=["Cm:alpha"], outputs=OUTPUTS)
    assert found.converged
    assert found.verdict == "not validated"
    assert found.model.refinement == "not validated (no recordings were held out)"


def helicopter_flight(name, seed, width, gain=1.0):
    """AS 355 by scipy's integrator, in motion at the start, with noise and constants on the outputs."""
    rng = np.random.default_rng(seed)
    u = three_two_one_one("de", 0.5, width, duration=8.0, dt=0.04)
    start, constant = 0.2 * rng.standard_normal(4), 0.1 * rng.standard_normal(5)
    y = fly_by_solver(helicopter(), u.t, [gain * u["de"]], start=start, reference=constant)
    y = y + 0.01 * y.std(axis=0) * rng.standard_normal(y.shape)
    return Recording(name, u.t, {"de": u["de"], **dict(zip(("alpha", "q", "ax", "az", "theta"), y.T))})


def test_a_linear_model_is_better_on_held_out_flights_whose_start_is_not_known():
    held_out = [helicopter_flight("m02", 2, 0.7), helicopter_flight("m03", 3, 0.4)]
    off = helicopter(Mq=-0.6, Md=0.12)
    asked = {"free": ["Mq", "Md"], "starts": "all", "biases": "all"}
    found = refine(off, None, [helicopter_flight("m01", 1, 0.5)], held_out=held_out, **asked)
    assert found.verdict == "better"
    # The noise remains: 1 % of the flight's standard deviation, relative to that of both flights together.
    both = [np.array([r[name] for r in held_out]) for name in found.noise_std]
    noise = np.sqrt(np.mean([1e-4 * np.mean(y.std(axis=1) ** 2) / y.std() ** 2 for y in both]))
    # Nine constants of 500 samples in a window are fitted: 1 % less. Twenty per cent is for the errors of Mq and Md.
    assert np.mean(found.comparison.refined) == pytest.approx(noise, rel=0.2)
    assert np.mean(found.comparison.original) > 2.0 * noise


def test_the_original_linear_model_is_kept_where_the_refined_one_predicts_worse():
    # The elevator of the first recording moved 30 % more than was recorded.
    wrong = helicopter_flight("m01", 1, 0.5, gain=1.3)
    asked = {"free": ["Md"], "starts": "all", "biases": "all"}
    found = refine(helicopter(), None, [wrong], held_out=[helicopter_flight("m02", 2, 0.7)], **asked)
    assert found.verdict == "worse"
    assert found.model is found.original
    assert found.refined.parameters["Md"] != found.original.parameters["Md"]


def test_held_out_recordings_must_be_others_with_an_output_in_common():
    with pytest.raises(DataError, match="'m01' as held out, and to refine with"):
        refine(model(), CITATION.aircraft, [record(1)], free=["Cm:alpha"], held_out=[record(1)])
    blind = Recording("blind", record(2).t, {n: x for n, x in record(2).channels.items() if n not in OUTPUTS[1:]})
    with pytest.raises(DataError, match="no varying output in common of q"):
        refine(model(), CITATION.aircraft, [record(1)], free=["Cm:alpha"], outputs=["q"], held_out=[blind.with_channels(
            theta=record(2)["theta"])])  # fmt: skip


# --- command ----------------------------------------------------------------------------------------


def test_the_command_leads_with_the_verdict_and_keeps_the_original_where_it_is_worse(tmp_path):
    CITATION.aircraft.to_toml(tmp_path / "aircraft.toml")
    model().to_json(tmp_path / "first.json")
    wrong = record(1)
    (tmp_path / "flights").mkdir()
    for one in (wrong.with_channels(de=TRIM["de"] + 1.3 * (wrong["de"] - TRIM["de"])), record(2), record(3, -0.02)):
        write_recording(one, tmp_path / "flights" / f"{one.name}.csv")
    asked = ("refine", tmp_path / "first.json", "--aircraft", tmp_path / "aircraft.toml", "--recordings",
             tmp_path / "flights", "--free", "Cm:de,Cm:alpha", "--outputs", ",".join(OUTPUTS), "--held-out", "m02,m03",
             "--no-plots")  # fmt: skip
    result = run(*asked, "--out", tmp_path / "a")  # exit code 0
    assert result.stdout.startswith("Refinement  worse on held-out recordings (relative error 0.")
    assert "--keep-worse keeps the refined one" in result.stderr
    stored = json.loads((tmp_path / "a" / "model.json").read_text())
    assert stored["provenance"]["refinement"].endswith("this is the original model")
    assert AeroModel.from_json(tmp_path / "a" / "model.json") == model()
    assert json.loads((tmp_path / "a" / "refinement.json").read_text())["verdict"] == "worse"
    assert (tmp_path / "a" / "report.txt").read_text().startswith("Refinement: worse on held-out recordings")
    assert "The refined model is worse on held-out recordings" in (tmp_path / "a" / "report.html").read_text()
    result = run(*asked, "--out", tmp_path / "b", "--keep-worse")
    assert "It is kept, as --keep-worse asks" in result.stderr
    kept = AeroModel.from_json(tmp_path / "b" / "model.json")
    assert kept["Cm"]["de"] == pytest.approx(TRUTH["de"] / 1.3, rel=0.1)
    assert kept.refinement.startswith("worse on held-out recordings")
    assert [str(term) for term in kept["Cm"].held] == ["1", "q_hat"]


def test_constants_of_single_recordings_go_where_their_mean_is_estimated():
    before = ResponseModel(("1", "alpha"), [0.1, -0.5], constants={"m01": 0.09, "m02": 0.11})
    assert refine_response(before, {0: 0.2}, np.array([[0.01]]), "output error").constants == {}
    assert refine_response(before, {1: -0.6}, np.array([[0.04]]), "output error").constants == before.constants
