"""``structsel diagnose``: what did the simulation leave out?"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.text import Text

from structsel.aircraft import Aircraft
from structsel.cli.folders import output_folder, refuse_existing
from structsel.cli.help_text import page
from structsel.cli.input_files import provenance
from structsel.cli.messages import Waiting, json_text, print_json, quiet, say, stdout
from structsel.cli.recordings import (
    OUTPUT,
    Json,
    Map,
    Overwrite,
    hold_out,
    load_aircraft,
    option,
    read_files,
    read_manoeuvres,
)
from structsel.cli.tables import print_files
from structsel.errors import DataError
from structsel.recording import Recording, write_recording

if TYPE_CHECKING:
    from structsel.diagnosis.patching import Patched
    from structsel.diagnosis.result import Diagnosis

EPILOG = page(
    [
        (
            "What does the simulation leave out",
            "structsel diagnose --aircraft aircraft.toml --recordings recordings/ \\\n"
            "    --simulation simulated/ --out out/",
        ),
        (
            "A model of structsel's own, judged by two flights",
            "structsel diagnose --aircraft aircraft.toml --recordings flights/ \\\n"
            "    --map map.toml --simulation model.json --held-out m05,m06 --out out/",
        ),
        (
            "JSBSim's aircraft; a function of your own",
            "structsel diagnose --aircraft aircraft.toml --recordings recordings/ \\\n"
            "    --simulation jsbsim:c172p --json\n"
            "  structsel diagnose --aircraft aircraft.toml --recordings recordings/ \\\n"
            "    --simulation python:mysim:coefficients",
        ),
    ],
    """[bold]Simulated files[/bold] have the recordings' names. Those with t and any of CX CY CZ Cl Cm Cn hold what the
    simulation says along the recorded path; those with V, alpha, ... hold its own flight with the recorded inputs from
    the same start. Names and units are structsel's: --map is for the recordings.""",
    """\\[tolerances] in the aircraft file say how far off the simulation and the instruments may be before it is
    physics. Without --held-out each recording is judged by what the others say.""",
    """[bold]--out[/bold] gets diagnosis.json, report.html, which opens in any browser without a network, and
    model.json, the simulation with what was missing; of JSBSim's aircraft also the folder AIRCRAFT-corrected, where the
    physics can be written into it. Where effects are tied, to-separate-N.csv has inputs that tell those of finding N
    apart, as departures from trim. The verdict is mismatch, consistent or undecidable; all three end with exit code
    0.""",
)
_WRITTEN = ("diagnosis.json", "report.html", "model.json")


def run(
    aircraft: Annotated[
        Path,
        option(
            "--aircraft",
            "Geometry, mass, inertia, thrust line, places of the instruments, tolerances.",
            metavar="AIRCRAFT.TOML",
        ),
    ],
    recordings: Annotated[
        list[Path],
        option("--recordings", "Recordings or folders of them, one manoeuvre each; may be repeated.", metavar="FILES"),
    ],
    simulation: Annotated[
        str,
        option(
            "--simulation",
            "Simulated files or their folder, a model.json, jsbsim:AIRCRAFT, or python:MODULE:FUNCTION.",
            metavar="WHAT",
        ),
    ],
    channel_map: Map = None,
    held_out: Annotated[
        str, option("--held-out", "Validation recordings; by default each one in turn.", metavar="NAMES")
    ] = "",
    out: Annotated[
        Path | None,
        option("--out", "Folder for diagnosis.json, report.html, model.json.", OUTPUT, "DIR"),
    ] = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Say what a simulation leaves out: where, which physics, how sure, and what adding it brings."""
    refuse_existing(out, overwrite)
    if out is not None:
        _keep_simulation(out, simulation)
    aircraft_model = load_aircraft(aircraft)
    # A simulated file goes with a whole recording: only what can be asked anywhere is asked along parts of one.
    flown = (
        read_manoeuvres(recordings, channel_map) if _can_be_asked(simulation) else read_files(recordings, channel_map)
    )
    judges = [r.name for r in hold_out(flown, held_out)[1]] if held_out else []
    found = _diagnose(simulation, flown, aircraft_model, judges)
    written = _write(out, found) if out is not None else []
    if json:
        print_json(found.to_dict())
    else:
        _print_story(found)
        if out is not None:
            print_files(stdout(), str(out), written)


def _can_be_asked(simulation: str) -> bool:
    return simulation.startswith(("jsbsim:", "python:")) or simulation.endswith(".json")


def _keep_simulation(out: Path, simulation: str) -> None:
    """Refuse to write over the simulation that is diagnosed."""
    if not simulation.startswith(("jsbsim:", "python:")):
        given = Path(simulation).resolve()
        if given in {(out / name).resolve() for name in _WRITTEN}:
            raise DataError(f"--out '{out}' would write over the simulation '{simulation}'. Choose another folder.")


def _diagnose(
    simulation: str, flown: Sequence[Recording], aircraft_model: Aircraft, judges: Sequence[str]
) -> Diagnosis:
    from structsel.diagnosis.diagnose import diagnose  # all hypotheses: a while to load, and few commands need them

    with Waiting("diagnosing") as waiting:
        return diagnose(simulation, flown, aircraft_model, held_out=judges, progress=waiting)


def _write(out: Path, found: Diagnosis) -> list[str]:
    """Write everything, or nothing; return the names written."""
    from structsel.report import write_report

    with output_folder(out) as folder:
        (folder / "diagnosis.json").write_text(json_text(found.to_dict()), encoding="utf-8")
        write_report(found, folder / "report.html", provenance=provenance())
        if found.model is not None:
            found.model.to_json(folder / "model.json", provenance=provenance())
        if (patched := _patched(found)) is not None:
            patched.write(folder)
        for number, finding in enumerate(found.findings, 1):
            if finding.manoeuvre is not None:
                write_recording(finding.manoeuvre, folder / f"to-separate-{number}.csv")
        written = [p.name + "/" * p.is_dir() for p in sorted(folder.iterdir())]
    if found.model is None and (out / "model.json").exists():
        say("warning", f"'{out / 'model.json'}' stood there before, and is not of this diagnosis.")
    return written


def _patched(found: Diagnosis) -> Patched | None:
    """The simulation itself with the physics, where it is an aircraft of JSBSim that can hold it."""
    from structsel.diagnosis.modelling import CorrectedModel

    patched = found.model.patched if isinstance(found.model, CorrectedModel) else None
    return patched if patched is not None and patched.name else None


def _print_story(found: Diagnosis) -> None:
    from structsel.diagnosis.story import headline

    text = Text(headline(found) if quiet() else str(found))
    text.highlight_regex(r"^(MISMATCH|CONSISTENT|UNDECIDABLE)", "bold")
    text.highlight_regex(r"(?m)^\d+\. [^:]+", "bold")
    stdout().print(text, soft_wrap=True)
