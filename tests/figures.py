"""Checks that hold for every figure."""

from matplotlib.backends.backend_agg import FigureCanvasAgg


def assert_nothing_outside(figure):
    """Every text of a figure is inside it, with slack of a little more than a pixel [inches]."""
    FigureCanvasAgg(figure).draw()
    extent = figure.get_tightbbox()
    assert extent.x0 > -0.02
    assert extent.y0 > -0.02
    assert extent.x1 < figure.get_figwidth() + 0.02
    assert extent.y1 < figure.get_figheight() + 0.02
