"""States of a model that follow the flight itself, advanced beside the rigid body sample by sample.

Over each sample a state runs straight from its value at the beginning to that at the end. The end is first guessed as
it would be were the rate to stay, the sample flown, the state worked out from what was flown, and the sample flown
again: second order, as the trapezoidal rule.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from structsel.candidates.formulas import Node, evaluate
from structsel.errors import ModelError
from structsel.model import State
from structsel.numerics.flight_dynamics import STATES, SURROUNDINGS, Batch, Flight, FlightPlan, fly_batch, outputs_index
from structsel.simulation.compiling import Formulas

_GUST = SURROUNDINGS.index("u_gust")
_FLOWN = ("V", "alpha", "beta", "rho", "qbar", "mach", "alpha_dot", "beta_dot")


@dataclass(frozen=True, eq=False)
class Following:
    """One state that follows the flight.

    Attributes
    ----------
    name : str
        The control of the plan that holds it.
    state : State
    nodes : mapping of channel to Node
        The state's channels, written in those of a flight and its controls.
    """

    name: str
    state: State
    nodes: Mapping[str, Node]

    @classmethod
    def of(cls, name: str, state: State, formulas: Formulas) -> Following:
        """The state as a flight advances it.

        Raises
        ------
        ModelError
            It is of a kind that cannot be advanced, or follows what a flight does not give.
        """
        if not state.is_linear:
            raise ModelError(
                f"The state '{name}' is a {state.kind} of '{state.input}', which is flown and not given; only lags, "
                "delays and separation can follow the flight itself. Give the channel with the inputs."
            )
        nodes = {}
        for c in state.channels:
            direct = c in (*STATES, *_FLOWN)
            nodes[c] = Node("channel", name=c) if direct else formulas.expand(Node("channel", name=c))
        return cls(name, state, nodes)

    def read(self, held: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Its channels, from those of a flight and its controls."""
        return {c: evaluate(node, held, self.name) for c, node in self.nodes.items()}


def fly_beside(
    plan: FlightPlan,
    flight: Flight,
    following: tuple[Following, ...],
    full: np.ndarray,
    observed: np.ndarray,
    substeps: int,
) -> Batch:
    """Fly parameter sets one after another with states that follow.

    Parameters
    ----------
    plan, flight, substeps
        As `fly_batch`.
    following : tuple of Following
    full : (m, P) array
        Full parameter vectors, without a delay.
    observed : (c,) int array

    Returns
    -------
    Batch
    """
    flown = [_Flyer(plan, flight, following, row, observed, substeps).fly() for row in full]
    outputs, ends, reasons = zip(*flown)
    return Batch(np.stack(outputs), np.array(ends), np.array(reasons))


class _Flyer:
    """One parameter set on its way."""

    def __init__(
        self,
        plan: FlightPlan,
        flight: Flight,
        following: tuple[Following, ...],
        parameters: np.ndarray,
        observed: np.ndarray,
        substeps: int,
    ):
        self.plan, self.flight, self.substeps = plan, flight, substeps
        self.parameters, self.every = parameters.copy(), np.arange(len(parameters))
        self.start = slice(len(plan.term_names), len(plan.term_names) + len(STATES))
        self.width = len(observed)
        self.observed = np.concatenate([observed, outputs_index((*STATES, *_FLOWN))])
        # Held inputs are given as straight lines that do not change, so that states may run straight beside them.
        self.given, self.states = flight.controls, np.zeros((len(flight.t), len(following)))
        self.places = [plan.controls.index(f.name) for f in following]
        self.histories = [_History(f, len(flight.t)) for f in following]
        biases = parameters[self.start.stop + len(STATES) :][: len(plan.controls)]
        self.biases = dict(zip(plan.controls, biases.tolist()))

    def fly(self) -> tuple[np.ndarray, int, int]:
        """Outputs (n, c), samples that hold, and why it ended."""
        n = len(self.flight.t)
        outputs = np.full((n, self.width), np.nan)
        state = self.parameters[self.start]
        for _ in range(2):  # where a state begins may depend, by a rate, on where it begins
            rows, flown, reason = self._sample(0, state)
            if not flown:
                return outputs, 0, reason
            channels = self._channels(0, rows[0])
            self.states[:2] = [history.begin(self.flight.t[0], channels) for history in self.histories]
        for k in range(n - 1):
            self.states[k + 1] = [history.guess() for history in self.histories]
            for _ in range(2):
                rows, flown, reason = self._sample(k, state)
                outputs[k] = rows[0, : self.width]
                if flown < 2:
                    return outputs, k + flown, reason
                channels = self._channels(k + 1, rows[1])
                self.states[k + 1] = [h.advance(k, self.flight.t, channels) for h in self.histories]
            for history in self.histories:
                history.keep()
            state = np.array([channels[c] for c in STATES])
            # What is observed is the motion through the air; what flies on is that through the steady wind here.
            state[:3] += self.flight.surroundings[k + 1, _GUST : _GUST + 3]
        outputs[n - 1] = self._sample(n - 1, state)[0][0, : self.width]
        return outputs, n, 0

    def _sample(self, k: int, state: np.ndarray) -> tuple[np.ndarray, int, int]:
        """Fly from one sample to the next, and from the last as far again."""
        t = self.flight.t
        ends = [k, min(k + 1, len(t) - 1)]
        step = t[ends[1]] - t[k] if ends[1] > k else t[k] - t[k - 1]
        controls = self.given[[k, k] if self.flight.hold else ends].copy()
        controls[:, self.places] = self.states[ends]
        self.parameters[self.start] = state
        window = replace(
            self.flight, t=np.array([t[k], t[k] + step]), controls=controls, hold=False,
            surroundings=self.flight.surroundings[ends], start=state,
        )  # fmt: skip
        flown = fly_batch(
            self.plan, window, self.parameters[None], self.every, self.observed, substeps=self.substeps
        )  # fmt: skip
        return flown.outputs[0], int(flown.flown[0]), int(flown.reason[0])

    def _channels(self, k: int, row: np.ndarray) -> dict[str, float]:
        given = {c: v + self.biases[c] for c, v in zip(self.plan.controls, self.given[k].tolist())}
        return given | dict(zip((*STATES, *_FLOWN), row[self.width :].tolist()))


class _History:
    """What a state has followed so far, and where it is."""

    def __init__(self, following: Following, n: int):
        self.of = following
        self.held = {c: np.zeros(n) for c in following.nodes}
        self.clock, self.x = np.zeros(n), np.zeros(n)
        self.last = self.now = 0.0
        self.value = self.ahead = self.before = 0.0

    def begin(self, t: float, channels: Mapping[str, float]) -> float:
        """At rest at the first sample."""
        self._note(0, channels)
        self.clock[0] = 0.0 if "way" in self.of.state.parameters else t
        self.last = self.x[0]
        self.value = self.before = float(self.of.state.blend(self.x[0], self.last))
        return self.value

    def guess(self) -> float:
        """A sample on, were the rate to stay."""
        return 2.0 * self.value - self.before

    def advance(self, k: int, t: np.ndarray, channels: Mapping[str, float]) -> float:
        """At sample k + 1, of what was flown there."""
        self._note(k + 1, channels)
        clock = self.of.state.clock(t[k : k + 2], {c: x[k : k + 2] for c, x in self.held.items()})
        self.clock[k + 1] = self.clock[k] + clock[1] - clock[0]
        self.now = self.of.state.advance(self.clock[: k + 2], self.x[: k + 2], self.last)
        self.ahead = float(self.of.state.blend(self.x[k + 1], self.now))
        return self.ahead

    def keep(self) -> None:
        """Take what was last worked out as where it is."""
        self.last, self.before, self.value = self.now, self.value, self.ahead

    def _note(self, k: int, channels: Mapping[str, float]) -> None:
        now = self.of.read({c: np.array([v]) for c, v in channels.items()})
        for c, v in now.items():
            self.held[c][k] = v[0]
        self.x[k] = self.of.state.driving(now)[0]
