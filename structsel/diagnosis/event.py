"""An event: a change at one moment of a recording."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from structsel.formatting import format_estimate


@dataclass(frozen=True)
class Event:
    """A change at one moment of a recording.

    Attributes
    ----------
    recording : str
    t, std : float [s]
        Time of the change, and its standard deviation.
    shape : str
        "step", "ramp" or "pulse".
    change : str
        Of a plant: what changes, and by how much; empty where that is not sought.
    """

    recording: str
    t: float
    std: float
    shape: str
    change: str = ""

    @property
    def says(self) -> str:
        """Time and shape in words."""
        what = f"{self.shape} of {self.change}" if self.change else self.shape
        return f"at {format_estimate(self.t, self.std, 's')} ({what})"

    def to_dict(self) -> dict[str, str | float]:
        """For diagnosis.json."""
        return {name: value for name, value in asdict(self).items() if value != ""}
