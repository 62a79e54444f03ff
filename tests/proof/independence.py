"""Whether the declared case of an effect is another formula than the effect's own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from proof.scenario.declared import DeclaredEffect, declare, product
from structsel.comparison.flight import Flight
from structsel.effects import Effect
from structsel.numerics.dynamic_elements import delayed, first_order_lag

PLAIN = ("parameter", "sensor")
"""Kinds that are plain terms by nature: there is one way to write them."""
_ALIKE = 0.9999
_EQUAL = 1.0 - 1e-9  # a sum with a small second term is like its first, and no copy
_SUM = "the sum of its terms"
_CHANNELS = ("alpha", "beta", "de", "da", "dr", "df")


def copied_terms(hypothesis: Effect, flights: Sequence[Flight]) -> list[str]:
    """Declared terms, and sums of them, that a column of one of the effect's forms equals, up to a factor.

    Random signals are not compared, nor are effects whose channels the flights lack.

    Parameters
    ----------
    hypothesis : Effect
        With a declared case.
    flights : sequence of Flight
        Prepared, so that both sides are computed from the same channels.

    Returns
    -------
    list of str
        "Cm: alpha*q_hat", ...; empty where the case is independent, or need not be.
    """
    if hypothesis.truth is None or hypothesis.kind in PLAIN or hypothesis.needs(flights):
        return []
    declared = declare(hypothesis.name, hypothesis.kind, hypothesis.truth)
    added = _along(declared, flights)
    copied = []
    for variant in hypothesis.variants(flights):
        columns = [variant.columns(f) for f in flights]
        for (axis, formula), x in added.items():
            held = [c[axis] if axis in c else np.zeros((len(f), len(variant.parameters)))
                    for c, f in zip(columns, flights)]  # fmt: skip
            if any(_alike(x, column, _EQUAL if formula == _SUM else _ALIKE) for column in np.vstack(held).T):
                copied.append(f"{axis}: {formula}")
    return list(dict.fromkeys(copied))


def _along(declared: DeclaredEffect, flights: Sequence[Flight]) -> dict[tuple[str, str], np.ndarray]:
    """Each declared term without noise along all flights, one after another, and the sums by coefficient."""
    made: dict[tuple[str, str], np.ndarray] = {}
    sums: dict[str, np.ndarray] = {}
    values = [_values(f) | _following(declared, f) for f in flights]
    for axis, factors, value in declared.terms:
        if not {name for name, _ in factors} & set(declared.noise):
            text = "*".join(f"{name}^{power}" if power > 1 else name for name, power in factors)
            x = np.concatenate([np.broadcast_to(product(factors, v), len(f)) for v, f in zip(values, flights)])
            made[axis, text] = x
            sums[axis] = sums.get(axis, 0.0) + value * x
    return made | {(axis, _SUM): x for axis, x in sums.items() if len(declared.truth.terms[axis]) > 1}


def _following(declared: DeclaredEffect, f: Flight) -> dict[str, np.ndarray]:
    """Lags and delays along a prepared flight."""
    values = _values(f)
    return {
        s.name: delayed(values[s.of], f.dt, s.delay)
        if s.delay
        else first_order_lag(values[s.of], f.dt, s.time_constant)
        for s in declared.following
    }


def _values(f: Flight) -> dict[str, np.ndarray]:
    """Variables of formulas along a prepared flight."""
    qbar = 0.5 * f["rho"] * f["V"] ** 2
    made = {"1": np.ones(len(f)), "CT": f["thrust"] / (qbar * f.aircraft.S)}
    made |= {name: f[name] if name in f.channels else np.zeros(len(f)) for name in _CHANNELS}
    lengths = {"p": f.aircraft.b, "q": f.aircraft.cbar, "r": f.aircraft.b}
    made |= {f"{rate}_hat": f[rate] * length / (2.0 * f["V"]) for rate, length in lengths.items()}
    made |= {f"abs_{name}": np.abs(made[name]) for name in ("alpha", "beta", "de", "da", "dr")}
    made["CL"] = f.simulated["CX"] * np.sin(f["alpha"]) - f.simulated["CZ"] * np.cos(f["alpha"])
    return made


def _alike(x: np.ndarray, y: np.ndarray, least: float) -> bool:
    """Whether two regressors are one up to a factor: their cosine is 1."""
    size = float(np.linalg.norm(x) * np.linalg.norm(y))
    return size > 0.0 and abs(float(x @ y)) > least * size
