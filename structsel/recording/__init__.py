"""Recording: named SI channels on one clock; reading, checking and cutting them.

Measured, reconstructed and simulated flights are all Recordings, so any two compare. A
*manoeuvre* is one continuous Recording.
"""

from structsel.recording.checks import Finding
from structsel.recording.reading import read_recording, read_recordings
from structsel.recording.recording import Recording

__all__ = ["Finding", "Recording", "read_recording", "read_recordings"]
