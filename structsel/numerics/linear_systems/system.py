"""A linear system as arrays with names."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from structsel.errors import DomainError

SHAPES = {"A": "xx", "B": "xu", "C": "yx", "D": "yu", "bias": "x", "y_ref": "y", "delay": ""}
"""What each array of one system runs over: x states, u inputs, y outputs."""


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """One linear system, or m of the same shape.

    Attributes
    ----------
    states, inputs, outputs : tuple of str
        Names; ns, ni and no of them.
    A : (ns, ns) or (m, ns, ns) array
    B : (ns, ni) or (m, ns, ni) array
    C : (no, ns) or (m, no, ns) array
    D : (no, ni) or (m, no, ni) array
    delay : () or (m,) array [s]
        Of all inputs; zero or above.
    bias : (ns,) or (m, ns) array
        Added to the state's derivative.
    y_ref : (no,) or (m, no) array
        Added to the outputs.

    Raises
    ------
    DomainError
        Where shapes and names disagree.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    delay: np.ndarray
    bias: np.ndarray
    y_ref: np.ndarray

    def __post_init__(self) -> None:
        """Check shapes; make the arrays read-only."""
        for name in ("states", "inputs", "outputs"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        count = {"x": len(self.states), "u": len(self.inputs), "y": len(self.outputs)}
        sizes: set[int] = set()
        for name, axes in SHAPES.items():
            array = np.array(getattr(self, name), dtype=float)
            want = tuple(count[axis] for axis in axes)
            lead = array.shape[: array.ndim - len(want)]
            if len(lead) > 1 or array.shape[len(lead) :] != want:
                raise DomainError(
                    f"LinearSystem needs {name} of shape {want}, or with one axis before it for several systems; "
                    f"found {array.shape}. States {', '.join(self.states)}; inputs {', '.join(self.inputs)}; "
                    f"outputs {', '.join(self.outputs)}."
                )
            sizes.update(lead)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if len(sizes) > 1:
            raise DomainError(f"LinearSystem: the arrays hold {sorted(sizes)} systems; give all the same number.")

    @classmethod
    def of(
        cls,
        states: tuple[str, ...],
        inputs: tuple[str, ...],
        A: np.ndarray,
        B: np.ndarray,
        *,
        outputs: tuple[str, ...] | None = None,
        C: np.ndarray | None = None,
        D: np.ndarray | None = None,
    ) -> LinearSystem:
        """System without delay, bias or reference; its outputs are its states where no C is given."""
        ns, ni = len(states), len(inputs)
        out = tuple(states) if outputs is None else tuple(outputs)
        return cls(
            tuple(states),
            tuple(inputs),
            out,
            np.asarray(A),
            np.asarray(B),
            np.eye(ns) if C is None else np.asarray(C),
            np.zeros((len(out), ni)) if D is None else np.asarray(D),
            np.asarray(0.0),
            np.zeros(ns),
            np.zeros(len(out)),
        )

    @property
    def batch(self) -> int | None:
        """Number of systems; None where there is one without a leading axis."""
        arrays = {name: getattr(self, name) for name in SHAPES}
        return next((len(a) for name, a in arrays.items() if a.ndim > len(SHAPES[name])), None)
