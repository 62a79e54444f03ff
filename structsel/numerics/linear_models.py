"""Linear systems with named states and outputs, and with named parameters and exact sensitivities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from structsel.errors import DomainError
from structsel.numerics.linear_systems import (
    Hold,
    advance,
    discretise,
    interval,
    read_outputs,
    simulate_linear,
    split_delay,
)

SHAPES = {"A": "xx", "B": "xu", "C": "yx", "D": "yu", "bias": "x", "y_ref": "y", "delay": ""}
"""Axes of each array of one system: x states, u inputs, y outputs."""


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
        If shapes and names do not agree.
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


@dataclass(frozen=True, eq=False)
class LinearFamily:
    """A system whose arrays and delay are linear in k named parameters::

        A(theta) = base.A + sum_j theta_j dA_j,    and so for B, C, D, bias, y_ref and the delay

    Attributes
    ----------
    names : tuple of str
        The k parameters.
    base : LinearSystem
        One system, for which every parameter is zero.
    dA : (k, ns, ns) array
    dB : (k, ns, ni) array
    dC : (k, no, ns) array
    dD : (k, no, ni) array
    dbias : (k, ns) array
    dy_ref : (k, no) array
    ddelay : (k,) array

    Raises
    ------
    DomainError
        Where shapes and names disagree.
    """

    names: tuple[str, ...]
    base: LinearSystem
    dA: np.ndarray
    dB: np.ndarray
    dC: np.ndarray
    dD: np.ndarray
    dbias: np.ndarray
    dy_ref: np.ndarray
    ddelay: np.ndarray

    def __post_init__(self) -> None:
        """Check shapes; make the arrays read-only."""
        object.__setattr__(self, "names", tuple(self.names))
        if self.base.batch is not None:
            raise DomainError("LinearFamily needs one system as its base; found several.")
        for part in SHAPES:
            want = (len(self.names), *getattr(self.base, part).shape)
            array = np.array(getattr(self, f"d{part}"), dtype=float)
            if array.shape != want:
                raise DomainError(f"LinearFamily needs d{part} of shape {want}; found {array.shape}.")
            array.setflags(write=False)
            object.__setattr__(self, f"d{part}", array)

    @classmethod
    def of(cls, base: LinearSystem, derivatives: dict[str, dict[str, np.ndarray]]) -> LinearFamily:
        """Family from the derivatives by each parameter, name to {"A": ..., "delay": ...}; others are zero.

        Raises
        ------
        DomainError
            A part that is none of A, B, C, D, bias, y_ref, delay.
        """
        k = len(derivatives)
        parts = {part: np.zeros((k, *getattr(base, part).shape)) for part in SHAPES}
        for j, (name, given) in enumerate(derivatives.items()):
            if unknown := set(given) - set(SHAPES):
                raise DomainError(
                    f"parameter '{name}' is to alter {', '.join(sorted(unknown))}; a system has {', '.join(SHAPES)}."
                )
            for part, value in given.items():
                parts[part][j] = value
        return cls(tuple(derivatives), base, *(parts[part] for part in SHAPES))

    def at(self, theta: np.ndarray) -> LinearSystem:
        """System for parameters (k,), or one for each row of (m, k).

        Raises
        ------
        DomainError
            Where theta does not hold k parameters.
        """
        theta = np.asarray(theta, dtype=float)
        if theta.ndim not in (1, 2) or theta.shape[-1] != len(self.names):
            raise DomainError(
                f"LinearFamily needs (k,) or (m, k) parameters, k = {len(self.names)} ({', '.join(self.names)}); "
                f"found shape {theta.shape}."
            )
        made = {part: getattr(self.base, part) + np.tensordot(theta, getattr(self, f"d{part}"), 1) for part in SHAPES}
        return LinearSystem(self.base.states, self.base.inputs, self.base.outputs, **made)

    def keep(self, names: tuple[str, ...], theta: np.ndarray) -> LinearFamily:
        """Family in these parameters alone, the others held at their values in theta (k,).

        Raises
        ------
        DomainError
            A name that is none of the family's.
        """
        if missing := [n for n in names if n not in self.names]:
            raise DomainError(f"no parameter {', '.join(missing)}; there are {', '.join(self.names)}.")
        rows = [self.names.index(n) for n in names]
        held = np.array(theta, dtype=float)
        held[rows] = 0.0
        return LinearFamily(tuple(names), self.at(held), *(getattr(self, f"d{part}")[rows] for part in SHAPES))

    def simulate(
        self, theta: np.ndarray, u: np.ndarray, dt: float, *, x0: np.ndarray | float = 0.0, hold: Hold = "hold"
    ) -> np.ndarray:
        """Outputs (n, no) for parameters (k,), or (m, n, no) for (m, k); see `simulate_linear`."""
        s = self.at(theta)
        y = simulate_linear(s.A, s.B, s.C, s.D, u, dt, delay=s.delay, bias=s.bias, y_ref=s.y_ref, x0=x0, hold=hold)
        assert isinstance(y, np.ndarray)
        return y

    def sensitivities(
        self, theta: np.ndarray, u: np.ndarray, dt: float, *, x0: np.ndarray | float = 0.0, hold: Hold = "hold"
    ) -> np.ndarray:
        """Derivatives of the outputs by the parameters, exact, (n, no, k).

        The state's derivative s_j by parameter j follows the same system, driven by the motion::

            s_j' = A s_j + dA_j x + dB_j u + dbias_j        dy/dtheta_j = C s_j + dC_j x + dD_j u + dy_ref_j

        so that x and s_j together are one system of twice the size, solved as exactly as x. The derivative by the
        delay is the response to minus the slope of the input. For held inputs, D u jumps at the edges, and its
        derivative by the delay is left out.

        Parameters
        ----------
        theta : (k,) or (m, k) array
        u : (n, ni) or (b, n, ni) array
            Several inputs at once, for one set of parameters.
        dt : float [s]
        x0 : (ns,) array
        hold : {"hold", "linear"}

        Returns
        -------
        (n, no, k), (m, n, no, k) or (b, n, no, k) array
        """
        theta, u = np.asarray(theta, dtype=float), np.asarray(u, dtype=float)
        if u.ndim == 3:
            return np.stack([self.sensitivities(theta, one, dt, x0=x0, hold=hold) for one in u])
        sets = np.atleast_2d(theta)
        s = self.at(sets)
        m, k, ns, no = len(sets), len(self.names), len(s.states), len(s.outputs)
        A = np.zeros((m, k, 2 * ns, 2 * ns))
        A[:, :, :ns, :ns] = A[:, :, ns:, ns:] = s.A[:, None]
        A[:, :, ns:, :ns] = self.dA
        B = _stack(s.B, self.dB, 2)
        bias = _stack(s.bias, self.dbias, 2)
        C = np.concatenate([np.broadcast_to(self.dC, (m, *self.dC.shape)), np.repeat(s.C[:, None], k, 1)], axis=3)
        start = np.concatenate([np.broadcast_to(np.asarray(x0, dtype=float), (ns,)), np.zeros(ns)])

        def flat(a: np.ndarray) -> np.ndarray:
            return a.reshape(m * k, *a.shape[2:])

        moved = simulate_linear(
            flat(A), flat(B), flat(C), np.tile(self.dD, (m, 1, 1)), u, dt, delay=np.repeat(s.delay, k),
            bias=flat(bias), y_ref=np.tile(self.dy_ref, (m, 1)), x0=start, hold=hold,
        )  # fmt: skip
        assert isinstance(moved, np.ndarray)
        result = moved.reshape(m, k, len(u), no).transpose(0, 2, 3, 1)
        if self.ddelay.any():
            result = result + self.ddelay * self._by_delay(s, u, dt, hold)[:, :, :, None]
        return np.ascontiguousarray(result if theta.ndim == 2 else result[0])

    @staticmethod
    def _by_delay(s: LinearSystem, u: np.ndarray, dt: float, hold: Hold) -> np.ndarray:
        delay_steps, part = split_delay(s.delay, dt)
        Phi, after, _ = interval(s.A, s.B, dt, part, hold)
        G = np.zeros((3, *s.B.shape))
        if hold == "hold":  # one edge in every interval moves
            G[0] = after @ s.B
            G[1] = -G[0]
        else:
            first = after @ discretise(s.A, s.B, part * dt)[1] / dt
            second = discretise(s.A, s.B, (1.0 - part) * dt)[1] / dt
            G[0], G[1], G[2] = first, second - first, -second
        m, ns = len(s.A), len(s.states)
        x = np.empty((m, len(u), ns))
        advance(Phi, G, np.zeros((m, ns)), delay_steps, np.ascontiguousarray(u[None]), np.zeros((1, ns)), x)
        slope = np.zeros((1, *u.shape))
        if hold == "linear":
            slope[0, 1:] = -np.diff(u, axis=0) / dt
        return read_outputs(x, s.C, s.D, np.zeros((1, len(s.outputs))), slope, delay_steps, np.zeros(m), hold)


def _stack(common: np.ndarray, own: np.ndarray, axis: int) -> np.ndarray:
    """Array of each set (m, ...) above that of each parameter (k, ...), (m, k, ...)."""
    m, k = len(common), len(own)
    return np.concatenate([np.repeat(common[:, None], k, 1), np.broadcast_to(own, (m, *own.shape))], axis=axis)
