"""A tree is shortened: what brings least goes first, and what is left returns as much as it can."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from mirrors_for_tests import MIRRORS, NAMES
from problems_for_tests import Analytic, problem_of

from ge_torchrl.environments.backend import Limit, LimitReachedError
from ge_torchrl.refiners.folding import fold_at, half_of, whole_of
from ge_torchrl.refiners.mirror import Mirror
from ge_torchrl.search import shortening
from ge_torchrl.search.shortening import moved, shortened
from ge_torchrl.trees.nodes import Split, forest_of
from ge_torchrl.trees.tree import DecisionTree

CART = MIRRORS["cart"]
leaf, split = DecisionTree.leaf, DecisionTree.split
STATES = np.random.default_rng(0).normal(size=(400, 4)).astype(np.float32)
# What a tree should do: two splits say it, and one says most of it.
GOAL = split(2, 0.0, split(3, 1.0, leaf(0), leaf(1)), leaf(1))
# With splits that only do harm.
LONG = split(
    2, 0.0, split(0, -2.0, leaf(1), split(3, 1.0, leaf(0), leaf(1))), split(1, 2.0, leaf(1), leaf(0))
)


def value_of(goal):
    return lambda tree: 100 * float((tree.decide(STATES) == goal.decide(STATES)).mean())


def problem(goal=GOAL, mirror=None):
    return replace(problem_of(Analytic(value_of(goal), luck=1.0)), mirror=mirror)


def shorter(of, tree, n_splits, timesteps=50_000, seed=0):
    return shortened(of, tree, n_splits, timesteps, "shortening", np.random.default_rng(seed))


@pytest.mark.parametrize("seed", range(3))
def test_what_does_harm_goes_first(seed):
    tree = shorter(problem(), LONG, 2, seed=seed)
    assert tree.structure == GOAL.structure
    assert value_of(GOAL)(tree) > 99
    assert shorter(problem(), LONG, 1, seed=seed).feature.tolist() == [2]


def test_a_tree_that_is_short_enough_stays_as_it_is():
    of = problem()
    assert shorter(of, GOAL, 2) is GOAL
    assert of.backend.steps.total() == 0


def test_in_a_mirror_what_is_left_is_its_own_image():
    half = fold_at(
        2, [Split((3,), (1.0,), -0.8), 0, Split((1,), (1.0,), 0.4), 1, Split((0,), (1.0,), 0.3), 0, 1], CART
    )
    tree = forest_of([whole_of(half, CART)]).tree(0)
    goal = forest_of([whole_of(fold_at(2, [Split((3,), (1.0,), -0.8), 0, 1], CART), CART)]).tree(0)
    assert tree.num_decision_nodes == 7
    left = shorter(problem(goal, CART), tree, 3)
    assert half_of(left, CART) is not None
    assert left.num_decision_nodes == 3
    assert value_of(goal)(left) > 99


def test_moving_thresholds_never_leaves_a_worse_tree():
    away = GOAL.with_parameters(GOAL.parameters + np.float32(0.4))
    for seed in range(3):
        of = problem()
        tree = moved(of, away, 20_000, 0.2, "moving", np.random.default_rng(seed))
        assert value_of(GOAL)(tree) > value_of(GOAL)(away) + 3
        # Nothing is better than the goal.
        assert moved(of, GOAL, 2_000, 0.2, "moving", np.random.default_rng(seed)) == GOAL


def test_with_few_steps_it_is_shortened_all_the_same():
    of = problem()
    assert shorter(of, LONG, 1, timesteps=10).num_decision_nodes <= 1
    assert of.backend.steps.total() < 12_000


def test_a_limit_breaks_it_off():
    of = problem()
    of.backend.limit = Limit(max_env_steps=2_000)
    with pytest.raises(LimitReachedError):
        shorter(of, LONG, 1)


def test_no_step_makes_it_larger_though_a_half_without_its_fold_may_unfold_to_more(monkeypatch):
    mirror = Mirror.declared({"negate": ["theta", "theta_dot"], "swap": [["x", "x_dot"]]}, NAMES["cart"])
    beyond = [Split((0,), (1.0,), 0.5), 0, Split((3,), (1.0,), 0.5), 1, 0]
    tree = forest_of([whole_of(fold_at(2, beyond, mirror), mirror)]).tree(0)
    assert tree.num_decision_nodes < forest_of([whole_of(beyond, mirror)]).tree(0).num_decision_nodes
    tried = []

    def best(_, forest, *__):
        tried.extend(forest.num_decision_nodes)
        return forest

    monkeypatch.setattr(shortening, "_best", best)
    shorter(problem(mirror=mirror), tree, tree.num_decision_nodes - 1)
    assert tried
    assert max(tried) < tree.num_decision_nodes
