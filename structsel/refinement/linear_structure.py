"""Linear models with named parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from structsel.deprecation import renamed_arguments, renamed_attribute
from structsel.errors import ModelError
from structsel.nomenclature import suggest
from structsel.numerics.linear_models import LinearFamily, LinearSystem
from structsel.results import Copied
from structsel.simulation.linear import LinearModel

Build = Callable[[Mapping[str, np.ndarray]], Mapping[str, Any]]
"""Parameter arrays (m,) by name to matrices by name: A, B, C, D; where there are any, drift (added to the derivatives
of the states), reference (added to the outputs) and delay. A matrix that depends on no parameter may lack the leading
axis."""


@renamed_arguments(late="delayed")
@dataclass(frozen=True)
class LinearStructure(Copied):
    """A linear model whose matrices depend on named parameters, in any way.

    `LinearModel` is the special case of matrices that are linear in the parameters.

    Attributes
    ----------
    states, inputs, outputs : tuple of str
        Outputs and inputs are channels of recordings.
    parameters : mapping of str to float
        Their values.
    build : callable
        See `Build`.
    delay : float [s]
        Time delay of the inputs, in addition to that of `build`.
    hold : {"linear", "hold"}
        Inputs between samples.
    input_reference : mapping of str to float
        Reading of an input's channel where the model's input is zero; 0 where not named.
    name : str
    delayed : tuple of str, optional
        Inputs that are delayed; all by default.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: Mapping[str, float]
    build: Build
    delay: float = 0.0
    hold: Literal["linear", "hold"] = "linear"
    input_reference: Mapping[str, float] = field(default_factory=dict)
    name: str = "linear model"
    delayed: tuple[str, ...] | None = None

    late = renamed_attribute("delayed")

    def __repr__(self) -> str:
        return f"<LinearStructure {self.name}: states {', '.join(self.states)}; {len(self.parameters)} parameters>"

    def __post_init__(self) -> None:
        for key in ("states", "inputs", "outputs"):
            object.__setattr__(self, key, tuple(getattr(self, key)))
        for key in ("parameters", "input_reference"):
            object.__setattr__(self, key, MappingProxyType({k: float(v) for k, v in getattr(self, key).items()}))

    def __reduce__(self) -> tuple[Any, ...]:  # a mapping proxy does not pickle
        plain = [getattr(self, name) for name in self.__dataclass_fields__]
        return LinearStructure, tuple(dict(p) if isinstance(p, MappingProxyType) else p for p in plain)

    @classmethod
    def from_model(cls, model: LinearModel, *, hold: Literal["linear", "hold"] = "linear") -> LinearStructure:
        """Structure of a linear model in its own parameters."""
        return cls.from_family(model.family, model.theta, model.name, hold=hold)

    @classmethod
    def from_family(
        cls,
        family: LinearFamily,
        values: Mapping[str, float] | np.ndarray,
        name: str = "linear model",
        *,
        hold: Literal["linear", "hold"] = "linear",
    ) -> LinearStructure:
        """Structure of a system that depends linearly on parameters, at these values."""
        theta = [values[n] for n in family.names] if isinstance(values, Mapping) else np.asarray(values, dtype=float)

        def build(sets: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
            system = family.at(np.column_stack([sets[n] for n in family.names]))
            return {key: getattr(system, key) for key in "ABCD"} | {
                "drift": system.bias, "reference": system.y_ref, "delay": system.delay,
            }  # fmt: skip

        base = family.base
        return cls(base.states, base.inputs, base.outputs, dict(zip(family.names, theta)), build, hold=hold, name=name)

    @classmethod
    def from_entries(
        cls, model: LinearSystem, entries: Mapping[str, tuple[str, int, int] | Sequence[tuple[str, int, int]]]
    ) -> LinearStructure:
        """Structure whose parameters are entries of a linear system's matrices.

        Parameters
        ----------
        model : LinearSystem
            Gives all other entries, and the parameters' values.
        entries : mapping of str to (matrix, row, column) or several
            Matrix is ``"A"``, ``"B"``, ``"C"`` or ``"D"``; in several places the parameter has the same value.

        Raises
        ------
        ModelError
            An entry outside its matrix, or places whose values differ.
        """
        base = {key: np.array(getattr(model, key), dtype=float) for key in "ABCD"}
        places: dict[str, list[tuple[str, int, int]]] = {}
        for name, place in entries.items():
            places[name] = [place] if isinstance(place[0], str) else list(place)  # type: ignore[list-item,arg-type]
            for matrix, row, column in places[name]:
                shape = base[matrix].shape if matrix in base else ()
                if not shape or not (0 <= row < shape[0] and 0 <= column < shape[1]):
                    raise ModelError(
                        f"Parameter '{name}' is to be entry ({row}, {column}) of {matrix}; the model has "
                        f"{', '.join(f'{key} {m.shape}' for key, m in base.items())}, counted from 0."
                    )
        values = {name: [float(base[m][r, c]) for m, r, c in where] for name, where in places.items()}
        for name, found in values.items():
            if len(set(found)) > 1:
                raise ModelError(
                    f"Parameter '{name}' has different values in its places: {found}. Use different names."
                )

        def build(theta: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
            m = len(next(iter(theta.values())))
            made = {key: np.tile(matrix, (m, 1, 1)) for key, matrix in base.items()}
            made |= {"drift": model.bias, "reference": model.y_ref}
            for name, where in places.items():
                for matrix, row, column in where:
                    made[matrix][:, row, column] = theta[name]
            return made

        return cls(
            tuple(model.states), tuple(model.inputs), tuple(model.outputs),
            {name: found[0] for name, found in values.items()}, build, float(model.delay),
        )  # fmt: skip

    def matrices(self, values: np.ndarray) -> LinearSystem:
        """Systems of m parameter sets, values (m, k) in the order of `parameters`.

        Raises
        ------
        ModelError
            Matrices that do not fit the names of states, inputs and outputs.
        """
        values = np.atleast_2d(values)
        m = len(values)
        made = self.build({name: values[:, j] for j, name in enumerate(self.parameters)})
        s, i, o = len(self.states), len(self.inputs), len(self.outputs)
        shapes = {"A": (s, s), "B": (s, i), "C": (o, s), "D": (o, i), "drift": (s,), "reference": (o,), "delay": ()}
        missing = [key for key in "ABCD" if key not in made]
        if missing:
            raise ModelError(f"'{self.name}' builds no {', '.join(missing)}; it must build A, B, C and D.")
        held = {}
        for key, shape in shapes.items():
            matrix = np.asarray(made.get(key, np.zeros(shape)), dtype=float)
            if matrix.shape not in (shape, (m, *shape)):
                raise ModelError(
                    f"'{self.name}' builds {key} of shape {matrix.shape}; {s} states, {i} inputs and {o} outputs "
                    f"need {shape}, or {(m, *shape)} for {m} parameter sets."
                )
            held[key] = np.ascontiguousarray(np.broadcast_to(matrix, (m, *shape)))
        bias, y_ref = held.pop("drift"), held.pop("reference")
        return LinearSystem(self.states, self.inputs, self.outputs, **held, bias=bias, y_ref=y_ref)

    @renamed_arguments(late="delayed")
    def replace(
        self, values: Mapping[str, float], delay: float | None = None, delayed: Sequence[str] | None = None
    ) -> LinearStructure:
        """The same structure with other values of some parameters, another delay, or other delayed inputs.

        Raises
        ------
        ModelError
            A name it does not have.
        """
        for name in values:
            if name not in self.parameters:
                raise ModelError(f"'{self.name}' has no parameter '{name}'.{suggest(name, self.parameters)}")
        return LinearStructure(
            self.states, self.inputs, self.outputs, {**self.parameters, **values}, self.build,
            self.delay if delay is None else delay, self.hold, self.input_reference, self.name,
            self.delayed if delayed is None else tuple(delayed),
        )  # fmt: skip

    def growth(self, values: np.ndarray) -> np.ndarray:
        """(m,) largest real part of the eigenvalues of A [1/s]; below zero where the motion is stable."""
        A = self.matrices(values).A
        lost = ~np.isfinite(A).all(axis=(1, 2))
        roots = np.linalg.eigvals(np.where(lost[:, None, None], 0.0, A))
        return np.where(lost, np.inf, roots.real.max(axis=1))
