"""The page of the explorer: menus, three figures, and the effect of one more term."""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from bokeh.core.templates import get_env
from bokeh.document import Document
from bokeh.embed import file_html
from bokeh.layouts import column
from bokeh.models.annotations import Whisker
from bokeh.models.formatters import BasicTickFormatter
from bokeh.models.layouts import Row
from bokeh.models.sources import ColumnDataSource
from bokeh.models.widgets.buttons import Button
from bokeh.models.widgets.inputs import MultiSelect, NumericInput, Select, TextInput
from bokeh.models.widgets.markups import Div
from bokeh.plotting import figure
from bokeh.resources import INLINE

from structsel.errors import StructselError
from structsel.exploring.exploration import Exploration, ViewData, compute_view
from structsel.exploring.view import View
from structsel.numerics.binning import BinMeans
from structsel.plotting.style import MEASURED, MODEL, SECONDARY, SELECTED, decimate

Save = Callable[[View, str], str]

_HEIGHT = 320  # pixels of a figure
_BINS = (3, 60)
_ALL = "nothing"
_TEMPLATE = """{% extends base %}
{% block preamble %}<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
body { font: 15px/1.45 system-ui, sans-serif; margin: 0; color: #1d1d1d; background: #fff; }
main { max-width: 1240px; margin: 0 auto; padding: 12px 16px 40px; }
h1 { font-size: 1.35em; margin: 0.3em 0; }
p { margin: 0.4em 0; }
</style>{% endblock %}
{% block contents %}<main><h1>{{ title|e }}</h1>
<p>ABOUT</p>
{{ super() }}</main>{% endblock %}"""
_STYLE = (
    ":host { font: 15px/1.45 system-ui, sans-serif; color: #1d1d1d; width: 100%; } "
    ".bk-clearfix { width: 100%; } "
    "table { border-collapse: collapse; } "
    "caption { text-align: left; padding: 4px 0; font-weight: 600; } "
    "th, td { padding: 2px 10px 2px 0; text-align: right; white-space: nowrap; border-bottom: 1px solid #ddd; } "
    "th:first-child, td:first-child { text-align: left; } ul { padding-left: 18px; } "
    ".scroll { overflow-x: auto; max-width: 100%; } .scroll:focus-visible { outline: 2px solid #00798c; }"
)
_INPUT = (
    ":host { flex: 1 1 150px; min-width: 130px; width: auto; margin: 0; font: 15px/1.45 system-ui, sans-serif; } "
    "label { color: #1d1d1d; } .bk-input { color: #1d1d1d; border-color: #6b6b6b; } "
    ".bk-input[multiple] { padding: 2px 6px; } "
    ".bk-input:focus { outline: 2px solid #00798c; }"
)
_BUTTON = (
    ":host { flex: 0 1 auto; width: auto; margin: 0; align-self: flex-end; } "
    ".bk-btn { color: #1d1d1d; border-color: #6b6b6b; } .bk-btn:focus-visible { outline: 2px solid #00798c; }"
)
_FIGURE = ":host { flex: 1 1 420px; min-width: min(100%, 300px); width: auto; margin: 0; }"
_FLEX = ":host { gap: 10px 16px; width: 100%; margin: 6px 0; }"


class BrowserExplorer:
    """One open page.

    Parameters
    ----------
    exploration : Exploration
    view : View
    save : callable, optional
        Saves a view under a name, and returns what was written, as a sentence.
    """

    def __init__(self, exploration: Exploration, view: View, save: Save | None = None):
        self._exploration, self._save = exploration, save
        self._data = compute_view(exploration, view)
        self._changing = False
        self._words = Div(stylesheets=[_STYLE], name="words")
        self._table = Div(stylesheets=[_STYLE], name="effect")
        self._status = Div(stylesheets=[_STYLE], name="status")
        self._make_figures()
        self._make_menus()
        self._show()

    # ------------------------------------------------------------ figures

    def _make_figures(self) -> None:
        self._samples, self._lines = ColumnDataSource(name="samples"), ColumnDataSource()
        self._bins = {key: ColumnDataSource(name=f"bins-{key}") for key in ("without", "with")}
        self._spectra = ColumnDataSource(name="spectra")
        tools = "pan,box_zoom,box_select,reset"
        common: dict[str, Any] = {
            "height": _HEIGHT, "sizing_mode": "stretch_width", "stylesheets": [_FIGURE], "tools": tools,
            "active_drag": "box_select", "min_border_left": 80,
        }  # fmt: skip
        self._time: Any = figure(title="Residual over time", x_axis_label="time [s]", **common)
        self._time.multi_line("t", "without", source=self._lines, color=SECONDARY, line_width=1.2)
        self._time.multi_line("t", "with", source=self._lines, color=SELECTED, line_width=1.0)
        # Invisible but for samples that are selected in the other figure.
        self._time.scatter("t", "without", source=self._samples, size=4, **{**_dots(), "alpha": 0.0,
                           "nonselection_alpha": 0.0})  # fmt: skip
        self._against: Any = figure(title="Residual over a channel, with bin means", **common)
        self._against.scatter("x", "without", source=self._samples, size=3, **_dots())
        for key, colour in (("without", MODEL), ("with", SELECTED)):
            held = self._bins[key]
            self._against.line("x", "mean", source=held, color=colour, line_width=2, legend_label=f"{key} it")
            self._against.scatter("x", "mean", source=held, color=colour, size=6, legend_label=f"{key} it")
            bars = Whisker(source=held, base="x", lower="low", upper="high", line_color=colour, level="overlay")
            for head in (bars.upper_head, bars.lower_head):
                head.size, head.line_color = 6, colour  # type: ignore[union-attr]
            self._against.add_layout(bars)
        self._spectrum: Any = figure(
            title="Spectrum of the residual", x_axis_label="frequency [Hz]", x_axis_type="log", y_axis_type="log",
            **{**common, "tools": "pan,box_zoom,reset", "active_drag": "box_zoom"},
        )  # fmt: skip
        for key, colour in (("without", MODEL), ("with", SELECTED)):
            self._spectrum.line("f", key, source=self._spectra, color=colour, line_width=1.5, legend_label=f"{key} it")
        one: Any
        for one in (self._time, self._against, self._spectrum):
            one.toolbar.logo = None
            one.yaxis.formatter = BasicTickFormatter(
                precision=1 if one is self._spectrum else "auto", power_limit_low=-4
            )
            one.title.text_font_size = "14px"
            one.axis.axis_label_text_font_style = "normal"
            one.axis.axis_label_text_font_size = one.axis.major_label_text_font_size = "13px"
            one.axis.axis_label_text_color = one.axis.major_label_text_color = "#1d1d1d"

    @property
    def _figures(self) -> Row:
        figures = [self._time, self._against, self._spectrum]
        return Row(children=figures, stylesheets=[_FLEX], styles={"flex-wrap": "wrap"}, sizing_mode="stretch_width")

    # ------------------------------------------------------------ menus

    def _make_menus(self) -> None:
        exploration, view = self._exploration, self._data.view
        common: dict[str, Any] = {"stylesheets": [_INPUT]}
        names: list[Any] = list(exploration.names)
        responses: list[Any] = list(exploration.responses)
        channels: list[Any] = list(exploration.channels)
        self._recordings = MultiSelect(title="Recordings", value=list(view.recordings), options=names, size=5, **common)
        self._response = Select(title="Response", value=view.response, options=responses, **common)
        self._channel = Select(title="Channel", value=view.channel, options=channels, **common)
        self._added = Select(title="Add to the model", **common)
        self._scored = view.kind == "effect"
        self._list_additions(view)
        self._bin_count = NumericInput(title="Bins", low=_BINS[0], high=_BINS[1], value=view.bins, **common)
        self._start = NumericInput(title="From [s]", value=view.start, mode="float", **common)
        self._end = NumericInput(title="To [s]", value=view.end, mode="float", **common)
        menus = [self._recordings, self._response, self._channel, self._added, self._bin_count, self._start, self._end]
        for menu in menus:
            menu.on_change("value", self._change)
        self._menus: list[Any] = menus
        self._name = TextInput(
            title="Name of the view", value="view", stylesheets=[_INPUT, ":host { max-width: 280px; }"]
        )
        self._button = Button(label="Save view", stylesheets=[_BUTTON])
        self._button.on_click(self._save_view)
        self._score = Button(label="Score effects", stylesheets=[_BUTTON])
        self._score.on_click(self._start_scoring)

    def _list_additions(self, view: View) -> None:
        """Fill the menu of terms and effects, the best first."""
        trials = self._exploration.trials
        groups: dict[str, list[Any]] = {"": [("", _ALL)]}
        groups["Terms, best cross-validated R2 first"] = [
            (f"term:{name}", name) for name in trials["term"].names(view.response)
        ]
        if self._scored:
            named = trials["effect"].names(view.response)
            groups["Effects, largest evidence first"] = [(f"effect:{name}", name) for name in named]
        there = [key for each in groups.values() for key, _ in each]
        value = f"{view.kind}:{view.added}" if view.kind else ""
        self._added.options = {group: each for group, each in groups.items() if each}
        self._added.value = value if value in there else ""

    # ------------------------------------------------------------ changes

    def _change(self, attribute: str, old: Any, new: Any) -> None:
        if self._changing:
            return
        self._changing = True
        try:
            kind, _, added = self._added.value.partition(":")
            view = View(
                recordings=tuple(self._recordings.value) or self._exploration.names,
                response=self._response.value, channel=self._channel.value, kind=kind, added=added,
                bins=int(np.clip(self._bin_count.value or View.bins, *_BINS)),
                start=self._start.value, end=self._end.value,
            )  # fmt: skip
            if view.response != self._data.view.response:
                self._list_additions(view)
                if not self._added.value:
                    view = replace(view, kind="", added="")
            self._data = compute_view(self._exploration, view)
            self._show()
        except StructselError as error:
            self._say(str(error))
        finally:
            self._changing = False

    def _start_scoring(self) -> None:
        self._score.disabled = True
        self._say("The effects are being scored, which may take a minute.")
        document = self._score.document
        if document is not None:  # the page shows the message first
            document.add_timeout_callback(self._finish_scoring, 200)

    def _finish_scoring(self) -> None:
        try:
            names = self._exploration.trials["effect"].names(self._data.view.response)
            self._scored = True
            self._list_additions(self._data.view)
            self._table.text = _table(
                self._exploration.trials["effect"].summary(self._data.view.response, "").to_html()
            )
            self._say(
                f"{len(names)} effects act on {self._data.view.response}; they are in the menu 'Add to the model'."
            )
        except StructselError as error:
            self._say(str(error))

    def _save_view(self) -> None:
        try:
            if self._save is not None:
                self._say(self._save(self._data.view, self._name.value))
        except (StructselError, OSError) as error:
            self._say(str(error))

    def _say(self, text: str) -> None:
        self._status.text = f'<div role="status">{html.escape(text)}</div>'

    # ------------------------------------------------------------ what is shown

    def _show(self) -> None:
        data = self._data
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
        self._words.text = _words(data)
        self._table.text = _table(data.summary.to_html())
        self._say("")

    def _limit_time(self, data: ViewData) -> None:
        low, high = min(float(s.t[0]) for s in data.series), max(float(s.t[-1]) for s in data.series)
        start, end = (
            edge if given is None else given for given, edge in ((data.view.start, low), (data.view.end, high))
        )
        if end > start:
            self._time.x_range.start, self._time.x_range.end = start, end

    def _row(self, children: list[Any]) -> Row:
        return Row(
            children=children, stylesheets=[_FLEX], sizing_mode="stretch_width",
            styles={"flex-wrap": "wrap", "align-items": "flex-start"},
        )  # fmt: skip

    def add_to(self, document: Document) -> None:
        """Show the page in a document."""
        actions = [self._name, self._button, *([self._score] if "effect" in self._exploration.trials else [])]
        menus, buttons = self._row(self._menus), self._row(actions)
        parts: list[Any] = [menus, buttons, self._status, self._figures, self._words, self._table]
        document.add_root(column(parts, sizing_mode="stretch_width"))
        document.title = f"{self._exploration.title}: residuals"
        document.template = get_env().from_string(_page(self._exploration.residual))

    def static_page(self) -> str:
        """Page with the figures and the numbers of the view, without menus; it needs no network."""
        content = column(self._figures, self._words, self._table, sizing_mode="stretch_width")
        title = f"{self._exploration.title}: residuals"
        return file_html(content, INLINE, title, template=get_env().from_string(_page(self._exploration.residual)))


def _page(about: str) -> str:
    return _TEMPLATE.replace("ABOUT", f"The residual is the {html.escape(about)}.")


def _dots() -> dict[str, Any]:
    return {"color": MEASURED, "alpha": 0.35, "selection_color": MODEL, "selection_alpha": 1.0,
            "nonselection_alpha": 0.08, "line_color": None}  # fmt: skip


def _whiskers(found: BinMeans, shown: bool = True) -> dict[str, Any]:
    """Columns of bin means; without any where nothing is added."""
    keep = slice(None) if shown else slice(0)
    half = np.nan_to_num(found.half)
    columns = {"x": found.at, "mean": found.means, "low": found.means - half, "high": found.means + half}
    return {name: values[keep] for name, values in columns.items()}


def _table(text: str) -> str:
    return f'<div class="scroll" tabindex="0" role="region" aria-label="Effect of what is added">{text}</div>'


def _words(data: ViewData) -> str:
    """Text of the figures, and the bin means as a table that can be opened."""
    kinds = [("without it", data.means)] + ([("with it", data.means_with)] if data.view.kind else [])
    heads = "".join(f"<th>mean {name}</th><th>95 % half width</th>" for name, _ in kinds)
    rows = []
    for i in range(len(data.means.at)):
        cells = "".join(f"<td>{found.means[i]:.4g}</td><td>{found.half[i]:.2g}</td>" for _, found in kinds)
        rows.append(f"<tr><td>{data.means.at[i]:.4g}</td>{cells}</tr>")
    label, unit = html.escape(data.x_label), html.escape(data.y_label)
    return (
        f'<p id="words" role="status">{html.escape(data.words)}</p><details><summary>Bin means as a table</summary>'
        f'<div class="scroll" tabindex="0" role="region" aria-label="Bin means"><table><caption>{unit}</caption>'
        f"<thead><tr><th>{label}</th>{heads}</tr></thead><tbody>{''.join(rows)}</tbody></table></div></details>"
    )
