import dataclasses
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import any_trees, float32s, observations, trees, weighted_trees

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split

AXIS_ALIGNED = {
    "feature": [2, 3],
    "threshold": [0.5, 0.25],
    "children_left": [1, ~0],
    "children_right": [~2, ~1],
    "action": [0, 1, 1],
}
TREE = DecisionTree.axis_aligned(**AXIS_ALIGNED)
ARRAYS = {name: array.tolist() for name, array in TREE.arrays._asdict().items()} | {
    "leaf_weight": np.zeros((0, 0))
}
VALUES = {
    **ARRAYS,
    "action": [],
    "value": [[0.5], [1.0], [2.0]],
    "leaf_term_start": [0, 0, 2, 2],
    "leaf_feature": [1, 0],
    "leaf_weight": [[1.0], [3.0]],
}


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


@given(any_trees())
def test_parameters_come_back(tree):
    assert tree.with_parameters(tree.parameters) == tree


@given(st.data(), any_trees())
def test_other_parameters_leave_the_structure_and_are_kept(data, tree):
    n = len(tree.parameters)
    numbers = data.draw(st.lists(float32s(), min_size=n, max_size=n))
    other = tree.with_parameters(numbers)
    assert other.structure == tree.structure
    assert np.array_equal(other.parameters, np.float32(numbers))
    assert (other == tree) == (other.parameters.tobytes() == tree.parameters.tobytes())
    assert DecisionTree(*other.arrays) == other


@given(any_trees(), any_trees())
def test_structures_are_equal_exactly_where_only_numbers_differ(one, other):
    differ_in_numbers = (
        len(one.parameters) == len(other.parameters) and one.with_parameters(other.parameters) == other
    )
    assert (one.structure == other.structure) == differ_in_numbers


def test_parameters_stand_in_their_order():
    below = split(
        0,
        0.5,
        DecisionTree.value_leaf([10.0, 11.0], {1: [20.0, 21.0]}),
        DecisionTree.value_leaf([12.0, 13.0]),
    )
    tree = DecisionTree.weighted_split([0, 3], [2.0, 3.0], -1.0, DecisionTree.value_leaf([8.0, 9.0]), below)
    assert tree.parameters.tolist() == [-1.0, 0.5, 2.0, 3.0, 8, 9, 10, 11, 12, 13, 20, 21]
    spread = np.array([4.0, 2.0, 1.0, 0.5])
    of_sum = np.hypot(2 * 4, 3 * 0.5)
    expected = [of_sum, 4.0, of_sum / 4, of_sum / 0.5, *[1.0] * 6, 0.5, 0.5]
    assert tree.parameter_units(spread) == pytest.approx(expected)


@given(weighted_trees())
def test_every_parameter_has_a_step(tree):
    units = tree.parameter_units(np.array([0.5, 1.0, 2.0, 4.0]))
    assert units.shape == tree.parameters.shape
    assert (units > 0).all()


def test_the_weight_of_a_lone_term_is_no_parameter():
    scaled = DecisionTree.weighted_split([0], [2.0], 1.0, leaf(0), leaf(1))
    assert not scaled.is_axis_aligned
    assert scaled.parameters.tolist() == [1.0]
    assert scaled.structure != split(0, 1.0, leaf(0), leaf(1)).structure
    assert scaled.parameter_units(np.array([3.0])).tolist() == [6.0]


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ([0.5], "has 2 parameters; 1 were given"),
        ([0.5, np.nan], r"parameters\[1\] must be a finite float32, not nan"),
        ([1e39, 0.5], r"parameters\[0\] must be a finite float32, not 1e\+39"),
    ],
)
def test_parameters_of_something_else_are_refused(numbers, message):
    with pytest.raises(InvalidTreeError, match=message):
        TREE.with_parameters(numbers)


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
