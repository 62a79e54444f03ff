"""validate(): a model against recordings, response by response."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import scipy

from structsel import whiteness
from structsel.errors import DomainError, ModelError
from structsel.formatting import UNDEFINED, finite_or_none
from structsel.metrics import MetricValues, Normaliser, compute_metrics, in_tables
from structsel.model import AeroModel
from structsel.recording import Recording, require_recordings
from structsel.recording.arguments import as_recordings, require_kind
from structsel.results import Result
from structsel.tables import Column, Summary, Table, text_column

if TYPE_CHECKING:
    import pandas as pd

_CALL = "validate(model, recordings)"
_FEWEST = 10
_WHITE = 0.05
_WHITENESS = ("bound", "outside", "ljung_box", "ljung_box_p", "durbin_watson", "white")


_WHITENESS_COLUMNS = (
    Column("DW", "3f", detail=True, note="Durbin-Watson"),
    Column("beyond", "%", detail=True, note="lags outside the 95 % bound of white residuals, 5 % are expected"),
    text_column("residual", note="white where Ljung-Box finds no autocorrelation at 5 %"),
)


@dataclass(frozen=True, eq=False, kw_only=True)
class Score(MetricValues):
    """Metrics and whiteness of one response of a model on one recording, or on all of them together.

    Attributes
    ----------
    response, recording : str
        The recording is ``"all"`` for the pooled score.
    n : int
        Samples.
    metrics : mapping of str to float
        By name, also as attributes: ``score.r2``. The correlation is nan where the model is constant.
    autocorrelation : (lags + 1,) array
        Of the residual, lag zero first; nan where the model is exact.
    bound : float
        95 % bound of the autocorrelation of white residuals.
    outside : float
        Fraction of the lags beyond the bound; about 0.05 for white residuals.
    ljung_box, ljung_box_p, durbin_watson : float
    """

    response: str
    recording: str
    n: int
    autocorrelation: np.ndarray
    bound: float
    outside: float
    ljung_box: float
    ljung_box_p: float
    durbin_watson: float

    @property
    def white(self) -> bool:
        """Whether Ljung-Box finds no autocorrelation of the residual at 5 %."""
        return bool(self.ljung_box_p > _WHITE)

    def to_dict(self) -> dict[str, Any]:
        """Return the score as plain numbers, None for what is not defined."""
        row: dict[str, Any] = {"response": self.response, "recording": self.recording, "n": self.n, **self.metrics}
        row["autocorrelation"] = self.autocorrelation.tolist()
        found: dict[str, Any] = finite_or_none(row | {name: getattr(self, name) for name in _WHITENESS})
        return found


@dataclass(frozen=True, repr=False, eq=False)
class Validation(Result):
    """Scores of a model on recordings.

    Attributes
    ----------
    model : str
        Name of the model.
    scores : tuple of Score
        One per recording and response.
    pooled : tuple of Score
        One per response, over the samples of all recordings; lags do not cross from one to the next.
    normaliser : str
        What RRMSE is relative to.
    doubts : tuple of str
        Why a number should be read with care.
    """

    model: str
    scores: tuple[Score, ...]
    pooled: tuple[Score, ...]
    normaliser: str
    doubts: tuple[str, ...] = ()

    def score(self, response: str, recording: str = "all") -> Score:
        """Score of one response, on one recording or on all.

        Raises
        ------
        ModelError
            There is no such score.
        """
        for score in (*self.pooled, *self.scores):
            if (score.response, score.recording) == (response, recording):
                return score
        have = ", ".join(f"{s.response} on {s.recording}" for s in (*self.pooled, *self.scores))
        raise ModelError(f"No score of '{response}' on '{recording}'. There are: {have}.")

    def to_frame(self) -> pd.DataFrame:
        """One row per response and recording, then the pooled ones; the autocorrelation is left out."""
        import pandas as pd

        rows = [score.to_dict() for score in (*self.scores, *self.pooled)]
        return pd.DataFrame([{k: v for k, v in row.items() if k != "autocorrelation"} for row in rows])

    def to_dict(self) -> dict[str, Any]:
        """Return everything as plain lists and numbers, None for what is not defined."""
        return {
            "schema": "structsel.validation/1",
            "model": self.model,
            "normaliser": self.normaliser,
            "scores": [score.to_dict() for score in self.scores],
            "pooled": [score.to_dict() for score in self.pooled],
            "doubts": list(self.doubts),
        }

    def summary(self) -> Summary:
        """Scores by response and recording."""
        alone = len(self.scores) == len(self.pooled)  # one recording is its own pool
        order = [score.response for score in self.pooled]
        scores = sorted([*self.scores, *(() if alone else self.pooled)], key=lambda s: order.index(s.response))
        shown = in_tables()
        rows = tuple(
            (s.response, s.recording, s.n, *(s.metrics.get(m.name) for m in shown), s.durbin_watson, s.outside,
             "white" if s.white else "coloured" if math.isfinite(s.ljung_box_p) else UNDEFINED)
            for s in scores
        )  # fmt: skip
        metrics_columns = (Column(m.label, "4f", detail=not m.brief) for m in shown)
        heads = (text_column("response"), text_column("recording"), Column("n"))
        columns = (*heads, *metrics_columns, *_WHITENESS_COLUMNS)
        size = {"rms": "rms", "std": "standard deviation", "range": "range"}[self.normaliser]
        return Summary(
            f"Model {self.model!r}" if self.model else "Model",
            "compared with recordings",
            tables=(Table(columns, rows),),
            notes=(f"RRMSE: rms error over the {size} of the measured response. TIC: 0 perfect, 1 useless.",),
            warnings=self.doubts,
        )


def validate(
    model: AeroModel,
    recordings: Recording | pd.DataFrame | Sequence[Recording | pd.DataFrame],
    *,
    responses: Iterable[str] | None = None,
    constants: Literal["auto", "model", "own"] = "auto",
    normaliser: Normaliser = "rms",
    lags: int = 40,
) -> Validation:
    """Score a model on recordings it need not have seen.

    Parameters
    ----------
    model : AeroModel
    recordings : Recording, DataFrame, or sequence of these
        With the channels the model needs and the responses measured. Whole manoeuvres held out of the
        identification judge a model; those it was fitted to only describe the fit.
    responses : iterable of str, optional
        Those to score; all of the model's by default.
    constants : {"auto", "model", "own"}
        ``"model"``: the model predicts the level too. ``"own"``: measured and modelled response are compared about
        their means over each recording, so that trim and calibration are left out. ``"auto"``: own for responses
        identified with a constant of each recording, else the model's.
    normaliser : {"rms", "std", "range"}
        See `rrmse`.
    lags : int
        Highest lag of the residual autocorrelation and of Ljung-Box, at most a fifth of the samples.

    Returns
    -------
    Validation

    Raises
    ------
    ArgumentError
        The model or the recordings are objects of another type.
    ModelError
        The model has no such response, or ``constants`` is none of the three.
    ChannelError
        A recording lacks a channel the model needs, or a response.
    DataError
        No recordings, two of one name, fewer than 10 samples, or samples that are not finite.
    DomainError
        A measured response is constant; names the response and the recording.

    References
    ----------
    [KM16], [H17], [J15]
    """
    recordings = as_recordings(recordings, _CALL)
    require_kind(model, AeroModel, _CALL)
    if responses is None:
        wanted = list(model.responses)
    else:
        wanted = [responses] if isinstance(responses, str) else list(responses)
    part = AeroModel({name: model[name] for name in wanted}, model.name, model.recordings)
    require_recordings(recordings, samples=_FEWEST, by="validate")
    if constants not in ("auto", "model", "own"):
        raise ModelError(f"validate: constants={constants!r} is not one of 'auto', 'model', 'own'.")
    own = {name for name in wanted if constants == "own" or (constants == "auto" and part[name].constants)}
    scores: list[Score] = []
    held: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {name: [] for name in wanted}
    for recording in recordings:
        recording.require(*part.channels, *wanted, finite=True, by="validate")
        modelled = part.evaluate(recording, outside="ignore")
        for name in wanted:
            pair = np.asarray(recording[name]), modelled[name]
            held[name].append((pair[0] - pair[0].mean(), pair[1] - pair[1].mean()) if name in own else pair)
            scores.append(_score(name, recording.name, held[name][-1:], part, normaliser, lags))
    doubts = part.warnings_on(recordings)
    if own and constants == "auto":
        doubts.append(
            f"{', '.join(sorted(own))}: identified with a constant of each recording, so compared about the means of "
            "each recording."
        )
    pooled = tuple(_score(name, "all", held[name], part, normaliser, lags) for name in wanted)
    for score in (*scores, *pooled):
        where = f"{score.response} on '{score.recording}'"
        if not math.isfinite(score.correlation):
            doubts.append(f"{where}: the model is constant, so no correlation.")
        if not math.isfinite(score.ljung_box_p):
            doubts.append(f"{where}: the residual is constant, so no test of whiteness.")
    return Validation(model.name, tuple(scores), pooled, normaliser, tuple(doubts))


def _score(
    name: str,
    recording: str,
    pieces: Sequence[tuple[np.ndarray, np.ndarray]],
    model: AeroModel,
    normaliser: Normaliser,
    lags: int,
) -> Score:
    """Score one response on the pieces together, lags kept inside each."""
    y, yhat = (np.concatenate(parts) for parts in zip(*pieces))
    n_terms = sum(not term.is_constant for term in model[name].terms)
    constant = np.ptp(yhat) == 0  # no correlation then, and the other metrics are defined
    try:
        values = compute_metrics(
            y, yhat, skip=("correlation",) if constant else (), n_terms=n_terms, normaliser=normaliser
        )
    except DomainError as error:
        raise DomainError(f"{name} on '{recording}': {error}") from error
    residuals = [measured - modelled for measured, modelled in pieces]
    return Score(response=name, recording=recording, n=len(y), metrics=values, **_whiteness(residuals, lags))


def _whiteness(residuals: Sequence[np.ndarray], lags: int) -> dict[str, Any]:
    n = sum(map(len, residuals))
    lags = max(1, min(lags, min(map(len, residuals)) // 5))
    bound = whiteness.white_bound(n)
    if any(np.ptp(e) == 0 for e in residuals):
        nothing = np.full(lags + 1, math.nan)
        nothing.setflags(write=False)
        nan = math.nan
        tests = {"outside": nan, "ljung_box": nan, "ljung_box_p": nan, "durbin_watson": nan}
        return {"autocorrelation": nothing, "bound": bound, **tests}
    products = [(e - e.mean()) @ (e - e.mean()) * whiteness.autocorrelation(e, lags) for e in residuals]
    rho = np.sum(products, axis=0)
    rho /= rho[0]
    rho.setflags(write=False)
    # Manoeuvres are independent, so their statistics add and so do their degrees of freedom.
    statistic = sum(whiteness.ljung_box(e, lags)[0] for e in residuals)
    steps = sum(np.sum(np.diff(e) ** 2) for e in residuals)
    return {
        "autocorrelation": rho,
        "bound": bound,
        "outside": float(np.mean(np.abs(rho[1:]) > bound)),
        "ljung_box": statistic,
        "ljung_box_p": float(scipy.stats.chi2.sf(statistic, lags * len(residuals))),
        "durbin_watson": float(steps / sum(e @ e for e in residuals)),
    }
