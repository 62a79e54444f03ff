"""The report: one file that needs nothing else, gives the result first, and escapes every name."""

import base64
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from numpy.testing import assert_allclose

from structsel.diagnosis.event import Event
from structsel.report import render, write_report
from structsel.report.chart_data import MAX_VALUES
from structsel.report.diagnosis_charts import figures_of
from tests.diagnoses import GROUND, TURBULENCE, VANE, diagnosis, hostile

VOID = {"meta", "br", "img", "input", "link", "hr"}


class Page(HTMLParser):
    """What a browser makes of a page: its tags, whether they close, its text and scripts."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.text, self.scripts, self.crossed = [], [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.crossed.append(tag)

    def handle_data(self, data):
        where = self.open[-1] if self.open else ""
        if where != "style" and "nav" not in self.open:
            (self.scripts if where == "script" else self.text).append(data)

    def words(self):
        return " ".join(" ".join(self.text).split())


@pytest.fixture(scope="module")
def two():
    return render(diagnosis(GROUND, VANE))


@pytest.fixture(scope="module")
def page(two):
    return Page(two)


ALL = {
    "one": lambda: diagnosis(),
    "two": lambda: diagnosis(GROUND, VANE),
    "consistent": lambda: diagnosis(verdict="consistent"),
    "turbulence": lambda: diagnosis(TURBULENCE, verdict="consistent"),
    "undecidable": lambda: diagnosis(verdict="undecidable", recordings=("m01",), traces={}, model=None),
    "empty": lambda: diagnosis(verdict="consistent", traces={}, deviations=(), remarks=(), remaining={}, detects={}),
    "unknown figures": lambda: diagnosis(
        replace(GROUND, explained=np.nan, explainable=np.nan, fraction=np.nan), remaining={"CZ": (np.nan, False)}
    ),
    "hostile": hostile,
}


@pytest.mark.parametrize("case", ALL)
def test_every_tag_closes_and_no_figure_is_printed_as_nan(case):
    made = Page(render(ALL[case]()))
    assert made.crossed == []
    assert made.open == []
    assert not re.search(r"\b(nan|inf|None)\b", made.words())


@pytest.mark.parametrize("case", ALL)
def test_nothing_is_fetched_from_anywhere(case):
    made = Page(render(ALL[case]()))
    for tag, attrs in made.tags:
        assert tag not in ("link", "iframe", "object", "embed", "base")
        assert not {"src", "action", "background"} & set(attrs)
        assert attrs.get("href", "#").startswith("#")
        assert not any(name.startswith("on") for name in attrs)
    policy = next(
        a["content"] for t, a in made.tags if t == "meta" and a.get("http-equiv") == "Content-Security-Policy"
    )
    assert "default-src 'none'" in policy
    for script in made.scripts:
        assert not re.search(r"\b(fetch|XMLHttpRequest|WebSocket|import|eval|innerHTML)\b", script)


def test_the_result_comes_first_and_the_rest_after(page):
    stated = page.words()
    order = [
        "leaves out ground-effect (94 %)",
        "1. ground-effect",
        "2. sensor-scale",
        "Explained variance of",
        "Time histories",
    ]
    order += [
        "Remaining differences",
        "Deviations from the stated values",
        "could not be tested",
        "Detectability",
        "Notes",
    ]
    places = [stated.find(word) for word in order]
    assert -1 not in places
    assert places == sorted(places)


def test_the_tables_hold_the_numbers(page):
    stated = page.words()
    for word in (
        "-0.100 ± 0.004",
        "5.0 ± 0.3 m",
        "h_agl 1.5 to 5.4 m",
        "12.5 to 19.0 s , 24.0 to 24.5 s",
        "0.220",
        "+12 ± 2 %",
    ):
        assert word in stated


def test_an_interval_of_a_finding_is_a_button_with_its_recording_and_times(page):
    buttons = [attrs for tag, attrs in page.tags if tag == "button" and "data-interval" in attrs]
    times = [(b["data-recording"], float(b["data-from"]), float(b["data-to"])) for b in buttons]
    assert times == [(name, *one) for name, each in GROUND.intervals.items() for one in each]


def test_the_contents_name_every_section_in_order(two):
    links = re.findall(r'<li><a href="#([^"]+)">', two)
    places = [two.index(f' id="{anchor}"') for anchor in links]
    assert len(links) == len(re.findall(r"<section", two)) + 1  # and the result
    assert places == sorted(places)


def test_the_printed_summary_names_what_it_omits(page):
    assert "Summary. The file also has: Remaining differences, Deviations from the stated values" in page.words()


def test_turbulence_that_explains_nothing_is_no_finding():
    gusts = replace(TURBULENCE, fraction=0.0, explained=0.9)
    stated = Page(render(diagnosis(GROUND, gusts))).words()
    assert "2. turbulence" not in stated
    assert gusts.physics[0].says in stated
    assert "2. turbulence" in Page(render(diagnosis(GROUND, replace(gusts, fraction=0.02)))).words()


def test_numbers_in_sentences_have_no_exponents():
    first = replace(GROUND.physics[0], says="Height scale 1.1e+02 m, -2.3e+03 N, delay 1.2e-02 s.")
    stated = Page(render(diagnosis(replace(GROUND, physics=(first, *GROUND.physics[1:]))))).words()
    assert "Height scale 110 m, -2300 N, delay 0.012 s." in stated


def test_no_line_breaks_between_a_number_and_its_unit(two):
    assert "Computing time: 6.2&nbsp;s" in two
    assert not re.search(r"\d (?:%|m|s|deg)\b", "".join(Page(two).text))


def test_bars_are_as_long_as_their_errors(two):
    # The longest, 0.31, fills its track.
    wide = [float(x) for x in re.findall(r'fill (?:delivered|refitted|physics)" style="left:0.0%;width:([\d.]+)%', two)]
    assert_allclose(wide[1:7], np.round(100.0 * np.array([0.22, 0.21, 0.08, 0.31, 0.30, 0.19]) / 0.31, 1), atol=0.06)


def test_the_probabilities_of_a_finding_add_up_to_one():
    stated = Page(render(diagnosis(VANE))).words()
    # 52 and 41 %; the remaining 7 % have a row.
    assert "sensor-scale 52 % wrong-derivative 41 % another effect, or none 7 %" in stated


def test_every_bar_and_figure_has_words_for_those_who_do_not_see_it(page):
    bars = [a for t, a in page.tags if a.get("role") == "img"]
    assert bars
    assert all(a.get("aria-label") for a in bars)
    assert sum(t == "figure" for t, _ in page.tags) == sum(t == "figcaption" for t, _ in page.tags) == 4
    assert ("html", {"lang": "en"}) in page.tags
    assert "aria-label" in "".join(page.scripts)


def test_both_colour_schemes_narrow_screens_and_paper_are_provided_for(two):
    for rule in ("prefers-color-scheme: dark", "max-width: 44rem", "@media print", "width=device-width"):
        assert rule in two


def test_no_name_from_the_data_becomes_markup_or_ends_the_script():
    text = render(hostile())
    assert "<script>alert" not in text
    made = Page(text)
    # The data and the program: no third script, and the data are still JSON.
    assert len(made.scripts) == 2
    assert '<script>alert("x")</script></script>' in json.loads(made.scripts[0])["recordings"]
    assert '<script>alert("x")</script>' in made.words()


def test_the_figures_hold_the_time_histories_in_the_units_people_read():
    made = diagnosis()
    data = figures_of(made)

    def unpack(text):
        return np.frombuffer(base64.b64decode(text), "<f4")

    one = data["recordings"]["m03"]
    assert_allclose(unpack(one["t"]), made.traces["m03"].t, rtol=1e-6)
    assert_allclose(unpack(one["responses"]["CZ"]["y"]["physics"]), made.traces["m03"].explained["CZ"], rtol=1e-6)
    assert_allclose(unpack(one["channels"]["alpha"]["y"]), np.rad2deg(made.traces["m03"].channels["alpha"]), rtol=1e-6)
    assert (data["units"]["alpha"], data["units"]["h_agl"]) == ("deg", "m")
    assert data["findings"][0]["channel"] == "h_agl"
    assert json.loads(json.dumps(data, allow_nan=False)) == data


def test_the_figures_of_a_finding_that_was_only_detected_open_at_its_event_without_a_line_with_it():
    detected = replace(GROUND, intervals={}, events=(Event("m02", 7.5, 0.2, "step"),), is_fitted=False)
    data = figures_of(diagnosis(detected))
    assert [stage for stage, _ in data["stages"]] == ["delivered", "refitted"]
    assert data["hidden"] == []
    (finding,) = data["findings"]
    assert finding["recording"] == "m02"
    assert finding["intervals"]["m02"] == [[7.3, 7.7]]
    assert "physics" not in data["recordings"]["m03"]["responses"]["CZ"]
    assert {stage for each in data["scatter"]["residuals"].values() for stage in each} == {"delivered", "refitted"}


def test_long_recordings_are_thinned_to_a_page_that_can_be_mailed():
    one = diagnosis().traces["m01"]
    many = 40
    long = replace(
        one,
        t=np.arange(len(one.t) * many) * 0.04,
        **{
            name: {c: np.tile(x, many) for c, x in getattr(one, name).items()}
            for name in ("measured", "simulated", "refitted", "explained", "channels")
        },
    )
    text = render(diagnosis(traces={f"m{k:02d}": long for k in range(1, 9)}))
    assert 4 * MAX_VALUES < len(text) < 5_000_000


def test_a_report_is_written_to_the_given_path(tmp_path):
    write_report(diagnosis(), tmp_path / "report.html")
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == render(diagnosis())
    with pytest.raises(OSError, match="nowhere"):
        write_report(diagnosis(), tmp_path / "nowhere" / "report.html")
