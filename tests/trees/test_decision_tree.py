import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import observations, renumbered_trees

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.decision_tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split

ARRAYS = {
    "feature": [2, 3, -1, -1, -1],
    "threshold": [0.5, 0.25, 0, 0, 0],
    "children_left": [1, 2, -1, -1, -1],
    "children_right": [4, 3, -1, -1, -1],
    "action": [-1, -1, 0, 1, 1],
}


def walked(tree, observation):
    node = 0
    while tree.children_left[node] != -1:
        goes_left = observation[tree.feature[node]] < tree.threshold[node]
        node = tree.children_left[node] if goes_left else tree.children_right[node]
    return node


def depth_of(tree, node=0):
    if tree.children_left[node] == -1:
        return 0
    return 1 + max(depth_of(tree, tree.children_left[node]), depth_of(tree, tree.children_right[node]))


def test_split_numbers_nodes_depth_first():
    tree = split(2, 0.5, split(3, 0.25, leaf(0), leaf(1)), leaf(1))
    for name, values in ARRAYS.items():
        assert getattr(tree, name).tolist() == values


def test_a_leaf_is_one_node():
    tree = leaf(3)
    assert (tree.n_nodes, tree.n_decision_nodes, tree.depth) == (1, 0, 0)
    assert tree.is_leaf.tolist() == [True]
    assert tree.decide(np.zeros((2, 4))).tolist() == [3, 3]


def test_sizes_of_a_tree():
    tree = DecisionTree(**ARRAYS)
    assert (tree.n_nodes, tree.n_decision_nodes, tree.depth) == (5, 2, 2)
    assert tree.is_leaf.tolist() == [False, False, True, True, True]


def test_an_observation_at_the_threshold_goes_right():
    tree = split(0, 0.1, leaf(0), leaf(1))
    at = np.float32(0.1)
    below = np.nextafter(at, np.float32(0))
    assert tree.decide([[below], [at], [np.nan]]).tolist() == [0, 1, 1]


def test_observations_are_compared_as_float32():
    just_below_as_float64 = np.float64(np.float32(0.1)) - 1e-12
    assert split(0, 0.1, leaf(0), leaf(1)).decide([[just_below_as_float64]]).tolist() == [1]


@given(st.data(), renumbered_trees())
def test_decide_is_the_walk_from_the_root(data, tree):
    rows = data.draw(observations(tree))
    leaves = [walked(tree, row) for row in rows]
    assert tree.leaf_of(rows).tolist() == leaves
    assert tree.decide(rows).tolist() == tree.action[leaves].tolist()


def test_no_observations_give_no_actions():
    assert DecisionTree(**ARRAYS).decide(np.zeros((0, 4))).shape == (0,)


@given(renumbered_trees())
def test_depth_is_the_longest_path(tree):
    assert tree.depth == depth_of(tree)


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_are_read_only_copies(name):
    given_array = np.array(ARRAYS[name], dtype=np.float32 if name == "threshold" else np.int32)
    tree = DecisionTree(**{**ARRAYS, name: given_array})
    given_array[0] = 7
    assert getattr(tree, name).tolist() == ARRAYS[name]
    with pytest.raises(ValueError, match="read-only"):
        getattr(tree, name)[0] = 7
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(tree, name, given_array)


def test_types_are_fixed():
    tree = DecisionTree(**{name: np.array(values, dtype=np.int64) for name, values in ARRAYS.items()})
    assert tree.threshold.dtype == np.float32
    assert {getattr(tree, name).dtype for name in ARRAYS if name != "threshold"} == {np.dtype(np.int32)}


def test_equal_arrays_make_equal_trees():
    tree = DecisionTree(**ARRAYS)
    assert tree == DecisionTree(**ARRAYS)
    assert hash(tree) == hash(DecisionTree(**ARRAYS))
    assert tree != "a tree"


@pytest.mark.parametrize(
    "other",
    [
        split(1, 0.5, split(3, 0.25, leaf(0), leaf(1)), leaf(1)),
        split(2, 0.75, split(3, 0.25, leaf(0), leaf(1)), leaf(1)),
        split(2, 0.5, leaf(1), split(3, 0.25, leaf(0), leaf(1))),
        split(2, 0.5, split(3, 0.25, leaf(0), leaf(1)), leaf(0)),
    ],
)
def test_each_array_counts_in_equality(other):
    assert DecisionTree(**ARRAYS) != other


def test_both_zeros_are_one_threshold():
    positive, negative = (split(0, zero, leaf(0), leaf(1)) for zero in (0.0, -0.0))
    assert positive == negative
    assert hash(positive) == hash(negative)


def changed(name, index, value):
    return {**ARRAYS, name: [*ARRAYS[name][:index], value, *ARRAYS[name][index + 1 :]]}


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({name: [] for name in ARRAYS}, "at least 1"),
        ({**ARRAYS, "action": [-1, 0, 1]}, "five arrays of one length"),
        ({name: [values] for name, values in ARRAYS.items()}, "five arrays of one length"),
        ({**ARRAYS, "action": [[0], [0, 1]]}, "action must be one array of numbers"),
        (changed("feature", 0, 0.5), "feature must hold 32-bit integers, not float64"),
        (changed("action", 4, 2**40), "action must hold 32-bit integers"),
        (changed("action", 4, 2**80), "action must hold 32-bit integers"),
        ({**ARRAYS, "action": [False] * 5}, "action must hold 32-bit integers, not bool"),
        ({**ARRAYS, "threshold": ["a"] * 5}, "threshold must hold real numbers"),
        (changed("children_right", 1, -1), "node 1 has only one child"),
        (changed("children_left", 2, 3), "node 2 has only one child"),
        (changed("action", 2, -1), "node 2 is a leaf without an action"),
        (changed("feature", 3, 0), "node 3 is a leaf with a feature"),
        (changed("threshold", 3, 0.5), "node 3 is a leaf with a threshold"),
        (changed("action", 1, 0), "node 1 is a decision node with an action"),
        (changed("feature", 1, -1), "node 1 is a decision node without a feature"),
        (changed("threshold", 1, np.nan), "node 1 has a threshold that is not a finite number"),
        (changed("threshold", 1, -np.inf), "node 1 has a threshold that is not a finite number"),
        (changed("threshold", 1, 1e300), "node 1 has a threshold that is not a finite number"),
        (changed("children_left", 0, 5), "children must be nodes 1 to 4 .* one is 5"),
        (changed("children_left", 0, 0), "children must be nodes 1 to 4 .* one is 0"),
        (changed("children_left", 0, -2), "children must be nodes 1 to 4 .* one is -2"),
        (changed("children_left", 0, 3), "does not have exactly one parent"),
        (changed("children_right", 0, 1), "does not have exactly one parent"),
    ],
)
def test_what_is_not_a_tree_is_refused(arrays, message):
    with pytest.raises(InvalidTreeError, match=message):
        DecisionTree(**arrays)


def test_a_cycle_beside_the_root_is_refused():
    with pytest.raises(InvalidTreeError, match="4 nodes form a cycle"):
        DecisionTree(
            feature=[-1, 0, 0, -1, -1],
            threshold=[0, 0, 0, 0, 0],
            children_left=[-1, 2, 1, -1, -1],
            children_right=[-1, 3, 4, -1, -1],
            action=[0, -1, -1, 0, 1],
        )
