"""Where a result came from: versions, and the files that went in."""

from __future__ import annotations

import hashlib
import platform
import re
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from structsel.files import path_text


def provenance_of(files: Iterable[str | Path] = ()) -> dict[str, Any]:
    """What made a result, for the result to carry.

    It holds neither date nor host, so that the same input gives the same result to the last bit.

    Parameters
    ----------
    files : iterable of path
        What was read.

    Returns
    -------
    dict
        ``versions``: of structsel, Python, NumPy and SciPy. ``inputs``: each ``file`` once, with its ``sha256``, None
        where it can no longer be read.
    """
    paths = dict.fromkeys(map(Path, files))
    return {
        "versions": versions(),
        "inputs": [{"file": path_text(path), "sha256": sha256_of(path)} for path in paths],
    }


_ORIGIN = re.compile(r"read from '(.*?)'(?: through '.*')?$")


def file_of(notes: Iterable[str]) -> Path | None:
    """File that a recording was read from, by the notes of its provenance; the last, where it was written between."""
    found = [m for note in notes if (m := _ORIGIN.match(note))]
    return Path(found[-1][1]) if found else None


def versions() -> dict[str, str]:
    """Versions of structsel and of what it computes with."""
    return {
        "structsel": version("structsel"),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
    }


def sha256_of(path: Path) -> str | None:
    """SHA-256 of a file, in hexadecimal digits; None where it cannot be read."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError:
        return None
