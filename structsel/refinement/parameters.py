"""Names of what can be estimated, and where each stands in the parameter vector.

============================  ================================================================================
``CL:alpha``                  term of a response of an AeroModel; a linear structure names its own
``start:m01:alpha``           state at the first sample of recording m01
``drift:m01:w``               constant added to a state equation in m01, unit of the state per second
``bias:m01:az``               constant added to an output in m01
``reference:az``              constant added to an output in all recordings
``scale:alpha``               factor of an output in all recordings
``delay``                     time by which the inputs act late [s]
``process:w``                 process noise of a state, standard deviation per root of a second
``jump:m01:w``                state at the start of m01 less that at its end; in the frequency domain
============================  ================================================================================
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from structsel.errors import ModelError
from structsel.nomenclature import suggest

Kind: TypeAlias = Literal["model", "start", "drift", "bias", "reference", "scale", "delay", "process", "jump"]


@dataclass(frozen=True)
class Parameter:
    """One number that can be estimated.

    Attributes
    ----------
    name : str
    kind : {"model", "start", "drift", "bias", "reference", "scale", "delay", "process", "jump"}
    value : float
        Where the search starts.
    low, high : float
        Bounds, infinite where there is none.
    scale : float
        Typical size, above zero.
    recording : str
        The one it belongs to; empty where it belongs to all.
    """

    name: str
    kind: Kind
    value: float
    low: float = -np.inf
    high: float = np.inf
    scale: float = 1.0
    recording: str = ""


def bound(parameters: Sequence[Parameter], bounds: Mapping[str, tuple[float, float]]) -> list[Parameter]:
    """Parameters with these bounds, each start brought inside.

    A name's last part may be left open: ``"start:m01:"`` bounds all of that beginning.

    Raises
    ------
    ModelError
        A name that is not estimated, or bounds that cross.
    """
    found = {p.name: p for p in parameters}
    for key, (low, high) in bounds.items():
        which = [name for name in found if name == key or (key.endswith(":") and name.startswith(key))]
        if not which:
            raise ModelError(
                f"refine was given bounds of '{key}', which is not estimated.{suggest(key, found)} "
                f"Estimated are: {', '.join(found)}."
            )
        if not low < high:
            raise ModelError(f"refine was given bounds of '{key}' from {low:g} to {high:g}. Write the lower first.")
        for name in which:
            p = found[name]
            start = float(np.clip(p.value, low, high))
            found[name] = Parameter(p.name, p.kind, start, float(low), float(high), p.scale, p.recording)
    return list(found.values())
