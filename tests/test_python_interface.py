"""The Python interface: arguments, refusals, and the attributes of results that statsmodels has."""

import copy
import inspect
import pickle
from functools import cache
from pathlib import Path
from types import MappingProxyType

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
import statsmodels.api as sm
from numpy.testing import assert_allclose, assert_array_equal

import structsel as ss
from structsel.demo import demo_instruments
from structsel.demo.aircraft import demo_aircraft
from structsel.errors import ArgumentError, DataError, SelectionError
from structsel.results import Result, Summarised
from tests.commands import code_blocks
from tests.public_results import MAKERS, made

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


def test_units_and_name_may_be_attached_to_a_frame():
    degrees = frame().assign(alpha=np.rad2deg(frame().alpha), t=1000.0 * frame().t)
    degrees.attrs = {"name": "m01", "units": {"alpha": "deg", "t": "ms", "gone": "ft"}}
    found = ss.select(degrees, "Cm", TERMS, include=TERMS, bootstrap=0, noise="white")
    assert found.recordings == ("m01",)
    assert_allclose(found.values, chosen().values, rtol=1e-12)
    assert_allclose(found.data[0].t, frame().t, rtol=1e-12)


@cache
def a_flight():
    """The first seconds of a simulated flight, as recorded, and its aircraft."""
    flight = demo_instruments("all-axes", 1, duration=4.0)
    return flight.measured, flight.aircraft


def in_degrees(recording):
    """Data frame of a recording with angles in degrees, and their units attached."""
    angles = [name for name in recording.names if recording.unit(name) == "rad"]
    table = recording.to_frame()
    table[angles] = np.rad2deg(table[angles])
    table.attrs = {"name": recording.name, "units": dict.fromkeys(angles, "deg")}
    return table


def assert_same_channels(found, expected):
    assert found.names == expected.names
    for name in expected.names:
        assert_allclose(found[name], expected[name], rtol=1e-9, atol=1e-9)


def test_coefficients_and_paths_of_a_frame_are_those_of_the_recording():
    recording, aircraft = a_flight()
    options = {"method": "output-error"}
    assert_same_channels(
        ss.compute_coefficients(in_degrees(recording), aircraft), ss.compute_coefficients(recording, aircraft)
    )
    found, expected = (ss.reconstruct(one, aircraft, **options) for one in (in_degrees(recording), recording))
    assert_allclose([c.value for c in found.constants], [c.value for c in expected.constants], rtol=1e-5, atol=1e-8)


def test_a_frame_of_inputs_is_simulated_from_its_first_sample():
    published = ss.published_aircraft("beaver")
    steady = published.trim(45.0, 600.0)
    t = 0.02 * np.arange(50)
    inputs = {"t": t, **{name: np.full(50, value) for name, value in steady.controls.items()}}
    options = {"definitions": published.definitions}
    expected = ss.simulate(published.model, published.aircraft, inputs, start=steady, **options)
    found = ss.simulate(published.model, published.aircraft, pd.DataFrame(inputs), start=steady, **options)
    assert_same_channels(found, expected)
    assert found.name == "recording"
    again = ss.simulate(published.model, published.aircraft, in_degrees(expected), **options)
    assert_allclose(again["alpha"], expected["alpha"], atol=1e-9)


def test_validation_and_comparison_take_frames():
    model = chosen().model
    found, expected = (ss.validate(model, one).scores[0] for one in (frame(), ss.Recording.from_frame(frame())))
    assert found.metrics == expected.metrics
    t = 0.05 * np.arange(240)
    u = np.sin(0.8 * t)
    runs = [ss.Recording(name, t, {"u": u, "y": 2.0 * u + shift * u**2}) for name, shift in (("a", 0.3), ("b", 0.2))]
    simulated = {one.name: ss.Recording(one.name, t, {"y": 2.0 * u}) for one in runs}
    tables = [one.to_frame() for one in runs]
    for table, one in zip(tables, runs):
        table.attrs["name"] = one.name
    sizes = [ss.compare(simulated, given).sizes["y"].difference for given in (tables, runs)]
    assert_allclose(*sizes, rtol=1e-9)


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
        lambda: ss.compute_all(given, AIRCRAFT),
    ):
        with pytest.raises(ArgumentError, match=says):
            call()
    with pytest.raises(TypeError):
        ss.select(given, "Cm", TERMS)


@pytest.mark.parametrize("given", ["alpha", 3, [3], {"alpha": 1}.items()])
def test_what_is_no_pool_is_refused_with_what_to_pass(given):
    with pytest.raises(ArgumentError, match=r"candidate terms.*\nPass Candidates\.polynomial"):
        ss.select(frame(), "Cm", given)


FLIGHT = ss.Recording("m1", [0.0, 1.0, 2.0], {"alpha": [0.1, 0.2, 0.1]})
MODEL = ss.AeroModel.from_terms({"Cm": {"alpha": -1.0}})
AIRCRAFT = demo_aircraft()
NO_RECORDING, NO_AIRCRAFT, NO_MODEL = "needs one recording", "needs an Aircraft", "needs an AeroModel"


@pytest.mark.parametrize(
    ("call", "says", "remedy"),
    [
        (lambda: ss.select(AIRCRAFT, "Cm", TERMS), "given an Aircraft", "order is select"),
        (lambda: ss.select(frame(), 3, TERMS), "name of a response.*\n.*an int", "order is select"),
        (lambda: ss.select(frame(), [FLIGHT], TERMS), "name of a response.*\n.*a list", "order is select"),
        (lambda: ss.select("Cm", FLIGHT, TERMS), "given a str", "read_recording"),
        (lambda: ss.compute_coefficients("m1.csv", AIRCRAFT), f"{NO_RECORDING}.*\n.*a str", "read_recording"),
        (lambda: ss.compute_coefficients([FLIGHT], AIRCRAFT), f"{NO_RECORDING}.*\n.*a list", "compute_all"),
        (lambda: ss.compute_coefficients(AIRCRAFT, FLIGHT), f"{NO_RECORDING}.*\n.*Aircraft", "order is"),
        (lambda: ss.compute_coefficients(FLIGHT, "a.toml"), f"{NO_AIRCRAFT}.*\n.*a str", "Aircraft.from_toml"),
        (lambda: ss.compute_all(FLIGHT, {"S": 1.0}), f"{NO_AIRCRAFT}.*\n.*a dict", "order is compute_all"),
        (lambda: ss.reconstruct([FLIGHT], AIRCRAFT), f"{NO_RECORDING}.*\n.*a list", "reconstruct_all"),
        (lambda: ss.reconstruct(AIRCRAFT, FLIGHT), f"{NO_RECORDING}.*\n.*Aircraft", "order is reconstruct"),
        (lambda: ss.reconstruct(np.zeros(9), AIRCRAFT), f"{NO_RECORDING}.*\n.*ndarray", "Name the columns"),
        (lambda: ss.reconstruct(FLIGHT, None), f"{NO_AIRCRAFT}.*\n.*NoneType", "order is reconstruct"),
        (lambda: ss.reconstruct_all([FLIGHT], "a.toml"), f"{NO_AIRCRAFT}.*\n.*a str", "Aircraft.from_toml"),
        (lambda: ss.simulate(AIRCRAFT, MODEL, FLIGHT), f"{NO_MODEL}.*\n.*Aircraft", "order is simulate"),
        (lambda: ss.simulate("model.json", AIRCRAFT, FLIGHT), f"{NO_MODEL}.*\n.*a str", "AeroModel.from_json"),
        (lambda: ss.simulate({"Cm": {}}, AIRCRAFT, FLIGHT), f"{NO_MODEL}.*\n.*a dict", "AeroModel.from_terms"),
        (lambda: ss.simulate(MODEL, AIRCRAFT, np.zeros((9, 2))), f"{NO_RECORDING}.*\n.*ndarray", "Name the columns"),
        (lambda: ss.simulate(MODEL, AIRCRAFT, FLIGHT, start=45.0), "needs a Trim as start.*\n.*a float", "trim(model"),
        (lambda: ss.simulate(MODEL, AIRCRAFT, FLIGHT, instruments={}), "needs Instruments.*\n.*a dict", "noise={"),
        (lambda: ss.trim("model.json", AIRCRAFT, 45.0, 0.0), f"{NO_MODEL}.*\n.*a str", "AeroModel.from_json"),
        (lambda: ss.trim(MODEL, "a.toml", 45.0, 0.0), f"{NO_AIRCRAFT}.*\n.*a str", "Aircraft.from_toml"),
        (lambda: ss.trim(MODEL, AIRCRAFT, "45", 0.0), r"needs V as a number \[m/s\].*\n.*a str", "order is trim"),
        (lambda: ss.trim(MODEL, AIRCRAFT, 45.0, [0.0]), r"needs h as a number \[m\].*\n.*a list", "order is trim"),
        (lambda: ss.linearise(AIRCRAFT, MODEL, None), f"{NO_MODEL}.*\n.*Aircraft", "order is linearise"),
        (lambda: ss.linearise(MODEL, AIRCRAFT, 45.0), "needs a Trim.*\n.*a float", "trim(model, aircraft, V, h)"),
        (lambda: ss.design_inputs(MODEL, noise={}), "needs a LinearModel.*\n.*AeroModel", "linearise(model"),
        (lambda: ss.compare_inputs("m", noise={}, energy=1.0), "needs a LinearModel.*\n.*a str", "linearise(model"),
        (lambda: ss.refine(MODEL, "a.toml", [FLIGHT]), f"{NO_AIRCRAFT}.*\n.*a str", "Aircraft.from_toml"),
        (
            lambda: ss.refine("model.json", AIRCRAFT, [FLIGHT]),
            "refine takes a LinearModel.*of type str",
            "LinearStructure",
        ),
        (lambda: ss.qualify(MODEL, AIRCRAFT, "m1.csv"), "needs recordings.*\n.*a str", "read_recording"),
        (lambda: ss.qualify(MODEL, AIRCRAFT, FLIGHT, corrected="m"), "as corrected model.*\n.*a str", "from_json"),
        (lambda: ss.frequency_response("m1.csv", "q", "de"), "needs recordings.*\n.*a str", "read_recording"),
        (lambda: ss.fit_transfer_function(FLIGHT, "q/de"), "needs a FrequencyResponse.*\n.*", "frequency_response("),
        (lambda: ss.export_model(chosen(), "m.c"), f"{NO_MODEL}.*\n.*a Selection", "Pass its .model"),
        (lambda: ss.write_recording(MODEL, "m.csv"), f"{NO_RECORDING}.*\n.*AeroModel", "first argument"),
        (lambda: ss.AeroModel.from_terms(["alpha"]), "needs the values of terms by response", '{"CZ": {'),
        (lambda: ss.resimulate(AIRCRAFT, MODEL, FLIGHT), f"{NO_MODEL}.*\n.*Aircraft", "order is resimulate"),
        (lambda: ss.validate(FLIGHT, MODEL), "needs recordings.*\n.*AeroModel", "first argument"),
        (lambda: ss.validate(chosen(), FLIGHT), f"{NO_MODEL}.*\n.*a Selection", "Pass its .model"),
        (lambda: ss.validate(None, FLIGHT), f"{NO_MODEL}.*\n.*NoneType", "order is validate"),
        (lambda: ss.compare(MODEL, FLIGHT, "a.toml"), f"{NO_AIRCRAFT}.*\n.*a str", "Aircraft.from_toml"),
        (lambda: ss.compare(np.zeros(9), FLIGHT), "needs a simulation.*type ndarray", "order is compare"),
        (lambda: ss.compare([FLIGHT], [FLIGHT]), "needs a simulation.*type list", "recordings by name"),
        (lambda: ss.diagnose(None, FLIGHT, AIRCRAFT), "needs a simulation.*type NoneType", "order is diagnose"),
        (lambda: ss.diagnose(chosen(), FLIGHT, AIRCRAFT), "needs a simulation.*type Selection", "Pass its .model"),
    ],
)
def test_a_wrong_call_is_a_type_error_that_says_what_to_pass(call, says, remedy):
    with pytest.raises(TypeError, match=says) as raised:
        call()
    assert isinstance(raised.value, ArgumentError)
    *_, last = str(raised.value).splitlines()
    assert remedy in last
    assert str(raised.value).count("\n") <= 2


@pytest.mark.parametrize("verb", [ss.compare, ss.diagnose])
def test_a_model_in_the_place_of_the_recordings_is_refused(verb):
    recordings, aircraft = [FLIGHT], AIRCRAFT
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


@pytest.mark.parametrize("kind", MAKERS)
def test_a_result_survives_a_pickle_and_a_deep_copy_and_is_short_at_the_prompt(kind):
    one = made(kind)
    assert type(one).__name__ == kind
    for again in (pickle.loads(pickle.dumps(one)), copy.deepcopy(one)):
        assert type(again) is type(one)
        if isinstance(one, Summarised):  # else the text may have the address of an object
            assert str(again) == str(one)
        if isinstance(one, Result):
            pd.testing.assert_frame_equal(again.to_frame(), one.to_frame())
            assert_same_content(again, one)
    assert len(repr(one)) < 400
    assert "\n" not in repr(one) or not isinstance(one, Summarised)


def assert_same_content(found, expected):
    """Arrays and mappings of a result are equal, and as read-only as they were."""
    for name, value in vars(expected).items():
        again = getattr(found, name)
        if isinstance(value, np.ndarray):
            assert_array_equal(again, value)
            assert again.flags.writeable <= value.flags.writeable
        elif isinstance(value, MappingProxyType):
            assert isinstance(again, MappingProxyType)
            assert list(again) == list(value)


def test_every_public_type_is_among_those_that_are_copied():
    not_copied = {"JSBSimAircraft"}  # has the simulation of JSBSim, which runs in this process
    public = {name for name in ss.__all__ if isinstance(getattr(ss, name), type)}
    assert public - not_copied <= set(MAKERS)


def test_a_model_with_states_is_pickled():
    effect = ss.model.State("lag", "de", {"tau": ss.model.Quantity(0.3, 0.02, "s")})
    model = ss.model.ResponseModel(["1", "de_lagged"], np.array([0.02, -1.5]), states={"de_lagged": effect})
    again = pickle.loads(pickle.dumps(model))
    assert_array_equal(again.evaluate(recording_of()), model.evaluate(recording_of()))


def recording_of():
    return ss.Recording.from_frame(frame())


def test_a_pickled_selection_is_without_its_recordings_and_takes_them_again():
    complete = chosen()
    again = pickle.loads(pickle.dumps(complete))
    assert len(pickle.dumps(complete)) < 0.5 * len(pickle.dumps(complete.data))
    assert again.data == ()
    assert again.predict(frame()).equals(complete.predict(frame()))
    with pytest.raises(SelectionError, match=r"it was pickled.*\n.*with_recordings"):
        again.resid  # noqa: B018
    assert again.with_recordings(frame()).resid.equals(complete.resid)
    with pytest.raises(SelectionError, match="of the recordings recording, and was given m2"):
        again.with_recordings(ss.Recording.from_frame(frame(), name="m2"))
    for copied in (copy.copy(complete), copy.deepcopy(complete)):  # in one process nothing is lost
        assert copied.resid.equals(complete.resid)


@pytest.mark.parametrize(
    ("kind", "arguments"),
    [
        ("Selection", ()),
        ("Selections", ("Cm",)),
        ("Recording", ("alpha",)),
        ("Reconstruction", ()),
        ("Resimulation", ("Recording", "q")),
        ("AeroModel", ("Cm",)),
        ("ResponseModel", ()),
        ("EquationError", ()),
        ("LinearModel", ()),
        ("Validation", ("Cm",)),
        ("Ensemble", ("Cm",)),
        ("RecursiveEstimate", ()),
    ],
)
def test_a_result_plots_itself_on_the_axes_that_are_given(kind, arguments):
    figure, ax = plt.subplots()
    names = [made(one).name if one == "Recording" else one for one in arguments]
    assert made(kind).plot(*names, ax=ax) is ax
    assert ax.has_data()
    plt.close(figure)


@pytest.mark.parametrize(("kind", "count"), [("FrequencyResponse", 3), ("TransferFunction", 2)])
def test_a_bode_plot_is_drawn_on_the_figure_that_is_given(kind, count):
    figure = plt.figure()
    drawn = made(kind).plot(ax=figure)
    assert list(drawn) == figure.axes
    assert len(drawn) == count
    plt.close(figure)


def test_a_result_without_a_figure_says_which_have_one():
    for kind, remedy in (("Candidates", "plot the Selection"), ("Trim", "plot the modes of linearise")):
        with pytest.raises(ArgumentError, match=rf"no figure for a {kind}\.\n.*{remedy}"):
            ss.plotting.plot(made(kind))
    with pytest.raises(ArgumentError, match=r"no figure for a LinearStructure\.\nIt has figures for .*Selection"):
        ss.plotting.plot(made("LinearStructure"))


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
