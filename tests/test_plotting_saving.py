"""Figures are written for print: 300 dots per inch on the page, and fonts that are embedded."""

import pytest
from matplotlib.figure import Figure
from PIL import Image

from structsel.plotting import save_figure
from tests.commands import run


@pytest.mark.parametrize(("inches", "pixels"), [(5.0, 1500), (12.0, 2126)])
def test_a_picture_has_300_dots_per_inch_at_the_width_of_a_page(tmp_path, inches, pixels):
    # 180 mm are 7.087 in: a wider figure is printed smaller. 180 / 25.4 * 300 = 2126.
    with Image.open(save_figure(Figure(figsize=(inches, 2.0)), tmp_path / "one.png")) as made:
        assert made.width == pytest.approx(pixels, abs=1)


def test_a_pdf_embeds_truetype_fonts(tmp_path):
    figure = Figure()
    figure.text(0.5, 0.5, "time [s]")
    content = save_figure(figure, tmp_path / "one.pdf").read_bytes()
    assert b"/FontFile2" in content
    assert b"/Type3" not in content


@pytest.mark.parametrize(("kind", "begins"), [("svg", b"<?xml"), ("pdf", b"%PDF"), ("png", b"\x89PNG")])
def test_the_command_line_writes_plots_in_the_format_that_is_asked_for(tmp_path, kind, begins):
    arguments = ("--channel", "de", "--amplitude", 0.02, "--duration", 6)
    run("inputs", "doublet", *arguments, "--out", tmp_path / "out", "--plot-format", kind)
    assert [p.name for p in (tmp_path / "out").glob("inputs.*") if p.suffix != ".json"] == [f"inputs.{kind}"]
    assert (tmp_path / "out" / f"inputs.{kind}").read_bytes().startswith(begins)
