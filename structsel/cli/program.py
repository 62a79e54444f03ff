"""The program: its commands, exit codes and error messages."""

from __future__ import annotations

from errno import EPIPE
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from structsel import __version__
from structsel.cli.help_text import epilog
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
    remedy. 2: the command line cannot be read. 3: diagnose, consistent only outside stated tolerances. 130: stopped by
    Ctrl-C; no file is incomplete.""",
)


COMMANDS = {
    "describe": "Print the channels of recordings with units and ranges, and report faults in the data.",
    "map": "Guess the channel map of a file from names, units and values, and write it with comments.",
    "aircraft": "Print a commented aircraft file to fill in, or check one.",
    "reconstruct": "Reconstruct flight paths: estimate sensor biases, wind and vane errors, and the "
    "states without these errors.",
    "coefficients": "Compute the aerodynamic coefficients of recordings, and write them with the channels "
    "of candidate terms.",
    "select": "Select the terms of the model of each response from candidates, and estimate their uncertainty.",
    "validate": "Score the predictions of a model on recordings: R2, relative rms error, Theil's "
    "coefficient, whiteness.",
    "inputs": "Design inputs (classical, multisine, optimal), and compare the information that they "
    "give about parameters.",
    "simulate": "Simulate a model: trim, modes, and the response to inputs, as recordings.",
    "frequency-response": "Frequency responses and coherence of recorded inputs and outputs, and transfer functions "
    "fitted to them.",
    "monitor": "Estimate parameters by equation error in the frequency domain while a flight is recorded.",
    "refine": "Estimate the parameters of a model by output error or filter error, from complete recorded manoeuvres.",
    "diagnose": "Compare a simulation with recordings, and find the effects that it lacks, with their probabilities.",
    "explore": "Show the residuals of a model or a simulation, and what one more term or effect would do, on a local "
    "page.",
    "export": "Write a model for JSBSim, Python, C, Modelica, LaTeX or a spreadsheet, or as text.",
    "demo": "Select models of all six axes from six simulated flights, and print them with the true values.",
}
"""Commands in the order of the help page, with what each does; its module has the same name."""


class Commands(dict[str, Any]):
    """Commands by name, each imported when it is looked up."""

    def __missing__(self, name: str) -> Any:
        """Import the command of this name.

        Raises
        ------
        KeyError
            There is no such command.
        """
        if name not in COMMANDS:
            raise KeyError(name)
        from structsel.cli.common_options import with_common_options

        module = import_module(f"structsel.cli.{name.replace('-', '_')}")
        single = typer.Typer(
            rich_markup_mode="rich", add_completion=False, context_settings=_SETTINGS, pretty_exceptions_enable=False
        )
        single.command(name, epilog=module.EPILOG)(with_common_options(module.run))
        self[name] = typer.main.get_command(single)
        return self[name]


class Program(TyperGroup):
    """Group of commands that imports the one that is called, and prints errors and warnings without a traceback."""

    def __init__(self, *args: Any, **options: Any):
        super().__init__(*args, **options)
        # Name and help text, for the help page and for completion.
        known = {name: TyperCommand(name, help=text, rich_markup_mode="rich") for name, text in COMMANDS.items()}
        self.commands = {**known, **self.commands}

    def all_commands(self) -> dict[str, Any]:
        """Every command with its options; each is imported."""
        return {name: LOADED[name] if name in COMMANDS else one for name, one in self.commands.items()}

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Command that is called, with its options, and the rest of the command line."""
        name, command, rest = super().resolve_command(ctx, args)
        return name, LOADED[name] if name in COMMANDS else command, rest

    def invoke(self, ctx: Any) -> Any:
        """Run the command; exit code 1 for an error of the data or the request, 130 for Ctrl-C."""
        from structsel.cli.folders import folder_locks
        from structsel.cli.messages import plain_warnings, say

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


LOADED = Commands()
"""Commands that were called, or whose options were needed."""
_SETTINGS = {"help_option_names": ["-h", "--help"]}

app = typer.Typer(
    cls=Program,
    name="structsel",
    help="Identify aerodynamic models from flight-test recordings, and find what a simulation is missing.",
    epilog=_EPILOG,
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings=_SETTINGS,
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


@app.command("prove", hidden=True, context_settings={"ignore_unknown_options": True, "allow_extra_args": True})
def _prove(ctx: typer.Context) -> None:
    """Moved: ``python -m proof``, from a clone of the repository."""
    from structsel.cli.messages import say

    say("error", "'structsel prove' is no longer a command. Run 'python -m proof' from a clone of the repository.")
    raise typer.Exit(2)


def main() -> None:
    """Entry point of the ``structsel`` command."""
    app()
