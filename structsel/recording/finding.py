"""Finding: one fault or remark about a recording.

A finding has one of three severities:

- ``error``: the samples cannot be used (NaN, infinity);
- ``warning``: very probably a fault (a unit, a sign, a dead instrument);
- ``note``: for information (a constant channel, a missing sample).

Samples are counted from 0, as in arrays.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from structsel.formatting import as_sentence


@dataclass(frozen=True)
class Finding:
    """One finding about a recording.

    Attributes
    ----------
    kind : str
        From the samples: gap, dropped, jitter, not-finite, constant, stuck, implausible, unit, sign.
        From the file: header, text, file; from a log: clock (the resampling), silent (a dropout), assumed.
        From an operation on the samples: spike. Other functions have kinds of their own.
    channel : str
    message : str
    severity : {"note", "warning", "error"}
    remedy : str
    sample : int or None
        First sample concerned, counted from 0; None if the finding is about the complete channel.
    time : float or None [s]
    count : int
        Number of samples, or of intervals, concerned.
    """

    kind: str
    channel: str
    message: str
    severity: str = "warning"
    remedy: str = ""
    sample: int | None = None
    time: float | None = None
    count: int = 1

    @classmethod
    def of_samples(
        cls,
        kind: str,
        channel: str,
        message: str,
        severity: str,
        remedy: str,
        t: np.ndarray,
        samples: np.ndarray,
    ) -> Finding:
        """Finding about some samples of the time axis `t`: it has the first of them and their number."""
        i = int(samples[0])
        return cls(kind, channel, message, severity, remedy, i, float(t[i]), len(samples))

    def __str__(self) -> str:
        at = ""
        if self.sample is not None:
            at = f" at sample {self.sample}"
            if self.time is not None:
                at += f" (t = {self.time:g} s)"
        return f"{self.severity}: {self.channel}: {self.message}{at}. {as_sentence(self.remedy)}".rstrip()

    def to_dict(self) -> dict[str, Any]:
        """Fields by name."""
        return asdict(self)
