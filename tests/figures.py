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


def assert_tick_labels_apart(figure):
    """No two tick labels of an axis touch."""
    FigureCanvasAgg(figure).draw()
    for ax in figure.axes:
        for axis in (ax.xaxis, ax.yaxis):
            boxes = [t.get_window_extent() for t in axis.get_ticklabels() if t.get_visible() and t.get_text()]
            rotated = any(t.get_rotation() for t in axis.get_ticklabels())
            if not rotated:
                assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[i + 1 :]), ax.get_title()
