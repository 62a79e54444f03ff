"""Results of complete passes in a file, so that an interrupted selection continues after the last of them.

The file is a NumPy archive (npz): the array of each pass and one JSON document, never pickle. A selection is the same
arithmetic every time: passes over the data in a fixed order, and algebra on their results. So it is enough to keep
the results; a run that continues repeats the algebra and makes only the passes that are missing.
"""

from __future__ import annotations

import json
import shutil
import struct
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Any
from zipfile import ZIP_STORED, BadZipFile, ZipFile

import numpy as np

from structsel.errors import DataError
from structsel.files import replacing
from structsel.numerics.arrays import Array

SCHEMA = "structsel.checkpoint/2"
_ABOUT = "about.json"

_UNREADABLE = (
    BadZipFile, KeyError, ValueError, TypeError, OSError, EOFError, RecursionError, RuntimeError, MemoryError,
    struct.error, zlib.error,
)  # fmt: skip


class Checkpoint:
    """The passes of one selection that are complete; a `structsel.numerics.blocks.PassStore`.

    Parameters
    ----------
    path : Path
        Continued from if it is there.
    identity : str
        Of data and options.

    Raises
    ------
    DataError
        The file is another selection's, of another schema or none of ours, another run is using it, or it cannot be
        written.
    """

    def __init__(self, path: Path, identity: str):
        from filelock import FileLock, Timeout

        self.path, self.identity = path, identity
        self._lock = FileLock(path.with_name(f".{path.name}.lock"), timeout=0)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._lock.acquire()
        except Timeout as error:
            raise DataError(
                f"checkpoint '{path}' is in use by another run. Wait until it has ended, or name another file."
            ) from error
        except OSError as error:
            raise self._unwritable(error) from error
        try:
            for stale in path.parent.glob(f".{path.name}.*.partial"):  # of a run that was killed while it wrote
                stale.unlink(missing_ok=True)
            self._complete = self._read_count() if path.exists() else 0
        except BaseException:
            self.release()
            raise
        self._next = 0

    def load(self, size: int) -> Array | None:
        """Result of the next pass, (size,), if it is there."""
        number, self._next = self._next, self._next + 1
        if number >= self._complete:
            return None
        name = _member(number)
        try:
            with ZipFile(self.path) as archive, archive.open(name) as stream:
                result: Array = np.lib.format.read_array(stream, allow_pickle=False)
        except _UNREADABLE as error:
            raise self._damaged(f"its {name} cannot be read") from error
        if result.shape != (size,) or result.dtype != float:
            raise self._damaged("it holds results of another length")
        return result

    def save(self, result: Array) -> None:
        """Add the result of the pass that the last `load` requested."""
        about = {"schema": SCHEMA, "identity": self.identity}
        try:
            with replacing(self.path) as partial:
                if self.path.exists():
                    shutil.copyfile(self.path, partial)
                with ZipFile(partial, "a", ZIP_STORED) as archive:
                    if not archive.namelist():
                        archive.writestr(_ABOUT, json.dumps(about))
                    with archive.open(_member(self._next - 1), "w", force_zip64=True) as stream:
                        np.lib.format.write_array(stream, result, allow_pickle=False)
        except OSError as error:
            raise self._unwritable(error) from error

    def remove(self) -> None:
        """Remove the file: the selection is complete."""
        self.path.unlink(missing_ok=True)

    def release(self) -> None:
        """Let other runs use the file, and continue from it."""
        self._lock.release()
        with suppress(OSError):
            Path(self._lock.lock_file).unlink(missing_ok=True)

    def _read_count(self) -> int:
        """Number of passes in the file."""
        try:
            with ZipFile(self.path) as archive:
                about: dict[str, Any] = json.loads(archive.read(_ABOUT))
                schema, identity = str(about["schema"]), str(about["identity"])
                passes = [name for name in archive.namelist() if name != _ABOUT]
        except _UNREADABLE as error:
            raise self._damaged("it is no checkpoint") from error
        family, _, version = schema.partition("/")
        if schema != SCHEMA:
            ours = family == SCHEMA.partition("/")[0] and version.isdecimal()
            why = f"was written by another version of structsel ({schema}; this one reads {SCHEMA})"
            raise DataError(
                f"checkpoint '{self.path}' {why if ours else 'is no checkpoint of a selection'}.\n"
                "Continue with the version that wrote it, or remove the file and start anew."
            )
        if identity != self.identity:
            raise DataError(
                f"checkpoint '{self.path}' belongs to other data or other options.\n"
                "Repeat the earlier call, name another file, or remove this one and start anew."
            )
        if passes != [_member(number) for number in range(len(passes))]:
            raise self._damaged("passes are missing")
        return len(passes)

    def _damaged(self, why: str) -> DataError:
        return DataError(f"checkpoint '{self.path}': {why}. Remove the file and start anew.")

    def _unwritable(self, error: OSError) -> DataError:
        return DataError(f"checkpoint '{self.path}' cannot be written: {error.strerror or error}.")


def _member(number: int) -> str:
    return f"pass{number:03d}.npy"
