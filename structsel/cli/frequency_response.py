"""``structsel frequency-response``: frequency responses, coherence and transfer functions of recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from structsel.cli.dataclass_options import takes_dataclass
from structsel.cli.folders import names_in, output_folder, refuse_existing, save_figures
from structsel.cli.help_text import epilog, option
from structsel.cli.messages import json_text, print_json, stdout
from structsel.cli.parsing import read_numbers, read_pair, split_names
from structsel.cli.recordings import OUTPUT, Files, OutputOptions, RecordingOptions
from structsel.cli.tables import print_files, print_summary
from structsel.frequency_domain import (
    FORMS,
    FrequencyResponse,
    TransferFunction,
    fit_transfer_function,
    frequency_response,
)
from structsel.tables import csv_of_frame

EPILOG = epilog(
    [
        (
            "Response of pitch rate to the elevator in three sweeps",
            "structsel frequency-response sweep1.csv sweep2.csv sweep3.csv \\\n    --outputs q --inputs de",
        ),
        (
            "Two inputs; each response without what the other input explains",
            "structsel frequency-response sweeps/ --map map.toml \\\n    --outputs p,r --inputs da,dr --out out/",
        ),
        (
            "Low-order equivalent system, its zero held",
            "structsel frequency-response sweeps/ --outputs q --inputs de \\\n"
            "    --fit q/de=short-period --held 1/Ttheta2=0.9",
        ),
    ],
    f"""[bold]Forms[/bold] of --fit: {", ".join(FORMS)}; or numbers of zeros and poles, such as 1,2; or factors: (a) is
    s + a, \\[zeta, omega] is s^2 + 2 zeta omega s + omega^2, s is s. Each has a gain K and a delay tau.""",
    """The coherence is the fraction of the output that the input explains linearly. Use a response where it is 0.6 or
    more. Recordings should be frequency sweeps that begin and end near trim.""",
)
Form = str | tuple[int, int]
_FIT = "With --fit"


@takes_dataclass()
def run(
    files: Files,
    recorded: RecordingOptions,
    output: OutputOptions,
    outputs: Annotated[str, option("--outputs", "Channels that respond.", metavar="NAMES")],
    inputs: Annotated[str, option("--inputs", "Channels that drive them.", metavar="NAMES")],
    band: Annotated[str | None, option("--band", "Lowest and highest frequency, in rad/s.", metavar="LOW,HIGH")] = None,
    windows: Annotated[
        str | None, option("--windows", "Lengths of the windows, such as 40,20,10.", metavar="SECONDS")
    ] = None,
    points: Annotated[int, typer.Option("--points", min=2, help="Number of frequencies.")] = 100,
    fit: Annotated[
        list[str] | None,
        option("--fit", "Form of the transfer function of one response; may be repeated.", _FIT, "OUTPUT/INPUT=FORM"),
    ] = None,
    fit_band: Annotated[
        str | None, option("--fit-band", "Band of the fit, in rad/s; by default, coherence 0.6.", _FIT, "LOW,HIGH")
    ] = None,
    held: Annotated[str, option("--held", "Parameters that are held at a value.", _FIT, "NAME=VALUE,...")] = "",
    out: Annotated[Path | None, option("--out", "Folder for tables and Bode plots.", OUTPUT, "DIR")] = None,
) -> None:
    """Frequency responses and coherence of recorded inputs and outputs, and transfer functions fitted to them."""
    refuse_existing(out, output.overwrite)
    forms = _read_forms(fit or [])
    if (fit_band or held) and not forms:
        raise typer.BadParameter("--fit-band and --held need --fit.")
    recordings = recorded.read(files, {*split_names(outputs), *split_names(inputs)})
    response = frequency_response(
        recordings, split_names(outputs), split_names(inputs), points=points,
        band=None if band is None else read_pair("--band", band, "0.3,12"),
        windows=None if windows is None else _read_windows(windows),
    )  # fmt: skip
    found = None
    if forms:
        limits = None if fit_band is None else read_pair("--fit-band", fit_band, "0.5,10")
        constants = read_numbers("--held", held, "1/Ttheta2=0.9")
        found = fit_transfer_function(response, forms, band=limits, held=constants)
    written = [] if out is None else _write(out, response, found, output.figures)
    if output.json:
        print_json(_content(response, found))
        return
    for result in (response, found):
        if result is not None:
            print_summary(stdout(), result.summary())
    if out is not None:
        print_files(stdout(), str(out), written)


def _read_forms(texts: list[str]) -> dict[str, Form]:
    """Form of each response, from texts such as ``q/de=short-period``."""
    forms: dict[str, Form] = {}
    for text in texts:
        pair, equals, form = (part.strip() for part in text.partition("="))
        if not equals or "/" not in pair or not form:
            raise typer.BadParameter(f"--fit '{text}' is not of the form OUTPUT/INPUT=FORM, as q/de=short-period.")
        orders = [part.strip() for part in form.split(",")]
        general = len(orders) == 2 and all(part.isdigit() for part in orders)
        forms[pair] = (int(orders[0]), int(orders[1])) if general else form
    return forms


def _read_windows(text: str) -> list[float]:
    try:
        return [float(part) for part in split_names(text)]
    except ValueError:
        raise typer.BadParameter(f"--windows '{text}' is not numbers of seconds, as 40,20,10.") from None


def _content(response: FrequencyResponse, fit: TransferFunction | None) -> dict[str, Any]:
    return {**response.to_dict(), "transfer_function": None if fit is None else fit.to_dict()}


def _write(out: Path, response: FrequencyResponse, fit: TransferFunction | None, figures: str) -> list[str]:
    """Write everything, or nothing; return the names written."""
    with output_folder(out) as folder:
        (folder / "frequency_response.json").write_text(json_text(_content(response, fit)), encoding="utf-8")
        csv_of_frame(response.to_frame(), folder / "frequency_response.csv")
        if figures:
            from structsel.plotting import draw_frequency_response  # matplotlib takes a while to load

            save_figures(folder / "plots", draw_frequency_response(response, fit), figures)
        return names_in(folder)
