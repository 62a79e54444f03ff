"""Effect of adding a term to a model, for all candidates at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from structsel.candidates import Candidates, Term
from structsel.errors import SelectionError
from structsel.formatting import count_of
from structsel.model import AeroModel
from structsel.numerics.arrays import Array
from structsel.numerics.binning import split_into_segments
from structsel.numerics.criteria import pse
from structsel.numerics.normal_equations import project
from structsel.recording import Recording
from structsel.recording.arguments import as_recordings
from structsel.results import Result
from structsel.tables import Summary, table_of_frame

if TYPE_CHECKING:
    import pandas as pd

_RANK_TOLERANCE = 1e-9  # fraction of a candidate's variance that the terms of the model must leave unexplained
_SEGMENTS = 8  # for cross-validation with a single recording
_MAX_SHOWN = 10  # candidates in the table and in messages


@dataclass(frozen=True, eq=False, repr=False)
class Additions(Result):
    """Fit of a model, and of the model with each candidate added; the terms are refitted by least squares.

    Attributes
    ----------
    response : str
    terms : tuple of Term
        Candidates, the largest held-out R2 first, without linear combinations of the model's terms.
    values : (m,) array
        Estimate of each candidate in the extended model.
    partial_F : (m,) array [-]
        Reduction of the residual sum of squares over the residual variance with the candidate. It is that of white
        residuals, and too large for autocorrelated ones: choose by the held-out R2.
    r2, pse, held_out_r2 : (m,) array [-]
        PSE as a fraction of the variance of the response. For the held-out R2, complete recordings are left out in
        turn, or eight segments of a single one.
    before : tuple of float
        r2, pse and held_out_r2 of the model without a further term.
    n : int
        Number of samples.
    """

    response: str
    terms: tuple[Term, ...]
    values: Array
    partial_F: Array
    r2: Array
    pse: Array
    held_out_r2: Array
    before: tuple[float, float, float]
    n: int

    def __getitem__(self, term: Term | str) -> tuple[float, float, float]:
        """Return R2, PSE and held-out R2 with one term added.

        Raises
        ------
        SelectionError
            The term is no candidate, or a linear combination of the model's terms.
        """
        wanted = term if isinstance(term, Term) else Term(term)
        if wanted not in self.terms:
            have = ", ".join(map(str, self.terms[:_MAX_SHOWN]))
            raise SelectionError(f"'{wanted}' was not tried, or the model's terms explain it. There are {have}, ...")
        i = self.terms.index(wanted)
        return float(self.r2[i]), float(self.pse[i]), float(self.held_out_r2[i])

    def to_frame(self) -> pd.DataFrame:
        """One row for the model, then one for each candidate: term, value, partial_F, r2, pse, held_out_r2."""
        import pandas as pd

        r2, pse_before, held_out_r2 = self.before
        return pd.DataFrame(
            {
                "term": ["(as it is)", *map(str, self.terms)],
                "value": [np.nan, *self.values],
                "partial_F": [np.nan, *self.partial_F],
                "r2": [r2, *self.r2],
                "pse": [pse_before, *self.pse],
                "held_out_r2": [held_out_r2, *self.held_out_r2],
            }
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain types, for JSON."""
        rows = self.to_frame().to_dict("records")
        rows[0]["value"] = rows[0]["partial_F"] = None
        return {"schema": "structsel.additions/1", "response": self.response, "n": self.n, "rows": rows}

    def summary(self) -> Summary:
        """Effect of each candidate on fit and prediction."""
        table = table_of_frame(self.to_frame().head(_MAX_SHOWN + 1), digits=5)
        return Summary(
            self.response,
            f"effect of one more term, {count_of(len(self.terms), 'candidate')}; n {self.n}",
            tables=(table,),
        )


def try_additions(
    model: AeroModel, recordings: Recording | Sequence[Recording], response: str, candidates: Candidates
) -> Additions:
    """Compute for each candidate how adding it to a model changes fit and prediction.

    The cross-products of candidates, terms and response are summed once for each recording. The effect of a candidate
    follows from partial regression on these sums [KM16, ch. 5]; a recording is left out by subtraction of its sums.

    Parameters
    ----------
    model : AeroModel
    recordings : Recording or sequence of Recording
        Recordings with the channels of the model and of the candidates, and with the response.
    response : str
    candidates : Candidates
        Terms of the model, and linear combinations of them, are left out.

    Returns
    -------
    Additions

    Raises
    ------
    ModelError
        The model has no such response.
    ChannelError, DataError
        A channel is missing, or not finite.
    SelectionError
        Every candidate is in the model, or a linear combination of its terms.
    """
    flights = as_recordings(recordings, "try_additions")
    own = [term for term in model[response].terms if not term.is_constant]
    tried = [term for term in candidates if term not in own and not term.is_constant]
    if not tried:
        raise SelectionError(f"every candidate is in the model of {response} already. Offer others.")
    pool = Candidates([*own, *tried])
    X = np.concatenate([pool.evaluate(recording) for recording in flights])
    X = X[:, [pool.names.index(str(term)) for term in (*own, *tried)]]
    y = np.concatenate([recording[response] for recording in flights])
    scale = X.std(axis=0)
    scale[scale == 0.0] = 1.0
    Z = np.column_stack([np.ones(len(y)), (X - X.mean(axis=0)) / scale, y - y.mean()])
    part = split_into_segments([len(r) for r in flights], 1 if len(flights) > 1 else _SEGMENTS)
    products = np.stack([Z[part == k].T @ Z[part == k] for k in range(int(part.max()) + 1)])
    total = products.sum(axis=0)
    base, n = 1 + len(own), len(y)
    swept = _partial_out(total, base)
    variances = swept[base:-1, base:-1].diagonal()
    new = np.flatnonzero(variances > _RANK_TOLERANCE * n)
    if not new.size:
        raise SelectionError(f"the terms of {response} explain every candidate in these recordings. Offer others.")
    columns = np.r_[:base, base + new, Z.shape[1] - 1]
    total, products = total[np.ix_(columns, columns)], products[:, columns][:, :, columns]
    swept = swept[base:, base:][np.ix_(np.r_[new, -1], np.r_[new, -1])]
    gains = swept[:-1, -1] ** 2 / swept[:-1, :-1].diagonal()
    tss, rss = total[-1, -1], swept[-1, -1]
    held_out_r2, without = _held_out_r2(total, products, base)
    order = np.argsort(-held_out_r2, kind="stable")
    k, variance = len(own), tss / n
    return Additions(
        response,
        tuple(tried[new[i]] for i in order),
        (swept[:-1, -1] / swept[:-1, :-1].diagonal() / scale[len(own) + new])[order],
        _partial_F(gains, rss, n - len(own) - 2)[order],
        1.0 - (rss - gains[order]) / tss,
        pse(rss - gains[order], tss, n, k + 1) / variance,
        held_out_r2[order],
        (1.0 - rss / tss, float(pse(rss, tss, n, k) / variance), without),
        n,
    )


def _partial_F(gains: Array, rss: float, dof: int) -> Array:
    """Partial F of each candidate, from what it takes off the residual sum of squares."""
    with np.errstate(divide="ignore"):
        return gains / (np.maximum(rss - gains, 0.0) / dof)


def _partial_out(product: Array, base: int) -> Array:
    """Cross-products of the residuals of all columns on the first `base` ones."""
    return product - product[:, :base] @ project(product, range(base)).coefficients


def _held_out_r2(total: Array, products: Array, base: int) -> tuple[Array, float]:
    """R2 of recordings that are predicted from the others, about their means: with each candidate, and without one."""
    error = np.zeros(len(total) - base - 1)
    error_without = tss = 0.0
    for own in products:
        others = total - own
        B = project(others, range(base)).coefficients
        swept = others - others[:, :base] @ B
        variances = swept[base:-1, base:-1].diagonal()
        # The other recordings give no estimate of a candidate that is constant in all of them.
        varies = variances > _RANK_TOLERANCE * others[0, 0]
        values = np.where(varies, swept[base:-1, -1] / np.where(varies, variances, 1.0), 0.0)
        # Cross-products of this recording's prediction errors, with the coefficients of the others.
        cross = own - own[:, :base] @ B
        errors = cross - B.T @ cross[:base]
        squares = errors[base:-1, base:-1].diagonal()
        error += errors[-1, -1] - 2.0 * values * errors[base:-1, -1] + values**2 * squares
        error_without += float(errors[-1, -1])
        tss += float(own[-1, -1] - own[0, -1] ** 2 / own[0, 0])
    return 1.0 - error / tss, 1.0 - error_without / tss
