"""A case and its files: the data in one folder, the key in another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from proof.keys import Key
from structsel.aircraft import Aircraft, Tolerances
from structsel.recording import Recording

_DIGITS = "%.6g"


@dataclass(frozen=True, eq=False)
class Case:
    """Recordings beside a simulation that lacks something, or does not.

    Attributes
    ----------
    name : str
        Says nothing of what is concealed.
    aircraft : Aircraft
        With the tolerances that are stated.
    recordings : sequence of Recording
        One per manoeuvre, named m01, m02, ...
    simulated : mapping of recording's name to mapping of channel to (n,) array
        Each with ``t``.
    key : Key
    contribution : sequence of (n, 6) arrays
        What the effects add to measured less simulated, without noise, per recording; empty where that is not known.
    """

    name: str
    aircraft: Aircraft
    recordings: Sequence[Recording]
    simulated: Mapping[str, Mapping[str, np.ndarray]]
    key: Key
    contribution: Sequence[np.ndarray] = ()


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
    (place / "aircraft.toml").write_text(aircraft_toml(case.aircraft), encoding="utf-8")
    for recording in case.recordings:
        _write_table({"t": recording.t, **recording.channels}, place / "recordings" / f"{recording.name}.csv")
    for name, channels in case.simulated.items():
        _write_table(channels, place / "simulated" / f"{name}.csv")
    case.key.write(Path(key_folder) / f"{case.name}.json")
    return place


def aircraft_toml(aircraft: Aircraft) -> str:
    """Text of aircraft.toml with what differs from the defaults; all tolerances if any differs."""
    content = aircraft.model_dump(mode="json", exclude_defaults=True)
    if aircraft.tolerances != Tolerances():
        content["tolerances"] = aircraft.tolerances.model_dump(mode="json")
    return "\n".join(_toml_lines(content)) + "\n"


def _toml_lines(content: Mapping[str, Any], above: str = "") -> list[str]:
    """Lines of a table: its values first, then the tables within."""
    lines = [f"{key} = {_toml_value(value)}" for key, value in content.items() if not isinstance(value, Mapping)]
    if above and lines:
        lines.insert(0, f"[{above}]")
    for key, value in content.items():
        if isinstance(value, Mapping):
            lines += _toml_lines(value, f"{above}.{key}" if above else key)
    return lines


def _toml_value(value: Any) -> str:
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_toml_value, value)) + "]"
    return str(float(f"{value:.6g}"))


def _write_table(channels: Mapping[str, np.ndarray], path: Path) -> None:
    frame = pd.DataFrame({"t": channels["t"], **{k: v for k, v in channels.items() if k != "t"}})
    frame.to_csv(path, index=False, float_format=_DIGITS)
