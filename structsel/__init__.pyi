# ruff: noqa: I001
"""Public names for type checkers and editors; at run time `__init__.py` imports each at its first use."""

from typing import Any, overload

from structsel import estimators as estimators, plotting as plotting
from structsel.aircraft import Aircraft as Aircraft
from structsel.candidates import Candidates as Candidates, Factor as Factor, Term as Term
from structsel.coefficients import compute_all as compute_all, compute_coefficients as compute_coefficients
from structsel.comparison import Mismatch as Mismatch, compare as compare
from structsel.demo import demo_flights as demo_flights
from structsel.diagnosis import Diagnosis as Diagnosis, diagnose as diagnose
from structsel.errors import StructselError as StructselError, StructselWarning as StructselWarning
from structsel.exploring import explore_residuals as explore_residuals
from structsel.exporting import export_model as export_model
from structsel.frequency_domain import (
    FrequencyResponse as FrequencyResponse,
    RecursiveEstimate as RecursiveEstimate,
    RecursiveEstimator as RecursiveEstimator,
    TransferFunction as TransferFunction,
    fit_transfer_function as fit_transfer_function,
    frequency_response as frequency_response,
)
from structsel.inputs import (
    InputComparison as InputComparison,
    InputDesign as InputDesign,
    compare_inputs as compare_inputs,
    design_inputs as design_inputs,
)
from structsel.model import AeroModel as AeroModel, ResponseModel as ResponseModel
from structsel.qualification import Qualification as Qualification, qualify as qualify
from structsel.reconstruction import (
    Reconstruction as Reconstruction,
    Reconstructions as Reconstructions,
    reconstruct as reconstruct,
    reconstruct_all as reconstruct_all,
)
from structsel.recording import (
    Recording as Recording,
    StoredRecording as StoredRecording,
    read_recording as read_recording,
    read_recordings as read_recordings,
    stream_recordings as stream_recordings,
    write_recording as write_recording,
)
from structsel.refinement import (
    Derivatives as Derivatives,
    EstimateComparison as EstimateComparison,
    LinearStructure as LinearStructure,
    Refinement as Refinement,
    compare_estimates as compare_estimates,
    derivatives_by_condition as derivatives_by_condition,
    equation_error as equation_error,
    refine as refine,
)
from structsel.report import write_report as write_report
from structsel.selection import Selection as Selection, Selections as Selections
from structsel.simulation import (
    Actuator as Actuator,
    Atmosphere as Atmosphere,
    Gust as Gust,
    Instruments as Instruments,
    LinearModel as LinearModel,
    PublishedAircraft as PublishedAircraft,
    Trim as Trim,
    Turbulence as Turbulence,
    linearise as linearise,
    published_aircraft as published_aircraft,
    simulate as simulate,
    trim as trim,
)
from structsel.simulation.jsbsim import JSBSimAircraft as JSBSimAircraft, open_jsbsim as open_jsbsim
from structsel.validation import (
    Ensemble as Ensemble,
    Resimulation as Resimulation,
    Validation as Validation,
    ensemble as ensemble,
    resimulate as resimulate,
    validate as validate,
)

__version__: str

@overload
def select(recordings: Any, responses: str, candidates: Any, **options: Any) -> Selection: ...
@overload
def select(recordings: Any, responses: list[str] | tuple[str, ...], candidates: Any, **options: Any) -> Selections: ...
