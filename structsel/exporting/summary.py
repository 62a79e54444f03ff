"""A model as text in the manner of statsmodels, drawn by statsmodels' own tables."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import scipy

from structsel.aircraft import Aircraft
from structsel.exporting.header import one_line, reference_lines
from structsel.model import AeroModel, ResponseModel


def write_summary(model: AeroModel, aircraft: Aircraft | None, path: Path) -> dict[Path, str]:
    """Per response what was fitted how, and a table of values, standard errors, t, p and 95 % intervals."""
    blocks = [_summarise(name, held) for name, held in model.responses.items()]
    verdict = [f"Refinement: {one_line(model.refinement)}"] if model.refinement else []
    facts = [one_line(model.heading), *reference_lines(model, aircraft)]
    return {path: "\n\n".join([*verdict, *blocks, "\n".join(facts)]) + "\n"}


def _summarise(name: str, held: ResponseModel) -> str:
    from statsmodels.iolib.summary import Summary, summary_params

    freedom = held.n - len(held.terms)
    t = held.t_values
    law = scipy.stats.t(freedom) if freedom > 0 else scipy.stats.norm
    fitted = SimpleNamespace(params=held.values, model=SimpleNamespace(endog_names=name))  # what the tables ask for
    figures = (fitted, held.values, held.standard_errors, t, 2.0 * law.sf(np.abs(t)), held.intervals())
    text = Summary()
    text.add_table_2cols(
        fitted,
        title=f"Model of {one_line(name)}",
        gleft=[
            ("Response:", [one_line(name)]),
            ("Method:", [one_line(held.method) or "-"]),
            ("Residuals:", [one_line(held.residuals) or "-"]),
            ("Biased:", ["yes" if held.biased else "no"]),
        ],
        gright=[
            ("R-squared:", [_figure(held.r2, "8.3f")]),
            ("Residual std:", [_figure(math.sqrt(held.s2), "8.4g")]),
            ("No. Observations:", [str(held.n or "-")]),
            ("Df Residuals:", [str(freedom) if freedom > 0 else "-"]),
        ],
        yname=name,
    )
    words = list(held.labels)
    text.tables.append(summary_params(figures, yname=name, xname=words, use_t=freedom > 0))
    if held.biased:
        text.add_extra_txt(["Biased estimates: the standard errors leave the bias out, and there are no intervals."])
    return text.as_text()


def _figure(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else "-"
