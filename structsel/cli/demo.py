"""``structsel demo``: models selected from six simulated flights with known true parameters."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from structsel.candidates import Candidates
from structsel.cli.comparison_tables import summarise_truth
from structsel.cli.folders import lock_folder
from structsel.cli.help_text import epilog, option
from structsel.cli.messages import ProgressBar, print_json, stdout
from structsel.cli.recordings import Json, PlotFormat
from structsel.cli.selection_files import write_results
from structsel.cli.tables import print_files, print_summary
from structsel.coefficients import compute_all
from structsel.demo import demo_flights
from structsel.recording import write_recording
from structsel.selection import select
from structsel.validation import validate

EPILOG = epilog(
    [("Print the tables, and write model and plots to a folder", "structsel demo --out out/demo")],
    """The flights are simulated in turbulence and recorded with instrument noise. The selection does not use the true
    parameters; they are only printed with the result. Files of an earlier demo are replaced.""",
)

CHANNELS = ("alpha", "beta", "p_hat", "q_hat", "r_hat", "de", "da", "dr")
DEGREE = 3
TRAINING, VALIDATION = 6, 11  # number of recordings to select from; index of the one for validation
TURBULENCE = 0.4  # fraction of a gust of 0.8 m/s


def run(
    out: Annotated[Path | None, option("--out", "Folder for model, tables and plots.", metavar="DIR")] = None,
    seed: Annotated[int, option("--seed", "Seed of turbulence and instrument noise.")] = 1,
    bootstrap: Annotated[
        int, option("--bootstrap", "Selections repeated on resampled data; 0: none.", metavar="N")
    ] = 200,
    plots: Annotated[bool, option("--plots/--no-plots", "Whether --out gets plots.")] = True,
    plot_format: PlotFormat = "png",
    json: Json = False,
) -> None:
    """Select models of all six axes from six simulated flights, and print them with the true values."""
    console = stdout()
    if out is not None:
        lock_folder(out)
    with ProgressBar("simulating"):
        # A flight does not depend on how many are simulated, and twelve take hardly longer than one.
        simulated, aircraft, truth = demo_flights(VALIDATION + 1, seed, turbulence=TURBULENCE)
        recordings, another = simulated[:TRAINING], simulated[VALIDATION]
        *used, held = compute_all([*recordings, another], aircraft)
    pool = Candidates.polynomial(CHANNELS, DEGREE)
    if not json:
        seconds = sum(r.duration for r in used)
        console.print(
            f"{aircraft.name}\n{TRAINING} manoeuvres, {seconds:.0f} s at {1 / held.dt:.0f} Hz, with light turbulence "
            f"and instrument noise. {len(pool)} candidate terms for each of {len(truth)} responses: products up to "
            f"degree {DEGREE} of {', '.join(CHANNELS)}.\n"
            "truth: true value in the simulation. prob.: probability that the term belongs in the model. "
            "inside: whether the true value is inside the interval. The interval allows for coloured residuals and for "
            "the choice of terms. In turbulence the values are those of causal rows, which allow for controls that "
            "respond to gusts and for noise on the candidates.\n"
        )
    with ProgressBar("selecting") as waiting:
        found = select(used, list(truth), pool, F_in="auto", bootstrap=bootstrap, progress=waiting)
    scores = validate(found.model, [held])
    written = []
    if out is not None:

        def write_data(folder: Path) -> None:
            aircraft.to_toml(folder / "aircraft.toml")
            (folder / "flights").mkdir()
            for recording in [*recordings, another]:
                write_recording(recording, folder / "flights" / f"{recording.name}.csv")

        written = write_results(
            out,
            {"stepwise": found},
            {"stepwise": scores},
            [*used, held],
            [held],
            plot_format if plots else "",
            extra_files=write_data,
        )
    if json:
        print_json({**found.to_dict(), "truth": truth, "validation": scores.to_dict()})
        return
    for response, selection in found.items():
        print_summary(console, summarise_truth(selection, truth[response]))
    title = f"Another recording, '{held.name}', not used for the selection"
    print_summary(console, replace(scores.summary(), title=title, about=""))
    flights, toml = "FILES --map map.toml", "aircraft.toml"
    if out is not None:
        print_files(console, str(out), written)
        flights, toml = f"{out / 'flights'}", f"{out / 'aircraft.toml'}"
    console.print(
        f"\nNext steps:\n  structsel describe {flights}\n  structsel select {flights} --aircraft {toml} \\\n"
        "      --responses CZ,Cm --candidates alpha,q_hat,de --degree 3 --f-in auto\n"
        "Your own files also need a channel map (--map); examples/ has some. For more see structsel select --help.",
        markup=False,
        soft_wrap=True,
    )
