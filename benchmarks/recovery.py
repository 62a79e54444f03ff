"""How often the exact structure comes back: structsel's methods and their peers, in one run.

    python benchmarks/recovery.py --seeds 200 --peer-seeds 50 --jobs 2 --out recovery.md

Each seed is a flight of correlated signals with its own seven true terms, three of them weak. The residual's noise
model is one of six in turn (every sixth seed is white). Peers get candidates that are already evaluated, centred and
scaled; structsel gets the signals. A slow peer may be given fewer seeds, always the first ones; the table gives their
number.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from math import sqrt
from statistics import median
from time import process_time
from typing import Any

from cases import NOISE_MODELS, monomials, recovery_case, score
from methods import METHODS, Tally, workers
from peers import Peer, candidate_matrix, peers_named, standardise
from timing import machine, one_blas_thread, publish, say, table

Score = tuple[bool, int, int]
Over = Callable[[Callable[..., Any], Sequence[tuple[Any, ...]]], Iterator[Any]]


@dataclass(frozen=True)
class Answer:
    """Result of one method for one seed."""

    method: str
    noise_model: str
    score: Score
    seconds: float
    failed: str = ""


@dataclass
class Record:
    """One method's answers so far."""

    answers: list[Answer] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        return sum(a.seconds for a in self.answers)

    def tally(self, white: bool | None = None) -> Tally:
        return Tally.of(a.score for a in self.answers if white is None or (a.noise_model == "white") == white)


def one_seed(
    seed: int, noise_model: str, samples: int, degree: int, manoeuvres: int, methods: str, peers: str
) -> list[Answer]:
    """All methods and the named peers on one case; CPU seconds of each."""
    with one_blas_thread():
        case = recovery_case(noise_model, seed, n=samples, degree=degree, n_manoeuvres=manoeuvres)
        answers = []
        for method in METHODS:
            if not wanted(method.name, methods):
                continue
            start = process_time()
            chosen = method.choose(case)
            answers.append(Answer(method.name, noise_model, score(case, chosen), process_time() - start))
        running = present(peers)
        if running:
            for peer in running:
                peer.warm_up()
            X, y = standardise(candidate_matrix(case.base, case.exponents), case.response)
        for peer in running:
            start = process_time()
            try:
                chosen = tuple(peer.fit(X, y, true_count=len(case.true)))
                failed = ""
            except Exception as error:  # a peer that fails has found nothing; the table marks it
                chosen, failed = (), f"{type(error).__name__}: {error}"
            answers.append(Answer(peer.name, noise_model, score(case, chosen), process_time() - start, failed))
        return answers


def wanted(name: str, words: str) -> bool:
    return words == "all" or any(word.strip().lower() in name.lower() for word in words.split(";"))


def present(names: str) -> list[Peer]:
    """Installed peers of that name that need no second run for the same answer."""
    return [p for p in peers_named(names) if not p.absent() and not p.name.endswith("as called")]


def run(a: argparse.Namespace, degree: int, over: Over) -> dict[str, Record]:
    """Seeds in order; peers drop out when their seeds or their CPU budget are used up."""
    records: dict[str, Record] = {}
    group = max(1, a.jobs) * 2
    names = {p.name for p in present(a.peers)}
    for first in range(0, a.seeds, group):
        seeds = range(first, min(first + group, a.seeds))
        left = [n for n in names if n not in records or records[n].seconds < a.peer_seconds]
        peers = ";".join(sorted(left)) if left and first < a.peer_seeds else "none"
        work = []
        for seed in seeds:
            noise_model = NOISE_MODELS[seed % len(NOISE_MODELS)] if a.noise_model == "cycle" else a.noise_model
            these = peers if seed < a.peer_seeds else "none"
            work.append((a.seed + seed, noise_model, a.samples, degree, a.manoeuvres, a.methods, these))
        for (seed, noise_model, *_), answers in zip(work, over(one_seed, work)):
            for answer in answers:
                records.setdefault(answer.method, Record()).answers.append(answer)
                if answer.failed:
                    say(f"{answer.method} failed on seed {seed}: {answer.failed}")
            exact = [answer.method for answer in answers if answer.score[0]]
            say(f"degree {degree} seed {seed} {noise_model}: exact by {len(exact)} of {len(answers)}")
    return records


def percent(tally: Tally) -> str:
    if not tally.cases:
        return "-"
    likely = (tally.exact + 1) / (tally.cases + 2)  # Laplace: a rate of 0 or 1 is not certain
    error = sqrt(likely * (1 - likely) / (tally.cases + 3))
    return f"{100 * tally.rate:.0f} ± {100 * error:.0f} %"


def report(records: dict[str, Record], peers: str) -> str:
    rows: list[list[object]] = []
    for name, record in records.items():
        tally = record.tally()
        failures = sum(bool(answer.failed) for answer in record.answers)
        rows.append(
            [
                name + (f" ({failures} failed)" if failures else ""),
                tally.cases,
                percent(tally),
                percent(record.tally(white=True)),
                percent(record.tally(white=False)),
                tally.per_case(tally.missed),
                tally.per_case(tally.false),
                median(answer.seconds for answer in record.answers),
            ]
        )
    for peer in peers_named(peers):
        if peer.absent():
            rows.append([peer.name, peer.absent(), *["-"] * 6])
    head = ["method", "seeds", "exact", "exact, white", "exact, coloured", "missed", "false", "CPU s"]
    return table(head, rows)


def settings(peers: str) -> str:
    lines = [f"- {p.name} ({p.version()}): {p.settings}" for p in peers_named(peers) if not p.absent()]
    return "\n".join(["Peers and their settings:", "", *lines]) if lines else ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0, help="the first one")
    parser.add_argument("--degrees", default="3,4", help="3: 164 candidates, 4: 494")
    parser.add_argument("--samples", type=int, default=20_000)
    parser.add_argument("--manoeuvres", type=int, default=1, help="of equal length")
    parser.add_argument("--noise-model", default="cycle", choices=["cycle", *NOISE_MODELS])
    parser.add_argument("--methods", default="all", help="semicolon-separated words of structsel's methods")
    parser.add_argument("--peers", default="all", help="semicolon-separated words, 'all' or 'none'")
    parser.add_argument("--peer-seeds", type=int, default=48, help="maximum number of seeds of a peer")
    parser.add_argument("--peer-seconds", type=float, default=1800.0, help="CPU budget of a peer per pool")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", help="also write the report to this file")
    a = parser.parse_args()
    parts = [
        "# Structure recovery",
        f"{a.samples} samples, {a.manoeuvres} manoeuvre(s), residual: {a.noise_model}. {machine()}",
    ]
    with workers(a.jobs) as over:
        for degree in (int(d) for d in a.degrees.split(",")):
            p = len(monomials(8, degree))
            parts += [f"## {p} candidates, 7 of them true", report(run(a, degree, over), a.peers)]
    parts += [
        "Missed and false are means per seed, CPU seconds medians; ± is one standard error (Laplace).",
        settings(a.peers),
    ]
    publish("\n\n".join(parts), a.out)


if __name__ == "__main__":
    main()
