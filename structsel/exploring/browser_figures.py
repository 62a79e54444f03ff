"""The three figures of the explorer: residual over time and over a channel, and its spectrum."""

from __future__ import annotations

from typing import Any

import numpy as np
from bokeh.models.annotations import Whisker
from bokeh.models.callbacks import CustomJS
from bokeh.models.formatters import BasicTickFormatter
from bokeh.models.sources import ColumnDataSource
from bokeh.plotting import figure

from structsel.exploring.exploration import ViewData
from structsel.numerics.binning import BinMeans
from structsel.plotting.style import MEASURED, MODEL, SECONDARY, SELECTED, decimate

_HEIGHT = 320  # pixels of a figure
# Colours on a light and on a dark page.
_INK, _PAPER = ("#1d1d1d", "#e4eaed"), ("#ffffff", "#12181b")
_EDGE, _GRID = ("#6b6b6b", "#8b999f"), ("#e5e5e5", "#28333a")
_WITHOUT, _WITH, _LINE, _DOT = (MODEL, "#ff8492"), (SELECTED, "#4ec5d6"), (SECONDARY, "#738189"), (MEASURED, "#cdd6da")
_VARIABLES = {"ink": _INK, "paper": _PAPER, "edge": _EDGE, "rule": _GRID, "focus": _WITH}
_LIGHT, _DARK = ("".join(f"--{name}: {pair[k]}; " for name, pair in _VARIABLES.items()) for k in (0, 1))
PALETTE = (
    f":root {{ color-scheme: light dark; {_LIGHT} }} @media (prefers-color-scheme: dark) {{ :root {{ {_DARK} }} }}"
)
"""Variables of the style sheet of the page."""
_FIGURE = ":host { flex: 1 1 420px; min-width: min(100%, 300px); width: auto; margin: 0; }"
_DOTS: dict[str, Any] = {"alpha": 0.35, "selection_alpha": 1.0, "nonselection_alpha": 0.08, "line_color": None}
_PAINT = """const dark = matchMedia('(prefers-color-scheme: dark)')
const paint = () => {
  for (const [k, property, ...pair] of colours) models[k].setv({[property]: pair[+dark.matches]}, {sync: false})
}
paint()
dark.addEventListener('change', paint)"""
"""A canvas has no style sheet: its colours are properties, which follow the scheme of the browser."""


class ResidualFigures:
    """Figures that show the numbers of one view after another.

    Attributes
    ----------
    all : list of figures
    """

    def __init__(self) -> None:
        self._samples, self._lines = ColumnDataSource(name="samples"), ColumnDataSource()
        self._bins = {key: ColumnDataSource(name=f"bins-{key}") for key in ("without", "with")}
        self._spectra = ColumnDataSource(name="spectra")
        tools = "pan,box_zoom,box_select,reset"
        common: dict[str, Any] = {
            "height": _HEIGHT, "sizing_mode": "stretch_width", "stylesheets": [_FIGURE], "tools": tools,
            "active_drag": "box_select", "min_border_left": 80,
        }  # fmt: skip
        self._colours: list[tuple[Any, str, tuple[str, str]]] = []
        self._time: Any = figure(title="Residual over time", x_axis_label="time [s]", **common)
        for key, colour, width in (("without", _LINE, 1.2), ("with", _WITH, 1.0)):
            lines = self._time.multi_line("t", key, source=self._lines, line_width=width)
            self._paint(lines.glyph, colour, "line_color")
        # Invisible but for samples that are selected in the other figure.
        hidden = {**_DOTS, "alpha": 0.0, "nonselection_alpha": 0.0}
        self._paint_dots(self._time.scatter("t", "without", source=self._samples, size=4, **hidden))
        self._against: Any = figure(title="Residual over a channel, with bin means", **common)
        self._paint_dots(self._against.scatter("x", "without", source=self._samples, size=3, **_DOTS))
        for key, colour in (("without", _WITHOUT), ("with", _WITH)):
            held, text = self._bins[key], f"{key} it"
            line = self._against.line("x", "mean", source=held, line_width=2, legend_label=text)
            self._paint(line.glyph, colour, "line_color")
            dots = self._against.scatter("x", "mean", source=held, size=6, legend_label=text)
            self._paint(dots.glyph, colour, "fill_color", "line_color")
            bars = Whisker(source=held, base="x", lower="low", upper="high", level="overlay")
            for part in (bars, bars.upper_head, bars.lower_head):
                self._paint(part, colour, "line_color")
            bars.upper_head.size = bars.lower_head.size = 6  # type: ignore[union-attr]
            self._against.add_layout(bars)
        self._spectrum: Any = figure(
            title="Spectrum of the residual", x_axis_label="frequency [Hz]", x_axis_type="log", y_axis_type="log",
            **{**common, "tools": "pan,box_zoom,reset", "active_drag": "box_zoom"},
        )  # fmt: skip
        for key, colour in (("without", _WITHOUT), ("with", _WITH)):
            line = self._spectrum.line("f", key, source=self._spectra, line_width=1.5, legend_label=f"{key} it")
            self._paint(line.glyph, colour, "line_color")
        self.all: list[Any] = [self._time, self._against, self._spectrum]
        for one in self.all:
            self._style(one)

    def _style(self, one: Any) -> None:
        """Texts, colours and legend of a figure."""
        one.toolbar.logo = None
        one.yaxis.formatter = BasicTickFormatter(precision=1 if one is self._spectrum else "auto", power_limit_low=-4)
        one.title.text_font_size = "14px"
        self._paint(one.title, _INK, "text_color")
        self._paint(one, _PAPER, "background_fill_color", "border_fill_color")
        one.outline_line_color = None
        for grid in one.grid:
            self._paint(grid, _GRID, "grid_line_color")
        for axis in one.axis:
            axis.axis_label_text_font_style = "normal"
            axis.axis_label_text_font_size = axis.major_label_text_font_size = "13px"
            self._paint(axis, _INK, "axis_label_text_color", "major_label_text_color")
            self._paint(axis, _EDGE, "axis_line_color", "major_tick_line_color", "minor_tick_line_color")
        for legend in one.legend:  # above the samples, which it would hide
            one.add_layout(legend, "above")
            legend.orientation, legend.border_line_color, legend.padding, legend.margin = "horizontal", None, 2, 0
            self._paint(legend, _INK, "label_text_color")
            self._paint(legend, _PAPER, "background_fill_color")

    def _paint(self, model: Any, colours: tuple[str, str], *properties: str) -> None:
        """Give a part of a figure its colours on a light and on a dark page."""
        for name in properties:
            setattr(model, name, colours[0])
            self._colours.append((model, name, colours))

    def _paint_dots(self, dots: Any) -> None:
        for glyph, colour in ((dots.glyph, _DOT), (dots.nonselection_glyph, _DOT), (dots.selection_glyph, _WITHOUT)):
            self._paint(glyph, colour, "fill_color")

    @property
    def painter(self) -> CustomJS:
        """Sets the colours of the canvases in the browser."""
        changes = [(k, name, *colours) for k, (_, name, colours) in enumerate(self._colours)]
        return CustomJS(args={"models": [model for model, _, _ in self._colours], "colours": changes}, code=_PAINT)

    def show(self, data: ViewData) -> None:
        """Draw a view."""
        some = [decimate(len(s.t)) for s in data.series]
        parts = {
            "t": [s.t[k] for s, k in zip(data.series, some)],
            "without": [s.without[k] for s, k in zip(data.series, some)],
            "with": [s.with_it[k] for s, k in zip(data.series, some)],
        }
        channel = np.concatenate([s.channel[k] for s, k in zip(data.series, some)])
        self._samples.data = {name: np.concatenate(each) for name, each in parts.items()} | {"x": channel}
        lines: dict[str, Any] = dict(parts)
        if not data.view.kind:
            lines["with"] = [np.full(len(t), np.nan) for t in parts["t"]]
        self._lines.data = lines
        self._bins["without"].data = _whiskers(data.means)
        self._bins["with"].data = _whiskers(data.means_with, data.view.kind != "")
        with_it = data.density_with if data.view.kind else np.full(len(data.density), np.nan)
        positive = data.frequency > 0.0
        self._spectra.data = {
            "f": data.frequency[positive], "without": data.density[positive], "with": with_it[positive]
        }  # fmt: skip
        for one, label in (
            (self._time, data.y_label),
            (self._against, data.y_label),
            (self._spectrum, data.density_label),
        ):
            one.yaxis.axis_label = label
        self._against.xaxis.axis_label = data.x_label
        for one in (self._against, self._spectrum):
            one.legend.visible = bool(data.view.kind)
        self._against.title.text = f"Over {data.view.channel}, with means of bins"
        added = f", with {data.view.added}" if data.view.kind else ""
        self._time.title.text = f"Residual of {data.view.response}{added}"
        self._limit_time(data)

    def _limit_time(self, data: ViewData) -> None:
        low, high = min(float(s.t[0]) for s in data.series), max(float(s.t[-1]) for s in data.series)
        start, end = (
            edge if given is None else given for given, edge in ((data.view.start, low), (data.view.end, high))
        )
        if end > start:
            self._time.x_range.start, self._time.x_range.end = start, end


def _whiskers(found: BinMeans, shown: bool = True) -> dict[str, Any]:
    """Columns of bin means; without any where nothing is added."""
    keep = slice(None) if shown else slice(0)
    half = np.nan_to_num(found.half)
    columns = {"x": found.at, "mean": found.means, "low": found.means - half, "high": found.means + half}
    return {name: values[keep] for name, values in columns.items()}
