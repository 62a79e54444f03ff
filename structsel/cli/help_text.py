"""Help pages: examples and paragraphs below a command's options."""

from __future__ import annotations

from collections.abc import Sequence


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
