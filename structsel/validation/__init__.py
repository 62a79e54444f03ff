"""Validation of a model on recordings: its responses, its simulation, and the scatter of values over manoeuvres."""

from structsel.deprecation import renamed_names
from structsel.metrics import adjusted_r2, bias, correlation, metric, r2, rms_error, rrmse, tic
from structsel.validation.ensembles import Ensemble, ensemble
from structsel.validation.resimulate import BANDS, resimulate
from structsel.validation.resimulation import Divergence, Resimulation, ResimulationScore
from structsel.validation.validate import Score, Validation, validate
from structsel.whiteness import autocorrelation, durbin_watson, ljung_box, white_bound

__getattr__ = renamed_names(
    __name__,
    {
        "Departure": "Divergence",
        "Replay": "Resimulation",
        "ReplayScore": "ResimulationScore",
        "recorded_start": "structsel.simulation:start_from",
        "replay": "resimulate",
    },
)

__all__ = [
    "BANDS",
    "Divergence",
    "Ensemble",
    "Resimulation",
    "ResimulationScore",
    "Score",
    "Validation",
    "adjusted_r2",
    "autocorrelation",
    "bias",
    "correlation",
    "durbin_watson",
    "ensemble",
    "ljung_box",
    "metric",
    "r2",
    "resimulate",
    "rms_error",
    "rrmse",
    "tic",
    "validate",
    "white_bound",
]
