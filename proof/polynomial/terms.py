"""Variables of the coefficients: names, and the compiled sum of terms over them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from proof.keys import COEFFICIENTS
from proof.scenario.declared import MAX_FACTORS, MAX_FOLLOWING
from structsel.numerics.compiling import njit

AXES = COEFFICIENTS
SIGNALS = tuple(f"signal{j}" for j in range(1, MAX_FOLLOWING + 1))
"""Lags and delays of variables, as an injected effect defines them."""
VARIABLES = (
    "1", "alpha", "beta", "p_hat", "q_hat", "r_hat", "de", "da", "dr", "df", "CT", "dV",
    "abs_alpha", "abs_beta", "abs_de", "abs_da", "abs_dr",
    # Of Mach: 1/sqrt(1-M^2) less that at the reference; drag rise. Of Reynolds: ln(Re/Re0).
    "glauert", "rise", "lnRe",
    # Near the ground; schedules of time: configuration, ice, a clock of any kind.
    "ground", "cfg", "ice", "clock",
    # Relative dynamic pressure; what lags behind alpha and beta; separated fraction of the wing, lift lost.
    "dqbar", "downwash", "sidewash", "wagner", "stall", "lost",
    # Rates times rotor speed over dynamic pressure; lift of the base model; heading as a sawtooth; slosh angle.
    "gyro_q", "gyro_r", "CL", "heading", "slosh", "angle_of_bank", *SIGNALS,
)  # fmt: skip
"""Names, in the order of a row of variables."""
INDEX = {name: i for i, name in enumerate(VARIABLES)}
Terms = tuple[NDArray[np.int64], NDArray[np.float64]]
"""(k, 1 + MAX_FACTORS) axis and variables of each term (1 fills up), and (k,) values."""


def compile_terms(terms: Iterable[tuple[str, str, float]]) -> Terms:
    """Terms (axis, "alpha^2*de", value) as arrays.

    Raises
    ------
    KeyError
        An axis or a variable with another name.
    """
    rows, values = [], []
    for axis, text, value in terms:
        factors: list[int] = []
        for part in text.split("*"):
            name, _, power = part.partition("^")
            factors += [INDEX[name]] * int(power or 1)
        rows.append([AXES.index(axis), *factors, *[0] * (MAX_FACTORS - len(factors))])
        values.append(value)
    return np.array(rows, dtype=np.int64).reshape(-1, 1 + MAX_FACTORS), np.array(values, dtype=float)


@njit(cache=True)
def add_terms(rows, values, x, out):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Add the terms at one row of variables to six coefficients."""
    for k in range(values.size):
        product = values[k]
        for j in range(1, rows.shape[1]):
            if rows[k, j] != 0:
                product *= x[rows[k, j]]
        out[rows[k, 0]] += product


@njit(cache=True)
def evaluate(rows, values, table):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """(n, 6) coefficients at (n, v) rows of variables."""
    out = np.zeros((table.shape[0], 6))
    for i in range(table.shape[0]):
        add_terms(rows, values, table[i], out[i])
    return out
