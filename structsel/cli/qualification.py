"""Proof of match for ``structsel validate --replay --qtg``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from structsel.cli.folders import names_in, output_folder
from structsel.cli.messages import ProgressBar, json_text, print_json, stdout
from structsel.cli.tables import print_files, print_summary
from structsel.formatting import join_names
from structsel.model import AeroModel
from structsel.provenance import provenance_of
from structsel.qualification import Qualification, qualify
from structsel.tables import csv_of_frame


def qualify_and_show(
    model: Path, corrected: Path | None, files: Sequence[Path], out: Path | None, json: bool, **options: Any
) -> None:
    """Compare with the tolerances, print the result, and write the pages."""
    after = None if corrected is None else AeroModel.from_json(corrected)
    with ProgressBar("simulating") as waiting:
        result = qualify(AeroModel.from_json(model), corrected=after, progress=waiting, **options)
    result = replace(result, model=model.name, corrected="" if corrected is None else str(corrected))
    written = [] if out is None else _write(out, result, files)
    if json:
        print_json(result.to_dict())
        return
    print_summary(stdout(), result.summary())
    if out is not None:
        print_files(stdout(), str(out), written)
        stdout().print(f"Open {join_names([out / 'qtg.html', out / 'qtg.pdf'])}.", highlight=False, soft_wrap=True)


def _write(out: Path, result: Qualification, files: Sequence[Path]) -> list[str]:
    """Write everything, or nothing; return the names written."""
    from structsel.report import write_qualification  # matplotlib takes a while to load

    with output_folder(out) as folder:
        (folder / "qtg.json").write_text(json_text(result.to_dict()), encoding="utf-8")
        csv_of_frame(result.to_frame(), folder / "qtg.csv")
        write_qualification(result, folder, provenance=provenance_of(files))
        return names_in(folder)
