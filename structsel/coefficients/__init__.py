"""Coefficients of the measured motion, and the dimensionless channels of candidate terms."""

from structsel.coefficients.compute import compute_all, compute_coefficients

__all__ = ["compute_all", "compute_coefficients"]
