from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import observations, renumbered_trees, trees

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest

leaf, split = DecisionTree.leaf, DecisionTree.split


@given(st.lists(renumbered_trees(), max_size=5))
def test_every_stacked_tree_comes_back(trees):
    forest = Forest.stack(trees)
    assert len(forest) == len(trees)
    assert [forest.tree(index) for index in range(len(forest))] == trees
    assert forest.sizes.tolist() == [tree.n_nodes for tree in trees]
    assert [forest.structure(index) for index in range(len(forest))] == [tree.structure for tree in trees]


def test_arrays_stand_end_to_end_and_children_count_from_their_root():
    forest = Forest.stack([split(1, 0.5, leaf(0), leaf(1)), leaf(2), split(0, -2.0, leaf(1), leaf(0))])
    assert forest.offsets.tolist() == [0, 3, 4, 7]
    assert forest.feature.tolist() == [1, -1, -1, -1, 0, -1, -1]
    assert forest.threshold.tolist() == [0.5, 0, 0, 0, -2, 0, 0]
    assert forest.children_left.tolist() == [1, -1, -1, -1, 1, -1, -1]
    assert forest.children_right.tolist() == [2, -1, -1, -1, 2, -1, -1]
    assert forest.action.tolist() == [-1, 0, 1, 2, -1, 1, 0]


@pytest.mark.parametrize("trees", [[], [leaf(0)]])
def test_types_do_not_depend_on_the_number_of_trees(trees):
    forest = Forest.stack(trees)
    assert forest.offsets.dtype == np.int64
    assert forest.threshold.dtype == np.float32
    for array in (forest.feature, forest.children_left, forest.children_right, forest.action):
        assert array.dtype == np.int32


def test_an_individual_without_a_tree_is_refused_by_name():
    whole = Forest.stack([leaf(0), leaf(1)])
    gapped = Forest(
        np.array([0, 1, 1, 2]),
        whole.feature,
        whole.threshold,
        whole.children_left,
        whole.children_right,
        whole.action,
    )
    assert gapped.sizes.tolist() == [1, 0, 1]
    assert gapped.tree(2) == leaf(1)
    with pytest.raises(InvalidTreeError, match="individual 1 has no tree"):
        gapped.tree(1)


@pytest.mark.parametrize("index", [-1, 1])
def test_an_individual_outside_of_the_forest_is_refused(index):
    with pytest.raises(IndexError, match=f"individuals 0 to 0, not {index}"):
        Forest.stack([leaf(0)]).tree(index)


@given(st.data(), st.lists(renumbered_trees(), min_size=1, max_size=4))
def test_each_observation_is_decided_by_its_own_tree(data, trees):
    forest = Forest.stack(trees)
    rows = np.concatenate([data.draw(observations(tree)) for tree in trees])
    chosen = data.draw(st.lists(st.integers(0, len(trees) - 1), min_size=len(rows), max_size=len(rows)))
    expected = [int(trees[p].decide(row[np.newaxis])[0]) for p, row in zip(chosen, rows, strict=True)]
    assert forest.decide(np.array(chosen, dtype=np.int64), rows).tolist() == expected


@given(st.lists(trees(), max_size=5))
def test_depth_first_numbering_determines_the_children(numbered):
    forest = Forest.stack(numbered)
    again = Forest.depth_first(
        [tree.n_nodes for tree in numbered], forest.feature, forest.threshold, forest.action
    )
    assert [again.tree(index) for index in range(len(again))] == numbered


@given(trees(), st.integers(0, 3), st.integers(0, 2**32))
def test_copies_with_other_thresholds_are_the_trees_with_these_thresholds(tree, n, seed):
    thresholds = np.random.default_rng(seed).normal(size=(n, tree.n_nodes)).astype(np.float32)
    thresholds[:, tree.is_leaf] = 0
    thresholds[: n // 2] *= -0.0
    copies = Forest.of_thresholds(tree, thresholds)
    assert [copies.tree(index) for index in range(n)] == [
        replace(tree, threshold=threshold) for threshold in thresholds
    ]
