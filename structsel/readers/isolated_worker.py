"""The process that `structsel.readers.isolated` starts; to be there at once, it imports nothing of structsel."""

import contextlib
import json
import os
import sys
from collections.abc import Callable

import h5py
import numpy as np
from pymatreader import read_mat


def read_hdf5(path: str) -> None:
    """Read every dataset that a walk over the groups comes to, and what attributes say of units."""
    with h5py.File(path, "r") as stream:
        _walk(stream)


def _walk(group: h5py.Group) -> None:
    for member in group.values():
        if isinstance(member, h5py.Group):
            _walk(member)
        elif isinstance(member, h5py.Dataset) and member.shape is not None:
            np.asarray(member[()])
            for attribute in ("unit", "units"):
                member.attrs.get(attribute)


READ: dict[str, Callable[[str], object]] = {"mat": read_mat, "h5": read_hdf5}


def limit(seconds: float, memory: int) -> None:
    """Let the system end this process after so much processor time, and give it no more memory."""
    with contextlib.suppress(ImportError):  # there are systems without limits
        import resource

        used = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
        for what, most in ((resource.RLIMIT_CPU, int(used + seconds) + 1), (resource.RLIMIT_AS, memory)):
            highest = resource.getrlimit(what)[1]
            soft = most if highest == resource.RLIM_INFINITY else min(most, highest)
            resource.setrlimit(what, (soft, highest))


def main() -> None:
    """Answer a line of JSON each, what to read as and which file, until there are no more."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # readers print
    answers.write("ready\n")
    answers.flush()
    for line in sys.stdin:
        kind, path, seconds, memory = json.loads(line)
        limit(seconds, memory)
        try:
            READ[kind](path)
            told = "read"
        except MemoryError:
            told = "memory"
        except Exception as error:
            told = " ".join(str(error).split()) or type(error).__name__
        answers.write(f"{told}\n")
        answers.flush()


if __name__ == "__main__":
    main()
