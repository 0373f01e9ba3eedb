"""What is shown is what happens: the tree's own path, and the episodes that backends play."""

from contextlib import closing

import gymnasium as gym
import numpy as np
import pytest
from documents_for_tests import CONTROLLER
from environments_for_tests import WalkEnv
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import any_trees, observations

from ge_torchrl.environments.choose import open_backend
from ge_torchrl.environments.spec import describe
from ge_torchrl.errors import EnvironmentFaultError
from ge_torchrl.play import episode
from ge_torchrl.play.episode import chosen_seed, frames_per_second, moments, way_through
from ge_torchrl.trees.controller import Controller
from ge_torchrl.trees.deciding import leaves_of
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree

SPEC = describe("CartPole-v1")


@settings(max_examples=30)
@given(st.data())
def test_the_way_through_a_tree_ends_where_the_tree_decides(data):
    tree = data.draw(any_trees())
    for observation in data.draw(observations(tree)):
        path, leaf = way_through(tree, observation)
        assert leaf == leaves_of(tree.arrays, tree.depth, observation[np.newaxis])[0]
        assert len({passed.split for passed in path}) == len(path) <= tree.depth


def test_an_episode_is_the_one_that_a_backend_plays():
    shown = list(moments(CONTROLLER, SPEC, 7, 1000, None))
    with closing(open_backend(SPEC, "gymnasium", workers=1)) as backend:
        trajectory = backend.record(CONTROLLER.tree, 7)
    assert [moment.step for moment in shown] == list(range(len(trajectory.rewards) + 1))
    np.testing.assert_array_equal([moment.observation for moment in shown], trajectory.observations)
    assert [moment.answer for moment in shown[:-1]] == trajectory.actions.tolist()
    assert shown[-1].total == trajectory.rewards.sum()
    assert [moment.ended != "" for moment in shown] == [False] * len(trajectory.rewards) + [True]
    assert shown[-1].ended == ("ended by the task" if trajectory.terminated else "ended by its limit")


def test_pictures_are_drawn_where_they_are_asked_for_and_at_the_end():
    shown = list(moments(CONTROLLER, SPEC, 7, 5, lambda step: step == 2))
    assert [moment.picture is not None for moment in shown] == [False, False, True, False, False, True]
    assert shown[2].picture.shape == (400, 600, 3)
    assert shown[-1].ended == "shown up to step 5"


def test_values_that_are_shown_are_cut_to_their_bounds():
    spec = describe("Pendulum-v1")
    controller = Controller(DecisionTree.value_leaf([100.0]), spec.names)
    assert [moment.answer for moment in moments(controller, spec, 0, 2, None)] == [(2.0,)] * 3


def test_the_best_the_median_and_the_worst_episode_are_found_by_their_returns(monkeypatch):
    monkeypatch.setattr(episode, "CHOSEN_FROM", 9)
    with closing(open_backend(SPEC)) as backend:
        returns = backend.evaluate(Forest.stack([CONTROLLER.tree]), np.arange(50, 59), "test").returns[0]
    found = [
        returns[chosen_seed(CONTROLLER.tree, SPEC, 50, which) - 50] for which in ("worst", "median", "best")
    ]
    assert found == [returns.min(), np.median(returns), returns.max()]


def test_who_draws_nothing_says_so():
    assert frames_per_second(SPEC) == 50
    gym.register("DrawsNothing-v0", WalkEnv)
    assert frames_per_second(describe("DrawsNothing-v0")) is None


class MissingEnv(WalkEnv):
    """Is drawn by what is not installed."""

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012

    def __init__(self, render_mode=None):
        self.render_mode = render_mode

    def render(self):
        raise gym.error.DependencyNotInstalled("pygame is not installed")


class BurningEnv(MissingEnv):
    """Cannot be drawn."""

    def render(self):
        raise RuntimeError("the screen is on fire")


@pytest.mark.parametrize(
    ("environment", "told"),
    [(MissingEnv, r"not installed \(pygame.*\[play\]"), (BurningEnv, "raised RuntimeError.*in render")],
)
def test_what_fails_while_it_is_drawn_is_told(environment, told):
    gym.register("DrawnBadly-v0", environment)
    spec = describe("DrawnBadly-v0")
    try:
        with pytest.raises(EnvironmentFaultError, match=told):
            list(moments(Controller(DecisionTree.leaf(0), spec.names), spec, 0, 3, lambda _: True))
    finally:
        del gym.registry["DrawnBadly-v0"]
