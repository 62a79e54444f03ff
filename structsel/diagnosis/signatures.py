"""Signatures of every form of every effect for some flights, as spectra."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from structsel.comparison.flight import Flight
from structsel.comparison.noise import bins_of, edge_of
from structsel.effects.base import Effect, Variant
from structsel.numerics.arrays import Array
from structsel.numerics.fourier_series import spectrum

_FAINT = 1e-6  # rms of a signature over that of the differences, below which it is not used

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class Signature:
    """One form of one effect on all flights.

    Attributes
    ----------
    hypothesis : Effect
    variant : Variant
    spectra : sequence of mapping of response to (bins, k) array
        Per flight; scaled by the priors' standard deviations.
    flights : frozenset of str
        Names of those on which it acts.
    """

    hypothesis: Effect
    variant: Variant
    spectra: Sequence[Mapping[str, Array]]
    flights: frozenset[str]

    @property
    def width(self) -> int:
        """Number of linear parameters."""
        return len(self.variant.parameters)

    @property
    def responses(self) -> set[str]:
        """Responses on which it acts in any flight."""
        return {c for one in self.spectra for c in one}


@dataclass(frozen=True)
class Library:
    """Effects that these flights can test, and those that they cannot.

    Attributes
    ----------
    signatures : tuple of Signature
    not_testable : mapping of effect to what it needs
    """

    signatures: tuple[Signature, ...]
    not_testable: Mapping[str, str]

    def of(self, effect: str) -> list[Signature]:
        """Forms of one effect."""
        return [s for s in self.signatures if s.hypothesis.name == effect]

    @property
    def effects(self) -> list[Effect]:
        """Effects with a signature, each once."""
        return list({s.hypothesis.name: s.hypothesis for s in self.signatures}.values())


def spectra_of(variant: Variant, flight: Flight, responses: Sequence[str]) -> dict[str, Array]:
    """Spectra of a variant on one flight, scaled by its priors; without those that are zero."""
    bins, edge = bins_of(flight), edge_of(flight)
    added = {c: x for c, x in variant.columns(flight).items() if c in responses and x.any()}
    if not added:
        return {}
    together = spectrum(np.concatenate([x.T for x in added.values()]).T, bins, edge)
    together *= np.tile([p.sd for p in variant.parameters], len(added))
    return dict(zip(added, np.split(together, len(added), axis=1)))


def work_out(
    effects: Sequence[Effect],
    flights: Sequence[Flight],
    responses: Sequence[str],
    progress: Progress | None = None,
) -> Library:
    """Signatures of all effects that these flights can test.

    Parameters
    ----------
    effects : sequence of Effect
    flights : sequence of Flight
    responses : sequence of str
    progress : callable, optional
    """
    refused: dict[str, str] = {}
    jobs: list[tuple[Effect, Variant]] = []
    for hypothesis in effects:
        lacking = hypothesis.needs(flights)
        variants = [] if lacking else list(hypothesis.variants(flights))
        if not variants:
            refused[hypothesis.name] = lacking or "motion that would show it"
        jobs += [(hypothesis, v) for v in variants]
    size = {c: max(float(np.std(f.difference[c])) for f in flights) for c in responses}

    def one(hypothesis: Effect, variant: Variant) -> Signature | None:
        made = [spectra_of(variant, f, responses) for f in flights]
        seen = any(float(np.abs(x).max()) > _FAINT * size[c] for part in made for c, x in part.items())
        return (
            Signature(hypothesis, variant, made, frozenset(f.name for f, x in zip(flights, made) if x))
            if seen
            else None
        )

    found: list[Signature] = []
    tell = progress or (lambda what, done, of: None)
    # One by one: the jobs are small, and threads would wait for each other.
    for done, made in enumerate(one(*job) for job in jobs):
        if made is not None:
            found.append(made)
        if done % 16 == 0 or done == len(jobs) - 1:
            tell("signatures", done + 1, len(jobs))
    seen = {s.hypothesis.name for s in found}
    refused |= {h.name: "motion that would show it" for h, _ in jobs if h.name not in seen}
    return Library(tuple(found), refused)
