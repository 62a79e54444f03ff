"""Files that ``select`` and ``demo`` write: models, selections, tables, plots."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from structsel.cli.folders import names_in, output_folder, save_figures
from structsel.cli.input_files import provenance
from structsel.cli.messages import json_text
from structsel.recording import Recording
from structsel.selection import Selections
from structsel.tables import csv_of_frame
from structsel.validation import Validation


def write_results(
    out: Path,
    found: Mapping[str, Selections],
    scores: Mapping[str, Validation],
    recordings: Sequence[Recording],
    shown: Sequence[Recording],
    figures: str,
    before: Path | None = None,
    extra_files: Callable[[Path], None] | None = None,
) -> list[str]:
    """Write everything, or nothing; return the names written, plots as one.

    Parameters
    ----------
    out : Path
    found : mapping of method to Selections
        Several methods have one file each, with the method in its name, and a page that compares them.
    scores : mapping of method to Validation
    recordings : sequence of Recording
        Data of the reports: the recordings of the selection and of the validation.
    shown : sequence of Recording
        Recordings whose time histories are plotted.
    figures : str
        Format of the plots; empty for none.
    before : Path, optional
        JSON file of an earlier selection, with which the reports compare.
    extra_files : callable, optional
        Writes further files to the folder that it is called with.
    """
    from structsel.report import write_comparison, write_report

    with output_folder(out) as folder:
        context: dict[str, Any] = {"recordings": recordings, "provenance": provenance()}
        marks = {method: "" if len(found) == 1 else "_" + method.replace(", ", "_") for method in found}
        for method, selections in found.items():
            mark = marks[method]
            _write_one(folder, mark, selections, scores.get(method))
            write_report(selections, folder / f"report{mark}.html", judged=scores.get(method), before=before, **context)
            if figures:
                from structsel.plotting import draw_selection  # matplotlib takes a while to load

                save_figures(folder / f"plots{mark}", draw_selection(selections, shown), figures, 3 * len(selections))
        if len(found) > 1:
            pages = {method: f"report{mark}.html" for method, mark in marks.items()}
            write_comparison(found, folder / "report.html", judged=scores, pages=pages, **context)
        if extra_files is not None:
            extra_files(folder)
        return names_in(folder)


def _write_one(folder: Path, mark: str, selections: Selections, scores: Validation | None) -> None:
    selections.model.to_json(folder / f"model{mark}.json", provenance=provenance())
    (folder / f"selection{mark}.json").write_text(json_text(selections.to_dict()), encoding="utf-8")
    csv_of_frame(selections.to_frame(), folder / f"terms{mark}.csv")
    (folder / f"terms{mark}.tex").write_text(selections.model.latex() + "\n", encoding="utf-8")
    report = [str(selections)] + ([str(scores)] if scores is not None else [])
    (folder / f"report{mark}.txt").write_text("\n\n".join(report) + "\n", encoding="utf-8")
    if scores is not None:
        (folder / f"validation{mark}.json").write_text(json_text(scores.to_dict()), encoding="utf-8")
