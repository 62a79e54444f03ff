"""structsel: identifies aerodynamic models from flight-test recordings and selects the model structure from the data.

The journey: `read_recording`, `reconstruct`, `compute_coefficients`, `Candidates`, `select`, `AeroModel`, `validate`.
The model is simulated by `trim`, `simulate`, `refine` and `resimulate`; `design_inputs` says what to fly. `compare`
and `diagnose` say where another simulation parts from the recordings, and which physics it leaves out.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_MODULES = ("estimators", "plotting")
_PLACES = {
    "aircraft": "Aircraft",
    "candidates": "Candidates Factor Term",
    "coefficients": "compute_all compute_coefficients",
    "comparison": "Mismatch compare",
    "demo": "demo_flights",
    "diagnosis": "Diagnosis diagnose",
    "errors": "StructselError StructselWarning",
    "exploring": "explore_residuals",
    "exporting": "export_model",
    "frequency_domain": (
        "FrequencyResponse RecursiveEstimate RecursiveEstimator TransferFunction fit_transfer_function "
        "frequency_response"
    ),
    "inputs": "InputComparison InputDesign compare_inputs design_inputs",
    "model": "AeroModel ResponseModel",
    "qualification": "Qualification qualify",
    "reconstruction": "Reconstruction Reconstructions reconstruct reconstruct_all",
    "recording": "Recording StoredRecording read_recording read_recordings stream_recordings write_recording",
    "refinement": (
        "Derivatives EstimateComparison LinearStructure Refinement compare_estimates "
        "derivatives_by_condition equation_error refine"
    ),
    "report": "write_report",
    "selection": "Selection Selections select",
    "simulation": (
        "Actuator Atmosphere Gust Instruments LinearModel PublishedAircraft Trim Turbulence linearise "
        "published_aircraft simulate trim"
    ),
    "simulation.jsbsim": "JSBSimAircraft open_jsbsim",
    "validation": "Ensemble Resimulation Validation ensemble resimulate validate",
}
"""Public names by the module that each is imported from when it is first used."""
_MODULE_OF = {name: module for module, names in _PLACES.items() for name in names.split()}
_RENAMED = {
    "Comparison": "EstimateComparison",
    "Replay": "Resimulation",
    "replay": "resimulate",
    "Air": "Atmosphere",
    "ReadyAircraft": "PublishedAircraft",
    "ready": "published_aircraft",
}


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(f"{__name__}.{name}")
    if name in _MODULE_OF:
        value = getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
        globals()[name] = value  # the next use finds it without this function
        return value
    from structsel.deprecation import renamed_names

    return renamed_names(__name__, _RENAMED)(name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_MODULE_OF, *_MODULES})


__all__ = [
    "Actuator",
    "AeroModel",
    "Aircraft",
    "Atmosphere",
    "Candidates",
    "Derivatives",
    "Diagnosis",
    "Ensemble",
    "EstimateComparison",
    "Factor",
    "FrequencyResponse",
    "Gust",
    "InputComparison",
    "InputDesign",
    "Instruments",
    "JSBSimAircraft",
    "LinearModel",
    "LinearStructure",
    "Mismatch",
    "PublishedAircraft",
    "Qualification",
    "Reconstruction",
    "Reconstructions",
    "Recording",
    "RecursiveEstimate",
    "RecursiveEstimator",
    "Refinement",
    "Resimulation",
    "ResponseModel",
    "Selection",
    "Selections",
    "StoredRecording",
    "StructselError",
    "StructselWarning",
    "Term",
    "TransferFunction",
    "Trim",
    "Turbulence",
    "Validation",
    "compare",
    "compare_estimates",
    "compare_inputs",
    "compute_all",
    "compute_coefficients",
    "demo_flights",
    "derivatives_by_condition",
    "design_inputs",
    "diagnose",
    "ensemble",
    "equation_error",
    "estimators",
    "explore_residuals",
    "export_model",
    "fit_transfer_function",
    "frequency_response",
    "linearise",
    "open_jsbsim",
    "plotting",
    "published_aircraft",
    "qualify",
    "read_recording",
    "read_recordings",
    "reconstruct",
    "reconstruct_all",
    "refine",
    "resimulate",
    "select",
    "simulate",
    "stream_recordings",
    "trim",
    "validate",
    "write_recording",
    "write_report",
]
