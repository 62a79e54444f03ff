"""structsel: flight recordings in, an aerodynamic model out whose structure the data chose.

The journey: `read_recording`, `reconstruct`, `compute_coefficients`, `Candidates`, `select`, `AeroModel`, `validate`.
The model is simulated by `trim`, `simulate`, `refine` and `resimulate`; `design_inputs` says what to fly. `compare`
and `diagnose` say where another simulation parts from the recordings, and which physics it leaves out.
"""

from structsel.aircraft import Aircraft
from structsel.candidates import Candidates, Factor, Term
from structsel.coefficients import compute_all, compute_coefficients
from structsel.comparison import Mismatch, compare
from structsel.demo import demo_flights
from structsel.deprecation import renamed_names
from structsel.diagnosis import Diagnosis, diagnose
from structsel.errors import StructselError, StructselWarning
from structsel.exploring import explore_residuals
from structsel.exporting import export_model
from structsel.frequency_domain import (
    FrequencyResponse,
    RecursiveEstimate,
    RecursiveEstimator,
    TransferFunction,
    fit_transfer_function,
    frequency_response,
)
from structsel.inputs import InputComparison, InputDesign, compare_inputs, design_inputs
from structsel.model import AeroModel, ResponseModel
from structsel.qualification import Qualification, qualify
from structsel.reconstruction import Reconstruction, Reconstructions, reconstruct, reconstruct_all
from structsel.recording import (
    Recording,
    StoredRecording,
    read_recording,
    read_recordings,
    stream_recordings,
    write_recording,
)
from structsel.refinement import (
    Derivatives,
    EstimateComparison,
    LinearStructure,
    Refinement,
    compare_estimates,
    derivatives_by_condition,
    equation_error,
    refine,
)
from structsel.report import write_report
from structsel.selection import Selection, Selections, select
from structsel.simulation import (
    Actuator,
    Atmosphere,
    Gust,
    Instruments,
    LinearModel,
    PublishedAircraft,
    Trim,
    Turbulence,
    linearise,
    published_aircraft,
    simulate,
    trim,
)
from structsel.simulation.jsbsim import JSBSimAircraft, open_jsbsim
from structsel.validation import Ensemble, Resimulation, Validation, ensemble, resimulate, validate

__version__ = "0.1.0"

__getattr__ = renamed_names(
    __name__,
    {
        "Comparison": "EstimateComparison",
        "Replay": "Resimulation",
        "replay": "resimulate",
        "Air": "Atmosphere",
        "ReadyAircraft": "PublishedAircraft",
        "ready": "published_aircraft",
    },
)

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
    "explore_residuals",
    "export_model",
    "fit_transfer_function",
    "frequency_response",
    "linearise",
    "open_jsbsim",
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
