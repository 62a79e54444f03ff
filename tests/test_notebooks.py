"""Every example is a script and a notebook of the same cells, and a notebook runs from nothing."""

import re
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[1] / "examples"
SCRIPTS = sorted(EXAMPLES.glob("*.py"))
MISSING = 'is not installed; pip install "structsel[notebooks]" installs it'


def cells(path):
    jupytext = pytest.importorskip("jupytext", reason=f"jupytext {MISSING}")
    return [(cell.cell_type, cell.source) for cell in jupytext.read(path).cells]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_script_and_notebook_have_the_same_cells(script):
    assert cells(script) == cells(script.with_suffix(".ipynb")), "run: jupytext --sync examples/*.py"


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_notebook_says_first_what_it_is_and_is_stored_with_its_figures(script):
    jupytext = pytest.importorskip("jupytext", reason=f"jupytext {MISSING}")
    notebook = jupytext.read(script.with_suffix(".ipynb"))
    assert notebook.cells[0].source.startswith("# ")
    assert notebook.metadata.kernelspec.name == "python3"
    outputs = [out for cell in notebook.cells if cell.cell_type == "code" for out in cell.outputs]
    assert any("image/png" in out.get("data", {}) for out in outputs), "run: make notebooks"
    texts = [out.get("text", "") + out.get("data", {}).get("text/plain", "") for out in outputs]
    assert not [t for t in texts if re.search(r"<Axes|<matplotlib|\[<", t)], "a cell ends in a plot: add plt.show()"
    assert not any(out.output_type == "error" for out in outputs)


def test_no_notebook_is_without_its_script():
    assert {path.stem for path in EXAMPLES.glob("*.ipynb")} == {path.stem for path in SCRIPTS}


@pytest.mark.slow
def test_a_notebook_runs_in_a_new_process_and_shows_tables_figures_and_the_explorer(tmp_path, monkeypatch):
    jupytext = pytest.importorskip("jupytext", reason=f"jupytext {MISSING}")
    nbclient = pytest.importorskip("nbclient", reason=f"nbclient {MISSING}")
    for package in ("ipykernel", "ipywidgets"):
        pytest.importorskip(package, reason=f"{package} {MISSING}")
    for name in ("PYTHONPATH", "MPLBACKEND"):  # what this process was given is no business of the notebook's
        monkeypatch.delenv(name, raising=False)
    notebook = jupytext.read(EXAMPLES / "05_explore_residuals.ipynb")
    where = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3", resources=where).execute()
    shown = [out.data for cell in notebook.cells if cell.cell_type == "code" for out in cell.outputs if "data" in out]
    assert sum("<caption" in data.get("text/html", "") for data in shown) >= 3
    assert sum("image/png" in data for data in shown) >= 4
    assert any("application/vnd.jupyter.widget-view+json" in data for data in shown)
    assert not list(tmp_path.iterdir()), "the notebook says that it writes no files"
