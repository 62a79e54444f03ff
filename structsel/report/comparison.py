"""Selections by several methods as one page: what they agree on, where they part, and which predicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from structsel.formatting import count_of, format_decimals, format_number, join_names
from structsel.recording import Recording
from structsel.report.page_model import (
    Link,
    PageColumn,
    PageTable,
    Section,
    Sheet,
    conversions,
    list_sources,
    merge_remarks,
)
from structsel.report.selection import figures_of
from structsel.selection import Selection, Selections
from structsel.validation import Validation

_INKS = ("physics", "delivered", "refitted", "other")
_LEGEND = (
    "Values are in SI and radians; a dash: not in that model. Left out: predicting, in turn, manoeuvres (parts of a "
    "single one) left out of the selection. VIF: variance inflation. RRMSE: rms error over that of the measured "
    "response."
)


def sheet_of(
    found: Mapping[str, Selections],
    recordings: Sequence[Recording],
    judged: Mapping[str, Validation],
    pages: Mapping[str, str],
) -> Sheet:
    """The page of a comparison; `pages` are where each method has its own."""
    methods = list(found)
    first = next(iter(found.values()))
    responses = list(first)
    by_method = {response: {method: s[response] for method, s in found.items()} for response in responses}
    agreed = [r for r in responses if len({frozenset(s.terms) for s in by_method[r].values()}) == 1]
    held = list(dict.fromkeys(score.recording for one in judged.values() for score in one.scores))
    doubts = merge_remarks(
        (f"{s.response} by {method}", text)
        for method, each in found.items()
        for s in each.values()
        for text in s.doubts
    )
    apart = [r for r in responses if r not in agreed]
    return Sheet(
        verdict="all agree" if not apart else "the methods differ" if not agreed else f"{len(agreed)} agree",
        tone="good" if not apart and not doubts else "doubt",
        headline=_headline(agreed, apart, methods),
        lead=tuple(_parting(r, by_method[r]) for r in apart),
        about=_about(methods, first[responses[0]], held),
        reasons=(),
        sections=(*([_contents(pages)] if pages else ()), *(_section(r, by_method[r], judged) for r in responses)),
        doubts=doubts,
        notes=(),
        done=(f"The same data and candidates by {join_names(methods, len(methods))}.",),
        sources=list_sources(recordings, first[responses[0]].recordings, held),
        history=conversions(recordings),
        data=figures_of(dict(zip(_INKS, found.items())), recordings),
        legend=_LEGEND,
    )


def _about(methods: Sequence[str], one: Selection, held: Sequence[str]) -> str:
    judges = f"; {join_names(held)} held out for validation" if held else ""
    return f"{count_of(len(methods), 'way')} of selecting from {count_of(len(one.recordings), 'recording')}{judges}."


def _headline(agreed: Sequence[str], apart: Sequence[str], methods: Sequence[str]) -> str:
    count = count_of(len(methods), "method")
    if not apart:
        return f"All {count} keep the same terms of {join_names(agreed)}."
    if not agreed:
        return f"The {count} differ about the terms of {join_names(apart)}."
    return f"The {count} keep the same terms of {join_names(agreed)}, and differ about {join_names(apart)}."


def _parting(response: str, by_method: Mapping[str, Selection]) -> str:
    """Which terms some keep and others do not."""
    kept = [set(s.terms) for s in by_method.values()]
    shared, disputed = set.intersection(*kept), set.union(*kept)
    sure = f"all keep {join_names(map(str, sorted(shared)))}" if shared else "no term is kept by all"
    return f"{response}: {sure}; only some keep {join_names(map(str, sorted(disputed - shared)))}."


def _contents(pages: Mapping[str, str]) -> Section:
    rows = tuple((Link(method, page),) for method, page in pages.items())
    return Section("Each method by itself", tables=(PageTable((PageColumn("page", "link"),), rows),))


def _section(response: str, by_method: Mapping[str, Selection], judged: Mapping[str, Validation]) -> Section:
    numbers = tuple(PageColumn(method) for method in by_method)
    values = {m: dict(zip(("1", *map(str, s.terms)), s.values)) for m, s in by_method.items()}
    terms = ["1", *map(str, sorted({term for s in by_method.values() for term in s.terms}))]
    rows = tuple(
        (
            term,
            *(format_number(v.get(term)) for v in values.values()),
            f"{sum(term in v for v in values.values())} of {len(values)}",
        )
        for term in terms
    )
    chosen = list(by_method.values())
    measures = [
        ("terms", *(str(len(s.terms)) for s in chosen)),
        ("R²", *(format_decimals(s.r2) for s in chosen)),
        ("R², left out", *(format_decimals(s.held_out_r2) for s in chosen)),
        ("rms error, left out", *(format_number(s.held_out_rms, 3) for s in chosen)),
        ("highest VIF", *(format_number(float(s.vif.max()), 2) if len(s.vif) else "-" for s in chosen)),
        ("doubts", *(str(len(s.doubts)) for s in chosen)),
    ]
    if judged:
        scores = [judged[method].score(response) for method in by_method]
        measures.append(("R², held out", *(format_decimals(s.r2) for s in scores)))
        measures.append(("RRMSE, held out", *(format_decimals(s.rrmse) for s in scores)))
    tables = (
        PageTable((PageColumn("term", "name"), *numbers, PageColumn("kept by")), rows, "Terms and values"),
        PageTable((PageColumn("measure", "name"), *numbers), tuple(measures), "How well each explains and predicts"),
    )
    return Section(response, tables=tables)
