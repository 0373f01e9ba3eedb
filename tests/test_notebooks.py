import ast
import re
from pathlib import Path
from types import SimpleNamespace

import nbformat
import pytest
from nbclient import NotebookClient

from ge_torchrl import experiment
from ge_torchrl.__main__ import main

NOTEBOOKS = Path(__file__).parents[1] / "notebooks"
ONE_RUN, SWEEP = (NOTEBOOKS / name for name in ("01_one_run.ipynb", "02_a_sweep.ipynb"))
SMALL = [
    "experiment=thesis/cartpole",
    "refiner=thesis,none",
    "seed=0,1",
    "ge.population_size=20",
    "ge.generations=4",
    "refiner.schedule.every=2",
    "refiner.ppo.max_timesteps=200",
    "refiner.ppo.update_timesteps=100",
    "refiner.ppo.epochs=2",
    "refiner.ppo.source=fused",
    "evaluation.validation_episodes=5",
    "evaluation.test_episodes=5",
]


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep")
    assert main(["-m", *SMALL, f"hydra.sweep.dir={folder}"]) == 0
    return folder


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


def test_one_run_is_told(sweep, monkeypatch):
    run = next(path.parent for path in sorted(sweep.rglob("refinements.jsonl")))
    text, figures = executed(ONE_RUN, monkeypatch, GE_TORCHRL_RUN=run)
    assert "| method | GE+PPO |" in text
    assert "**CartPole-v1 GE+PPO** (5 test episodes" in text
    assert "Cost: " in text
    assert figures == 2


def test_a_sweep_is_told(sweep, monkeypatch):
    text, figures = executed(SWEEP, monkeypatch, GE_TORCHRL_SWEEP=sweep)
    assert "| CartPole-v1 GE+PPO | 2 |" in text
    assert "| seed | GE+PPO | GE alone | ratio |" in text
    assert figures == 1 + 2 + 2
    assert Path(text.strip().splitlines()[-1]).is_file(), "the last cell says where the report is"


@pytest.mark.parametrize("path", [ONE_RUN, SWEEP], ids=["one_run", "a_sweep"])
def test_notebooks_are_stored_without_outputs(path):
    for cell in nbformat.read(path, as_version=4).cells:
        if cell.cell_type == "code":
            assert (cell.outputs, cell.execution_count) == ([], None)


@pytest.mark.parametrize(
    ("path", "flags", "runs"), [(ONE_RUN, [], 1), (SWEEP, ["-m"], 6)], ids=["one_run", "a_sweep"]
)
def test_the_examples_of_the_notebooks_can_be_run(path, flags, runs, tmp_path, monkeypatch):
    first = next(cell.source for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code")
    example = ast.literal_eval(re.search(r"EXAMPLE = (\[.*?\])", first, flags=re.DOTALL)[1])
    configs = []

    def run(config, _):
        configs.append(config)
        return SimpleNamespace(stopped_by="generations")

    monkeypatch.setattr(experiment, "run", run)
    monkeypatch.chdir(tmp_path)
    assert main([*flags, *example]) == 0
    assert len(configs) == runs
    assert {config.refiner.ppo.max_timesteps for config in configs if config.refiner.enabled} == {2000}
