"""explore_residuals(): what a model leaves, looked at in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from structsel.candidates import Candidates
from structsel.errors import StructselError
from structsel.model import AeroModel
from structsel.recording import Recording
from structsel.selection import Selection, Selections

if TYPE_CHECKING:
    from structsel.exploring.notebook_explorer import ResidualExplorer

_DEGREE = 2  # of the terms offered where nobody named candidates


def explore_residuals(
    selection_or_model: Selections | Selection | AeroModel,
    recordings: Recording | Sequence[Recording],
    *,
    candidates: Candidates | None = None,
) -> ResidualExplorer:
    """Look at what a model leaves unexplained, and at what adding a term would do, in a notebook.

    Pick a response, a channel and a candidate: the residual stands against the channel with the mean of each bin,
    as it is and with the term; beside it the added-variable plot of the term; below, R2, PSE and the R2 of
    recordings held out in turn, before and after.

    Parameters
    ----------
    selection_or_model : Selections, Selection or AeroModel
    recordings : Recording or sequence of Recording
        Those identified from, or others: with the channels of the model and the candidates, and the responses.
    candidates : Candidates, optional
        What may be added. Else the pool of the selection; of a model, products of two of its channels.

    Returns
    -------
    ResidualExplorer
        A widget, shown where it is a cell's last line. ``.additions`` has the numbers of all candidates.

    Raises
    ------
    StructselError
        ipywidgets is not installed; the message says how to.
    ChannelError, DataError
        A channel is missing, or not finite.
    SelectionError
        No candidate tells anything that the terms of the model do not.
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
    flown = [recordings] if isinstance(recordings, Recording) else list(recordings)
    return ResidualExplorer(model, flown, candidates or pool)


def _model_and_pool(given: Selections | Selection | AeroModel) -> tuple[AeroModel, Candidates]:
    if isinstance(given, AeroModel):
        return given, Candidates.polynomial(given.channels, _DEGREE)
    by_response = {given.response: given} if isinstance(given, Selection) else dict(given)
    terms = [term for one in by_response.values() for term in one.pool]
    return AeroModel({name: one.to_model() for name, one in by_response.items()}), Candidates(terms)
