"""Manoeuvres cut into blocks of samples: enough blocks to resample, limited by memory."""

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
MIN_BLOCKS, MAX_BLOCKS = 48, 512  # blocks that manoeuvres are joined into, however many or few candidates there are
SHORTEST = 64  # samples of a segment


class Segment(NamedTuple):
    """Samples ``start`` to ``stop`` of manoeuvre number ``manoeuvre``."""

    manoeuvre: int
    start: int
    stop: int


Block = tuple[Segment, ...]
"""One segment, or several complete manoeuvres that follow each other."""


@dataclass(frozen=True)
class Samples:
    """A segment with its data, and the noise models of the responses where they are known."""

    source: DataSource
    start: int
    stop: int
    noise: tuple[ARNoise, ...] = ()


def max_blocks(p: int) -> int:
    """Blocks of cross-products of p candidates that there is room for."""
    return min(max(MIN_BLOCKS, ROOM // (4 * (p + 2) * (p + 3))), MAX_BLOCKS)


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
    if len(lengths) <= max_blocks(p):
        return [(segment,) for segment in split_manoeuvres(lengths, wanted)]
    return join_manoeuvres(lengths, max_blocks(p))


def complete_manoeuvres(lengths: Sequence[int]) -> list[Block]:
    """Every manoeuvre in a block of its own, very many joined: for what must see a manoeuvre from its start."""
    if len(lengths) <= MAX_BLOCKS:
        return [(Segment(k, 0, n),) for k, n in enumerate(lengths)]
    return join_manoeuvres(lengths, MAX_BLOCKS)


def split_manoeuvres(lengths: Sequence[int], wanted: int) -> list[Segment]:
    """Cut manoeuvres into about ``wanted`` segments in all, at least one each and none shorter than necessary."""
    total = sum(lengths)
    segments = []
    for k, n in enumerate(lengths):
        pieces = max(1, min(round(wanted * n / max(total, 1)), n // SHORTEST))
        edges = np.linspace(0, n, pieces + 1).round().astype(int)
        segments += [Segment(k, int(a), int(b)) for a, b in pairwise(edges)]
    return segments


def join_manoeuvres(lengths: Sequence[int], limit: int) -> list[Block]:
    """Complete manoeuvres in at most ``limit`` blocks of about as many samples each; none is cut."""
    ends = np.cumsum(lengths)
    middle = ends - np.asarray(lengths) / 2.0
    of = np.minimum((middle / ends[-1] * limit).astype(int), limit - 1)
    groups = [np.flatnonzero(of == g).tolist() for g in np.unique(of)]
    return [tuple(Segment(k, 0, lengths[k]) for k in group) for group in groups]


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
