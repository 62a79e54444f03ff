"""Time and memory of a selection against one ``X.T @ X`` of the same candidates, and against the peers.

    python benchmarks/selection.py --samples 20000,200000,2000000 --degrees 3,4 --out selection.md

The floor is numpy's ``X.T @ X``, float64, X given and column-major, one BLAS thread. structsel starts from the
signals; peers are given X, centred and scaled. Jobs are timed in `--repeats` rounds. A ratio of CPU seconds is the
median over the rounds of the ratio within a round, because a busy machine slows one round's jobs alike. Peers with
a goal run at `--peer-samples`, the others at `--other-peer-samples`. Memory is the peak above the signals, in a
process of its own. Goals S1 to S6 are judged at the end, if their sizes were run. With `--out` the report and a
`.json` file are written after every measurement; `--continue` resumes an interrupted run.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from functools import partial
from os import getloadavg
from pathlib import Path
from statistics import median

import workloads as w
from cases import monomials
from methods import complete_fit, cross_products_of
from peers import Peer, peers_named
from timing import free_memory, machine, measure, measure_once, one_blas_thread, publish, say, table

from structsel.numerics.blocks import choose_workers

Size = tuple[int, int]  # samples, candidates
S4 = {
    "abess": {164: 100.0, 494: 30.0},
    "SysIdentPy FROLS, as called": {164: 300.0, 494: 300.0},
    "PySINDy FROLS": {164: 300.0, 494: 300.0},
    "scikit-learn OMP, true count": {164: 1.0, 494: 1.0},
}
"""Peers with a goal: minimum ratio of their time to the complete fit, by number of candidates."""


@dataclass
class Results:
    """CPU seconds of each turn and memory by size and job, wall seconds of the workers' test, steps that are done."""

    turns: dict[Size, dict[str, tuple[float, ...]]] = field(default_factory=dict)
    memory: dict[Size, dict[str, float | str]] = field(default_factory=dict)
    wall: dict[str, float] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    done: list[str] = field(default_factory=list)

    def seconds(self, size: Size, job: str) -> float | None:
        """Return the median over turns."""
        turns = self.turns.get(size, {}).get(job)
        return None if turns is None else median(turns)

    def ratio(self, size: Size, job: str, floor: str = w.XTX) -> float | None:
        """Return the median of each turn's ratio, or of medians where they were not taken in the same turns."""
        of = self.turns.get(size, {})
        if job not in of or floor not in of:
            return None
        if len(of[job]) == len(of[floor]):
            return median(a / b for a, b in zip(of[job], of[floor]))
        return median(of[job]) / median(of[floor])

    def to_json(self) -> str:
        """Return everything, to go on with."""
        by_size = {k: {f"{n}x{p}": of for (n, p), of in getattr(self, k).items()} for k in ("turns", "memory")}
        return json.dumps({**asdict(self), **by_size}, indent=1)

    @classmethod
    def from_json(cls, text: str) -> Results:
        """Return what `to_json` wrote."""
        held = json.loads(text)
        for k in ("turns", "memory"):
            held[k] = {(int(n), int(p)): of for (n, _, p), of in ((s.partition("x"), v) for s, v in held[k].items())}
        return cls(**held)


def time_jobs(results: Results, n: int, degree: int, repeats: int) -> None:
    """Every job of structsel at one size, beside X.T @ X."""
    work = w.prepare(n, degree)
    X = None
    if w.room_for(None, n, degree, free_memory()):
        X = w.candidate_matrix(work.white.base_signals, work.exponents)
    else:
        results.notes.append(f"No room for X of {n} x {work.p}: X.T @ X is scaled from a tenth of the samples.")
    with one_blas_thread():
        times = {name: t.cpu for name, t in measure(w.jobs(work, X), repeats).items()}
        if X is None:
            X = w.candidate_matrix(work.white.base_signals[:, : n // 10], work.exponents)
            times[w.XTX] = tuple(10 * t for t in measure({w.XTX: lambda: X.T @ X}, repeats)[w.XTX].cpu)
    size = n, work.p
    results.turns.setdefault(size, {}).update(times)
    say(f"N={n} p={work.p}: " + ", ".join(f"{name} {results.ratio(size, name):.3g}" for name in times))


def time_peer(results: Results, n: int, degree: int, peer: Peer) -> None:
    """A peer once, or the median of three where it is quick."""
    work = w.prepare(n, degree)
    if not w.room_for(peer, n, degree, free_memory()):
        results.notes.append(f"{peer.name} was left out at {n} x {work.p}: too little memory.")
        return
    say(f"N={n} p={work.p}: {peer.name} ...")
    peer.warm_up()
    X, y = w.standardised(work)
    with one_blas_thread():
        first, _, chosen = measure_once(lambda: peer.fit(X, y, work.true))
        times = [first]
        while first < 5.0 and len(times) < 3:
            times.append(measure_once(lambda: peer.fit(X, y, work.true))[0])
    results.turns.setdefault((n, work.p), {})[peer.name] = tuple(times)
    say(f"N={n} p={work.p}: {peer.name} {median(times):.3g} s, {len(chosen)} terms")


def measure_memory(results: Results, n: int, degree: int, peers: tuple[Peer, ...]) -> None:
    """Peak above the signals of the fits, of X.T @ X and of the peers."""
    size = (n, len(monomials(8, degree)))
    of = results.memory.setdefault(size, {})
    for what in (w.WHITE, w.GENERIC, w.SELECT, w.BOOTSTRAP, w.XTX):
        if what == w.XTX and not w.room_for(None, n, degree, free_memory()):
            of[what] = "no room"
            continue
        of[what] = w.peak(n, degree, what)
        say(f"N={n} p={size[1]}: {what} {of[what]:.1f} MiB")
    for name, peer in [(p.name, p) for p in peers if not p.absent()]:
        if not w.room_for(peer, n, degree, free_memory()):
            of[name] = "no room"
            continue
        try:
            of[name] = w.peak(n, degree, name)
        except RuntimeError as error:
            of[name] = "failed"
            results.notes.append(f"{name} at {n} x {size[1]}: {error}")
        say(f"N={n} p={size[1]}: {name} {of[name]} MiB")


def time_workers(results: Results, n: int, degree: int, repeats: int) -> None:
    """Wall seconds of one and two workers, quiet and with a busy neighbour."""
    work = w.prepare(n, degree)
    if (load := getloadavg()[0]) > 0.5:
        results.notes.append(f"The machine was not quiet (load {load:.1f}): the workers' wall seconds mean little.")

    def job(signals: object, exponents: object, workers: int) -> Callable[[], object]:
        return lambda: cross_products_of([signals], exponents, workers)  # type: ignore[arg-type,list-item]

    functions = {
        f"{kind}, {workers} worker(s)": job(signals, exponents, workers)
        for kind, signals, exponents in (
            ("products", work.white, work.exponents),
            ("generic", work.generic, work.generic_exponents),
        )
        for workers in (1, 2)
    }
    functions["fit, 2 worker(s)"] = lambda: complete_fit([work.white], work.exponents, 2)
    quiet = measure(functions, repeats)
    with w.busy_neighbour():
        busy = measure(functions, repeats)
    results.wall |= {name: t.wall_median for name, t in quiet.items()}
    results.wall |= {f"{name}, busy neighbour": t.wall_median for name, t in busy.items()}
    say("; ".join(f"{k} {v:.3g} s" for k, v in results.wall.items()))


# ---------------------------------------------------------------- tables


def time_table(results: Results) -> str:
    sizes = list(results.turns)
    names = list(dict.fromkeys(name for of in results.turns.values() for name in of))
    rows: list[list[object]] = []
    for name in names:
        cells: list[object] = [name]
        for size in sizes:
            seconds, ratio = results.seconds(size, name), results.ratio(size, name)
            cells.append("-" if seconds is None else f"{ratio:.3g} x" if ratio is not None else f"{seconds:.3g} s")
        rows.append(cells)
    rows.append([f"{w.XTX}, seconds", *(results.seconds(size, w.XTX) or float("nan") for size in sizes)])
    return table(["CPU", *(f"N={n:,} p={p}" for n, p in sizes)], rows)


def memory_table(results: Results) -> str:
    sizes = list(results.memory)
    names = list(dict.fromkeys(name for of in results.memory.values() for name in of))
    rows = [[name, *(results.memory[size].get(name, "-") for size in sizes)] for name in names]
    return table(["MiB above the signals", *(f"N={n:,} p={p}" for n, p in sizes)], rows)


def goals(results: Results) -> str:
    """S1 to S6 where their sizes were run."""
    rows: list[list[object]] = []
    big = 200_000

    def no_larger(goal: str, what: str, found: float | None, limit: float, unit: str = "x") -> None:
        if found is not None:
            verdict = "reached" if found <= limit else "not reached"
            rows.append([goal, what, f"<= {limit:g} {unit}", f"{found:.3g} {unit}", verdict])

    def at_least(goal: str, what: str, found: float | None, limit: float) -> None:
        if found is not None:
            verdict = "reached" if found >= limit else "not reached"
            rows.append([goal, what, f">= {limit:g} x", f"{found:.3g} x", verdict])

    no_larger("S1", "complete fit, 200k x 164", results.ratio((big, 164), w.WHITE), 1.0)
    no_larger("S1", "complete fit, 200k x 494", results.ratio((big, 494), w.WHITE), 0.65)
    no_larger("S1", "generic candidates, 200k x 164", results.ratio((big, 164), w.GENERIC), 1.6)
    no_larger("S1", "generic candidates, 200k x 494", results.ratio((big, 494), w.GENERIC), 1.3)
    no_larger("S1", "complete fit, setup included, 20k x 164", results.ratio((20_000, 164), w.FRESH), 2.0)
    for p in (164, 494):
        size = (big, p)
        no_larger(
            "S2", f"six responses' cross-products over one's, p={p}", results.ratio(size, w.CROSS_SIX, w.CROSS), 1.3
        )
        no_larger("S2", f"six responses' fit over one's, p={p}", results.ratio(size, w.SIX, w.WHITE), 2.5)
        for again in w.ONCE_MORE:
            no_larger("S2", f"{again}, p={p}", results.ratio(size, again), 0.05)
    for p in (164, 494):
        no_larger("S3", f"select, coloured, p={p}", results.ratio((big, p), w.SELECT), 5.0)
    for p in (164, 494):
        for name, limits in S4.items():
            at_least("S4", f"{name} over complete fit, p={p}", results.ratio((big, p), name, w.WHITE), limits[p])
        one_run = results.ratio((big, p), "SysIdentPy FROLS", w.WHITE)
        if one_run is not None:
            rows.append(["", f"SysIdentPy FROLS, one of its 20 runs, p={p}", "no goal", f"{one_run:.3g} x", ""])
    for p, limit in ((494, 32.0), (164, 16.0)):
        peaks = {n: of[w.WHITE] for (n, q), of in results.memory.items() if q == p}
        for n, found in peaks.items():
            no_larger("S5", f"memory of the complete fit, {n:,} x {p}", float(found), limit, "MiB")
        if len(peaks) > 1:
            span = float(max(peaks.values())) - float(min(peaks.values()))
            no_larger("S5", f"its spread over N, p={p}", span, 1.0, "MiB")
    wall = results.wall
    if wall:
        for kind, limit in (("generic", 1.7), ("products", 1.5)):
            speed_up = wall[f"{kind}, 1 worker(s)"] / wall[f"{kind}, 2 worker(s)"]
            at_least("S6", f"two workers over one, {kind}, wall", speed_up, limit)
            slower = wall[f"{kind}, 2 worker(s), busy neighbour"] / wall[f"{kind}, 2 worker(s)"]
            no_larger("S6", f"two workers with a busy neighbour, {kind}, wall", slower, 2.0)
        no_larger("S6", "workers for 2,000 samples and 164 candidates", choose_workers(None, 2000, 164), 1, "worker")
    return table(["goal", "what", "limit", "found", ""], rows) if rows else "None of the goals' sizes was run."


def steps(a: argparse.Namespace, peers: tuple[Peer, ...]) -> Iterator[tuple[str, Callable[[Results], None]]]:
    """Every measurement by its name."""
    samples, degrees, goals_at, others_at = (
        [int(v) for v in text.split(",") if v] for text in (a.samples, a.degrees, a.peer_samples, a.other_peer_samples)
    )
    parts = a.parts.split(",")
    for n in samples:
        for degree in degrees:
            here = tuple(p for p in peers if n in (goals_at if p.name in S4 else others_at) and not p.absent())
            if "time" in parts:
                yield f"time {n} {degree}", partial(time_jobs, n=n, degree=degree, repeats=a.repeats)
            if "peers" in parts:
                for peer in here:
                    yield f"{peer.name} {n} {degree}", partial(time_peer, n=n, degree=degree, peer=peer)
            if "memory" in parts:
                memory_peers = here if "peer-memory" in parts else ()
                yield f"memory {n} {degree}", partial(measure_memory, n=n, degree=degree, peers=memory_peers)
    if "workers" in parts:
        yield "workers", partial(time_workers, n=a.worker_samples, degree=max(degrees), repeats=a.repeats)


def report(results: Results, peers: tuple[Peer, ...]) -> str:
    """Return the tables of what there is."""
    absent = [f"{p.name}: {p.absent()}" for p in peers if p.absent()]
    text = ["# Time and memory of a selection", machine()]
    if results.turns:
        text += [f"## CPU time over one {w.XTX}", time_table(results)]
    if results.memory:
        text += ["## Peak memory", memory_table(results)]
    if results.wall:
        text += ["## Workers, wall seconds", table(["", "s"], [[k, v] for k, v in results.wall.items()])]
    if results.notes or absent:
        text.append("\n".join(f"- {note}" for note in [*results.notes, *absent]))
    return "\n\n".join([*text, "## Goals", goals(results)])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", default="20000,200000,2000000")
    parser.add_argument("--degrees", default="3,4", help="3: 164 candidates, 4: 494")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--parts", default="time,peers,memory,peer-memory,workers")
    parser.add_argument("--peers", default="all", help="semicolon-separated words, 'all' or 'none'")
    parser.add_argument("--peer-samples", default="20000,200000", help="sizes at which peers of a goal run")
    parser.add_argument("--other-peer-samples", default="20000,200000", help="sizes at which the other peers run")
    parser.add_argument("--worker-samples", type=int, default=200_000)
    parser.add_argument("--out", help="also write the report to this file")
    parser.add_argument("--continue", dest="resume", action="store_true", help="resume an earlier run with this --out")
    a = parser.parse_args()
    peers, results = peers_named(a.peers), Results()
    kept = Path(a.out).with_suffix(".json") if a.out else None
    if a.resume and kept and kept.exists():
        results = Results.from_json(kept.read_text(encoding="utf-8"))
    todo = [(name, step) for name, step in steps(a, peers) if name not in results.done]
    for number, (name, step) in enumerate(todo, 1):
        say(f"{number} of {len(todo)}: {name}")
        step(results)
        results.done.append(name)
        if kept:
            kept.parent.mkdir(parents=True, exist_ok=True)
            kept.write_text(results.to_json(), encoding="utf-8")
            Path(a.out).write_text(report(results, peers) + "\n", encoding="utf-8")
    publish(report(results, peers), a.out)


if __name__ == "__main__":
    main()
