"""The explorer: residuals with one term or effect more, views that open again, and the page in a real browser."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import statsmodels.api as sm
from numpy.testing import assert_allclose

import structsel as ss
from structsel.cli import explore as command
from structsel.errors import DataError, StructselError
from structsel.exploring.exploration import compute_view, explore_model
from structsel.exploring.trials import EffectTrials, TermTrials
from structsel.exploring.view import View, read_view, write_view
from tests.commands import run

DT = 0.05


def recording(k, n=600):
    """Cm = 0.05 - 0.5 alpha - 1.5 de + 8 (alpha - 0.1)^2 + noise, CZ = -0.3 - 4 alpha + noise."""
    rng = np.random.default_rng([37, k])
    t = DT * np.arange(n)
    alpha, de = 0.1 + 0.05 * np.sin(0.9 * t + k), 0.05 * np.sign(np.sin(1.3 * t + k))
    Cm, CZ = 0.05 - 0.5 * alpha - 1.5 * de + 8.0 * (alpha - 0.1) ** 2, -0.3 - 4.0 * alpha
    noise = 0.004 * rng.standard_normal((2, n))
    return ss.Recording(f"m{k}", t, {"alpha": alpha, "de": de, "Cm": Cm + noise[0], "CZ": CZ + noise[1]})


RECORDINGS = [recording(k) for k in range(4)]
MODEL = ss.AeroModel.from_terms({"Cm": {"1": 0.05, "alpha": -0.5, "de": -1.5}, "CZ": {"1": -0.3, "alpha": -4.0}})
POOL = ss.Candidates.parse(["alpha^2", "alpha*de", "de^2", "de^3"])


def exploration():
    return explore_model(MODEL, RECORDINGS, POOL)


# --- numbers -----------------------------------------------------------------------------------------


def test_residuals_without_and_with_a_term_are_those_of_least_squares_on_all_recordings():
    alpha, de, Cm = (np.concatenate([r[name] for r in RECORDINGS]) for name in ("alpha", "de", "Cm"))
    shown = TermTrials(MODEL, RECORDINGS, POOL).residuals("Cm", "alpha", ["m1", "m3"], "alpha^2")
    assert [s.name for s in shown] == ["m1", "m3"]
    chosen = np.repeat([False, True, False, True], 600)
    for name, columns in (("without", [alpha, de]), ("with_it", [alpha, de, alpha**2])):
        expected = sm.OLS(Cm, sm.add_constant(np.column_stack(columns))).fit().resid[chosen]
        assert_allclose(np.concatenate([getattr(s, name) for s in shown]), expected, atol=1e-10)


def test_the_table_of_terms_has_partial_F_and_the_change_of_R2():
    alpha, de, Cm = (np.concatenate([r[name] for r in RECORDINGS]) for name in ("alpha", "de", "Cm"))
    before, after = (
        sm.OLS(Cm, sm.add_constant(np.column_stack(x))).fit() for x in ([alpha, de], [alpha, de, alpha**2])
    )
    (table,) = TermTrials(MODEL, RECORDINGS, POOL).summary("Cm", "alpha^2").tables
    row = dict(zip([column.name for column in table.columns][:4], table.rows[1]))
    assert row["term"] == "alpha^2"
    assert_allclose(row["F"], after.compare_f_test(before)[0], rtol=1e-6)
    assert_allclose(table.rows[1][4], after.rsquared - before.rsquared, rtol=1e-9)


def test_a_view_has_the_best_term_first_and_its_spectrum_is_that_of_the_residual():
    one = exploration()
    assert one.trials["term"].names("Cm")[0] == "alpha^2"
    data = compute_view(one, View(kind="term", added="alpha^2"))
    assert (data.view.response, data.view.channel) == ("Cm", "alpha")
    assert data.x_label == "alpha [deg]"
    # White noise of standard deviation s has the one-sided density 2 s^2 dt; 0.3 allows for 4 times 6 segments.
    assert_allclose(np.median(data.density_with[2:]), 2.0 * 0.004**2 * DT, rtol=0.3)
    low = data.frequency < 0.5  # twice the frequency of alpha is 0.29 Hz
    assert data.density[low].max() > 5.0 * data.density_with[low].max()
    assert data.words.startswith("Residual of Cm in 4 recordings: rms 0.00")
    assert "with alpha^2" in data.words


def test_recordings_of_unequal_sampling_intervals_have_no_spectrum():
    slow = RECORDINGS[1]
    slow = ss.Recording("slow", 2.0 * slow.t, dict(slow.channels))
    data = compute_view(explore_model(MODEL, [RECORDINGS[0], slow], POOL), View())
    assert data.frequency.size == 0
    assert len(data.series) == 2


@pytest.mark.slow
def test_an_effect_takes_out_of_the_difference_what_the_simulation_lacks():
    from structsel.demo import demo_missing_physics

    case = demo_missing_physics("cross-coupling", flights=3)
    trials = EffectTrials(case.simulation, case.recordings, case.aircraft)
    assert trials.names("Cn")[0] == "cross-coupling"
    value = case.terms["Cn"]["alpha*p_hat"]
    for flight, s in zip(trials.flights, trials.residuals("Cn", "alpha", ["m01", "m02", "m03"], "cross-coupling")):
        lacking = value * flight["alpha"] * flight["p_hat"]
        taken = s.without - s.with_it
        # The estimate differs from -0.8 by its error and by what the tolerances take of the difference.
        assert np.corrcoef(taken, lacking)[0, 1] > 0.999
        assert_allclose(np.std(taken), np.std(lacking), rtol=0.1)
    assert "cross-coupling" in str(trials.summary("Cn", "").tables[0].rows[0])


# --- views -------------------------------------------------------------------------------------------


def test_a_view_is_read_as_it_was_written(tmp_path):
    view = View(("m1",), "CZ", "de", "term", "de^2", 9, 1.5, None)
    write_view(view, {"model": "model.json"}, tmp_path / "one.json")
    assert read_view(tmp_path / "one.json") == (view, {"model": "model.json"})


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"schema": "structsel.view/1", "source": {}, "view": 3}'])
def test_a_file_that_is_no_view_is_refused(text, tmp_path):
    (tmp_path / "one.json").write_text(text)
    with pytest.raises(DataError, match="is not a saved view"):
        read_view(tmp_path / "one.json")


@pytest.mark.parametrize(
    ("view", "says"),
    [
        (View(response="Cl"), "response 'Cl', which is not here. There are: Cm, CZ"),
        (View(channel="beta"), "channel 'beta'"),
        (View(recordings=("m9",)), "recording 'm9'"),
        (View(kind="effect", added="ground-effect"), "kind of addition 'effect'"),
    ],
)
def test_a_view_of_what_is_not_there_is_refused(view, says):
    with pytest.raises(DataError, match=says):
        exploration().complete(view)


def test_a_saved_view_is_a_file_a_page_without_network_and_a_picture(tmp_path):
    pytest.importorskip("bokeh", reason="needs the extra 'explore'")
    from structsel.exploring.saving import save_view

    view = View(kind="term", added="alpha^2")
    paths = save_view(exploration(), view, {"model": "m.json"}, tmp_path / "views", "pitch 1")
    assert [p.name for p in paths] == ["pitch 1.json", "pitch 1.html", "pitch 1.png"]
    assert read_view(paths[0])[0] == view
    page = paths[1].read_text()
    assert re.findall(r"<(?:script|link)[^>]*\s(?:src|href)=[^>]*>", page) == []
    assert "with alpha^2" in page
    assert paths[2].read_bytes().startswith(b"\x89PNG")
    for name in ("../out", "", ".hidden", "a/b"):
        with pytest.raises(DataError, match="not a name for a view"):
            save_view(exploration(), view, {}, tmp_path, name)


def test_the_server_answers_this_computer_only():
    pytest.importorskip("bokeh", reason="needs the extra 'explore'")
    from structsel.exploring.server import make_server

    server, address = make_server(exploration(), View(), {}, Path("views"))
    try:
        assert re.fullmatch(r"http://localhost:\d+/", address)
        assert {s.getsockname()[0] for s in server._http._sockets.values()} <= {"127.0.0.1", "::1"}
        assert server._tornado.websocket_origins == {address.removeprefix("http://").rstrip("/")}
    finally:
        server.stop()


# --- the command -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder of structsel select, with the recordings that it was made from beside it."""
    place = tmp_path_factory.mktemp("explorer")
    (place / "rec").mkdir()
    for one in RECORDINGS:
        ss.write_recording(one, place / "rec" / f"{one.name}.csv")
    options = ("--responses", "Cm,CZ", "--candidates", "alpha,de", "--include", "alpha", "--bootstrap", 0, "--no-plots")
    run("select", place / "rec", *options, "--cut", "0:20", "--out", place / "out")
    return place


@pytest.fixture
def opened(monkeypatch):
    """What the command opens, without a server."""
    pytest.importorskip("bokeh", reason="needs the extra 'explore'")
    from structsel.exploring import server

    found = []
    monkeypatch.setattr(server, "make_server", lambda *given: (found.append(given), (None, "http://localhost:1/"))[1])
    monkeypatch.setattr(server, "serve", lambda one, started: started())
    return found


def test_a_result_is_opened_with_the_recordings_it_was_made_from(folder, opened):
    request = json.loads((folder / "out" / "model.json").read_text())["provenance"]["request"]
    assert request == {"recordings": [str(folder / "rec")], "cut": ["0:20"]}
    result = run("explore", folder / "out", "--no-browser")
    assert "Model, 4 recordings: http://localhost:1/" in result.stdout
    ((found, view, source, views),) = [given[:4] for given in opened]
    assert found.names == ("m0", "m1", "m2", "m3")
    assert found.recordings[0].t[-1] == 20.0
    assert found.trials["term"].names("Cm")[0] == "alpha^2"
    assert (view.response, views) == ("Cm", folder / "out" / "views")
    assert source["model"] == str(folder / "out" / "model.json")


def test_of_several_methods_the_default_one_is_opened_and_the_others_are_named(folder, opened):
    options = ("--responses", "Cm", "--candidates", "alpha,de", "--bootstrap", 0, "--no-plots")
    run("select", folder / "rec", *options, "--method", "all", "--out", folder / "all")
    result = run("explore", folder / "all", "--no-browser")
    assert opened[0][2]["model"] == str(folder / "all" / "model_stepwise.json")
    said = " ".join(result.stderr.split())
    assert "the model is model_stepwise.json. Give " in said
    assert all(f"model_{one}.json" in said for one in ("orthogonal", "best_subset", "stepwise_white"))
    run("explore", folder / "all" / "model_orthogonal.json", "--no-browser")
    assert opened[1][2]["model"] == str(folder / "all" / "model_orthogonal.json")


def test_other_recordings_and_a_saved_view_are_opened(folder, opened, tmp_path):
    run("explore", folder / "out", "--no-browser", "--recordings", folder / "rec" / "m2.csv", "--candidates", "alpha")
    first = opened[0]
    assert first[0].names == ("m2",)
    assert first[0].trials["term"].names("Cm") == ["alpha^2"]
    write_view(View(("m2",), "CZ", "de", "term", "de^2"), first[2], tmp_path / "one.json")
    run("explore", tmp_path / "one.json", "--no-browser")
    assert opened[1][0].names == ("m2",)
    assert opened[1][1] == View(("m2",), "CZ", "de", "term", "de^2")
    assert opened[1][3] == tmp_path


def test_recordings_that_were_changed_or_are_gone_are_reported(folder, opened, tmp_path):
    content = json.loads((folder / "out" / "model.json").read_text())
    model = tmp_path / "model.json"
    content["provenance"]["inputs"][0]["sha256"] = "0" * 64
    model.write_text(json.dumps(content))
    assert "m0.csv' was changed since" in run("explore", model, "--no-browser").stderr
    content["provenance"]["request"]["recordings"] = [str(tmp_path / "gone")]
    model.write_text(json.dumps(content))
    assert "give --recordings FILES" in run("explore", model, "--no-browser", code=1).stderr
    del content["provenance"]["request"]
    model.write_text(json.dumps(content))
    assert "does not say which recordings" in run("explore", model, "--no-browser", code=1).stderr
    assert "neither model.json nor diagnosis.json" in run("explore", tmp_path / "no", "--no-browser", code=1).stderr


def test_without_bokeh_it_says_how_to_get_it(monkeypatch, folder):
    monkeypatch.setitem(sys.modules, "bokeh", None)
    result = run("explore", folder / "out", "--no-browser", code=1)
    assert 'pip install "structsel[explore]"' in " ".join(result.stderr.split())
    from structsel.exploring.server import require_bokeh

    with pytest.raises(StructselError, match="needs the package bokeh"):
        require_bokeh()


def test_neither_the_package_nor_the_command_line_imports_bokeh():
    code = "import sys, structsel.cli.explore; structsel.explore_residuals; print('bokeh' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "False\n"
    assert command.EPILOG
