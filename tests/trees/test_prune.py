"""Pruned trees are smaller and act the same on what was visited."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import any_trees, observations
from subtrees_for_tests import subtree

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.simplify import prune
from ge_torchrl.trees.tree import DecisionTree

leaf, split, value = DecisionTree.leaf, DecisionTree.split, DecisionTree.value_leaf


def visits_of(tree, rows):
    return np.bincount(tree.leaf_of(rows), minlength=tree.num_leaves)


def test_an_unvisited_leaf_gives_its_parents_place_to_its_sibling():
    tree = split(0, 0.5, split(1, 0.25, leaf(0), leaf(1)), leaf(2))
    assert prune(tree, [4, 5, 0]) == split(1, 0.25, leaf(0), leaf(1))
    assert prune(tree, [0, 5, 4]) == split(0, 0.5, leaf(1), leaf(2))
    assert prune(tree, [9, 0, 0]) == leaf(0)
    assert prune(tree, [0, 0, 9]) == leaf(2)
    assert prune(tree, [2, 3, 4]) == tree
    assert prune(leaf(1), [3]) == leaf(1)


def test_equal_leaves_merge_until_none_is_left():
    same = split(1, 0.25, leaf(1), split(2, 0.0, leaf(1), leaf(1)))
    assert prune(same, [1, 1, 1]) == leaf(1)
    assert prune(split(0, 0.5, same, leaf(0)), [1, 1, 1, 1]) == split(0, 0.5, leaf(1), leaf(0))


def test_equal_leaves_with_values_merge_too():
    here, there = value([1.0, 2.0], {0: [1.0, 0.0]}), value([1.0, 2.0], {1: [1.0, 0.0]})
    assert prune(split(0, 0.5, here, here), [1, 1]) == here
    assert prune(split(0, 0.5, here, there), [1, 1]) == split(0, 0.5, here, there)


def test_splits_between_equal_subtrees_are_not_leaves_to_merge():
    half = split(1, 0.25, leaf(0), leaf(1))
    assert prune(split(0, 0.5, half, half), [1, 1, 1, 1]) == split(0, 0.5, half, half)


def test_pruning_merges_leaves_that_only_visits_made_neighbours():
    tree = split(0, 0.5, leaf(1), split(1, 0.25, leaf(0), leaf(1)))
    assert prune(tree, [4, 1, 5]) == tree
    assert prune(tree, [4, 0, 5]) == leaf(1)


@given(st.data(), any_trees())
def test_a_pruned_tree_acts_as_the_full_one_on_what_was_visited(data, tree):
    rows = data.draw(observations(tree))
    pruned = prune(tree, visits_of(tree, rows))
    assert np.array_equal(pruned.decide(rows), tree.decide(rows), equal_nan=True)
    assert pruned.num_decision_nodes <= tree.num_decision_nodes
    assert visits_of(pruned, rows).min() > 0, "all that is left is visited"
    assert pruned == DecisionTree(*pruned.arrays), "a tree, depth first"
    assert prune(pruned, visits_of(pruned, rows)) == pruned


@given(st.data(), any_trees())
def test_where_all_is_visited_only_equal_leaves_go(data, tree):
    rows = data.draw(observations(tree))
    merged = prune(tree, np.ones(tree.num_leaves))
    assert np.array_equal(merged.decide(rows), tree.decide(rows), equal_nan=True)
    for left, right in zip(merged.children_left, merged.children_right, strict=True):
        assert left >= 0 or right >= 0 or subtree(merged, left) != subtree(merged, right)


@pytest.mark.parametrize(
    ("visits", "message"),
    [
        ([0, 0], "nothing was validated"),
        ([3, 3, 3], "one count for each of 2 leaves"),
        ([[3, 3]], "one count for each of 2 leaves"),
    ],
)
def test_visits_of_something_else_are_refused(visits, message):
    with pytest.raises(InvalidTreeError, match=message):
        prune(split(0, 0.5, leaf(0), leaf(1)), visits)
