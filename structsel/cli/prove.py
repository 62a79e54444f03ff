"""``structsel prove``: how often the diagnosis is right, on cases whose missing physics is concealed."""

from __future__ import annotations

from collections.abc import Sequence, Sized
from dataclasses import asdict
from datetime import date
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from structsel import __version__
from structsel.atomic import write_text
from structsel.cli.flights import OUTPUT, Json, option, words
from structsel.cli.output import claim
from structsel.cli.pages import page
from structsel.cli.tables import print_files
from structsel.cli.terminal import Waiting, json_text, print_json, say, stdout
from structsel.errors import DataError
from structsel.proving import running
from structsel.proving.scoring import WITHOUT, CaseScore
from structsel.proving.summary import SCHEMA, summarise
from structsel.proving.tables import page as proof_page

EPILOG = page(
    [
        ("A hundred cases of development", "structsel prove --cases 100 --seed 2000 --out out/proof"),
        (
            "What is published: cases kept to judge, so many of each family",
            "structsel prove --judged --baselines --out out/judged \\\n"
            "    --cases single=300,pair=60,null=200,outside=30,clutter=20,without=30",
        ),
        (
            "One effect, its hypothesis taken out of the library",
            "structsel prove --cases 10 --effects ground-effect --without-truth --out out/without",
        ),
    ],
    """Each case is diagnosed by a process that sees a copy of its folder and is told nothing of its key. An interrupted
    run goes on where it stopped when the same command is given again; with --done it scores what there is.
    docs/proof.md says how each figure is defined.""",
    f"""[bold]Seeds[/bold] {running.DEVELOPMENT[0]} to {running.DEVELOPMENT[-1]} are for development; from
    {running.JUDGED} on they judge, nothing is tuned on them, and --judged asks for them.""",
)
_DRAWN = "Which cases"
_LINES = 20


def run(
    out: Annotated[Path, option("--out", "Folder for cases, keys, answers and the proof.", OUTPUT, "DIR")],
    cases: Annotated[str, option("--cases", "How many: 100, or single=300,null=200.", _DRAWN, "N")] = "20",
    seed: Annotated[int | None, option("--seed", "Of the first case; 0, or the first that judges.", _DRAWN)] = None,
    sources: Annotated[str, option("--sources", "Who flies the truth: own,jsbsim.", _DRAWN, "NAMES")] = "",
    family: Annotated[
        str, option("--family", f"{', '.join(running.FAMILIES[:-1])}; drawn if not given.", _DRAWN, "NAME")
    ] = "",
    effects: Annotated[str, option("--effects", "Of singles, in turn; drawn if not given.", _DRAWN, "NAMES")] = "",
    severity: Annotated[str, option("--severity", "easy, medium or hard.", _DRAWN, "NAME")] = "",
    without_truth: Annotated[
        bool, option("--without-truth", "Singles, the right hypothesis taken out of the library.", _DRAWN)
    ] = False,
    judged: Annotated[bool, option("--judged", "Cases kept to judge.", _DRAWN)] = False,
    baselines: Annotated[bool, option("--baselines", "Ask three simple ways too.")] = False,
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="Cases at a time.")] = 2,
    timeout: Annotated[
        float, typer.Option("--timeout", min=1.0, help="Seconds after which a case counts as not answered.")
    ] = 300.0,
    again: Annotated[bool, option("--again", "Diagnose all again; the cases stay.")] = False,
    done: Annotated[bool, option("--done", "Score what is done so far, and go on with nothing.")] = False,
    json: Json = False,
) -> None:
    """Draw concealed cases, diagnose each apart from its key, and score what was said."""
    if severity not in ("", "easy", "medium", "hard"):
        raise typer.BadParameter(f"--severity is easy, medium or hard; found '{severity}'.")
    counts = _counts(cases, WITHOUT if without_truth else family or ("single" if effects else ""))
    first = seed if seed is not None else running.JUDGED if judged else 0
    draws = running.plan(
        counts, first, sources=_sources(sources), effects=words(effects), severity=severity, judged=judged
    )
    asked = len(draws)
    if done:
        draws = running.done(draws, out)
    else:
        out.mkdir(parents=True, exist_ok=True)  # the lock of a folder that is there lies in it
        claim(out)
        with Waiting("proving") as waiting:
            running.prove(
                draws, out, jobs=jobs, timeout=timeout, again=again, simple=baselines,
                progress=lambda what, count, of: _tell(waiting, what, count, of),
            )  # fmt: skip
    scores, undrawn = running.scores_of(draws, out)
    errors = running.errors_of(draws, out)
    if errors:
        name, why = next(iter(errors.items()))
        say("warning", f"{_cases(errors)} not answered; of {name}: {why.splitlines()[-1]}")
    summary = summarise(scores)
    options = {
        "--cases": cases, "--seed": first, "--sources": sources, "--family": family, "--effects": effects,
        "--severity": severity, "--without-truth": without_truth, "--judged": judged, "--baselines": baselines,
        "--out": out,
    }  # fmt: skip
    command = " ".join(["structsel prove", *(f"{k}" if v is True else f"{k} {v}" for k, v in options.items() if v)])
    about = _about(draws, scores, undrawn, errors, command, judged)
    if len(draws) < asked:
        about.append(f"so far: {len(draws)} of the {asked} cases asked for are done")
    content = {
        "schema": SCHEMA, "date": date.today().isoformat(), "version": __version__, "command": command,
        "judged": judged, **summary.to_dict(), "undrawn": undrawn, "errors": errors,
        "cases": [asdict(s) for s in scores],
    }  # fmt: skip
    told = proof_page(summary, about)
    written = _write(out, {"proof.json": json_text(content), "proof.md": told})
    if json:
        print_json(content)
        return
    stdout().print(told, markup=False, soft_wrap=True)
    print_files(stdout(), str(out), written)


def _counts(cases: str, family: str) -> dict[str, int]:
    """Cases of each family; of ``""`` where seeds decide."""
    try:
        if "=" not in cases:
            return {family: _positive(cases)}
        pairs = [part.partition("=") for part in words(cases)]
        counts = {name.strip(): _positive(count) for name, _, count in pairs}
    except ValueError:
        raise typer.BadParameter(f"--cases is a number, or family=number,...; found '{cases}'.") from None
    if family:
        raise typer.BadParameter("--cases names families already; leave out --family, --effects and --without-truth.")
    return counts


def _positive(text: str) -> int:
    count = int(text)
    if count < 1:
        raise ValueError(text)
    return count


def _sources(text: str) -> tuple[str, ...]:
    """Sources asked for, or all that are installed."""
    if text:
        return tuple(words(text))
    if find_spec("jsbsim") is None:
        say("note", "JSBSim is not installed: all cases are flown by our own models.")
        return ("own",)
    return running.SOURCES


def _tell(waiting: Waiting, what: str, done: int, of: int) -> None:
    """Progress on a terminal; otherwise a line now and then, so that a log of a long run says how far it is."""
    waiting(what, done, of)
    if not Console(stderr=True).is_terminal and (done % max(1, of // _LINES) == 0 or done == of):
        say("note", f"{done} of {of} cases done")


def _cases(held: Sized) -> str:
    return f"{len(held)} case{'s' * (len(held) != 1)}"


def _about(
    draws: Sequence[running.Draw],
    scores: Sequence[CaseScore],
    undrawn: dict[str, str],
    errors: dict[str, str],
    command: str,
    judged: bool,
) -> list[str]:
    kind = "kept to judge" if judged else "of development"
    sources = ", ".join(sorted({s.source for s in scores}))
    lines = [
        f"{date.today().isoformat()}, structsel {__version__}: `{command}`",
        f"{_cases(scores)}, seeds {draws[0].seed} to {draws[-1].seed}, {kind}; flown by {sources or 'none'}",
    ]
    if undrawn:
        lines.append(f"{_cases(undrawn)} could not be drawn and left out; proof.json says why")
    if errors:
        lines.append(f"{_cases(errors)} not answered and counted as wrong; proof.json says why")
    return lines


def _write(out: Path, texts: dict[str, str]) -> list[str]:
    """Write the proof beside the cases; return the names written."""
    try:
        for name, text in texts.items():
            write_text(out / name, text)
    except OSError as error:
        raise DataError(f"--out '{out}' cannot be written: {error.strerror or error}.") from error
    return list(texts)
