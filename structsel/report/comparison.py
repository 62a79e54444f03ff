"""Page that compares selections by several methods: terms in common, differences, and predictions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from structsel.formatting import count_of, format_decimals, format_number, join_names
from structsel.recording import Recording
from structsel.report.page_model import Page, Section, list_history, list_sources, merge_notes
from structsel.report.selection import figures_of
from structsel.selection import Selection, Selections
from structsel.tables import Column, Link, Table, text_column
from structsel.validation import Validation

_STYLES = ("physics", "delivered", "refitted", "other")
_LEGEND = (
    "Values are in SI units and radians; a dash: the model does not have the term. Cross-validated: each manoeuvre (or "
    "part of a single one) is predicted by a model selected without it. VIF: variance inflation factor. RRMSE: rms "
    "error over the rms of the measured response."
)


def page_of(
    found: Mapping[str, Selections],
    recordings: Sequence[Recording],
    judged: Mapping[str, Validation],
    pages: Mapping[str, str],
) -> Page:
    """Page of a comparison; `pages` has the file with the report of each method."""
    methods = list(found)
    first = next(iter(found.values()))
    responses = list(first)
    by_method = {response: {method: s[response] for method, s in found.items()} for response in responses}
    agreed = [r for r in responses if len({frozenset(s.terms) for s in by_method[r].values()}) == 1]
    different = [r for r in responses if r not in agreed]
    held_out = list(dict.fromkeys(score.recording for one in judged.values() for score in one.scores))
    warnings = merge_notes(
        (f"{s.response} by {method}", text)
        for method, each in found.items()
        for s in each.values()
        for text in s.doubts
    )
    agreement = f"{len(agreed)} of {len(responses)} agree" if agreed else "the methods differ"
    return Page(
        verdict=agreement if different else "all agree",
        status="warning" if different or warnings else "good",
        headline=_headline(agreed, different, methods),
        summary=tuple(_difference(r, by_method[r]) for r in different),
        about=_about(methods, first[responses[0]], held_out),
        reasons=(),
        sections=(*([_links(pages)] if pages else ()), *(_section(r, by_method[r], judged) for r in responses)),
        warnings=warnings,
        notes=(),
        method=(f"The same data and candidates by {join_names(methods, len(methods))}.",),
        sources=list_sources(recordings, first[responses[0]].recordings, held_out),
        history=list_history(recordings),
        data=figures_of(dict(zip(_STYLES, found.items())), recordings),
        legend=_LEGEND,
    )


def _about(methods: Sequence[str], one: Selection, held_out: Sequence[str]) -> str:
    validation = f"; validation with {join_names(held_out)}" if held_out else ""
    recordings = count_of(len(one.recordings), "recording")
    return f"Selection by {count_of(len(methods), 'method')} from {recordings}{validation}."


def _headline(agreed: Sequence[str], different: Sequence[str], methods: Sequence[str]) -> str:
    count = count_of(len(methods), "method")
    if not different:
        return f"All {count} select the same terms of {join_names(agreed)}."
    if not agreed:
        return f"The {count} select different terms of {join_names(different)}."
    return f"The {count} select the same terms of {join_names(agreed)}, and different terms of {join_names(different)}."


def _difference(response: str, by_method: Mapping[str, Selection]) -> str:
    """Terms of all methods, and of some of them."""
    each = [set(s.terms) for s in by_method.values()]
    common, some = set.intersection(*each), set.union(*each)
    text = f"all select {join_names(map(str, sorted(common)))}" if common else "no term is selected by all"
    return f"{response}: {text}; only some select {join_names(map(str, sorted(some - common)))}."


def _links(pages: Mapping[str, str]) -> Section:
    rows = tuple((Link(method, page),) for method, page in pages.items())
    return Section("Report of each method", tables=(Table((text_column("method"),), rows),))


def _section(response: str, by_method: Mapping[str, Selection], judged: Mapping[str, Validation]) -> Section:
    numbers = tuple(Column(method) for method in by_method)
    values = {m: dict(zip(("1", *map(str, s.terms)), s.values)) for m, s in by_method.items()}
    terms = ["1", *map(str, sorted({term for s in by_method.values() for term in s.terms}))]
    rows = tuple(
        (
            term,
            *(v.get(term) for v in values.values()),
            f"{sum(term in v for v in values.values())} of {len(values)}",
        )
        for term in terms
    )
    each = list(by_method.values())
    measures = [
        ("terms", *(len(s.terms) for s in each)),
        ("R²", *(format_decimals(s.r2) for s in each)),
        ("R², cross-validated", *(format_decimals(s.held_out_r2) for s in each)),
        ("rms error, cross-validated", *(format_number(s.held_out_rms, 3) for s in each)),
        ("largest VIF", *(format_number(float(s.vif.max()), 2) if len(s.vif) else "-" for s in each)),
        ("warnings", *(len(s.doubts) for s in each)),
    ]
    if judged:
        scores = [judged[method].score(response) for method in by_method]
        measures.append(("R², validation", *(format_decimals(s.r2) for s in scores)))
        measures.append(("RRMSE, validation", *(format_decimals(s.rrmse) for s in scores)))
    tables = (
        Table((text_column("term"), *numbers, Column("selected by")), rows, "Terms and values"),
        Table((text_column("measure"), *numbers), tuple(measures), "Fit and prediction"),
    )
    return Section(response, tables=tables)
