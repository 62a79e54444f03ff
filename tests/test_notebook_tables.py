"""What a notebook shows of a result is a table with its caption, and whatever comes from a file is escaped."""

import copy
import pickle
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

import structsel as ss
from structsel.results import Summarised
from structsel.tables import Summary, table_of_frame
from tests.diagnoses import diagnosis, hostile

BAD = '<script>alert("x")</script>'


def read(html):
    """The fragment as a tree; a stray or unclosed tag does not parse."""
    return ElementTree.fromstring(f"<div>{html}</div>")


def cells(html):
    """Texts of the table, row by row, its head first."""
    return [[cell.text or "" for cell in row] for row in read(html).iter("tr")]


def recording(name="m1", channel="alpha"):
    t = np.arange(0.0, 20.0, 0.05)
    alpha = 0.1 + 0.05 * np.sin(t)
    noise = 0.001 * np.random.default_rng(1).standard_normal(t.size)
    return ss.Recording(name, t, {channel: alpha, "Cm": 0.1 - 0.5 * alpha + noise})


def to_html(frame, title, notes=()):
    return Summary(title, tables=(table_of_frame(pd.DataFrame(frame)),), notes=tuple(notes)).to_html()


def test_a_table_has_a_caption_a_head_and_a_row_for_each_row():
    html = to_html({"term": ["1", "alpha"], "value": [0.123456789, np.nan]}, "Cm", ["doubtful"])
    assert read(html).find("table/caption").text == "Cm"
    assert cells(html) == [["term", "value"], ["1", "0.1235"], ["alpha", "\N{EN DASH}"]]
    assert [note.text for note in read(html).iter("li")] == ["doubtful"]


def test_words_are_aligned_left_and_numbers_right():
    html = to_html([{"name": "m1", "trusted": True, "n": 3, "nis": 1.0, "why": None}], "")
    assert cells(html)[1] == ["m1", "yes", "3", "1", "\N{EN DASH}"]
    aligned = [cell.get("style") for cell in read(html).iter("td")]
    assert ["right" in style for style in aligned] == [False, False, True, True, False]


def test_a_long_table_is_cut_and_says_by_how_much():
    html = to_html({"x": np.arange(100)}, "long")
    assert len(cells(html)) == 61
    assert "40 more rows" in html


def test_nothing_to_list_is_a_caption_alone():
    assert cells(Summary("an aircraft").to_html()) == []


def test_captions_heads_cells_and_notes_are_escaped():
    html = to_html({BAD: [BAD]}, BAD, [BAD])
    assert "<script" not in html
    assert cells(html) == [[BAD], [BAD]]
    assert [read(html).find(place).text for place in ("table/caption", "ul/li")] == [BAD, BAD]


def test_names_from_a_hostile_file_do_no_harm():
    flight = recording(BAD, channel=BAD)
    for result in (flight, hostile()):
        html = result._repr_html_()
        assert "<script" not in html
        assert "&lt;script" in html
        read(html)


def test_every_result_with_a_table_shows_it_in_a_notebook():
    results = [thing for name in ss.__all__ if isinstance(thing := getattr(ss, name), type)]
    tables = [kind for kind in results if hasattr(kind, "to_frame")]
    assert len(tables) > 12
    assert [kind.__name__ for kind in tables if not hasattr(kind, "_repr_html_")] == []


@pytest.fixture(scope="module")
def selections():
    return ss.select([recording("m1"), recording("m2")], ["Cm"], ss.Candidates(["alpha", "alpha^2"]), bootstrap=0)


def test_a_selection_shows_its_parameters_under_what_it_prints_first(selections):
    one = selections["Cm"]
    html = one._repr_html_()
    assert read(html).find("table/caption").text.splitlines()[0] == str(one).splitlines()[0]
    assert [row[0] for row in cells(html)] == ["term", "1", *map(str, one.terms)]


def test_a_recording_shows_each_channel_with_its_unit_and_range():
    html = recording()._repr_html_()
    assert cells(html)[0] == ["channel", "unit", "min", "mean", "max"]
    name, unit, low, _, high = cells(html)[1]
    assert (name, unit) == ("alpha", "rad")
    # 0.1 + 0.05 sin t, over three turns.
    assert (float(low), float(high)) == (pytest.approx(0.05, abs=1e-4), pytest.approx(0.15, abs=1e-4))


def test_models_validations_and_diagnoses_show_what_they_are(selections):
    model, one_recording = selections.model, recording()
    for result, count in (
        (selections, len(model["Cm"].terms)),
        (model, len(model["Cm"].terms)),
        (model["Cm"], len(model["Cm"].terms)),
        (ss.validate(model, one_recording), 1),
        (ss.ensemble([model, model]), len(model["Cm"].terms)),
        (diagnosis(), 1),
        (ss.Candidates(["alpha", "de"]), 2),
    ):
        html = result._repr_html_()
        assert len(cells(html)) == 1 + count
        assert read(html).find("table/caption").text
    assert "ground-effect" in diagnosis()._repr_html_()


def test_aircraft_trims_and_inputs_show_what_they_are():
    aircraft = ss.published_aircraft("citation")
    steady = aircraft.trim(V=120.0, h=7500.0)
    assert "V 120 m/s" in steady._repr_html_()
    assert ["theta", "rad"] in [row[:3:2] for row in cells(steady._repr_html_())]
    assert aircraft.aircraft.name in aircraft.aircraft._repr_html_()
    assert aircraft.aircraft.name in aircraft._repr_html_()
    linear = aircraft.linearise(steady, inputs=["de"])
    assert [row[0] for row in cells(linear._repr_html_())][1 : 1 + len(linear.parameters)] == list(linear.parameters)


@pytest.mark.parametrize("name", ["selections", "selection", "model", "response", "validation", "recording", "pool"])
def test_a_result_is_one_line_at_the_prompt_and_survives_a_copy_and_another_process(selections, name):
    model = selections.model
    results = {"selections": selections, "selection": selections["Cm"], "model": model, "response": model["Cm"],
               "validation": ss.validate(model, recording()), "recording": recording(),
               "pool": ss.Candidates(["alpha", "de"])}  # fmt: skip
    one = results[name]
    assert len(repr(one)) < 200
    assert "\n" not in repr(one)
    for again in (copy.deepcopy(one), pickle.loads(pickle.dumps(one))):
        assert str(again) == str(one)


def test_every_public_result_has_a_summary():
    kinds = [kind for name in ss.__all__ if isinstance(kind := getattr(ss, name), type) and hasattr(kind, "to_frame")]
    assert [kind.__name__ for kind in kinds if not issubclass(kind, Summarised)] == []
