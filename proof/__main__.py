"""``python -m proof``: how often the diagnosis is right, on cases whose missing physics is known."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence, Sized
from dataclasses import asdict
from datetime import date
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from proof import run as campaign
from proof.score import WITHOUT, CaseScore
from proof.summary import SCHEMA, summarise
from proof.tables import page
from structsel import __version__
from structsel.cli.messages import json_text
from structsel.errors import DataError, StructselError
from structsel.files import write_text

_EXAMPLES = f"""examples:
  a hundred cases of development
    python -m proof --cases 100 --seed 2000 --out out/proof
  what is published: cases kept for evaluation, so many of each family
    python -m proof --judged --baselines --out out/judged \\
        --cases single=300,pair=60,null=200,outside=30,clutter=20,without=30
  one effect, its hypothesis left out of the library
    python -m proof --cases 10 --effects ground-effect --without-truth --out out/without

Each case is diagnosed by a process that sees a copy of its folder and nothing of its key. Give the same command again
to continue an interrupted run; with --done it scores what there is. docs/proof.md defines each figure. Seeds
{campaign.DEVELOPMENT[0]} to {campaign.DEVELOPMENT[-1]} are for development. Those from {campaign.JUDGED} on are for
evaluation, nothing is tuned on them, and --judged asks for them.
"""
_LINES = 20


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a campaign; exit code 1 where the data or the request cannot be used, 2 where the command cannot be read."""
    parser = _parser()
    asked = parser.parse_args(arguments)
    try:
        counts = _counts(asked.cases, WITHOUT if asked.without_truth else asked.family, bool(asked.effects))
    except ValueError as error:
        parser.error(str(error))
    try:
        _run(asked, counts)
    except StructselError as error:
        _say("error", str(error))
        return 1
    except KeyboardInterrupt:
        _say("error", "stopped by Ctrl-C. Give the same command again to continue.")
        return 130
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "python -m proof", description=(__doc__ or "").partition(": ")[2], epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False,
    )  # fmt: skip
    words: dict[str, Any] = {"type": _words, "default": [], "metavar": "NAMES"}
    parser.add_argument("--out", type=Path, required=True, help="folder of cases, keys, answers and the proof")
    parser.add_argument("--cases", default="20", help="how many: 100, or single=300,null=200")
    parser.add_argument("--seed", type=int, help="of the first case; by default 0, or the first for evaluation")
    parser.add_argument("--sources", **words, help="plants of the truth: polynomial,jsbsim")
    parser.add_argument("--family", default="", help=f"{', '.join(campaign.FAMILIES[:-1])}; drawn if not given")
    parser.add_argument("--effects", **words, help="of singles, in turn; drawn if not given")
    parser.add_argument("--severity", default="", choices=["", "easy", "medium", "hard"])
    parser.add_argument("--without-truth", action="store_true", help="singles, the right hypothesis left out")
    parser.add_argument("--judged", action="store_true", help="cases kept for evaluation")
    parser.add_argument("--baselines", action="store_true", help="also ask three simple methods")
    parser.add_argument("--jobs", type=int, default=2, help="number of parallel processes")
    parser.add_argument("--timeout", type=float, default=300.0, help="seconds after which a case counts as unanswered")
    parser.add_argument("--again", action="store_true", help="diagnose all again; the cases stay")
    parser.add_argument("--done", action="store_true", help="score what is done so far, and stop")
    parser.add_argument("--json", action="store_true", help="print JSON and nothing else")
    return parser


def _words(text: str) -> list[str]:
    return [word.strip() for word in text.split(",") if word.strip()]


def _run(asked: argparse.Namespace, counts: dict[str, int]) -> None:
    first = asked.seed if asked.seed is not None else campaign.JUDGED if asked.judged else 0
    draws = campaign.plan(
        counts, first, sources=_sources(asked.sources), effects=asked.effects, severity=asked.severity,
        judged=asked.judged,
    )  # fmt: skip
    total, out = len(draws), asked.out
    draws = campaign.as_stored(draws, out)
    if asked.done:
        draws = campaign.done(draws, out)
    else:
        _prove(draws, asked)
    scores, undrawn = campaign.scores_of(draws, out)
    errors = campaign.errors_of(draws, out)
    if errors:
        name, why = next(iter(errors.items()))
        _say("warning", f"{_cases(errors)} not answered; of {name}: {why.splitlines()[-1]}")
    command = _command(asked, first)
    about = _about(draws, scores, undrawn, errors, command, asked.judged)
    if len(draws) < total:
        about.append(f"so far: {len(draws)} of the {total} requested cases are done")
    summary = summarise(scores)
    content = json_text({
        "schema": SCHEMA, "date": date.today().isoformat(), "version": __version__, "command": command,
        "judged": asked.judged, **summary.to_dict(), "undrawn": undrawn, "errors": errors,
        "cases": [asdict(s) for s in scores],
    })  # fmt: skip
    text = page(summary, about)
    _write(out, {"proof.json": content, "proof.md": text})
    sys.stdout.write(content if asked.json else f"{text}\nwritten to '{out}': proof.json, proof.md\n")


def _prove(draws: Sequence[campaign.Draw], asked: argparse.Namespace) -> None:
    """Draw and diagnose what is not done; one run per folder."""
    asked.out.mkdir(parents=True, exist_ok=True)
    try:
        with FileLock(asked.out / ".lock", timeout=0):
            campaign.prove(
                draws, asked.out, jobs=asked.jobs, timeout=asked.timeout, again=asked.again, simple=asked.baselines,
                progress=_progress,
            )  # fmt: skip
    except Timeout as error:
        raise DataError(f"another run writes to '{asked.out}'. Wait for it, or choose another folder.") from error


def _command(asked: argparse.Namespace, first: int) -> str:
    """The command that gives the same cases."""
    options: dict[str, Any] = {
        "--cases": asked.cases, "--seed": first, "--sources": ",".join(asked.sources), "--family": asked.family,
        "--effects": ",".join(asked.effects), "--severity": asked.severity, "--without-truth": asked.without_truth,
        "--judged": asked.judged, "--baselines": asked.baselines, "--out": asked.out,
    }  # fmt: skip
    return " ".join(["python -m proof", *(k if v is True else f"{k} {v}" for k, v in options.items() if v)])


def _counts(cases: str, family: str, effects: bool) -> dict[str, int]:
    """Cases of each family; of ``""`` where seeds decide.

    Raises
    ------
    ValueError
        The text is neither a number nor family=number,...
    """
    if "=" in cases and (family or effects):
        raise ValueError("--cases names families already; leave out --family, --effects and --without-truth.")
    pairs = [part.partition("=")[::2] for part in cases.split(",")] if "=" in cases else [(family, cases)]
    try:
        counts = {name.strip() or ("single" if effects else ""): int(count) for name, count in pairs}
    except ValueError:
        counts = {"": 0}
    if min(counts.values()) < 1:
        raise ValueError(f"--cases is a number, or family=number,...; found '{cases}'.")
    return counts


def _sources(asked: Sequence[str]) -> Sequence[str]:
    """Requested sources, or all that are installed."""
    if not asked and find_spec("jsbsim") is None:
        _say("note", "JSBSim is not installed: all cases are of the polynomial plant.")
        return ("polynomial",)
    return ["polynomial" if s == campaign.FORMER_NAME else s for s in asked] or campaign.SOURCES


def _progress(what: str, done: int, of: int) -> None:
    """Report the progress twenty times in a run."""
    if done % max(1, of // _LINES) == 0 or done == of:
        _say("note", f"{done} of {of} cases done")


def _say(kind: str, text: str) -> None:
    print(f"{kind}: {text}", file=sys.stderr, flush=True)


def _cases(held: Sized) -> str:
    return f"{len(held)} case{'s' * (len(held) != 1)}"


def _about(
    draws: Sequence[campaign.Draw],
    scores: Sequence[CaseScore],
    undrawn: dict[str, str],
    errors: dict[str, str],
    command: str,
    judged: bool,
) -> list[str]:
    kind = "for evaluation" if judged else "of development"
    sources = ", ".join(sorted({s.source for s in scores}))
    lines = [
        f"{date.today().isoformat()}, structsel {__version__}: `{command}`",
        f"{_cases(scores)}, seeds {draws[0].seed} to {draws[-1].seed}, {kind}; truth by {sources or 'none'}",
    ]
    if undrawn:
        lines.append(f"{_cases(undrawn)} could not be drawn and left out; proof.json says why")
    if errors:
        lines.append(f"{_cases(errors)} not answered and counted as wrong; proof.json says why")
    return lines


def _write(out: Path, texts: dict[str, str]) -> None:
    """Write the proof into the folder of the cases."""
    try:
        for name, text in texts.items():
            write_text(out / name, text)
    except OSError as error:
        raise DataError(f"--out '{out}' cannot be written: {error.strerror or error}.") from error


if __name__ == "__main__":
    sys.exit(main())
