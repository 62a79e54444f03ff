"""Option ``--cut`` of every command that reads recordings: the parts of long recordings that are used."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace

import typer

from structsel.errors import DataError
from structsel.recording import Recording, split_manoeuvres

MANOEUVRES = "manoeuvres"
_CUTS: ContextVar[tuple[str, ...]] = ContextVar("cuts", default=())
_FORMS = (
    "--cut '{}' is neither manoeuvres, nor START:END in s such as 10:60, nor rows=FIRST:LAST such as rows=500:3000."
)


@contextmanager
def set_cuts(texts: Sequence[str]) -> Iterator[None]:
    """Context in which recordings are cut as ``--cut`` states.

    Raises
    ------
    BadParameter
        A text is not of its form, or `manoeuvres` is given with other parts.
    """
    for text in texts:
        if text != MANOEUVRES:
            _span(text)
    if MANOEUVRES in texts and len(texts) > 1:
        raise typer.BadParameter("--cut manoeuvres finds the parts itself: leave the other --cut out.")
    before = _CUTS.set(tuple(texts))
    try:
        yield
    finally:
        _CUTS.reset(before)


def is_cut() -> bool:
    """Whether the command line has ``--cut``."""
    return bool(_CUTS.get())


def cut(recording: Recording, find: bool = False) -> list[Recording]:
    """Parts of a recording that the command line names; of several, ``name_1``, ``name_2``, ...; else all of it.

    Raises
    ------
    DataError
        A part has fewer than two samples.
    """
    cuts = (MANOEUVRES,) if find else _CUTS.get()
    if not cuts:
        return [recording]
    if cuts == (MANOEUVRES,):
        return split_manoeuvres(recording)
    parts = [_part(recording, text) for text in cuts]
    if len(parts) == 1:
        return parts
    return [replace(part, name=f"{recording.name}_{k}") for k, part in enumerate(parts, 1)]


def _part(recording: Recording, text: str) -> Recording:
    by_rows, first, last = _span(text)
    if by_rows:
        rows = recording.t[slice(*(None if end is None else int(end) for end in (first, last)))]
        if len(rows) < 2:
            raise DataError(
                f"--cut {text} leaves {len(rows)} samples of '{recording.name}', which has {len(recording)}.\n"
                "Rows are counted from 0, and LAST is not included."
            )
        start, end = float(rows[0]), float(rows[-1])
    else:
        start = recording.t[0] if first is None else first
        end = recording.t[-1] if last is None else last
    part = recording.between(float(start), float(end))
    return replace(part, provenance=(*part.provenance, f"{text.removeprefix('rows=')} of '{recording.name}'"))


def _span(text: str) -> tuple[bool, float | None, float | None]:
    """Whether a part is given by rows, its begin and its end; None where they are left out."""
    by_rows = text.startswith("rows=")
    first, colon, last = text.removeprefix("rows=").partition(":")
    try:
        ends = [None if not end.strip() else float(int(end)) if by_rows else float(end) for end in (first, last)]
    except ValueError:
        colon = ""
    if not colon or ends == [None, None] or any(end is not None and end != end for end in ends):
        raise typer.BadParameter(_FORMS.format(text))
    return by_rows, ends[0], ends[1]
