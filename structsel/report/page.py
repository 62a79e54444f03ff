"""A result as one page: the finding first, then figures and tables, doubts, and what was done."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from markupsafe import Markup

from structsel.atomic import write_text
from structsel.diagnosis.result import Diagnosis
from structsel.errors import DomainError
from structsel.reconstruction import Reconstruction, Reconstructions
from structsel.recording import Recording
from structsel.refinement import Refinement
from structsel.report import diagnosis, flight_path, refinement, selection
from structsel.selection import Selection, Selections
from structsel.validation import Replay, Validation

Result = Diagnosis | Selection | Selections | Reconstruction | Reconstructions | Refinement
_HERE = Path(__file__).parent


def write_report(
    result: Result,
    path: str | Path,
    *,
    recordings: Sequence[Recording] = (),
    judged: Validation | Mapping[str, Replay] | None = None,
    reasons: Sequence[str] = (),
) -> Path:
    """Write a result as one HTML file that holds all it needs.

    Parameters
    ----------
    result : Diagnosis, Selection, Selections, Reconstruction, Reconstructions or Refinement
    path : str or Path
    recordings : sequence of Recording
        Those a selection or a refinement was made from: they are drawn, and their files named. Long ones are thinned
        for the figures, by their least and greatest samples. The other results hold their own.
    judged : Validation, or mapping of str to Replay, optional
        What held-out recordings say of a selection; of a model before and after its refinement.
    reasons : sequence of str
        Why not to believe a selection or a refinement; said first.

    Returns
    -------
    Path
        Where it stands.

    Raises
    ------
    DomainError
        The result is none of these.
    OSError
        The file cannot be written.
    """
    path = Path(path)
    write_text(path, render(result, recordings=recordings, judged=judged, reasons=reasons))
    return path


def render(
    result: Result,
    *,
    recordings: Sequence[Recording] = (),
    judged: Validation | Mapping[str, Replay] | None = None,
    reasons: Sequence[str] = (),
) -> str:
    """HTML of a result, as `write_report` takes it; whatever comes from its data is escaped."""
    if isinstance(result, Diagnosis):
        return _fill("diagnosis.html", diagnosis.page_of(result))
    if isinstance(result, Selection):
        result = Selections({result.response: result})
    if isinstance(result, Reconstruction):
        result = Reconstructions((result,), {})
    if isinstance(result, Selections):
        sheet = selection.sheet_of(result, recordings, judged if isinstance(judged, Validation) else None, reasons)
    elif isinstance(result, Reconstructions):
        sheet = flight_path.sheet_of(result)
    elif isinstance(result, Refinement):
        sheet = refinement.sheet_of(result, recordings, judged if isinstance(judged, Mapping) else {}, reasons)
    else:
        raise DomainError(
            f"write_report was given a {type(result).__name__}; it writes what select, reconstruct, reconstruct_all, "
            "refine and diagnose return."
        )
    return _fill("sheet.html", {"sheet": sheet, "headline": sheet.headline, "data": sheet.data, "shaded": ""})


def _fill(template: str, context: Mapping[str, Any]) -> str:
    # Templates take a while to load, and few commands make a page.
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    pages = Environment(
        loader=FileSystemLoader(_HERE), autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined
    )
    style, *scripts = ((_HERE / name).read_text(encoding="utf-8") for name in ("page.css", "charts.js", "flights.js"))
    return pages.get_template(template).render(
        **context, versions=_versions(), style=Markup(style), script=Markup("\n".join(scripts))
    )


def _versions() -> str:
    from structsel import __version__  # the package knows its report, not the reverse

    beneath = f"Python {platform.python_version()}, NumPy {np.__version__}, SciPy {scipy.__version__}"
    return f"structsel {__version__}, {beneath}"
