"""How manoeuvres are cut into blocks: enough of them to resample, not more than memory has room for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from structsel.numerics.noise_models import ARNoise
from structsel.numerics.passes import Part, Piece
from structsel.numerics.rows import Signals

ROOM = 64 << 20  # bytes of second moments kept apart, per response
FEWEST, MOST = 48, 512  # blocks that manoeuvres are bound into, however many or few candidates there are


@dataclass(frozen=True)
class Block:
    """Samples ``start`` to ``stop`` of manoeuvre ``manoeuvre``."""

    manoeuvre: int
    start: int
    stop: int


@dataclass(frozen=True)
class Cut:
    """Manoeuvres cut into blocks, or bound together into them.

    Attributes
    ----------
    blocks : tuple of tuple of Block
        The stretches each block is made of: one, or several whole manoeuvres that follow each other.
    """

    blocks: tuple[tuple[Block, ...], ...]

    @property
    def first(self) -> NDArray[np.int64]:
        """(B,) the first manoeuvre of each block."""
        return np.array([block[0].manoeuvre for block in self.blocks])

    @property
    def last(self) -> NDArray[np.int64]:
        """(B,) the last manoeuvre of each block."""
        return np.array([block[-1].manoeuvre for block in self.blocks])

    @property
    def samples(self) -> int:
        """Samples in all."""
        return int(self.n().sum())

    def n(self, reach: Sequence[int] | None = None) -> NDArray[np.int64]:
        """(B,) samples of each block, those left out with which a filter of this reach starts on a manoeuvre."""
        return np.array(
            [
                sum(max(b.stop - max(b.start, reach[b.manoeuvre] if reach else 0), 0) for b in block)
                for block in self.blocks
            ]
        )

    def parts(self, manoeuvres: Sequence[Signals], colours: Sequence[Sequence[ARNoise]] = ()) -> list[Part]:
        """The blocks with their data, and with the colours of every response in every manoeuvre."""
        return [
            [Piece(manoeuvres[b.manoeuvre], b.start, b.stop, tuple(of[b.manoeuvre] for of in colours)) for b in block]
            for block in self.blocks
        ]


def most_blocks(p: int) -> int:
    """Blocks of second moments of p candidates that there is room for."""
    return min(max(FEWEST, ROOM // (4 * (p + 2) * (p + 3))), MOST)


def cut_blocks(lengths: Sequence[int], wanted: int, p: int) -> Cut:
    """Cut manoeuvres into about ``wanted`` blocks in all; where there are too many of them, bind some together.

    Parameters
    ----------
    lengths : sequence of int
        Samples of each manoeuvre.
    wanted : int
    p : int
        Candidates.
    """
    if len(lengths) <= most_blocks(p):
        return Cut(tuple((block,) for block in split_blocks(lengths, wanted)))
    return bind_blocks(lengths, most_blocks(p))


def whole_manoeuvres(lengths: Sequence[int]) -> Cut:
    """Every manoeuvre in one block, or very many bound together: for what must see a manoeuvre from its start."""
    if len(lengths) <= MOST:
        return Cut(tuple((Block(k, 0, n),) for k, n in enumerate(lengths)))
    return bind_blocks(lengths, MOST)


def split_blocks(lengths: Sequence[int], wanted: int, shortest: int = 64) -> list[Block]:
    """Cut manoeuvres into about ``wanted`` blocks in all, at least one each and none needlessly short."""
    total = sum(lengths)
    blocks = []
    for k, n in enumerate(lengths):
        pieces = max(1, min(round(wanted * n / max(total, 1)), n // shortest))
        edges = np.linspace(0, n, pieces + 1).round().astype(int)
        blocks += [Block(k, int(a), int(b)) for a, b in pairwise(edges)]
    return blocks


def bind_blocks(lengths: Sequence[int], most: int) -> Cut:
    """Whole manoeuvres in at most ``most`` blocks of about as many samples each; none is cut."""
    ends = np.cumsum(lengths)
    middle = ends - np.asarray(lengths) / 2.0
    of = np.minimum((middle / ends[-1] * most).astype(int), most - 1)
    groups = [np.flatnonzero(of == g).tolist() for g in np.unique(of)]
    return Cut(tuple(tuple(Block(k, 0, lengths[k]) for k in group) for group in groups))
