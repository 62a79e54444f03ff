"""Work done in a process of its own: a case drawn, or diagnosed.

``python -m structsel.proving.apart TASK ...`` prints one line of JSON. Who diagnoses is told of one folder, its own
working folder, which holds the case and nothing that says where it came from.
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
from structsel.effects import HYPOTHESES
from structsel.errors import DataError, StructselError
from structsel.recording import Recording, read_recordings


def draw(request: str, folder: str) -> dict[str, Any]:
    """Draw a case and write it to ``folder/case/``, its key to ``folder/key/``."""
    from structsel.proving.cases import write_case
    from structsel.proving.deciding import nats_of

    asked = json.loads(request)
    chosen = {k: asked[k] for k in ("family", "effect", "severity") if asked[k]}
    try:
        case = _drawer(asked["source"])(asked["seed"], **chosen)
    except (RuntimeError, StructselError) as error:
        return {"undrawn": str(error)}
    case = replace(case, name=asked["name"])
    keys = Path(folder) / "key"
    nats = nats_of(case, write_case(case, Path(folder) / "case", keys))
    case.key.with_nats(nats).write(keys / f"{case.name}.json")
    return {}


def _drawer(source: str) -> Callable[..., Any]:
    if source == "own":
        from structsel.proving.drawing import draw_case

        return draw_case
    from structsel.proving.jsbsim.drawing import draw_jsbsim_case

    return draw_jsbsim_case


def open_case(folder: Path) -> tuple[Any, list[Recording], Aircraft]:
    """Simulation, recordings and aircraft of a case's folder.

    Raises
    ------
    DataError
        It holds no simulation.
    """
    aircraft, recordings = Aircraft.from_toml(folder / "aircraft.toml"), read_recordings(folder / "recordings")
    if any((folder / "simulated").glob("*.csv")):
        return folder / "simulated", recordings, aircraft
    if models := sorted(folder.glob("*.json")):
        return models[0], recordings, aircraft
    if crafts := sorted(folder.glob("*.xml")):
        return f"jsbsim:{crafts[0]}", recordings, aircraft
    raise DataError(f"'{folder}' holds no simulation: neither simulated/*.csv nor a model nor an aircraft of JSBSim.")


def diagnose(folder: str, without: str = "", simple: str = "") -> dict[str, Any]:
    """Diagnose a case; hypotheses named in `without` (separated by commas) are taken out of the library.

    With `simple`, what simple ways name in it too, of the same differences and signatures.
    """
    from structsel.comparison.preparing import prepare
    from structsel.diagnosis.diagnose import conclude, set_up

    simulation, recordings, aircraft = open_case(Path(folder))
    gone = set(filter(None, without.split(",")))
    start = time.perf_counter()
    prepared = prepare(simulation, recordings, aircraft)
    ready = set_up(prepared.flights, tuple(h for h in HYPOTHESES if h.effect not in gone))
    found = conclude(prepared, ready)
    seconds = time.perf_counter() - start
    spans = {r.name: [float(r.t[0]), float(r.t[-1])] for r in recordings}
    made = {"diagnosis": found.to_dict(), "spans": spans, "seconds": seconds}
    if simple:
        from structsel.proving.baselines import name_simply

        made["simple"] = name_simply(ready[0].flights, ready[1])
    return made


TASKS: dict[str, Callable[..., dict[str, Any]]] = {"draw": draw, "diagnose": diagnose}


def main(arguments: Sequence[str]) -> None:
    """Run one task and print what came of it."""
    try:
        made = TASKS[arguments[0]](*arguments[1:])
    except StructselError as error:
        made = {"error": str(error)}
    sys.stdout.write(json.dumps(made, default=float) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
