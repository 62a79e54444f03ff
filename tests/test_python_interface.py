"""The Python interface: what to pass, what is refused, and what a user of statsmodels finds on a result."""

import copy
import inspect
import pickle
import warnings
from functools import cache
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
import scipy
import statsmodels.api as sm
from numpy.testing import assert_allclose, assert_array_equal

import structsel as ss
from structsel.demo import demo_instruments
from structsel.errors import ArgumentError, DataError, SelectionError
from structsel.results import Summarised
from tests.commands import code_blocks

TERMS = ["alpha", "de"]


def frame(seed=0, n=400, **level):
    """A manoeuvre as a data frame, Cm = 0.02 - 0.5 alpha - 1.5 de + white noise."""
    t = 0.04 * np.arange(n)
    alpha, de = 0.1 + 0.03 * np.sin(0.7 * t + seed), 0.05 * np.sign(np.sin(1.1 * t + seed))
    noise = 0.001 * np.random.default_rng(seed).standard_normal(n)
    Cm = level.get("level", 0.02) - 0.5 * alpha - 1.5 * de + noise
    return pd.DataFrame({"t": t, "alpha": alpha, "de": de, "Cm": Cm})


def chosen(**options):
    """A selection with both terms, from one manoeuvre."""
    return ss.select(frame(), "Cm", TERMS, include=TERMS, bootstrap=0, **{"noise": "white", **options})


# --- what may be passed ------------------------------------------------------------------------------


def test_a_frame_a_list_of_names_and_recordings_with_candidates_give_the_same_selection():
    from_frame = chosen()
    recording = ss.Recording.from_frame(frame())
    named = ss.select([recording], "Cm", ss.Candidates.parse(TERMS), include=TERMS, bootstrap=0, noise="white")
    assert isinstance(from_frame, ss.Selection)
    assert from_frame.terms == named.terms
    assert_array_equal(from_frame.values, named.values)


def test_units_of_a_frame_are_converted():
    degrees = frame().assign(alpha=np.rad2deg(frame().alpha), h_ft=1000.0)
    recording = ss.Recording.from_frame(degrees, {"alpha": "deg", "h_ft": "ft"}, name="m01")
    assert recording.name == "m01"
    assert_allclose(recording["alpha"], frame().alpha, rtol=1e-14)
    assert recording.unit("alpha") == "rad"
    assert recording.unit("h_ft") == "ft"  # no channel of the nomenclature


@pytest.mark.parametrize("how", ["column", "index", "stamps"])
def test_the_time_of_a_frame_is_its_column_t_a_named_column_or_its_index(how):
    given, options = frame(), {}
    if how == "column":
        given, options = given.rename(columns={"t": "Time"}), {"time": "Time"}
    if how == "index":
        given = given.set_index("t")
    if how == "stamps":
        given.index = pd.Timestamp("2026-05-01 12:00") + pd.to_timedelta(given.pop("t"), unit="s")
    recording = ss.Recording.from_frame(given, **options)
    assert_allclose(recording.t, frame().t, atol=1e-8)
    assert set(recording.names) == {"alpha", "de", "Cm"}


def test_a_frame_without_time_and_a_unit_of_no_column_are_refused():
    with pytest.raises(DataError, match=r'no time\. It has: alpha, de, Cm\.\n.*time="Time"'):
        ss.Recording.from_frame(frame().drop(columns="t"))
    with pytest.raises(DataError, match="no column 'beta'"):
        ss.Recording.from_frame(frame(), {"beta": "deg"})


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ("flights/", "read_recording"),
        (np.zeros((9, 2)), r"ndarray\.\n.*StepwiseRegressor"),
        ({"alpha": [1.0]}, r"dict\.\nMake a recording"),
        (3, "an int"),
        ([3], "an int, in its list"),
        (ss.AeroModel.from_terms({"Cm": {"alpha": -1.0}}), "first argument"),
    ],
)
def test_what_is_no_recording_is_refused_with_what_to_pass(given, says):
    for call in (
        lambda: ss.select(given, "Cm", TERMS),
        lambda: ss.validate(ss.AeroModel.from_terms({"Cm": {"alpha": -1.0}}), given),
        lambda: ss.compute_all(given, ss.demo_flights(1)[1]),
    ):
        with pytest.raises(ArgumentError, match=says):
            call()
    with pytest.raises(TypeError):
        ss.select(given, "Cm", TERMS)


@pytest.mark.parametrize("given", ["alpha", 3, [3], {"alpha": 1}.items()])
def test_what_is_no_pool_is_refused_with_what_to_pass(given):
    with pytest.raises(ArgumentError, match=r"candidate terms.*\nPass Candidates\.polynomial"):
        ss.select(frame(), "Cm", given)


@pytest.mark.parametrize("verb", [ss.compare, ss.diagnose])
def test_a_model_in_the_place_of_the_recordings_is_refused(verb):
    recordings, aircraft, _ = ss.demo_flights(1)
    with pytest.raises(ArgumentError, match=rf"{verb.__name__} needs recordings.*\nIt was given an AeroModel"):
        verb(recordings, ss.AeroModel.from_terms({"Cm": {"alpha": -1.0}}), aircraft)


# --- one response, one selection --------------------------------------------------------------------


def test_one_response_gives_a_selection_and_a_list_gives_a_mapping():
    assert isinstance(chosen(), ss.Selection)
    several = ss.select(frame(), ["Cm"], TERMS, bootstrap=0)
    assert isinstance(several, ss.Selections)
    assert list(several) == ["Cm"]


def test_the_former_index_of_one_response_works_with_a_warning():
    selection = chosen()
    with pytest.warns(DeprecationWarning, match="use selection instead"):
        assert selection["Cm"] is selection
    with pytest.raises(SelectionError, match="not of 'CZ'"):
        selection["CZ"]
    assert list(selection.model.responses) == ["Cm"]


# --- as statsmodels ------------------------------------------------------------------------------------


def test_estimates_intervals_and_residuals_are_those_of_statsmodels_where_residuals_are_white():
    data = frame()
    fit = sm.OLS(data.Cm, sm.add_constant(data[TERMS])).fit()
    # Of the same terms, with the textbook errors: those printed are corrected for what autocorrelation there is.
    model = ss.model.ResponseModel(
        ["1", *TERMS], fit.params.to_numpy(), covariance=fit.cov_params().to_numpy(), n=int(fit.nobs)
    )
    assert list(model.params.index) == ["1", "alpha", "de"]
    for name in ("params", "bse", "tvalues", "pvalues"):
        assert_allclose(getattr(model, name), getattr(fit, name), rtol=1e-9, atol=1e-300)
    for alpha in (0.05, 0.2):
        assert_allclose(model.conf_int(alpha), fit.conf_int(alpha), rtol=1e-9)
    found = chosen()
    order = list(found.params.index)
    assert_allclose(found.params[["1", *TERMS]], fit.params, rtol=1e-6)
    assert_allclose(found.conf_int().to_numpy(), found.intervals(), rtol=1e-12)
    assert_allclose(found.fittedvalues, fit.fittedvalues, rtol=1e-6)
    assert_allclose(found.resid, fit.resid, atol=1e-8)
    assert set(order) == {"1", *TERMS}
    assert found.resid.index.name == "t"


@cache
def from_two_levels():
    pair = [ss.Recording.from_frame(frame(k, level=0.02 + 0.01 * k), name=f"m{k}") for k in range(2)]
    return pair, ss.select(pair, "Cm", TERMS, include=TERMS, constants="own", bootstrap=0)


def test_residuals_of_recordings_with_constants_of_their_own_have_the_rms_that_is_printed():
    pair, found = from_two_levels()
    assert found.resid.index.names == ["recording", "t"]
    assert len(found.resid) == sum(map(len, pair))
    assert_allclose(np.sqrt(np.mean(found.resid**2)), found.rms, rtol=1e-4)  # prewhitened: not the least rms
    for name, part in found.resid.groupby("recording"):
        assert abs(part.mean()) < 1e-4, name  # their levels differ by 0.01


def test_a_prediction_has_the_mean_constant_and_the_index_of_its_recording():
    pair, found = from_two_levels()
    data = frame(7, 50)
    predicted = found.predict(data)
    expected = found.params["1"] + found.params["alpha"] * data.alpha + found.params["de"] * data.de
    assert_allclose(predicted, expected, rtol=1e-12)
    assert_allclose(predicted.index, data.t)
    assert found.predict(pair).index.names == ["recording", "t"]
    assert found.predict().equals(found.fittedvalues)


def test_refinements_and_regressions_have_estimates_by_term():
    for kind in (ss.Refinement, ss.refinement.EquationError, ss.Selection, ss.model.ResponseModel):
        for name in ("params", "bse", "tvalues", "pvalues", "conf_int"):
            assert hasattr(kind, name)


# --- every result ------------------------------------------------------------------------------------


@cache
def results():
    """One result of each public type that a small case can make."""
    recordings, aircraft, _ = ss.demo_flights(2, duration=8.0)
    flights = ss.compute_all(recordings, aircraft)
    pool = ss.Candidates.parse(["alpha", "q_hat", "de"])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        selections = ss.select(flights, ["CX", "CZ", "Cm"], pool, include=pool.names, bootstrap=0)
        published = ss.published_aircraft("beaver")
        trimmed = published.trim(45.0, 600.0)
        linear = ss.linearise(published.model, published.aircraft, trimmed, definitions=published.definitions)
        t = 0.02 * np.arange(2000)
        de = np.sin(0.5 * t + 0.05 * t**2)
        sweep = ss.Recording("sweep", t, {"de": de, "q": scipy.signal.lfilter([0.05], [1.0, -1.9, 0.95], de)})
        response = ss.frequency_response(sweep, "q", "de", band=(0.6, 4.0))
        flight = demo_instruments("all-axes", 1, duration=4.0)
        return {
            type(one).__name__: one
            for one in (
                flights[0], aircraft, pool, selections, selections["Cm"], selections.model, selections.model["Cm"],
                ss.validate(selections.model, flights), ss.resimulate(selections.model, aircraft, flights),
                response, ss.fit_transfer_function(response, (1, 2)),
                published, trimmed, linear, ss.reconstruct(flight.measured, flight.aircraft, method="extended"),
                ss.equation_error(selections.model, aircraft, flights),
            )
        }  # fmt: skip


KINDS = ("Recording Aircraft Candidates Selections Selection AeroModel ResponseModel Validation Resimulation "
         "PublishedAircraft Trim LinearModel Reconstruction EquationError FrequencyResponse "
         "TransferFunction")  # fmt: skip


@pytest.mark.parametrize("kind", KINDS.split())
def test_a_result_survives_a_pickle_and_a_deep_copy_and_is_short_at_the_prompt(kind):
    one = results()[kind]
    for again in (pickle.loads(pickle.dumps(one)), copy.deepcopy(one)):
        assert type(again) is type(one)
        assert str(again) == str(one)
        if hasattr(one, "to_frame"):
            pd.testing.assert_frame_equal(again.to_frame(), one.to_frame())
    assert len(repr(one)) < 400
    assert "\n" not in repr(one)


def test_every_public_result_is_among_those_that_are_copied_or_is_named_here():
    not_made = {
        "Derivatives", "Diagnosis", "Ensemble", "EstimateComparison", "InputComparison", "InputDesign", "Mismatch",
        "Qualification", "Reconstructions", "RecursiveEstimate", "Refinement",
    }  # fmt: skip
    types = {name: getattr(ss, name) for name in ss.__all__ if isinstance(getattr(ss, name), type)}
    public = {name for name, kind in types.items() if issubclass(kind, Summarised)}
    assert public - not_made <= set(KINDS.split())


@pytest.mark.parametrize(
    ("kind", "arguments"),
    [("Selection", ()), ("Recording", ("alpha",)), ("Reconstruction", ()), ("Resimulation", ("Recording", "q"))],
)
def test_a_result_plots_itself_on_the_axes_that_are_given(kind, arguments):
    figure, ax = plt.subplots()
    names = [results()[one].name if one == "Recording" else one for one in arguments]
    assert results()[kind].plot(*names, ax=ax) is ax
    assert ax.has_data()
    plt.close(figure)


def test_a_result_without_a_figure_says_which_have_one():
    with pytest.raises(ArgumentError, match=r"no figure for a Candidates.*\n.*Selection"):
        results()["Candidates"].plot()


@pytest.mark.parametrize("name", [name for name in ss.plotting.__all__ if name.startswith("plot")])
def test_every_plot_takes_axes(name):
    assert "ax" in inspect.signature(getattr(ss.plotting, name)).parameters


def test_the_page_on_data_frames_and_arrays_runs_as_it_stands(capsys):
    page = (Path(__file__).parents[1] / "docs/python_use.md").read_text()
    names = {}
    for block in code_blocks(page, "python"):
        exec(block, names)
    assert names["found"].get_support()[[0, 2]].all()
    assert abs(names["found"].coef_[2] + 1.5) < 0.01
    assert [recording.name for recording in names["manoeuvres"]] == ["0.0", "1.0"]
    assert_allclose(names["flight"]["V"], 90.0 * 1852.0 / 3600.0, rtol=1e-12)
    (refused,) = code_blocks(page, "text")
    with pytest.raises(ArgumentError) as raised:
        ss.select("flights/", "Cm", TERMS)
    assert f"ArgumentError: {raised.value}\n" == refused
    assert "2 of 3 candidate terms" in capsys.readouterr().out
    plt.close("all")
