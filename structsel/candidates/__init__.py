"""Candidate terms: what a model may contain, as values with an algebra.

A `Factor` is one evaluated signal (a channel, an offset from a reference, a spline basis, a formula),
a `Term` a product of powers of factors, and `Candidates` the ordered pool a selection chooses from.
"""

from structsel.candidates.pool import Candidates
from structsel.candidates.terms import Factor, Term

__all__ = ["Candidates", "Factor", "Term"]
