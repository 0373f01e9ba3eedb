"""A snapped tree settles on the best constants near by."""

from __future__ import annotations

import numpy as np
import pytest
from fake_backend import FakeBackend

from ge_torchrl.environments.backend import Limit, LimitReachedError
from ge_torchrl.refiners.settling import settle
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
SEEDS = np.arange(2)


def tree_of(first, second):
    return split(0, first, leaf(0), split(1, second, leaf(1), leaf(0)))


def grid(tree):
    """The parameters that differ in one whole number, by one or two, within 0 to 9."""
    moves = [
        tree.parameters + step * np.eye(len(tree.parameters), dtype=np.float32)[number]
        for number in range(len(tree.parameters))
        for step in (-2, -1, 1, 2)
    ]
    return np.array([moved for moved in moves if ((moved >= 0) & (moved <= 9)).all()], np.float32)


def settled(tree, backend, near=grid):
    return settle(tree, near, lambda forest: backend.evaluate(forest, SEEDS, "polish").returns.mean(axis=1))


def test_numbers_move_one_by_one_to_the_best_constants():
    # What is best for one number depends on the other, so that several rounds are needed.
    def value(tree):
        first, second = tree.threshold.tolist()
        return -((first - second) ** 2) / 2 - (second - 3) ** 2

    backend = FakeBackend(value)
    tree = settled(tree_of(7.0, 8.0), backend)
    assert tree == tree_of(3.0, 3.0)
    assert backend.batches[:2] == [(1, 2), (7, 2)]
    assert len(backend.batches) > 4


def test_a_tree_that_no_move_makes_better_stays():
    assert settled(tree_of(5.0, 5.0), FakeBackend(lambda _: 7.0)) == tree_of(5.0, 5.0)


def test_moves_end_where_the_constants_do():
    backend = FakeBackend(lambda tree: -float(tree.threshold[0]))
    assert settled(tree_of(5.0, 5.0), backend).threshold.tolist() == [0.0, 5.0]


def test_what_has_no_constants_near_is_not_measured():
    backend = FakeBackend(lambda _: 0.0)
    nothing = np.zeros((0, 2), np.float32)
    assert settled(tree_of(1.0, 1.0), backend, lambda _: nothing) == tree_of(1.0, 1.0)
    assert backend.batches == []


def test_a_limit_that_is_reached_ends_the_search():
    backend = FakeBackend(lambda tree: -float(tree.threshold[0]))
    backend.limit = Limit(max_env_steps=300)
    with pytest.raises(LimitReachedError):
        settled(tree_of(9.0, 5.0), backend)
