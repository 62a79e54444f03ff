"""Measuring tools of the benchmarks: CPU seconds, wall seconds, and peak memory of a child process.

Ratios, not seconds, are what the benchmarks report: numerator and denominator are timed in one process, turn and
turn about, so that a busy machine slows both. CPU seconds count every thread of the process.
"""

from __future__ import annotations

import ctypes
import gc
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

HERE = Path(__file__).resolve().parent
MEBI = 2**20


def say(text: str) -> None:
    """One line of progress, on stderr so that stdout holds the tables alone."""
    print(f"[{time.strftime('%H:%M:%S')}] {text}", file=sys.stderr, flush=True)


def one_blas_thread() -> threadpool_limits:
    """Context in which numpy, scipy and the peers' BLAS and OpenMP keep to one thread."""
    return threadpool_limits(limits=1)


@dataclass(frozen=True)
class Times:
    """CPU and wall seconds of repeated calls of one function."""

    cpu: tuple[float, ...]
    wall: tuple[float, ...]

    @property
    def cpu_median(self) -> float:
        return median(self.cpu)

    @property
    def wall_median(self) -> float:
        return median(self.wall)


def measure(functions: Mapping[str, Callable[[], Any]], repeats: int = 5, warm: bool = True) -> dict[str, Times]:
    """Time several functions turn and turn about; garbage is collected before each call, not inside it."""
    cpu: dict[str, list[float]] = {name: [] for name in functions}
    wall: dict[str, list[float]] = {name: [] for name in functions}
    if warm:
        for function in functions.values():
            function()
    for _ in range(repeats):
        for name, function in functions.items():
            gc.collect()
            gc.disable()
            w, c = time.perf_counter(), time.process_time()
            result = function()
            cpu[name].append(time.process_time() - c)
            wall[name].append(time.perf_counter() - w)
            gc.enable()
            del result
    return {name: Times(tuple(cpu[name]), tuple(wall[name])) for name in functions}


def measure_once(function: Callable[[], Any]) -> tuple[float, float, Any]:
    """CPU seconds, wall seconds and the result of a single call (slow peers)."""
    gc.collect()
    w, c = time.perf_counter(), time.process_time()
    result = function()
    return time.process_time() - c, time.perf_counter() - w, result


def free_memory() -> float:
    """Memory the machine has free for new arrays [MiB]; infinite where the system does not say."""
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) / 1024.0
    except OSError:
        pass
    return float("inf")


def _status(key: str) -> float:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(key + ":"):
            return int(line.split()[1]) / 1024.0
    raise KeyError(key)


def peak_above_now(function: Callable[[], Any]) -> float:
    """Peak resident memory of a call above what was resident when it began [MiB] (Linux).

    Freed heap is first returned to the system and the kernel's high-water mark reset, or it would hide the
    call's own use. What the first call loads (code, compiled kernels, BLAS buffers) counts unless the caller
    warmed up on a small problem.
    """
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5")
    before = _status("VmRSS")
    function()
    return max(0.0, _status("VmHWM") - before)


def in_child(module: str, function: str, arguments: Mapping[str, Any], timeout: float | None = None) -> Any:
    """Call ``module.function(**arguments)`` in a fresh interpreter; arguments and result pass as JSON."""
    code = (
        f"import json, sys; sys.path.insert(0, {str(HERE)!r}); import {module} as m; "
        f"print('RESULT ' + json.dumps(m.{function}(**json.loads(sys.argv[1]))))"
    )
    environment = dict(os.environ, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", MKL_NUM_THREADS="1")
    done = subprocess.run(
        [sys.executable, "-c", code, json.dumps(dict(arguments))],
        capture_output=True,
        text=True,
        env=environment,
        timeout=timeout,
        check=False,
    )
    for line in done.stdout.splitlines():
        if line.startswith("RESULT "):
            return json.loads(line[7:])
    last = done.stderr.strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
    raise RuntimeError(f"the child process of {module}.{function} gave no result: {last[0]}")


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A markdown table; floats are written with three significant digits."""

    def cell(value: object) -> str:
        if isinstance(value, (float, np.floating)):
            return "-" if np.isnan(value) else f"{value:.3g}"
        return str(value)

    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(cell(value) for value in row) + " |" for row in rows]
    return "\n".join(lines)


def machine() -> str:
    """One line on what the figures were measured with."""
    import scipy

    cpu = platform.processor() or platform.machine()
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                cpu = line.split(":", 1)[1].strip()
                break
    except OSError:
        pass
    return (
        f"{cpu}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; Python {platform.python_version()}, "
        f"numpy {np.__version__}, scipy {scipy.__version__}"
    )


def publish(text: str, out: str | None) -> None:
    """Print a report, and write it to a file when one is named."""
    print(text, flush=True)
    if out:
        Path(out).parent.mkdir(parents=True, exist_ok=True)
        Path(out).write_text(text + "\n", encoding="utf-8")
