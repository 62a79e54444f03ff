"""Recording: named SI channels on one time axis; reading, checking, splitting and writing them.

Measured, reconstructed and simulated flights are all Recordings, so that any two can be compared. A *manoeuvre* is one
continuous Recording.
"""

from structsel.deprecation import renamed_names
from structsel.recording.finding import Finding
from structsel.recording.manoeuvres import FlightSegment, find_manoeuvres, split_manoeuvres
from structsel.recording.reading import read_recording, read_recordings
from structsel.recording.recording import Recording
from structsel.recording.sets import DataWarning, require_recordings, warn_of_entry_errors, with_entry_findings
from structsel.recording.stored import StoredRecording, stream_recordings
from structsel.recording.writing import write_recording

__all__ = [
    "DataWarning",
    "Finding",
    "FlightSegment",
    "Recording",
    "StoredRecording",
    "find_manoeuvres",
    "read_recording",
    "read_recordings",
    "require_recordings",
    "split_manoeuvres",
    "stream_recordings",
    "warn_of_entry_errors",
    "with_entry_findings",
    "write_recording",
]

__getattr__ = renamed_names(__name__, {"Stretch": "FlightSegment"})
