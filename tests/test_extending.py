"""What may be added from outside the package: a toy of each kind."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from structsel import read_recording, write_report
from structsel.candidates import Candidates, Term
from structsel.cli import app
from structsel.cli.messages import stdout
from structsel.cli.tables import print_summary
from structsel.demo import demo_missing_physics
from structsel.diagnosis import diagnose
from structsel.effects import EFFECTS, Effect, EffectParameter, Variant
from structsel.errors import DataError, DomainError, SelectionError
from structsel.metrics import metric, remove_metric
from structsel.model import AeroModel, ResponseModel
from structsel.readers import READERS
from structsel.readers.table import table_from_arrays
from structsel.recording import Recording, write_recording
from structsel.report.selection import describe_method
from structsel.selection import select
from structsel.selection.methods import METHODS, SelectionMethod, VisitedModels
from structsel.validation import validate

from .flights import fly

# --- a metric -------------------------------------------------------------------------------------


@pytest.fixture
def within_a_tenth():
    @metric(label="within 10 %", best=1.0)
    def within_a_tenth(measured, modelled):
        """Fraction of the samples within a tenth of the measured range."""
        return np.mean(np.abs(measured - modelled) <= 0.1 * np.ptp(measured))

    yield within_a_tenth
    remove_metric("within_a_tenth")


def test_a_metric_from_outside_stands_in_every_table_and_file_of_a_validation(within_a_tenth, capsys):
    alpha = np.linspace(-0.1, 0.3, 200)
    noise = 0.05 * np.random.default_rng(1).standard_normal(200)
    recording = Recording("m01", 0.02 * np.arange(200), {"alpha": alpha, "Cm": 0.1 - alpha + noise})
    found = validate(AeroModel({"Cm": ResponseModel(("1", "alpha"), [0.1, -1.0])}), recording)
    expected = within_a_tenth(recording["Cm"], 0.1 - alpha)
    assert 0.0 < expected < 1.0
    assert found.score("Cm").within_a_tenth == expected
    assert found.to_dict()["pooled"][0]["within_a_tenth"] == expected
    assert found.to_frame()["within_a_tenth"].iloc[0] == expected
    assert "within 10 %" in str(found)
    assert f"{expected:.4f}" in str(found)
    print_summary(stdout(), found.summary())
    printed = capsys.readouterr().out
    assert "within" in printed
    assert f"{expected:.4f}" in printed


def test_two_metrics_of_one_name_are_refused(within_a_tenth):
    with pytest.raises(DomainError, match="metric 'within_a_tenth' already"):
        metric(label="again", best=1.0)(within_a_tenth)


# --- an effect ------------------------------------------------------------------------------------


def _tab_forms(flights):
    """A tab on the elevator, geared to the pitch attitude: one form, one parameter."""

    def columns(flight):
        return {"Cm": (flight["theta"] * flight["alpha"])[:, None]}

    gearing = EffectParameter("gearing", "1/rad^2", sd=0.5)
    return [Variant((gearing,), columns, about="a geared tab", terms=("theta*alpha",))]


TAB = Effect(
    "toy-tab",
    "static",
    "A tab moves with the pitch attitude.",
    needs=lambda flights: "" if all("theta" in f for f in flights) else "pitch attitude",
    variants=_tab_forms,
    says=lambda found: f"A tab is geared to the attitude, by {found.text('gearing')}.",
    look_alikes=("missing-term",),
)


def test_an_effect_from_outside_is_named_and_enters_model_text_json_and_report(tmp_path):
    case = demo_missing_physics("", flights=3)
    simulated = {
        r.name: s.with_channels(Cm=s["Cm"] - 0.8 * r["theta"] * r["alpha"])
        for r, s in ((r, case.simulated[r.name]) for r in case.recordings)
    }
    usual = [e for e in EFFECTS if e.name in ("asymmetry", "ground-effect", "wrong-derivative")]
    found = diagnose(simulated, case.recordings, case.aircraft, effects=[*usual, TAB])
    first = found.findings[0]
    assert (found.verdict, first.effect, first.axes) == ("mismatch", "toy-tab", ("Cm",))
    gearing = first.physics[0].parameters["gearing"]
    assert abs(gearing.value - 0.8) < 4.0 * gearing.std
    assert Term("theta*alpha") in found.model.responses["Cm"].terms
    assert "toy-tab" in str(found)
    assert found.to_dict()["findings"][0]["physics"][0]["effect"] == "toy-tab"
    write_report(found, tmp_path / "report.html")
    assert "toy-tab" in (tmp_path / "report.html").read_text(encoding="utf-8")


# --- a selection method ---------------------------------------------------------------------------


@pytest.fixture
def single_best(monkeypatch):
    """The single candidate that correlates most with the response, from outside the package."""

    def search(problem):
        C = problem.products
        explained = C[:-1, -1] ** 2 / np.diag(C)[:-1]
        order = np.argsort(explained)[::-1][: problem.options.max_terms]
        models = [((), problem.tss), *(((int(j),), problem.tss - explained[j]) for j in order)]
        return VisitedModels(models, models[1], (), "one term is enough")

    method = SelectionMethod("single_best", "The single best term", search)
    monkeypatch.setitem(METHODS, "single_best", method)
    return method


def test_a_method_from_outside_is_an_option_of_select_with_its_errors_warnings_and_report(single_best):
    recordings = fly({"1": -0.3, "alpha": -4.0, "de": -0.2}, 0.03, lengths=(600, 500, 700))
    pool = Candidates.polynomial(["alpha", "q_hat", "de"], 2)
    selections = select(recordings, "CZ", pool, method="single_best", bootstrap=5)
    (term,) = selections.terms
    assert str(term) == "alpha"
    assert selections.standard_errors[1] > 0.0
    assert len(selections.held_out) == 3
    assert "1 of 9 candidate terms, single_best" in str(selections)
    chosen = select(recordings, "CZ", pool, method="single_best", criterion="BIC", max_terms=2, bootstrap=0)
    assert chosen.stop_reason == "least BIC of 3 models visited"
    assert "The single best term; " in describe_method(selections)[0]
    with pytest.raises(SelectionError, match="is not one of 'stepwise', 'orthogonal', 'best_subset', 'single_best'"):
        select(recordings, "CZ", pool, method="double_best")


def test_a_method_from_outside_is_known_to_the_command_line(single_best, tmp_path):
    for recording in fly({"1": -0.3, "alpha": -4.0}, 0.03, lengths=(600, 500)):
        write_recording(recording, tmp_path / f"{recording.name}.csv")
    asked = ["select", str(tmp_path), "--responses", "CZ", "--candidates", "alpha,de", "--bootstrap", "0", "--json"]
    result = CliRunner().invoke(app, [*asked, "--method", "single_best"])
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["responses"]["CZ"]["method"] == "single_best"
    result = CliRunner().invoke(app, [*asked, "--method", "double_best"])
    assert result.exit_code == 2
    assert "single_best" in result.output


# --- a reader -------------------------------------------------------------------------------------


def test_a_reader_from_outside_reads_files_of_its_suffix(tmp_path, monkeypatch):
    def read_recorder(path, options):
        alpha = [float(x) for x in path.read_text().split()]
        return table_from_arrays(str(path), {"t": np.arange(len(alpha)), "alpha": alpha})

    monkeypatch.setitem(READERS, ".recorder", read_recorder)
    (tmp_path / "m01.recorder").write_text("0.1 0.2 0.3")
    recording = read_recording(tmp_path / "m01.recorder")
    np.testing.assert_allclose(recording["alpha"], [0.1, 0.2, 0.3])
    (tmp_path / "m01.other").write_text("0.1 0.2 0.3")
    with pytest.raises(DataError, match=r"'\.other', which no reader knows"):
        read_recording(tmp_path / "m01.other")


def test_a_table_of_arrays_has_the_units_and_the_order_of_the_file():
    arrays = {
        "t": [0, 1],
        "name": "abc",
        "AoA": [1.0, 2.0],
        "V_kt": [3.0, 4.0],
        "acc": np.zeros((2, 2)),
        "odd": [[1], [1, 2]],
    }
    table = table_from_arrays(
        "m01", arrays, units={"AoA": "deg", "V_kt": "m/s", "acc": "g", "t": "volts per division"}, numbered=True
    )
    assert table.units == {"AoA": "deg", "V_kt": "m/s", "acc[1]": "g", "acc[2]": "g"}
    assert table.numbers == {1: "t", 2: "name", 3: "AoA", 4: "V_kt", 5: "acc[1]", 6: "acc[2]", 7: "odd"}
    assert table.unusable == {"name": "text or objects", "odd": "rows of different lengths"}
    assert table.notes == ("the unit of 't' cannot be read: 'volts per division'",)
    plain = table_from_arrays("m01", arrays)
    assert (plain.units, plain.numbers) == ({"V_kt": "kt"}, {})


@pytest.mark.parametrize(("arrays", "units"), [([1.0, 2.0], None), ({"t": [0.0, 1.0]}, ["s"])])
def test_a_table_of_arrays_without_names_is_refused(arrays, units):
    with pytest.raises(DataError, match=r"'m01' holds list where (columns|units) by name are needed: it is damaged"):
        table_from_arrays("m01", arrays, units=units)
