"""``structsel monitor``: parameters of a flight while it is recorded."""

from __future__ import annotations

import json as json_format
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from structsel.cli.help_text import epilog, option
from structsel.cli.messages import say, stdout
from structsel.cli.parsing import read_pair, split_names
from structsel.cli.recordings import OUTPUT, Map
from structsel.errors import DataError
from structsel.formatting import format_estimate, format_number
from structsel.frequency_domain import RecursiveEstimate, RecursiveEstimator
from structsel.frequency_domain.recursive_estimator import BAND, SPACING
from structsel.recording import Recording, read_recording
from structsel.recording.growing import GrowingFile

EPILOG = epilog(
    [
        (
            "Pitch derivatives during a recorded flight, every 2 s",
            "structsel monitor flight.csv --response q_dot --terms alpha,q,de",
        ),
        (
            "While another program writes the file; old samples fade within 20 s or so",
            "structsel monitor flight.csv --map map.toml --follow \\\n"
            "    --response q_dot --terms alpha,q,de --memory 20",
        ),
    ],
    """[bold]--response[/bold] is a channel of the file, or the derivative of one: q_dot is that of q, taken in the
    frequency domain. Forces such as CZ need files of structsel coefficients. A constant and a trend are removed.""",
    """[bold]--follow[/bold] reads the lines that are added, until none came for --idle seconds, or until Ctrl-C. Time
    must be in seconds, samples evenly spaced.""",
)
_PAUSE = 0.2  # s between two looks at a growing file; chosen, not critical
_FOLLOW = "A file that grows"


def run(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording; with --follow a text file.")],
    response: Annotated[str, option("--response", "Channel, or derivative of one.", metavar="NAME")],
    terms: Annotated[str, option("--terms", "Terms, such as alpha,q,de.", metavar="NAMES")],
    channel_map: Map = None,
    band: Annotated[str | None, option("--band", "Frequencies, in Hz. Default: 0.1,1.5.", metavar="LOW,HIGH")] = None,
    memory: Annotated[
        float | None,
        option("--memory", "Time in which the weight of a sample falls to 1/e, in s. Default: none does."),
    ] = None,
    every: Annotated[float, option("--every", "Interval of the estimates, in s of flight.")] = 2.0,
    follow: Annotated[bool, option("--follow", "Go on as the file grows.", _FOLLOW)] = False,
    idle: Annotated[float, option("--idle", "Stop when nothing was added for this long, in s.", _FOLLOW)] = 30.0,
    json: Annotated[bool, option("--json", "Print one JSON object a line.", OUTPUT)] = False,
) -> None:
    """Estimate parameters by equation error in the frequency domain while a flight is recorded."""
    if not every > 0.0 or not idle > 0.0 or (memory is not None and not memory > 0.0):
        raise typer.BadParameter("--every, --idle and --memory must be above zero.")
    low, high = BAND if band is None else read_pair("--band", band, "0.1,1.5")
    frequencies = np.arange(low, high + 1e-9, SPACING)
    estimator, last, read = None, None, None
    for part in _parts(file, channel_map, follow, idle):
        if estimator is None:
            forgetting = 1.0 if memory is None else float(np.exp(-part.dt / memory))
            estimator = RecursiveEstimator(response, split_names(terms), frequencies=frequencies, forgetting=forgetting)
        for estimate in estimator.feed(part, every=every, after=read):
            _show(estimate, json, first=last is None)
            last = estimate
        read = float(part.t[-1])
    if estimator is None:
        raise DataError(f"'{file}' has no samples.\nCheck the name, or start its writer first and raise --idle.")
    end = estimator.estimate()
    if last is None or end.t > last.t:
        _show(end, json, first=last is None)


def _parts(file: Path, channel_map: Path | None, follow: bool, idle: float) -> Iterator[Recording]:
    """Recording, or the parts of a growing one; each begins with the last sample of the part before."""
    if not follow:
        yield read_recording(file, channel_map)
        return
    growing = GrowingFile(file, channel_map)
    since = time.monotonic()
    try:
        while time.monotonic() - since < idle:
            part = growing.read_new()
            if part is None:
                time.sleep(min(_PAUSE, idle))
                continue
            since = time.monotonic()
            yield part
        say("note", f"nothing was added to '{file}' for {idle:g} s.")
    except KeyboardInterrupt:
        say("note", "stopped by Ctrl-C.")


def _show(estimate: RecursiveEstimate, json: bool, *, first: bool) -> None:
    if json:
        print(json_format.dumps(estimate.to_dict(), allow_nan=False), flush=True)
        return
    if first:
        stdout().print(f"{'t [s]':>8}  {'R2':>6}  {estimate.response} on {', '.join(estimate.names)}", highlight=False)
    values = [
        f"{name} {format_estimate(value, std)}" if np.isfinite(value) else f"{name} -"
        for name, value, std in zip(estimate.names, estimate.values, estimate.std)
    ]
    r2 = format_number(estimate.r2, 3)
    stdout().print(f"{estimate.t:8.2f}  {r2:>6}  {'   '.join(values)}", highlight=False, soft_wrap=True)
    sys.stdout.flush()  # a pipe shows each line when it is there
