"""The gallery: a page for each notebook of examples/, with its stored figures, and a page of previews."""

from __future__ import annotations

import base64
import json
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

EXAMPLES = Path(__file__).parents[1] / "examples"


def gallery() -> Iterator[tuple[str, str | bytes]]:
    """Names and contents of the files of the gallery."""
    cards = []
    for path in sorted(EXAMPLES.glob("*.ipynb")):
        notebook = json.loads(path.read_text(encoding="utf-8"))
        page, pictures = _page(path.stem, notebook["cells"])
        yield f"gallery/{path.stem}.md", page
        for number, picture in enumerate(pictures, start=1):
            yield f"gallery/{path.stem}-{number}.png", picture
        cards.append(_card(path.stem, page, bool(pictures)))
    yield "gallery.md", _GALLERY + "\n".join(cards)


def _card(stem: str, page: str, has_picture: bool) -> str:
    title = page.partition("\n")[0].removeprefix("# ")
    picture = (
        f"[![First figure of the example {stem}](gallery/{stem}-1.png)](gallery/{stem}.md)\n\n" if has_picture else ""
    )
    return f"## {_short(title)}\n\n{picture}{title}. [Open the example](gallery/{stem}.md)\n"


def _short(title: str) -> str:
    return re.split(r"[:,;]| of a | from ", title)[0]


def _page(stem: str, cells: list[dict[str, Any]]) -> tuple[str, list[bytes]]:
    """Markdown of one notebook, and its figures."""
    parts: list[str] = []
    pictures: list[bytes] = []
    for cell in cells:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        for output in cell["outputs"]:
            data = output.get("data", {})
            text = "".join(output.get("text", "" if "image/png" in data else data.get("text/plain", "")))
            if "image/png" in data:
                pictures.append(base64.b64decode("".join(data["image/png"])))
                parts.append(f"![Figure {len(pictures)} of this example]({stem}-{len(pictures)}.png)")
            elif text:
                lines = [
                    textwrap.fill(line, 118, subsequent_indent="    ") if len(line) > 118 else line
                    for line in _PLAIN.sub("", text).rstrip().splitlines()
                ]
                parts.append("```text\n" + "\n".join(lines) + "\n```")
    title, *rest = parts
    where = f"The script is `examples/{stem}.py`, the notebook `examples/{stem}.ipynb`."
    first, _, others = title.partition("\n")
    return "\n\n".join([first, where, others.strip(), *rest]) + "\n", pictures


_PLAIN = re.compile(r"\x1b\[[0-9;]*m")
_GALLERY = """# Gallery

Each example is a script and a notebook of the same cells. It makes its own data, so it runs as it stands, and ends in
an assertion about the known truth. `jupyter lab examples/` opens the notebooks (`pip install "structsel[notebooks]"`).

"""
