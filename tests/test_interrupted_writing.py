"""Faults that must leave no half file and no traceback: full disks, closed folders, Ctrl-C, two runs at once."""

import ast
import errno
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import structsel
from structsel import AeroModel, write_recording
from structsel.candidates import Term
from structsel.cli import folders
from structsel.errors import DataError, StructselError, TermError
from structsel.exporting import export_model
from structsel.model import ResponseModel
from structsel.recording import Recording
from tests.commands import run

PACKAGE = Path(structsel.__file__).parent
T = np.arange(400) * 0.04
ALPHA, DE = 0.1 + 0.03 * np.sin(0.7 * T), 0.05 * np.sign(np.sin(1.1 * T))
CM = 0.02 - 0.5 * ALPHA - 1.5 * DE + 0.001 * np.random.default_rng(1).standard_normal(400)
FLIGHT = Recording("m01", T, {"alpha": ALPHA, "de": DE, "Cm": CM})
MODEL = AeroModel({"Cm": ResponseModel((Term("1"), Term("alpha")), np.array([0.02, -0.5]))})
WRITERS = {
    "m.csv": lambda path: write_recording(FLIGHT, path, overwrite=True),
    "m.parquet": lambda path: write_recording(FLIGHT, path, overwrite=True),
    "model.json": lambda path: MODEL.to_json(path, overwrite=True),
    "model.py": lambda path: export_model(MODEL, path, to="python", overwrite=True),
    "model.c": lambda path: export_model(MODEL, path, to="c", overwrite=True),
}


def content(folder):
    """Every file of a folder, hidden ones too, with what it holds."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def run_any(*arguments):
    """Result of a command, whatever its exit code."""
    return run(*arguments, code=None)


@pytest.fixture
def select(tmp_path):
    """Arguments of a selection into `out`, which holds an earlier one."""
    write_recording(FLIGHT, tmp_path / "m01.csv")
    out = tmp_path / "out"
    out.mkdir()
    for name in ("model.json", "report.txt", "mine.txt"):
        (out / name).write_text("old")
    arguments = ("select", tmp_path / "m01.csv", "--responses", "Cm", "--candidates", "alpha,de", "--degree", "1")
    return (*arguments, "--no-plots", "--overwrite", "--out", out)


# --- one file --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="only Linux has a device that is always full")
def test_a_full_disk_leaves_the_old_file_and_says_so(name, tmp_path):
    path = tmp_path / name
    path.write_text("old")
    # What is written beside the file ends on a device on which every write fails for want of space.
    (tmp_path / f".{name}.{os.getpid()}.partial").symlink_to("/dev/full")
    with pytest.raises(StructselError, match=f"{name}' cannot be written: No space left on device"):
        WRITERS[name](path)
    assert content(tmp_path) == {name: b"old"}


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_ctrl_c_at_the_last_step_leaves_the_old_file(name, step, tmp_path, monkeypatch):
    path = tmp_path / name
    path.write_text("old")

    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, step, stop)
    with pytest.raises(KeyboardInterrupt):
        WRITERS[name](path)
    assert content(tmp_path) == {name: b"old"}


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="the superuser may write anywhere")
@pytest.mark.parametrize("name", WRITERS)
def test_a_closed_folder_is_named(name, tmp_path):
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(StructselError, match=f"{name}' cannot be written: Permission denied"):
            WRITERS[name](tmp_path / name)
    finally:
        tmp_path.chmod(0o700)


# --- a folder of results ---------------------------------------------------------------------------


FAULTS = {
    "full disk": (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), 1, "written: No space left on device"),
    "read-only": (OSError(errno.EROFS, os.strerror(errno.EROFS)), 1, "written: Read-only file system"),
    "closed": (OSError(errno.EACCES, os.strerror(errno.EACCES)), 1, "written: Permission denied"),
    "Ctrl-C": (KeyboardInterrupt(), 130, "stopped by Ctrl-C"),
}


def failing(real, fails_at, fault):
    """Return a function that raises a fault when it is called for so many times, and lists its calls."""
    calls = []

    def tried(*arguments, **options):
        # The process id in the lock is a courtesy, a compiled kernel's cache no result: their loss is no fault.
        if not re.search(r"\.lock$|\.nb[ci]", str(arguments[0])):
            calls.append(arguments)
            if len(calls) == fails_at:
                raise fault
        return real(*arguments, **options)

    return tried, calls


@pytest.mark.parametrize("fault", ["full disk", "Ctrl-C"])
@pytest.mark.parametrize(("where", "step"), [(Path, "write_text"), (os, "replace"), (Path, "mkdir")])
def test_a_fault_at_any_step_leaves_the_folder_as_it_was(where, step, fault, tmp_path, monkeypatch):
    out = tmp_path / "out"
    out.mkdir()
    for name in ("model.json", "report.txt", "mine.txt"):
        (out / name).write_text("old")
    before = content(tmp_path)
    error = FAULTS[fault][0]
    survived = 0
    while True:
        tried, calls = failing(getattr(where, step), survived + 1, error)
        with monkeypatch.context() as patch:
            patch.setattr(where, step, tried)
            try:
                with folders.output_folder(out) as folder:
                    MODEL.to_json(folder / "model.json")
                    (folder / "report.txt").write_text("new")
                    (folder / "plots").mkdir()
                    (folder / "plots" / "data.txt").write_text("new")
            except (StructselError, KeyboardInterrupt):
                assert content(tmp_path) == before
                survived += 1
                continue
        break
    assert survived == len(calls) >= 3
    after = content(out)
    assert after.keys() == {"mine.txt", "model.json", "report.txt", "plots/data.txt"}
    assert after["mine.txt"] == b"old"
    assert after["report.txt"] == b"new"


@pytest.mark.parametrize("fault", FAULTS)
def test_a_command_says_what_stopped_it_and_leaves_the_old_results(fault, select, monkeypatch):
    error, code, says = FAULTS[fault]
    before = content(select[-1].parent)
    tried, calls = failing(os.replace, 3, error)
    monkeypatch.setattr(os, "replace", tried)
    result = run_any(*select)
    assert len(calls) >= 3
    assert result.exit_code == code
    assert result.stderr.startswith("error: ")
    assert says in result.stderr
    assert result.stdout == ""
    assert content(select[-1].parent) == before


def test_what_a_killed_run_left_is_cleared_away(select):
    out = select[-1]
    leftover = out / ".out.partial"
    leftover.mkdir()
    (leftover / "model.json").write_text("half")
    (out / ".out.lock").write_text("999999999")
    run(*select)
    assert not [p.name for p in out.iterdir() if p.name.startswith(".")]


def test_a_new_folder_that_cannot_be_filled_is_removed(select, tmp_path):
    (tmp_path / "file").write_text("")
    before = content(tmp_path)
    result = run_any(*select[:-1], tmp_path / "file" / "new" / "out")
    assert result.exit_code == 1
    assert "cannot be written: Not a directory" in result.stderr
    result = run_any("select", tmp_path / "absent.csv", *select[2:-1], tmp_path / "new" / "deep" / "out")
    assert result.exit_code == 1
    assert content(tmp_path) == before
    assert not (tmp_path / "new").exists()


def test_the_current_folder_can_be_written_to(select, tmp_path, monkeypatch):
    monkeypatch.chdir(select[-1])
    run(*select[:-1], ".")
    assert json.loads((select[-1] / "model.json").read_text())["schema"] == "structsel.model/1"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["m01.csv", "out"]


# --- messages --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["x" * 9000, "x " * 4500], ids=["word", "line"])
def test_a_name_of_thousands_of_characters_is_cut_in_print(name):
    stated = str(DataError(f"'r.csv' has no channel 't'.\nIt has: {name}.\nName the column."))
    assert stated.startswith("'r.csv' has no channel 't'.\nIt has: x")
    assert stated.endswith(".\nName the column.")
    assert re.search(r"\(900\d characters\)", stated)
    assert len(stated) < 500


# --- two runs at once ------------------------------------------------------------------------------


def test_the_second_of_two_runs_into_one_folder_is_refused_by_process(select):
    with folders.folder_locks():
        folders.lock_folder(select[-1])
        result = run_any(*select)
        assert result.exit_code == 1
        assert f"is being written to by another run, process {os.getpid()}. Wait until it has ended" in result.stderr
        run(*select[:-1], select[-1].parent / "another")
    run(*select)


def test_a_folder_not_yet_there_is_claimed_too(tmp_path):
    out = tmp_path / "deep" / "out"
    with folders.folder_locks():
        folders.lock_folder(out)
        with folders.folder_locks(), pytest.raises(DataError, match="another run"):
            folders.refuse_existing(out, overwrite=True)
    assert list(tmp_path.iterdir()) == []


_HOLDS = """
import sys, time
from pathlib import Path
from structsel.cli import folders
with folders.folder_locks():
    folders.lock_folder(Path(sys.argv[1]))
    print("claimed", flush=True)
    time.sleep(60)
"""


@pytest.mark.slow
def test_the_lock_of_a_killed_run_does_not_hold(select):
    other = subprocess.Popen([sys.executable, "-c", _HOLDS, select[-1]], stdout=subprocess.PIPE, text=True)
    try:
        assert other.stdout.readline() == "claimed\n"
        assert f"process {other.pid}" in run_any(*select).stderr
    finally:
        other.kill()
        other.wait()
    run(*select)


# --- Ctrl-C ----------------------------------------------------------------------------------------

_INTERRUPTED = """
import sys, time
import structsel.cli.select as command
def work(*_, **__):
    print("working", flush=True)
    time.sleep(60)
command.select = work
from structsel.cli import main
main()
"""


def _heed_interrupts():
    """Whatever starts the tests in the background has them, and their children, ignore Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.skipif(sys.platform == "win32", reason="signals are sent otherwise there")
def test_ctrl_c_ends_a_command_with_130_and_words(select):
    before = content(select[-1])
    program = subprocess.Popen(
        [sys.executable, "-c", _INTERRUPTED, *map(str, select)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=_heed_interrupts,
    )  # fmt: skip
    assert program.stdout.readline() == "working\n"
    program.send_signal(signal.SIGINT)
    _, stated = program.communicate(timeout=20)
    assert program.returncode == 130
    assert stated.startswith("error: stopped by Ctrl-C. No file is incomplete")
    assert "Traceback" not in stated
    assert content(select[-1]) == before


# --- nothing from a file is executed ---------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os')",
        "__import__(os)",
        "alpha.__class__",
        "alpha.real",
        "exec(alpha)",
        "eval(alpha)",
        "open(alpha)",
        "(lambda: 1)()",
        "[alpha for alpha in q]",
        "alpha[q]",
        "alpha if q else de",
        "alpha^q",
        "9^9^9^9^9^9",
        "alpha^9^9^9^9",
        "1e999",
        "9" * 999,
        "9" * 5000,
        "(" * 400 + "alpha" + ")" * 400,
        "sin(" * 200 + "alpha" + ")" * 200,
        "-" * 900 + "alpha",
        "alpha\0",
        "abs(*alpha)",
        "",
    ],
    ids=lambda text: text[:20] or "empty",
)
def test_a_term_that_is_no_formula_is_refused_at_once(text):
    start = time.process_time()
    with pytest.raises(TermError):
        Term(text)
    assert time.process_time() - start < 1.0


def test_nothing_in_the_package_evaluates_text_or_unpickles():
    forbidden = {"pickle", "cPickle", "dill", "cloudpickle", "shelve", "marshal"}
    found, seen = [], 0
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            seen += 1
            match node:
                case ast.Import(names=names):
                    wrong = forbidden & {name.name.partition(".")[0] for name in names}
                case ast.ImportFrom(module=str(module)):
                    wrong = forbidden & {module.partition(".")[0]}
                case ast.Call(func=ast.Name(id="eval" | "exec" | "compile" as name)):
                    wrong = {name}
                case ast.Call(func=ast.Attribute(attr="read_pickle" | "to_pickle" as name)):
                    wrong = {name}
                case ast.keyword(arg="allow_pickle", value=ast.Constant(value=True)):
                    wrong = {"allow_pickle"}
                case _:
                    continue
            found += [f"{path.relative_to(PACKAGE)}:{getattr(node, 'lineno', 0)} {name}" for name in wrong]
    assert seen > 100_000
    assert found == []


def test_objects_in_numpy_files_are_never_unpickled(tmp_path):
    class Trap:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "sprung"),)

    np.save(tmp_path / "trap.npy", np.array([Trap()], dtype=object), allow_pickle=True)
    with pytest.raises(DataError, match="no NumPy file that can be read"):
        structsel.read_recording(tmp_path / "trap.npy")
    assert not (tmp_path / "sprung").exists()
