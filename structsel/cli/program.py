"""The program: its commands, its exit codes, and how it says what went wrong."""

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
    inputs,
    reconstruct,
    refine,
    select,
    simulate,
    validate,
)
from structsel.cli.common_options import mannered
from structsel.cli.folders import claims
from structsel.cli.help_text import page
from structsel.cli.messages import plain_warnings, say
from structsel.errors import StructselError

_EPILOG = page(
    [
        ("Six simulated flights with known true parameters", "structsel demo --out out/demo"),
        ("Is the file read as you meant", "structsel describe flight.csv --map map.toml"),
        (
            "What is wrong with the instruments, and the flight without it",
            "structsel reconstruct flights/ --map map.toml --aircraft aircraft.toml \\\n    --out path/",
        ),
        (
            "Select the terms, two manoeuvres for validation",
            "structsel select flights/ --map map.toml --aircraft aircraft.toml \\\n"
            "    --responses CZ,Cm --candidates alpha,q_hat,de --degree 3 \\\n"
            "    --held-out m05,m06 --out out/",
        ),
        (
            "Score the model on other flights",
            "structsel validate out/model.json m07.csv --map map.toml \\\n    --aircraft aircraft.toml",
        ),
        (
            "Simulate it with the recorded inputs, and refine it on complete manoeuvres",
            "structsel validate out/model.json m07.csv --map map.toml \\\n    --aircraft aircraft.toml --replay\n"
            "  structsel refine out/model.json --recordings flights/ --map map.toml \\\n"
            "    --aircraft aircraft.toml --starts w,q,theta --out refined/",
        ),
        (
            "What is missing in a simulation",
            "structsel diagnose --aircraft aircraft.toml --recordings recordings/ \\\n"
            "    --simulation simulated/ --out out/",
        ),
    ],
    """[bold]Results[/bold] go to stdout, everything else to stderr; --json prints JSON and nothing else. Inside, units
    are SI and radians; a channel map brings others in. NO_COLOR=1 turns colours off. Every command takes --quiet and
    --verbose.""",
    """[bold]structsel.toml[/bold] in the folder you work in, or a file given with --config, holds options that need not
    be repeated: a table per command, \\[select] with f-in = "auto" and degree = 3, and above the tables what is for
    every command that has the option, aircraft = "aircraft.toml". The command line wins.""",
    """[bold]Exit code[/bold] 0: done. 1: the data or the request cannot be used; the message says why and what to do.
    2: the command line cannot be read. 130: stopped by Ctrl-C; no file is half written.""",
)


class Program(TyperGroup):
    """Says structsel's own errors and warnings plainly, without a traceback."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command; exit code 1 for an error of the data or the request, 130 for Ctrl-C."""
        with plain_warnings(), claims():
            try:
                return super().invoke(ctx)
            except StructselError as error:
                say("error", error.cli_message)
                raise typer.Exit(1) from error
            except typer.BadParameter as error:
                error.message += _origin(error)
                raise
            except KeyboardInterrupt as error:
                say("error", "stopped by Ctrl-C. No file is half written; what was finished before stays.")
                raise typer.Exit(130) from error
            except OSError as error:
                if error.errno == EPIPE:  # whoever read the output has enough of it
                    raise
                say("error", f"{error}. Nothing more can be read or written there; free space, or check permissions.")
                raise typer.Exit(1) from error


def _origin(error: Any) -> str:
    """Where the value at fault came from, if not from the command line."""
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


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"structsel {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
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
    "refine": refine,
    "diagnose": diagnose,
    "export": export,
    "demo": demo,
}.items():
    app.command(_name, epilog=_command.EPILOG)(mannered(_command.run))


@app.command("prove", hidden=True, context_settings={"ignore_unknown_options": True, "allow_extra_args": True})
def _prove(ctx: typer.Context) -> None:
    """Moved: ``python -m proof``, from a clone of the repository."""
    say("error", "'structsel prove' has left the package. Run 'python -m proof' from a clone of the repository.")
    raise typer.Exit(2)


def main() -> None:
    """Entry point of the ``structsel`` command."""
    app()
