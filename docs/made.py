"""Pages that are made when the site is built: the public names, the commands, the effects."""

from __future__ import annotations

import os
from typing import Any

from mkdocs.structure.files import File, Files
from typer.main import get_command
from typer.testing import CliRunner

import structsel
from structsel.cli.program import app
from structsel.hypotheses import HYPOTHESES


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that stand nowhere as text."""
    for name, text in (("reference.md", reference()), ("commands.md", commands()), ("effects.md", effects())):
        files.append(File.generated(config, name, content=text))
    return files


def reference() -> str:
    """One entry for each public name."""
    return "# Python\n\n" + "\n\n".join(f"::: structsel.{name}" for name in sorted(structsel.__all__, key=str.lower))


def commands() -> str:
    """The manual page of each command."""
    os.environ |= {"COLUMNS": "100", "NO_COLOR": "1", "TERM": "dumb"}
    pages = ["# Commands\n"]
    for name in ["", *get_command(app).commands]:  # type: ignore[attr-defined]
        told = CliRunner().invoke(app, [*filter(None, [name]), "--help"]).stdout
        pages.append(f"## structsel {name}\n\n```text\n{told.rstrip()}\n```\n")
    return "\n".join(pages)


def effects() -> str:
    """Each hypothesis: what it is, what it is taken for, what separates them."""
    rows = [
        "# Effects that can be named\n",
        "| effect | kind | what it is | may be taken for | told apart by |",
        "|---|---|---|---|---|",
    ]
    rows += [
        f"| `{h.effect}` | {h.kind} | {h.what} | {', '.join(h.look_alikes)} | {h.separated_by} |"
        for h in sorted(HYPOTHESES, key=lambda h: h.effect)
    ]
    return "\n".join(rows) + "\n"
