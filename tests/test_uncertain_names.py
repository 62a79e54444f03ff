"""A name that leaves a residual in one response alone is uncertain: its cause may be that of the mismatch."""

import numpy as np
import pytest

import structsel as ss
from structsel.comparison.preparing import prepare
from structsel.diagnosis.isolated import IsolatedResidual
from structsel.diagnosis.uncertain_names import less_probable
from structsel.recording import Recording
from structsel.report import render
from tests.diagnoses import GROUND

UNSURE = IsolatedResidual("Cm", 0.036, 0.0)
NONE = IsolatedResidual("Cm", 0.005, 0.0)


def test_names_keep_the_probability_that_no_such_residual_is_there():
    assert 0.3 < UNSURE.probability < 0.7
    (found,) = less_probable([GROUND], UNSURE)
    before = {p.effect: p.probability for p in GROUND.physics}
    after = {p.effect: p.probability for p in found.physics}
    for name in before.keys() - {"unknown"}:
        assert after[name] == pytest.approx((1.0 - UNSURE.probability) * before[name])
    assert sum(after.values()) == pytest.approx(sum(before.values()))
    assert "unknown" in {found.effect, *found.ambiguous_with}
    assert list(after.values()) == sorted(after.values(), reverse=True)
    assert found.effect not in found.ambiguous_with


def test_a_name_that_the_unknown_cause_overtakes_is_a_tie():
    likely = IsolatedResidual("Cm", 0.0352, 0.0)
    assert 0.5 < likely.probability < 0.7
    (found,) = less_probable([GROUND], likely)
    assert found.effect == "unknown"
    assert GROUND.effect in found.ambiguous_with


@pytest.mark.parametrize("alone", [None, NONE])
def test_without_such_a_residual_findings_stay(alone):
    assert less_probable([GROUND], alone) == [GROUND]


def test_an_effectiveness_that_swings_with_time_has_no_name():
    """No effect explains it; one in CZ was named, whose evidence is the motion that it causes."""
    recordings, aircraft, truth = ss.demo_flights(4, turbulence=0.0)
    simulated = {}
    for k, f in enumerate(prepare(ss.AeroModel.from_terms(truth), recordings, aircraft, aligned=True).flights):
        swing = np.sin(2.0 * np.pi * 0.37 * (f.t + 7.3 * k)) * f["de"] / np.std(f["de"])
        less = f.simulated["Cm"] - 0.5 * f.measured["Cm"].std() * swing
        simulated[f.name] = Recording(f.name, f.t, {**f.simulated, "Cm": less})
    found = ss.diagnose(simulated, recordings, aircraft)
    assert [(f.effect, f.axes) for f in found.findings] == [("unknown", ("Cm",))]
    assert found.findings[0].probability > 0.9
    assert "The residual of Cm lasts as that of no other response does" in " ".join(str(found).split())
    # Nothing is corrected, so no error is one "with it"; in windows the pitch rate is off most, relative to its noise.
    assert "with it" not in str(found)
    assert "No effect explains the differences" in render(found)
    assert "with the effects" not in render(found).split("Time histories")[0]
    assert found.replayed.shown.channel == found.replayed.example.channel == "q"
