"""How well a model holds on recordings and flies them, and how its values scatter over manoeuvres."""

from structsel.validation.ensembles import Ensemble, ensemble
from structsel.validation.metrics import (
    adjusted_r2,
    autocorrelation,
    correlation,
    durbin_watson,
    ljung_box,
    r2,
    rrmse,
    tic,
    white_bound,
)
from structsel.validation.replay import BANDS, recorded_start, replay
from structsel.validation.replayed import Departure, Replay, ReplayScore
from structsel.validation.scores import Score, Validation, validate

__all__ = [
    "BANDS",
    "Departure",
    "Ensemble",
    "Replay",
    "ReplayScore",
    "Score",
    "Validation",
    "adjusted_r2",
    "autocorrelation",
    "correlation",
    "durbin_watson",
    "ensemble",
    "ljung_box",
    "r2",
    "recorded_start",
    "replay",
    "rrmse",
    "tic",
    "validate",
    "white_bound",
]
