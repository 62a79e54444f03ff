"""Options of every command: a file of defaults, and how much is printed."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from structsel import __version__
from structsel.cli.cutting import set_cuts
from structsel.cli.defaults import DEFAULTS, load_defaults
from structsel.cli.help_text import option
from structsel.cli.input_files import record_inputs
from structsel.cli.messages import log_duration, say, set_verbosity

_PANEL = "Every command"


def _apply_defaults(ctx: typer.Context, path: Path | None) -> Path | None:
    """Take the defaults of this command from a file, before the other options are read, which have precedence."""
    if path is None and DEFAULTS.exists():
        path = DEFAULTS
    if path is not None and not ctx.resilient_parsing:
        commands = ctx.find_root().command.all_commands()  # type: ignore[attr-defined]
        stated = load_defaults(path, commands)[str(ctx.info_name)]
        ctx.default_map = {**(ctx.default_map or {}), **stated}
    return path


_COMMON: dict[str, tuple[Any, Any]] = {
    "config": (
        None,
        Annotated[
            Path | None,
            typer.Option(
                "--config",
                metavar="FILE.TOML",
                help=f"File with defaults of options, a table for each command; by default {DEFAULTS} in this folder.",
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
            option("--quiet", "Print warnings, errors and the result only; with --out no result.", _PANEL),
        ],
    ),
    "verbose": (
        False,
        Annotated[
            bool,
            option("--verbose", "Print each step and its duration.", _PANEL),
        ],
    ),
}


_CUT = Annotated[
    list[str] | None,
    option(
        "--cut",
        "Part of each recording that is used: START:END in s, rows=FIRST:LAST, or manoeuvres, the parts in which "
        "controls move; may be repeated. Recordings are always split at gaps in time.",
        _PANEL,
        "PART",
    ),
]


def with_common_options(run: Callable[..., None]) -> Callable[..., None]:
    """Return the command with the options ``--config``, ``--quiet`` and ``--verbose`` added."""

    @wraps(run)
    def command(config: Path | None, quiet: bool, verbose: bool, **options: Any) -> None:
        cuts = options.pop("cut", None) or []
        if quiet and verbose:
            raise typer.BadParameter("give one of --quiet and --verbose, not both.")
        with (
            set_verbosity(quiet, verbose, written=options.get("out") is not None),
            record_inputs(options, config, cuts),
        ):
            if config is not None:
                say("note", f"defaults of options are from '{config}'.")
            if cuts and options.get("stream"):
                raise typer.BadParameter("--stream reads complete files: leave --cut out, or cut them first.")
            with set_cuts(cuts), log_duration(f"structsel {__version__} {run.__module__.rpartition('.')[2]}"):
                run(**options)

    common = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
        for name, (default, annotation) in _COMMON.items()
    ]
    if {"files", "recordings"} & inspect.signature(run).parameters.keys():
        common.insert(0, inspect.Parameter("cut", inspect.Parameter.KEYWORD_ONLY, default=None, annotation=_CUT))
    kinds = get_type_hints(run, include_extras=True)
    declared = [one.replace(annotation=kinds[one.name]) for one in inspect.signature(run).parameters.values()]
    command.__signature__ = inspect.Signature([*declared, *common])  # type: ignore[attr-defined]
    command.__annotations__ = {one.name: one.annotation for one in (*declared, *common)}
    return command
