import numpy as np
import pytest
from arrays_for_tests import AXIS_ALIGNED, TREE
from hypothesis import given
from hypothesis import strategies as st
from strategies import any_trees, observations

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split


@st.composite
def renumbered(draw, tree):
    """The fields of a tree with splits behind the root, and leaves, in any order."""
    n_splits = tree.num_decision_nodes
    splits = [0, *draw(st.permutations(range(1, n_splits)))] if n_splits else []
    leaves = draw(st.permutations(range(tree.num_leaves)))

    def number(child):
        return splits.index(child) if child >= 0 else ~leaves.index(~child)

    def of_rows(start, items, *arrays):
        rows = [row for item in items for row in range(start[item], start[item + 1])]
        counts = [0, *(start[item + 1] - start[item] for item in items)]
        return [np.cumsum(counts), *(array[rows] for array in arrays)]

    terms = of_rows(tree.term_start, splits, tree.feature, tree.weight)
    leaf_terms = of_rows(tree.leaf_term_start, leaves, tree.leaf_feature, tree.leaf_weight)
    return {
        "children_left": [number(tree.children_left[m]) for m in splits],
        "children_right": [number(tree.children_right[m]) for m in splits],
        **dict(zip(("term_start", "feature", "weight"), terms, strict=True)),
        "threshold": tree.threshold[splits],
        "action": tree.action[leaves] if tree.has_actions else [],
        "value": tree.value[leaves],
        **dict(zip(("leaf_term_start", "leaf_feature", "leaf_weight"), leaf_terms, strict=True)),
    }


def walked(tree, row):
    """The leaf of a row, and its answer, in plain Python."""
    node = 0 if tree.num_decision_nodes else ~0
    while node >= 0:
        total = 0.0
        for term in range(tree.term_start[node], tree.term_start[node + 1]):
            total += float(tree.weight[term]) * float(row[tree.feature[term]])
        goes_left = total < float(tree.threshold[node])
        node = int((tree.children_left if goes_left else tree.children_right)[node])
    if tree.has_actions:
        return ~node, int(tree.action[~node])
    answer = []
    for column in range(tree.value.shape[1]):
        total = float(tree.value[~node, column])
        for term in range(tree.leaf_term_start[~node], tree.leaf_term_start[~node + 1]):
            total += float(tree.leaf_weight[term, column]) * float(row[tree.leaf_feature[term]])
        with np.errstate(over="ignore"):
            answer.append(float(np.float32(total)))
    return ~node, answer


def depth_of(tree, node):
    children = (tree.children_left, tree.children_right)
    return 0 if node < 0 else 1 + max(depth_of(tree, of_side[node]) for of_side in children)


def test_split_numbers_splits_and_leaves_depth_first():
    assert split(2, 0.5, split(3, 0.25, leaf(0), leaf(1)), leaf(1)) == TREE
    for name, values in AXIS_ALIGNED.items():
        assert getattr(TREE, name).tolist() == values
    assert (TREE.term_start.tolist(), TREE.weight.tolist()) == ([0, 1, 2], [1.0, 1.0])
    assert (TREE.num_decision_nodes, TREE.num_leaves, TREE.depth) == (2, 3, 2)
    assert TREE.has_actions
    assert TREE.is_axis_aligned


def test_a_leaf_is_a_tree_without_splits():
    tree = leaf(3)
    assert (tree.num_decision_nodes, tree.num_leaves, tree.depth) == (0, 1, 0)
    assert tree.decide(np.zeros((2, 4))).tolist() == [3, 3]
    assert len(tree.parameters) == 0


@given(st.data(), any_trees())
def test_any_numbering_gives_the_one_depth_first_tree(data, tree):
    again = DecisionTree(**data.draw(renumbered(tree)))
    assert again == tree
    assert again.structure == tree.structure
    for name, array in tree.arrays._asdict().items():
        assert getattr(again, name).tolist() == array.tolist()
        assert getattr(again, name).dtype == array.dtype
        assert getattr(again, name).shape == array.shape


def numbered(tree, node, splits, leaves):
    if node < 0:
        leaves.append(~node)
        return
    splits.append(node)
    numbered(tree, tree.children_left[node], splits, leaves)
    numbered(tree, tree.children_right[node], splits, leaves)


@given(any_trees())
def test_splits_and_leaves_are_numbered_depth_first(tree):
    splits, leaves = [], []
    numbered(tree, 0 if tree.num_decision_nodes else ~0, splits, leaves)
    assert splits == list(range(tree.num_decision_nodes))
    assert leaves == list(range(tree.num_leaves))


@given(st.data(), any_trees())
def test_decide_is_the_walk_from_the_root(data, tree):
    rows = data.draw(observations(tree))
    expected = [walked(tree, row) for row in rows]
    assert tree.leaf_of(rows).tolist() == [of_row for of_row, _ in expected]
    assert np.array_equal(tree.decide(rows), [answer for _, answer in expected], equal_nan=True)


def test_an_observation_at_the_threshold_goes_right_and_so_does_nan():
    tree = split(0, 0.1, leaf(0), leaf(1))
    at = np.float32(0.1)
    below = np.nextafter(at, np.float32(0))
    assert tree.decide([[below], [at], [np.nan]]).tolist() == [0, 1, 1]
    weighted = DecisionTree.weighted_split([0, 0], [1.0, 1.0], 0.0, leaf(0), leaf(1))
    assert weighted.decide([[-1.0], [0.0], [np.nan], [-np.inf]]).tolist() == [0, 1, 1, 0]


def test_observations_are_compared_as_float32():
    just_below_as_float64 = np.float64(np.float32(0.1)) - 1e-12
    assert split(0, 0.1, leaf(0), leaf(1)).decide([[just_below_as_float64]]).tolist() == [1]


def test_sums_are_taken_in_float64_in_the_order_of_their_terms():
    small_last = DecisionTree.weighted_split([0, 1, 2], [1.0, 1.0, 1.0], 0.5, leaf(0), leaf(1))
    small_between = DecisionTree.weighted_split([0, 2, 1], [1.0, 1.0, 1.0], 0.5, leaf(0), leaf(1))
    row = np.float32([[1e20, -1e20, 1.0]])
    assert small_last.decide(row).tolist() == [1]
    assert small_between.decide(row).tolist() == [0]


def test_linear_leaves_add_to_their_values():
    tree = split(
        0, 0.5, DecisionTree.value_leaf([1.0, 2.0], {1: [0.5, -1.0]}), DecisionTree.value_leaf([0.0, 7.0])
    )
    assert not tree.has_actions
    assert tree.decide([[0.0, 4.0], [1.0, 4.0]]).tolist() == [[3.0, -2.0], [0.0, 7.0]]
    assert tree.decide(np.zeros((0, 2))).shape == (0, 2)


def test_no_observations_give_no_actions():
    assert TREE.decide(np.zeros((0, 4))).shape == (0,)


@given(any_trees())
def test_depth_is_the_longest_path(tree):
    assert tree.depth == depth_of(tree, 0 if tree.num_decision_nodes else ~0)


def test_other_actions():
    assert TREE.with_actions([2, 0, 1]) == split(2, 0.5, split(3, 0.25, leaf(2), leaf(0)), leaf(1))
    for actions in ([0, 1], [0, 1, -1]):
        with pytest.raises(InvalidTreeError, match="takes 3 actions, each at least 0"):
            TREE.with_actions(actions)
    with pytest.raises(InvalidTreeError, match="takes 0 actions"):
        DecisionTree.value_leaf([1.0]).with_actions([0])


@given(st.data(), any_trees())
def test_a_split_is_visited_as_often_as_its_leaves(data, tree):
    rows = data.draw(observations(tree))
    visits = np.bincount(tree.leaf_of(rows), minlength=tree.num_leaves)
    of_splits = tree.split_visits(visits)
    assert of_splits.shape == (tree.num_decision_nodes,)
    for node, visited in enumerate(of_splits):
        splits, leaves = [], []
        numbered(tree, node, splits, leaves)
        assert visited == visits[leaves].sum()
