"""``structsel diagnose``: effects that a simulation lacks."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.text import Text

from structsel.aircraft import Aircraft
from structsel.cli.cutting import is_cut
from structsel.cli.folders import names_in, output_folder, refuse_existing
from structsel.cli.help_text import epilog, option
from structsel.cli.input_files import provenance
from structsel.cli.messages import ProgressBar, is_quiet, json_text, print_json, say, stdout
from structsel.cli.recordings import (
    OUTPUT,
    Before,
    Json,
    Map,
    MoreRecordings,
    Overwrite,
    check_before,
    hold_out,
    load_aircraft,
    read_files,
    read_manoeuvres,
)
from structsel.cli.tables import print_files
from structsel.errors import DataError
from structsel.files import path_text
from structsel.recording import Recording, write_recording

if TYPE_CHECKING:
    from structsel.diagnosis.patching import Patched
    from structsel.diagnosis.result import Diagnosis

EPILOG = epilog(
    [
        (
            "Recordings against simulated files",
            "structsel diagnose --aircraft aircraft.toml --recordings recordings/ \\\n"
            "    --simulation simulated/ --out out/",
        ),
        (
            "A model file; two recordings are for validation only",
            "structsel diagnose --aircraft aircraft.toml --recordings flights/ \\\n"
            "    --map map.toml --simulation model.json --held-out m05,m06 --out out/",
        ),
        (
            "An aircraft of JSBSim; a Python function",
            "structsel diagnose --aircraft aircraft.toml --recordings recordings/ \\\n"
            "    --simulation jsbsim:c172p --json\n"
            "  structsel diagnose --aircraft aircraft.toml --recordings recordings/ \\\n"
            "    --simulation python:mysim:coefficients",
        ),
    ],
    """[bold]Simulated files[/bold] have the names of the recordings. A file with t and any of CX CY CZ Cl Cm Cn has the
    coefficients of the simulation along the recorded path. A file with V, alpha, ... has a simulation with the recorded
    inputs from the same initial state. Channels have the names and units of structsel; --map applies to the recordings
    only.""",
    """The table \\[tolerances] of the aircraft file states the standard deviations of the parameters of the
    simulation and of the instruments. Only differences beyond them are attributed to a missing effect. Without
    --held-out each recording is predicted from the others.""",
    """[bold]--out[/bold] is written with diagnosis.json, report.html (a page that needs no network) and model.json,
    the simulation with the missing effect added. For an aircraft of JSBSim it also has the folder AIRCRAFT-corrected,
    if the effect can be written in its format. If the effects of finding N cannot be distinguished, to-separate-N.csv
    has inputs that distinguish them, as perturbations from trim. """,
    """[bold]Exit code[/bold] 0 for the verdicts mismatch, consistent and undecidable; 3 if recordings and simulation
    are consistent only with a parameter outside its stated tolerance, "within_tolerances": false in diagnosis.json.""",
)
OUTSIDE_TOLERANCES = 3
"""Exit code where recordings and simulation agree only with a parameter outside its stated tolerance."""
_WRITTEN = ("diagnosis.json", "report.html", "model.json")


def run(
    recordings: Annotated[
        list[Path],
        option(
            "--recordings",
            "Files with one manoeuvre each, folders, or patterns in quotes; several.",
            metavar="FILES...",
        ),
    ],
    simulation: Annotated[
        str,
        option(
            "--simulation",
            "Simulated files or their folder, a model.json, jsbsim:AIRCRAFT, or python:MODULE:FUNCTION.",
            metavar="SIMULATION",
        ),
    ],
    more_recordings: MoreRecordings = None,
    aircraft: Annotated[
        Path | None,
        option(
            "--aircraft",
            "Geometry, mass, inertia, thrust line, positions of the instruments, tolerances. Not needed for plants, "
            "whose recordings have no channels of a flight.",
            metavar="AIRCRAFT.TOML",
        ),
    ] = None,
    channel_map: Map = None,
    held_out: Annotated[
        str, option("--held-out", "Validation recordings; by default each recording in turn.", metavar="NAMES")
    ] = "",
    out: Annotated[
        Path | None,
        option("--out", "Folder for diagnosis.json, report.html, model.json.", OUTPUT, "DIR"),
    ] = None,
    overwrite: Overwrite = False,
    before: Before = None,
    json: Json = False,
) -> None:
    """Compare a simulation with recordings, and find the effects that it lacks, with their probabilities."""
    refuse_existing(out, overwrite)
    check_before(before, "structsel.diagnosis")
    if out is not None:
        _refuse_overwriting(out, simulation)
    aircraft_model = None if aircraft is None else load_aircraft(aircraft)
    recordings = [*recordings, *(more_recordings or [])]
    if is_cut() and not _is_model(simulation):
        raise typer.BadParameter("--cut applies to models: a simulated file belongs to a complete recording.")
    # A simulated file belongs to a complete recording; a model can be evaluated along any part of one.
    recorded = (
        read_manoeuvres(recordings, channel_map) if _is_model(simulation) else read_files(recordings, channel_map)
    )
    validation = [r.name for r in hold_out(recorded, held_out)[1]] if held_out else []
    found = _diagnose(simulation, recorded, aircraft_model, validation)
    written = _write(out, found, before) if out is not None else []
    if json:
        print_json(found.to_dict())
    else:
        _print_text(found)
        if out is not None:
            print_files(stdout(), path_text(out), written)
    if found.verdict == "consistent" and not found.within_tolerances:
        raise typer.Exit(OUTSIDE_TOLERANCES)


def _is_model(simulation: str) -> bool:
    return simulation.startswith(("jsbsim:", "python:")) or simulation.endswith(".json")


def _refuse_overwriting(out: Path, simulation: str) -> None:
    """Refuse to overwrite the simulation that is diagnosed."""
    if not simulation.startswith(("jsbsim:", "python:")):
        given = Path(simulation).resolve()
        if given in {(out / name).resolve() for name in _WRITTEN}:
            raise DataError(f"--out '{out}' would overwrite the simulation '{simulation}'. Choose another folder.")


def _diagnose(
    simulation: str, recorded: Sequence[Recording], aircraft_model: Aircraft | None, validation: Sequence[str]
) -> Diagnosis:
    from structsel.diagnosis.diagnose import diagnose  # takes a while to load

    with ProgressBar("diagnosing") as waiting:
        return diagnose(simulation, recorded, aircraft_model, held_out=validation, progress=waiting)


def _write(out: Path, found: Diagnosis, before: Path | None) -> list[str]:
    """Write everything, or nothing; return the names written."""
    from structsel.report import write_report

    with output_folder(out) as folder:
        (folder / "diagnosis.json").write_text(json_text(found.to_dict()), encoding="utf-8")
        write_report(found, folder / "report.html", before=before, provenance=provenance())
        if found.model is not None:
            found.model.to_json(folder / "model.json", provenance=provenance())
        if (patched := _patched(found)) is not None:
            patched.write(folder)
        for number, finding in enumerate(found.findings, 1):
            if finding.manoeuvre is not None:
                write_recording(finding.manoeuvre, folder / f"to-separate-{number}.csv")
        written = names_in(folder)
    if found.model is None and (out / "model.json").exists():
        say("warning", f"'{out / 'model.json'}' was there before; it is not a result of this diagnosis.")
    return written


def _patched(found: Diagnosis) -> Patched | None:
    """Aircraft of JSBSim with the effect added; None for other simulations and for effects it cannot express."""
    from structsel.diagnosis.modelling import CorrectedModel

    patched = found.model.patched if isinstance(found.model, CorrectedModel) else None
    return patched if patched is not None and patched.name else None


def _print_text(found: Diagnosis) -> None:
    from structsel.diagnosis.text_report import headline

    text = Text(headline(found) if is_quiet() else str(found))
    text.highlight_regex(r"^(MISMATCH|CONSISTENT|UNDECIDABLE)", "bold")
    text.highlight_regex(r"(?m)^\d+\. [^:]+", "bold")
    stdout().print(text, soft_wrap=True)
