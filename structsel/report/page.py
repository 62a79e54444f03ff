"""write_report(): one HTML file with the result first, then figures and tables, warnings, method and data."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from markupsafe import Markup

from structsel.diagnosis.result import Diagnosis
from structsel.errors import DomainError
from structsel.files import replacing, write_text
from structsel.formatting import format_number
from structsel.provenance import file_of, provenance_of
from structsel.qualification import Qualification
from structsel.reconstruction import Reconstruction, Reconstructions
from structsel.recording import Recording
from structsel.refinement import Refinement
from structsel.report import comparison, diagnosis, qualification, reconstruction, refinement, selection
from structsel.report.changes import changes_of
from structsel.report.page_model import Page, Part, bar_columns, place_sections
from structsel.selection import Selection, Selections
from structsel.tables import Bar, Cell, Link
from structsel.validation import Resimulation, Validation

Result = Diagnosis | Selection | Selections | Reconstruction | Reconstructions | Refinement
_HERE = Path(__file__).parent
_NO_BREAK = "\N{NO-BREAK SPACE}"
_EXPONENT = re.compile(r"(?<![\w.])-?(\d(?:\.\d+)?)e[+-]?\d{1,2}(?![\w.])")
_SQUARE = re.compile(r"(?<=/s)\^2|(?<=/rad)\^2|(?<=/deg)\^2|(?<=\bm)\^2")
_BEFORE_UNIT = re.compile(
    r"(?<=\d)(?=%)|(?<=\d) (?=(?:%|±|s|m|km|kg|N|deg|rad|Hz|ms|h|K|Pa|V|1)(?:[\s,;.)/²]|$))|(?<=±) (?=\d)"
)
_MAX_PRINTED_WARNINGS = 6
_MAX_TITLES = 12  # of sections that the printed summary omits
MAX_PRINTED_FINDINGS = 2
"""Findings that the printed summary of a diagnosis has."""


def write_report(
    result: Result,
    path: str | Path,
    *,
    recordings: Sequence[Recording] = (),
    judged: Validation | Mapping[str, Resimulation] | None = None,
    reasons: Sequence[str] = (),
    before: Result | str | Path | None = None,
    provenance: Mapping[str, Any] | None = None,
) -> Path:
    """Write a result as one HTML file that needs no other file.

    Parameters
    ----------
    result : Diagnosis, Selection, Selections, Reconstruction, Reconstructions or Refinement
    path : str or Path
    recordings : sequence of Recording
        Recordings used for a selection or a refinement: the page shows their time histories and lists their files.
        Long ones are decimated in the figures by minimum and maximum. The other results hold their recordings.
    judged : Validation, or mapping of str to Resimulation, optional
        Scores of a selection on validation recordings; re-simulations by the model ``"before"`` and ``"after"`` its
        refinement.
    reasons : sequence of str
        Reasons why a selection or a refinement is not valid; shown first.
    before : result of the same kind, str or Path, optional
        Result before a change, or its JSON file: the page shows the values that differ.
    provenance : mapping, optional
        Return value of `structsel.provenance.provenance_of` for all input files; by default, for the files of the
        recordings.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    DomainError
        The result is of another type.
    ArgumentError, DataError
        `before` is of another kind, or no file of a result.
    OSError
        The file cannot be written.
    """
    path = Path(path)
    text = render(result, recordings=recordings, judged=judged, reasons=reasons, before=before, provenance=provenance)
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
    """Write selections of the same responses by several methods as one HTML file.

    Parameters
    ----------
    found : mapping of method to Selections
        The figures show the first four.
    path : str or Path
    recordings : sequence of Recording
        Recordings used for the selections, and validation recordings.
    judged : mapping of method to Validation, optional
    pages : mapping of method to str, optional
        File in the same folder with the report of each method.
    provenance : mapping, optional
        See `write_report`.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    path = Path(path)
    page = comparison.page_of(found, recordings, judged or {}, pages or {})
    write_text(path, _fill_page(page, _provenance(provenance, recordings)))
    return path


def write_qualification(
    result: Qualification, folder: str | Path, *, provenance: Mapping[str, Any] | None = None
) -> tuple[Path, Path]:
    """Write a proof of match as ``qtg.html`` and ``qtg.pdf``, each one file that needs no other.

    Parameters
    ----------
    result : Qualification
    folder : str or Path
        Exists.
    provenance : mapping, optional
        See `write_report`.

    Returns
    -------
    tuple of Path
        HTML and PDF.

    Raises
    ------
    OSError
        A file cannot be written.
    """
    page = qualification.page_of(result)
    known = _provenance(provenance, [one.recorded for one in result.tests])
    context = {**_context(page), "pictures": qualification.pictures_of(result)}
    html, pdf = Path(folder) / "qtg.html", Path(folder) / "qtg.pdf"
    write_text(html, _fill("qualification.html", context, known))
    with replacing(pdf) as partial:
        partial.write_bytes(qualification.pdf_of(result, known["versions"]))
    return html, pdf


def _provenance(given: Mapping[str, Any] | None, recordings: Sequence[Recording]) -> Mapping[str, Any]:
    """Provenance that was given, or that of the known files of the recordings."""
    if given is not None:
        return given
    return provenance_of(path for one in recordings if (path := file_of(one.provenance)) is not None)


def render(
    result: Result,
    *,
    recordings: Sequence[Recording] = (),
    judged: Validation | Mapping[str, Resimulation] | None = None,
    reasons: Sequence[str] = (),
    before: Result | str | Path | None = None,
    provenance: Mapping[str, Any] | None = None,
) -> str:
    """HTML of a result, see `write_report`; text from data is escaped."""
    versions_and_files = _provenance(provenance, recordings)
    result, before = _several(result), _several(before)
    if isinstance(result, Diagnosis):
        context = diagnosis.page_of(result, () if before is None else (changes_of(result, before),))
        findings = [(f"finding-{f['number']}", f"{f['number']}. {f['effect']}") for f in context["findings"]]
        context |= {
            "contents": _contents(findings, context["parts"], context["data"], [("notes", "Notes")]),
            "not_printed": _not_printed(context["parts"], findings[MAX_PRINTED_FINDINGS:]),
            "printed_findings": MAX_PRINTED_FINDINGS,
        }
        return _fill("diagnosis.html", context, versions_and_files)
    if isinstance(result, Selections):
        page = selection.page_of(result, recordings, judged if isinstance(judged, Validation) else None, reasons)
    elif isinstance(result, Reconstructions):
        page = reconstruction.page_of(result)
    elif isinstance(result, Refinement):
        page = refinement.page_of(result, recordings, judged if isinstance(judged, Mapping) else {}, reasons)
    else:
        raise DomainError(
            f"write_report was given a {type(result).__name__}; it writes results of select, reconstruct, "
            "reconstruct_all, refine and diagnose."
        )
    if before is not None:
        page = replace(page, sections=(changes_of(result, before), *page.sections))
    return _fill_page(page, versions_and_files)


def _several(result: Any) -> Any:
    """Collection with one selection or reconstruction; other results as they are."""
    if isinstance(result, Selection):
        return Selections({result.response: result})
    return Reconstructions((result,), {}) if isinstance(result, Reconstruction) else result


def _fill_page(page: Page, provenance: Mapping[str, Any]) -> str:
    return _fill("results.html", {**_context(page), "shaded": ""}, provenance)


def _context(page: Page) -> dict[str, Any]:
    """Variables of the templates of pages of results."""
    parts = place_sections(page.sections)
    last = [("warnings", "Warnings"), ("method", "Method and data")]
    printed = len(page.warnings) <= _MAX_PRINTED_WARNINGS
    return {
        "page": page,
        "headline": page.headline,
        "data": page.data,
        "parts": parts,
        "contents": _contents([], parts, page.data, last),
        "not_printed": [*_not_printed(parts, [])[:-1], *["Warnings"] * (not printed), "Method and data"],
        "warnings_printed": printed,
    }


def _contents(
    first: Sequence[tuple[str, str]], parts: Sequence[Part], data: Mapping[str, Any], last: Sequence[tuple[str, str]]
) -> list[tuple[str, str]]:
    """Anchors and titles of a page, in order."""
    above = [(p.anchor, p.section.title) for p in parts if not p.section.after]
    below = [(p.anchor, p.section.title) for p in parts if p.section.after]
    figures = [("figures", "Time histories")] if data["recordings"] else []
    return [("result", "Result"), *first, *above, *figures, *below, *last]


def _not_printed(parts: Sequence[Part], findings: Sequence[tuple[str, str]]) -> list[str]:
    """Titles that the printed summary omits."""
    titles = [*(title for _, title in findings), *(p.section.title for p in parts if p.detail)]
    more = [f"{len(titles) - _MAX_TITLES} more sections"] if len(titles) > _MAX_TITLES else []
    return [*titles[:_MAX_TITLES], *more, "Method and data"]


def _fill(template: str, context: Mapping[str, Any], provenance: Mapping[str, Any]) -> str:
    # Jinja takes a while to import, and few commands write a page.
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    templates = Environment(
        loader=FileSystemLoader(_HERE),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
        finalize=_typeset,
    )
    templates.globals |= {"cell_kind": _cell_kind, "bar_columns": bar_columns}
    # Reports are sent to others: they have file names without folders.
    inputs = [{**one, "file": Path(one["file"]).name} for one in provenance["inputs"]]
    style, *scripts = ((_HERE / name).read_text(encoding="utf-8") for name in ("page.css", "charts.js", "flights.js"))
    return templates.get_template(template).render(
        **context,
        versions=provenance["versions"],
        inputs=inputs,
        style=Markup(style),
        script=Markup("\n".join(scripts)),
    )


def _typeset(value: Any) -> Any:
    """Text as printed: ±, squares of units, numbers without exponents, and no line break between number and unit."""
    if type(value) is not str:  # markup, the data of the charts and numbers stay
        return value
    text = _EXPONENT.sub(lambda found: format_number(float(found[0]), len(found[1].replace(".", ""))), value)
    text = _SQUARE.sub("²", text.replace("+-", "±"))
    return _BEFORE_UNIT.sub(_NO_BREAK, text)


def _cell_kind(value: Any) -> str:
    """Kind of a cell: bar, link, or the tone of a value."""
    if isinstance(value, Cell):
        return value.tone
    return "bar" if isinstance(value, Bar) else "link" if isinstance(value, Link) else ""
