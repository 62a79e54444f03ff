"""Figures of single terms: contribution to a model, effect of adding one, and estimates over manoeuvres."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from structsel.candidates import Candidates, Term
from structsel.errors import DataError, ModelError
from structsel.formatting import format_number
from structsel.model import AeroModel, ResponseModel
from structsel.plotting.style import (
    MODEL,
    SELECTED,
    as_list,
    bin_mean_errorbars,
    decimate,
    display_values,
    get_axes,
    label,
    name_manoeuvres,
    scale,
    scatter_with_bin_means,
    symbol,
)
from structsel.recording import Recording

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_RANK_TOLERANCE = 1e-9  # fraction of a term's variance that the terms of the model must leave unexplained


def plot_component(
    model: AeroModel,
    recordings: Recording | Sequence[Recording],
    response: str,
    of: str,
    *,
    bins: int = 15,
    ax: Axes | None = None,
) -> Axes:
    """Component-plus-residual plot: what the terms in one channel contribute, and the partial residual.

    Dots are the residual plus the component. Where their bin means leave the line, the dependence on the channel has
    another shape than in the model.

    Parameters
    ----------
    model : AeroModel
    recordings : Recording or sequence of Recording
    response : str
    of : str
        A channel: all terms in this channel alone are drawn over the channel. Or a term of the model, drawn over the
        values of the term.
    bins : int, optional
    ax : Axes, optional

    Returns
    -------
    Axes
        Angles are in degrees; the values of a term are in SI units and radians.

    Raises
    ------
    ModelError
        The model has neither such a term nor a term in that channel alone.

    References
    ----------
    [KM16], ch. 5.
    """
    ax = get_axes(ax)
    flights, one = as_list(recordings), model[response]
    terms = [term for term in one.terms if term.channels == (of,)] or [term for term in one.terms if str(term) == of]
    if not terms:
        raise ModelError(
            f"the model of {response} has no term in '{of}' alone, and no term of that name. "
            f"It has {', '.join(map(str, one.terms))}."
        )
    units, is_channel = flights[0].units, of in flights[0]
    factor = scale(response, units)
    part = ResponseModel(tuple(terms), np.array([one[term] for term in terms]))
    x = np.concatenate([display_values(r, of) if is_channel else _values(Term(of), r) for r in flights])
    component = factor * np.concatenate([part.evaluate(r) for r in flights])
    residual = factor * np.concatenate([r[response] - model.evaluate(r, outside="ignore")[response] for r in flights])
    scatter_with_bin_means(ax, x, component + residual, flights, bins, text="mean of partial residual")
    order = np.argsort(x, kind="stable")
    order = order[decimate(len(order))]
    ax.plot(x[order], component[order], color=SELECTED, lw=1.6, label=" + ".join(map(str, terms)))
    ax.set_xlabel(label(of, units) if is_channel else f"${Term(of).latex()}$ [SI, rad]")
    ax.set_ylabel(label(response, units, text=f"component of {symbol(response)}"))
    return _finish(ax)


def plot_addition(
    model: AeroModel,
    recordings: Recording | Sequence[Recording],
    response: str,
    term: Term | str,
    *,
    bins: int = 15,
    ax: Axes | None = None,
) -> Axes:
    """Added-variable plot of a term: residual of the response over the residual of the term, both on the model's terms.

    Parameters
    ----------
    model : AeroModel
        Its terms are refitted by least squares; their values are not used.
    recordings : Recording or sequence of Recording
    response : str
    term : Term or str
    bins : int, optional
    ax : Axes, optional

    Returns
    -------
    Axes
        In SI units and radians: the slope of the line is the estimate that the term would have in the model. If the
        bin means curve away from the line, a further term is missing.

    Raises
    ------
    ModelError
        The term is a linear combination of the model's terms.
    """
    ax = get_axes(ax)
    flights, term = as_list(recordings), term if isinstance(term, Term) else Term(term)
    x, residual, value = _partial_out(model, flights, response, term)
    scatter_with_bin_means(ax, x, residual, flights, bins)
    ends = np.array([x.min(), x.max()])
    ax.plot(ends, value * ends, color=SELECTED, lw=1.6, label=f"{format_number(value)} {term}")
    ax.set_xlabel(f"residual of ${term.latex()}$ [SI, rad]")
    ax.set_ylabel(f"residual of {symbol(response)} [SI, rad]")
    return _finish(ax)


def plot_residual_with(
    model: AeroModel,
    recordings: Recording | Sequence[Recording],
    response: str,
    channel: str,
    term: Term | str,
    *,
    bins: int = 15,
    ax: Axes | None = None,
) -> Axes:
    """Draw the residual over a channel, and its bin means without and with one more term in the model.

    Parameters
    ----------
    model : AeroModel
        Its terms are refitted by least squares, without the term and with it.
    recordings : Recording or sequence of Recording
    response, channel : str
    term : Term or str
    bins : int, optional
    ax : Axes, optional

    Returns
    -------
    Axes
        Angles are in degrees.

    Raises
    ------
    ModelError
        The term is a linear combination of the model's terms.
    """
    ax = get_axes(ax)
    flights, term = as_list(recordings), term if isinstance(term, Term) else Term(term)
    units = flights[0].units
    x, residual, value = _partial_out(model, flights, response, term)
    along, factor = np.concatenate([display_values(r, channel) for r in flights]), scale(response, units)
    scatter_with_bin_means(ax, along, factor * residual, flights, bins, text="mean of each bin")
    with_term = factor * (residual - value * x)
    bin_mean_errorbars(ax, along, with_term, flights, bins, colour=SELECTED, text=f"with {term}")
    ax.set_xlabel(label(channel, units))
    ax.set_ylabel(label(response, units, text=f"residual of {symbol(response)}"))
    return _finish(ax)


def plot_estimates_by_manoeuvre(
    models: Sequence[AeroModel],
    response: str,
    term: str,
    *,
    together: AeroModel | None = None,
    level: float = 0.95,
    ax: Axes | None = None,
) -> Axes:
    """Draw the estimate of one parameter from each manoeuvre, with its interval.

    Parameters
    ----------
    models : sequence of AeroModel
        One model for each manoeuvre, all with the same structure: `select` with ``include`` of its terms. A model
        without the term has no point.
    response, term : str
    together : AeroModel, optional
        Model identified from all manoeuvres together; its interval is a horizontal band.
    level : float, optional
    ax : Axes, optional

    Returns
    -------
    Axes
        In SI units and radians. A manoeuvre that does not excite the term has a wide interval; the other estimates
        should agree within their intervals.

    Raises
    ------
    DataError
        No model has the term.
    """
    ax = get_axes(ax)
    names = [", ".join(model.recordings) or model.name or str(i + 1) for i, model in enumerate(models)]
    at = [i for i, model in enumerate(models) if response in model and term in model[response]]
    if not at:
        raise DataError(f"none of the {len(models)} models has the term '{term}' of {response}.")
    values = np.array([models[i][response][term] for i in at])
    half = [_half_interval(models[i][response], term, level) for i in at]
    text = f"{100.0 * level:g} % interval"
    ax.errorbar(at, values, half, fmt="o", ms=4, lw=1.0, capsize=3, color=SELECTED, label=f"each, {text}")
    if together is not None:
        value, width = together[response][term], _half_interval(together[response], term, level)
        ax.axhspan(value - width, value + width, color=MODEL, alpha=0.25, lw=0)
        ax.axhline(value, color=MODEL, lw=1.0, label=f"all together, {text}")
    name_manoeuvres(ax, names)
    ax.set_ylabel(f"{symbol(response)}: parameter of ${Term(term).latex()}$ [SI, rad]")
    ax.legend(fontsize="small")
    return ax


def draw_addition(
    model: AeroModel, recordings: Recording | Sequence[Recording], response: str, channel: str, term: Term | str
) -> Figure:
    """Figure of the effect of one more term: residual over a channel without and with it, and added-variable plot."""
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    plot_residual_with(model, recordings, response, channel, term, ax=left)
    plot_addition(model, recordings, response, term, ax=right)
    return figure


def _values(term: Term, recording: Recording) -> np.ndarray:
    return ResponseModel((term,), np.ones(1)).evaluate(recording)


def _half_interval(one: ResponseModel, term: str, level: float) -> float:
    """Half of the interval of a term; zero, so that no bar is drawn, if it is unknown."""
    return float(np.nan_to_num(one.intervals(level)[one.terms.index(Term(term)), 1] - one[term]))


def _partial_out(
    model: AeroModel, flights: Sequence[Recording], response: str, term: Term
) -> tuple[np.ndarray, np.ndarray, float]:
    """Residuals of a term and of the response on the model's terms, and the estimate of the term in the model."""
    own = Candidates(model[response].terms)
    X = np.concatenate([np.column_stack([np.ones(len(r)), own.evaluate(r)]) for r in flights])
    both = np.concatenate([np.column_stack([_values(term, r), r[response]]) for r in flights])
    x, residual = (both - X @ np.linalg.lstsq(X, both, rcond=None)[0]).T
    size = float(x @ x)
    if size <= _RANK_TOLERANCE * float(np.sum((both[:, 0] - both[:, 0].mean()) ** 2)):
        raise ModelError(f"the terms of {response} explain '{term}' in these recordings: it cannot add anything.")
    return x, residual, float(x @ residual) / size


def _finish(ax: Axes) -> Axes:
    ax.xaxis.set_major_locator(MaxNLocator(6))
    ax.legend(fontsize="small", loc="best")
    return ax
