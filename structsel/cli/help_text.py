"""Help pages: options with their texts, examples and paragraphs below them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import typer


def epilog(examples: Sequence[tuple[str, str]], *paragraphs: str) -> str:
    """Return the text below the options of a help page.

    Parameters
    ----------
    examples : sequence of (title, command)
    *paragraphs : str
        Rich markup; line breaks within one are not kept.
    """
    shown = [f"{title}:\n[cyan]  {command}[/cyan]" for title, command in examples]
    head = "[bold]Examples[/bold]" if len(examples) > 1 else "[bold]Example[/bold]"
    return "\n\n".join([head, *shown, *(" ".join(p.split()) for p in paragraphs)])


def option(name: str, text: str, panel: str | None = None, metavar: str | None = None) -> Any:
    """Option of a command, on a panel of its help page."""
    return typer.Option(name, help=text, rich_help_panel=panel, metavar=metavar)
