"""The widget of explore_residuals(); the only module that imports ipywidgets."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import ipywidgets

from structsel.candidates import Candidates
from structsel.exploring.added_terms import try_additions
from structsel.exploring.trials import varying_channels
from structsel.model import AeroModel
from structsel.plotting import draw_addition
from structsel.recording import Recording
from structsel.tables import Summary, table_of_frame

_DPI = 90


class ResidualExplorer(ipywidgets.VBox):
    """Three menus, a figure, and the effect of the term; see `explore_residuals`.

    Attributes
    ----------
    response, channel, term : ipywidgets.Dropdown
        Menus; set their ``value`` to change the choice from code.
    figure : ipywidgets.Image
    effect : ipywidgets.HTML
    additions : structsel.exploring.Additions
        Numbers of all candidates for the response.
    """

    def __init__(self, model: AeroModel, recordings: Sequence[Recording], candidates: Candidates):
        self._model, self._recordings, self._candidates = model, list(recordings), candidates
        self.response = ipywidgets.Dropdown(options=list(model), description="response")
        self.channel = ipywidgets.Dropdown(options=varying_channels(self._recordings), description="against")
        self.term = ipywidgets.Dropdown(description="adding")
        self.figure = ipywidgets.Image(format="png")
        self.effect = ipywidgets.HTML()
        self._list_candidates()
        first = [name for name in self.additions.terms[0].channels if name in self.channel.options]
        self.channel.value = next(iter(first), self.channel.value)
        super().__init__([ipywidgets.HBox([self.response, self.channel, self.term]), self.figure, self.effect])
        self._show()
        self.response.observe(self._change_response, "value")
        for choice in (self.channel, self.term):
            choice.observe(self._show, "value")

    def _list_candidates(self) -> None:
        """Compute the effect of the candidates on the response, and list them, the best first."""
        self.additions = try_additions(self._model, self._recordings, self.response.value, self._candidates)
        self.term.options = [str(term) for term in self.additions.terms]
        self.term.value = self.term.options[0]

    def _change_response(self, _: Any) -> None:
        self.term.unobserve(self._show, "value")  # otherwise every step of the change would be drawn
        self._list_candidates()
        self.term.observe(self._show, "value")
        self._show()

    def _show(self, _: Any = None) -> None:
        response, channel, term = self.response.value, self.channel.value, self.term.value
        drawn = io.BytesIO()
        draw_addition(self._model, self._recordings, response, channel, term).savefig(drawn, format="png", dpi=_DPI)
        self.figure.value = drawn.getvalue()
        rows = self.additions.to_frame()
        table = table_of_frame(rows[rows["term"].isin(["(as it is)", term])], digits=5)
        note = "Held out are complete recordings in turn, or segments of a single one. Choose terms by this R2."
        self.effect.value = Summary(f"{response}: adding {term}", tables=(table,), notes=(note,)).to_html()
