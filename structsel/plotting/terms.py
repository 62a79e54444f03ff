"""Figures of single terms: what a model has in a channel, what one more would add, how it holds across manoeuvres."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from structsel.candidates import Candidates, Term
from structsel.errors import DataError, ModelError
from structsel.model import AeroModel, ResponseModel
from structsel.plotting.style import (
    KEPT,
    MODELLED,
    draw_cloud,
    draw_means,
    label,
    new_axes,
    several,
    symbol,
    thin,
    unit_label,
)
from structsel.recording import Recording

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_NOTHING_NEW = 1e-9  # share of a term's variance that the model's terms leave of it
_MOST_NAMES = 20  # of manoeuvres under an axis


def plot_component(
    model: AeroModel,
    recordings: Recording | Sequence[Recording],
    response: str,
    of: str,
    *,
    bins: int = 15,
    ax: Axes | None = None,
) -> Axes:
    """Component and partial residual: what the model has in a channel, with what it leaves unexplained about it.

    Dots are the residual plus the component. Where their means leave the line, the component has another shape than
    the model gives it.

    Parameters
    ----------
    model : AeroModel
    recordings : Recording or sequence of Recording
    response : str
    of : str
        A channel: all terms in it alone, against it. Or one of the model's terms, against the term.
    bins : int, optional
    ax : Axes, optional

    Raises
    ------
    ModelError
        The model has neither such a term nor a term in that channel alone.

    References
    ----------
    [KM16], ch. 5.
    """
    ax = new_axes(ax)
    flown, one = several(recordings), model[response]
    terms = [term for term in one.terms if term.channels == (of,)] or [term for term in one.terms if str(term) == of]
    if not terms:
        raise ModelError(
            f"the model of {response} has no term in '{of}' alone, and no term of that name. "
            f"It has {', '.join(map(str, one.terms))}."
        )
    part = ResponseModel(tuple(terms), np.array([one[term] for term in terms]))
    x = np.concatenate([_values(Term(of), r) for r in flown])
    component = np.concatenate([part.evaluate(r) for r in flown])
    left = np.concatenate([r[response] - model.evaluate(r, outside="ignore")[response] for r in flown])
    draw_cloud(ax, x, component + left, flown, bins, text="mean of partial residual")
    order = np.argsort(x, kind="stable")
    order = order[thin(len(order))]
    ax.plot(x[order], component[order], color=KEPT, lw=1.6, label=" + ".join(map(str, terms)))
    ax.set_xlabel(label(of, flown[0].units) if of in flown[0] else f"${Term(of).latex()}$")
    ax.set_ylabel(f"component of {symbol(response)}{unit_label(response, flown[0].units)}")
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
    """Added-variable plot: what one more term could explain, the model's own terms taken out of both sides.

    Parameters
    ----------
    model : AeroModel
        Its terms are refitted by least squares; its values do not matter.
    recordings : Recording or sequence of Recording
    response : str
    term : Term or str
    bins : int, optional
    ax : Axes, optional

    Returns
    -------
    Axes
        The line's slope is the value the term would get. Means that bend away from it ask for another term.

    Raises
    ------
    ModelError
        The model's terms explain the term.
    """
    ax = new_axes(ax)
    flown, term = several(recordings), term if isinstance(term, Term) else Term(term)
    new, left, value = _taken_out(model, flown, response, term)
    draw_cloud(ax, new, left, flown, bins)
    ends = np.array([new.min(), new.max()])
    ax.plot(ends, value * ends, color=KEPT, lw=1.6, label=f"{value:.4g} {term}")
    ax.set_xlabel(f"${term.latex()}$, the model's terms taken out")
    ax.set_ylabel(f"{symbol(response)}, the same{unit_label(response, flown[0].units)}")
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
    """Residual against a channel as it is, and the means of its bins with one more term in the model.

    Parameters
    ----------
    model : AeroModel
        Its terms are refitted by least squares, without the term and with it.
    recordings : Recording or sequence of Recording
    response, channel : str
    term : Term or str
    bins : int, optional
    ax : Axes, optional

    Raises
    ------
    ModelError
        The model's terms explain the term.
    """
    ax = new_axes(ax)
    flown, term = several(recordings), term if isinstance(term, Term) else Term(term)
    new, left, value = _taken_out(model, flown, response, term)
    x = np.concatenate([r[channel] for r in flown])
    draw_cloud(ax, x, left, flown, bins, text="mean of each bin")
    draw_means(ax, x, left - value * new, flown, bins, colour=KEPT, text=f"the same with {term}")
    ax.set_xlabel(label(channel, flown[0].units))
    ax.set_ylabel(f"residual of {symbol(response)}{unit_label(response, flown[0].units)}")
    return _finish(ax)


def plot_across(
    models: Sequence[AeroModel],
    response: str,
    term: str,
    *,
    together: AeroModel | None = None,
    level: float = 0.95,
    ax: Axes | None = None,
) -> Axes:
    """One coefficient across manoeuvres, with its intervals.

    Parameters
    ----------
    models : sequence of AeroModel
        One per manoeuvre, of one structure: `select` with its terms forced. Those without the term stay empty.
    response, term : str
    together : AeroModel, optional
        Of all manoeuvres; its interval is a band across.
    level : float, optional
    ax : Axes, optional

    Returns
    -------
    Axes
        A manoeuvre that does not excite the term has a wide bar; those that do should agree within theirs.

    Raises
    ------
    DataError
        No model has the term.
    """
    ax = new_axes(ax)
    names = [", ".join(model.recordings) or model.name or str(i + 1) for i, model in enumerate(models)]
    at = [i for i, model in enumerate(models) if response in model and term in model[response]]
    if not at:
        raise DataError(f"none of the {len(models)} models has the term '{term}' of {response}.")
    values = np.array([models[i][response][term] for i in at])
    ax.errorbar(at, values, [_half(models[i][response], term, level) for i in at], fmt="o", ms=4, lw=1.0, capsize=3,
                color=KEPT, label=f"each, {100 * level:g} %")  # fmt: skip
    if together is not None:
        value, half = together[response][term], _half(together[response], term, level)
        ax.axhspan(value - half, value + half, color=MODELLED, alpha=0.25, lw=0)
        ax.axhline(value, color=MODELLED, lw=1.0, label=f"all together, {100 * level:g} %")
    ax.set_xlim(-0.6, len(models) - 0.4)
    if len(models) <= _MOST_NAMES:
        ax.set_xticks(range(len(models)), names, rotation=40, ha="right", fontsize="small")
    else:
        ax.set_xlabel("manoeuvre, in order")
    ax.set_ylabel(f"{symbol(response)}: ${Term(term).latex()}$ [-]")
    ax.yaxis.set_major_locator(MaxNLocator(5))
    ax.grid(alpha=0.25, axis="y")
    ax.legend(fontsize="small")
    return ax


def draw_addition(
    model: AeroModel, recordings: Recording | Sequence[Recording], response: str, channel: str, term: Term | str
) -> Figure:
    """Figure of what adding a term does: the residual against a channel without and with it, and what it adds to."""
    figure = Figure(figsize=(11.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    plot_residual_with(model, recordings, response, channel, term, ax=left)
    plot_addition(model, recordings, response, term, ax=right)
    return figure


def _values(term: Term, recording: Recording) -> np.ndarray:
    return ResponseModel((term,), np.ones(1)).evaluate(recording)


def _half(one: ResponseModel, term: str, level: float) -> float:
    """Half of a term's interval; zero, so that no bar is drawn, where it is not known."""
    return float(np.nan_to_num(one.intervals(level)[one.terms.index(Term(term)), 1] - one[term]))


def _taken_out(
    model: AeroModel, flown: Sequence[Recording], response: str, term: Term
) -> tuple[np.ndarray, np.ndarray, float]:
    """A term and the response, less what the model's own terms explain of each, and the value the term would get."""
    own = Candidates(model[response].terms)
    X = np.concatenate([np.column_stack([np.ones(len(r)), own.evaluate(r)]) for r in flown])
    both = np.concatenate([np.column_stack([_values(term, r), r[response]]) for r in flown])
    new, left = (both - X @ np.linalg.lstsq(X, both, rcond=None)[0]).T
    size = float(new @ new)
    if size <= _NOTHING_NEW * float(np.sum((both[:, 0] - both[:, 0].mean()) ** 2)):
        raise ModelError(f"the terms of {response} explain '{term}' in these recordings: it cannot add anything.")
    return new, left, float(new @ left) / size


def _finish(ax: Axes) -> Axes:
    ax.xaxis.set_major_locator(MaxNLocator(6))
    ax.legend(fontsize="small", loc="best")
    return ax
