"""Program of the process that `structsel.readers.isolated` starts; to start quickly, it imports nothing of structsel.

A request is a tuple of format, path, processor time [s] and memory [bytes]. The answer is a tuple of a status ("read",
"memory" or "error") and the content of the file, or the message of the error. Both travel as JSON, followed by the
bytes of the arrays: nothing that a damaged file leads to is ever executed on the other side.
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
import struct
import sys
from collections.abc import Callable
from importlib import import_module
from types import SimpleNamespace
from typing import IO, Any

import numpy as np

_PLAIN = "biufcSUmM"  # kinds of arrays that are passed on with their values
_HEADER = 3  # bytes of a DataFlash message: the magic and the type of the message
_PADDING = 528  # bytes without a message that an intact DataFlash log may end with, as in pymavlink
DATAFLASH_TYPES = {
    "a": ("(32,)<i2", 1), "b": ("<i1", 1), "B": ("<u1", 1), "g": ("<f2", 1), "h": ("<i2", 1), "H": ("<u2", 1),
    "i": ("<i4", 1), "I": ("<u4", 1), "f": ("<f4", 1), "d": ("<f8", 1), "M": ("<u1", 1), "q": ("<i8", 1),
    "Q": ("<u8", 1), "n": ("S4", 1), "N": ("S16", 1), "Z": ("S64", 1), "c": ("<i2", 100), "C": ("<u2", 100),
    "e": ("<i4", 100), "E": ("<u4", 100), "L": ("<i4", 10_000_000),
}  # fmt: skip
"""For each character of a DataFlash format: the type, and the divisor of the number."""


def read_matlab(path: str) -> dict[str, Any]:
    """Variables of a MATLAB file, structs as nested mappings."""
    from pymatreader import read_mat

    return {name: _plain(value) for name, value in read_mat(path).items() if not name.startswith("__")}


def read_hdf5(path: str) -> tuple[dict[str, Any], dict[str, list[str]]]:
    """Datasets of an HDF5 file as nested mappings; texts of the attributes ``unit`` and ``units``, by dotted path."""
    import h5py

    units: dict[str, list[str]] = {}

    def walk(group: Any, prefix: str) -> dict[str, Any]:
        content: dict[str, Any] = {}
        for name, member in group.items():
            if isinstance(member, h5py.Group):
                content[name] = walk(member, f"{prefix}{name}.")
            elif isinstance(member, h5py.Dataset) and member.shape is not None:
                content[name] = _plain(np.asarray(member[()]))
                texts = [member.attrs.get(attribute) for attribute in ("unit", "units")]
                texts = [text.decode() if isinstance(text, bytes) else text for text in texts]
                units[f"{prefix}{name}"] = [text for text in texts if isinstance(text, str)]
        return content

    with h5py.File(path, "r") as stream:
        return walk(stream, ""), units


def _plain(value: Any) -> Any:
    """A value without objects that other processes cannot load; text and numbers are unchanged."""
    if isinstance(value, dict):
        return {str(name): _plain(member) for name, member in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(member) for member in value]
    if isinstance(value, np.ndarray):
        return np.asarray(value) if value.dtype.kind in _PLAIN else np.empty(value.shape, dtype=object)
    return value if isinstance(value, str | bytes | bool | int | float | complex | np.generic) else None


def read_ulog(path: str) -> SimpleNamespace:
    """Topics, dropouts and faults of a ULog, by the names of pyulog."""
    import pyulog

    with open(path, "rb") as stream:
        log = pyulog.ULog(stream)
    fields = ("name", "multi_id", "timestamp_idx", "data")
    return SimpleNamespace(
        data_list=[SimpleNamespace(**{field: getattr(topic, field) for field in fields}) for topic in log.data_list],
        dropouts=[dropout.duration for dropout in log.dropouts],
        file_corruption=bool(log.file_corruption),
        has_data_appended=bool(log.has_data_appended),
    )


def read_dataflash(path: str) -> SimpleNamespace:
    """Messages of a DataFlash log: for each name its format and a structured array; and faults of the file."""
    from pymavlink import DFReader

    class Index(DFReader.DFReader_binary):  # type: ignore[name-defined, misc]
        def init_clock(self) -> None:
            """No search for the time of day, which takes many times as long in a log without GPS."""

    with Index(path) as log:
        return SimpleNamespace(messages=_dataflash_messages(log), faults=_dataflash_faults(log))


def _dataflash_messages(log: Any) -> dict[str, tuple[SimpleNamespace, np.ndarray]]:
    """Each format of a log with its messages, at the positions that pymavlink found."""
    found: dict[str, tuple[SimpleNamespace, np.ndarray]] = {}
    content = np.frombuffer(log.data_map[:], dtype=np.uint8)
    for number, fmt in log.formats.items():
        size = struct.calcsize(fmt.msg_struct)
        at = np.asarray(log.offsets[number], dtype=np.int64) + _HEADER
        at = at[at + size <= len(content)]
        if not len(at) or len(fmt.columns) != len(fmt.msg_fmts):
            continue
        kinds = np.dtype([(name, DATAFLASH_TYPES[kind][0]) for name, kind in zip(fmt.columns, fmt.msg_fmts)])
        rows = np.lib.stride_tricks.sliding_window_view(content, size)[at].view(kinds)[:, 0]
        fields = ("columns", "msg_fmts", "units", "instance_field")
        found[fmt.name] = SimpleNamespace(**{field: getattr(fmt, field) for field in fields}), rows
    return found


def _dataflash_faults(log: Any) -> tuple[str, ...]:
    there = {number: fmt.len for number, fmt in log.formats.items() if len(log.offsets[number])}
    end = max((int(log.offsets[number][-1]) + size for number, size in there.items()), default=0)
    if end > log.data_len:
        return ("the log ends within a message, as when power was lost; it is read up to there",)
    lost = log.data_len - sum(size * len(log.offsets[number]) for number, size in there.items())
    if lost > _PADDING:
        return (f"the log is damaged: {lost} of its {log.data_len} bytes belong to no readable message",)
    return ()


def read_mdf(path: str) -> SimpleNamespace:
    """Channels of an MDF file: columns, the time column and the stated unit of each, and the unusable channels."""
    asammdf: Any = import_module("asammdf")

    found = SimpleNamespace(columns={}, clocks={}, stated={}, unusable={})
    with asammdf.MDF(path) as content:
        for g, group in enumerate(content.groups):
            master = content.masters_db.get(g)
            clock = f"t (group {g + 1})" if len(content.groups) > 1 else "t"
            for c, channel in enumerate(group.channels):
                if c == master:
                    continue
                taken = {*found.columns, *found.unusable, clock}
                name = channel.name if channel.name not in taken else f"{channel.name} (group {g + 1})"
                signal = content.get(group=g, index=c, ignore_invalidation_bits=True)
                values = np.asarray(signal.samples)
                if values.dtype.kind not in "biuf" or values.ndim != 1 or master is None or not len(values):
                    why = "no times" if master is None else f"of type {values.dtype}, {len(values)} samples"
                    found.unusable[name] = why
                    continue
                invalid = getattr(signal, "invalidation_bits", None)
                if invalid is not None:
                    values = np.where(np.asarray(invalid), np.nan, values)
                if clock not in found.columns:
                    found.columns[clock], found.clocks[clock] = np.asarray(signal.timestamps), clock
                found.columns[name], found.clocks[name] = values, clock
                found.stated[name] = str(signal.unit).strip() if signal.unit else None
    return found


READERS: dict[str, tuple[str, Callable[[str], Any]]] = {
    "mat": ("pymatreader", read_matlab),
    "h5": ("h5py", read_hdf5),
    "ulg": ("pyulog", read_ulog),
    "bin": ("pymavlink.DFReader", read_dataflash),
    "mdf": ("asammdf", read_mdf),
}
"""For each format the package, which is imported before the limits are set, and the function that reads a file."""


def send(stream: IO[bytes], value: Any) -> None:
    """Write a value to a stream: the length of its JSON, the JSON, and the bytes of its arrays."""
    arrays: list[np.ndarray] = []
    text = json.dumps(_encoded(value, arrays)).encode()
    stream.write(struct.pack("<Q", len(text)))
    stream.write(text)
    for array in arrays:
        stream.write(array.tobytes())
    stream.flush()


def receive(stream: IO[bytes]) -> Any:
    """Read the value that `send` wrote.

    Raises
    ------
    EOFError
        The stream ends before.
    """
    (size,) = struct.unpack("<Q", _exactly(stream, 8))
    return _decoded(json.loads(_exactly(stream, size)), stream)


def _exactly(stream: IO[bytes], size: int) -> bytearray:
    content = bytearray(size)
    view, at = memoryview(content), 0
    while at < size:
        count = stream.readinto(view[at:])  # type: ignore[attr-defined]
        if not count:
            raise EOFError
        at += count
    return content


def _encoded(value: Any, arrays: list[np.ndarray]) -> Any:
    """JSON of a value; each of its arrays is appended to the list, and stands as its type and shape."""
    match value:
        case None | bool() | str():
            return value
        case np.ndarray() | np.generic():
            array = np.asarray(value)
            if array.dtype.hasobject:  # without its values, which `_plain` has left out
                return {"object": list(array.shape)}
            arrays.append(array)
            kind = np.lib.format.dtype_to_descr(array.dtype)
            return {"array": [kind, list(array.shape), isinstance(value, np.generic)]}
        case int() | float():
            return value
        case complex():
            return {"complex": [value.real, value.imag]}
        case bytes():
            return {"bytes": base64.b64encode(value).decode()}
        case SimpleNamespace():
            return {"namespace": _encoded(vars(value), arrays)}
        case dict():
            return {"dict": [[_encoded(k, arrays), _encoded(v, arrays)] for k, v in value.items()]}
        case tuple():
            return {"tuple": [_encoded(member, arrays) for member in value]}
    return [_encoded(member, arrays) for member in value]


def _decoded(value: Any, stream: IO[bytes]) -> Any:
    """Value of its JSON, with the arrays read in the order in which they stand."""
    if isinstance(value, list):
        return [_decoded(member, stream) for member in value]
    if not isinstance(value, dict):
        return value
    ((kind, content),) = value.items()
    match kind:
        case "object":
            return np.empty(content, dtype=object)
        case "array":
            kind, shape, scalar = content
            return _array(kind, shape, scalar, stream)
        case "complex":
            return complex(*content)
        case "bytes":
            return base64.b64decode(content)
        case "namespace":
            return SimpleNamespace(**_decoded(content, stream))
        case "dict":
            return {_decoded(k, stream): _decoded(v, stream) for k, v in content}
    return tuple(_decoded(member, stream) for member in content)


def _array(kind: Any, shape: list[int], scalar: bool, stream: IO[bytes]) -> Any:
    fields: Any = kind
    if not isinstance(kind, str):
        fields = [tuple(tuple(x) if isinstance(x, list) else x for x in field) for field in kind]
    dtype = np.lib.format.descr_to_dtype(fields)
    content = _exactly(stream, dtype.itemsize * int(np.prod(shape, dtype=np.int64)))
    array = np.frombuffer(content, dtype=dtype).reshape(shape)
    return array[()] if scalar else array


def limit(seconds: float, memory: int) -> None:
    """Let the system end this process after this processor time, and limit its memory."""
    with contextlib.suppress(ImportError):  # not on Windows
        import resource

        used = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
        for what, value in ((resource.RLIMIT_CPU, int(used + seconds) + 1), (resource.RLIMIT_AS, memory)):
            highest = resource.getrlimit(what)[1]
            soft = value if highest == resource.RLIM_INFINITY else min(value, highest)
            resource.setrlimit(what, (soft, highest))


def answer(kind: str, path: str, seconds: float = 0.0, memory: int = 0) -> tuple[str, Any]:
    """Status and content, or status and message; without limits if the memory is zero."""
    try:
        package, read = READERS[kind]
        import_module(package)
        if memory:
            limit(seconds, memory)
        return "read", read(path)
    except MemoryError:
        return "memory", ""
    except Exception as error:
        return "error", str(error).strip() or type(error).__name__


def main() -> None:
    """Answer requests until there are no more."""
    stream = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # the readers print messages
    send(stream, "ready")
    while True:
        try:
            request = receive(sys.stdin.buffer)
        except EOFError:
            return
        send(stream, answer(*request))


if __name__ == "__main__":
    main()
