"""Run the notebooks of examples/ and store their outputs: `make notebooks`, or `python docs/notebooks.py 01 05`."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import jupytext
import nbformat
from nbclient import NotebookClient

EXAMPLES = Path(__file__).parents[1] / "examples"
_SETUP = "import matplotlib\nmatplotlib.rcParams['figure.dpi'] = 72\n"
_KEPT = ("text/plain", "text/html", "image/png")  # what every viewer shows; no state of widgets


def run(script: Path) -> None:
    """Execute the cells of a script in a new process, and write the notebook with what they show."""
    notebook = jupytext.read(script)
    notebook.metadata["kernelspec"] = {"display_name": "Python 3", "language": "python", "name": "python3"}
    notebook.cells.insert(0, nbformat.v4.new_code_cell(_SETUP))
    with tempfile.TemporaryDirectory() as folder:
        NotebookClient(notebook, timeout=900, kernel_name="python3", resources={"metadata": {"path": folder}}).execute()
    del notebook.cells[0]
    for number, cell in enumerate(notebook.cells):
        cell.id = f"cell-{number}"
        cell.metadata = nbformat.NotebookNode()
        if cell.cell_type == "code":
            cell.execution_count = None
            cell.outputs = [kept for output in cell.outputs if (kept := _stored(output))]
    notebook.metadata = nbformat.NotebookNode(kernelspec=notebook.metadata["kernelspec"])
    nbformat.write(notebook, script.with_suffix(".ipynb"))


def _stored(output: nbformat.NotebookNode) -> nbformat.NotebookNode | None:
    """Output without what changes from run to run; None for messages on stderr."""
    if output.get("name") == "stderr":
        return None
    if "data" in output:
        widget = any("widget" in kind for kind in output.data)
        kinds = () if widget else _KEPT
        output.data = nbformat.NotebookNode({kind: output.data[kind] for kind in kinds if kind in output.data})
        output.metadata = nbformat.NotebookNode()
        if "execution_count" in output:
            output.execution_count = None
        return output if output.data else None
    return output


if __name__ == "__main__":
    os.environ.pop("MPLBACKEND", None)
    for path in sorted(EXAMPLES.glob("*.py")):
        if len(sys.argv) == 1 or path.name.startswith(tuple(sys.argv[1:])):
            print(path.stem, flush=True)
            run(path)
