"""Hooks of the site: the generated pages (public names, commands, effects, gallery), and its links."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from gallery import gallery
from links import add_outside_pages, check_site, rewrite_links
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from pictures import pictures
from public_names import reference_pages
from typer.main import get_command
from typer.testing import CliRunner

from structsel.cli.program import app
from structsel.effects import EFFECTS


def on_files(files: Files, config: Any) -> Files:
    """Add the generated pages."""
    generated: list[tuple[str, str | bytes]] = [("commands.md", commands()), ("effects.md", effects())]
    generated.append(("decisions.md", decisions()))
    generated += [*reference_pages(), *gallery()]
    generated += [(f"effects/{effect}.svg", picture) for effect, picture in pictures()]
    for name, content in generated:
        files.append(File.generated(config, name, content=content))
    add_outside_pages(files, config)
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Links to files outside docs/ lead to their pages."""
    return rewrite_links(markdown, page)


def on_post_page(output: str, page: Page, **_: Any) -> str:
    """Two faults of the theme: it loads a file of its search from a network, and the search lacks a name."""
    own = "../" * page.url.count("/") + "search-worker/shim.js"
    named = output.replace(
        'data-md-component="search" role="dialog"', 'data-md-component="search" role="dialog" aria-label="Search"'
    )
    return named.replace("https://unpkg.com/iframe-worker/shim", own)


def on_post_build(config: Any) -> None:
    """No link is dead."""
    check_site(config)


def commands() -> str:
    """The manual page of each command."""
    os.environ |= {"COLUMNS": "96", "NO_COLOR": "1", "TERM": "dumb"}
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


def decisions() -> str:
    """List of the design decisions, by the titles of their pages."""
    folder = Path(__file__).parent / "decisions"
    titles = [(path.name, path.read_text(encoding="utf-8").partition("\n")[0]) for path in sorted(folder.glob("*.md"))]
    links = "\n".join(f"- [{title.removeprefix('# ')}](decisions/{name})" for name, title in titles)
    return f"# Design decisions\n\nWhat was decided, why, and what was measured for it.\n\n{links}\n"


_EFFECTS = """# Effects that can be named

Each picture shows the contribution of an effect of usual size, in one of its forms, to measured minus simulated in the
coefficient that it changes most: over time and, if it depends on one channel, over that channel (dashed in the left
part). The flights are simulated for this purpose, with doublets of elevator, rudder and ailerons, and steps of thrust.
"""
