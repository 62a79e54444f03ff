"""Ledger of evidence: what the true difference, the best form of the true effect and the best other effect add.

    python benchmarks/ledger.py out/proof --out ledger.json          # cases and keys of `python -m proof`
    python benchmarks/ledger.py ../shared/data/concealed-cases       # folders with an answer.json each

Log Bayes factors over the stated tolerances, by response and frequency band. A case takes about 15 s. Of correct
simulations the largest evidence is listed with its effect and band, and the largest that counts: limited by that on the
response to the recorded inputs, of events in part. By Turing's theorem the mean Bayes factor of any
effect over correct simulations is at most one, so a log Bayes factor above 10 is an artefact of the method.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import logsumexp
from threadpoolctl import threadpool_limits

from structsel.aircraft import Aircraft
from structsel.comparison.noise import frequencies
from structsel.comparison.preparing import prepare
from structsel.diagnosis.detection import detect
from structsel.diagnosis.diagnose import set_up
from structsel.diagnosis.input_response import InputDrivenMotion
from structsel.diagnosis.problem import DiagnosisProblem
from structsel.diagnosis.scoring import score_all
from structsel.diagnosis.signatures import Signature
from structsel.diagnosis.weighing import log_bayes
from structsel.numerics.evidence import Base
from structsel.recording import read_recordings

EDGES = (0.0, 0.4, 1.0, 2.5, np.inf)  # Hz; chosen, not critical
ARTEFACT = 10.0
"""Log Bayes factor that correct simulations exceed in one of 22,000 trials at most."""


def bands() -> list[str]:
    """Names of the bands: the level, then frequencies."""
    return ["level", *(f"{low:g} to {high:g} Hz" for low, high in pairwise(EDGES))]


def by_band(problem: DiagnosisProblem, signature: Signature) -> dict[str, dict[str, float]]:
    """Log Bayes factor of a form by response and band, each from its own rows with the biases integrated out."""
    columns = [r.whiten(s, signature.width) for r, s in zip(problem.rows, signature.spectra)]
    made: dict[str, dict[str, float]] = {}
    for c in problem.responses:
        made[c] = {}
        for k, name in enumerate(bands()):
            at = []
            for r in problem.rows:
                hz = np.concatenate([[-1.0], frequencies(r.flight, r.bins)])
                inside = hz < 0.0 if k == 0 else (hz >= EDGES[k - 1]) & (hz < EDGES[k]) & (hz >= 0.0)
                at.append(r.part(c).start + np.flatnonzero(inside))
            if any(np.any(x[i]) for x, i in zip(columns, at)):
                made[c][name] = _log_bayes(problem.base, columns, at)
    return made


def _log_bayes(base: Base, columns: Sequence[np.ndarray], at: Sequence[np.ndarray]) -> float:
    """Log Bayes factor of columns on some of the rows."""
    y, B = [x[i] for x, i in zip(base.y, at)], [x[i] for x, i in zip(base.given, at)]
    without = Base(y, B, [(0,)], base.scales)
    with_columns = without.with_columns([x[i] for x, i in zip(columns, at)])
    return float(logsumexp(with_columns.evidence[:, 0]) - logsumexp(without.evidence[:, 0]))


@threadpool_limits.wrap(limits=1)
def entry(folder: Path, key: Mapping[str, Any]) -> dict[str, Any]:
    """Entry of one case."""
    prepared = prepare(str(folder / "simulated"), read_recordings(folder / "recordings"), _aircraft(folder))
    problem, library, turbulence = set_up(prepared.flights)
    scores = score_all(problem, library)
    true = {n for e in key["effects"] for n in e["accept"]} - {"turbulence", "consistent"}
    right = next((s for s in scores if s.effect in true), None)
    other = next((s for s in scores if s.effect not in true), None)
    confirmed = InputDrivenMotion.of(problem.flights).confirm(problem, scores)
    counts = max((s for s in confirmed if s.effect not in true), key=log_bayes, default=None)
    seen = detect(problem.flights, problem)
    known = key.get("log_evidence", key.get("log_likelihood_gain_of_perfect_account"))
    return {
        "case": folder.name,
        "effects": [e["effect"] for e in key["effects"]],
        "null": key["family"].startswith(("null", "turbulence")),
        "turbulence": turbulence is not None,
        "true difference": known,
        "detection": None if seen is None else seen.parts | {"any": seen.log_bayes},
        "best form": None if right is None else _listed(problem, right.effect, right.log_evidence, right.signature),
        "best other": None if other is None else _listed(problem, other.effect, other.log_evidence, other.signature),
        "confirmed other": None if counts is None else {"effect": counts.effect, "log_bayes": log_bayes(counts)},
    }


def _aircraft(folder: Path) -> Aircraft:
    return Aircraft.from_toml(folder / "aircraft.toml")


def _listed(problem: DiagnosisProblem, effect: str, log_evidence: float, signature: Signature) -> dict[str, Any]:
    return {"effect": effect, "log_bayes": log_evidence, "by band": by_band(problem, signature)}


def cases(place: Path) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Folders of cases, and their keys."""
    if (place / "cases").exists():
        pairs = [(f, place / "keys" / f"{f.name}.json") for f in sorted((place / "cases").iterdir())]
    else:
        pairs = [(f, f / "answer.json") for f in sorted(place.iterdir()) if f.is_dir()]
    for folder, key in pairs:
        if key.exists():
            yield folder, json.loads(key.read_text(encoding="utf-8"))


def line(one: Mapping[str, Any]) -> str:
    """One line of the ledger."""
    named = [
        f"{what} {x['effect']} {x['log_bayes']:.0f} ({_clearest(x['by band'])})"
        for what in ("best form", "best other")
        if (x := one[what]) is not None
    ]
    if (counts := one["confirmed other"]) is not None:
        named.append(f"confirmed {counts['effect']} {counts['log_bayes']:.0f}")
    known = "" if one["true difference"] is None else f"true difference {one['true difference']:.0f}; "
    seen = "" if one["detection"] is None else f"; detection {one['detection']['any']:.0f}"
    air = ", turbulence" if one["turbulence"] else ""
    return f"{one['case']} [{', '.join(one['effects']) or 'none'}{air}]: {known}{'; '.join(named)}{seen}"


def _clearest(each: Mapping[str, Mapping[str, float]]) -> str:
    """Response and band with the largest evidence."""
    flat = [(x, c, band) for c, some in each.items() for band, x in some.items()]
    return "-" if not flat else "{1}, {2}: {0:.0f}".format(*max(flat))


def summary(made: Sequence[Mapping[str, Any]]) -> list[str]:
    """Turing's test of the correct simulations, and the fraction that the best forms explain."""
    found = [one["best other"]["log_bayes"] for one in made if one["null"] and one["best other"]]
    counted = [one["confirmed other"]["log_bayes"] for one in made if one["null"] and one["confirmed other"]]
    seen = [one["detection"]["any"] for one in made if one["null"] and one["detection"]]
    said = []
    for what, values in (("best effect", found), ("as it counts", counted), ("detection", seen)):
        if values:
            above = sum(x > ARTEFACT for x in values)
            said.append(f"correct simulations, {what}: {above} of {len(values)} above {ARTEFACT:g}; {max(values):.0f}")
    parts = [
        one["best form"]["log_bayes"] / one["true difference"]
        for one in made
        if not one["null"] and one["best form"] and (one["true difference"] or 0.0) > ARTEFACT
    ]
    if parts:
        few = sum(x < 0.8 for x in parts)
        said.append(
            f"best form below 80 % of the true difference: {few} of {len(parts)}; median {np.median(parts):.0%}"
        )
    return said


def main() -> None:
    """Print a line for each case, then the summary."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("place", type=Path)
    parser.add_argument("--only", nargs="+", default=(), help="names of cases")
    parser.add_argument("--out", type=Path)
    stated = parser.parse_args()
    made = []
    for folder, key in cases(stated.place):
        if not stated.only or folder.name in stated.only:
            made.append(entry(folder, key))
            print(line(made[-1]), flush=True)
    for text in summary(made):
        print(text)
    if stated.out:
        stated.out.write_text(json.dumps(made, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
