"""The marks of tables that are made from runs, and what the pages show of Python and YAML."""

import importlib.util
import re
import shutil
import subprocess
import sys
from pathlib import Path

import default_tables
import pytest
import thesis_tables
from pages_for_tests import PAGES, ROOT, blocks
from records_for_tests import history, kept, proposal, refinement
from sweeps_for_tests import write_run

from ge_torchrl.__main__ import main
from ge_torchrl.artefacts.folder import RunFolder

RESULTS = ROOT / "docs" / "results.md"
TOY = '''
import gymnasium as gym
import numpy as np


class PendulumSwitch(gym.Env):
    """An angle that noise moves; the action should push it back."""

    observation_space = gym.spaces.Box(np.float32([-3.2, -8]), np.float32([3.2, 8]))
    action_space = gym.spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.angle, self.speed = self.np_random.uniform(-1, 1, 2)
        return np.float32([self.angle, self.speed]), {}

    def step(self, action):
        self.speed = float(np.clip(self.speed + 0.4 * action - 0.2, -8, 8))
        self.angle = float(np.clip(self.angle + 0.1 * self.speed, -3.2, 3.2))
        return np.float32([self.angle, self.speed]), -abs(self.angle), False, False, {}


gym.register("PendulumSwitch-v0", PendulumSwitch, max_episode_steps=20)
'''


def test_marks_stand_in_pairs_and_once():
    found = [
        mark for path in PAGES for mark in re.findall(r"<!-- (TABLE|END) ([\w-]+) -->", path.read_text())
    ]
    opened = [name for what, name in found if what == "TABLE"]
    assert found == [(what, name) for name in opened for what in ("TABLE", "END")]
    assert len(set(opened)) == len(opened)


def test_tables_have_as_many_cells_in_every_row():
    for path in PAGES:
        rows = []
        for line in [*path.read_text().splitlines(), ""]:
            if line.startswith("|"):
                rows.append(line.replace("\\|", "").count("|"))
            elif rows:
                assert len(rows) > 2, f"{path.name}: a table has a head, a line below it, and rows"
                assert len(set(rows)) == 1, f"{path.name}: {line}"
                rows = []


def test_python_of_the_readme_runs():
    (text,) = blocks(ROOT / "README.md", "python")
    told = subprocess.run([sys.executable, "-c", text], cwd=ROOT, capture_output=True, text=True, check=True)
    assert told.stdout.split() == re.findall(r"print\(.*\)  # (\w+)", text)


def test_an_environment_of_ones_own_is_one_file(tmp_path, monkeypatch):
    (tmp_path / "my_conf" / "env").mkdir(parents=True)
    (tmp_path / "my_package.py").write_text(TOY)
    (text,) = blocks(ROOT / "docs" / "your_own_environment.md", "yaml")
    (tmp_path / "my_conf" / "env" / "pendulum_switch.yaml").write_text(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    small = ["refiner=none", "ge.generations=3", "ge.population_size=10", "env.workers=1"]
    small += [
        "ge.max_env_steps=20000",
        "evaluation.validation_episodes=5",
        "evaluation.test_episodes=5",
        "hydra.run.dir=run",
    ]
    assert main(["--config-dir", "my_conf", "env=pendulum_switch", *small]) == 0
    run = RunFolder(tmp_path / "run")
    assert run.read_summary().route == "gymnasium"
    assert set(run.read_best_tree().names.features) == {"angle", "speed"}


@pytest.fixture(scope="module")
def results():
    """The script that makes the tables; it lies beside the benches, which are no package."""
    spec = importlib.util.spec_from_file_location("results", ROOT / "tests" / "benchmarks" / "results.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def pages(results, tmp_path, monkeypatch):
    """Copies of the pages, which the script may write."""
    copies = [shutil.copy(path, tmp_path) for path in results.PAGES]
    monkeypatch.setattr(results, "PAGES", tuple(map(Path, copies)))
    return results.PAGES


def sweep(folder, environment, solved_at, methods):
    for method in methods:
        for seed in (0, 1):
            write_run(
                folder / f"{method}-{seed}",
                method,
                seed=seed,
                environment=environment,
                solved_at=solved_at,
                generations=history([100.0, 500.0] if method == "GE" else [500.0, 500.0]),
                refinements=[refinement(1), proposal(1, again=500.0)],
            )


@pytest.mark.parametrize(
    ("name", "methods", "told"),
    [
        ("rates", ["GE+PPO"], "| CartPole-v1 | neighbours | 2 | 0 (0%) | 2 | 500.0 | 480.0 | 1.00 |"),
        ("thesis", ["GE", "thesis"], "| CartPole-v1 thesis | 2 | 2 of 2 (34% to 100%) |"),
    ],
)
def test_tables_are_made_of_runs_and_written_between_their_marks(
    results, pages, name, methods, told, tmp_path
):
    for environment, id_ in default_tables.ENVIRONMENTS.items():
        sweep(tmp_path / "runs" / name / environment, id_, 475.0, methods)
    folders = ["--folder", str(tmp_path / "runs"), "--figures", str(tmp_path / "figures")]
    results.main([name, "--write", *folders])
    written = pages[0].read_text()
    assert told in written
    assert len(re.findall("<!-- TABLE", written)) == len(re.findall("<!-- TABLE", RESULTS.read_text()))
    assert len(list((tmp_path / "figures").glob("*.png"))) == (3 if name == "thesis" else 0)


def test_generations_to_solve_are_compared_with_the_runs_of_ge_alone(results, pages, tmp_path):
    for name, ways in thesis_tables.SOLVING.items():
        for way in ("alone", *ways):
            methods = ["GE"] if way == "alone" else ["GE+PPO"]
            sweep(tmp_path / "solving" / name / way, default_tables.ENVIRONMENTS[name], 475.0, methods)
    results.main(["solving", "--write", "--folder", str(tmp_path)])
    assert "| MountainCar-v0: individuals | 2 | 2 | 1 | 0.50 (range 0.50 to 0.50) |" in pages[0].read_text()


def test_the_default_is_evaluated_anew(results, pages, tmp_path, monkeypatch):
    monkeypatch.setattr(default_tables, "EPISODES", 2)
    monkeypatch.setattr(default_tables, "ENVIRONMENTS", {"cartpole": "CartPole-v1"})
    for seed in (0, 1):
        folder = tmp_path / "default" / "cartpole" / str(seed)
        write_run(folder, "GE+PPO+polish", seed=seed, refinements=[refinement(1)], archive=[kept(2, 480.0)])
    results.main(["default", "--write", "--folder", str(tmp_path)])
    assert re.search(r"\| CartPole-v1 \| 2 of 2 \| \d+\.\d+ \| \d+\.\d+ \|", pages[0].read_text())
    assert re.search(r"\| CartPole-v1 \| 2 of 2 \| \d+\.\d+ \| .* \| 500.00 with 2 \|", pages[1].read_text())
