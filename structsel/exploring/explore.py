"""explore_residuals(): residuals of a model in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from structsel.candidates import Candidates
from structsel.errors import StructselError
from structsel.model import AeroModel
from structsel.recording import Recording
from structsel.recording.arguments import as_recordings
from structsel.selection import Selection, Selections

if TYPE_CHECKING:
    from structsel.exploring.notebook_explorer import ResidualExplorer

_DEGREE = 2  # of the candidates by default


def explore_residuals(
    selection_or_model: Selections | Selection | AeroModel,
    recordings: Recording | Sequence[Recording],
    *,
    candidates: Candidates | None = None,
) -> ResidualExplorer:
    """Show the residuals of a model, and the effect of one more term, in a notebook.

    Choose a response, a channel and a candidate. The left figure shows the residual over the channel with bin means,
    without and with the term. The right one is the added-variable plot of the term. The table below has R2, PSE and
    cross-validated R2, without and with the term.

    Parameters
    ----------
    selection_or_model : Selections, Selection or AeroModel
    recordings : Recording or sequence of Recording
        Recordings with the channels of the model and of the candidates, and with the responses.
    candidates : Candidates, optional
        Terms that may be added. By default the candidates of the selection; for a model, products of two of its
        channels.

    Returns
    -------
    ResidualExplorer
        A widget, shown if it is the last line of a cell. ``.additions`` has the numbers of all candidates.

    Raises
    ------
    StructselError
        ipywidgets is not installed.
    ChannelError, DataError
        A channel is missing, or not finite.
    SelectionError
        Every candidate is in the model, or a linear combination of its terms.
    """
    try:
        import ipywidgets  # noqa: F401
    except ImportError as error:
        raise StructselError(
            "explore_residuals needs the package ipywidgets, which is not installed.\n"
            'Install it with: pip install "structsel[notebooks]"'
        ) from error
    from structsel.exploring.notebook_explorer import ResidualExplorer

    model, pool = _model_and_pool(selection_or_model)
    flights = as_recordings(recordings, "explore_residuals")
    return ResidualExplorer(model, flights, candidates or pool)


def _model_and_pool(given: Selections | Selection | AeroModel) -> tuple[AeroModel, Candidates]:
    if isinstance(given, AeroModel):
        return given, Candidates.polynomial(given.channels, _DEGREE)
    by_response = {given.response: given} if isinstance(given, Selection) else dict(given)
    terms = [term for one in by_response.values() for term in one.pool]
    return AeroModel({name: one.to_model() for name, one in by_response.items()}), Candidates(terms)
