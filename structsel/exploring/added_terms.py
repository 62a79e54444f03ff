"""What adding a term to a model would do, for every candidate at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from structsel.candidates import Candidates, Term
from structsel.errors import SelectionError
from structsel.model import AeroModel
from structsel.numerics.arrays import Array
from structsel.numerics.binning import split_into_segments
from structsel.numerics.criteria import pse
from structsel.numerics.cross_products import project
from structsel.recording import Recording
from structsel.results import Result
from structsel.tables import Summary, table_of_frame

_NOTHING_NEW = 1e-9  # share of a candidate's variance that the model's terms leave of it
_PARTS = 8  # held out in turn where there is one recording
_SHOWN = 10


@dataclass(frozen=True, eq=False, repr=False)
class Additions(Result):
    """A model's fit as it is, and with each candidate added; its terms are refitted by least squares each time.

    Attributes
    ----------
    response : str
    terms : tuple of Term
        The candidates, best held-out R2 first; those the model's own terms explain are not among them.
    values : (m,) array
        What each would get.
    r2, pse, held_out_r2 : (m,) array [-]
        PSE as a share of the response's variance. Held out are whole recordings in turn; of one alone, eight
        segments of it.
    before : tuple of float
        r2, pse and held_out_r2 of the model as it is.
    n : int
        Samples.
    """

    response: str
    terms: tuple[Term, ...]
    values: Array
    r2: Array
    pse: Array
    held_out_r2: Array
    before: tuple[float, float, float]
    n: int

    def __getitem__(self, term: Term | str) -> tuple[float, float, float]:
        """R2, PSE and held-out R2 with one term added.

        Raises
        ------
        SelectionError
            It is not among the candidates that tell anything new.
        """
        wanted = term if isinstance(term, Term) else Term(term)
        if wanted not in self.terms:
            have = ", ".join(map(str, self.terms[:_SHOWN]))
            raise SelectionError(f"'{wanted}' was not tried, or the model's terms explain it. There are {have}, ...")
        i = self.terms.index(wanted)
        return float(self.r2[i]), float(self.pse[i]), float(self.held_out_r2[i])

    def to_frame(self) -> pd.DataFrame:
        """One row per candidate, the model as it is before them: term, value, r2, pse, held_out_r2."""
        r2, share, ahead = self.before
        return pd.DataFrame(
            {
                "term": ["(as it is)", *map(str, self.terms)],
                "value": [np.nan, *self.values],
                "r2": [r2, *self.r2],
                "pse": [share, *self.pse],
                "held_out_r2": [ahead, *self.held_out_r2],
            }
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain types, for JSON."""
        rows = self.to_frame().to_dict("records")
        rows[0]["value"] = None
        return {"schema": "structsel.additions/1", "response": self.response, "n": self.n, "rows": rows}

    def summary(self) -> Summary:
        """Effect of each candidate on fit and prediction."""
        table = table_of_frame(self.to_frame().head(_SHOWN + 1), digits=5)
        return Summary(self.response, f"one more term, of {len(self.terms)}; n {self.n}", tables=(table,))


def try_additions(
    model: AeroModel, recordings: Recording | Sequence[Recording], response: str, candidates: Candidates
) -> Additions:
    """Say for each candidate what adding it to a model would do to its fit and its prediction.

    The candidates' products with the model's terms and the response are summed once for each recording; all else
    is algebra on them: the terms swept out of the candidates [KM16, ch. 5], a recording left out by subtraction.

    Parameters
    ----------
    model : AeroModel
    recordings : Recording or sequence of Recording
        With the channels of the model and the candidates, and the response.
    response : str
    candidates : Candidates
        Terms the model has already, and those its terms explain, are passed over.

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
        No candidate tells anything new.
    """
    flown = [recordings] if isinstance(recordings, Recording) else list(recordings)
    kept = [term for term in model[response].terms if not term.is_constant]
    tried = [term for term in candidates if term not in kept and not term.is_constant]
    if not tried:
        raise SelectionError(f"every candidate is in the model of {response} already. Offer others.")
    pool = Candidates([*kept, *tried])
    X = np.concatenate([pool.evaluate(recording) for recording in flown])
    X = X[:, [pool.names.index(str(term)) for term in (*kept, *tried)]]
    y = np.concatenate([recording[response] for recording in flown])
    scale = X.std(axis=0)
    scale[scale == 0.0] = 1.0
    Z = np.column_stack([np.ones(len(y)), (X - X.mean(axis=0)) / scale, y - y.mean()])
    part = split_into_segments([len(r) for r in flown], 1 if len(flown) > 1 else _PARTS)
    products = np.stack([Z[part == k].T @ Z[part == k] for k in range(int(part.max()) + 1)])
    total = products.sum(axis=0)
    base, n = 1 + len(kept), len(y)
    swept = _sweep(total, base)
    left = swept[base:-1, base:-1].diagonal()
    new = np.flatnonzero(left > _NOTHING_NEW * n)
    if not new.size:
        raise SelectionError(f"the terms of {response} explain every candidate in these recordings. Offer others.")
    columns = np.r_[:base, base + new, Z.shape[1] - 1]
    total, products = total[np.ix_(columns, columns)], products[:, columns][:, :, columns]
    swept = swept[base:, base:][np.ix_(np.r_[new, -1], np.r_[new, -1])]
    gains = swept[:-1, -1] ** 2 / swept[:-1, :-1].diagonal()
    tss, rss = total[-1, -1], swept[-1, -1]
    ahead, without = _held_out(total, products, base)
    order = np.argsort(-ahead, kind="stable")
    k, variance = len(kept), tss / n
    return Additions(
        response,
        tuple(tried[new[i]] for i in order),
        (swept[:-1, -1] / swept[:-1, :-1].diagonal() / scale[len(kept) + new])[order],
        1.0 - (rss - gains[order]) / tss,
        pse(rss - gains[order], tss, n, k + 1) / variance,
        ahead[order],
        (1.0 - rss / tss, float(pse(rss, tss, n, k) / variance), without),
        n,
    )


def _sweep(product: Array, base: int) -> Array:
    """Products of the columns less what the first `base` ones explain of them."""
    return product - product[:, :base] @ project(product, range(base)).coefficients


def _held_out(total: Array, products: Array, base: int) -> tuple[Array, float]:
    """R2 of parts predicted by the others, about each part's own mean: with each candidate, and without any."""
    error = np.zeros(len(total) - base - 1)
    bare = spread = 0.0
    for own in products:
        others = total - own
        B = project(others, range(base)).coefficients
        swept = others - others[:, :base] @ B
        variances = swept[base:-1, base:-1].diagonal()
        # A candidate that stands still in all the other parts gets no value from them.
        moves = variances > _NOTHING_NEW * others[0, 0]
        values = np.where(moves, swept[base:-1, -1] / np.where(moves, variances, 1.0), 0.0)
        # Columns of the part itself, less what the others' coefficients make of the base.
        cross = own - own[:, :base] @ B
        ahead = cross - B.T @ cross[:base]
        squares = ahead[base:-1, base:-1].diagonal()
        error += ahead[-1, -1] - 2.0 * values * ahead[base:-1, -1] + values**2 * squares
        bare += float(ahead[-1, -1])
        spread += float(own[-1, -1] - own[0, -1] ** 2 / own[0, 0])
    return 1.0 - error / spread, 1.0 - bare / spread
