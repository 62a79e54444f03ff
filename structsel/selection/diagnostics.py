"""Warnings about a selection, with their remedies, and aliased terms with the inputs that separate them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from structsel.candidates import Candidates, Term
from structsel.nomenclature import UNKNOWN
from structsel.selection.array_selection import ArraySelection
from structsel.selection.data import DataSummary
from structsel.selection.methods import METHODS, thresholds
from structsel.selection.parsimony import is_larger
from structsel.selection.settings import SelectOptions

FEW_BLOCKS = 12  # tests between blocks have one degree of freedom less than these
SEVERAL = 3  # names spelled out before "and n more"
LARGE_VIF, LARGE_CONDITION = 10.0, 1e6
DOUBTFUL = 0.5  # probability that a term belongs in the model
INVALID = 0.01  # significance of Sargan's test
SHORT = 1000
"""Samples of a single recording, below which intervals are too narrow: of 500 samples 81 to 93 % of the 95 % intervals
contain the truth, of 1,000 88 to 96 %, of 2,000 95 % (seven residual noise models, `benchmarks/short_records.py`)."""
FALLS = 0.1  # of R2, on data not used for selecting

EXCITATION = {
    "V_ratio": "fly the same inputs at other speeds",
    "V": "fly the same inputs at other speeds",
    "qbar": "fly the same inputs at other speeds or heights",
    "mach": "fly the same inputs at another Mach number",
    "CT": "fly the same inputs at other power options",
    "thrust": "fly the same inputs at other power options",
    "throttle": "fly the same inputs at other power options",
    "alpha": "fly the same inputs about other trim angles of attack, or larger pitch inputs",
    "beta": "add rudder inputs or steady sideslips",
    "p_hat": "add aileron inputs (bank to bank)",
    "q_hat": "add sharp elevator inputs (a doublet or 3-2-1-1)",
    "r_hat": "add rudder inputs",
    "alpha_dot_hat": "add motion in which alpha and pitch rate differ: steady pull-ups and turns, or plunging",
    "beta_dot_hat": "add motion in which sideslip and yaw rate differ: steady turns, flat sideslips",
    "de": "move the elevator independently of the motion (an unaugmented doublet or a multisine)",
    "da": "move the ailerons independently of the rudder and the motion",
    "dr": "move the rudder independently of the ailerons and the motion",
    "df": "repeat at other flap options",
}


def listed(names: Sequence[str]) -> str:
    """A few names, and how many more there are."""
    shown = ", ".join(names[:SEVERAL])
    return shown if len(names) <= SEVERAL else f"{shown} and {len(names) - SEVERAL} more"


def find_warnings(
    found: ArraySelection,
    candidates: Candidates,
    options: SelectOptions,
    aliases: Sequence[Alias],
    recordings: Sequence[str],
) -> tuple[str, ...]:
    """Everything about a result that its reader should doubt."""
    names = candidates.names
    return (
        *_about_the_search(found, names, options),
        *_about_white_noise(found, names, options),
        *_about_terms(found, names, aliases),
        *_about_manoeuvres(found, names, recordings),
        *_about_length(found, recordings),
        *_about_prediction(found),
    )


def _about_the_search(found: ArraySelection, names: Sequence[str], options: SelectOptions) -> list[str]:
    search, p = found.search, len(names)
    warnings = []
    if found.n <= p:
        warnings.append(f"{found.n} samples for {p} candidates: many models fit equally well. Record longer.")
    if not found.converged:
        warnings.append("Terms and noise models did not converge in four rounds; those of the last are shown.")
    if found.prewhitening_dropped is not None:
        a, b = (np.sqrt(v) for v in found.prewhitening_dropped)
        warnings.append(
            f"Prewhitening was dropped: its rms error is {a / b:.2f} times that of ordinary least squares, more than "
            "noise would cause. The residual is not only noise; look for delayed channels, noise in the signals, or "
            "missing dynamics."
        )
    if found.instruments is not None and found.instruments[1] < INVALID:
        warnings.append(
            f"The instruments of the causal rows follow the residual (Sargan's F = {found.instruments[0]:.1f}): part "
            f"of the bias may remain, and standard errors are {np.sqrt(found.instruments[0]):.1f} times as large. Look "
            "for missing terms and delayed channels."
        )
    if found.cluster_robust and found.n_blocks < FEW_BLOCKS:
        warnings.append(
            f"Only {found.n_blocks} blocks of samples support the tests, which then find few terms. "
            "Record longer, or give more recordings."
        )
    if found.noise and max(model.order for model in found.noise) >= options.max_ar_order > 0:
        warnings.append(
            f"The noise model asks for more than AR order {options.max_ar_order}. Raise max_ar_order, or look "
            "for an oscillation that was left out."
        )
    by_F = "F_in" in METHODS[options.method].options and options.criterion_used is None
    if by_F and options.stopping_rule == "F" and options.F_in != "fdr" and not found.cluster_robust:
        F_in = thresholds(options, p, search.dof)[0]
        outside = p - len(search.selected)
        expected = outside * scipy.stats.f.sf(F_in, 1, max(search.dof - len(search.selected), 1.0))
        if expected > 0.5:
            warnings.append(
                f"With F_in = {F_in:.3g} and {p} candidates about {expected:.1f} false terms are expected; "
                "F_in='auto' keeps the probability of any below 5 %."
            )
    return warnings


def _about_white_noise(found: ArraySelection, names: Sequence[str], options: SelectOptions) -> list[str]:
    """Where the tests with white noise and those used keep different terms."""
    now, white = set(found.search.selected), set(found.white_noise.selected)
    if options.noise == "white" or now == white:
        return []
    more = [names[i] for i in found.white_noise.selected if i not in now]
    fewer = [names[i] for i in found.search.selected if i not in white]
    parts = []
    if more:
        parts.append(f"would also keep {listed(more)}")
    if fewer:
        parts.append(f"would not keep {listed(fewer)}")
    return [f"With white residuals the search {' and '.join(parts)}."]


def _about_terms(found: ArraySelection, names: Sequence[str], aliases: Sequence[Alias]) -> list[str]:
    kept = [names[i] for i in found.search.selected]
    warnings = [f"Aliased in these data: {alias}." for alias in aliases[:SEVERAL]]
    if len(aliases) > SEVERAL:
        warnings.append(f"{len(aliases) - SEVERAL} more pairs are aliased (see .aliases).")
    if found.dependent:
        warnings.append(
            "Constant, or exactly dependent on the kept terms, so never tested: "
            f"{listed([names[i] for i in found.dependent])}. Vary their channels independently."
        )
    large = [f"{n} ({v:.0f})" for n, v in zip(kept, found.vif) if v > LARGE_VIF]
    if large:
        warnings.append(f"Collinear (VIF above 10): {listed(large)}; their values trade against each other.")
    if found.fit.condition > LARGE_CONDITION:
        digits = max(0, int(15 - np.log10(found.fit.condition)))
        warnings.append(f"Condition number {found.fit.condition:.1g}: about {digits} digits of the values are correct.")
    if found.bootstrap is not None:
        probability = found.bootstrap.probability
        unsure = [f"{names[i]} ({probability[i]:.0%})" for i in found.search.selected if probability[i] < DOUBTFUL]
        if unsure:
            warnings.append(f"More probably not in the model than in it: {listed(unsure)}.")
    return warnings


def _about_manoeuvres(found: ArraySelection, names: Sequence[str], recordings: Sequence[str]) -> list[str]:
    """Terms whose values differ between recordings by more than their errors."""
    if found.heterogeneity is None:
        return []
    warnings = []
    for i, j in enumerate(found.search.selected):
        if worst := found.heterogeneity.disagreeing(i):
            value = found.values[1 + i]
            parts = [f"{recordings[k]} ({value + found.heterogeneity.deviation[i, k]:.4g})" for k in worst]
            warnings.append(
                f"{names[j]} differs between recordings by more than its error: {listed(parts)}, together {value:.4g}. "
                "Its standard error includes the scatter."
            )
    return warnings


def _about_length(found: ArraySelection, recordings: Sequence[str]) -> list[str]:
    if len(recordings) > 1 or found.n >= SHORT:
        return []
    return [
        f"One recording of {found.n} samples: too short to tell the correlation of its residual, so that intervals are "
        "too narrow (of 500 samples about 85 % of the 95 % intervals contain the truth). Record longer, or give more "
        "recordings."
    ]


def _about_prediction(found: ArraySelection) -> list[str]:
    held_out = found.cross_validation
    if held_out is None:
        return ["No cross-validation: there is one block of samples, and R2 is that of the fit."]
    warnings = []
    if held_out.within:
        warnings.append(
            "One manoeuvre only: its parts are held out in turn, and resemble each other; R2 held out is too high."
        )
    linear = found.linear
    if linear is not None and not found.is_linear and is_larger(held_out.sse, linear.sse):
        warnings.append(
            f"The linear model predicts data not used for selecting better: R2 {linear.r2:.4f}, this one "
            f"{held_out.r2:.4f}. Offer fewer candidates, or record more."
        )
    if found.r2 - held_out.r2 > FALLS:
        warnings.append(f"R2 falls from {found.r2:.2f} to {held_out.r2:.2f} on data not used for selecting.")
    return warnings


# ---------------------------------------------------------------- aliased terms


@dataclass(frozen=True)
class Alias:
    """Two terms that these data cannot separate.

    Attributes
    ----------
    kept, other : Term
        The one in the model, and the one that could replace it.
    loss : float [-]
        Rise of the residual sum of squares on the exchange, in units of its variance (4 is twice a likelihood
        ratio of e^2); below zero the other even fits better.
    correlation : float [-]
        Of the two, given the other terms of the model.
    to_separate : str
        The inputs that would separate them.
    """

    kept: Term
    other: Term
    loss: float
    correlation: float
    to_separate: str

    def __str__(self) -> str:
        return (
            f"{self.kept} or {self.other} (correlation {self.correlation:+.3f}, loss {self.loss:.1f} s^2): "
            f"{self.to_separate}"
        )


def describe_channel(name: str, data: DataSummary) -> str:
    """Mean, standard deviation and unit of a channel over recordings, in words."""
    found = data.statistics(name)
    unit = "" if data.unit(name) in ("-", UNKNOWN) else f" {data.unit(name)}"
    return f"{name} = {found.mean:.4g} +- {found.std:.2g}{unit}"


def to_separate(kept: Term, other: Term, data: DataSummary) -> str:
    """The excitation that would separate two terms: the channels in which they differ must move independently."""
    only_kept, only_other = _difference(kept, other), _difference(other, kept)
    differing = sorted({c for side in (only_kept, only_other) for f in side for c in f})
    if not differing:
        differing = sorted({*kept.channels, *other.channels})
    if bool(only_kept) != bool(only_other):
        name = differing[0]
        advice = EXCITATION.get(name, f"vary {name}")
        return f"they differ only by {describe_channel(name, data)}, which hardly varies: {advice}"
    advice = "; ".join(dict.fromkeys(EXCITATION.get(name, f"vary {name} independently") for name in differing))
    return f"{' and '.join(differing)} move together here: {advice}"


def _difference(a: Term, b: Term) -> list[tuple[str, ...]]:
    """Channels of each factor that ``a`` has more of than ``b``."""
    powers = dict(b.factors)
    return [tuple(f.channels) for f, power in a.factors if power > powers.get(f, 0)]
