"""The best hard tree on the way comes back."""

import numpy as np
import pytest
import torch
from fake_backend import FakeBackend
from ppo_for_tests import ACTIONS, MIXED, generators, leaf, split

from ge_torchrl.refiners.rl.ddt import soften
from ge_torchrl.refiners.rl.snapshots import Snapshots


def value(tree):
    """What is worth something: a first threshold near 1, and action 2 at the first leaf."""
    nearness = -abs(float(tree.threshold[0]) - 1.0) if tree.num_decision_nodes else 0.0
    return nearness + (tree.action[0] == 2)


def soft(trees=MIXED):
    return soften(trees, ACTIONS, leaf_logit=5.0, generators=generators(range(len(trees))))


def moved(ddt, row, threshold):
    with torch.no_grad():
        ddt.threshold[row, 0] = threshold - ddt.origin[row, 0]


def watched(n_episodes, *moves):
    ddt, backend = soft(), FakeBackend(value, n_actions=ACTIONS, luck=3.0)
    snapshots = Snapshots(backend, ddt, n_episodes, "refinement")
    for rows in moves:
        for row, threshold in rows.items():
            moved(ddt, row, threshold)
        snapshots.look()
    return snapshots.trees(), backend


def test_each_tree_comes_back_as_it_was_when_it_was_best():
    (first, second, third), backend = watched(5, {0: 0.5, 1: 0.0}, {0: 2.0, 1: 0.75}, {0: -9.0, 1: 1.5})
    assert first.threshold[0] == np.float32(0.5)
    assert second.threshold[0] == np.float32(0.75)
    assert third == MIXED[2]
    # All trees at once, four times, on the same episodes.
    assert backend.batches == [(3, 5)] * 4
    assert len(set(backend.episodes)) == 1
    assert backend.steps == {"refinement": 4 * 3 * 5 * 10}


def test_nothing_worse_comes_back_and_of_equals_the_earlier():
    trees, _ = watched(5, {0: -1.0, 1: 1.95}, {0: 1.75, 1: 5.0})
    assert trees == list(MIXED)


def test_without_episodes_the_last_tree_comes_back():
    trees, backend = watched(0, {0: 0.5}, {0: -9.0})
    assert trees[0].threshold[0] == -9.0
    assert backend.batches == []


@pytest.mark.parametrize("n_episodes", [0, 3])
def test_a_threshold_beyond_float32_never_comes_back(n_episodes):
    trees, _ = watched(n_episodes, {0: float("inf"), 1: 0.9})
    assert trees[0] == MIXED[0]
    assert trees[1].threshold[0] == np.float32(0.9)


def test_trees_before_training_are_themselves_whatever_their_soft_leaves_prefer():
    tree = split(0, 1.0, leaf(2), leaf(1))
    ddt = soften([tree], ACTIONS, leaf_sd=50.0, generators=generators([0]))
    assert ddt.leaf_logits.argmax(-1).tolist() != [[2, 1]]
    snapshots = Snapshots(FakeBackend(value, n_actions=ACTIONS), ddt, 3, "refinement")
    assert snapshots.trees() == [tree]
