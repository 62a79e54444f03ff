"""What may be added from outside the package: a toy of each kind."""

import numpy as np
import pytest

from structsel import write_report
from structsel.candidates import Term
from structsel.cli.tables import print_validation
from structsel.cli.terminal import stdout
from structsel.demo import demo_missing_physics
from structsel.diagnosis import diagnose
from structsel.effects import EFFECTS, Effect, EffectParameter, Variant
from structsel.errors import DomainError
from structsel.metrics import metric, remove_metric
from structsel.model import AeroModel, ResponseModel
from structsel.recording import Recording
from structsel.validation import validate

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
    assert f"{expected:.3f}" in str(found)
    print_validation(stdout(), found, "model against 1 recording")
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
