"""Invariances of a diagnosis: the same flights described or sampled in another way must have the same answer.

    python benchmarks/invariances.py out/proof/cases/*            # folders with aircraft.toml, recordings and simulated
    python benchmarks/invariances.py --model                      # a model against files of its coefficients

Order, names, clock origin, units, mirror image and rounding change nothing: verdict and first name must stay, and
probabilities may move by 0.02. Cutting every recording in two, half the sampling rate and 0.02 s between the vanes and
the rest change the data a little: probabilities may move by 0.1. So may they between a model and files of the
coefficients that it has along the recordings, which is tried on demonstration flights whose model lacks one term.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from errors_in_real_recordings import Flown

import structsel as ss
from structsel.recording import Recording

Recordings = Sequence[Recording]
MIRRORED = ("beta", "p", "r", "phi", "psi", "ay", "da", "dr", "CY", "Cl", "Cn", "ve", "v")
DELAY = 0.02  # s


@dataclass(frozen=True)
class Problem:
    """A simulation along recordings, the recordings and the aircraft."""

    simulated: Recordings
    recordings: Recordings
    aircraft: ss.Aircraft

    def each(self, change: Callable[[Recording], Recording]) -> Problem:
        """The same with every recording changed, simulated ones too."""
        return replace(
            self, simulated=[change(r) for r in self.simulated], recordings=[change(r) for r in self.recordings]
        )


@dataclass(frozen=True)
class Answer:
    """What a diagnosis states: verdict, names of the first finding, probability of each name and of the mismatch."""

    verdict: str
    first: str
    names: Mapping[str, float]
    mismatch: float

    @classmethod
    def of(cls, problem: Problem) -> Answer:
        """Diagnose."""
        return cls.to(ss.diagnose({r.name: r for r in problem.simulated}, problem.recordings, problem.aircraft))

    @classmethod
    def to(cls, found: ss.Diagnosis) -> Answer:
        """The answer of a diagnosis."""
        named = [f for f in found.findings if f.kind != "random"]
        names = {p.effect: p.probability for p in named[0].physics} if named else {}
        return cls(found.verdict, named[0].effect if named else "", names, found.probability)

    def moved(self, other: Answer) -> float:
        """Largest change of a probability."""
        each = [abs(self.names.get(e, 0.0) - other.names.get(e, 0.0)) for e in {*self.names, *other.names}]
        return max([*each, abs(self.mismatch - other.mismatch)])


def rebuilt(recording: Recording, t: np.ndarray, channels: Mapping[str, np.ndarray], name: str = "") -> Recording:
    """A recording of other samples."""
    return replace(recording, name=name or recording.name, t=t, channels=channels, findings=())


def renamed(problem: Problem) -> Problem:
    """Recordings in reverse order under other names."""
    new = {r.name: f"z{len(problem.recordings) - k}" for k, r in enumerate(problem.recordings)}
    turned = problem.each(lambda r: rebuilt(r, r.t, r.channels, new[r.name]))
    return replace(turned, simulated=turned.simulated[::-1], recordings=turned.recordings[::-1])


def later(problem: Problem) -> Problem:
    """A clock that starts 1,000 s later."""
    return problem.each(lambda r: rebuilt(r, r.t + 1000.0, r.channels))


def rounded(problem: Problem) -> Problem:
    """Every sample times one plus a random number of 1e-12."""
    rng = np.random.default_rng(0)
    return problem.each(
        lambda r: rebuilt(r, r.t, {c: x * (1.0 + 1e-12 * rng.standard_normal(len(x))) for c, x in r.channels.items()})
    )


def mirrored(problem: Problem) -> Problem:
    """Left and right exchanged."""
    turned = problem.each(lambda r: rebuilt(r, r.t, {c: -x if c in MIRRORED else x for c, x in r.channels.items()}))
    content = problem.aircraft.to_dict()
    for table in [content["thrust"], *content["sensors"].values()]:
        key = "offset" if "offset" in table else "position"
        if key in table:
            x, y, z = table[key]
            table[key] = [x, -y, z]
    for product in ("Ixy", "Iyz") if "inertia" in content else ():
        content["inertia"][product] = -content["inertia"].get(product, 0.0)
    content["engine"]["angular_momentum"] = -content["engine"]["angular_momentum"]
    return replace(turned, aircraft=ss.Aircraft.from_dict(content))


def halves(problem: Problem) -> Problem:
    """Every recording cut in the middle."""

    def cut(recordings: Recordings) -> list[Recording]:
        parts = []
        for r in recordings:
            half = len(r) // 2
            for k, part in enumerate((slice(0, half), slice(half, len(r)))):
                parts.append(rebuilt(r, r.t[part], {c: x[part] for c, x in r.channels.items()}, f"{r.name}{'ab'[k]}"))
        return parts

    return replace(problem, simulated=cut(problem.simulated), recordings=cut(problem.recordings))


def slower(problem: Problem) -> Problem:
    """Every second sample."""
    return problem.each(lambda r: rebuilt(r, r.t[::2], {c: x[::2] for c, x in r.channels.items()}))


def vanes_late(problem: Problem) -> Problem:
    """Flow angles read later."""

    def late(r: Recording) -> Recording:
        angles = {c: np.interp(r.t - DELAY, r.t, r[c]) for c in ("alpha", "beta") if c in r}
        return rebuilt(r, r.t, {**r.channels, **angles})

    return replace(problem, recordings=[late(r) for r in problem.recordings])


EXACT = {
    "other order and names": renamed, "clock from 1,000 s": later, "rounding of 1e-12": rounded,
    "mirror image": mirrored,
}  # fmt: skip
NEAR = {"cut in halves": halves, "half the sampling rate": slower, f"vanes {DELAY:g} s late": vanes_late}


LACKING = (
    None, ("Cm", "beta^2"), ("Cm", "q_hat"), ("Cl", "alpha*da"), ("CX", "alpha^3"), ("Cn", "beta^3"),
    ("CZ", "beta^2*de"),
)  # fmt: skip


def model_and_files(lacking: tuple[str, str] | None, turbulence: float) -> tuple[Answer, Answer]:
    """Answers to a model of the demonstration flights, and to files of its coefficients."""
    recordings, aircraft, truth = ss.demo_flights(6, 21, turbulence=turbulence)
    if lacking is not None:
        del truth[lacking[0]][lacking[1]]
    model = ss.AeroModel.from_terms(truth)
    files = Flown(recordings, aircraft, model).simulated()
    one, other = (ss.diagnose(simulation, recordings, aircraft) for simulation in (model, files))
    return Answer.to(one), Answer.to(other)


def read(folder: Path) -> Problem:
    """A case."""
    return Problem(
        ss.read_recordings(folder / "simulated"),
        ss.read_recordings(folder / "recordings"),
        ss.Aircraft.from_toml(folder / "aircraft.toml"),
    )


def main() -> None:
    """Diagnose every case and its variants, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", type=Path, help="folders")
    parser.add_argument("--model", action="store_true", help="a model against files, on demonstration flights")
    a = parser.parse_args()
    warnings.simplefilter("ignore")
    rows: dict[str, list[tuple[bool, bool, float]]] = defaultdict(list)

    def compare(what: str, change: str, plain: Answer, other: Answer) -> None:
        rows[change].append((other.verdict == plain.verdict, other.first == plain.first, plain.moved(other)))
        print(f"{what}: {change}: {plain} -> {other}", file=sys.stderr, flush=True)

    for folder in a.cases:
        problem = read(folder)
        plain = Answer.of(problem)
        for name, change in (EXACT | NEAR).items():
            compare(folder.name, name, plain, Answer.of(change(problem)))
    if a.model:
        for lacking in LACKING:
            for turbulence in (0.0, 1.0):
                compare(f"without {lacking}", "files in place of a model", *model_and_files(lacking, turbulence))
    print("| change | cases | same verdict | same first name | largest change of a probability | median |")
    print("|---|---|---|---|---|---|")
    for name, each in rows.items():
        moved = [m for *_, m in each]
        verdicts, names = (sum(one[k] for one in each) for k in (0, 1))
        print(f"| {name} | {len(each)} | {verdicts} | {names} | {max(moved):.3f} | {np.median(moved):.3f} |")


if __name__ == "__main__":
    main()
