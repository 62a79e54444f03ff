"""Help pages: examples and paragraphs below a command's options."""

from __future__ import annotations

from collections.abc import Sequence


def page(examples: Sequence[tuple[str, str]], *paragraphs: str) -> str:
    """Return the end of a help page.

    Parameters
    ----------
    examples : sequence of (says, command)
    *paragraphs : str
        Rich markup; line breaks within one are not kept.
    """
    shown = [f"{says}:\n[cyan]  {command}[/cyan]" for says, command in examples]
    head = "[bold]Examples[/bold]" if len(examples) > 1 else "[bold]Example[/bold]"
    return "\n\n".join([head, *shown, *(" ".join(p.split()) for p in paragraphs)])
