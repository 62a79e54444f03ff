"""A selection over more recordings than memory holds: time, peak memory, and a run that is killed and resumed.

    python benchmarks/streaming.py FOLDER --rows 100000000 --kill 0.4 --workers 2,1 --out streaming.md

FOLDER is filled with Parquet manoeuvres (40 bytes a row), unless it holds as many already, and is left for other runs;
remove it afterwards. ``structsel select`` runs in a process of its own. Its result is compared with the truth of the
flights, with the result of the run that was killed, and, for the first recordings, with the result of the same command
without streaming. ``--dask 1,2`` adds runs on clusters of so many processes.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.signal import lfilter
from timing import machine, publish, say, table

CHANNELS = ("alpha", "q_hat", "de", "V_ratio")
OTHERS = ("beta", "p_hat")  # recorded, not among the candidates
TRUTH = {
    "CZ": {"1": -0.25, "alpha": -4.8, "q_hat": -6.0, "de": -0.45, "alpha^3": 9.0},
    "Cm": {"1": 0.03, "alpha": -0.9, "q_hat": -14.0, "de": -1.2, "V_ratio*alpha": 0.15},
}
NOISE = {"CZ": (0.02, 0.92), "Cm": (0.006, 0.85)}  # standard deviation, lag-one correlation
SELECT = [
    "--responses", "CZ,Cm", "--candidates", ",".join(CHANNELS), "--degree", "3", "--f-in", "auto",
    "--no-plots", "--stream",
]  # fmt: skip
DT = 0.02


def manoeuvre(number: int, rows: int) -> pa.Table:
    """One flight: correlated signals about a trim of its own, and two coefficients with coloured residuals."""
    rng = np.random.default_rng([20, number])

    def slow(memory: float, size: float) -> np.ndarray:
        noise = rng.standard_normal(rows) * size * np.sqrt(1.0 - memory**2)
        return np.asarray(lfilter([1.0], [1.0, -memory], noise))

    de = slow(0.98, 0.05)
    alpha = 0.10 + 0.03 * rng.standard_normal() + lfilter([0.05], [1.0, -0.95], -0.6 * de) + slow(0.97, 0.04)
    q_hat = 0.02 * np.gradient(alpha) / DT + slow(0.9, 0.004)
    V_ratio = 1.0 + 0.1 * rng.standard_normal() + slow(0.999, 0.05)
    columns = {"alpha": alpha, "q_hat": q_hat, "de": de, "V_ratio": V_ratio}
    columns |= {"beta": slow(0.98, 0.02), "p_hat": slow(0.95, 0.01)}
    columns = {name: values.astype(np.float32) for name, values in columns.items()}
    exact = {name: values.astype(np.float64) for name, values in columns.items()}
    for response, terms in TRUTH.items():
        total = np.full(rows, terms["1"])
        for term, value in terms.items():
            if term != "1":
                total += value * np.prod([exact[c] ** int(k or 1) for c, _, k in factors(term)], axis=0)
        std, memory = NOISE[response]
        columns[response] = (total + slow(memory, std)).astype(np.float32)
    return pa.table({"t": DT * np.arange(rows), **columns})


def factors(term: str) -> list[tuple[str, str, str]]:
    return [factor.partition("^") for factor in term.split("*")]


def make(folder: Path, rows: int, each: int) -> float:
    """Fill the folder; seconds it took, 0 where it was full."""
    folder.mkdir(parents=True, exist_ok=True)
    count = -(-rows // each)
    if len(list(folder.glob("m*.parquet"))) == count:
        return 0.0
    began = time.perf_counter()
    for number in range(count):
        this = min(each, rows - number * each)
        pq.write_table(manoeuvre(number, this), folder / f"m{number:05d}.parquet", use_dictionary=False)
        if number % 50 == 49:
            say(f"{number + 1} of {count} manoeuvres written")
    return time.perf_counter() - began


# ---------------------------------------------------------------- a run in a process of its own


@dataclass
class Run:
    """What one command took; memory is the largest resident size of the whole process [MiB]."""

    wall: float = 0.0
    cpu: float = 0.0
    memory: float = 0.0
    killed: bool = False
    models: dict[str, dict[str, float]] | None = None


def kill_at(process: int, seconds: float) -> None:
    """SIGKILL a process when it has used so many CPU seconds (Linux)."""
    ticks = os.sysconf("SC_CLK_TCK")
    try:
        while (
            sum(map(int, Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[11:13])) < seconds * ticks
        ):
            time.sleep(0.1)
        os.kill(process, signal.SIGKILL)
    except OSError:
        pass  # it has ended before


def run(command: list[str], out: Path, kill_after: float | None = None) -> Run:
    """Run a command that writes a selection to a folder; SIGKILL after some CPU seconds, if so wished."""
    one = Run()
    environment = dict(os.environ, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
    began = time.perf_counter()
    child = subprocess.Popen(command, stdout=subprocess.DEVNULL, env=environment)
    if kill_after is not None:
        threading.Thread(target=kill_at, args=(child.pid, kill_after), daemon=True).start()
    _, status, usage = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)  # it has been waited for
    one.wall = time.perf_counter() - began
    one.cpu, one.memory = usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0
    one.killed = child.returncode == -signal.SIGKILL
    if child.returncode == 0:
        said = json.loads((out / "selection.json").read_text(encoding="utf-8"))
        one.models = {
            response: {row["term"]: row["value"] for row in found["parameters"]}
            for response, found in said["responses"].items()
        }
    elif not one.killed:
        raise SystemExit(f"{' '.join(command)} ended with exit code {child.returncode}.")
    return one


def select(files: list[str], out: Path, *more: str, kill_after: float | None = None) -> Run:
    shutil.rmtree(out, ignore_errors=True)
    program = [sys.executable, "-c", "from structsel.cli import main; main()", "select"]
    return run([*program, *files, *SELECT, "--out", str(out), *more], out, kill_after)


def on_cluster(folder: Path, out: Path, processes: int) -> Run:
    return run([sys.executable, __file__, str(folder), "--cluster", str(processes), "--work", str(out)], out)


def cluster(folder: Path, out: Path, processes: int) -> None:
    """The selection on a cluster of processes of this machine, in this process."""
    from distributed import Client, LocalCluster

    import structsel as ss

    local = LocalCluster(n_workers=processes, threads_per_worker=1, dashboard_address=None)
    with local, Client(local) as client:
        flights = ss.stream_recordings(folder, client=client)
        pool = ss.Candidates.polynomial(CHANNELS, 3)
        found = ss.select(flights, list(TRUTH), pool, F_in="auto", client=client)
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    (out / "selection.json").write_text(json.dumps(found.to_dict(), default=float), encoding="utf-8")


def difference(a: Run, b: Run) -> float:
    """Largest relative difference of any parameter; infinite where the terms differ."""
    assert a.models is not None
    assert b.models is not None
    worst = 0.0
    for response, left in a.models.items():
        right = b.models[response]
        if set(left) != set(right):
            return float("inf")
        worst = max(worst, *(abs(left[t] - right[t]) / max(abs(left[t]), 1e-30) for t in left))
    return worst


def exact(one: Run) -> str:
    assert one.models is not None
    wrong = [r for r, terms in TRUTH.items() if set(one.models[r]) != set(terms)]
    return (
        "the true terms of both"
        if not wrong
        else f"other terms of {', '.join(wrong)}: " + "; ".join(f"{r} {sorted(one.models[r])}" for r in wrong)
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--rows", type=int, default=100_000_000)
    parser.add_argument("--each", type=int, default=180_000, help="rows of a manoeuvre: an hour at 50 Hz")
    parser.add_argument(
        "--kill", type=float, default=None, help="SIGKILL a run after this fraction of the first's CPU time"
    )
    parser.add_argument("--workers", default="2", help="threads of each run")
    parser.add_argument("--compare", type=int, default=20, help="recordings also selected from in memory")
    parser.add_argument("--dask", default="", help="processes of each run on a cluster")
    parser.add_argument("--work", type=Path, default=None, help="folder of the results")
    parser.add_argument("--out", default=None)
    parser.add_argument("--cluster", type=int, default=0, help=argparse.SUPPRESS)
    a = parser.parse_args()
    folder = a.folder.resolve()
    work = (a.work or folder.with_name(f"{folder.name}_results")).resolve()
    if a.cluster:
        cluster(folder, work, a.cluster)
        return
    seconds = make(folder, a.rows, a.each)
    files = sorted(folder.glob("m*.parquet"))
    held = sum(f.stat().st_size for f in files)
    lines = [f"{a.rows:,} rows in {len(files)} files, {held / 1e9:.2f} GB, {held / a.rows:.1f} bytes a row."]
    if seconds:
        lines.append(f"Made in {seconds:.0f} s.")
    runs: dict[str, Run] = {}
    for workers in map(int, a.workers.split(",")):
        name = f"{workers} thread{'s' if workers > 1 else ''}"
        runs[name] = select([str(folder)], work / name.replace(" ", "_"), "--workers", str(workers))
        say(f"{name}: {runs[name]}")
    first, *_ = runs.values()
    if a.kill is not None:
        workers = a.workers.split(",")[0]
        out = work / "killed"
        (out.with_name("killed.checkpoint")).unlink(missing_ok=True)
        runs["killed"] = select([str(folder)], out, "--workers", workers, kill_after=a.kill * first.cpu)
        kept = out.with_name("killed.checkpoint")
        size = f"{kept.stat().st_size / 2**20:.1f} MiB" if kept.exists() else "not written yet"
        lines.append(f"Checkpoint when killed: {size}.")
        runs["went on"] = select([str(folder)], out, "--workers", workers)
        lines.append(f"Gone when done: {'no' if kept.exists() else 'yes'}.")
        lines.append(
            f"Largest relative difference of a run killed and gone on with: {difference(first, runs['went on']):.1e}."
        )
    for processes in map(int, filter(None, a.dask.split(","))):
        name = f"Dask, {processes} process{'es' if processes > 1 else ''}"
        runs[name] = on_cluster(folder, work / f"dask{processes}", processes)
        lines.append(f"Largest relative difference of {name}: {difference(first, runs[name]):.1e}.")
    if a.compare:
        some = [str(f) for f in files[: a.compare]]
        streamed = select(some, work / "some_streamed")
        complete = select(some, work / "some_held", "--no-stream")
        lines.append(
            f"First {a.compare} recordings, in memory: largest relative error {difference(streamed, complete):.1e}; "
            f"peak {complete.memory:.0f} MiB held, {streamed.memory:.0f} MiB streamed."
        )
    rows = [
        [name, r.wall, r.wall / a.rows * 1e6, r.cpu, f"{r.memory:.0f}", "killed" if r.killed else exact(r)]
        for name, r in runs.items()
    ]
    heads = ["run", "wall s", "wall s a million rows", "CPU s", "peak MiB", "found"]
    publish("\n\n".join([machine(), "\n".join(lines), table(heads, rows)]), a.out)


if __name__ == "__main__":
    main()
