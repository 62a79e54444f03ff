"""A text file that another program is still writing: the samples that were added since the last look."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from structsel.errors import DataError
from structsel.readers import read_table
from structsel.readers.channel_map import ChannelMap, FileOptions, load_channel_map
from structsel.recording.reading import load
from structsel.recording.recording import Recording

_KINDS = (".csv", ".txt", ".tsv", ".dat", ".asc")
_FEWEST = 3  # complete lines below the header of the first part


class GrowingFile:
    """Samples of a text file in parts, in the order in which they were written.

    A line counts when its line break is there. The header is that of the first part. Time must be in seconds, not in
    time stamps, which are seconds since the first sample of a part.

    Parameters
    ----------
    path : str or Path
    channel_map : str, Path, mapping or ChannelMap, optional

    Raises
    ------
    DataError
        The file is no text file.
    """

    def __init__(
        self, path: str | Path, channel_map: str | Path | Mapping[str, Any] | ChannelMap | None = None
    ) -> None:
        self.path = Path(path)
        if self.path.suffix.lower() not in _KINDS:
            raise DataError(f"'{path}' cannot be followed: only text files can, {', '.join(_KINDS)}.")
        self._map = None if channel_map is None else load_channel_map(channel_map)
        self._header, self._last_line = b"", b""
        self._place = 0
        self._t = -np.inf

    def read_new(self) -> Recording | None:
        """Samples since the last call, after the last one of that call (a Recording needs two); None without new ones.

        Raises
        ------
        DataError
            The file became shorter, time runs backwards, or whatever reading raises.
        """
        text = self._new_lines()
        if text is None:
            return None
        recording = self._read(self._header + self._last_line + text)
        new = recording.t > self._t
        if self._last_line and new.sum() != len(recording) - 1:
            raise DataError(
                f"'{self.path}': time does not go on after t = {self._t:g} s; the next sample is at "
                f"{recording.t[min(1, len(recording) - 1)]:g} s.\nFollow a file whose time is in seconds and increases."
            )
        self._t = float(recording.t[-1])
        self._last_line = text.splitlines(keepends=True)[-1]
        return recording

    def _new_lines(self) -> bytes | None:
        """Complete lines that are new; None if there are none, or too few for a header and samples."""
        if not self.path.exists():
            return None
        size = self.path.stat().st_size
        if size < self._place:
            raise DataError(f"'{self.path}' became shorter, from {self._place} to {size} bytes; it was written anew.")
        with self.path.open("rb") as stream:
            stream.seek(self._place)
            text = stream.read()
        text = text[: text.rfind(b"\n") + 1]
        if not text.strip():
            return None
        if not self._last_line and not self._found_header(text):
            return None
        if not self._last_line:
            all_text, text = text, text[len(self._header) :]
            self._place += len(all_text)
        else:
            self._place += len(text)
        return text

    def _found_header(self, text: bytes) -> bool:
        """Whether the first part has a header and some samples; its header is kept."""
        if len(text.splitlines()) < _FEWEST + 1:
            return False
        with TemporaryDirectory() as folder:
            copy = Path(folder) / self.path.name
            copy.write_bytes(text)
            first = read_table(copy, self._map.file if self._map is not None else FileOptions()).first_row
        lines = text.splitlines(keepends=True)
        self._header = b"".join(lines[: first - 1])
        return len(lines) - (first - 1) >= _FEWEST

    def _read(self, text: bytes) -> Recording:
        with TemporaryDirectory() as folder:
            copy = Path(folder) / self.path.name
            copy.write_bytes(text)
            return load(copy, self._map, self.path.stem)
