"""What a descent by output error found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class OutputErrorFit:
    """Parameters, how sure they are, and how the search went; k parameters, c outputs.

    Attributes
    ----------
    theta : (k,) array
        The best found.
    crlb : (k, k) array
        Covariance were the residuals white: the Cramer-Rao bound; for the cost "weighted", that of its estimator.
        Infinite on the diagonal where the data do not determine a parameter.
    covariance : (k, k) array
        With the residuals as coloured as they are.
    R : (c, c) array
        Covariance of the noise, from the residuals.
    outputs, residuals : tuple of (n, c) array
        Of each manoeuvre; residuals are measured less predicted, NaN where not sampled.
    costs : (i,) array
        J at the start and after each step taken.
    thetas : (i, k) array
        The parameters there.
    converged : bool
    message : str
        How the search ended.
    at_bound : (k,) int array
        -1 at the lower bound, 1 at the upper, else 0.
    undetermined : (k,) bool array
        Parameters the outputs do not depend on, alone or in some combination.
    evaluations : int
        Parameter sets flown.
    """

    theta: np.ndarray
    crlb: np.ndarray
    covariance: np.ndarray
    R: np.ndarray
    outputs: tuple[np.ndarray, ...]
    residuals: tuple[np.ndarray, ...]
    costs: np.ndarray
    thetas: np.ndarray
    converged: bool
    message: str
    at_bound: np.ndarray
    undetermined: np.ndarray
    evaluations: int

    def __post_init__(self) -> None:
        arrays = [self.theta, self.crlb, self.covariance, self.R, self.costs, self.thetas]
        for array in (*arrays, self.at_bound, self.undetermined, *self.outputs, *self.residuals):
            array.setflags(write=False)

    @property
    def std(self) -> np.ndarray:
        """(k,) standard deviations, residuals coloured."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def std_white(self) -> np.ndarray:
        """(k,) Cramer-Rao standard deviations."""
        return np.sqrt(np.diag(self.crlb))

    @property
    def correlation(self) -> np.ndarray:
        """(k, k) correlation of the estimates; 0 with what is not determined."""
        std = self.std_white
        usable = np.isfinite(std) & (std > 0.0)
        inverse = np.where(usable, 1.0 / np.where(usable, std, 1.0), 0.0)
        found = np.where(np.isfinite(self.crlb), self.crlb, 0.0) * np.outer(inverse, inverse)
        np.fill_diagonal(found, 1.0)
        return found
