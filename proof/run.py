"""A campaign: many cases drawn, each diagnosed by a process that does not see its key, and scored."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from proof.generate import drawable
from proof.keys import Key
from proof.score import WITHOUT, CaseScore, score_case
from structsel.errors import DataError
from structsel.files import write_text

SOURCES = ("polynomial", "jsbsim")
FORMER_NAME = "own"
"""Of the source polynomial, in version 0.1.0."""
FAMILIES = ("single", "pair", "null", "outside", "clutter", WITHOUT)
DEVELOPMENT = range(0, 100_000)
"""Seeds of the cases that may be looked at."""
JUDGED = 1_000_000
"""First seed of the cases that only judge."""
PROGRAM = (sys.executable, "-m", "proof.worker")
_CLONE = Path(__file__).parents[1]
_DRAWING = 600.0  # s, that a case may take to draw

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Draw:
    """One case to be drawn.

    Attributes
    ----------
    source : {"polynomial", "jsbsim"}
    seed : int
    family, effect, severity : str
        Empty where the seed decides.
    without_truth : bool
        Its hypothesis is taken out of the library.
    """

    source: str
    seed: int
    family: str = ""
    effect: str = ""
    severity: str = ""
    without_truth: bool = False

    @property
    def name(self) -> str:
        """Of its files."""
        return f"{self.source}-{self.seed:07d}"


def plan(
    counts: Mapping[str, int],
    seed: int,
    *,
    sources: Sequence[str] = SOURCES,
    effects: Sequence[str] = (),
    severity: str = "",
    judged: bool = False,
) -> list[Draw]:
    """Cases to be drawn: sources in turn, effects in turn, seeds one after another.

    Parameters
    ----------
    counts : mapping of family to number of cases
        ``""`` lets each seed decide its family; ``without`` are singles whose hypothesis is taken out.
    seed : int
        The first.
    sources : sequence of {"polynomial", "jsbsim"}
    effects : sequence of str, optional
        Of singles.
    severity : str, optional
    judged : bool
        Seeds must be among those kept for judging; otherwise among those of development.

    Raises
    ------
    DataError
        A name is not known, JSBSim is not installed, or the seeds belong to the other range.
    """
    for what, given, known in (("source", sources, SOURCES), ("family", counts, ("", *FAMILIES))):
        if strange := [g for g in given if g not in known]:
            raise DataError(f"prove knows no {what} '{strange[0]}'; it knows {', '.join(filter(None, known))}.")
    if "jsbsim" in sources and find_spec("jsbsim") is None:
        raise DataError(
            "prove: JSBSim is not installed, so it cannot simulate a case.\n"
            'Install it with pip install "structsel[jsbsim]", or choose the source polynomial.'
        )
    if effects and set(counts) - {"single", WITHOUT}:
        raise DataError("prove: effects can be chosen for singles only. Choose the family single.")
    last = seed + sum(counts.values()) - 1
    if judged and seed < JUDGED:
        raise DataError(f"prove: seeds that judge begin at {JUDGED}; found {seed}.")
    if not judged and not (seed in DEVELOPMENT and last in DEVELOPMENT):
        raise DataError(
            f"prove: seeds {seed} to {last} are not those of development, {DEVELOPMENT[0]} to {DEVELOPMENT[-1]}.\n"
            f"Seeds from {JUDGED} on are kept for evaluation: choose judged."
        )
    made: list[Draw] = []
    for family, count in counts.items():
        for i in range(count):
            effect = effects[(i // len(sources)) % len(effects)] if effects else ""
            able = [s for s in sources if not effect or effect in drawable(s)]
            if not able:
                raise DataError(f"prove: no case of '{effect}' can be drawn by {', '.join(sources)}.")
            alone = "single" if family == WITHOUT else family
            made.append(Draw(able[i % len(able)], seed + len(made), alone, effect, severity, family == WITHOUT))
    return made


def prove(
    draws: Sequence[Draw],
    out: Path,
    *,
    jobs: int = 2,
    timeout: float = 300.0,
    again: bool = False,
    simple: bool = False,
    progress: Progress | None = None,
    program: Sequence[str] | None = None,
) -> None:
    """Draw and diagnose cases that are not done yet.

    Cases are in ``out/cases``, keys in ``out/keys``, answers in ``out/answers``. A case is diagnosed in a process
    that sees a copy of its folder under another name, elsewhere, and gets nothing else; it prints its answer, and
    this process writes it down. What was done when a run was interrupted is not done again; a process that broke down
    is started again, one that took too long is not.

    Parameters
    ----------
    draws : sequence of Draw
    out : Path
    jobs : int
        Number of parallel processes.
    timeout : float [s]
        After which a case counts as not answered.
    again : bool
        Diagnose also what was diagnosed; the cases stay.
    simple : bool
        Ask the baselines too.
    progress : callable, optional
    program : sequence of str, optional
        In place of :mod:`proof.worker`.

    Raises
    ------
    DataError
        The folder holds cases that were drawn otherwise.
    """
    out = out.resolve()  # processes run in folders of their own
    _check_plan(draws, out)
    tell = progress or (lambda what, done, of: None)
    campaign = _Campaign(out, timeout, tuple(program or PROGRAM), again, simple)
    pool = ThreadPoolExecutor(jobs, initializer=_pin_to_core, initargs=(_cores(),))
    try:
        running = [pool.submit(campaign.complete, d) for d in in_turn(draws)]
        for done, one in enumerate(as_completed(running)):
            one.result()
            tell("cases", done + 1, len(draws))
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def as_stored(draws: Sequence[Draw], out: Path) -> list[Draw]:
    """Draws with the names that a folder has for them: version 0.1.0 called the source "polynomial" "own"."""
    path = out / "plan.json"
    held = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    if not any(one["source"] == FORMER_NAME for one in held.values()):
        return list(draws)
    return [replace(d, source=FORMER_NAME) if d.source == "polynomial" else d for d in draws]


def done(draws: Sequence[Draw], out: Path) -> list[Draw]:
    """Those of the cases that are answered, or could not be drawn.

    Raises
    ------
    DataError
        None is.
    """
    held = [d for d in draws if _answer_of(d.name, out).exists()]
    if not held:
        raise DataError(f"'{out}' holds no answer to these cases yet. Give the command that began the proof.")
    return held


def in_turn(draws: Sequence[Draw]) -> list[Draw]:
    """Families in proportion, so that the part done by an interrupted run is a fair sample."""
    families: dict[tuple[str, bool], list[Draw]] = {}
    for one in draws:
        families.setdefault((one.family, one.without_truth), []).append(one)
    placed = [((k + 0.5) / len(some), one) for some in families.values() for k, one in enumerate(some)]
    return [one for _, one in sorted(placed, key=lambda item: item[0])]


def _cores() -> SimpleQueue[int]:
    """Cores that this process may use; none where the system does not say."""
    free: SimpleQueue[int] = SimpleQueue()
    for core in sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else ():
        free.put(core)
    return free


def _pin_to_core(free: SimpleQueue[int]) -> None:
    """Keep a thread and the processes it starts to one core: two threads of one case would wait for each other."""
    if not free.empty():
        core = free.get()
        os.sched_setaffinity(0, {core})
        free.put(core)


def _check_plan(draws: Sequence[Draw], out: Path) -> None:
    """Note what is drawn, or refuse a folder whose cases were drawn otherwise."""
    path = out / "plan.json"
    wanted = {d.name: asdict(d) for d in draws}
    held = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    if clash := next((n for n in wanted if n in held and held[n] != wanted[n]), None):
        raise DataError(
            f"'{out}' holds case {clash} drawn otherwise than is asked now. Choose another folder for this proof."
        )
    _write(path, held | wanted)


@dataclass(frozen=True)
class _Campaign:
    """Folder and settings of a campaign."""

    out: Path
    timeout: float
    program: tuple[str, ...]
    again: bool
    simple: bool

    def complete(self, asked: Draw) -> None:
        """Draw one case and diagnose it, as far as that is not done."""
        path = _answer_of(asked.name, self.out)
        answer = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        if "undrawn" in answer:
            return
        case, key = self.out / "cases" / asked.name, self.out / "keys" / f"{asked.name}.json"
        if not case.exists() and (refused := self._draw(asked, case, key)):
            _write(path, refused)
            return
        simple = self.simple and not asked.without_truth
        if self.again or not {"diagnosis", "error"} & set(answer) or (simple and not {"simple", "error"} & set(answer)):
            gone = [n for e in Key.read(key).effects for n in e.accept] if asked.without_truth else []
            new = self._ask(case, "diagnose", ",".join(gone), *(["simple"] if simple else []))
            # A diagnosis stands, though asking the baselines as well took too long.
            if self.again or "diagnosis" in new or "diagnosis" not in answer:
                _write(path, new)

    def _draw(self, asked: Draw, case: Path, key: Path) -> dict[str, Any]:
        """Draw a case; empty, or why it could not be."""
        with tempfile.TemporaryDirectory(prefix=f".{asked.name}.", dir=_made(self.out)) as place:
            request = json.dumps({**asdict(asked), "name": asked.name})
            answer = _run([*self.program, "draw", request, place], Path(place), _DRAWING)
            if answer:
                return answer if "crash" in answer else {"undrawn": answer.get("undrawn", answer.get("error", ""))}
            # The case last: if there is a case, there is its key.
            os.replace(Path(place) / "key" / key.name, _made(key.parent) / key.name)
            os.replace(Path(place) / "case" / asked.name, _made(case.parent) / asked.name)
        return {}

    def _ask(self, case: Path, task: str, *more: str) -> dict[str, Any]:
        with tempfile.TemporaryDirectory() as place:
            shutil.copytree(case, Path(place) / "case")
            return _run([*self.program, task, "case", *more], Path(place), self.timeout)


def _run(command: Sequence[str], place: Path, timeout: float) -> dict[str, Any]:
    """Run a process in a folder of its own; what it printed, or an ``error``, or a ``crash`` where it said nothing."""
    # These name the folder of this process, which may hold the keys.
    environment = {k: v for k, v in os.environ.items() if k not in ("PWD", "OLDPWD")}
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, [str(_CLONE), environment.get("PYTHONPATH", "")]))
    try:
        done = subprocess.run(
            command, cwd=place, env=environment, capture_output=True, text=True, timeout=timeout, check=False
        )
    except subprocess.TimeoutExpired:
        return {"error": f"no answer within {timeout:g} s"}
    try:
        answer = json.loads(done.stdout.splitlines()[-1])
    except (IndexError, ValueError):
        return {"crash": f"exit code {done.returncode}: {done.stderr.strip()[-2000:]}"}
    return dict(answer)


def _answer_of(name: str, out: Path) -> Path:
    return out / "answers" / f"{name}.json"


def _made(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _write(path: Path, content: Mapping[str, Any]) -> None:
    """Write JSON whole or not at all."""
    write_text(_made(path.parent) / path.name, json.dumps(content, indent=1) + "\n")


def scores_of(draws: Sequence[Draw], out: Path) -> tuple[list[CaseScore], dict[str, str]]:
    """Scores of all cases that were drawn, and why the others were not.

    Returns
    -------
    scores : list of CaseScore
    undrawn : mapping of case to reason
    """
    scores, undrawn = [], {}
    for asked in draws:
        path = _answer_of(asked.name, out)
        answer = json.loads(path.read_text(encoding="utf-8"))
        at = out / "keys" / f"{asked.name}.json"
        if not at.exists():
            undrawn[asked.name] = answer.get("undrawn") or answer.get("crash", "")
            continue
        key = Key.read(at)
        scores.append(
            score_case(
                asked.name, answer.get("diagnosis"), key, answer.get("spans"), without_truth=asked.without_truth,
                simple=answer.get("simple"), seconds=answer.get("seconds", math.nan),
            )
        )  # fmt: skip
    return scores, undrawn


def errors_of(draws: Sequence[Draw], out: Path) -> dict[str, str]:
    """Errors of the cases that were drawn but not answered."""
    names = [d.name for d in draws if (out / "keys" / f"{d.name}.json").exists()]
    held = {n: json.loads(_answer_of(n, out).read_text(encoding="utf-8")) for n in names}
    return {n: a.get("error") or a["crash"] for n, a in held.items() if {"error", "crash"} & set(a)}
