import ast
import re
from pathlib import Path

import nbformat
import pytest
from command_line_for_tests import check_composes
from nbclient import NotebookClient
from records_for_tests import history, kept, proposal, refinement
from sweeps_for_tests import write_run

NOTEBOOKS = Path(__file__).parents[1] / "notebooks"
ONE_RUN, SWEEP = (NOTEBOOKS / name for name in ("01_one_run.ipynb", "02_a_sweep.ipynb"))


def executed(path, monkeypatch, **variables):
    """Return all that the cells of a notebook show, as Markdown and text, and the number of its figures."""
    for name, value in variables.items():
        monkeypatch.setenv(name, str(value))
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=60, kernel_name="python3").execute(cwd=str(path.parent))
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    shown = [output.get("data", {}) for output in outputs]
    texts = [data.get("text/markdown", "") for data in shown] + [output.get("text", "") for output in outputs]
    return "\n".join(texts), sum("image/svg+xml" in data for data in shown)


def test_one_run_is_told(tmp_path, monkeypatch):
    run = write_run(
        tmp_path / "run",
        "GE+PPO+polish",
        refinements=[refinement(5), proposal(5, again=120.0)],
        archive=[kept(2, 480.0), kept(3, 490.0)],
        champion_from="polish",
    )
    text, figures = executed(ONE_RUN, monkeypatch, GE_TORCHRL_RUN=run)
    assert "| method | GE+PPO+polish |" in text
    assert "| 5 | neighbour | 3 | improved | 120.00 | 480.00 |" in text
    assert "| 2 | 480.00 ± 1.50 |" in text
    assert "The champion comes from the polish." in text
    assert "Cost: " in text
    assert figures == 2


def test_a_sweep_is_told(tmp_path, monkeypatch):
    for seed in (0, 1):
        write_run(tmp_path / f"ppo{seed}", "thesis", seed=seed, refinements=[refinement(1)])
        alone = history([100.0, 200.0, 500.0])
        write_run(tmp_path / f"ge{seed}", "GE", seed=seed, generations=alone)
    text, figures = executed(SWEEP, monkeypatch, GE_TORCHRL_SWEEP=tmp_path)
    assert "| CartPole-v1 thesis | 2 |" in text
    assert "| seed | thesis | GE alone | ratio |" in text
    assert figures == 1 + 2 + 2
    assert Path(text.strip().splitlines()[-1]).is_file(), "the last cell says where the report is"


@pytest.mark.parametrize("path", [ONE_RUN, SWEEP], ids=["one_run", "a_sweep"])
def test_notebooks_are_stored_without_outputs(path):
    for cell in nbformat.read(path, as_version=4).cells:
        if cell.cell_type == "code":
            assert (cell.outputs, cell.execution_count) == ([], None)


@pytest.mark.usefixtures("experiment")
@pytest.mark.parametrize(("path", "flags"), [(ONE_RUN, []), (SWEEP, ["-m"])], ids=["one_run", "a_sweep"])
def test_the_examples_of_the_notebooks_compose(path, flags):
    first = next(cell.source for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code")
    example = ast.literal_eval(re.search(r"EXAMPLE = (\[.*?\])", first, flags=re.DOTALL)[1])
    check_composes([*flags, *example])
