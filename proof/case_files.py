"""A case and its files: the data in one folder, the key in another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from proof.keys import Key
from structsel.aircraft import Aircraft
from structsel.recording import Recording

_DIGITS = "%.6g"


@dataclass(frozen=True, eq=False)
class Case:
    """Recordings and a simulation, which may lack an effect.

    Attributes
    ----------
    name : str
        Without information on the effect.
    aircraft : Aircraft
        With the tolerances that are stated.
    recordings : sequence of Recording
        One per manoeuvre, named m01, m02, ...
    simulated : mapping of recording's name to mapping of channel to (n,) array
        Each with ``t``.
    key : Key
    contribution : sequence of (n, 6) arrays
        Contribution of the effects to measured minus simulated, without noise, per recording; empty if not known.
    of_each : sequence of sequences of (n, 6) arrays
        The same for each effect of a pair, in the order of the key; empty otherwise.
    """

    name: str
    aircraft: Aircraft
    recordings: Sequence[Recording]
    simulated: Mapping[str, Mapping[str, np.ndarray]]
    key: Key
    contribution: Sequence[np.ndarray] = ()
    of_each: Sequence[Sequence[np.ndarray]] = ()


def write_case(case: Case, folder: str | Path, key_folder: str | Path) -> Path:
    """Write a case to ``folder/name/`` and its key to ``key_folder/name.json``, each number with six digits.

    Parameters
    ----------
    case : Case
    folder, key_folder : str or Path
        Made where they are not there. Files of an earlier case of this name are replaced.

    Returns
    -------
    Path
        The case's own folder: aircraft.toml, recordings/, simulated/.
    """
    place = Path(folder) / case.name
    for part in ("recordings", "simulated"):
        (place / part).mkdir(parents=True, exist_ok=True)
    Aircraft.from_dict(_rounded(case.aircraft.to_dict())).to_toml(place / "aircraft.toml")
    for recording in case.recordings:
        _write_table({"t": recording.t, **recording.channels}, place / "recordings" / f"{recording.name}.csv")
    for name, channels in case.simulated.items():
        _write_table(channels, place / "simulated" / f"{name}.csv")
    case.key.write(Path(key_folder) / f"{case.name}.json")
    return place


def _rounded(content: Any) -> Any:
    """Content with each number to six digits."""
    if isinstance(content, Mapping):
        return {key: _rounded(value) for key, value in content.items()}
    if isinstance(content, (list, tuple)):
        return [_rounded(value) for value in content]
    return content if isinstance(content, str) else float(f"{content:.6g}")


def _write_table(channels: Mapping[str, np.ndarray], path: Path) -> None:
    frame = pd.DataFrame({"t": channels["t"], **{k: v for k, v in channels.items() if k != "t"}})
    frame.to_csv(path, index=False, float_format=_DIGITS)
