"""Fits the weights of the effects' features: `structsel.diagnosis.effect_probability.WEIGHTS`.

The key of a case states which of the candidate effects is there, or that none is. The weights are the most probable
ones by the probabilities that the diagnosis states, with a weak prior for small ones, each of the right sign. Folders
are those of ``python -m proof``; what is collected from one stays in its ``rounds.jsonl``. Cases kept for evaluation
are never among them. To fit the weights, this module opens the diagnosis from inside, which the rest of the proof does
not.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from scipy.optimize import minimize
from sklearn.model_selection import GroupKFold

from proof.keys import Key
from proof.worker import open_case
from structsel.comparison.preparing import prepare
from structsel.diagnosis.diagnose import set_up
from structsel.diagnosis.effect_probability import (
    AGAINST,
    FEATURES,
    WEIGHTS,
    EffectEvidence,
    first_probabilities,
    further_probabilities,
)
from structsel.diagnosis.input_response import InputDrivenMotion
from structsel.diagnosis.ranking import NAMED, TIED, enter, search_effects
from structsel.diagnosis.residuals import white_fraction
from structsel.numerics.arrays import Array

_MILD = 1.0  # inverse variance of a weight beforehand, in standard deviations of its feature
_LEAST = 1e-4  # probability of the right answer below which a search counts no further: its key may be wrong
_FOLDS = 5
_NOTHING = 3.0  # times that a first search without an effect counts: users' simulations lack one less often than these

Round = dict[str, Any]


def collect(folder: Path, name: str) -> list[Round]:
    """Searches of one case: the candidate effects, and after a right one is accepted, those of the next search.

    The key does not state in how many places an effect acts: more of one that was found are left out.
    """
    key = Key.read(folder / "keys" / f"{name}.json")
    start, library, _ = set_up(prepare(*open_case(folder / "cases" / name), aligned=True).flights)
    problem = start
    rounds: list[Round] = []
    missing = [set(e.accept) for e in key.effects]
    motion = InputDrivenMotion.of(problem.flights)
    while len(rounds) <= len(key.effects):
        _, found = search_effects(problem, library, motion)
        candidates = [one for one in found if (one.lowers or not rounds) and one.effect not in problem.found]
        right = [any(one.effect in e for e in missing) for one in candidates]
        white = None if rounds else white_fraction(problem)
        rows = [{"effect": one.effect, "right": r, "evidence": _numbers(one)} for one, r in zip(candidates, right)]
        of_case = {"case": name, "source": key.source, "family": key.family}
        rounds.append({**of_case, "round": len(rounds), "white": white, "rows": rows})
        accepted = [one for one, r in zip(candidates, right) if r and one.lowers]
        if not accepted:
            break
        best = max(accepted, key=lambda one: one.log_bayes)
        missing = [e for e in missing if best.effect not in e]
        problem, library = enter(best, problem, library, start)
    return rounds


def _numbers(one: EffectEvidence) -> dict[str, Any]:
    """What the probability of a candidate is computed from, but for the weights."""
    held = {f.name: getattr(one, f.name) for f in fields(EffectEvidence) if f.name != "weights"}
    return {k: v.tolist() if isinstance(v, np.ndarray | np.generic) else v for k, v in held.items()}


def rounds_of(folder: Path, jobs: int) -> list[dict]:
    """Rounds of all cases of a folder, those that are not yet in its ``rounds.jsonl`` collected first."""
    path = folder / "rounds.jsonl"
    done = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    known = {d["case"] for d in done}
    names = sorted(p.stem for p in (folder / "keys").glob("*.json") if p.stem not in known)
    with path.open("a") as out:
        for k, made in enumerate(Parallel(jobs, return_as="generator_unordered")(
            delayed(_collect)(folder, n) for n in names
        )):  # fmt: skip
            done += made
            out.writelines(json.dumps(one) + "\n" for one in made)
            out.flush()
            print(f"\r{k + 1} of {len(names)}", end="", file=sys.stderr)
    return done


def _collect(folder: Path, name: str) -> list[dict]:
    try:
        return collect(folder, name)
    except Exception as error:  # a case that cannot be opened is reported and left out
        print(f"\n{name}: {error}", file=sys.stderr)
        return []


def stated(one: Round, weights: Array) -> Array:
    """(1 + k,) probabilities of a search: of nothing, and of each effect."""
    candidates = [EffectEvidence(**row["evidence"], weights=weights) for row in one["rows"]]
    return further_probabilities(candidates) if one["round"] else first_probabilities(candidates, one["white"])


def right_of(one: Round) -> Array:
    """(1 + k,) what is right: nothing, or some of the effects."""
    right = [bool(row["right"]) for row in one["rows"]]
    return np.array([not any(right), *right])


def log_probability(one: Round, weights: Array) -> float:
    """Log probability of what is right in a search."""
    return float(np.log(max(stated(one, weights)[right_of(one)].sum(), _LEAST)))


def fit(rounds: Sequence[Round], mild: float = _MILD) -> Array:
    """Weights (1 + f,), the log odds without features first."""
    counts = [_NOTHING if right_of(one)[0] and not one["round"] else 1.0 for one in rounds]
    spread = np.std([row["evidence"]["features"] for one in rounds for row in one["rows"]], axis=0)

    def loss(w: Array) -> float:
        of_right = sum(n * log_probability(one, w) for one, n in zip(rounds, counts))
        return -of_right + 0.5 * mild * float(np.sum((w[1:] * spread) ** 2))

    bounds = [(None, None), *((None, 0.0) if name in AGAINST else (0.0, None) for name in FEATURES)]
    return np.asarray(minimize(loss, WEIGHTS, method="L-BFGS-B", bounds=bounds).x)


def crossed(rounds: Sequence[Round], groups: Sequence[str], folds: int) -> Iterator[tuple[Round, Array]]:
    """Each search, with weights found on other groups."""
    for learnt, kept in GroupKFold(folds).split(rounds, groups=groups):
        w = fit([rounds[i] for i in learnt])
        yield from ((rounds[i], w) for i in kept)


def report(rounds: Sequence[Round]) -> None:
    """Print what such weights are worth on cases that they were not found from."""
    generators = [one["source"].split("/")[0] for one in rounds]
    by_case = list(crossed(rounds, [one["case"] for one in rounds], _FOLDS))
    found = {"as they are": [(one, WEIGHTS) for one in rounds], "found on other cases": by_case}
    if len(set(generators)) > 1:
        found["found on the other generator"] = list(crossed(rounds, generators, 2))
    print("\n| weights | mean log probability of what is right |\n|---|---|")
    for name, pairs in found.items():
        print(f"| {name} | {np.mean([log_probability(one, w) for one, w in pairs]):.4f} |")
    rows = [_outcome(one, stated(one, w)) for one, w in by_case]
    print("\n| search | family | searches | there | right | tied | wrong | missed | nothing there, named |")
    print("|---|---|---|---|---|---|---|---|---|")
    for key in sorted({key for key, *_ in rows}):
        said = [what for k, what, _ in rows if k == key]
        there = len(said) - said.count("alarm") - said.count("nothing")
        counts = (len(said), there, *(said.count(x) for x in ("right", "tied", "wrong", "missed", "alarm")))
        print("| " + " | ".join(map(str, [*key, *counts])) + " |")
    named = [(p, what == "right") for _, what, p in rows if what not in ("nothing", "missed")]
    print(f"\nBrier {np.mean([(p - hit) ** 2 for p, hit in named]):.3f}\n\n| said | of | right |\n|---|---|---|")
    for low in np.arange(0.0, 1.0, 0.2):
        held = [(p, hit) for p, hit in named if low <= p < low + 0.2]
        if held:
            said, hits = np.mean(held, axis=0)
            print(f"| {said:.2f} | {len(held)} | {hits:.2f} |")


def _outcome(one: Round, p: Array) -> tuple[tuple[str, str], str, float]:
    """Kind of search and family, what would be said of it, and with which probability."""
    right = right_of(one)
    key = ("later" if one["round"] else "first", one["family"])
    if 1.0 - p[0] < NAMED:
        return key, "nothing" if right[0] else "missed", float(p[0])
    first = 1 + int(p[1:].argmax())
    tied = bool((right[1:] & (p[1:] > TIED * p[first])).any())
    what = "alarm" if right[0] else "right" if right[first] else "tied" if tied else "wrong"
    return key, what, float(p[first])


def main() -> None:
    """Collect, cross-validate, and print the weights."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path, help="made by python -m proof --out FOLDER, development seeds")
    parser.add_argument("--jobs", type=int, default=2)
    a = parser.parse_args()
    begun = time.perf_counter()
    rounds = [r for folder in a.folders for r in rounds_of(folder, a.jobs)]
    print(f"{len({r['case'] for r in rounds})} cases, {len(rounds)} rounds, {time.perf_counter() - begun:.0f} s")
    report(rounds)
    w = fit(rounds)
    print("\nWEIGHTS = " + ", ".join(f"{x:.3f}" for x in w))
    print("\n" + "\n".join(f"{n:12} {x:8.3f}" for n, x in zip(("none", *FEATURES), w)))


if __name__ == "__main__":
    main()
