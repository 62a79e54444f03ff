"""Frequency domain: frequency responses and coherence, transfer functions, estimation while a flight is recorded."""

from structsel.frequency_domain.fit_transfer_function import TransferFunction, fit_transfer_function
from structsel.frequency_domain.forms import FORMS
from structsel.frequency_domain.frequency_response import FrequencyResponse, frequency_response
from structsel.frequency_domain.recursive_estimator import RecursiveEstimate, RecursiveEstimator

__all__ = [
    "FORMS",
    "FrequencyResponse",
    "RecursiveEstimate",
    "RecursiveEstimator",
    "TransferFunction",
    "fit_transfer_function",
    "frequency_response",
]
