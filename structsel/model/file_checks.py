"""Contradictions in the content of model.json that a schema cannot see."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

_ROUNDING = 1e-6
"""Relative difference that is not a contradiction: numbers written by structsel agree to the last bit, numbers written
by hand may have six digits."""
_NO_VARIANCE = 1e-12
"""Of the square of a value: rounding can push the variance of an exact fit so far below zero."""


class ObjectPairs(dict[str, Any]):
    """A JSON object that remembers the keys that occur twice."""

    def __init__(self, pairs: list[tuple[str, Any]]):
        super().__init__(pairs)
        names = [name for name, _ in pairs]
        self.twice = tuple(name for name in dict.fromkeys(names) if names.count(name) > 1)


def find_duplicate_keys(content: Any, place: str = "") -> Iterator[str]:
    """Sentences on the objects of a file that contain a key twice."""
    if isinstance(content, ObjectPairs):
        where = f"in {place}" if place else "at the top"
        yield from (f"the key '{name}' occurs twice {where}" for name in content.twice)
        for name, value in content.items():
            yield from find_duplicate_keys(value, f"{place}.{name}" if place else name)
    elif isinstance(content, list):
        for i, value in enumerate(content):
            yield from find_duplicate_keys(value, f"{place}.{i}")


def find_contradictions(responses: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Sentences on the numbers of a response that cannot be true together; each names response and term."""
    for name, fields in responses.items():
        where = f"response '{name}'"
        terms = fields["terms"]
        if fields["r2"] is not None and fields["r2"] > 1.0 + _ROUNDING:
            yield f"{where}: r2 is {fields['r2']:g}. R2 cannot exceed 1"
        if fields["s2"] is not None and fields["s2"] < 0.0:
            yield f"{where}: s2, a variance, is {fields['s2']:g}"
        errors = fields["standard_errors"]
        for term, error in zip(terms, errors or ()):
            if error is not None and error < 0.0:
                yield f"{where}, term '{term}': the standard error is {error:g}. It cannot be negative"
        covariance = fields["covariance"]
        if covariance is not None and [len(row) for row in covariance] == [len(terms)] * len(terms):
            yield from _of_covariance(where, fields, np.array(covariance).reshape(len(terms), -1))


def _of_covariance(where: str, fields: Mapping[str, Any], covariance: np.ndarray) -> Iterator[str]:
    """Sentences on a covariance (k, k): variances, symmetry, correlations, standard errors."""
    terms, errors, variances = fields["terms"], fields["standard_errors"], np.diag(covariance)
    for term, value, variance in zip(terms, fields["values"], variances):
        if variance < 0.0 and np.sqrt(-variance) > np.sqrt(_NO_VARIANCE) * abs(value):
            yield f"{where}, term '{term}': the variance in the covariance is {variance:g}. It cannot be negative"
            return
    std = np.sqrt(np.maximum(variances, 0.0))
    size = np.outer(std, std)
    for i, j in np.argwhere(np.triu(np.abs(covariance - covariance.T) > _ROUNDING * size, 1))[:1]:
        yield (
            f"{where}, terms '{terms[i]}' and '{terms[j]}': the covariance is not symmetric, {covariance[i, j]:g} and "
            f"{covariance[j, i]:g}"
        )
        return
    for i, j in np.argwhere(np.triu(np.abs(covariance) - size > _ROUNDING * size, 1))[:1]:
        yield (
            f"{where}, terms '{terms[i]}' and '{terms[j]}': their covariance {covariance[i, j]:g} exceeds the product "
            f"of their standard deviations, {size[i, j]:g}"
        )
    for term, error, stated in zip(terms, errors or (), std):
        # Larger is possible: a selection widens the errors of the terms that it chose.
        if error is not None and error < (1.0 - _ROUNDING) * stated:
            yield (
                f"{where}, term '{term}': the standard error {error:g} is smaller than the covariance states, "
                f"{stated:g}"
            )
            return
