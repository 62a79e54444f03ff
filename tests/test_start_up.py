"""Start-up: nothing is imported before it is needed, and type checkers still see every name."""

import ast
import inspect
import json
import pickle
import subprocess
import sys
import time
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import structsel as ss
from structsel.cli import messages
from structsel.cli.program import COMMANDS
from structsel.numerics import compiling
from tests.commands import run

HEAVY = ("h5py", "matplotlib", "numba", "pandas", "pint", "pyarrow", "scipy.optimize", "scipy.stats", "sklearn",
         "statsmodels")  # fmt: skip
PROGRAM = "import sys; from structsel.cli import main; sys.argv[0] = 'structsel'; main()"


def loaded_by(code, *arguments):
    """Modules that a new process has imported."""
    ask = "import atexit, json, sys; atexit.register(lambda: print(json.dumps(sorted(sys.modules)), file=sys.stderr))\n"
    ended = subprocess.run([sys.executable, "-c", ask + code, *arguments], capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr
    return set(json.loads(ended.stderr.splitlines()[-1]))


@pytest.mark.parametrize("option", ["--version", "--help"])
def test_version_and_help_import_no_command_and_no_library_of_arrays(option):
    loaded = loaded_by(PROGRAM, option)
    assert loaded.isdisjoint({*HEAVY, "numpy", "pydantic", "structsel.cli.select", "structsel.recording"})


def test_the_help_of_a_command_imports_no_other_command_and_no_compiler():
    loaded = loaded_by(PROGRAM, "select", "--help")
    assert "structsel.cli.select" in loaded
    assert loaded.isdisjoint({*HEAVY, "structsel.cli.diagnose", "structsel.diagnosis", "structsel.report"})


@pytest.mark.parametrize("name", ["Recording", "select", "reconstruct", "simulate", "refine", "diagnose"])
def test_the_first_use_of_a_name_imports_no_heavy_library(name):
    assert loaded_by(f"import structsel; structsel.{name}").isdisjoint(HEAVY)


def test_the_package_alone_imports_nothing():
    loaded = loaded_by("import structsel")
    assert {module for module in loaded if module.startswith("structsel")} == {"structsel"}
    assert "numpy" not in loaded


def test_type_checkers_see_the_names_that_exist():
    stub = ast.parse((Path(ss.__file__).parent / "__init__.pyi").read_text())
    seen = {alias.asname: node.module for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    seen = {name: module for name, module in seen.items() if name is not None}  # the other imports are for types
    seen |= {node.name: "structsel.selection" for node in stub.body if isinstance(node, ast.FunctionDef)}
    assert sorted(seen) == sorted(ss.__all__)
    for name, module in seen.items():
        thing = getattr(ss, name)
        assert thing is getattr(import_module(module), name)
    assert set(ss.__all__) <= set(dir(ss))


@pytest.mark.parametrize("name", COMMANDS)
def test_the_list_of_commands_says_what_each_says_of_itself(name):
    assert (
        inspect.getdoc(import_module(f"structsel.cli.{name.replace(chr(45), chr(95))}").run).splitlines()[0]
        == COMMANDS[name]
    )


def test_an_unknown_name_is_refused():
    with pytest.raises(AttributeError, match="has no attribute 'selct'"):
        ss.selct  # noqa: B018


@compiling.njit(cache=False)
def doubled(x):
    return 2.0 * x


@compiling.njit(cache=False)
def quadrupled(x):
    return doubled(doubled(x))


def test_kernels_call_each_other_after_the_compiler_is_imported():
    np.testing.assert_array_equal(quadrupled(np.arange(3.0)), [0.0, 4.0, 8.0])


def test_kernels_wait_for_the_compiler_in_a_new_process():
    code = """
import sys
import time
from structsel.numerics import linear_systems as kernels, compiling
waiting = len(compiling._WAITING)
assert waiting and "numba" not in sys.modules
compiling.load_compiler()
assert "numba" in sys.modules and not compiling._WAITING
held = [k for m in list(sys.modules.values()) if getattr(m, "__name__", "").startswith("structsel")
        for k in vars(m).values() if hasattr(k, "py_func")]
assert len(held) >= waiting
"""
    loaded_by(code)


def test_compilation_is_reported_and_reading_the_cache_is_not():
    seen = []
    kernel = compiling.njit(cache=False)(lambda x: x + 1.0)
    with compiling.compilation(seen.append):
        kernel(1.0)
        kernel(2.0)
    assert seen == [True, False]


def test_a_misspelled_command_names_the_nearest():
    assert "Did you mean 'select'?" in " ".join(run("selct", code=2).stderr.split())


@pytest.mark.parametrize("terminal", [True, False])
def test_a_progress_line_says_that_code_is_compiled_on_a_terminal_only(terminal, monkeypatch, capsys):
    monkeypatch.setattr(messages, "PROGRESS_DELAY", 0.0)
    monkeypatch.setenv("COLUMNS", "160")
    if terminal:
        monkeypatch.setenv("FORCE_COLOR", "1")
        monkeypatch.setenv("TTY_COMPATIBLE", "1")
    kernel = compiling.njit(cache=False)(lambda x: x + 1.0)
    with messages.ProgressBar("reconstructing"):
        time.sleep(0.3)  # the bar is shown by a timer
        kernel(1.0)
    assert (messages.COMPILING in capsys.readouterr().err) is terminal


def test_a_cache_with_types_that_have_moved_is_compiled_anew(tmp_path):
    # An upgrade leaves numba's files in place; they name the classes of arguments by their former modules.
    compiling.load_compiler()
    numba, caching = import_module("numba"), import_module("numba.core.caching")
    former = b"cstructsel.numerics.compiling\nNoSuchClass\n."
    (tmp_path / "kernel.nbi").write_bytes(pickle.dumps(numba.__version__, protocol=-1) + former)
    cache = caching.IndexDataCacheFile(str(tmp_path), "kernel", "stamp")
    assert cache.load("signature") is None
    cache.save("signature", "code")
    assert cache.load("signature") == "code"
