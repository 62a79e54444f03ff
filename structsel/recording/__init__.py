"""Recording: named SI channels on one clock; reading, checking, cutting and writing them.

Measured, reconstructed and simulated flights are all Recordings, so any two compare. A
*manoeuvre* is one continuous Recording.
"""

from structsel.recording.checks import Finding
from structsel.recording.manoeuvres import Stretch, find_manoeuvres, split_manoeuvres
from structsel.recording.reading import read_recording, read_recordings
from structsel.recording.recording import Recording
from structsel.recording.sets import require_recordings
from structsel.recording.stored import StoredRecording, stream_recordings
from structsel.recording.writing import write_recording

__all__ = [
    "Finding",
    "Recording",
    "StoredRecording",
    "Stretch",
    "find_manoeuvres",
    "read_recording",
    "read_recordings",
    "require_recordings",
    "split_manoeuvres",
    "stream_recordings",
    "write_recording",
]
