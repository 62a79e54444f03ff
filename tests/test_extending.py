"""What may be added from outside the package: a toy of each kind."""

import numpy as np
import pytest

from structsel.cli.tables import print_validation
from structsel.cli.terminal import stdout
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
