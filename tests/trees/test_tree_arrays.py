import dataclasses
import pickle

import numpy as np
import pytest
from arrays_for_tests import ARRAYS, AXIS_ALIGNED, TREE, VALUES
from hypothesis import given
from strategies import any_trees, trees

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_are_read_only_copies(name):
    given_array = np.array(VALUES[name], dtype=getattr(TREE, name).dtype)
    tree = DecisionTree(**{**VALUES, name: given_array})
    if given_array.size == 0:
        return
    given_array[0] = 7
    assert getattr(tree, name).tolist() == VALUES[name]
    with pytest.raises(ValueError, match="read-only"):
        getattr(tree, name)[0] = 7
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(tree, name, given_array)


def test_types_are_fixed():
    tree = DecisionTree(
        **{name: np.array(values) for name, values in VALUES.items() if name != "action"}, action=[]
    )
    floats = {name for name, array in tree.arrays._asdict().items() if array.dtype == np.float32}
    assert floats == {"weight", "threshold", "value", "leaf_weight"}
    assert {array.dtype for name, array in tree.arrays._asdict().items() if name not in floats} == {
        np.dtype(np.int32)
    }


def test_equal_arrays_make_equal_trees():
    assert DecisionTree.axis_aligned(**AXIS_ALIGNED) == TREE
    assert hash(DecisionTree.axis_aligned(**AXIS_ALIGNED)) == hash(TREE)
    assert TREE != "a tree"


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
    assert other != TREE


@given(trees(), trees())
def test_trees_are_equal_exactly_where_their_arrays_are(one, other):
    arrays = zip(one.arrays, other.arrays, strict=True)
    assert (one == other) == all(np.array_equal(of_one, of_other) for of_one, of_other in arrays)


@given(any_trees())
def test_a_tree_travels_between_processes(tree):
    there = pickle.loads(pickle.dumps(tree))  # noqa: S301, our own bytes
    assert there == tree
    assert hash(there) == hash(tree)


def test_both_zeros_are_one_number():
    positive, negative = (split(0, zero, leaf(0), leaf(1)) for zero in (0.0, -0.0))
    assert positive == negative == positive.with_parameters([-0.0])
    assert hash(positive) == hash(negative)


def changed(name, index, value, arrays=ARRAYS):
    return {**arrays, name: [*arrays[name][:index], value, *arrays[name][index + 1 :]]}


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({**ARRAYS, "action": [0, 1]}, "each of the 3 leaves must hold one action"),
        ({**ARRAYS, "value": np.zeros((2, 0))}, "value must have length 3 in a tree of 2 splits, 3 leaves"),
        ({**ARRAYS, "children_left": [1]}, "children_left must have length 2"),
        ({**ARRAYS, "threshold": [[0.5], [1.0]]}, "threshold must be an array of 1 dimensions"),
        ({**ARRAYS, "action": [[0], [0, 1]]}, "action must be one array of numbers"),
        ({**ARRAYS, "action": [[0, 1, 1]]}, "action must be one row of integers"),
        (changed("feature", 0, 0.5), "feature must hold 32-bit integers, not float64"),
        (changed("action", 2, 2**40), "action must hold 32-bit integers"),
        (changed("action", 2, 2**80), "action must hold 32-bit integers"),
        ({**ARRAYS, "action": [False] * 3}, "action must hold 32-bit integers, not bool"),
        ({**ARRAYS, "threshold": ["a"] * 2}, "threshold must hold real numbers"),
        (changed("action", 2, -1), r"action\[2\] must be at least 0, not -1"),
        (changed("feature", 1, -1), r"feature\[1\] must be at least 0, not -1"),
        (changed("threshold", 1, np.nan), r"threshold\[1\] must be a finite float32, not nan"),
        (changed("threshold", 1, -np.inf), r"threshold\[1\] must be a finite float32, not -inf"),
        (changed("threshold", 1, 1e300), r"threshold\[1\] must be a finite float32, not 1e\+300"),
        (changed("weight", 0, np.inf), r"weight\[0\] must be a finite float32, not inf"),
        (changed("children_left", 0, 2), "must be one of the splits 1 to 1 .* it is 2"),
        (changed("children_left", 0, 0), "must be one of the splits 1 to 1 .* it is 0"),
        (changed("children_left", 0, ~3), "or a leaf, ~0 to ~2; it is -4"),
        (changed("children_left", 0, ~2), "split 1 must have exactly one parent, not 0"),
        (changed("children_right", 0, 1), "split 1 must have exactly one parent, not 2"),
        (changed("children_right", 1, ~0), "leaf 0 must have exactly one parent, not 2"),
        ({**ARRAYS, "term_start": [0, 2, 2]}, "term_start must begin at 0, leave at least 1"),
        ({**ARRAYS, "term_start": [1, 1, 2]}, "term_start must begin at 0"),
        ({**ARRAYS, "term_start": [0, 1, 3]}, "and end at 2, the number of terms"),
        (
            {**ARRAYS, "leaf_feature": [0], "leaf_weight": [[]], "leaf_term_start": [0, 1, 1, 1]},
            "hold one action, or",
        ),
        ({**VALUES, "action": [0, 1, 2]}, "hold one action, or values"),
        (
            {**VALUES, "leaf_weight": [[1.0, 2.0]] * 2},
            "leaf_weight must have one column for each of the 1 values",
        ),
        ({**VALUES, "leaf_term_start": [0, 2, 1, 2]}, "leaf_term_start must begin at 0"),
        (changed("leaf_feature", 1, -1, VALUES), r"leaf_feature\[1\] must be at least 0"),
        (changed("value", 1, [np.nan], VALUES), r"value\[1\] must be a finite float32, not \[nan\]"),
    ],
)
def test_what_is_not_a_tree_is_refused(arrays, message):
    with pytest.raises(InvalidTreeError, match=message):
        DecisionTree(**arrays)


def test_a_cycle_beside_the_root_is_refused():
    with pytest.raises(InvalidTreeError, match="2 splits form a cycle that the root does not reach"):
        DecisionTree.axis_aligned([0] * 3, [0.0] * 3, [~0, 2, 1], [~1, ~2, ~3], [0, 1, 2, 3])


def test_halves_of_two_kinds_and_splits_of_nothing_are_refused():
    with pytest.raises(InvalidTreeError, match="they hold 0 and 1 values a leaf"):
        split(0, 0.5, leaf(0), DecisionTree.value_leaf([1.0]))
    for feature, weight in (([], []), ([0], [1.0, 2.0]), ([-1], [1.0])):
        with pytest.raises(InvalidTreeError, match="a split needs at least one feature"):
            DecisionTree.weighted_split(feature, weight, 0.5, leaf(0), leaf(1))
