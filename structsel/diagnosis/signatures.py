"""Signatures of every form of every effect for some flights, as spectra."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from structsel.comparison.flight import Flight
from structsel.comparison.noise import bins_of, edge_of
from structsel.effects.base import Effect, Variant
from structsel.numerics.arrays import Array
from structsel.numerics.fourier_series import spectrum

_FAINT = 1e-6  # rms of a signature over that of the differences, below which it is not used
_TAIL = 0.05
"""Power of an effect relative to its largest in any flight, up to which it does not act in another one: from there its
size would be extrapolated by a factor of more than four."""

_AT_ONCE = 16  # forms that are transformed together

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
    switched : tuple of (Effect, forms)
        Those that may be on in parts of the flights, as they are when they are on.
    """

    signatures: tuple[Signature, ...]
    not_testable: Mapping[str, str]
    switched: tuple[tuple[Effect, Sequence[Variant]], ...] = ()

    def may_name(self, effect: str) -> bool:
        """Whether an effect may be a finding, whether these flights can test it or not."""
        return effect in self.not_testable or effect in {
            e.name for e in (*self.effects, *(e for e, _ in self.switched))
        }

    def of(self, effect: str) -> list[Signature]:
        """Forms of one effect."""
        return [s for s in self.signatures if s.hypothesis.name == effect]

    @property
    def effects(self) -> list[Effect]:
        """Effects with a signature, each once."""
        return list({s.hypothesis.name: s.hypothesis for s in self.signatures}.values())


def spectra_of(variants: Sequence[Variant], flight: Flight, responses: Sequence[str]) -> list[dict[str, Array]]:
    """Spectra of variants on one flight, scaled by their priors; without those that are zero."""
    added = [{c: x for c, x in v.columns(flight).items() if c in responses and x.any()} for v in variants]
    columns = [x.T for one in added for x in one.values()]
    if not columns:
        return [{} for _ in variants]
    together = spectrum(np.concatenate(columns).T, bins_of(flight), edge_of(flight))
    together *= np.array([p.sd for v, one in zip(variants, added) for _ in one for p in v.parameters])
    ends = iter(np.cumsum([len(x) for x in columns]))
    return [{c: together[:, (end := next(ends)) - x.shape[1] : end] for c, x in one.items()} for one in added]


def acting(spectra: Sequence[Mapping[str, Array]], flights: Sequence[Flight]) -> frozenset[str]:
    """Flights on which an effect acts: more than the tails of what it does in another one."""
    powers = [{c: float(np.vdot(x.T, x.T)) for c, x in one.items()} for one in spectra]  # rows of it are contiguous
    largest = {c: max(power.get(c, 0.0) for power in powers) for c in {c for power in powers for c in power}}
    return frozenset(
        f.name for f, power in zip(flights, powers) if any(x > _TAIL * largest[c] for c, x in power.items())
    )


def each_spectra(
    variants: Sequence[Variant], flights: Sequence[Flight], responses: Sequence[str]
) -> Iterator[list[dict[str, Array]]]:
    """Spectra of each variant on all flights, as by `spectra_of`."""
    # Not in threads: the jobs are small, and would wait for each other.
    for first in range(0, len(variants), _AT_ONCE):
        some = variants[first : first + _AT_ONCE]
        yield from map(list, zip(*(spectra_of(some, f, responses) for f in flights)))


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
    switched = []
    for hypothesis in effects:
        lacking = hypothesis.needs(flights)
        variants = [] if lacking else list(hypothesis.variants(flights))
        forms = [] if lacking or hypothesis.switched is None else list(hypothesis.switched(flights))
        if forms:
            switched.append((hypothesis, forms))
        elif not variants:
            refused[hypothesis.name] = lacking or "motion that would show it"
        jobs += [(hypothesis, v) for v in variants]
    size = {c: max(float(np.std(f.difference[c])) for f in flights) for c in responses}

    found: list[Signature] = []
    tell = progress or (lambda what, done, of: None)
    for done, ((hypothesis, variant), made) in enumerate(
        zip(jobs, each_spectra([v for _, v in jobs], flights, responses))
    ):
        if any(float(np.abs(x).max()) > _FAINT * size[c] for part in made for c, x in part.items()):
            found.append(Signature(hypothesis, variant, made, acting(made, flights)))
        if done % _AT_ONCE == 0 or done == len(jobs) - 1:
            tell("signatures", done + 1, len(jobs))
    seen = {s.hypothesis.name for s in found} | {e.name for e, _ in switched}
    refused |= {h.name: "motion that would show it" for h, _ in jobs if h.name not in seen}
    return Library(tuple(found), refused, tuple(switched))
