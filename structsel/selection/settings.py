"""How `select` searches and estimates: one field for each of its keyword arguments, checked before data are read.

The command line and the documentation take names, types, defaults, choices and help texts from these fields.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from structsel.deprecation import renamed_arguments, renamed_value
from structsel.errors import SelectionError
from structsel.options import option
from structsel.selection.methods import METHODS

Noise = Literal["ar", "cluster", "white"]
Criterion = Literal["PSE", "BIC", "EBIC", "AICc", "adj_R2", "cv"]
Estimate = Literal["least_squares", "principal_components", "ridge"]
Components = Literal["variance", "PSE", "cv"] | int
Constants = Literal["auto", "shared", "own"]
HierarchyRule = Literal["none", "weak", "strong"]
Rows = Literal["auto", "sampled", "causal"]
Parsimony = Literal["one_se", "none"]
StoppingRule = Literal["F", "R2", "PSE"]
InitialTerms = Literal["empty", "linear", "all"]

_SEARCH, _JUDGE, _FINE = "The search", "Uncertainty of the result", "Fine tuning"

RENAMED_ARGUMENTS = {
    "force": "include",
    "residuals": "noise",
    "start": "initial_terms",
    "stop": "stopping_rule",
    "r2_change": "min_r2_gain",
    "max_order": "max_ar_order",
}
"""Old names of keyword arguments, which work for one release."""

RENAMED_VALUES = {
    "noise": {"coloured": "ar", "robust": "cluster"},
    "criterion": {"manoeuvre": "cv"},
    "components": {"manoeuvre": "cv"},
}
"""Old values of options, which work for one release."""


@renamed_arguments(**{old: new for old, new in RENAMED_ARGUMENTS.items() if new != "include"})
@dataclass(frozen=True)
class SelectOptions:
    """How `select` searches, estimates and judges.

    Attributes
    ----------
    method : {"stepwise", "orthogonal", "best_subset"}
        Modified stepwise regression by partial F [C89], [TP1916]; orthogonal functions minimising PSE [H17],
        [M95]; or the best model of every size, by branch and bound [FW74], for small pools.
    noise : {"ar", "cluster", "white"}
        Model of the residuals in tests and standard errors. ``"ar"``: autoregressive noise of each recording, or one
        of all with the level of each, and its order, by BIC; prewhitened and estimated again until the terms stay the
        same. Where that predicts recordings left out clearly worse (the residual is then model error rather than
        noise), ``"cluster"`` is used instead, with a warning. ``"cluster"``: any correlation; ordinary least squares
        with partial F from the scatter between blocks. ``"white"``: independent residuals, as in the sources. A
        different choice of terms by the last is always reported.
    F_in, F_out : float, "auto" or "fdr"
        Partial F to enter and to stay (F_in where F_out is absent). 4 and 12 are classical values [C89]; ``"auto"``
        keeps the probability of any false term at most near 5 % for this number of candidates, and lets it vanish with
        the length of the record as extended BIC does; ``"fdr"`` keeps the fraction of false terms near 5 % [BG09].
    constants : {"auto", "shared", "own"}
        One constant for all recordings, or one of each: trim, centre of gravity and thrust calibration differ in what
        no candidate knows. ``"auto"`` takes own constants where levels differ significantly, unless the slopes then
        predict recordings left out worse, each about its mean. A new recording is predicted with their mean.
    rows : {"auto", "sampled", "causal"}
        Regress on the candidates as sampled, or on what their past predicts of them (instrumental variables [W10]): in
        turbulence, with feedback, or with noise in the candidates, these follow the residual, and least squares is
        biased. ``"auto"`` takes causal rows where a test (Durbin, Wu and Hausman, at 1 %) shows that; it needs
        ``noise="ar"`` and ten samples for each instrument.
    parsimony : {"one_se", "none"}
        Of the model selected from all candidates, those from candidates up to a lower degree, and the linear model with
        all its terms, take the one of fewest terms whose error of prediction in recordings left out is within one
        standard error of the least [B84]; or the first. A criterion that is given decides alone.
    hierarchy : {"none", "weak", "strong"}
        Parents that a product needs in the model: none, at least one, or all [N77]. The parents of a term are the
        candidates that divide it, with no candidate between: alpha and de of alpha*de, alpha of alpha^2, alpha*de and
        alpha^2 of alpha^2*de. A formula, a spline or an offset is one signal: abs(beta) has no parent, those of
        abs(beta)*beta are abs(beta) and beta. Included terms need no parent. By default any model may be chosen: by
        symmetry beta^2 belongs in CX, CZ and Cm, and beta does not.
    initial_terms : {"empty", "linear", "all"}
        Start of a stepwise search: no term, the linear terms [TP1916], or all terms [C89].
    stopping_rule : {"F", "R2", "PSE"}
        What besides F_in ends a stepwise search: a gain in R2 under ``min_r2_gain``, or PSE no longer falling.
    criterion : {"PSE", "BIC", "EBIC", "AICc", "adj_R2", "cv"}, optional
        Choose, among the models the search visited, the one with the least PSE, BIC, extended BIC [CC08] or AICc, the
        largest adjusted R2, or the least error of prediction in manoeuvres left out (cross-validation). By default
        F-tests decide for stepwise, and extended BIC for orthogonal and best subset; PSE is the classical choice.
    sigma_max : {"response", "residual"} or float
        PSE's bound on the prediction error: the response's standard deviation [H17], five times the residual's,
        or a number in the response's units [M95]. Applied to the prewhitened response with ``noise="ar"``.
    order : {"greedy", "given"}
        Orthogonalise the most useful candidate next [M95], or in the order given and then rank [H17].
    estimate : {"least_squares", "principal_components", "ridge"}
        How the selected terms are estimated; the latter two are biased, labelled so, and meant for collinear
        terms.
    components : {"variance", "PSE", "cv"} or int
        Principal components used: enough for 99 % of the candidates' variance, those of least PSE, those that
        predict manoeuvres left out best, or a number. The constant of a ridge estimate is chosen by generalised
        cross-validation, or by manoeuvres left out where ``"cv"``.
    correlation_limit : float, optional
        Drop the weaker of two selected terms whose parameters correlate above this [H17].
    max_terms : int, optional
    bootstrap : int
        Selections repeated on reweighted manoeuvres (from eight on) or blocks; 0 for none.
    max_ar_order : int
        Highest order of the autoregressive noise model.
    seed, workers : int
        Of the bootstrap; threads, by default as many as the amount of work justifies.
    """

    method: str = option("stepwise", help="How the terms are searched.", group=_SEARCH, metavar="METHOD")
    noise: Noise = option(
        "ar", help="Model of the residuals: ar (autoregressive), cluster (any correlation) or white.", group=_SEARCH
    )
    rows: Rows = option(
        "auto",
        help="Regress on the samples, or on what the past predicts of them (turbulence, feedback, noise).",
        group=_SEARCH,
    )
    constants: Constants = option(
        "auto", help="Constant shared by all recordings, own of each, or auto: what predicts better.", group=_SEARCH
    )
    F_in: float | Literal["auto", "fdr"] = option(
        "auto",
        help="Partial F to enter: auto (from the number of candidates), fdr, or a number (4 and 12 are classical).",
        group=_SEARCH,
        metavar="F",
    )
    F_out: float | None = option(None, help="Partial F to stay; that to enter if absent.", group=_SEARCH, metavar="F")
    criterion: Criterion | None = option(
        None,
        help="Choose among the models visited by PSE, BIC, EBIC, AICc, adj_R2 or cv (error in manoeuvres left out).",
        group=_SEARCH,
        metavar="RULE",
    )
    parsimony: Parsimony = option(
        "one_se", help="Prefer candidates of lower degree that predict as well (one_se), or none.", group=_SEARCH
    )
    hierarchy: HierarchyRule = option(
        "none", help="Parents that a product needs in the model: none, one (weak) or all (strong).", group=_SEARCH
    )
    max_terms: int | None = option(None, help="Largest number of terms.", group=_SEARCH, metavar="N")
    initial_terms: InitialTerms = option("empty", help="Terms that a stepwise search starts from.", group=_SEARCH)
    stopping_rule: StoppingRule = option(
        "F", help="What ends a stepwise search, besides the partial F to enter.", group=_SEARCH
    )
    correlation_limit: float | None = option(
        None, help="Drop the weaker of two terms whose parameters correlate above this.", group=_SEARCH, metavar="R"
    )
    estimate: Estimate = option(
        "least_squares", help="least_squares; or, biased, principal_components or ridge.", group=_SEARCH
    )
    components: Components = option(
        "variance", help="Principal components: variance, PSE, cv or a number.", group=_SEARCH, metavar="RULE"
    )
    bootstrap: int = option(
        200,
        help="Selections repeated on resampled manoeuvres or blocks; 0: none.",
        group=_JUDGE,
        metavar="N",
    )
    seed: int = option(0, help="Seed of the bootstrap.", group=_JUDGE)
    sigma_max: Literal["response", "residual"] | float = option(
        "response",
        help="Bound on the prediction error in PSE: response, residual, or a number.",
        group=_FINE,
        metavar="RULE",
    )
    order: Literal["greedy", "given"] = option(
        "greedy", help="Order in which candidates are orthogonalised.", group=_FINE
    )
    min_r2_gain: float = option(0.005, help="Smallest gain in R2, with the stopping rule R2.", group=_FINE)
    max_ar_order: int = option(24, help="Highest order of the autoregressive noise model.", group=_FINE, metavar="N")
    workers: int | None = option(
        None, help="Number of threads; chosen from the amount of work if absent.", group=_FINE, metavar="N"
    )

    def __post_init__(self) -> None:
        """Check every value."""
        for name, new_values in RENAMED_VALUES.items():
            object.__setattr__(self, name, renamed_value(name, getattr(self, name), new_values))
        if self.method not in METHODS:
            raise SelectionError(f"select: method={self.method!r} is not one of {_listed(list(METHODS))}.")
        for name, hint in _field_types().items():
            _check_choice(name, getattr(self, name), hint)
        for name, least in (("bootstrap", 0), ("max_ar_order", 0), ("max_terms", 1), ("components", 1)):
            value = getattr(self, name)
            if isinstance(value, int) and value < least:
                raise SelectionError(f"select: {name} must be {least} or more, not {value}.")
        for name in ("F_in", "sigma_max"):
            value = getattr(self, name)
            if not isinstance(value, str) and not value > 0:
                raise SelectionError(f"select: {name} must be above zero, not {value}.")
        if self.sigma_max != "response" and "PSE" not in (self.criterion_used, self.stopping_rule):
            raise SelectionError(
                f"select: sigma_max={self.sigma_max!r} is the bound of PSE, which decides nothing here.\n"
                "Give criterion='PSE' as well, or leave sigma_max out."
            )
        if self.F_out is not None and self.F_out < 0:
            raise SelectionError(f"select: F_out must not be negative, got {self.F_out:g}.")
        if self.F_out is not None and not isinstance(self.F_in, str) and self.F_out > self.F_in:
            raise SelectionError(
                f"select: F_out={self.F_out:g} is above F_in={self.F_in:g}: a term whose partial F lies between the "
                "two would enter and leave for ever. Lower F_out or raise F_in."
            )
        if self.rows == "causal" and self.noise != "ar":
            raise SelectionError(
                f"select: rows='causal' needs the noise model of each recording; noise={self.noise!r} has none.\n"
                "Use noise='ar', or rows='sampled'."
            )
        if self.correlation_limit is not None and not 0 < self.correlation_limit < 1:
            raise SelectionError(
                f"select: correlation_limit={self.correlation_limit} must lie between 0 and 1 (0.9 is usual)."
            )

    @property
    def criterion_used(self) -> str | None:
        """The given criterion, or that of the method; None where F-tests decide."""
        return self.criterion if self.criterion is not None else METHODS[self.method].default_criterion

    @property
    def moves_singly(self) -> bool:
        """Whether a candidate stays out only because it explains too little beside the terms or in the place of one."""
        by_gain = self.method == "stepwise" and self.stopping_rule == "F" and self.F_in == "auto"
        by_gain |= self.method == "orthogonal" and self.order == "greedy"
        limits = (self.criterion, self.F_out, self.max_terms, self.correlation_limit)
        return by_gain and self.hierarchy == "none" and all(limit is None for limit in limits)

    @property
    def rows_may_be_causal(self) -> bool:
        """Whether rows may be causal, by option or because turbulence shows."""
        return self.rows != "sampled" and self.noise == "ar"


@cache
def _field_types() -> Mapping[str, Any]:
    """Type of each option, which is written as text."""
    return get_type_hints(SelectOptions)


def _check_choice(name: str, value: Any, hint: Any) -> None:
    """Refuse a value that is not among those of a Literal type, nor a number where the type allows one."""
    parts = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    named = [choice for part in parts if get_origin(part) is Literal for choice in get_args(part)]
    number = any(part in (int, float) for part in parts)
    allowed = value in named or (value is None and type(None) in parts) or (number and not isinstance(value, str))
    if named and not allowed:
        if number:
            raise SelectionError(f"select: {name}={value!r}; give {_listed(named)} or a number.")
        raise SelectionError(f"select: {name}={value!r} is not one of {_listed(named)}.")


def _listed(names: Sequence[str]) -> str:
    return ", ".join(map(repr, names))
