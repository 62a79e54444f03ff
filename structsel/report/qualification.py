"""Proof of match as one HTML file and one PDF: each manoeuvre with its test, its bands, pass or fail."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from structsel.formatting import count_of
from structsel.qualification import Qualification
from structsel.qualification.result import AFTER, BEFORE
from structsel.qualification.tolerances import SOURCE
from structsel.report.page_model import Note, Page, Section, Status, list_history, list_sources
from structsel.tables import Table

_METHOD = (
    "A recording with several inputs is divided at their starts. Each manoeuvre is simulated from its first recorded "
    "state with the recorded inputs.",
    f"Tolerances: {SOURCE}. Of two tolerances of one parameter the less restrictive one counts. A time history passes "
    "if every sample is within its tolerance.",
    "Period, time to half amplitude and damping ratio are those of a decaying oscillation that is fitted to the free "
    "motion after the input, recorded and simulated alike. A fit that explains less than 80 % of it is not used.",
    "The proof shows where a simulation follows these recordings. It does not qualify a device: the rules also state "
    "flight conditions, configurations and the data gathering.",
)


def page_of(result: Qualification) -> Page:
    """Content of the page; sections are the overview and one for each manoeuvre."""
    stage = AFTER if result.corrected else BEFORE
    failed, open_ = result.count(stage, False), result.count(stage, None)
    judged = sum(bool(one.kind) for one in result.tests)
    status: Status = "bad" if failed else "warning" if open_ or not judged else "good"
    verdict = f"{failed} failed" if failed else "not complete" if open_ or not judged else "all passed"
    summary = []
    if open_:
        summary.append(f"{count_of(open_, 'test')} could not be judged: a value was not measured.")
    if missing := len(result.tests) - judged:
        summary.append(f"{count_of(missing, 'manoeuvre')} belong{'s' * (missing == 1)} to no test of the table.")
    sections = [Section("Overview", tables=(result.overview(),))]
    for one in result.tests:
        title = f"{one.name}: {one.title}"
        tables = (_with_signs(result.table_of(one)),) if one.kind else ()
        sections.append(Section(title, text=(f"Taken for this test because {one.why}.",), tables=tables))
    recordings = [one.recorded for one in result.tests]
    models = f"{result.model}, corrected: {result.corrected}" if result.corrected else result.model
    return Page(
        verdict=verdict,
        status=status,
        headline=result.headline(),
        summary=tuple(summary),
        about=f"Simulation: {models}. {count_of(len(result.tests), 'manoeuvre')}.",
        reasons=(),
        sections=tuple(sections),
        warnings=tuple(Note("", text) for text in result.doubts),
        notes=(),
        method=_METHOD,
        sources=list_sources(recordings),
        history=list_history(recordings),
        data={"recordings": [], "charts": []},
    )


def _with_signs(table: Table) -> Table:
    """Table with the sign of a tolerance as print has it."""
    rows = (tuple(cell.replace("+-", "±") if isinstance(cell, str) else cell for cell in row) for row in table.rows)
    return replace(table, rows=tuple(rows))


def pictures_of(result: Qualification) -> list[str]:
    """Data URL of the figure of each section; empty for the overview."""
    from structsel.plotting.qualification import svg_pictures  # matplotlib takes a while to load

    encoded = (base64.b64encode(picture).decode() for picture in svg_pictures(result))
    return ["", *(f"data:image/svg+xml;base64,{text}" for text in encoded)]


def pdf_of(result: Qualification, versions: Mapping[str, Any]) -> bytes:
    """PDF: an overview, then a page for each manoeuvre."""
    from structsel.plotting.qualification import pdf_pages  # matplotlib takes a while to load

    return pdf_pages(result, SOURCE, f"structsel {versions['structsel']}")
