"""Frequency domain: frequency responses and coherence, transfer functions, estimation while a flight is recorded."""

from structsel.frequency_domain.fit_transfer_function import TransferFunction, fit_transfer_function
from structsel.frequency_domain.forms import FORMS
from structsel.frequency_domain.frequency_response import FrequencyResponse, frequency_response

__all__ = [
    "FORMS",
    "FrequencyResponse",
    "TransferFunction",
    "fit_transfer_function",
    "frequency_response",
]
