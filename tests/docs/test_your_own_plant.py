"""The page on plants: its files are the examples, and they run as it says."""

import json
import shutil
import subprocess
import sys
import time
from contextlib import closing

import numpy as np
import pytest
from pages_for_tests import ROOT, blocks

from ge_torchrl.__main__ import main
from ge_torchrl.artefacts.folder import RunFolder
from ge_torchrl.environments.kernel_backend import KernelBackend
from ge_torchrl.environments.spec import describe, make_gymnasium
from ge_torchrl.trees.files import read_controller
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

PAGE = ROOT / "docs" / "your_own_plant.md"
EXAMPLES = ROOT / "docs" / "examples"
SMALL = [
    "ge.generations=3", "ge.population_size=10", "starts.max_timesteps=3000", "polish.max_timesteps=3000",
    "archive.final_keep=0", "archive.neighbours=2", "evaluation.validation_episodes=10", "evaluation.test_episodes=10",
    "evaluation.threads=2", "hydra.run.dir=run",
]  # fmt: skip


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder of the user's, with both files."""
    for path in EXAMPLES.glob("*.py"):
        shutil.copy(path, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_page_prints_the_examples():
    printed = blocks(PAGE, "python")
    assert printed[:2] == [(EXAMPLES / name).read_text() for name in ("plant.py", "motor.py")]
    subprocess.run([sys.executable, "-c", printed[2]], cwd=ROOT, check=True, capture_output=True)


def test_a_run_needs_nothing_but_the_file(folder, capsys, monkeypatch):
    assert main(["env.dynamics=plant.py:Cart", *SMALL]) == 0
    run = RunFolder(folder / "run")
    assert run.read_summary().route == "kernel"
    names = run.read_best_tree().names
    assert (names.id, names.features) == ("plant.py:Cart", ("x", "x_dot", "theta", "theta_dot"))
    assert run.read_config().env.dynamics == "plant.py:Cart"
    assert list(run.read_config().env.symmetry["negate_actions"]) == ["force"]
    # The same tree, measured from here and from elsewhere, on both routes and beside other runs.
    measured = []
    for place, route in ((folder, "kernel"), (folder, "gymnasium"), (ROOT, "kernel")):
        monkeypatch.chdir(place)
        monkeypatch.syspath_prepend(str(folder))
        capsys.readouterr()
        tree = str(folder / "run" / "best_tree.json")
        assert main(["evaluate", tree, "--episodes", "5", "--route", route, "--json"]) == 0
        measured.append(json.loads(capsys.readouterr().out)["mean"])
    assert measured == [pytest.approx(measured[0], rel=1e-12)] * 3
    assert main(["report", str(folder)]) == 0


def test_a_heavier_pole_is_another_plant_and_travels_with_the_tree(folder, capsys):
    heavy = ["env.kwargs.POLE=0.8", "env.kwargs.FRICTION=0"]
    assert main(["env.dynamics=plant.py:Cart", *heavy, "refiner=none", *SMALL]) == 0
    run = RunFolder(folder / "run")
    assert run.read_summary().route == "kernel"
    assert (
        dict(run.read_config().env.kwargs)
        == run.read_best_tree().names.kwargs
        == {"POLE": 0.8, "FRICTION": 0}
    )
    tree = folder / "elsewhere.json"
    shutil.copy(folder / "run" / "best_tree.json", tree)

    def measured(route):
        capsys.readouterr()
        assert main(["evaluate", str(tree), "--episodes", "5", "--route", route, "--json"]) == 0
        return json.loads(capsys.readouterr().out)["mean"]

    mean = measured("kernel")
    assert measured("gymnasium") == pytest.approx(mean, rel=1e-12)
    text = (
        (folder / "plant.py")
        .read_text()
        .replace("POLE = 1.0, 0.2", "POLE = 1.0, 0.8")
        .replace("= 0.1  #", "= 0.0  #")
    )
    (folder / "plant.py").write_text(text)
    tree.write_text(tree.read_text().replace('{"FRICTION": 0, "POLE": 0.8}', "{}"))
    assert measured("kernel") == mean


def test_ppo_trains_on_it(folder):
    ppo = [
        "refiner.schedule.every=1",
        "refiner.ppo.max_timesteps=1000",
        "refiner.ppo.update_timesteps=250",
        "polish=none",
        "starts.races=0",
    ]
    assert main(["env.dynamics=plant.py:Cart", *SMALL, *ppo]) == 0
    run = RunFolder(folder / "run")
    assert run.read_summary().refined > 0


@pytest.mark.parametrize(
    "words",
    [
        ["env.dynamics=motor.py:Motor", "refiner=cmaes"],
        ["env.dynamics=motor.py:Motor", "refiner=none", "env.route=gymnasium", "env.workers=2"],
        ["env.dynamics=plant.py:Cart", "refiner=none", "env.max_episode_steps=20"],
    ],
    ids=["cmaes", "workers", "a limit"],
)
def test_other_ways_to_run_it(folder, words):
    assert main([*words, *SMALL]) == 0
    summary = RunFolder(folder / "run").read_summary()
    assert summary.decision_nodes >= 0
    assert summary.workers == (2 if "env.workers=2" in words else 1)


def test_the_file_that_is_gone_is_told_when_a_tree_is_measured(folder, capsys):
    assert main(["env.dynamics=motor.py:Motor", "refiner=none", "polish=none", "starts.races=0", *SMALL]) == 0
    (folder / "motor.py").unlink()
    capsys.readouterr()
    assert main(["evaluate", "run"]) == 2
    told = capsys.readouterr().err
    assert "motor.py:Motor must name a file" in told
    assert f"it is neither in {folder} nor on PYTHONPATH" in told


def test_a_file_that_has_changed_since_is_told_when_a_tree_is_measured(folder, caplog):
    assert main(["env.dynamics=motor.py:Motor", "refiner=none", "polish=none", "starts.races=0", *SMALL]) == 0
    measures = [["run"], ["run/best_tree.json"], ["."]]

    def told_of(which):
        caplog.clear()
        assert main(["evaluate", *which, "--episodes", "2"]) == 0
        return [record.getMessage() for record in caplog.records]

    assert [told_of(which) for which in measures] == [[], [], []]
    text = (folder / "motor.py").read_text()
    (folder / "motor.py").write_bytes(text.replace("\n", "\r\n").encode())
    assert told_of(["run"]) == []
    (folder / "motor.py").write_text(text.replace("INERTIA, FRICTION = 0.001", "INERTIA, FRICTION = 0.002"))
    for which in measures:
        (line,) = told_of(which)
        assert line.startswith("The file of motor.py:Motor has changed since run")
        assert "\n" not in line


def test_the_file_of_init_holds_it(folder, capsys):
    assert main(["init", "plant.py:Cart"]) == 0
    assert "dynamics: plant.py:Cart" in (folder / "my_conf" / "env" / "cart.yaml").read_text()
    assert main(["--config-dir", "my_conf", "env=cart", "--cfg", "job"]) == 0
    assert "dynamics: plant.py:Cart" in capsys.readouterr().out


@pytest.mark.usefixtures("folder")
def test_dynamics_beside_another_environment_are_refused(capsys):
    assert main(["env=cartpole", "env.dynamics=plant.py:Cart"]) == 2
    assert "env.id=CartPole-v1" in capsys.readouterr().err


def test_the_kernel_is_a_hundred_times_as_fast_as_a_loop_over_gymnasium(monkeypatch):
    monkeypatch.chdir(ROOT)
    spec = describe("docs/examples/plant.py:Cart")
    law = DecisionTree.value_leaf([0.0], {0: [13.0], 1: [15.0], 2: [98.0], 3: [20.0]})
    with closing(KernelBackend(spec, 1)) as kernel, closing(make_gymnasium(spec)) as environment:
        kernel.evaluate(Forest.stack([law]), np.arange(64), "warm-up")
        started = time.process_time()
        steps = kernel.evaluate(Forest.stack([law]), np.arange(2000), "test").env_steps
        fast = steps / (time.process_time() - started)
        assert steps == 2000 * 500
        environment.reset(seed=0)
        started = time.process_time()
        for _ in range(500):
            environment.step(np.zeros(1, np.float32))
        slow = 500 / (time.process_time() - started)
    assert fast > 100 * slow


def test_trees_that_are_kept_here_are_of_the_plants_as_they_are(monkeypatch):
    monkeypatch.chdir(ROOT)
    kept = [read_controller(path).names for path in sorted((ROOT / "docs" / "trees").glob("*.json"))]
    plants = [names for names in kept if names.source]
    assert plants
    for names in plants:
        assert describe(names.id).names.source == names.source
