"""A process that draws one case, or diagnoses one: ``python -m proof.worker TASK ...`` prints one line of JSON.

A diagnosis sees one folder, its own working folder. It holds a copy of the case and nothing that says where it is from.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from structsel.aircraft import Aircraft
from structsel.diagnosis import comparison
from structsel.diagnosis import diagnose as diagnose_case
from structsel.effects import EFFECTS
from structsel.errors import DataError, StructselError
from structsel.recording import Recording, read_recordings


def draw(request: str, folder: str) -> dict[str, Any]:
    """Draw a case and write it to ``folder/case/``, its key to ``folder/key/``."""
    from proof.case_files import write_case
    from proof.detectability import log_evidence_of
    from proof.generate import draw_case

    asked = json.loads(request)
    chosen = {k: asked[k] for k in ("family", "effect", "severity") if asked[k]}
    try:
        case = draw_case(asked["seed"], source=asked["source"], **chosen)
    except StructselError as error:
        return {"undrawn": str(error)}
    case = replace(case, name=asked["name"])
    keys = Path(folder) / "key"
    place = write_case(case, Path(folder) / "case", keys)
    case.key.with_log_evidence(*log_evidence_of(case, place)).write(keys / f"{case.name}.json")
    return {}


def open_case(folder: Path) -> tuple[Path, list[Recording], Aircraft]:
    """Folder of the simulation, recordings and aircraft of a case.

    Raises
    ------
    DataError
        It holds no simulation.
    """
    aircraft, recordings = Aircraft.from_toml(folder / "aircraft.toml"), read_recordings(folder / "recordings")
    if not any((folder / "simulated").glob("*.csv")):
        raise DataError(f"'{folder}' holds no simulation: there is no simulated/*.csv.")
    return folder / "simulated", recordings, aircraft


def diagnose(folder: str, without: str = "", baselines: str = "") -> dict[str, Any]:
    """Diagnose a case; effects named in `without` (separated by commas) may not be named.

    With `baselines`, also what simple methods name from the same differences and signatures.
    """
    simulation, recordings, aircraft = open_case(Path(folder))
    known = {h.name for h in EFFECTS}
    gone = [e for e in without.split(",") if e in known]
    start = time.perf_counter()
    found = diagnose_case(simulation, recordings, aircraft, without_effects=gone)
    seconds = time.perf_counter() - start
    spans = {r.name: [float(r.t[0]), float(r.t[-1])] for r in recordings}
    answer = {"diagnosis": found.to_dict(), "spans": spans, "seconds": seconds}
    if baselines:
        from proof.baselines import name_simply

        answer["simple"] = name_simply(comparison(simulation, recordings, aircraft, without_effects=gone))
    return answer


TASKS: dict[str, Callable[..., dict[str, Any]]] = {"draw": draw, "diagnose": diagnose}


def main(arguments: Sequence[str]) -> None:
    """Run one task and print its answer."""
    try:
        answer = TASKS[arguments[0]](*arguments[1:])
    except StructselError as error:
        answer = {"error": str(error)}
    sys.stdout.write(json.dumps(answer, default=float) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
