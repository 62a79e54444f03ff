"""Limits on the expansion of compressed data, against damaged files and files made to fill the memory."""

from __future__ import annotations

import gzip
from pathlib import Path

MAX_BYTES = 1 << 31
"""Bytes to which data may expand in any case; larger data may expand by `MAX_RATIO` at most."""
MAX_RATIO = 100


def exceeds_expansion_limit(packed: int, expanded: int) -> bool:
    """Whether data expands by more than recordings do."""
    return expanded > MAX_BYTES and expanded > MAX_RATIO * packed


def require_bounded(name: str, packed: int, expanded: int) -> None:
    """Refuse data that exceeds the limit.

    Raises
    ------
    OSError
        The data exceeds the limit; the message states its name and both sizes.
    """
    if exceeds_expansion_limit(packed, expanded):
        raise OSError(
            f"{name} has {packed} bytes and would expand to {expanded}, more than {MAX_RATIO} times as many. "
            "Decompress it with another program and check it"
        )


class BoundedGzip(gzip.GzipFile):
    """A gzip file whose reading stops at the expansion limit.

    Raises
    ------
    OSError
        On reading, if the limit is exceeded.
    """

    def __init__(self, path: Path):
        super().__init__(path, "rb")
        self._packed, self._expanded = path.stat().st_size, 0

    def read(self, size: int | None = -1) -> bytes:
        """Read, as from any file."""
        return self._counted(super().read(size))

    def read1(self, size: int = -1) -> bytes:
        """Read, as from any file."""
        return self._counted(super().read1(size))

    def _counted(self, data: bytes) -> bytes:
        self._expanded += len(data)
        require_bounded("the file", self._packed, self._expanded)
        return data
