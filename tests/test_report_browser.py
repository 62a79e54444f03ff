"""Reports in a real browser: they open from a file, draw, ask for nothing, and work by keyboard and without sight.

They need the extra ``browser`` and a Chromium: the one of the extra, one on the path, or that of STRUCTSEL_BROWSER.
The accessibility check needs axe-core besides: STRUCTSEL_AXE, or the one that npm installed here.
"""

import os
import re
import shutil
from pathlib import Path

import pytest

from structsel.report import write_qualification
from tests.report_pages import pages, qualified

playwright = pytest.importorskip("playwright.sync_api", reason="needs the extra 'browser'")

KINDS = ("diagnosis", "selection", "reconstruction", "refinement")
LOOKS = [(scheme, wide) for scheme in ("light", "dark") for wide in (360, 1280)]
READING = "document.getElementById('history-text').textContent"
LABELS = "[...document.querySelectorAll('#history text')].map(t => t.textContent)"
PATHS = "[...document.querySelectorAll('.chart')].map(c => c.querySelectorAll('path').length)"


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as p:
        own = p.chromium.executable_path
        names = ("chromium", "chromium-browser", "chromium-headless-shell", "google-chrome")
        found = os.environ.get("STRUCTSEL_BROWSER") or (own if Path(own).exists() else None)
        found = found or next(filter(None, map(shutil.which, names)), None)
        if found is None:
            pytest.skip("no Chromium was found; STRUCTSEL_BROWSER may name one")
        made = p.chromium.launch(executable_path=found, args=["--no-sandbox"])
        yield made
        made.close()


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reports")
    for kind, text in pages().items():
        (folder / f"{kind}.html").write_text(text, encoding="utf-8")
    write_qualification(qualified(), folder)
    return folder


@pytest.fixture
def opened(browser, files):
    """Open a report; the messages and further requests of the browser."""
    contexts = []

    def open_one(kind, scheme="light", wide=1280, **options):
        context = browser.new_context(color_scheme=scheme, viewport={"width": wide, "height": 800}, **options)
        contexts.append(context)
        page = context.new_page()
        page.said, page.asked = [], []
        page.on("console", lambda message: page.said.append(message.text))
        page.on("pageerror", lambda error: page.said.append(str(error)))
        page.on("request", lambda request: page.asked.append(request.url))
        page.goto((files / f"{kind}.html").as_uri())
        return page

    yield open_one
    for context in contexts:
        context.close()


@pytest.mark.parametrize("kind", KINDS)
def test_a_report_opens_from_a_file_draws_its_figures_and_asks_for_nothing_else(kind, opened, files):
    page = opened(kind)
    drawn = page.evaluate(PATHS)
    assert len(drawn) >= 4
    assert all(drawn)
    assert page.said == []
    assert page.asked == [(files / f"{kind}.html").as_uri()]


@pytest.mark.parametrize("kind", [*KINDS, "qtg"])
def test_nothing_runs_out_of_a_phone(kind, opened):
    page = opened(kind, wide=360)
    assert page.evaluate("document.documentElement.scrollWidth") == 360


def test_hovering_reads_every_line_with_its_unit(opened):
    page = opened("refinement")
    says = page.evaluate(READING)
    assert says.startswith("alpha of m01 over time, measured and simulated")
    page.locator("#history svg").hover(position={"x": 400, "y": 100})
    stated = page.evaluate(READING)
    assert stated.startswith("m01, t = ")
    assert "measured" in stated
    assert "simulated" in stated
    assert stated.endswith("deg")
    page.mouse.move(5, 5)
    assert page.evaluate(READING) == says


def test_the_keyboard_reads_and_zooms_all_time_histories_together(opened):
    page = opened("selection")
    page.locator("#history svg").focus()
    page.keyboard.press("Home")
    assert page.evaluate(READING).startswith("m04, t = 0 s: measured ")
    page.keyboard.press("Shift+ArrowRight")
    assert page.evaluate(READING).startswith("m04, t = 2 s: ")
    complete = page.evaluate(LABELS)
    page.keyboard.press("+")
    # 0 to 19.96 s, halved about 1.996 s; the focus stays though the figure is drawn anew.
    closer = page.evaluate(LABELS)
    assert closer != complete
    assert "10" in closer
    assert "12" not in closer
    assert "12" not in page.evaluate(LABELS.replace("history", "channel"))
    assert page.evaluate("document.activeElement.closest('.chart').id") == "history"
    page.keyboard.press("PageDown")
    assert "14" in page.evaluate(LABELS)
    page.keyboard.press("0")
    assert page.evaluate(LABELS) == complete
    assert page.said == []


def test_dragging_zooms_and_the_buttons_move_and_show_all_again(opened):
    page = opened("reconstruction")
    complete = page.evaluate(LABELS)
    page.locator("#history svg").scroll_into_view_if_needed()
    box = page.locator("#history svg").bounding_box()
    page.mouse.move(box["x"] + 200, box["y"] + 60)
    page.mouse.down()
    page.mouse.move(box["x"] + 400, box["y"] + 60, steps=3)
    page.mouse.up()
    part = page.evaluate(LABELS)
    assert part != complete
    page.get_by_role("button", name="later").click()
    assert page.evaluate(LABELS) not in (part, complete)
    page.get_by_role("button", name="Full range").click()
    assert page.evaluate(LABELS) == complete


def test_a_line_is_hidden_by_its_name_and_other_channels_are_picked(opened):
    page = opened("diagnosis")
    lines = page.locator("#history svg path")
    before = lines.count()
    name = page.locator("#history").get_by_role("button", name="measured")
    name.focus()
    page.keyboard.press("Enter")
    assert lines.count() == before - 1
    assert page.evaluate("document.activeElement.textContent") == "measured"
    page.select_option("#pick-recording", "m05")
    page.select_option("#pick-channel", "alpha")
    assert page.evaluate("document.getElementById('channel-text').textContent").startswith("alpha of m05")
    assert page.said == []


@pytest.mark.parametrize("kind", KINDS)
def test_no_number_of_a_table_is_cut_on_a_phone(kind, opened):
    page = opened(kind, wide=360)
    cells = "[...document.querySelectorAll('td, th')]"
    cut = f"{cells}.filter(c => c.getBoundingClientRect().right > 360).map(c => c.textContent)"
    assert page.evaluate(cut) == []


def test_an_interval_of_a_finding_selects_its_samples_in_the_time_histories(opened):
    page = opened("diagnosis")
    page.get_by_role("button", name="Show m05 from 13.0 to 19.5 s in the time histories").click()
    assert page.evaluate("document.getElementById('selection').textContent") == "Selected: m05, 13 to 19.5 s."
    assert page.evaluate("document.querySelector('#history .title').textContent") == "m05: CZ"
    at = "[...document.querySelectorAll('#history text[text-anchor=middle]')].map(t => t.textContent)"
    labels = [float(x.replace("−", "-")) for x in page.evaluate(at)[:-2]]
    # The interval, and half of its length before and after.
    assert 9.75 <= min(labels) <= 11.0
    assert 21.0 <= max(labels) <= 22.75
    # Its samples are marked over the channel; 6.5 s at 25 Hz, at two stages.
    marked = page.evaluate(
        "[...document.querySelectorAll('#over .brushed')].map(p => p.getAttribute('d').split('M').length - 1)"
    )
    assert len(marked) == 2
    assert all(abs(count - 163) <= 1 for count in marked)
    page.get_by_role("button", name="Full range").click()
    assert page.locator("#over .brushed").count() == 0


def test_a_range_of_a_channel_shades_the_times_at_which_it_is_reached(opened):
    page = opened("diagnosis")
    page.get_by_role("button", name="Full range").click()
    assert page.locator("#history .shade.range").count() == 0
    page.locator("#over svg").focus()
    page.keyboard.press("+")
    assert page.locator("#history .shade.range").count() >= 1


def test_the_name_of_a_recording_in_a_table_shows_the_recording(opened):
    page = opened("selection")
    page.get_by_role("button", name="m03", exact=True).first.click()
    assert page.evaluate("document.querySelector('#history .title').textContent") == "m03: Cm"


@pytest.mark.parametrize("kind", KINDS)
def test_the_printed_summary_has_two_pages_or_fewer(kind, opened):
    page = opened(kind)
    printed = page.pdf(format="A4", margin=dict.fromkeys(("top", "bottom", "left", "right"), "12mm"))
    assert 1 <= len(re.findall(rb"/Type\s*/Page\b", printed)) <= 2


@pytest.mark.parametrize("kind", KINDS)
def test_figures_are_read_by_a_tap_on_a_touch_screen(kind, opened):
    page = opened(kind, wide=360, has_touch=True)
    says = page.evaluate(READING)
    page.locator("#history svg").tap(position={"x": 200, "y": 80})
    assert page.evaluate(READING) != says


def test_folded_sections_are_printed(opened):
    page = opened("refinement")
    folded = "document.querySelectorAll('details:not([open])').length"
    assert page.evaluate(folded) > 0
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.evaluate(folded) == 0
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert page.evaluate(folded) > 0


@pytest.fixture(scope="module")
def axe():
    named = os.environ.get("STRUCTSEL_AXE")
    places = [Path(named)] if named else [p / "node_modules/axe-core/axe.min.js" for p in Path(__file__).parents]
    found = next((p for p in places if p.is_file()), None)
    if found is None:
        pytest.skip("axe-core is not installed; STRUCTSEL_AXE may name its axe.min.js")
    return found.read_text(encoding="utf-8")


@pytest.mark.parametrize("kind", [*KINDS, "qtg"])
def test_axe_finds_nothing_serious_or_critical(kind, opened, axe):
    page = opened(kind, bypass_csp=True)
    page.evaluate(axe)
    for scheme, wide in LOOKS:
        page.emulate_media(color_scheme=scheme)
        page.set_viewport_size({"width": wide, "height": 800})
        found = page.evaluate("axe.run({resultTypes: ['violations']})")
        bad = [v for v in found["violations"] if v["impact"] in ("serious", "critical")]
        assert [(v["id"], scheme, wide, v["nodes"][0]["html"]) for v in bad] == []
        assert "color-contrast" in {rule["id"] for rule in found["passes"]}
