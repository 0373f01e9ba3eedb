import ast
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOKS = Path(__file__).parents[1] / "notebooks"
ONE_RUN, SWEEP = (NOTEBOOKS / name for name in ("01_one_run.ipynb", "02_a_sweep.ipynb"))


def cells(path):
    return [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]


def executed(path):
    """Return all that the cells of a notebook show as text, and the number of its figures."""
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=120, kernel_name="python3").execute(cwd=str(path.parent))
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    shown = [output.get("data", {}) for output in outputs]
    texts = [data.get("text/markdown", data.get("text/plain", "")) for data in shown]
    texts += [output.get("text", "") for output in outputs]
    return "\n".join(texts), sum("image/png" in data for data in shown)


def test_one_run_is_told():
    text, figures = executed(ONE_RUN)
    assert "6 of 6 generations" in text
    assert "**CartPole-v1, seed 1, GE+PPO: " in text
    assert "refined trees improved." in text
    assert "over 2,000 episodes" in text
    assert "stopped by callback" in text
    assert text.count("\n") < 150, "nothing floods the page"
    assert figures == 1


def test_a_sweep_is_told():
    text, figures = executed(SWEEP)
    assert text.count("| GE alone |") == 4
    assert "of 4 pairs." in text
    assert "| decision nodes | runs | median test mean |" in text
    assert figures == 1


@pytest.mark.parametrize("path", [ONE_RUN, SWEEP], ids=["one_run", "a_sweep"])
def test_notebooks_are_stored_without_outputs(path):
    for cell in cells(path):
        assert (cell.outputs, cell.execution_count) == ([], None)


@pytest.mark.parametrize("path", [ONE_RUN, SWEEP], ids=["one_run", "a_sweep"])
def test_of_this_program_they_use_the_library_alone(path):
    tree = ast.parse("\n".join(cell.source for cell in cells(path)))
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    imported |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert {name for name in imported if name.startswith("ge_torchrl")} == {"ge_torchrl"}
