"""The moves of a search and the parts held out, as a selection lists them."""

from __future__ import annotations

from dataclasses import dataclass

from structsel.candidates import Term


@dataclass(frozen=True)
class TraceStep:
    """One move of the search, with where it left the model.

    Attributes
    ----------
    action : {"enter", "leave", "swap", "refuse", "simplify"}
        "simplify" puts the term of lowest degree in the place of one these data cannot tell from it.
    term : Term
    other : Term or None
        The one a swap or simplification put out.
    F, partial_r : float [-]
        Partial F and partial correlation of the term that moved.
    n_terms : int
        After the move, the constant not counted.
    R2, PSE, BIC : float
        After the move, of the cross-products searched (prewhitened with coloured residuals); PSE as a fraction of
        the response's mean square about its mean.
    """

    action: str
    term: Term
    other: Term | None
    F: float
    partial_r: float
    n_terms: int
    R2: float
    PSE: float
    BIC: float

    def __str__(self) -> str:
        what = f"{self.other} -> {self.term}" if self.other is not None else str(self.term)
        return (
            f"{self.action:<8} {what:<28} F {self.F:>10.4g}  r {self.partial_r:+.3f}  terms {self.n_terms:>2}  "
            f"R2 {self.R2:.5f}  PSE {self.PSE:.5f}  BIC {self.BIC:.1f}"
        )


@dataclass(frozen=True)
class HeldOutPart:
    """Prediction of one part by a model selected without it: R2 about its own mean, rms error [response]."""

    name: str
    r2: float
    rms: float
    n: int
