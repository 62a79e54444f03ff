"""Fits the probability model of the diagnosis: weights and intercepts of `structsel.diagnosis.weighing`.

The key of a case states which of the candidate effects is there, or that none is. The log odds of each against nothing
are taken to be linear in its features (a conditional logit). The most probable weights are found, with a weak prior
for small ones. Folders are those of ``python -m proof``; what is collected from one stays in its ``rounds.jsonl``.
Cases kept for evaluation are never among them. To fit the model, this module opens the diagnosis from inside, which
the rest of the proof does not.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from scipy.optimize import minimize
from scipy.special import logsumexp, softmax
from sklearn.model_selection import KFold

from proof.keys import Key
from proof.worker import open_case
from structsel.comparison.preparing import prepare
from structsel.diagnosis import weighing
from structsel.diagnosis.diagnose import set_up
from structsel.diagnosis.input_response import InputDrivenMotion
from structsel.diagnosis.ranking import NAMED, TIED, enter, search_effects
from structsel.numerics.arrays import Array

_MILD = 3.0  # inverse variance of a weight beforehand, in standard deviations of its feature


def collect(folder: Path, name: str) -> list[dict]:
    """Rounds of one case: the candidate effects, and after a right one is accepted, those of the next round."""
    key = Key.read(folder / "keys" / f"{name}.json")
    start, library, _ = set_up(prepare(*open_case(folder / "cases" / name), aligned=True).flights)
    problem = start
    rounds: list[dict] = []
    missing = [set(e.accept) for e in key.effects]
    motion = InputDrivenMotion.of(problem.flights)
    while len(rounds) <= len(key.effects):
        _, candidates = search_effects(problem, library, motion)
        scored = [w for w in candidates if w.lowers]
        right = [any(w.effect in e for e in missing) for w in scored]
        rows = [
            {"effect": w.effect, "right": r, "features": [float(x) for x in w.features]} for w, r in zip(scored, right)
        ]
        rounds.append({"case": name, "family": key.family, "round": len(rounds), "rows": rows})
        found = [w for w, r in zip(scored, right) if r]
        if not found:
            break
        best = max(found, key=lambda w: weighing.log_bayes(w.score))
        missing = [e for e in missing if best.effect not in e]
        problem, library = enter(best, problem, library, start)
    return rounds


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


def padded(rounds: Sequence[dict]) -> tuple[Array, Array, Array]:
    """Features (n, k, f), zero or minus infinity where there is an effect or none, and what is right, (n, 1 + k)."""
    largest = max(len(r["rows"]) for r in rounds)
    X = np.zeros((len(rounds), largest, len(weighing.FEATURES)))
    there = np.full((len(rounds), 1 + largest), -np.inf)
    right = np.zeros((len(rounds), 1 + largest))
    there[:, 0] = 0.0
    for i, one in enumerate(rounds):
        k = len(one["rows"])
        if k:
            X[i, :k] = [row["features"] for row in one["rows"]]
            there[i, 1 : 1 + k] = 0.0
            right[i, 1 : 1 + k] = [row["right"] for row in one["rows"]]
    right[:, 0] = right.sum(axis=1) == 0.0
    return X, there, right


def fit(X: Array, there: Array, right: Array, mild: float = _MILD) -> Array:
    """Intercept and weights, (1 + f,)."""
    spread = X[there[:, 1:] == 0.0].std(axis=0) + 1e-9
    scaled = X / spread
    truth = np.where(right > 0.0, 0.0, -np.inf)

    def loss(w: Array) -> tuple[float, Array]:
        u = log_odds(w, scaled, there)
        among, of_right = logsumexp(u, axis=1), logsumexp(u + truth, axis=1)
        off = (np.exp(u - among[:, None]) - np.exp(u + truth - of_right[:, None]))[:, 1:]
        slope = np.concatenate([[off.sum()], np.einsum("nk,nkf->f", off, scaled) + mild * w[1:]])
        return float((among - of_right).sum() + 0.5 * mild * w[1:] @ w[1:]), slope

    found = minimize(loss, np.zeros(1 + X.shape[2]), jac=True, method="L-BFGS-B").x
    return np.concatenate([found[:1], found[1:] / spread])


def probabilities(w: Array, X: Array, there: Array) -> Array:
    """(n, 1 + k) probabilities: of nothing, and of each effect."""
    return softmax(log_odds(w, X, there), axis=1)


def log_odds(w: Array, X: Array, there: Array) -> Array:
    """(n, 1 + k) against nothing, which comes first."""
    return np.column_stack([np.zeros(len(X)), w[0] + X @ w[1:]]) + there


def crossed(rounds: Sequence[dict], folds: int = 8) -> tuple[Array, Array]:
    """Probabilities from weights found on other cases, and what is right."""
    X, there, right = padded(rounds)
    cases = sorted({r["case"] for r in rounds})
    of = np.array([cases.index(r["case"]) for r in rounds])
    p = np.zeros_like(right)
    for learnt, kept in KFold(folds, shuffle=True, random_state=1).split(cases):
        inside, outside = np.isin(of, learnt), np.isin(of, kept)
        p[outside] = probabilities(fit(X[inside], there[inside], right[inside]), X[outside], there[outside])
    return p, right


def report(rounds: Sequence[dict]) -> None:
    """Print what such weights are worth on cases that they were not found from."""
    p, right = crossed(rounds)
    top = 1 + p[:, 1:].argmax(axis=1)
    named, hit = 1.0 - p[:, 0] > NAMED, right[np.arange(len(right)), top] > 0.0
    tied = (right * (p > TIED * p[np.arange(len(p)), top][:, None]))[:, 1:].any(axis=1)
    print("\n| round | family | rounds | there | right | tied | wrong | missed | nothing there, named |")
    print("|---|---|---|---|---|---|---|---|---|")
    for key in sorted({(min(r["round"], 1), r["family"]) for r in rounds}):
        at = np.array([(min(r["round"], 1), r["family"]) == key for r in rounds])
        there = at & (right[:, 0] == 0.0)
        counts = (
            at.sum(), there.sum(), (there & named & hit).sum(), (there & named & ~hit & tied).sum(),
            (there & named & ~hit & ~tied).sum(), (there & ~named).sum(), (at & (right[:, 0] > 0.0) & named).sum(),
        )  # fmt: skip
        print("| " + " | ".join(map(str, ["first" if key[0] == 0 else "later", key[1], *counts])) + " |")
    said = p[np.arange(len(p)), top][named]
    print(f"\nBrier {np.mean((said - hit[named]) ** 2):.3f}\n\n| said | of | right |\n|---|---|---|")
    for low in np.arange(0.0, 1.0, 0.2):
        at = (said >= low) & (said < low + 0.2)
        if at.any():
            print(f"| {said[at].mean():.2f} | {at.sum()} | {hit[named][at].mean():.2f} |")


def main() -> None:
    """Collect, cross-validate, and print the weights."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "folders", nargs="+", type=Path, help="made by: structsel prove --out FOLDER, seeds to develop by"
    )
    parser.add_argument("--jobs", type=int, default=2)
    a = parser.parse_args()
    begun = time.perf_counter()
    rounds = [r for folder in a.folders for r in rounds_of(folder, a.jobs)]
    print(f"{len({r['case'] for r in rounds})} cases, {len(rounds)} rounds, {time.perf_counter() - begun:.0f} s")
    report(rounds)
    X, there, right = padded(rounds)
    w = fit(X, there, right)
    print(f"\nNOTHING = {w[0]:.3f}")
    print("WEIGHTS = " + ", ".join(f"{x:.3f}" for x in w[1:]))
    print("\n" + "\n".join(f"{n:12} {x:8.3f}" for n, x in zip(weighing.FEATURES, w[1:])))


if __name__ == "__main__":
    main()
