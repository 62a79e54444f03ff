"""Links of the site: files outside docs/ become pages, and a dead link or anchor stops the build."""

from __future__ import annotations

import posixpath
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
_LINK = re.compile(r"(?<=\]\()([^)\s#:]+)(#[^)\s]*)?(?=\))")
_LANGUAGES = {".py": "python", ".toml": "toml", ".yml": "yaml", ".json": "json"}


def outside_pages(config: Any) -> list[File]:
    """A page for each file outside docs/ that a page of docs/ points to, and that these pages point to."""
    made: dict[str, File] = {}
    waiting = list(Path(config.docs_dir).rglob("*.md"))
    while waiting:
        path = waiting.pop()
        for target in _targets(path):
            name = _name(target)
            if name and name not in made:
                made[name] = File.generated(config, name, content=_content(target))
                if target.suffix == ".md":
                    waiting.append(target)
    return list(made.values())


def _targets(path: Path) -> list[Path]:
    """Files that the links of a page point to."""
    return [(path.parent / match[1]).resolve() for match in _LINK.finditer(path.read_text(encoding="utf-8"))]


def _name(target: Path) -> str:
    """Address of the page of a file outside docs/; empty for other files, and for the examples of the gallery."""
    if target.is_relative_to(ROOT / "docs") or not target.is_relative_to(ROOT) or not target.is_file():
        return ""
    place = target.relative_to(ROOT)
    if place.parts[0] == "examples" and place.suffix in (".py", ".ipynb"):
        return ""
    return f"files/{place.with_suffix('') if place.suffix == '.md' else place}.md"


def _content(target: Path) -> str:
    text = target.read_text(encoding="utf-8")
    if target.suffix == ".md":
        return text
    return f"# {target.relative_to(ROOT)}\n\n~~~~{_LANGUAGES.get(target.suffix, 'text')}\n{text}\n~~~~\n"


def rewrite_links(markdown: str, page: Page) -> str:
    """Links of a page to files outside docs/, turned into links to their pages."""
    uri = page.file.src_uri
    here = ROOT / uri.removeprefix("files/") if uri.startswith("files/") else ROOT / "docs" / uri

    def rewritten(match: re.Match[str]) -> str:
        target = Path(posixpath.normpath(here.parent / match[1]))
        name = _name(target)
        if target.is_relative_to(ROOT / "examples") and target.suffix in (".py", ".ipynb"):
            name = f"gallery/{target.stem}.md"
        if not name and uri.startswith("files/") and target.is_relative_to(ROOT / "docs"):
            name = target.relative_to(ROOT / "docs").as_posix()
        if not name:
            return match[0]
        return posixpath.relpath(name, posixpath.dirname(uri) or ".") + (match[2] or "")

    parts = re.split(r"(^(?:```|~~~).*?^(?:```|~~~)[ ]*$)", markdown, flags=re.MULTILINE | re.DOTALL)
    parts[::2] = [_LINK.sub(rewritten, part) for part in parts[::2]]
    return "".join(parts)


class _Links(HTMLParser):
    """Addresses and anchors of one page."""

    def __init__(self) -> None:
        super().__init__()
        self.anchors, self.addresses = {""}, set[str]()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name == "id" or (name == "name" and tag == "a"):
                self.anchors.add(value or "")
            elif name in ("href", "src") and tag != "base":
                self.addresses.add(value or "")


def dead_links(site: Path) -> list[str]:
    """Links of the built pages whose file or anchor is not there, as `page: link`."""
    pages = {}
    for path in site.rglob("*.html"):
        pages[path] = _Links()
        pages[path].feed(path.read_text(encoding="utf-8"))
    dead = []
    for path, page in pages.items():
        if path.name == "404.html":  # its addresses are those of the server
            continue
        for address in sorted(page.addresses):
            parts = urlsplit(address)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            target = target / "index.html" if target.is_dir() else target
            anchor = unquote(parts.fragment)
            if not target.exists() or (target in pages and anchor not in pages[target].anchors):
                dead.append(f"{path.relative_to(site)}: {address}")
    return dead


def check_site(config: Any) -> None:
    """Stop the build where a link is dead.

    Raises
    ------
    PluginError
        With each page and the link that leads nowhere.
    """
    if dead := dead_links(Path(config.site_dir)):
        raise PluginError(f"{len(dead)} links lead nowhere. Correct them:\n" + "\n".join(dead))


def add_outside_pages(files: Files, config: Any) -> None:
    """Add the pages of the files outside docs/."""
    for file in outside_pages(config):
        files.append(file)
