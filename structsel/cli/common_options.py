"""What every command takes besides its own options: a file of defaults, and how much is said."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from structsel import __version__
from structsel.cli.defaults import DEFAULTS, load_defaults
from structsel.cli.input_files import reading
from structsel.cli.messages import say, speaking, timed

_PANEL = "Every command"


def _apply_defaults(ctx: typer.Context, path: Path | None) -> Path | None:
    """Take the options of this command from a file; called before the others are read, which then win."""
    if path is None and DEFAULTS.exists():
        path = DEFAULTS
    if path is not None and not ctx.resilient_parsing:
        held = load_defaults(path, ctx.find_root().command.commands)[str(ctx.info_name)]  # type: ignore[attr-defined]
        ctx.default_map = {**(ctx.default_map or {}), **held}
    return path


_OWN: dict[str, tuple[Any, Any]] = {
    "config": (
        None,
        Annotated[
            Path | None,
            typer.Option(
                "--config",
                metavar="FILE.TOML",
                help=f"Defaults of options, in a table per command; {DEFAULTS} of this folder if not given.",
                callback=_apply_defaults,
                is_eager=True,
                rich_help_panel=_PANEL,
            ),
        ],
    ),
    "quiet": (
        False,
        Annotated[
            bool,
            typer.Option(
                "--quiet",
                help="Warnings, errors and the bare result; with --out not even that.",
                rich_help_panel=_PANEL,
            ),
        ],
    ),
    "verbose": (
        False,
        Annotated[
            bool,
            typer.Option("--verbose", help="What is being done, and how long it took.", rich_help_panel=_PANEL),
        ],
    ),
}


def mannered(run: Callable[..., None]) -> Callable[..., None]:
    """Return a command that also takes ``--config``, ``--quiet`` and ``--verbose``."""

    @wraps(run)
    def command(config: Path | None, quiet: bool, verbose: bool, **asked: Any) -> None:
        if quiet and verbose:
            raise typer.BadParameter("give one of --quiet and --verbose, not both.")
        with speaking(quiet, verbose, written=asked.get("out") is not None), reading(asked, config):
            if config is not None:
                say("note", f"options not given are taken from '{config}'.")
            with timed(f"structsel {__version__} {run.__module__.rpartition('.')[2]}"):
                run(**asked)

    own = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
        for name, (default, annotation) in _OWN.items()
    ]
    kinds = get_type_hints(run, include_extras=True)
    theirs = [one.replace(annotation=kinds[one.name]) for one in inspect.signature(run).parameters.values()]
    command.__signature__ = inspect.Signature([*theirs, *own])  # type: ignore[attr-defined]
    command.__annotations__ = {one.name: one.annotation for one in (*theirs, *own)}
    return command
