"""A tree is measured where its environment still observes and takes what the tree was made for."""

import shutil
from pathlib import Path

import pytest
import yaml
from sweeps_for_tests import leaf, split, write_run

from ge_torchrl.environments.spec import describe
from ge_torchrl.environments.trust import trusting
from ge_torchrl.errors import ArtefactError
from ge_torchrl.report.evaluation import evaluate, evaluate_runs
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.files import write_controller
from ge_torchrl.trees.tree import DecisionTree

PLANT = "mine.py:Mine"
XV, LR = ("x", "v"), ("l", "r")
PUSH = {"push": (-1.0, 1.0)}


@pytest.fixture(autouse=True)
def vouched():
    """The plants here are the user's own."""
    with trusting():
        yield


def write_plant(features=XV, actions=LR, speed=0.1):
    """Write a plant; whatever it is called, `x` comes first in the state."""
    seen = ", ".join("state[1]" if name == "v" else "state[0]" for name in features)
    text = f"""class Mine:
    features, actions = {features!r}, {actions!r}
    start, max_episode_steps = [(-1.0, 1.0), 0.0], 20
    def step(state, action):
        return (state[0] + {speed} * state[1], state[1] + action), -abs(state[0]), False
    def observe(state):
        return ({seen},)
"""
    Path("mine.py").write_text(text)


@pytest.fixture
def made(tmp_path, monkeypatch):
    """Return what writes a run of the plant, and returns its folder."""
    monkeypatch.chdir(tmp_path)

    def make(name="runs/one", tree=None, **env):
        run = write_run(tmp_path / name, environment=PLANT, solved_at=None)
        spec = describe(PLANT, **env)
        controller = Controller(tree or split(0, 0.0, leaf(0), leaf(1)), spec.names)
        write_controller(run / "best_tree.json", controller)
        config = yaml.safe_load((run / "config.yaml").read_text())
        config["env"] |= {"solved_at": None, **{key: list(names) for key, names in env.items()}}
        (run / "config.yaml").write_text(yaml.safe_dump(config))
        return run

    return make


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"features": ("v", "x")}, "the tree reads x, v; mine.py:Mine observes v, x, "),
        ({"features": ("pos", "v")}, "the tree reads x, v; mine.py:Mine observes pos, v, "),
        ({"features": ("x", "y", "v")}, "the tree reads x, v; mine.py:Mine observes x, y, v, "),
        ({"actions": ("r", "l")}, "the tree answers with l, r; mine.py:Mine takes r, l, "),
        ({"actions": ("l", "n", "r")}, "the tree answers with l, r; mine.py:Mine takes l, n, r, "),
        ({"actions": PUSH}, "the tree answers with l, r; mine.py:Mine takes push, "),
    ],
)
def test_a_plant_that_observes_or_takes_something_else_is_refused(made, changed, told):
    write_plant()
    run = made()
    shutil.copy(run / "best_tree.json", "alone.json")
    write_plant(**changed)
    for path in (run, run / "best_tree.json", Path("alone.json")):
        with pytest.raises(ArtefactError) as raised:
            evaluate(path, 3, 0)
        assert str(raised.value).startswith(told)
        assert "\n" not in str(raised.value)


def test_another_kind_of_action_is_refused_and_other_runs_are_told(made):
    write_plant(actions=PUSH)
    numbers = made("runs/numbers", DecisionTree.value_leaf([0.5], {}))
    write_plant(actions=("push",))
    choices = made("runs/choices", leaf(0))
    told = "the tree answers with numbers for push; mine.py:Mine takes one of push by now"
    with pytest.raises(ArtefactError, match=told):
        evaluate(numbers, 3, 0)
    swept = evaluate_runs(numbers.parent, 3, 0)
    assert swept.left_out == (f"{numbers}: {told}",)
    assert [run.path for method in swept.methods for run in method.runs] == [str(choices)]
    write_plant(actions=PUSH)
    with pytest.raises(
        ArtefactError, match=r"answers with one of push; mine\.py:Mine takes numbers for push"
    ):
        evaluate(choices, 3, 0)


def test_a_plant_that_moves_in_another_way_is_measured_as_it_is(made):
    write_plant()
    run = made()
    before = evaluate(run, 3, 0).mean
    write_plant(speed=0.2)
    assert evaluate(run, 3, 0).mean != before


def test_names_of_the_users_own_are_not_asked_for(made):
    write_plant()
    run = made(features=("place", "speed"), actions=("back", "on"))
    before = evaluate(run, 3, 0)
    write_plant(features=("x", "v"), actions=("left", "right"))
    assert evaluate(run, 3, 0) == before


def test_a_tree_whose_bins_were_mere_numbers_is_measured_as_before(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    wrappers = ("gymnasium.wrappers:DiscretizeAction {bins: 3}",)
    write_plant(actions=PUSH)
    numbers = describe(PLANT, wrappers=wrappers, actions=("a0", "a1", "a2")).names
    path = tmp_path / "of_before.json"
    write_controller(path, Controller(split(0, 0.0, leaf(2), leaf(0)), numbers))
    before = evaluate(path, 3, 0)
    Path("mine.py").write_text(Path("mine.py").read_text() + "# The same by another text.\n")
    assert evaluate(path, 3, 0) == before
