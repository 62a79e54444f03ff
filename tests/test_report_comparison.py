"""The page that compares methods: what they agree on, where they part, and which predicts."""

from types import SimpleNamespace

import pytest

from structsel import Candidates, select, validate
from structsel.formatting import format_number
from structsel.report import write_comparison
from tests.report_pages import manoeuvre
from tests.test_report import Page

ODD = "all <of> it"


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    recordings = [manoeuvre(k) for k in range(4)]
    pool = Candidates.polynomial(["alpha", "q_hat", "de"], 2)
    asked = {"stepwise": {}, ODD: {"noise": "white", "parsimony": "none"}}
    found = {name: select(recordings[:3], ["Cm", "CZ"], pool, bootstrap=0, **more) for name, more in asked.items()}
    scores = {name: validate(one.model, recordings[3:]) for name, one in found.items()}
    pages = {"stepwise": "report_stepwise.html", ODD: "report_all of it.html"}
    path = tmp_path_factory.mktemp("compared") / "report.html"
    write_comparison(found, path, recordings=recordings, judged=scores, pages=pages)
    text = path.read_text(encoding="utf-8")
    return SimpleNamespace(text=text, page=Page(text), found=found, scores=scores)


def test_methods_stand_side_by_side_with_their_values_and_scores(compared):
    stated = compared.page.words()
    kept = {response: [set(s[response].terms) for s in compared.found.values()] for response in ("Cm", "CZ")}
    different = [response for response, (a, b) in kept.items() if a != b]
    assert different  # or the page would have nothing to show
    assert all(f"{response}: all select" in stated for response in different)
    values = " ".join(format_number(float(one["Cm"].values[0])) for one in compared.found.values())
    assert f"1 {values} 2 of 2" in stated
    for response in ("Cm", "CZ"):
        scores = [one.score(response) for one in compared.scores.values()]
        assert f"R², validation {' '.join(f'{s.r2:.4f}' for s in scores)}" in stated
        assert f"RRMSE, validation {' '.join(f'{s.rrmse:.4f}' for s in scores)}" in stated


def test_a_term_that_one_method_leaves_out_shows_as_a_dash(compared):
    first, second = (one["CZ"] for one in compared.found.values())
    only = next(iter(set(first.terms) ^ set(second.terms)))
    values = [
        format_number(dict(zip(s.terms, s.values[1:]))[only]) if only in s.terms else "-" for s in (first, second)
    ]
    assert f"{only} {' '.join(values)} 1 of 2" in compared.page.words()


def test_each_methods_own_page_is_one_click_away_and_names_are_only_text(compared):
    links = [attrs["href"] for tag, attrs in compared.page.tags if tag == "a" and "report" in attrs["href"]]
    assert links == ["report_stepwise.html", "report_all%20of%20it.html"]
    assert ODD in compared.page.words()
    assert "<of>" not in compared.text
    assert compared.page.crossed == compared.page.open == []


def test_every_method_has_its_line_in_the_figures(compared):
    assert '"stages": [["physics", "stepwise"], ["delivered"' in compared.text
