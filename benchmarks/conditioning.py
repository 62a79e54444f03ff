"""Nearly dependent candidates against a 60-digit fit and a QR search (goal A4).

A ninth signal copies the elevator except for independent motion of relative size d, from 1/10 to one millionth;
elevator and copy both belong to the model. Kept as long as the copy's Schur complement, about d^2, is above
1e-9, the copy is to be refused and listed as an alias below that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from cases import design_matrix, flight_signals, monomials
from numpy.typing import NDArray
from qr_search import qr_stepwise
from timing import say

from structsel.numerics.arrays import Array
from structsel.numerics.cross_products import cross_products
from structsel.numerics.least_squares import fit_terms
from structsel.numerics.regressors import ArrayData
from structsel.numerics.stepwise import partial_f, stepwise
from structsel.selection.search import centred

INDEPENDENT_MOTIONS = (1e-1, 1e-2, 1e-3, 1e-4, 4e-5, 1e-5, 1e-6)
TOL = 1e-9
SAMPLES = 5000
F_IN = 12.0
ELEVATOR, COPY = 5, 8
COPY_T = 60.0  # the copy's t statistic


@dataclass(frozen=True)
class Conditioning:
    """One case.

    Attributes
    ----------
    independent_motion : float
        Independent motion of the copy, relative to the elevator's.
    schur : float
        Fraction of the copy that the other true terms leave.
    condition : float
        Of the true terms and the constant, scaled to unit length.
    theta_error : float
        Of the refit against 60 digits, in units of eps times condition.
    f_error : float
        Largest relative error of a partial F from the cross-products that the search uses; nan where the Schur
        complement is below TOL.
    printed_f_error : float
        The same of the refit's, which is what is printed.
    same_set : bool
        Search on cross-products and search by QR kept the same terms.
    refused : bool
        One of the pair is among the candidates refused.
    kept_both : bool
    """

    independent_motion: float
    schur: float
    condition: float
    theta_error: float
    f_error: float
    printed_f_error: float
    same_set: bool
    refused: bool
    kept_both: bool

    def row(self) -> list[object]:
        return [
            f"{self.independent_motion:.0e}",
            f"{self.condition:.1e}",
            self.theta_error,
            f"{self.f_error:.1e}" if np.isfinite(self.f_error) else "-",
            f"{self.printed_f_error:.1e}",
            "yes" if self.same_set else "no",
            "yes" if self.refused else "no",
        ]


def conditioning_cases(per_level: int, seed: int) -> list[Conditioning]:
    """All levels of independent motion, `per_level` flights each."""
    found = []
    for motion in INDEPENDENT_MOTIONS:
        for k in range(per_level):
            found.append(one_case(motion, seed + k))
            say(f"conditioning {motion:.0e} seed {seed + k}: {found[-1].row()}")
    return found


def one_case(motion: float, seed: int) -> Conditioning:
    rng = np.random.default_rng([seed, 5])
    flight = flight_signals(SAMPLES, seed)
    own = rng.standard_normal(SAMPLES)
    elevator = flight[ELEVATOR]
    base = np.ascontiguousarray(np.vstack([flight, elevator + motion * elevator.std() * own]))
    exponents = monomials(9, 2)
    linear = np.flatnonzero(exponents.sum(axis=1) == 1)
    square = np.flatnonzero((exponents.sum(axis=1) == 2) & (exponents[:, [ELEVATOR, COPY]].sum(axis=1) == 0))
    others = [
        *rng.choice(linear[[0, 1, 2, 3, 4, 6, 7]], 3, replace=False),
        *rng.choice(square, 2, replace=False),
    ]
    true = [int(linear[ELEVATOR]), int(linear[COPY]), *(int(j) for j in others)]
    columns = design_matrix(base, exponents[true])
    signal = columns[:, 0] / columns[:, 0].std() + columns[:, 2:] @ (1.0 / columns[:, 2:].std(axis=0))
    noise = 0.2 * signal.std() * rng.standard_normal(SAMPLES)
    contribution = COPY_T * noise.std() / np.sqrt(SAMPLES) * own  # = theta (copy - elevator)
    y = signal + contribution + noise
    signals = [ArrayData(base, y[None])]
    products = cross_products(signals, exponents, workers=1)
    C, dof = centred(products.total()), SAMPLES - 1.0
    path = stepwise(C, dof, F_in=F_IN, F_out=F_IN, swap=False, min_tolerance=TOL)
    by_qr, _ = qr_stepwise(design_matrix(base, exponents), y, F_IN, TOL)
    fit = fit_terms(signals, exponents[true])
    theta, F, norms = reference(base, exponents[true], y)
    error = np.max(np.abs(fit.theta - theta) * norms) / np.max(np.abs(theta) * norms)
    sub = C[np.ix_(true, true)]
    schur = float(1.0 / (np.linalg.inv(sub / np.sqrt(np.outer(np.diag(sub), np.diag(sub))))[1, 1]))
    f_error = float("nan")
    if schur >= TOL:
        f_error = float(np.max(np.abs(partial_f(C, dof, true)[1] / F - 1.0)))
    pair = {true[0], true[1]}
    return Conditioning(
        independent_motion=motion,
        schur=schur,
        condition=fit.condition,
        theta_error=float(error / (np.finfo(float).eps * fit.condition)),
        f_error=f_error,
        printed_f_error=float(np.max(np.abs(fit.partial_F[1:] / F - 1.0))),
        same_set=set(path.selected) == by_qr,
        refused=bool(pair & set(path.refused)),
        kept_both=pair <= set(path.selected),
    )


def reference(base: Array, exponents: NDArray[np.integer], y: Array) -> tuple[Array, Array, Array]:
    """Coefficients (constant first), partial F of the terms and column norms, in 60 digits."""
    from mpmath import mp

    with mp.workdps(60):
        rows = [[mp.mpf(float(v)) for v in row] for row in base]
        columns = [[mp.mpf(1)] * len(y)]
        for powers in exponents:
            column = columns[0]
            for s in np.flatnonzero(powers):
                for _ in range(int(powers[s])):
                    column = [a * b for a, b in zip(column, rows[s])]
            columns.append(column)
        response = [mp.mpf(float(v)) for v in y]
        q = len(columns)
        gram = mp.matrix(q, q)
        right = mp.matrix(q, 1)
        for i in range(q):
            right[i] = mp.fdot(columns[i], response)
            for j in range(i + 1):
                gram[i, j] = gram[j, i] = mp.fdot(columns[i], columns[j])
        inverse = gram**-1
        theta = inverse * right
        rss = mp.fdot(response, response) - mp.fdot(theta, right)
        s2 = rss / (len(y) - q)
        F = [float(theta[i] ** 2 / (s2 * inverse[i, i])) for i in range(1, q)]
        norms = [float(mp.sqrt(gram[i, i])) for i in range(q)]
        return np.array([float(v) for v in theta]), np.array(F), np.array(norms)


def conditioning_goal(found: list[Conditioning]) -> list[tuple[str, str, bool]]:
    """The parts of A4: what, figure, reached."""
    if not found:
        return []
    worst = max(c.theta_error for c in found)
    printed = max(c.printed_f_error for c in found if c.schur >= TOL)
    f_errors = [c.f_error for c in found if np.isfinite(c.f_error)]
    same = sum(c.same_set for c in found)
    below = [c for c in found if c.schur < TOL]
    above = [c for c in found if c.schur >= TOL]
    return [
        ("refit within 20 eps cond of 60 digits", f"{worst:.2g} eps cond", worst <= 20),
        (
            "partial F in the search within 1e-5, Schur complement >= 1e-9",
            f"{max(f_errors):.1e}",
            max(f_errors) <= 1e-5,
        ),
        ("partial F as printed within 1e-6, Schur complement >= 1e-9", f"{printed:.1e}", printed <= 1e-6),
        ("same set as the QR search", f"{same} of {len(found)}", same == len(found)),
        (
            "both kept above 1e-9, one refused and listed below",
            f"{sum(c.kept_both for c in above)} of {len(above)}, {sum(c.refused for c in below)} of {len(below)}",
            all(c.kept_both for c in above) and all(c.refused and not c.kept_both for c in below),
        ),
    ]
