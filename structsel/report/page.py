"""The page of a diagnosis: the finding first, then the figures, then what stays open."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from structsel.diagnosis.result import Bars, Diagnosis, Finding
from structsel.diagnosis.story import (
    HARD_PULL,
    about,
    chance,
    displayed,
    estimate_text,
    headline,
    no_model,
    range_text,
    together,
    untested,
)
from structsel.diagnosis.views import STAGES
from structsel.report.charts import chart_data

_HERE = Path(__file__).parent
_STAGES = dict(zip(STAGES, ("as delivered", "refitted", "with the physics")))


def write_report(diagnosis: Diagnosis, path: str | Path) -> Path:
    """Write a diagnosis as one HTML file that holds all it needs.

    Parameters
    ----------
    diagnosis : Diagnosis
    path : str or Path

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
    path.write_text(render(diagnosis), encoding="utf-8")
    return path


def render(diagnosis: Diagnosis) -> str:
    """HTML of a diagnosis; whatever comes from its data is escaped."""
    # Templates take a while to load, and few commands make a page.
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    pages = Environment(
        loader=FileSystemLoader(_HERE), autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined
    )
    data = chart_data(diagnosis)
    return pages.get_template("page.html").render(
        diagnosis=diagnosis,
        headline=headline(diagnosis),
        about=about(diagnosis),
        findings=[_finding(k, f) for k, f in enumerate(diagnosis.findings)],
        shares=[_share(k, f) for k, f in enumerate(diagnosis.findings)],
        data=data,
        drawn=bool(data["recordings"]),
        remaining=[(c, _figure(r), white) for c, (r, white) in diagnosis.remaining.items()],
        pulls=[_pull(p.name, p.sigmas, p.value, p.std, p.unit) for p in diagnosis.pulls],
        untested=untested(diagnosis),
        detects=_detects(diagnosis),
        no_model=no_model(diagnosis),
        style=Markup((_HERE / "page.css").read_text(encoding="utf-8")),
        script=Markup((_HERE / "charts.js").read_text(encoding="utf-8")),
    )


def _finding(place: int, finding: Finding) -> dict[str, Any]:
    first = finding.physics[0]
    return {
        "place": place,
        "number": place + 1,
        "effect": finding.effect,
        "kind": finding.kind,
        "axes": ", ".join(finding.axes),
        "chance": chance(first.probability),
        "percent": _percent(first.probability),
        "share": _percent(finding.share),
        "says": first.says,
        "plausible": first.plausible,
        "check": first.check,
        "terms": ", ".join(first.terms),
        "regions": [range_text(c, limits) for c, limits in finding.region.items()],
        "stretches": [
            (name, ", ".join(f"{a:.1f} to {b:.1f}" for a, b in each))
            for name, each in finding.intervals.items()
            if each
        ],
        "parameters": [(name, estimate_text(e, "±")) for name, e in first.parameters.items()],
        "rivals": [(p.effect, chance(p.probability), _percent(p.probability), p.says) for p in finding.physics],
        "ties": list(finding.ambiguous_with),
        "together": chance(together(finding)),
        "to_separate": finding.to_separate,
        "bars": _bars(finding),
        "explained": _percent(finding.explained),
        "explainable": _percent(finding.explainable),
    }


def _bars(finding: Finding) -> list[dict[str, Any]]:
    """Rows of the three bars, responses in which it shows first; lengths in percent of the longest."""
    order = [c for c in finding.axes if c in finding.bars]
    order += [c for c in finding.bars if c not in order]
    longest = max((getattr(b, s).rrmse for b in finding.bars.values() for s in STAGES), default=1.0) or 1.0
    return [{"response": c, "stages": _stages(finding.bars[c], longest)} for c in order]


def _stages(bars: Bars, longest: float) -> list[dict[str, Any]]:
    made = []
    for stage, name in _STAGES.items():
        fit = getattr(bars, stage)
        numbers = {"rrmse": _figure(fit.rrmse), "r2": _figure(fit.r2), "tic": _figure(fit.tic)}
        made.append({"stage": stage, "name": name, "long": round(100.0 * fit.rrmse / longest, 1), **numbers})
    return made


def _share(place: int, finding: Finding) -> dict[str, Any]:
    """How much of the mismatch is explained where a finding shows, and how much could be."""
    told, most = (
        round(100.0 * float(np.clip(x, 0.0, 1.0)), 1) if np.isfinite(x) else None
        for x in (finding.explained, finding.explainable)
    )
    return {"place": place, "name": finding.effect, "axes": ", ".join(finding.axes), "told": told, "most": most,
            "explained": _percent(finding.explained), "explainable": _percent(finding.explainable),
            "share": _percent(finding.share)}  # fmt: skip


def _pull(name: str, sigmas: float, value: float, std: float, unit: str) -> dict[str, Any]:
    factor, shown = displayed(unit)
    return {
        "name": name,
        "sigmas": f"{sigmas:+.1f}",
        "long": round(min(50.0, 12.5 * abs(sigmas)), 1),  # half of the cell is four sigma
        "side": "up" if sigmas >= 0.0 else "down",
        "hard": abs(sigmas) >= HARD_PULL,
        "value": f"{factor * value:+.2g} ± {factor * std:.1g} {shown}".strip(),
    }


def _detects(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Self-test, smallest size first, with the rival hardest to tell apart."""
    made = []
    for effect, found in diagnosis.detects.items():
        rivals = sorted((nats, name) for name, nats in found.items() if name != "size")
        near = f"{rivals[0][1].removeprefix('nats against ')} ({rivals[0][0]:.3g} nats)" if rivals else "-"
        size = found.get("size", float("nan"))
        made.append((size if np.isfinite(size) else np.inf, effect, near))
    return [
        {"effect": effect, "size": f"{100.0 * size:.1f} %" if np.isfinite(size) else "not at any size", "near": near}
        for size, effect, near in sorted(made)
    ]


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if np.isfinite(share) else "-"


def _figure(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else "-"
