"""Formulas as short programs over a vector of slots, evaluated for single states inside compiled loops.

A program is a list of instructions. The first `inputs` slots hold channels; instruction i writes slot ``inputs + i``
from slots before it. An expression that occurs twice is computed once, so terms with common factors cost less::

    maker = ProgramMaker(inputs=2)                        # slots 0 and 1: alpha, de
    square = maker.emit("multiply", 0, 0)                 # alpha^2
    term = maker.emit("multiply", square, 1)              # alpha^2 de
    program = maker.done()
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from structsel.errors import TermError
from structsel.numerics.arrays import UNCOUNTED
from structsel.numerics.compiling import njit

OPERATIONS = (
    *("number", "add", "subtract", "multiply", "divide", "negate", "power", "plus"),
    *("abs", "sign", "sqrt", "sin", "cos", "tan", "exp", "log", "tanh", "step"),
)
"""Names of the operations, by number. ``number`` writes its own value, ``power`` raises to it, ``plus`` is max(0, x),
``step`` 1 from zero up."""
(_NUMBER, _ADD, _SUBTRACT, _MULTIPLY, _DIVIDE, _NEGATE, _POWER, _PLUS) = range(8)
(_ABS, _SIGN, _SQRT, _SIN, _COS, _TAN, _EXP, _LOG, _TANH, _STEP) = range(8, 18)


class TermProgram(NamedTuple):
    """Instructions over a vector of slots.

    Attributes
    ----------
    inputs : int
        Slots filled by the caller.
    operation, left, right : (k,) int array
        Operation by number, and the slots of its arguments; `right` is -1 for a function of one argument.
    value : (k,) array
        Of a number, or the exponent of a power.
    """

    inputs: int
    operation: NDArray[np.int64]
    left: NDArray[np.int64]
    right: NDArray[np.int64]
    value: NDArray[np.float64]

    @property
    def slots(self) -> int:
        """Length of the vector the program works on."""
        return self.inputs + self.operation.size


class ProgramMaker:
    """Collects instructions without repetition.

    Parameters
    ----------
    inputs : int
        Slots filled by the caller.
    """

    def __init__(self, inputs: int):
        self._inputs = inputs
        self._known: dict[tuple[int, int, int, float], int] = {}

    def emit(self, operation: str, left: int = -1, right: int = -1, value: float = 0.0) -> int:
        """Slot of an instruction's result.

        Raises
        ------
        TermError
            For an operation that is not in `OPERATIONS`, or a slot that is not yet filled.
        """
        if operation not in OPERATIONS:
            raise TermError(f"A program has no operation {operation!r}; there are {', '.join(OPERATIONS)}.")
        filled = self._inputs + len(self._known)
        if max(left, right) >= filled:
            raise TermError(f"Instruction {operation!r} takes slot {max(left, right)}; only {filled} are filled.")
        key = (OPERATIONS.index(operation), left, right, float(value))
        return self._known.setdefault(key, filled)

    def done(self) -> TermProgram:
        """The program of the instructions so far."""
        rows = list(self._known)
        operation, left, right = (np.array([row[j] for row in rows], dtype=np.int64) for j in range(3))
        return TermProgram(self._inputs, operation, left, right, np.array([row[3] for row in rows], dtype=float))


@njit(**UNCOUNTED, forceinline=True)
def run_program(program, slots):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Fill the slots (program.slots,) after the inputs; an undefined value (log of a negative number) is nan or inf."""
    inputs, operation, left, right, value = program
    for i in range(operation.size):
        what = operation[i]
        if what == _NUMBER:
            slots[inputs + i] = value[i]
            continue
        x = slots[left[i]]
        if what == _MULTIPLY:
            y = x * slots[right[i]]
        elif what == _ADD:
            y = x + slots[right[i]]
        elif what == _SUBTRACT:
            y = x - slots[right[i]]
        elif what == _DIVIDE:
            y = x / slots[right[i]]
        elif what == _NEGATE:
            y = -x
        elif what == _POWER:
            y = x ** value[i]
        elif what == _PLUS:
            # A nan stays one, as in numpy's maximum.
            y = 0.0 if x < 0.0 else x
        elif what == _ABS:
            y = abs(x)
        elif what == _SIGN:
            y = np.sign(x)
        elif what == _SQRT:
            y = np.sqrt(x)
        elif what == _SIN:
            y = np.sin(x)
        elif what == _COS:
            y = np.cos(x)
        elif what == _TAN:
            y = np.tan(x)
        elif what == _EXP:
            y = np.exp(x)
        elif what == _LOG:
            y = np.log(x)
        elif what == _TANH:
            y = np.tanh(x)
        else:
            y = 1.0 if x >= 0.0 else 0.0
        slots[inputs + i] = y
