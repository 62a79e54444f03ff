"""AeroModel: values, the recorded ranges, files and tables."""

import json
import math
import os
import pickle
import re
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats

from structsel.candidates import Candidates, Term
from structsel.errors import ChannelError, ModelError, StructselWarning
from structsel.model import AeroModel, ResponseModel, recorded_ranges
from structsel.recording import Recording

TERMS = ["1", "alpha", "alpha^2*de", "(alpha - 0.2)+", "abs(de)*de"]
VALUES = [-0.213, -4.037, 0.1 + 0.2, 1.7e-9, -0.836]


def make_recording(name="m01", seed=1, scale=1.0, n=300):
    rng = np.random.default_rng(seed)
    alpha, de = scale * rng.uniform(-0.1, 0.3, n), scale * rng.uniform(-0.2, 0.2, n)
    return Recording(name, 0.02 * np.arange(n), {"alpha": alpha, "de": de})


def make_model(**changes):
    root = np.random.default_rng(3).normal(size=(5, 5)) * 1e-2
    fields = {
        "covariance": root @ root.T,
        "method": "stepwise",
        "residuals": "coloured",
        "ranges": recorded_ranges([make_recording()], ["alpha", "de"]),
        "n": 300,
        "s2": 1.0 / 3.0,
        "r2": 0.957,
    } | changes
    CZ = ResponseModel(tuple(map(Term, TERMS)), np.array(VALUES), **fields)
    Cm = ResponseModel((Term("1"), Term("de")), np.array([0.021, -1.25]))
    return AeroModel({"CZ": CZ, "Cm": Cm}, name="citation", recordings=("m01",))


def by_hand(recording):
    a, d = recording["alpha"], recording["de"]
    columns = [np.ones_like(a), a, a**2 * d, np.where(a > 0.2, a - 0.2, 0), np.abs(d) * d]
    return np.column_stack(columns) @ VALUES


# --- values ----------------------------------------------------------------------------------------


def test_a_model_evaluates_to_the_sum_of_its_terms():
    recording = make_recording()
    values = make_model().evaluate(recording)
    assert_allclose(values["CZ"], by_hand(recording), rtol=1e-13)
    assert_allclose(values["Cm"], 0.021 - 1.25 * recording["de"], rtol=1e-13)
    assert_array_equal(values["CZ"], make_model()["CZ"].evaluate(dict(recording.channels)))


def test_a_model_of_the_constant_alone_and_of_nothing_have_a_value_everywhere():
    recording = make_recording()
    assert_array_equal(ResponseModel((Term("1"),), np.array([2.5])).evaluate(recording), np.full(300, 2.5))
    assert_array_equal(ResponseModel((), np.array([])).evaluate(recording), np.zeros(300))


def test_a_model_fitted_about_a_reference_is_the_same_function_on_new_data():
    # The terms contain the offset, so nothing about centring has to be kept with them.
    old, new = make_recording(seed=1), make_recording(seed=2, scale=3.0)
    pool = Candidates.polynomial(["alpha", "de"], 2)
    y = 1.0 + 2.0 * old["alpha"] - old["alpha"] * old["de"]
    found = []
    for terms in (pool, pool.about(alpha=0.15)):
        X = np.column_stack([np.ones(len(old)), terms.evaluate(old)])
        found.append(ResponseModel((Term(), *terms), np.linalg.lstsq(X, y, rcond=None)[0]).evaluate(new))
    assert_allclose(found[0], found[1], rtol=1e-10, atol=1e-12)
    assert_allclose(found[0], 1.0 + 2.0 * new["alpha"] - new["alpha"] * new["de"], rtol=1e-10, atol=1e-12)


def test_predict_puts_the_responses_into_the_recording():
    recording = make_recording()
    predicted = make_model().predict(recording)
    assert_allclose(predicted["CZ"], by_hand(recording), rtol=1e-13)
    assert "model 'citation'" in predicted.provenance[-1]


def test_a_missing_channel_is_named():
    with pytest.raises(ChannelError, match=r"needs channel 'de'; 'm09' has none"):
        make_model().evaluate(Recording("m09", np.arange(9.0), {"alpha": np.ones(9)}))


# --- uncertainty -----------------------------------------------------------------------------------


def test_standard_errors_t_and_intervals_are_the_textbook_s():
    CZ = make_model()["CZ"]
    errors = np.sqrt(np.diag(CZ.covariance))
    assert_allclose(CZ.standard_errors, errors, rtol=1e-15)
    assert_allclose(CZ.t_values, np.array(VALUES) / errors, rtol=1e-14)
    for i, (low, high) in enumerate(CZ.intervals()):
        expected = stats.t.interval(0.95, 295, loc=VALUES[i], scale=errors[i])
        assert_allclose((low, high), expected, rtol=1e-12)


def test_unknown_errors_are_nan_not_zero():
    Cm = make_model()["Cm"]
    assert np.isnan(Cm.standard_errors).all()
    assert np.isnan(Cm.intervals()).all()


# --- the recorded ranges ------------------------------------------------------------------------------


def test_inside_the_recorded_ranges_nothing_is_said():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        make_model().evaluate(make_recording())


def test_outside_the_region_simulated_the_warning_gives_channel_fraction_and_distance():
    recording = make_recording()
    alpha = recording["alpha"].copy()
    low, high = alpha.min(), alpha.max()
    alpha[:75], alpha[75] = high + 0.125, low - 0.5
    moved = recording.with_channels(alpha=alpha)
    with pytest.warns(StructselWarning, match=r"'m01' leaves the ranges .*alpha \[rad\] in 25.3 % of samples"):
        make_model().evaluate(moved)
    (excursion,) = make_model().range_excursions(moved)
    assert (excursion.channel, excursion.low, excursion.high) == ("alpha", low, high)
    assert_allclose([excursion.fraction, excursion.above, excursion.below], [76 / 300, 0.125, 0.5], rtol=1e-12)
    with pytest.raises(ModelError, match="leaves the ranges"):
        make_model().evaluate(moved, outside="raise")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        make_model().evaluate(moved, outside="ignore")


def test_only_channels_the_terms_need_count():
    region = {"alpha": (-1.0, 1.0), "de": (-1.0, 1.0), "q_hat": (0.0, 0.0)}
    recording = make_recording().with_channels(q_hat=np.ones(300))
    assert make_model(ranges=region).range_excursions(recording) == ()


def test_the_region_spans_all_recordings_and_the_model_s_is_common_to_its_responses():
    one, two = make_recording(seed=1), make_recording(seed=2)
    region = recorded_ranges([one, two], ["alpha"])
    both = np.concatenate([one["alpha"], two["alpha"]])
    assert region == {"alpha": (both.min(), both.max())}
    part = [ResponseModel(("alpha",), [1.0], ranges={"alpha": bounds}) for bounds in ((0, 2), (1, 3))]
    assert AeroModel({"CX": part[0], "CZ": part[1]}).ranges == {"alpha": (1.0, 2.0)}


# --- files -----------------------------------------------------------------------------------------


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=4, max_size=4))
@settings(max_examples=100, deadline=None)
def test_a_model_survives_its_file_to_the_last_bit(tmp_path_factory, numbers):
    path = tmp_path_factory.mktemp("models") / "model.json"
    part = ResponseModel(("1", "alpha", "(de - 0.1)^2"), numbers[:3], np.diag(np.abs(numbers[:3])), s2=abs(numbers[3]))
    model = AeroModel({"CX": part, "CY": make_model()["CZ"]}, "a", ("m1", "m2"))
    model.to_json(path)
    again = AeroModel.from_json(path)
    assert again == model
    assert_array_equal(again["CX"].values, numbers[:3])
    with np.errstate(over="ignore", invalid="ignore"):
        new = make_recording(seed=9)
        before, after = (m.evaluate(new, outside="ignore") for m in (model, again))
    for name in before:
        assert before[name].tobytes() == after[name].tobytes()


def test_everything_a_model_knows_survives_its_file(tmp_path):
    model = make_model(biased=True, standard_errors=[0.1, math.nan, 0.3, 0.4, 0.5])
    model.to_json(tmp_path / "model.json")
    again = AeroModel.from_json(tmp_path / "model.json")
    assert again == model
    CZ, held = again["CZ"], model["CZ"]
    assert CZ.biased
    assert (CZ.method, CZ.residuals, CZ.n, CZ.s2, CZ.r2) == ("stepwise", "coloured", 300, 1 / 3, 0.957)
    assert dict(CZ.ranges) == dict(held.ranges)
    assert_array_equal(CZ.covariance, held.covariance)
    assert_array_equal(CZ.standard_errors, held.standard_errors)
    assert math.isnan(again["Cm"].r2)
    assert again.recordings == ("m01",)
    assert pickle.loads(pickle.dumps(again)) == model


def test_a_model_can_be_written_by_hand(tmp_path):
    path = tmp_path / "hand.json"
    by_hand = {"CZ": {"terms": ["1", "de*alpha"], "values": [1, -2.5]}}
    path.write_text(json.dumps({"schema": "structsel.model/1", "responses": by_hand}))
    CZ = AeroModel.from_json(path)["CZ"]
    assert CZ["alpha*de"] == -2.5
    assert CZ.covariance is None


GOOD = {"schema": "structsel.model/1", "responses": {"CZ": {"terms": ["1", "alpha"], "values": [1.0, 2.0]}}}


def changed(**changes):
    return json.dumps({**GOOD, "responses": {"CZ": {**GOOD["responses"]["CZ"], **changes}}})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("{", "is not JSON"),
        ("[1, 2]", 'needs "schema": "structsel.model/1"; it has null'),
        (json.dumps({**GOOD, "schema": "structsel.model/2"}), 'it has "structsel.model/2"'),
        (json.dumps({**GOOD, "responses": {}}), "at least one response"),
        (json.dumps({"schema": "structsel.model/1"}), "responses: Field required"),
        (json.dumps({**GOOD, "colour": "red"}), "colour: Extra inputs"),
        (changed(values=[1.0, "2.0"]), r"responses.CZ.values.1: Input should be a valid number"),
        (changed(values=[1.0]), "response 'CZ': values has shape .1,.; 2 terms need"),
        (changed(values=[1.0, math.nan]), "NaN is not a JSON number"),
        (changed(values=[1.0, 2.0]).replace("2.0", "1e999"), "finite number"),
        (changed(terms=["1", "alpha*"]), r"response 'CZ': Term 'alpha\*' cannot be read at position 7"),
        (changed(terms=["alpha", "alpha"]), "holds alpha more than once"),
        (changed(covariance=[[1.0, 0.0]]), "covariance has shape"),
        (changed(covariance=[[1.0, 0.0], [1.0]]), "response 'CZ'"),
        (changed(region={"alpha": [1.0]}), "responses.CZ.region.alpha: List should have at least 2"),
        (changed(region={"alpha": [1.0, 0.0]}), "Write the least value first"),
        (changed(r2=1.01), "response 'CZ': r2 is 1.01. R2 cannot exceed 1"),
        (changed(s2=-0.1), "response 'CZ': s2, a variance, is -0.1"),
        (changed(standard_errors=[0.1, -0.1]), "response 'CZ', term 'alpha': the standard error is -0.1"),
        (changed(covariance=[[1.0, 0.0], [0.0, -0.04]]), "response 'CZ', term 'alpha': the variance .* is -0.04"),
        (
            changed(covariance=[[1.0, 0.5], [0.4, 1.0]]),
            "response 'CZ', terms '1' and 'alpha': the covariance is not symmetric, 0.5 and 0.4",
        ),
        (
            changed(covariance=[[1.0, 2.5], [2.5, 4.0]]),
            "terms '1' and 'alpha': their covariance 2.5 exceeds the product of their standard deviations, 2",
        ),
        (
            changed(covariance=[[1.0, 0.0], [0.0, 4.0]], standard_errors=[1.0, 0.5]),
            "response 'CZ', term 'alpha': the standard error 0.5 is smaller than the covariance states, 2",
        ),
        (changed().replace('"terms"', '"values": [3.0, 4.0], "terms"'), "'values' occurs twice in responses.CZ"),
        (changed().replace('"CZ": {', '"CZ": {"terms": [], "values": []}, "CZ": {'), "'CZ' occurs twice in responses"),
        (changed().replace('"schema"', '"name": "a", "name": "b", "schema"'), "'name' occurs twice at the top"),
        (changed(terms=["de*alpha", "alpha*de"]), "holds alpha[*]de more than once"),
        (changed(held=["de"]), "response 'CZ': The held term 'de' is not a term of the model"),
    ],
)
def test_a_file_that_is_no_model_is_refused_with_its_name_and_the_place(tmp_path, text, message):
    path = tmp_path / "model.json"
    path.write_text(text)
    with pytest.raises(ModelError, match=message) as caught:
        AeroModel.from_json(path)
    assert "model.json" in str(caught.value)


@pytest.mark.parametrize(
    "fields",
    [
        {"covariance": [[1.0, 0.0], [0.0, 4.0]], "standard_errors": [1.0, 3.0]},  # wider: after a selection
        {"covariance": [[1.0, 0.5], [0.5000001, 4.0]], "standard_errors": [0.9999999, 2.0]},  # written with digits
        {"covariance": [[1.0, 2.0], [2.0, 4.0]], "standard_errors": [None, 2.0], "r2": 1.0},  # perfectly correlated
        {"covariance": [[1.0, 0.0], [0.0, -1e-30]]},  # of a value that is known exactly
    ],
)
def test_wider_errors_and_rounding_are_no_contradiction(tmp_path, fields):
    path = tmp_path / "model.json"
    path.write_text(changed(**fields))
    assert AeroModel.from_json(path)["CZ"].covariance.shape == (2, 2)


def test_held_terms_and_the_verdict_of_a_refinement_survive_the_file_and_lead_the_report(tmp_path):
    part = ResponseModel(("1", "alpha"), [1.0, 2.0], np.diag([0.01, 0.04]), held=("alpha",))
    model = AeroModel({"CZ": part}, "mine", refinement="no better on held-out recordings (0.1)")
    model.to_json(tmp_path / "model.json", provenance={"inputs": []})
    stored = json.loads((tmp_path / "model.json").read_text())
    assert stored["provenance"]["refinement"] == model.refinement
    assert stored["responses"]["CZ"]["held"] == ["alpha"]
    again = AeroModel.from_json(tmp_path / "model.json")
    assert (again.refinement, again["CZ"].held) == (model.refinement, part.held)
    assert str(again).splitlines()[0] == "Refinement: no better on held-out recordings (0.1)"
    assert re.search(r"^  alpha \(held\) +2 +0.2 ", str(again), re.MULTILINE)
    assert r"$\alpha$\,(held) & $2$ & $0.2$" in again.latex()
    assert again.to_frame().held.tolist() == [False, True]
    assert again.quasi_steady().refinement == model.refinement


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(ModelError, match=r"absent\.json' cannot be read"):
        AeroModel.from_json(tmp_path / "absent.json")


def test_an_existing_file_is_kept_unless_stated_otherwise(tmp_path):
    path = tmp_path / "model.json"
    path.write_text("mine")
    with pytest.raises(ModelError, match=r"exists\.\nChoose another name, or pass overwrite=True"):
        make_model().to_json(path)
    assert path.read_text() == "mine"
    make_model().to_json(path, overwrite=True)
    assert AeroModel.from_json(path) == make_model()


def test_a_write_that_fails_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path = tmp_path / "model.json"
    path.write_text("mine")

    def fail(*_):
        raise OSError("disk full")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(ModelError, match="cannot be written: disk full"):
        make_model().to_json(path, overwrite=True)
    assert [p.name for p in tmp_path.iterdir()] == ["model.json"]
    assert path.read_text() == "mine"
    with pytest.raises(ModelError, match="cannot be written"):
        make_model().to_json(tmp_path / "no" / "model.json")


# --- tables ----------------------------------------------------------------------------------------


def test_the_frame_has_one_row_per_response_and_term():
    frame = make_model().to_frame()
    assert list(frame.columns) == ["response", "term", "value", "std_error", "t", "low", "high", "held"]
    assert list(frame.response) == ["CZ"] * 5 + ["Cm"] * 2
    CZ = make_model()["CZ"]
    assert_array_equal(frame.value[:5], VALUES)
    assert_allclose(frame[["low", "high"]].to_numpy()[:5], CZ.intervals(), rtol=1e-15)


def test_the_report_shows_values_errors_region_and_bias():
    model = make_model(biased=True, covariance=np.diag([0.01**2] * 5))
    text = str(model)
    assert "CZ: 5 terms, R2 0.9570, s 0.577, n 300, stepwise, coloured residuals" in text
    assert "Biased estimates" in text
    assert "Recorded ranges: alpha -0.09" in text
    row = next(line for line in text.splitlines() if line.strip().startswith("alpha  "))
    assert row.split() == ["alpha", "-4.037", "0.01", "-403.7", "-", "-"]
    table = [line for line in text.splitlines() if line.startswith("  ")]
    assert len({len(line) for line in table[:6]}) == 1  # columns line up
    assert table[-1].split() == ["de", "-1.25", "-", "-", "-", "-"]


def test_the_latex_table_has_a_row_per_term_and_balances():
    text = make_model().latex()
    assert r"$C_Z$ & $1$ & $-0.213$" in text
    assert r"\alpha^{2} \, \delta_e" in text
    assert r"$1.7 \times 10^{-9}$" in text
    assert text.count(r"\\") == 1 + 7
    assert text.count("{") == text.count("}")
    assert r" & $\delta_e$ & $-1.25$ & -- & -- & -- & -- \\" in text


# --- what a model refuses --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ResponseModel(("1", "alpha"), [1.0]), "values has shape"),
        (lambda: ResponseModel(("1", "alpha"), [1.0, math.inf]), "value of term 'alpha' is inf"),
        (lambda: ResponseModel(("de*alpha", "alpha*de"), [1.0, 2.0]), r"alpha\*de more than once"),
        (lambda: AeroModel({}), "at least one response"),
        (lambda: make_model()["CY"], "no response 'CY'. It has: CZ, Cm"),
        (lambda: make_model()["Cm"]["alpha"], "no term 'alpha'. It has: 1, de"),
        (lambda: make_model().evaluate(make_recording(), outside="shout"), "'warn', 'ignore', 'raise'"),
    ],
)
def test_what_a_model_cannot_do_is_refused(make, message):
    with pytest.raises(ModelError, match=message):
        make()


def test_a_model_cannot_be_changed_by_hand():
    model = make_model()
    with pytest.raises(ValueError, match="read-only"):
        model["CZ"].values[0] = 1.0
    with pytest.raises(TypeError):
        model.responses["CZ"] = model["Cm"]
    values = np.array([1.0])
    part = ResponseModel(("1",), values)
    values[0] = 2.0
    assert part["1"] == 1.0


def test_the_old_names_of_ranges_and_of_the_quasi_steady_model_still_work():
    model = make_model()
    with pytest.warns(DeprecationWarning, match="ranges"):
        assert model.region == model.ranges
    with pytest.warns(DeprecationWarning, match="range_excursions"):
        assert model.leaves_region(make_recording()) == model.range_excursions(make_recording())
    with pytest.warns(DeprecationWarning, match="quasi_steady"):
        assert model.steady() == model.quasi_steady()
    with pytest.warns(DeprecationWarning, match="ranges"):
        old = ResponseModel(("alpha",), [1.0], region={"alpha": (0.0, 1.0)})
    assert old.ranges == {"alpha": (0.0, 1.0)}
    with pytest.warns(DeprecationWarning, match="recorded_ranges"):
        from structsel.model import flown_region
    assert flown_region is recorded_ranges


def test_a_model_of_given_values_is_that_sum():
    model = AeroModel.from_terms(
        {"CZ": {"1": -0.05, "alpha": -5.6}, "CX": {"alpha^2": 2.0}}, "given", method="published"
    )
    assert (model.name, model["CZ"].method) == ("given", "published")
    values = model.evaluate({"alpha": np.array([0.0, 0.1])})
    assert_allclose(values["CZ"], [-0.05, -0.61], rtol=1e-12)
    assert_allclose(values["CX"], [0.0, 0.02], rtol=1e-12)
