"""Detectability of each effect in these recordings."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.signatures import Library, Signature
from structsel.nomenclature import COEFFICIENTS

_NAMED = 24.0  # expected log Bayes factor of an effect that would be named
_CLOSEST = 3


def self_test(problem: DiagnosisProblem, library: Library) -> dict[str, dict[str, float]]:
    """Smallest size at which each effect would be named, and the effects that are most similar to it.

    The clearest form of each effect is added to these manoeuvres, without noise, at the size at which its log Bayes
    factor over the tolerances is `_NAMED`. The most similar effects are those that leave least of it.

    Parameters
    ----------
    problem : DiagnosisProblem
        Without effects in the model.
    library : Library

    Returns
    -------
    mapping of effect to mapping
        ``size``: rms of the effect over the measured rms, in its clearest coefficient; ``nats against NAME``: log Bayes
        factor over each of the most similar effects.
    """
    forms = []
    for hypothesis in library.effects:
        tried = [(s, _strength(problem, s)) for s in library.of(hypothesis.name)]
        forms.append(max(tried, key=lambda item: item[1]))
    k = len(problem.nuisances)
    scale = problem.base.scales[problem.base.chosen][:k]
    each = [np.column_stack([r.whiten(s.spectra[i], s.width) for s, _ in forms]) for i, r in enumerate(problem.rows)]
    cross = scale[:, None] * np.sum([B[:, :k].T @ H for B, H in zip(problem.base.given, each)], axis=0)
    own = scale[:, None] * problem.base.total.A[:k, :k] * scale
    S = np.sum([H.T @ H for H in each], axis=0) - cross.T @ np.linalg.solve(np.eye(k) + own, cross)
    at = np.concatenate([[0], np.cumsum([s.width for s, _ in forms])])
    parts = [slice(a, b) for a, b in pairwise(at)]
    made: dict[str, dict[str, float]] = {}
    for (signature, _), mine in zip(forms, parts):
        power, direction = np.linalg.eigh(S[mine, mine])
        if power[-1] <= 1e-9:
            continue
        scale = np.sqrt(2.0 * (_NAMED + 0.5 * np.log1p(power[-1])) / power[-1])
        theta = scale * direction[:, -1]
        found = {"size": _size(problem, signature, theta)}
        gains = []
        for (similar, _), other in zip(forms, parts):
            if similar is not signature:
                cross = S[other, mine] @ theta
                left = theta @ S[mine, mine] @ theta - cross @ np.linalg.solve(
                    np.eye(similar.width) * 1e-2 + S[other, other], cross
                )
                gains.append((0.5 * float(left), similar.hypothesis.name))
        found |= {f"nats against {name}": value for value, name in sorted(gains)[:_CLOSEST]}
        made[signature.hypothesis.name] = found
    return made


def _strength(problem: DiagnosisProblem, signature: Signature) -> float:
    """Sum of squares of one prior standard deviation of each parameter, in units of the noise."""
    total = 0.0
    for r, spectra in zip(problem.rows, signature.spectra):
        for c, x in spectra.items():
            rows = (x.T * r.weight[c]).ravel()
            total += float(rows @ rows)
    return total


def _size(problem: DiagnosisProblem, signature: Signature, theta: np.ndarray) -> float:
    """Rms of an effect over the measured rms, in the coefficient where it is largest."""
    best = 0.0
    for c in problem.responses:
        if c not in COEFFICIENTS and not problem.is_plant:
            continue
        up = down = 0.0
        for f, spectra in zip(problem.flights, signature.spectra):
            if c in spectra:
                up += float(np.sum((spectra[c][1:] @ theta) ** 2))
            down += float(np.var(f.measured[c]) * len(f))
        best = max(best, np.sqrt(up / down) if down > 0.0 else 0.0)
    return float(best)
