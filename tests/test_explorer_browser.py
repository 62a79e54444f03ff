"""The explorer in a real browser: by keyboard alone, on a phone, without a network, and what axe finds.

It needs the extras ``explore`` and ``browser``, and a Chromium; see test_report_browser.py.
"""

import json
import subprocess
import sys

import pytest

import structsel as ss

pytest.importorskip("bokeh", reason="needs the extra 'explore'")
pytest.importorskip("playwright.sync_api", reason="needs the extra 'browser'")

from tests.test_explorer import RECORDINGS
from tests.test_report_browser import axe, browser  # noqa: F401 (fixtures)

MODEL = ss.AeroModel.from_terms({"Cm": {"1": 0.05, "alpha": -0.5, "de": -1.5}, "CZ": {"1": -0.3, "alpha": -4.0}})
SERVE = "from structsel.cli import main; import sys; sys.argv[0] = 'structsel'; main()"


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Folder with a model and recordings."""
    folder = tmp_path_factory.mktemp("explored")
    for one in RECORDINGS[:2]:
        ss.write_recording(one, folder / f"{one.name}.csv")
    MODEL.to_json(folder / "model.json")
    return folder


@pytest.fixture(scope="module")
def served(place):
    """Start the command; its address."""
    started = []

    def serve(*arguments):
        process = subprocess.Popen(
            [sys.executable, "-c", SERVE, "explore", *map(str, arguments), "--no-browser"],
            stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        started.append(process)
        return process.stdout.readline().split(": ", 1)[1].strip()

    yield serve
    for process in started:
        process.terminate()  # SIGINT is ignored where pytest runs in the background
        assert process.wait(30) == 0
        process.stdout.close()


@pytest.fixture(scope="module")
def address(served, place):
    return served(place / "model.json", "--recordings", place / "m0.csv", place / "m1.csv")


@pytest.fixture
def opened(browser, address):  # noqa: F811
    """Open the page; the addresses that it asks for, and the errors of its scripts."""
    contexts = []

    def open_one(wide=1280, at=address, scheme="light"):
        context = browser.new_context(color_scheme=scheme, viewport={"width": wide, "height": 900})
        contexts.append(context)
        page = context.new_page()
        page.asked, page.failed = [], []
        page.on("request", lambda request: page.asked.append(request.url))
        page.on("pageerror", lambda error: page.failed.append(str(error)))
        page.goto(at)
        page.wait_for_selector("#words")
        return page

    yield open_one
    for context in contexts:
        context.close()


def words(page):
    return page.locator("#words").inner_text()


def test_the_page_draws_three_figures_and_asks_this_computer_only(opened, address):
    page = opened()
    page.locator("canvas").nth(2).wait_for(state="attached")
    assert words(page).startswith("Residual of Cm in 2 recordings: rms 0.00")
    assert page.locator("caption").last.inner_text().startswith("Cm: effect of adding one term")
    assert {url.split("/")[2] for url in page.asked} == {address.split("/")[2]}
    assert page.failed == []


def test_everything_is_done_by_keyboard_and_a_saved_view_opens_again(opened, place, served):
    page = opened()

    def tab_to(name):
        for _ in range(40):
            page.keyboard.press("Tab")
            if page.evaluate(FOCUS) == name:
                return
        raise AssertionError(f"Tab does not reach '{name}'")

    tab_to("Add to the model")
    page.keyboard.type("alpha^2")
    page.get_by_text("with alpha^2 it is").wait_for()
    tab_to("Bins")
    page.keyboard.press("Control+a")
    page.keyboard.type("9")
    page.keyboard.press("Enter")
    page.wait_for_timeout(300)
    tab_to("Name of the view")
    page.keyboard.press("Control+a")
    page.keyboard.type("pitch")
    tab_to("Save view")
    page.keyboard.press("Enter")
    page.get_by_text("Saved in").wait_for()
    view = json.loads((place / "views" / "pitch.json").read_text())["view"]
    assert (view["kind"], view["added"], view["bins"]) == ("term", "alpha^2", 9)
    seen = words(page)
    assert page.failed == []
    assert words(opened(at=served(place / "views" / "pitch.json"))) == seen


FOCUS = """() => {
  let one = document.activeElement
  while (one && one.shadowRoot && one.shadowRoot.activeElement) one = one.shadowRoot.activeElement
  const label = one && one.labels && one.labels[0]
  return label ? label.innerText.trim() : one ? one.innerText.trim() : ''
}"""
"""Label or text of the element that has the focus."""


def test_a_channel_that_is_chosen_is_on_the_axis_and_in_words(opened):
    page = opened()
    page.get_by_label("Response").select_option(label="CZ")
    page.get_by_text("Residual of CZ in 2 recordings").wait_for()
    page.get_by_label("Channel").select_option(label="de")
    page.get_by_text("at de = ").first.wait_for()
    page.get_by_label("Recordings").select_option(label="m1")
    page.get_by_text("Residual of CZ in 1 recording:").wait_for()


COLOURS = """() => {
  const found = [...Bokeh.documents[0].all_models].filter(one => one.type == 'Axis' || one.type.endsWith('Axis'))
  return [getComputedStyle(document.body).backgroundColor, ...new Set(found.map(one => one.axis_label_text_color))]
}"""
"""Colour of the page, and of the labels of its figures."""


def test_page_and_figures_follow_the_colour_scheme_of_the_browser(opened):
    page = opened(scheme="dark")
    assert page.evaluate(COLOURS) == ["rgb(18, 24, 27)", "#e4eaed"]
    page.emulate_media(color_scheme="light")
    page.wait_for_timeout(100)
    assert page.evaluate(COLOURS) == ["rgb(255, 255, 255)", "#1d1d1d"]
    page.get_by_label("Add to the model").select_option(label="alpha^2")
    page.get_by_text("with alpha^2 it is").wait_for()  # the server has not refused the colours
    assert page.failed == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("wide", [360, 1280])
def test_the_page_fits_and_axe_finds_nothing(wide, scheme, opened, axe):  # noqa: F811
    page = opened(wide, scheme=scheme)
    assert page.evaluate("document.documentElement.scrollWidth") == wide
    page.evaluate(axe)
    found = page.evaluate("axe.run()")["violations"]
    assert [(one["impact"], one["id"]) for one in found] == []


def test_a_saved_page_opens_from_its_file_without_a_network(browser, place):  # noqa: F811
    from structsel.exploring.exploration import explore_model
    from structsel.exploring.saving import save_view
    from structsel.exploring.view import View

    found = explore_model(MODEL, RECORDINGS[:2], ss.Candidates.parse(["alpha^2"]))
    paths = save_view(found, View(kind="term", added="alpha^2"), {}, place / "saved", "one")
    context = browser.new_context(offline=True)
    page = context.new_page()
    asked = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto(paths[1].as_uri())
    page.wait_for_selector("#words")
    assert words(page).startswith("Residual of Cm in 2 recordings")
    assert asked == [paths[1].as_uri()]
    context.close()
