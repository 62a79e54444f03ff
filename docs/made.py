"""Pages that are generated when the site is built: the public names, the commands, the effects."""

from __future__ import annotations

import os
from typing import Any

from mkdocs.structure.files import File, Files
from pictures import pictures
from typer.main import get_command
from typer.testing import CliRunner

import structsel
from structsel.cli.program import app
from structsel.effects import EFFECTS


def on_files(files: Files, config: Any) -> Files:
    """Add the generated pages."""
    for name, text in (("reference.md", reference()), ("commands.md", commands()), ("effects.md", effects())):
        files.append(File.generated(config, name, content=text))
    for effect, picture in pictures():
        files.append(File.generated(config, f"effects/{effect}.svg", content=picture))
    return files


def reference() -> str:
    """One entry for each public name."""
    return "# Python\n\n" + "\n\n".join(map(_entry, sorted(structsel.__all__, key=str.lower)))


def _entry(name: str) -> str:
    """Entry of one name; of `select`, whose stub has overloads without a body, where it is defined."""
    if name != "select":
        return f"::: structsel.{name}"
    return "::: structsel.selection.select.select\n    options:\n      heading: structsel.select"


def commands() -> str:
    """The manual page of each command."""
    os.environ |= {"COLUMNS": "100", "NO_COLOR": "1", "TERM": "dumb"}
    pages = ["# Commands\n"]
    for name in ["", *(n for n, c in get_command(app).commands.items() if not c.hidden)]:  # type: ignore[attr-defined]
        manual = CliRunner().invoke(app, [*filter(None, [name]), "--help"]).stdout
        pages.append(f"## structsel {name}\n\n```text\n{manual.rstrip()}\n```\n")
    return "\n".join(pages)


def effects() -> str:
    """Each hypothesis: what it is, what it leaves, what it is taken for, what separates them."""
    parts = [_EFFECTS]
    known = {h.name for h in EFFECTS}
    for h in sorted(EFFECTS, key=lambda h: h.name):
        alike = (f"[{name}](#{name})" if name in known else name for name in h.look_alikes)
        facts = [("Similar effects", ", ".join(alike))]
        facts += [("Separated by", h.separated_by), ("Check", h.check)]
        shown = "\n".join(f"- {head}: {text}" for head, text in facts if text)
        picture = f"![Measured minus simulated response with {h.name}](effects/{h.name}.svg)"
        parts.append(f"## {h.name}\n\n{h.what} Kind: {h.kind}.\n\n{picture}\n\n{shown}\n")
    return "\n".join(parts)


_EFFECTS = """# Effects that can be named

Each picture shows the contribution of an effect of usual size, in one of its forms, to measured minus simulated in the
coefficient that it changes most: over time and, if it depends on one channel, over that channel (dashed in the left
part). The flights are simulated for this purpose, with doublets of elevator, rudder and ailerons, and steps of thrust.
"""
