"""``structsel inputs``: input signals, and the information that they give about parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from structsel import inputs as signals
from structsel.cli.comparison_tables import summarise_scatter
from structsel.cli.dataclass_options import takes_dataclass
from structsel.cli.folders import names_in, output_folder, refuse_existing
from structsel.cli.help_text import epilog, option
from structsel.cli.messages import ProgressBar, json_text, print_json, stdout
from structsel.cli.models import (
    MODEL_HELP,
    AircraftModelOptions,
    Controls,
    TrimOption,
    trim_model,
)
from structsel.cli.parsing import read_numbers, split_names
from structsel.cli.recordings import OUTPUT, OutputOptions
from structsel.cli.tables import print_files, print_summary
from structsel.formatting import format_number
from structsel.inputs import Information, InputComparison, InputDesign, Scatter
from structsel.inputs.settings import DesignOptions, InputOptions
from structsel.recording import Recording, write_recording
from structsel.simulation import LinearModel, PublishedAircraft
from structsel.tables import csv_of_frame

EPILOG = epilog(
    [
        (
            "A 3-2-1-1 of the elevator",
            "structsel inputs 3-2-1-1 --channel de --amplitude 0.03 --width 0.5 --out in/",
        ),
        (
            "Uncorrelated multisines for three controls",
            "structsel inputs multisine --channel de,da,dr --amplitude 0.02 \\\n"
            "    --low 0.1 --high 2 --period 20 --out in/",
        ),
        (
            "Comparison of inputs: which one determines three derivatives best",
            "structsel inputs compare --model builtin:hawk:longitudinal \\\n"
            "    --noise w=0.5,q=0.005 --parameters mw,mq,mde --energy 0.01",
        ),
        (
            "The input that best separates two derivatives, within limits",
            "structsel inputs optimal --model builtin:beaver --noise alpha=0.002,q=0.002 \\\n"
            "    --parameters zw,mw,mq,mde --to-separate mw,mq \\\n"
            "    --energy 0.01 --limits alpha=0.06,de=0.08 --out in/",
        ),
    ],
    """[bold]Inputs[/bold] are perturbations from trim, constant between samples. With --model and --noise the command
    prints the Cramer-Rao bounds of the parameters: no unbiased estimate has a smaller standard deviation. A nonlinear
    model is linearised about its trim (--trim, --axis); its inputs are the control surfaces or those of --channel, and
    its derivatives are named xu, zw, mq, mde, ..., yv, lp, ndr.""",
    """compare and optimal need --model and --noise; compare needs --energy, optimal needs --energy or --limits.""",
)
_LINEAR, _OPTIMAL = "Model whose parameters are estimated", "compare and optimal"
Kind = Literal["step", "impulse", "doublet", "3-2-1-1", "2-1-1-1", "multisine", "sweep", "optimal", "compare"]
_SHAPE = ("amplitude", "width", "start", "low", "high", "period")
_TIMING = ("duration", "dt")
_SURFACES = {"longitudinal": ("de",), "lateral": ("da", "dr")}
_PULSES: dict[str, Callable[..., Recording]] = {
    "doublet": signals.doublet,
    "3-2-1-1": signals.three_two_one_one,
    "2-1-1-1": signals.two_one_one_one,
}


@dataclass(frozen=True)
class SignalOptions:
    """Shape of a classical input, which needs no model."""

    channel: Annotated[
        str, option("--channel", "Control that moves; several for multisine and optimal.", None, "NAMES")
    ] = ""
    amplitude: Annotated[
        float | None, option("--amplitude", "Amplitude, in the unit of the control; for an impulse its area.")
    ] = None
    width: Annotated[float | None, option("--width", "Length of one pulse, in s.")] = None
    start: Annotated[float | None, option("--start", "Start of the input, in s. Default: 1.")] = None
    duration: Annotated[float | None, option("--duration", "Length of the record, in s. Default: 20.")] = None
    dt: Annotated[float | None, option("--dt", "Sampling interval, in s.")] = None
    low: Annotated[float | None, option("--low", "Lowest frequency of multisine and sweep, in Hz.")] = None
    high: Annotated[float | None, option("--high", "Highest frequency, in Hz.")] = None
    law: Annotated[Literal["log", "linear"], option("--law", "Logarithmic or linear sweep.")] = "log"
    period: Annotated[float | None, option("--period", "Period of a multisine, in s. Default: 20.")] = None

    @property
    def channels(self) -> list[str]:
        """Controls that the input moves."""
        return split_names(self.channel)

    def given(self, *names: str) -> dict[str, Any]:
        """Those of these options that were given."""
        return {name: value for name in names if (value := getattr(self, name)) is not None}


@dataclass(frozen=True)
class LinearModelOptions:
    """Linear model whose parameters are estimated, and its measured outputs."""

    model: Annotated[str, option("--model", MODEL_HELP, _LINEAR, "MODEL")] = ""
    trim: TrimOption = ""
    controls: Controls = ""
    axis: Annotated[
        Literal["longitudinal", "lateral"],
        option("--axis", "Axis about which a nonlinear model is linearised.", _LINEAR),
    ] = "longitudinal"
    noise: Annotated[
        str,
        option(
            "--noise",
            "Measured outputs and the standard deviation of their noise: alpha=0.002,q=0.001",
            _LINEAR,
            "NAME=STD,...",
        ),
    ] = ""


@takes_dataclass(DesignOptions, without=("duration", "dt"))
def run(
    kind: Annotated[
        Kind, typer.Argument(metavar="KIND", help="Kind of input; compare designs and compares several kinds.")
    ],
    signal: SignalOptions,
    known: LinearModelOptions,
    source: AircraftModelOptions,
    output: OutputOptions,
    *,
    options: dict[str, Any],
    runs: Annotated[
        int,
        option(
            "--runs",
            "compare: simulations with different noise, whose scatter of estimates is compared with the bound.",
            _OPTIMAL,
        ),
    ] = 0,
    out: Annotated[Path | None, option("--out", "Folder for the inputs, a table and a plot.", OUTPUT, "DIR")] = None,
) -> None:
    """Design inputs (classical, multisine, optimal), and compare the information that they give about parameters."""
    refuse_existing(out, output.overwrite)
    measured = read_numbers("--noise", known.noise, "alpha=0.002,q=0.001")
    if known.model and not measured:
        raise typer.BadParameter("--model needs --noise: the measured outputs and their standard deviations.")
    model = _linear(known, source, signal.channels, measured) if known.model else None
    found: Recording | InputDesign | InputComparison
    info: Information | None = None
    scattered: list[Scatter] = []
    wanted, seed = options["parameters"], options["seed"]
    if kind in ("optimal", "compare"):
        if model is None:
            raise typer.BadParameter(f"{kind} needs --model and --noise.")
        shape, timing = signal.given(*_SHAPE), signal.given(*_TIMING)
        limiting = (name for name in ("limits", "rate_limits", "to_separate") if options[name] and kind == "compare")
        if unwanted := [*shape, *limiting]:
            raise typer.BadParameter(f"{kind} has no --{unwanted[0].replace('_', '-')}.")
        with ProgressBar("searching") as progress:
            if kind == "optimal":
                found = signals.design_inputs(model, noise=measured, **options, **timing)
            elif options["energy"] is None:
                raise typer.BadParameter("compare needs --energy: inputs of equal energy are compared.")
            else:
                shared = {f.name: options[f.name] for f in fields(InputOptions) if f.name in options}
                energy = options["energy"]
                found = signals.compare_inputs(model, noise=measured, energy=energy, **shared, **timing)
                for i, u in enumerate(found.inputs if runs else ()):
                    scattered.append(signals.scatter(model, u, noise=measured, parameters=wanted, runs=runs, seed=seed))
                    progress("simulations", i + 1, len(found.inputs))
    else:
        found = _classical(kind, signal, seed)
        if model is not None:
            info = signals.information(model, found, noise=measured, parameters=wanted)
    content = _as_dict(found, info, scattered)
    written = _write(out, found, content, model, output.figures) if out is not None else []
    if output.json:
        print_json(content)
    else:
        _print(found, info)
        if scattered:
            print_summary(stdout(), summarise_scatter(scattered))
        if out is not None:
            print_files(stdout(), str(out), written)
    if info is not None:
        info.require()


def _linear(
    known: LinearModelOptions, source: AircraftModelOptions, channels: Sequence[str], measured: dict[str, float]
) -> LinearModel:
    """Linear model with named parameters and the measured outputs."""
    aircraft_model = source.open(known.model)
    if isinstance(aircraft_model, PublishedAircraft):
        trimmed = trim_model(aircraft_model, known.trim, known.controls)
        linear = aircraft_model.linearise(trimmed, axis=known.axis, inputs=channels or _SURFACES[known.axis])
        return signals.name_derivatives(linear, outputs=list(measured))
    if not isinstance(aircraft_model, LinearModel):
        raise typer.BadParameter(
            "inputs are designed for model files, built-in aircraft and linear models, not for JSBSim."
        )
    if set(measured) <= set(aircraft_model.outputs) and (not channels or set(channels) == set(aircraft_model.inputs)):
        return aircraft_model
    return signals.name_derivatives(aircraft_model, outputs=list(measured), inputs=channels or None)


def _classical(kind: str, signal: SignalOptions, seed: int) -> Recording:
    """One of the inputs that need no model.

    Raises
    ------
    BadParameter
        A required option is missing, or an option does not apply to this kind.
    """
    needs = {"multisine": ("amplitude", "low", "high"), "sweep": ("amplitude", "low", "high")}.get(kind, ("amplitude",))
    optional = {
        "step": ("start", "duration", "dt"),
        "impulse": ("start", "duration", "dt"),
        "multisine": ("period", "dt"),
        "sweep": ("start", "duration", "dt"),
    }.get(kind, ("width", "start", "duration", "dt"))
    given, channels = signal.given(*_SHAPE, *_TIMING), signal.channels
    if not channels:
        raise typer.BadParameter(f"{kind} needs --channel, the control that moves.")
    if missing := [name for name in needs if name not in given]:
        raise typer.BadParameter(f"{kind} needs --{missing[0]}.")
    if unwanted := [name for name in given if name not in (*needs, *optional)]:
        raise typer.BadParameter(
            f"{kind} has no --{unwanted[0]}; it has {', '.join(f'--{n}' for n in (*needs, *optional))}."
        )
    if kind == "multisine":
        return signals.multisine(channels, given.pop("amplitude"), seed=seed, **given)
    if len(channels) > 1:
        raise typer.BadParameter(f"{kind} moves one control; use a multisine for {', '.join(channels)}.")
    if kind == "sweep":
        return signals.frequency_sweep(channels[0], law=signal.law, **given)  # type: ignore[arg-type]
    if kind == "impulse":
        return signals.impulse(channels[0], given.pop("amplitude"), **given)
    make = _PULSES.get(kind, signals.step)
    return make(channels[0], given.pop("amplitude"), **given)


def _inputs_of(found: Recording | InputDesign | InputComparison) -> tuple[Recording, ...]:
    if isinstance(found, InputComparison):
        return found.inputs
    return (found,) if isinstance(found, Recording) else (found.inputs,)


def _print(found: Recording | InputDesign | InputComparison, info: Information | None) -> None:
    console = stdout()
    if not isinstance(found, Recording):
        print_summary(console, found.summary())
        return
    console.print(f"{found.name}, {len(found)} samples, {found.duration:g} s, every {found.dt:g} s", markup=False)
    for name in found.names:
        peak = max(found[name].max(), -found[name].min())
        rms = format_number(float((found[name] ** 2).mean() ** 0.5))
        factor = f", peak factor {signals.peak_factor(found[name]):.3f}" if peak else ""
        console.print(f"  {name}  peak {format_number(float(peak))}, rms {rms}{factor}")
    console.print(f"  energy {format_number(signals.energy(found))}")
    if info is not None:
        print_summary(console, info.summary())


def _as_dict(
    found: Recording | InputDesign | InputComparison, info: Information | None, scattered: Sequence[Scatter]
) -> dict[str, Any]:
    if isinstance(found, Recording):
        content = {"energy": signals.energy(found), "inputs": found.to_dict()}
        content["information"] = None if info is None else info.to_dict()
    else:
        content = found.to_dict()
        content["scatter"] = [one.to_dict() for one in scattered]
    return {"schema": "structsel.inputs/1", **content}


def _write(
    out: Path,
    found: Recording | InputDesign | InputComparison,
    content: dict[str, Any],
    model: LinearModel | None,
    figures: str,
) -> list[str]:
    """Write everything, or nothing; return the names written."""
    with output_folder(out) as folder:
        for one in _inputs_of(found):
            write_recording(one, folder / f"{one.name.replace(' ', '-')}.csv")
        (folder / "inputs.json").write_text(json_text(content), encoding="utf-8")
        if isinstance(found, InputComparison):
            csv_of_frame(found.to_frame(), folder / "comparison.csv")
        if figures:
            from structsel.plotting import draw_inputs, save_figure  # matplotlib takes a while to load

            save_figure(draw_inputs(found, model), folder / f"inputs.{figures}")
        return names_in(folder)
