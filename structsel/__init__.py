"""structsel: flight recordings in, an aerodynamic model out whose structure the data chose.

The journey: `read_recording`, `reconstruct`, `compute_coefficients`, `Candidates`, `select`, `AeroModel`, `validate`.
"""

from structsel.aircraft import Aircraft
from structsel.candidates import Candidates, Factor, Term
from structsel.coefficients import compute_all, compute_coefficients
from structsel.demo import demo_flights
from structsel.errors import StructselError, StructselWarning
from structsel.model import AeroModel, ResponseModel
from structsel.reconstruction import Reconstruction, Reconstructions, reconstruct, reconstruct_all
from structsel.recording import Recording, read_recording, read_recordings, write_recording
from structsel.selection import Selection, Selections, select
from structsel.validation import Ensemble, Validation, ensemble, validate

__version__ = "0.1.0"

__all__ = [
    "AeroModel",
    "Aircraft",
    "Candidates",
    "Ensemble",
    "Factor",
    "Reconstruction",
    "Reconstructions",
    "Recording",
    "ResponseModel",
    "Selection",
    "Selections",
    "StructselError",
    "StructselWarning",
    "Term",
    "Validation",
    "compute_all",
    "compute_coefficients",
    "demo_flights",
    "ensemble",
    "read_recording",
    "read_recordings",
    "reconstruct",
    "reconstruct_all",
    "select",
    "validate",
    "write_recording",
]
