"""A result as one page: the finding first, then figures and tables, doubts, and what was done."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from structsel.diagnosis.result import Diagnosis
from structsel.errors import DomainError
from structsel.files import write_text
from structsel.provenance import file_of, provenance_of
from structsel.reconstruction import Reconstruction, Reconstructions
from structsel.recording import Recording
from structsel.refinement import Refinement
from structsel.report import comparison, diagnosis, reconstruction, refinement, selection
from structsel.report.page_model import Sheet
from structsel.selection import Selection, Selections
from structsel.validation import Resimulation, Validation

Result = Diagnosis | Selection | Selections | Reconstruction | Reconstructions | Refinement
_HERE = Path(__file__).parent


def write_report(
    result: Result,
    path: str | Path,
    *,
    recordings: Sequence[Recording] = (),
    judged: Validation | Mapping[str, Resimulation] | None = None,
    reasons: Sequence[str] = (),
    provenance: Mapping[str, Any] | None = None,
) -> Path:
    """Write a result as one HTML file that holds all it needs.

    Parameters
    ----------
    result : Diagnosis, Selection, Selections, Reconstruction, Reconstructions or Refinement
    path : str or Path
    recordings : sequence of Recording
        Those a selection or a refinement was made from: they are drawn, and their files named. Long ones are thinned
        for the figures, by their least and greatest samples. The other results hold their own.
    judged : Validation, or mapping of str to Resimulation, optional
        What held-out recordings say of a selection; of a model before and after its refinement.
    reasons : sequence of str
        Why not to believe a selection or a refinement; said first.
    provenance : mapping, optional
        As `structsel.provenance.provenance_of` all files that went in; of the recordings' if not given.

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
    text = render(result, recordings=recordings, judged=judged, reasons=reasons, provenance=provenance)
    write_text(path, text)
    return path


def write_comparison(
    found: Mapping[str, Selections],
    path: str | Path,
    *,
    recordings: Sequence[Recording] = (),
    judged: Mapping[str, Validation] | None = None,
    pages: Mapping[str, str] | None = None,
    provenance: Mapping[str, Any] | None = None,
) -> Path:
    """Write selections of the same responses by several methods, side by side, as one HTML file.

    Parameters
    ----------
    found : mapping of method to Selections
        Four at most are drawn.
    path : str or Path
    recordings : sequence of Recording
        Those they were made from, and those that judge them.
    judged : mapping of method to Validation, optional
    pages : mapping of method to str, optional
        File beside this one that tells of the method alone.
    provenance : mapping, optional
        As `write_report` takes it.

    Returns
    -------
    Path
        Where it stands.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    path = Path(path)
    sheet = comparison.sheet_of(found, recordings, judged or {}, pages or {})
    write_text(path, _fill_sheet(sheet, _provenance(provenance, recordings)))
    return path


def _provenance(given: Mapping[str, Any] | None, recordings: Sequence[Recording]) -> Mapping[str, Any]:
    """As given; or of the recordings' files, as far as they are known."""
    if given is not None:
        return given
    return provenance_of(path for one in recordings if (path := file_of(one.provenance)) is not None)


def render(
    result: Result,
    *,
    recordings: Sequence[Recording] = (),
    judged: Validation | Mapping[str, Resimulation] | None = None,
    reasons: Sequence[str] = (),
    provenance: Mapping[str, Any] | None = None,
) -> str:
    """HTML of a result, as `write_report` takes it; whatever comes from its data is escaped."""
    made = _provenance(provenance, recordings)
    if isinstance(result, Diagnosis):
        return _fill("diagnosis.html", diagnosis.page_of(result), made)
    if isinstance(result, Selection):
        result = Selections({result.response: result})
    if isinstance(result, Reconstruction):
        result = Reconstructions((result,), {})
    if isinstance(result, Selections):
        sheet = selection.sheet_of(result, recordings, judged if isinstance(judged, Validation) else None, reasons)
    elif isinstance(result, Reconstructions):
        sheet = reconstruction.sheet_of(result)
    elif isinstance(result, Refinement):
        sheet = refinement.sheet_of(result, recordings, judged if isinstance(judged, Mapping) else {}, reasons)
    else:
        raise DomainError(
            f"write_report was given a {type(result).__name__}; it writes what select, reconstruct, reconstruct_all, "
            "refine and diagnose return."
        )
    return _fill_sheet(sheet, made)


def _fill_sheet(sheet: Sheet, provenance: Mapping[str, Any]) -> str:
    context = {"sheet": sheet, "headline": sheet.headline, "data": sheet.data, "shaded": ""}
    return _fill("sheet.html", context, provenance)


def _fill(template: str, context: Mapping[str, Any], provenance: Mapping[str, Any]) -> str:
    # Templates take a while to load, and few commands make a page.
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    pages = Environment(
        loader=FileSystemLoader(_HERE), autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined
    )
    # A page is sent to others, whom the folders of this machine do not concern.
    inputs = [{**one, "file": Path(one["file"]).name} for one in provenance["inputs"]]
    style, *scripts = ((_HERE / name).read_text(encoding="utf-8") for name in ("page.css", "charts.js", "flights.js"))
    return pages.get_template(template).render(
        **context,
        versions=provenance["versions"],
        inputs=inputs,
        style=Markup(style),
        script=Markup("\n".join(scripts)),
    )
