"""Linear small-perturbation models with named parameters and units, and their simulation.

All states, inputs and outputs are departures from the reference condition.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from structsel.errors import DataError, ModelError, SimulationError
from structsel.nomenclature import is_known, suggest, unit_of
from structsel.numerics.linear_models import LinearFamily, LinearSystem
from structsel.numerics.linear_systems import previous_input, simulate_linear
from structsel.recording import Recording
from structsel.results import Result
from structsel.simulation.modes import Modes, modes
from structsel.tables import Column, Summary, Table, text_column

if TYPE_CHECKING:
    import pandas as pd

Hold = Literal["hold", "linear"]

_UNIT_OF_RATE = {"m/s": "m/s^2", "rad": "rad/s", "rad/s": "rad/s^2", "-": "1/s", "m": "m/s"}


@dataclass(frozen=True, eq=False, repr=False)
class LinearModel(Result):
    """A linear model whose matrices are linear in named parameters.

    Attributes
    ----------
    name : str
    family : LinearFamily
    theta : (k,) array
        Values of the family's parameters.
    condition : mapping of str to float
        The reference condition and constants, in the nomenclature's names and units where it has them.
    units : mapping of str to str
        Of channels that the nomenclature does not hold.
    notes : tuple of str
        Where the numbers are from, and readings of them that may be doubted.

    Raises
    ------
    ModelError
        Where the values are not as many as the parameters, or not finite.
    """

    name: str
    family: LinearFamily
    theta: np.ndarray
    condition: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Make arrays and mappings read-only."""
        theta = np.array(self.theta, dtype=float)
        if theta.shape != (len(self.family.names),) or not np.isfinite(theta).all():
            raise ModelError(
                f"'{self.name}' needs one finite value for each of its {len(self.family.names)} parameters "
                f"({', '.join(self.family.names)}); found shape {theta.shape}, "
                f"{int(np.sum(~np.isfinite(theta)))} of them not finite."
            )
        theta.setflags(write=False)
        object.__setattr__(self, "theta", theta)
        object.__setattr__(self, "condition", MappingProxyType(dict(self.condition)))
        object.__setattr__(self, "units", MappingProxyType(dict(self.units)))
        object.__setattr__(self, "notes", tuple(self.notes))

    @property
    def system(self) -> LinearSystem:
        """Its arrays at the parameters' values."""
        return self.family.at(self.theta)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the states."""
        return self.family.base.states

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return self.family.base.inputs

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return self.family.base.outputs

    @property
    def parameters(self) -> dict[str, float]:
        """Name to value."""
        return dict(zip(self.family.names, self.theta.tolist()))

    def with_parameters(self, values: Mapping[str, float] | None = None, **more: float) -> LinearModel:
        """Model with some parameters at other values.

        Raises
        ------
        ModelError
            A name that is no parameter's.
        """
        changed = {**(values or {}), **more}
        for name in changed:
            if name not in self.family.names:
                raise ModelError(
                    f"'{self.name}' has no parameter '{name}'; it has {', '.join(self.family.names)}."
                    f"{suggest(name, self.family.names)}"
                )
        theta = [changed.get(name, value) for name, value in self.parameters.items()]
        return LinearModel(self.name, self.family, np.array(theta), self.condition, self.units, self.notes)

    def keep(self, *states: str, outputs: Sequence[str] | None = None) -> LinearModel:
        """Model with these states alone, the others held at the reference condition.

        Parameters that then act on nothing go too. ``model.keep("w", "q")`` is the short-period approximation.

        Parameters
        ----------
        *states : str
        outputs : sequence of str, optional
            Outputs to keep; by default those that still move, states that are gone not among them.

        Raises
        ------
        ModelError
            A name that is no state's, or no output's.
        """
        for name, among, kind in [(s, self.states, "state") for s in states] + [
            (o, self.outputs, "output") for o in outputs or ()
        ]:
            if name not in among:
                raise ModelError(f"'{self.name}' has no {kind} '{name}'; it has {', '.join(among)}.")
        x = [self.states.index(s) for s in states]
        if outputs is None:
            outputs = [o for o in self.outputs if o not in self.states or o in states]
        y = [self.outputs.index(o) for o in outputs]
        f, b = self.family, self.family.base
        base = LinearSystem(
            tuple(states), b.inputs, tuple(outputs), b.A[np.ix_(x, x)], b.B[x], b.C[np.ix_(y, x)], b.D[y], b.delay,
            b.bias[x], b.y_ref[y],
        )  # fmt: skip
        dA, dB, dC, dD = f.dA[:, x][:, :, x], f.dB[:, x], f.dC[:, y][:, :, x], f.dD[:, y]
        dbias, dy_ref, ddelay = f.dbias[:, x], f.dy_ref[:, y], f.ddelay
        parts = (dA, dB, dC, dD, dbias, dy_ref, ddelay)
        acts = np.any([np.abs(p).reshape(len(f.names), -1).any(axis=1) for p in parts], axis=0)
        names = tuple(n for n, a in zip(f.names, acts) if a)
        family = LinearFamily(
            names, base, dA[acts], dB[acts], dC[acts], dD[acts], dbias[acts], dy_ref[acts], ddelay[acts]
        )
        name = f"{self.name}, {' '.join(states)}"
        return LinearModel(name, family, self.theta[acts], self.condition, self.units, self.notes)

    def modes(self) -> Modes:
        """Its modes, named where the states are the usual ones."""
        return modes(self.system.A, self.states)

    def unit(self, name: str) -> str:
        """Unit of a state, an input, an output or a state's derivative."""
        if not is_known(name) and name.endswith("_dot") and name.removesuffix("_dot") in self.states:
            return self.units.get(name, _UNIT_OF_RATE.get(self.unit(name.removesuffix("_dot")), "?"))
        return unit_of(name, self.units)

    def simulate(
        self,
        inputs: Recording,
        *,
        start: Mapping[str, float] | None = None,
        hold: Hold = "hold",
        noise: Mapping[str, float] | None = None,
        seed: int = 0,
    ) -> Recording:
        """Fly a schedule of inputs.

        Parameters
        ----------
        inputs : Recording
            With the model's inputs, on an even clock; before its first sample each has its first value.
        start : mapping of str to float, optional
            States at the first sample; zero where not named.
        hold : {"hold", "linear"}
            What the inputs do between samples; either is followed exactly.
        noise : mapping of str to float, optional
            Standard deviations of white noise added to channels of the result.
        seed : int
            Of the noise.

        Returns
        -------
        Recording
            The inputs, the outputs, the states no output is named like, and the derivatives of the states
            (``u_dot``, ...), all departures from the reference condition.

        Raises
        ------
        ChannelError, DataError
            An input is missing, or a sample of it is not finite; the clock is not even.
        ModelError
            A start or noise for what the model does not have.
        SimulationError
            The motion grows beyond all bounds; ``.partial`` holds it to where that happens.
        """
        inputs.require(*self.inputs, finite=True, by="simulate")
        dt = _even_step(inputs)
        s = self.system
        if unknown := [k for k in start or {} if k not in s.states]:
            raise ModelError(f"'{self.name}' has no state {', '.join(unknown)}; it has {', '.join(s.states)}.")
        x0 = np.array([(start or {}).get(name, 0.0) for name in s.states])
        u = np.column_stack([inputs[name] for name in s.inputs])
        y, x = simulate_linear(
            s.A, s.B, s.C, s.D, u, dt, delay=s.delay, bias=s.bias, y_ref=s.y_ref, x0=x0, hold=hold, return_states=True
        )  # fmt: skip
        x_dot = x @ s.A.T + previous_input(u, dt, float(s.delay), hold) @ s.B.T + s.bias
        channels = {name: x[:, i] for i, name in enumerate(s.states) if name not in s.outputs}
        channels |= {name: y[:, i] for i, name in enumerate(s.outputs)}
        channels |= {f"{name}_dot": x_dot[:, i] for i, name in enumerate(s.states)}
        rng = np.random.default_rng(seed)
        for name, std in (noise or {}).items():
            if name not in channels:
                raise ModelError(f"'{self.name}' makes no channel '{name}' to add noise to.{suggest(name, channels)}")
            channels[name] = channels[name] + std * rng.standard_normal(len(inputs))
        units = {**inputs.units, **{name: self.unit(name) for name in (*s.inputs, *channels)}}
        note = f"simulate: {self.name}, departures from {_condition(self.condition) or 'the reference condition'}"
        lost = ~np.isfinite(x).all(axis=1)
        if lost.any():
            first = int(lost.argmax())
            begin = {k: v[:first] for k, v in (dict(inputs.channels) | channels).items()}
            partial = Recording(inputs.name, inputs.t[:first], begin, units, (note,)) if first > 1 else None
            worst = float(np.linalg.eigvals(s.A).real.max())
            raise SimulationError(
                f"simulate: '{self.name}' grows beyond all bounds by t = {inputs.t[first]:.4g} s; its fastest growth "
                f"is exp({worst:.4g} t). Check the parameters, simulate a shorter time, or close a loop; the error's "
                "partial holds the motion up to there.",
                partial,
            )
        # Made as it is, unchecked: a simulated control that stands still has not hung.
        return Recording(inputs.name, inputs.t, {**inputs.channels, **channels}, units, (*inputs.provenance, note))

    def to_frame(self) -> pd.DataFrame:
        """One row per parameter."""
        import pandas as pd

        return pd.DataFrame({"parameter": self.family.names, "value": self.theta})

    def to_dict(self) -> dict[str, Any]:
        """Plain types, for JSON."""
        found, s = self.modes(), self.system
        return {
            "name": self.name,
            "condition": dict(self.condition),
            "parameters": self.parameters,
            "states": list(s.states),
            "inputs": list(s.inputs),
            "outputs": list(s.outputs),
            **{key: getattr(s, key).tolist() for key in ("A", "B", "C", "D", "bias", "y_ref", "delay")},
            "modes": [
                {"name": n, "re": float(z.real), "im": float(z.imag)} for n, z in zip(found.names, found.eigenvalues)
            ],
            "notes": list(self.notes),
        }

    def summary(self) -> Summary:
        """States, inputs, outputs, parameters and modes."""
        s = self.system

        def named(names: Sequence[str]) -> str:
            return ", ".join(f"{n} [{self.unit(n)}]" for n in names)

        delay = f", delayed by {float(s.delay):.4g} s" if s.delay else ""
        return Summary(
            self.name,
            _condition(self.condition) if self.condition else "",
            tables=(
                Table((text_column("parameter"), Column("value", "5g")), tuple(self.parameters.items())),
                self.modes().table(),
            ),
            notes=(
                f"states {named(s.states)}",
                f"inputs {named(s.inputs)}{delay}",
                f"outputs {named(s.outputs)}",
                *self.notes,
            ),
        )


def _even_step(inputs: Recording) -> float:
    steps = np.diff(inputs.t)
    dt = float((inputs.t[-1] - inputs.t[0]) / len(steps))
    if np.abs(steps - dt).max() > 1e-3 * dt:
        i = int(np.abs(steps - dt).argmax())
        raise DataError(
            f"simulate needs an even clock; in '{inputs.name}' the step after sample {i} (t = {inputs.t[i]:g} s) is "
            f"{steps[i]:.4g} s, the mean {dt:.4g} s. Give the schedule on an even clock: structsel.inputs.table()."
        )
    return dt


def _condition(condition: Mapping[str, float]) -> str:
    return ", ".join(f"{k} {v:.5g}" + (f" {unit_of(k)}" if unit_of(k) not in ("?", "-") else "") for k, v in
                     condition.items())  # fmt: skip
