"""The page of the explorer: menus, three figures, and the effect of one more term."""

from __future__ import annotations

import html
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from bokeh.core.templates import get_env
from bokeh.document import Document
from bokeh.embed import file_html
from bokeh.events import DocumentReady
from bokeh.layouts import column
from bokeh.models.layouts import Row
from bokeh.models.widgets.buttons import Button
from bokeh.models.widgets.inputs import MultiSelect, NumericInput, Select, TextInput
from bokeh.models.widgets.markups import Div
from bokeh.resources import INLINE

from structsel.errors import StructselError
from structsel.exploring.browser_figures import PALETTE, ResidualFigures
from structsel.exploring.exploration import Exploration, ViewData, compute_view
from structsel.exploring.view import View

Save = Callable[[View, str], str]

_BINS = (3, 60)
_ALL = "nothing"
_MINUS = re.compile(r"-(?=\d)")
_TEMPLATE = """{% extends base %}
{% block preamble %}<meta name="viewport" content="width=device-width, initial-scale=1">
<style>
PALETTE
body { font: 15px/1.45 system-ui, sans-serif; margin: 0; color: var(--ink); background: var(--paper); }
main { max-width: 1240px; margin: 0 auto; padding: 12px 16px 40px; }
h1 { font-size: 1.35em; margin: 0.3em 0; }
p { margin: 0.4em 0; }
</style>{% endblock %}
{% block contents %}<main><h1>{{ title|e }}</h1>
<p>ABOUT</p>
{{ super() }}</main>{% endblock %}"""
_STYLE = (
    ":host { font: 15px/1.45 system-ui, sans-serif; color: var(--ink); width: 100%; } "
    ".bk-clearfix { width: 100%; } "
    "table { border-collapse: collapse; } "
    "caption { text-align: left; padding: 4px 0; font-weight: 600; } "
    "th, td { padding: 2px 10px 2px 0; text-align: right; white-space: nowrap; border-bottom: 1px solid var(--rule); } "
    "th:first-child, td:first-child { text-align: left; } ul { padding-left: 18px; } "
    ".scroll { overflow-x: auto; max-width: 100%; } .scroll:focus-visible { outline: 2px solid var(--focus); }"
)
_INPUT = (
    ":host { flex: 1 1 150px; min-width: 130px; width: auto; margin: 0; font: 15px/1.45 system-ui, sans-serif; } "
    "label { color: var(--ink); } "
    ".bk-input { color: var(--ink); background-color: var(--paper); border-color: var(--edge); } "
    ".bk-input[multiple] { padding: 2px 6px; } "
    "@media (prefers-color-scheme: dark) { select:not([multiple]).bk-input { background-image: "
    "url('data:image/svg+xml;utf8,"
    '<svg viewBox="0 0 25 20" xmlns="http://www.w3.org/2000/svg"><path d="M 0,0 25,0 12.5,20 Z" fill="white"/></svg>'
    "'); } } "
    ".bk-input:focus { outline: 2px solid var(--focus); }"
)
_BUTTON = (
    ":host { flex: 0 1 auto; width: auto; margin: 0; align-self: flex-end; } "
    ".bk-btn, .bk-btn:hover { color: var(--ink); background-color: var(--paper); border-color: var(--edge); } "
    ".bk-btn:focus-visible { outline: 2px solid var(--focus); }"
)
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
        self._figures = ResidualFigures()
        self._make_menus()
        self._show()

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
        self._figures.show(data)
        self._words.text = _words(data)
        self._table.text = _table(data.summary.to_html())
        self._say("")

    def _row(self, children: list[Any]) -> Row:
        return Row(
            children=children, stylesheets=[_FLEX], sizing_mode="stretch_width",
            styles={"flex-wrap": "wrap", "align-items": "flex-start"},
        )  # fmt: skip

    def add_to(self, document: Document) -> None:
        """Show the page in a document."""
        actions = [self._name, self._button, *([self._score] if "effect" in self._exploration.trials else [])]
        menus, buttons = self._row(self._menus), self._row(actions)
        parts: list[Any] = [menus, buttons, self._status, self._row(self._figures.all), self._words, self._table]
        document.add_root(column(parts, sizing_mode="stretch_width"))
        document.title = f"{self._exploration.title}: residuals"
        document.template = get_env().from_string(_page(self._exploration.residual))
        document.js_on_event(DocumentReady, self._figures.painter)

    def static_page(self) -> str:
        """Page with the figures and the numbers of the view, without menus; it needs no network."""
        content = column(self._row(self._figures.all), self._words, self._table, sizing_mode="stretch_width")
        title = f"{self._exploration.title}: residuals"
        document = Document()
        document.add_root(content)
        document.js_on_event(DocumentReady, self._figures.painter)
        return file_html(document, INLINE, title, template=get_env().from_string(_page(self._exploration.residual)))


def _page(about: str) -> str:
    return _TEMPLATE.replace("PALETTE", PALETTE).replace("ABOUT", f"The residual is the {html.escape(about)}.")


def _table(text: str) -> str:
    return f'<div class="scroll" tabindex="0" role="region" aria-label="Effect of what is added">{text}</div>'


def _typeset(text: str) -> str:
    """Text with the signs of print; a line does not end after a minus."""
    return _MINUS.sub("\N{MINUS SIGN}", text.replace("+-", "±"))


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
        f'<p id="words" role="status">{html.escape(_typeset(data.words))}</p>'
        "<details><summary>Bin means as a table</summary>"
        f'<div class="scroll" tabindex="0" role="region" aria-label="Bin means"><table><caption>{unit}</caption>'
        f"<thead><tr><th>{label}</th>{heads}</tr></thead><tbody>{''.join(rows)}</tbody></table></div></details>"
    )
