"""Functions of the states that may explain differences, and so are no noise."""

from __future__ import annotations

import numpy as np

from structsel.comparison.flight import Flight
from structsel.nomenclature import COEFFICIENTS
from structsel.numerics.arrays import Array

_PICKS = 8
_FREE = 1e-3  # precision (inverse standard deviation) of values that are not held to their tolerances
_WORTH = 0.03  # of what is left, that a further column must take
_GENERIC = (
    "alpha", "beta", "p_hat", "q_hat", "r_hat", "de", "da", "dr", "CT", "V", "alpha_dot_hat", "beta_dot_hat", "df",
    "h_agl", "gear", "phi", "theta",
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


def state_functions(f: Flight, response: str) -> Array:
    """Usual functions of the states of one flight and, for a coefficient, their recent past.

    A kinematic response consists of the rate of angle of attack: this and its recent past would explain its own noise.
    """
    itself = _ITSELF.get(response, ())
    rates = tuple(c for c in _GENERIC if c.endswith("_dot_hat") and (c in itself or response not in COEFFICIENTS))
    usual = tuple(c for c in _GENERIC if c not in rates)
    here = {c: f[c] - f[c].mean() for c in usual if c in f or c in f.channels}
    columns = list(here.values())
    columns += [here[a] * here[b] for a, b in _SQUARES if a in here and b in here]
    for c in (c for c in _LAGGED if response in COEFFICIENTS and c not in itself):
        for lag in _LAGS:
            k = round(lag / f.dt)
            if c in here:
                columns.append(np.concatenate([np.full(k, here[c][0]), here[c][:-k]]) if 0 < k < len(f) else here[c])
    if not columns:
        columns = [f.channels[c] - f.channels[c].mean() for c in sorted(f.channels) if c not in f.responses]
    return np.column_stack(columns) if columns else f.t[:, None]


def helpful_columns(rows: Array, y: Array, further: Array, weight: Array) -> list[int]:
    """Columns that lower the residual most, one after another, until none is significant.

    Parameters
    ----------
    rows : (n, k) array
        Weighted columns that explain already, in units of the noise. Many are collinear.
    y : (n,) array
        Weighted coefficients.
    further : (n, p) array
    weight : (n,) array
    """
    # Below the rows stands a weak prior: of collinear columns the directions that no sample determines would
    # otherwise be rounding errors, and what they take away would be random.
    Q = np.linalg.qr(np.vstack([rows, _FREE * np.eye(rows.shape[1])]))[0][: len(y)]
    F = further * weight[:, None]
    inside = Q.T @ F
    before = (F**2).sum(axis=0)
    # Products of the residuals of the columns after regression on the rows: with themselves, and with that of y.
    power = before - (inside**2).sum(axis=0)
    with_y = F.T @ y - inside.T @ (Q.T @ y)
    total = float(y @ y - ((Q.T @ y) ** 2).sum())
    freedom = max(1.0, len(y) - float((Q**2).sum()))
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
        along = F.T @ F[:, j] - inside.T @ inside[:, j] - sum(t * t[j] for t in taken)
        along = along / np.sqrt(power[j])
        step = float(with_y[j] / np.sqrt(power[j]))
        with_y, power, total = with_y - step * along, power - along**2, total - step**2
        taken.append(along)
    return kept
