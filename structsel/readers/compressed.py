"""Compressed data that grows out of all proportion: damaged, or made to fill the memory."""

from __future__ import annotations

import gzip
from pathlib import Path

LARGEST = 1 << 31
"""Bytes that anything may grow to; what is larger must not be more than `MOST` times as large as it was."""
MOST = 100


def grows_too_much(packed: int, grown: int) -> bool:
    """Whether so many bytes cannot be what was recorded."""
    return grown > LARGEST and grown > MOST * packed


def require_bounded(what: str, packed: int, grown: int) -> None:
    """Refuse what `grows_too_much`.

    Raises
    ------
    OSError
        The message says what, and to which size.
    """
    if grows_too_much(packed, grown):
        raise OSError(
            f"{what} takes {packed} bytes and would grow to {grown}, more than {MOST} times as many. "
            "Unpack it by other means and look at it"
        )


class BoundedGzip(gzip.GzipFile):
    """A file under gzip that is read only as long as it `grows_too_much` not.

    Raises
    ------
    OSError
        On reading, where it does.
    """

    def __init__(self, path: Path):
        super().__init__(path, "rb")
        self._packed, self._grown = path.stat().st_size, 0

    def read(self, size: int | None = -1) -> bytes:
        """As of any file."""
        return self._counted(super().read(size))

    def read1(self, size: int = -1) -> bytes:
        """As of any file."""
        return self._counted(super().read1(size))

    def _counted(self, data: bytes) -> bytes:
        self._grown += len(data)
        require_bounded("the file", self._packed, self._grown)
        return data
