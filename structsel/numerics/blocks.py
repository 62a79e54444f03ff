"""Manoeuvres cut into blocks of samples: enough blocks to resample, no more than memory has room for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.noise_models import ARNoise
from structsel.numerics.regressors import DataSource

ROOM = 64 << 20  # bytes of cross-products kept apart, per response
FEWEST, MOST = 48, 512  # blocks that manoeuvres are joined into, however many or few candidates there are
SHORTEST = 64  # samples


class Stretch(NamedTuple):
    """Samples ``start`` to ``stop`` of manoeuvre number ``manoeuvre``."""

    manoeuvre: int
    start: int
    stop: int


Block = tuple[Stretch, ...]
"""One stretch, or several whole manoeuvres that follow each other."""


@dataclass(frozen=True)
class Samples:
    """A stretch with its data, and the noise models of the responses where they are known."""

    source: DataSource
    start: int
    stop: int
    noise: tuple[ARNoise, ...] = ()


def most_blocks(p: int) -> int:
    """Blocks of cross-products of p candidates that there is room for."""
    return min(max(FEWEST, ROOM // (4 * (p + 2) * (p + 3))), MOST)


def cut_blocks(lengths: Sequence[int], wanted: int, p: int) -> list[Block]:
    """Cut manoeuvres into about ``wanted`` blocks in all; join very many into as many as there is room for.

    Parameters
    ----------
    lengths : sequence of int
        Samples of each manoeuvre.
    wanted : int
    p : int
        Candidates.
    """
    if len(lengths) <= most_blocks(p):
        return [(stretch,) for stretch in split_manoeuvres(lengths, wanted)]
    return join_manoeuvres(lengths, most_blocks(p))


def whole_manoeuvres(lengths: Sequence[int]) -> list[Block]:
    """Every manoeuvre in a block of its own, very many joined: for what must see a manoeuvre from its start."""
    if len(lengths) <= MOST:
        return [(Stretch(k, 0, n),) for k, n in enumerate(lengths)]
    return join_manoeuvres(lengths, MOST)


def split_manoeuvres(lengths: Sequence[int], wanted: int) -> list[Stretch]:
    """Cut manoeuvres into about ``wanted`` stretches in all, at least one each and none needlessly short."""
    total = sum(lengths)
    stretches = []
    for k, n in enumerate(lengths):
        pieces = max(1, min(round(wanted * n / max(total, 1)), n // SHORTEST))
        edges = np.linspace(0, n, pieces + 1).round().astype(int)
        stretches += [Stretch(k, int(a), int(b)) for a, b in pairwise(edges)]
    return stretches


def join_manoeuvres(lengths: Sequence[int], most: int) -> list[Block]:
    """Whole manoeuvres in at most ``most`` blocks of about as many samples each; none is cut."""
    ends = np.cumsum(lengths)
    middle = ends - np.asarray(lengths) / 2.0
    of = np.minimum((middle / ends[-1] * most).astype(int), most - 1)
    groups = [np.flatnonzero(of == g).tolist() for g in np.unique(of)]
    return [tuple(Stretch(k, 0, lengths[k]) for k in group) for group in groups]


def count_samples(blocks: Sequence[Block], reach: Sequence[int] | None = None) -> NDArray[np.int64]:
    """(B,) samples of each block, without those with which a filter of this reach starts on each manoeuvre."""
    return np.array(
        [sum(max(s.stop - max(s.start, reach[s.manoeuvre] if reach else 0), 0) for s in block) for block in blocks]
    )


def attach_data(
    blocks: Sequence[Block], manoeuvres: Sequence[DataSource], noise: Sequence[Sequence[ARNoise]] = ()
) -> list[list[Samples]]:
    """The blocks with their data, and with the noise model of every response in every manoeuvre."""
    return [
        [Samples(manoeuvres[s.manoeuvre], s.start, s.stop, tuple(of[s.manoeuvre] for of in noise)) for s in block]
        for block in blocks
    ]
