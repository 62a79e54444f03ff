"""A report shows which values changed since an earlier result, or since the file of one."""

import json
from dataclasses import replace

import pytest

from structsel.errors import ArgumentError, DataError
from structsel.recording import write_recording
from structsel.report import render
from tests.commands import run
from tests.diagnoses import GROUND, VANE, diagnosis
from tests.report_pages import manoeuvre, reconstructed, refined, selected
from tests.test_report import Page


def test_a_selection_shows_its_held_out_score_and_the_terms_that_came_and_went():
    found = selected()[0]["CZ"]
    # Of CZ = -4.58 alpha: before with another score and without the term.
    first = {
        name: getattr(found, name)[:1]
        for name in ("values", "standard_errors", "textbook_errors", "error_dof", "partial_F")
    }
    before = replace(found, terms=(), vif=found.vif[:0], covariance=found.covariance[:1, :1], held_out_r2=0.5, **first)
    stated = Page(render(found, before=before)).words()
    value, std = found.values[1], found.standard_errors[1]
    assert f"CZ R², held-out 0.5000 {found.held_out_r2:.4f} CZ terms 0 1 CZ alpha - {value:.3f} ± {std:.3f}" in stated
    # The constant and the rms error are equal.
    assert "3 values differ from the result before, 2 do not." in stated


def test_a_diagnosis_shows_the_effect_that_is_gone():
    stated = Page(render(diagnosis(GROUND), before=diagnosis(GROUND, VANE))).words()
    assert "sensor-scale probability 52 % -" in stated
    assert "ground-effect probability" not in stated
    assert "0 values differ from the result before" in Page(render(diagnosis(), before=diagnosis())).words()


@pytest.mark.parametrize("result", [lambda: refined()[0], reconstructed], ids=["refinement", "reconstruction"])
def test_an_equal_result_has_no_change(result):
    stated = Page(render(result(), before=result())).words()
    assert "0 values differ from the result before" in stated


def test_a_refined_parameter_is_shown_before_and_now():
    found = refined()[0]
    first = found.estimates[1]
    moved = replace(found, estimates=(found.estimates[0], replace(first, value=-0.7), *found.estimates[2:]))
    stated = Page(render(found, before=moved)).words()
    assert "1 value differs from the result before" in stated
    assert f"parameters {first.name} -0.7000 ± {first.std:.4f} {first.value:.4f} ± {first.std:.4f}" in stated


def test_the_file_of_a_result_does_as_well(tmp_path):
    path = tmp_path / "selection.json"
    found = selected()[0]
    path.write_text(json.dumps(found.to_dict()))
    assert "0 values differ from the result before" in Page(render(found, before=path)).words()


def test_the_command_compares_with_the_file_of_an_earlier_run_and_checks_it_first(tmp_path):
    (tmp_path / "flights").mkdir()
    for k in range(2):
        write_recording(manoeuvre(k), tmp_path / "flights" / f"m{k + 1:02d}.csv")
    asked = ("select", tmp_path / "flights", "--responses", "Cm", "--bootstrap", 0, "--no-plots")
    run(*asked, "--candidates", "alpha", "--degree", 1, "--out", tmp_path / "first")
    earlier = tmp_path / "first" / "selection.json"
    run(*asked, "--candidates", "alpha,de,q_hat", "--degree", 1, "--out", tmp_path / "second", "--before", earlier)
    stated = Page((tmp_path / "second" / "report.html").read_text()).words()
    assert "Cm terms 1 3" in stated
    wrong = run(*asked, "--candidates", "alpha", "--before", tmp_path / "first" / "model.json", code=1)
    assert "cannot be compared with this result" in " ".join(wrong.stderr.split())


def test_what_cannot_be_compared_is_refused(tmp_path):
    with pytest.raises(ArgumentError, match="compares a Diagnosis with another one; before= is a Selections"):
        render(diagnosis(), before=selected()[0])
    path = tmp_path / "model.json"
    path.write_text('{"schema": "structsel.model/1"}')
    with pytest.raises(DataError, match=r"its schema is 'structsel.model/1', not 'structsel.diagnosis'"):
        render(diagnosis(), before=path)
    path.write_text("[]")
    with pytest.raises(DataError, match="is no JSON file of a result"):
        render(diagnosis(), before=path)
