"""Functions of the states that may explain differences, and so are no noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from structsel.comparison.flight import Flight
from structsel.nomenclature import COEFFICIENTS, CONFIGURATION
from structsel.numerics.arrays import Array

_PICKS = 8
_RATE = "_dot_hat"
_FREE = 1e-3  # precision (inverse standard deviation) of values that are not held to their tolerances
_WORTH = 0.03  # of what is left, that a further column must take
_GENERIC = (
    "alpha", "beta", "p_hat", "q_hat", "r_hat", "de", "da", "dr", "CT", "V", "alpha_dot_hat", "beta_dot_hat",
    *CONFIGURATION, "h_agl", "phi", "theta",
)  # fmt: skip
_SQUARES = (
    ("alpha", "alpha"), ("beta", "beta"), ("alpha", "beta"), ("alpha", "de"), ("de", "de"), ("alpha", "q_hat"),
    ("alpha", "p_hat"), ("alpha", "r_hat"), ("CT", "de"), ("CT", "alpha"), ("alpha", "V"), ("p_hat", "r_hat"),
)  # fmt: skip
_LAGS = (0.1, 0.4)  # s
_LAGGED = ("alpha", "beta", "de", "da", "dr", "q_hat")
_ITSELF = {
    "CY": ("beta", "beta_dot_hat"), "CZ": ("alpha", "alpha_dot_hat"), "Cl": ("p_hat", "beta", "beta_dot_hat"),
    "Cm": ("q_hat", "alpha", "alpha_dot_hat"), "Cn": ("r_hat", "beta", "beta_dot_hat"),
}  # fmt: skip
"""States whose rates and recent past measure a response: the gyros predict the angles."""


def state_functions(f: Flight) -> dict[str, Array]:
    """Usual functions of the states of one flight and their recent past, by name; any channels without such states."""
    here = {c: f[c] - f[c].mean() for c in _GENERIC if c in f or c in f.channels}
    made = dict(here)
    made |= {f"{a}*{b}": here[a] * here[b] for a, b in _SQUARES if a in here and b in here}
    for c in (c for c in _LAGGED if c in here):
        for lag in _LAGS:
            k = round(lag / f.dt)
            past = np.concatenate([np.full(k, here[c][0]), here[c][:-k]]) if 0 < k < len(f) else here[c]
            made[_past(c, lag)] = past
    if not made:
        made = {c: f.channels[c] - f.channels[c].mean() for c in sorted(f.channels) if c not in f.responses}
    return made or {"t": f.t}


def usual_functions(names: Sequence[str], response: str) -> list[str]:
    """Those of the functions that are regressors of a response.

    A kinematic response consists of the rate of angle of attack: this and its recent past would explain its own noise.
    """
    itself = _ITSELF.get(response, ())
    if response in COEFFICIENTS:
        own = {c for c in itself if c.endswith(_RATE)} | {_past(c, lag) for c in itself for lag in _LAGS}
    else:
        own = {c for c in _GENERIC if c.endswith(_RATE)} | {_past(c, lag) for c in _LAGGED for lag in _LAGS}
    return [name for name in names if name not in own]


def _past(channel: str, lag: float) -> str:
    return f"{channel} {lag:g} s before"


def helpful_columns(
    explained: tuple[Array, Array], y: Array, further: Array, squares: Array, weight: Array
) -> list[int]:
    """Columns that lower the residual most, one after another, until none is significant.

    Parameters
    ----------
    explained : (k, k) array, (k, n) array
        Lower triangular L, of which ``L L' = R'R + P``, and ``L^-1 R'``: R are weighted columns that explain already,
        in units of the noise, P is a precision. Many of the columns are collinear.
    y : (n,) array
        Weighted coefficients.
    further : (n, p) array
    squares : (n, p) array
        Of `further`.
    weight : (n,) array
    """
    lower, turned = explained
    # A weak prior: of collinear columns the directions that no sample determines would otherwise be rounding errors,
    # and what they take away would be random. Turned by the given factor, the columns are nearly orthonormal, so their
    # products keep the digits.
    prior = _FREE * scipy.linalg.solve_triangular(lower, np.eye(len(lower)), lower=True)
    factor = scipy.linalg.cholesky(turned @ turned.T + prior @ prior.T, lower=True)
    inverse = scipy.linalg.solve_triangular(factor, np.eye(len(factor)), lower=True)
    inside, inside_y = inverse @ ((turned * weight) @ further), inverse @ (turned @ y)
    before = weight**2 @ squares
    # Products of the residuals of the columns after regression on the rows: with themselves, and with that of y.
    power = before - (inside**2).sum(axis=0)
    with_y = (weight * y) @ further - inside_y @ inside
    total = float(y @ y - inside_y @ inside_y)
    freedom = max(1.0, len(y) - len(lower) + float(((inverse @ prior) ** 2).sum()))
    kept: list[int] = []
    taken: list[Array] = []
    for _ in range(_PICKS):
        free = power > 1e-3 * before
        gain = np.where(free, with_y**2 / np.where(free, power, 1.0), 0.0)
        j = int(np.argmax(gain))
        if gain[j] < max(5.0 * np.log(further.shape[1] + 1.0) * total / freedom, _WORTH * total):
            break
        kept.append(j)
        # Gram-Schmidt: products of the normed new direction with every column.
        along = (weight**2 * further[:, j]) @ further - inside[:, j] @ inside - sum(t * t[j] for t in taken)
        along = along / np.sqrt(power[j])
        step = float(with_y[j] / np.sqrt(power[j]))
        with_y, power, total = with_y - step * along, power - along**2, total - step**2
        taken.append(along)
    return kept
