"""The program: its commands, exit codes and error messages."""

from __future__ import annotations

from errno import EPIPE
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from structsel import __version__
from structsel.cli import (
    coefficients,
    demo,
    describe,
    diagnose,
    export,
    frequency_response,
    inputs,
    monitor,
    reconstruct,
    refine,
    select,
    simulate,
    validate,
)
from structsel.cli.common_options import with_common_options
from structsel.cli.folders import folder_locks
from structsel.cli.help_text import epilog
from structsel.cli.messages import plain_warnings, say
from structsel.errors import StructselError

_EPILOG = epilog(
    [
        ("Six simulated flights with known true parameters", "structsel demo --out out/demo"),
        ("Check how a file is read", "structsel describe flight.csv --map map.toml"),
        (
            "Estimate instrument errors, and write the recordings without them",
            "structsel reconstruct flights/ --map map.toml --aircraft aircraft.toml \\\n    --out path/",
        ),
        (
            "Select the terms of a model; two manoeuvres are for validation",
            "structsel select flights/ --map map.toml --aircraft aircraft.toml \\\n"
            "    --responses CZ,Cm --candidates alpha,q_hat,de --degree 3 \\\n"
            "    --held-out m05,m06 --out out/",
        ),
        (
            "Score the model on other recordings",
            "structsel validate out/model.json m07.csv --map map.toml \\\n    --aircraft aircraft.toml",
        ),
        (
            "Simulate the model with recorded inputs, and refine it on complete manoeuvres",
            "structsel validate out/model.json m07.csv --map map.toml \\\n    --aircraft aircraft.toml --replay\n"
            "  structsel refine out/model.json --recordings flights/ --map map.toml \\\n"
            "    --aircraft aircraft.toml --starts w,q,theta --out refined/",
        ),
        (
            "Find the effects that a simulation lacks",
            "structsel diagnose --aircraft aircraft.toml --recordings recordings/ \\\n"
            "    --simulation simulated/ --out out/",
        ),
    ],
    """[bold]Results[/bold] are printed on stdout, messages on stderr; --json prints JSON only. Units are SI and
    radians; a channel map converts other units. NO_COLOR=1 turns colours off. Every command has --quiet and
    --verbose.""",
    """[bold]structsel.toml[/bold] in the working folder, or the file of --config, has defaults of options: one table
    for each command, such as \\[select] with f-in = "auto" and degree = 3. Options above the tables, such as aircraft
    = "aircraft.toml", apply to every command that has them. The command line has precedence.""",
    """[bold]Exit code[/bold] 0: success. 1: the data or the options cannot be used; the message gives the reason and a
    remedy. 2: the command line cannot be read. 130: stopped by Ctrl-C; no file is incomplete.""",
)


class Program(TyperGroup):
    """Group of commands that prints errors and warnings without a traceback."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command; exit code 1 for an error of the data or the request, 130 for Ctrl-C."""
        with plain_warnings(), folder_locks():
            try:
                return super().invoke(ctx)
            except StructselError as error:
                say("error", error.cli_message)
                raise typer.Exit(1) from error
            except typer.BadParameter as error:
                error.message += _origin(error)
                raise
            except KeyboardInterrupt as error:
                say("error", "stopped by Ctrl-C. No file is incomplete; files that were finished remain.")
                raise typer.Exit(130) from error
            except OSError as error:
                if error.errno == EPIPE:  # the reader of a pipe has closed it
                    raise
                say("error", f"{error}. The file cannot be read or written: free disk space, or check the permissions.")
                raise typer.Exit(1) from error


def _origin(error: Any) -> str:
    """File that has the wrong value, for the message; empty if it was given on the command line."""
    if error.ctx is None or error.param is None:
        return ""
    source = error.ctx.get_parameter_source(error.param.name)
    return f" (from {error.ctx.params.get('config')})" if source is not None and source.name == "DEFAULT_MAP" else ""


app = typer.Typer(
    cls=Program,
    name="structsel",
    help="Identify aerodynamic models from flight-test recordings, and find what a simulation is missing.",
    epilog=_EPILOG,
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"structsel {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Identify aerodynamic models from flight-test recordings, and find what a simulation is missing."""


for _name, _command in {
    "describe": describe,
    "reconstruct": reconstruct,
    "coefficients": coefficients,
    "select": select,
    "validate": validate,
    "inputs": inputs,
    "simulate": simulate,
    "frequency-response": frequency_response,
    "monitor": monitor,
    "refine": refine,
    "diagnose": diagnose,
    "export": export,
    "demo": demo,
}.items():
    app.command(_name, epilog=_command.EPILOG)(with_common_options(_command.run))


@app.command("prove", hidden=True, context_settings={"ignore_unknown_options": True, "allow_extra_args": True})
def _prove(ctx: typer.Context) -> None:
    """Moved: ``python -m proof``, from a clone of the repository."""
    say("error", "'structsel prove' is no longer a command. Run 'python -m proof' from a clone of the repository.")
    raise typer.Exit(2)


def main() -> None:
    """Entry point of the ``structsel`` command."""
    app()
