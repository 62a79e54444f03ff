"""Modes of a linear system: frequency, damping and times of its eigenvalues, and their names.

``control.damp`` gives frequencies, damping and poles; the names (short period, phugoid, Dutch roll, ...) are ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from structsel.errors import DomainError
from structsel.formatting import format_number
from structsel.tables import Cell, Column, Table, text_column

# Motion that each state belongs to, by its name.
_LONGITUDINAL = {"u": "speed", "V": "speed", "w": "heave", "alpha": "heave", "q": "pitch", "theta": "attitude"}
_LATERAL = {"v": "sway", "beta": "sway", "p": "roll", "r": "yaw", "phi": "bank", "psi": "heading"}


_COLUMNS = (
    text_column("mode"),
    Column("real 1/s", "5f"),
    Column("imag 1/s", "5f"),
    Column("rad/s"),
    Column("damping", "4f"),
    Column("T s", "3g"),
    Column("half s"),
    Column("period s", "3g"),
)


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of a linear system: one row per real eigenvalue or conjugate pair, the fastest first.

    Attributes
    ----------
    names : tuple of str
    eigenvalues : (k,) complex array [1/s]
        Of a pair, the one with positive imaginary part.
    frequency : (k,) array [rad/s]
        Natural frequency |eigenvalue|.
    damping : (k,) array [-]
        Ratio -Re / |eigenvalue|: 1 for a real decay, below zero where unstable.
    time_constant : (k,) array [s]
        -1 / Re; below zero where unstable.
    time_to_half, time_to_double : (k,) array [s]
        ln 2 / |Re|, of the amplitude; nan for the one that does not apply.
    period : (k,) array [s]
        nan for a real eigenvalue.
    participation : (k, ns) array [-]
        Participation factor of each state, independent of the states' units; rows add to 1.
    states : tuple of str
    """

    names: tuple[str, ...]
    eigenvalues: np.ndarray
    frequency: np.ndarray
    damping: np.ndarray
    time_constant: np.ndarray
    time_to_half: np.ndarray
    time_to_double: np.ndarray
    period: np.ndarray
    participation: np.ndarray
    states: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.names)

    def table(self) -> Table:
        """One row for each mode; an unstable mode has a time to double."""
        rows = []
        for i, z in enumerate(self.eigenvalues):
            half, double = self.time_to_half[i], self.time_to_double[i]
            when = format_number(half, 3) if np.isfinite(half) else f"{format_number(double, 3)} double"
            name = Cell(self.names[i], "bad" if z.real > 0.0 else "")
            rows.append(
                (name, z.real, z.imag or None, self.frequency[i], self.damping[i], self.time_constant[i],
                 when if z.real else None, self.period[i])
            )  # fmt: skip
        return Table(_COLUMNS, tuple(rows))

    def __str__(self) -> str:
        return self.table().to_text()


def modes(A: np.ndarray, states: Sequence[str] = ()) -> Modes:
    """Eigenvalues of A with frequency, damping, times and, for the usual states, names.

    Longitudinal states are u or V, w or alpha, q, theta; lateral ones v or beta, p, r, phi, psi. Names follow the
    participation factors (products of left and right eigenvectors, independent of units):
    the pair of angle of attack and pitch rate is the short period, that of speed and attitude the phugoid; the pair of
    sideslip and yaw the Dutch roll, and the real ones of roll rate and bank the roll subsidence and the spiral.

    Parameters
    ----------
    A : (ns, ns) array
    states : sequence of str
        Names of the states; without them, or with others, modes are "oscillation" and "aperiodic".

    Returns
    -------
    Modes

    Raises
    ------
    DomainError
        A is not square or not finite, or the names are not as many.
    """
    A = np.asarray(A, dtype=float)
    if A.ndim != 2 or A.shape[0] != A.shape[1] or not np.isfinite(A).all():
        raise DomainError(f"modes needs one square matrix of finite numbers; found shape {A.shape}.")
    if states and len(states) != len(A):
        raise DomainError(f"modes was given {len(states)} names for {len(A)} states.")
    values, left, right = scipy.linalg.eig(A, left=True, right=True)
    participation = np.abs(left * right)
    participation = (participation / np.maximum(participation.sum(axis=0), np.finfo(float).tiny)).T
    upper = values.imag >= 0.0
    order = np.argsort(-np.abs(values[upper]), kind="stable")
    values, participation = values[upper][order], participation[upper][order]
    real = values.real
    with np.errstate(divide="ignore", invalid="ignore"):
        T = -1.0 / real
        amplitude = np.log(2.0) / np.abs(real)
        frequency = np.abs(values)
        damping = np.where(frequency > 0.0, -real / frequency, 0.0)
        period = np.where(values.imag > 0.0, 2.0 * np.pi / values.imag, np.nan)
    return Modes(
        names=_names(values, participation, tuple(states)),
        eigenvalues=values,
        frequency=frequency,
        damping=damping,
        time_constant=T,
        time_to_half=np.where(real < 0.0, amplitude, np.nan),
        time_to_double=np.where(real > 0.0, amplitude, np.nan),
        period=period,
        participation=participation,
        states=tuple(states),
    )


def _names(values: np.ndarray, participation: np.ndarray, states: tuple[str, ...]) -> tuple[str, ...]:
    for motions, name in ((_LONGITUDINAL, _longitudinal), (_LATERAL, _lateral)):
        if states and all(s in motions for s in states):
            kinds = np.array([motions[s] for s in states])
            return tuple(name(values, {k: participation[:, kinds == k].sum(axis=1) for k in motions.values()}))
    return tuple("oscillation" if z.imag else "aperiodic" for z in values)


def _longitudinal(values: np.ndarray, participation: dict[str, np.ndarray]) -> list[str]:
    short = participation["heave"] + participation["pitch"] - participation["speed"] - participation["attitude"]
    pairs = np.flatnonzero(values.imag > 0.0)
    names = [f"{kind} aperiodic" for kind in _strongest(participation)]
    for i in pairs:
        names[i] = "short period" if short[i] > 0.0 else "phugoid"
    if len(pairs) == 2:  # whatever the participation, one is each
        names[pairs[np.argmax(short[pairs])]] = "short period"
        names[pairs[np.argmin(short[pairs])]] = "phugoid"
    return names


def _lateral(values: np.ndarray, participation: dict[str, np.ndarray]) -> list[str]:
    usual = {"sway": "sway aperiodic", "roll": "roll", "yaw": "yaw aperiodic", "bank": "spiral", "heading": "heading"}
    names = [usual[kind] for kind in _strongest(participation)]
    pairs = np.flatnonzero(values.imag > 0.0)
    rolling = participation["roll"] + participation["bank"] - participation["sway"] - participation["yaw"]
    for i in pairs:
        names[i] = "Dutch roll"
    if len(pairs) == 2:
        names[pairs[np.argmax(rolling[pairs])]] = "roll-spiral"
    rest = [i for i in np.flatnonzero(values.imag == 0.0) if names[i] != "heading"]
    if len(rest) == 2 and len(pairs) == 1:  # the fast one rolls, the slow one spirals
        names[rest[0]], names[rest[1]] = "roll", "spiral"
    return names


def _strongest(participation: dict[str, np.ndarray]) -> list[str]:
    kinds = list(participation)
    return [kinds[i] for i in np.array([participation[kind] for kind in kinds]).argmax(axis=0)]
