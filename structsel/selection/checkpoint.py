"""Results of passes kept in a file, so that a run that was broken off goes on where it was.

The file is a zip archive of NumPy arrays and one JSON document, never pickle. A selection is the same arithmetic every
time: passes over the data in a fixed order, and between them algebra on what they made. So it is enough to keep what
the passes made of every part; a run that goes on repeats the algebra and does only the parts that are missing.
"""

from __future__ import annotations

import json
import shutil
import struct
import time
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Any
from zipfile import ZIP_STORED, BadZipFile, ZipFile

import numpy as np
from filelock import FileLock, Timeout
from numpy.typing import NDArray

from structsel.atomic import replacing
from structsel.errors import DataError
from structsel.numerics.arrays import Array

SCHEMA = "structsel.checkpoint/1"
SECONDS = 10.0  # between two writings, at least
SHARE = 20.0  # times as long as the last writing took

_UNREADABLE = (
    BadZipFile, KeyError, ValueError, TypeError, OSError, EOFError, RecursionError, RuntimeError, MemoryError,
    struct.error, zlib.error,
)  # fmt: skip


class Checkpoint:
    """The memory of one selection; a `structsel.numerics.passes.Memory`.

    Parameters
    ----------
    path : Path
        Gone on with if it is there.
    identity : str
        Of data and options.

    Raises
    ------
    DataError
        The file is another selection's, of another schema or none of ours, another run is using it, or it cannot be
        written.
    """

    def __init__(self, path: Path, identity: str):
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
            for stale in path.parent.glob(f".{path.name}.*.partial"):  # of a run that was killed as it wrote
                stale.unlink(missing_ok=True)
            self._finished = self._read_about() if path.exists() else 0
            self._begun = self._finished + (self._member(self._finished, "done") in self._members())
        except BaseException:
            self.release()
            raise
        self._at = -1
        self._current: tuple[Array, NDArray[np.bool_]] | None = None
        self._written, self._took = time.monotonic(), 0.0

    def begin(self, edges: NDArray[np.int64]) -> tuple[Array, NDArray[np.bool_]]:
        """Results of the next pass, as far as they are there."""
        self._at += 1
        values, done = np.zeros(edges[-1]), np.zeros(edges.size - 1, dtype=bool)
        if self._at < self._begun:
            kept, was_done = self._read(self._at, "values"), self._read(self._at, "done")
            if kept.shape != values.shape or was_done.shape != done.shape:
                raise self._damaged("it holds results of another length")
            values, done = kept, was_done.astype(bool)
        self._current = values, done
        return values, done

    def tick(self) -> None:
        """Write what there is, if the last writing was long enough ago."""
        if time.monotonic() - self._written > max(SECONDS, SHARE * self._took):
            self._write()

    def end(self) -> None:
        """Write the pass, and let go of it."""
        if self._at >= self._finished:
            self._finished = self._at + 1
            self._write()
        self._current = None

    def remove(self) -> None:
        """Remove the file: the selection is made."""
        self.path.unlink(missing_ok=True)

    def release(self) -> None:
        """Let others use the file, and go on with it."""
        self._lock.release()
        with suppress(OSError):
            Path(self._lock.lock_file).unlink(missing_ok=True)

    @staticmethod
    def _member(number: int, what: str) -> str:
        return f"pass{number:03d}.{what}.npy"

    def _write(self) -> None:
        began = time.monotonic()
        assert self._current is not None
        values, done = self._current
        done = done.copy()  # first: what others go on writing meanwhile is not called done
        about = {"schema": SCHEMA, "identity": self.identity, "finished": self._finished}
        try:
            with replacing(self.path) as partial, ZipFile(partial, "w", ZIP_STORED) as archive:
                archive.writestr("about.json", json.dumps(about))
                self._copy_finished(archive)
                for what, array in (("values", values), ("done", done)):
                    with archive.open(self._member(self._at, what), "w", force_zip64=True) as stream:
                        np.lib.format.write_array(stream, array, allow_pickle=False)
        except OSError as error:
            raise self._unwritable(error) from error
        self._written = time.monotonic()
        self._took = self._written - began

    def _copy_finished(self, archive: ZipFile) -> None:
        """Passes that are over go from file to file, not through memory."""
        if self._at == 0:
            return
        with ZipFile(self.path) as before:
            for number in range(self._at):
                for what in ("values", "done"):
                    name = self._member(number, what)
                    with before.open(name) as old, archive.open(name, "w", force_zip64=True) as new:
                        shutil.copyfileobj(old, new, 1 << 20)

    def _members(self) -> list[str]:
        if not self.path.exists():
            return []
        with ZipFile(self.path) as archive:
            return archive.namelist()

    def _read_about(self) -> int:
        try:
            with ZipFile(self.path) as archive:
                about: dict[str, Any] = json.loads(archive.read("about.json"))
                schema, identity, finished = str(about["schema"]), str(about["identity"]), int(about["finished"])
        except _UNREADABLE as error:
            raise self._damaged("it is no checkpoint") from error
        family, _, version = schema.partition("/")
        if schema != SCHEMA:
            newer = family == SCHEMA.partition("/")[0] and version.isdecimal()
            why = f"was written by another version of structsel ({schema}; this one reads {SCHEMA})"
            raise DataError(
                f"checkpoint '{self.path}' {why if newer else 'is no checkpoint of a selection'}.\n"
                "Go on with the version that wrote it, or remove the file and start anew."
            )
        if identity != self.identity:
            raise DataError(
                f"checkpoint '{self.path}' belongs to other data or other options.\n"
                "Ask for what was asked for then, name another file, or remove this one and start anew."
            )
        return finished

    def _read(self, number: int, what: str) -> NDArray[Any]:
        try:
            with ZipFile(self.path) as archive, archive.open(self._member(number, what)) as stream:
                return np.lib.format.read_array(stream, allow_pickle=False)
        except _UNREADABLE as error:
            raise self._damaged(f"its {self._member(number, what)} cannot be read") from error

    def _damaged(self, why: str) -> DataError:
        return DataError(f"checkpoint '{self.path}': {why}. Remove the file and start anew.")

    def _unwritable(self, error: OSError) -> DataError:
        return DataError(f"checkpoint '{self.path}' cannot be written: {error.strerror or error}.")
