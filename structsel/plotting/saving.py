"""save_figure(): a figure as a file that can be printed."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

_PRINT_DPI = 300.0  # usual for print
_PAGE = 180.0 / 25.4  # in; width of the text on a page of A4


def save_figure(figure: Figure, path: str | Path) -> Path:
    """Write a figure for print; the suffix of the path is the format.

    Parameters
    ----------
    figure : Figure
    path : str or Path
        ``.png`` has 300 dots per inch when the figure is as wide as a page of A4, or less. ``.svg`` and ``.pdf`` are
        vectors; a PDF embeds its fonts. Clouds of samples are pictures inside.

    Returns
    -------
    Path
        The file.
    """
    path = Path(path)
    # Type 42 (TrueType) instead of Type 3: many journals refuse the latter.
    with mpl.rc_context({"pdf.fonttype": 42}):
        figure.savefig(path, dpi=_PRINT_DPI * min(1.0, _PAGE / float(figure.get_figwidth())))
    return path
