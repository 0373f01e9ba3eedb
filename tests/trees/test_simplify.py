"""Simplified trees are smaller and act the same on all that the bounds allow."""

import numpy as np
import pytest
from forests_for_tests import NO_TREE, simplify_one
from hypothesis import given
from hypothesis import strategies as st
from strategies import any_trees, float32s, observations, trees, trees_of_one_kind, weighted_trees
from subtrees_for_tests import subtree

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.simplify import simplify
from ge_torchrl.trees.tree import DecisionTree

leaf, split, weighted, value = (
    DecisionTree.leaf,
    DecisionTree.split,
    DecisionTree.weighted_split,
    DecisionTree.value_leaf,
)

LOW = np.float32([-4.8, -np.inf, -0.5, -np.inf])
HIGH = np.float32([4.8, np.inf, 0.5, np.inf])
LARGEST = np.finfo(np.float32).max


@st.composite
def bounds(draw, n_features=4):
    ends = st.sampled_from([-np.inf, np.inf]) | float32s()
    pairs = [sorted([draw(ends), draw(ends)]) for _ in range(n_features)]
    low, high = np.float32(pairs).T
    return low, high


def has_equal_halves(tree):
    return any(
        subtree(tree, tree.children_left[node]) == subtree(tree, tree.children_right[node])
        for node in range(tree.num_decision_nodes)
    )


@pytest.mark.parametrize(
    ("tree", "simplified"),
    [
        # Bounds of feature 2 are -0.5 and 0.5, both inclusive.
        (split(2, 0.5, leaf(0), leaf(1)), split(2, 0.5, leaf(0), leaf(1))),
        (split(2, np.nextafter(np.float32(0.5), np.float32(1)), leaf(0), leaf(1)), leaf(0)),
        (split(2, -0.5, leaf(0), leaf(1)), leaf(1)),
        (
            split(2, np.nextafter(np.float32(-0.5), np.float32(0)), leaf(0), leaf(1)),
            split(2, np.nextafter(np.float32(-0.5), np.float32(0)), leaf(0), leaf(1)),
        ),
        # What the path already decided is not asked again.
        (
            split(0, 1.0, split(0, 1.0, leaf(0), leaf(1)), split(0, 1.0, leaf(1), leaf(2))),
            split(0, 1.0, leaf(0), leaf(2)),
        ),
        (
            split(0, 1.0, split(0, 2.0, leaf(0), leaf(1)), split(0, 0.0, leaf(1), leaf(2))),
            split(0, 1.0, leaf(0), leaf(2)),
        ),
        # The interval of one branch is not that of the other.
        (
            split(0, 1.0, split(1, 0.0, leaf(0), leaf(1)), split(0, 2.0, leaf(1), leaf(2))),
            split(0, 1.0, split(1, 0.0, leaf(0), leaf(1)), split(0, 2.0, leaf(1), leaf(2))),
        ),
        # Leaves that become neighbours merge, and so do equal subtrees.
        (split(0, 1.0, leaf(1), split(0, 0.0, leaf(0), leaf(1))), leaf(1)),
        (
            split(3, 7.0, split(1, 0.0, leaf(0), leaf(1)), split(1, 0.0, leaf(0), leaf(1))),
            split(1, 0.0, leaf(0), leaf(1)),
        ),
        # Nothing lies between 0 and the least positive float32.
        (
            split(1, 0.0, leaf(0), split(1, 1e-45, leaf(1), split(1, 1e-45, leaf(2), leaf(0)))),
            split(1, 0.0, leaf(0), split(1, 1e-45, leaf(1), leaf(0))),
        ),
    ],
)
def test_simplification_of_known_trees(tree, simplified):
    assert simplify_one(tree, LOW, HIGH) == simplified


def test_equal_leaves_with_values_merge():
    here, there = value([1.0, 2.0], {0: [1.0, 0.0]}), value([1.0, 2.0], {1: [1.0, 0.0]})
    assert simplify_one(split(0, 0.5, here, here), LOW, HIGH) == here
    tree = split(0, 0.5, here, split(0, 0.5, value([0.0, 0.0]), there))
    assert simplify_one(tree, LOW, HIGH) == split(0, 0.5, here, there)


@pytest.mark.parametrize("largest", [np.finfo(np.float32).max, np.inf])
def test_the_largest_float32_is_still_reached(largest):
    tree = split(0, np.finfo(np.float32).max, leaf(0), leaf(1))
    assert simplify_one(tree, [-1.0], [largest]) == tree
    assert simplify_one(split(0, 0.0, tree, leaf(1)), [-1.0], [largest]) == split(0, 0.0, leaf(0), leaf(1))


@pytest.mark.parametrize(
    ("terms", "threshold", "expected"),
    [
        # Feature 2 lies in [-0.5, 0.5], feature 0 in [-4.8, 4.8]; float32 4.8 is a little above 4.8.
        (([2, 2], [1.0, 1.0]), 1.1, "TRUE"),
        (([2, 2], [1.0, 1.0]), 1.0, "open"),
        (([2, 2], [1.0, 1.0]), -1.0, "FALSE"),
        (([0, 2], [1.0, -2.0]), 5.9, "TRUE"),
        (([0, 2], [1.0, -2.0]), 5.8, "open"),
        (([0, 2], [1.0, -2.0]), -5.9, "FALSE"),
        # One term of another weight.
        (([2], [-2.0]), 1.5, "TRUE"),
        (([2], [-2.0]), -1.0, "FALSE"),
        # Sums that may be infinite, or infinity minus infinity, are not judged.
        (([1, 2], [1.0, 1.0]), 3e38, "open"),
        (([1, 3], [1.0, -1.0]), 0.0, "open"),
        # A weight of 0 adds nothing to any finite observation.
        (([1, 2], [0.0, 1.0]), 1.0, "TRUE"),
        (([1, 2], [0.0, 2.0]), -1.0, "FALSE"),
        (([2], [0.0]), 1.0, "TRUE"),
        (([2, 0], [0.0, 0.0]), 0.0, "FALSE"),
    ],
)
def test_a_split_on_a_sum_goes_only_where_bounds_decide(terms, threshold, expected):
    simplified = simplify_one(weighted(*terms, threshold, leaf(0), leaf(1)), LOW, HIGH)
    if expected == "open":
        assert simplified.num_decision_nodes == 1
    else:
        assert simplified == {"TRUE": leaf(0), "FALSE": leaf(1)}[expected]


@pytest.mark.parametrize(
    ("terms", "threshold", "plainer"),
    [
        # A split on one feature has weight 1; the other side of the threshold may begin one float32 further.
        (([0], [2.0]), 1.0, split(0, 0.5, leaf(0), leaf(1))),
        (([0], [0.1]), 0.3, split(0, np.nextafter(np.float32(3), np.float32(4)), leaf(0), leaf(1))),
        (([0], [-2.0]), 1.0, split(0, np.nextafter(np.float32(-0.5), np.float32(0)), leaf(1), leaf(0))),
        (([0], [-1.0]), 0.0, split(0, 1e-45, leaf(1), leaf(0))),
        # No finite threshold says the same.
        (([1], [1e-30]), 1e10, weighted([1], [1e-30], 1e10, leaf(0), leaf(1))),
        # Terms of weight 0 go.
        (([1, 0], [0.0, 1.0]), 1.0, split(0, 1.0, leaf(0), leaf(1))),
        (([0, 2, 1], [1.0, 0.0, 3.0]), 1.0, weighted([0, 1], [1.0, 3.0], 1.0, leaf(0), leaf(1))),
        # A feature that stands twice stands once where that rounds alike: in front of all others.
        (([0, 0], [1.0, 3.0]), 2.0, split(0, 0.5, leaf(0), leaf(1))),
        (([0, 2, 0], [1.0, 0.0, 3.0]), 2.0, split(0, 0.5, leaf(0), leaf(1))),
        (([0, 0, 1], [1.0, 3.0, 1.0]), 2.0, weighted([0, 1], [4.0, 1.0], 2.0, leaf(0), leaf(1))),
        (([1, 1, 0], [1.5, -1.5, 1.0]), 2.0, split(0, 2.0, leaf(0), leaf(1))),
        (([1, 0, 0], [1.0, 3.0, 1.0]), 2.0, weighted([1, 0, 0], [1.0, 3.0, 1.0], 2.0, leaf(0), leaf(1))),
        (([0, 0], [1.0, 1e-9]), 2.0, weighted([0, 0], [1.0, 1e-9], 2.0, leaf(0), leaf(1))),
        (([1, 1], [3e38, 3e38]), 2.0, weighted([1, 1], [3e38, 3e38], 2.0, leaf(0), leaf(1))),
    ],
)
def test_sums_lose_what_they_do_not_need(terms, threshold, plainer):
    assert simplify_one(weighted(*terms, threshold, leaf(0), leaf(1)), LOW, HIGH) == plainer


def test_terms_of_leaves_that_add_nothing_go():
    plain = value([1.0, 2.0], {1: [0.0, 3.0]})
    wordy = value([1.0, 2.0], {0: [0.0, 0.0], 1: [0.0, 3.0], 2: [0.0, 0.0]})
    assert simplify_one(wordy, LOW, HIGH) == plain
    assert simplify_one(split(0, 0.5, wordy, plain), LOW, HIGH) == plain


def test_a_sum_that_was_compared_before_is_not_compared_again():
    def asked(threshold, left, right):
        return weighted([0, 1], [1.0, 2.0], threshold, left, right)

    below, above, other = (split(2, 0.25, leaf(kind), leaf(2)) for kind in (0, 1, 3))
    tree = asked(1.0, asked(1.0, below, other), asked(1.0, other, above))
    assert simplify_one(tree, LOW, HIGH) == asked(1.0, below, above)
    tree = asked(1.0, split(3, 0.0, asked(2.0, below, other), leaf(1)), asked(0.0, other, above))
    assert simplify_one(tree, LOW, HIGH) == asked(1.0, split(3, 0.0, below, leaf(1)), above)
    tree = asked(1.0, asked(0.0, below, above), asked(2.0, below, above))
    assert simplify_one(tree, LOW, HIGH) == tree


def test_the_path_narrows_what_a_sum_can_be():
    below = weighted([0, 2], [1.0, 1.0], 0.6, leaf(0), leaf(1))
    assert simplify_one(split(0, 0.0, below, leaf(2)), LOW, HIGH) == split(0, 0.0, leaf(0), leaf(2))
    # The threshold itself goes right, so what goes left is at most the float32 below.
    twice = weighted([2, 2], [1.0, 1.0], 0.5, leaf(0), leaf(1))
    assert simplify_one(split(2, 0.25, twice, leaf(2)), LOW, HIGH) == split(2, 0.25, leaf(0), leaf(2))
    # The float32 below 0 is lost beside 0.5 even in float64: the sum is 0.5, and goes right.
    rounded = split(0, 0.0, weighted([0, 2], [1.0, 1.0], 0.5, leaf(0), leaf(1)), leaf(2))
    assert simplify_one(rounded, LOW, HIGH) == rounded
    above = weighted([0, 2], [1.0, 1.0], -0.5, leaf(0), leaf(1))
    assert simplify_one(split(0, 0.0, leaf(2), above), LOW, HIGH) == split(0, 0.0, leaf(2), leaf(1))


def test_equal_halves_with_sums_merge():
    half = weighted([0, 1], [1.0, 2.0], 0.5, leaf(0), leaf(1))
    assert simplify_one(weighted([2, 0], [1.0, 3.0], 0.0, half, half), LOW, HIGH) == half
    other = weighted([0, 1], [1.0, 2.5], 0.5, leaf(0), leaf(1))
    apart = split(1, 0.0, half, other)
    assert simplify_one(apart, LOW, HIGH) == apart
    assert simplify_one(split(2, 0.0, apart, apart), LOW, HIGH) == apart


@given(st.data(), any_trees(), bounds())
def test_simplification_never_changes_an_answer(data, tree, low_high):
    low, high = low_high
    near = [*low[np.isfinite(low)].tolist(), *high[np.isfinite(high)].tolist()]
    if not tree.is_axis_aligned or not tree.has_actions:
        # A weight of 0 says of an infinite feature that the sum is no number.
        low, high = (np.clip(bound, -LARGEST, LARGEST) for bound in low_high)
    rows = np.clip(data.draw(observations(tree, near=near)), low, high)
    corners = np.where(data.draw(st.lists(st.booleans(), min_size=4, max_size=4)), low, high)
    rows = np.concatenate([rows, corners[np.newaxis]])
    simplified = simplify_one(tree, *low_high)
    assert np.array_equal(simplified.decide(rows), tree.decide(rows), equal_nan=True)
    assert simplified.num_decision_nodes <= tree.num_decision_nodes
    assert (len(simplified.feature), len(simplified.leaf_feature)) <= (
        len(tree.feature),
        len(tree.leaf_feature),
    )


@given(any_trees(), bounds())
def test_simplification_is_idempotent_and_leaves_no_equal_halves(tree, low_high):
    simplified = simplify_one(tree, *low_high)
    assert simplify_one(simplified, *low_high) == simplified
    assert simplified == DecisionTree(*simplified.arrays), "a tree, depth first"
    assert not has_equal_halves(simplified)


@given(trees(), bounds())
def test_every_leaf_that_remains_is_reached_by_an_observation_within_the_bounds(tree, low_high):
    low, high = low_high
    simplified = simplify_one(tree, low, high)
    open_nodes = [(0 if simplified.num_decision_nodes else ~0, low)]
    while open_nodes:
        # If any observation reaches a node, the least one that goes right at every right turn does.
        node, witness = open_nodes.pop()
        if node < 0:
            assert (witness <= high).all()
            assert simplified.leaf_of(witness[np.newaxis]).tolist() == [~node]
            continue
        raised = witness.copy()
        feature = simplified.feature[node]
        raised[feature] = max(raised[feature], simplified.threshold[node])
        open_nodes += [(simplified.children_left[node], witness), (simplified.children_right[node], raised)]


@given(
    trees_of_one_kind().flatmap(lambda kind: st.lists(st.none() | kind, max_size=6)),
    bounds(),
)
def test_a_forest_is_simplified_tree_by_tree(individuals, low_high):
    parts = [NO_TREE if tree is None else Forest.stack([tree]) for tree in individuals]
    simplified = simplify(Forest.concatenate(parts), *low_high)
    assert simplified.valid.tolist() == [tree is not None for tree in individuals]
    for index, tree in enumerate(individuals):
        if tree is not None:
            assert simplified.tree(index) == simplify_one(tree, *low_high)
    for array in simplified.arrays:
        assert array.flags.c_contiguous
        assert array.flags.writeable


@given(weighted_trees(), bounds())
def test_simplification_leaves_its_input_as_it_was(tree, low_high):
    low, high = low_high
    forest, kept = Forest.stack([tree]), (low.copy(), high.copy())
    simplify(forest, low, high)
    assert forest.tree(0) == tree
    assert np.array_equal([low, high], kept)


@pytest.mark.parametrize(
    ("low", "high", "message"),
    [
        ([0.0, 0.0], [1.0], "two vectors with low <= high"),
        ([0.0, 2.0], [1.0, 1.0], "two vectors with low <= high"),
        ([0.0, np.nan], [1.0, 1.0], "two vectors with low <= high"),
        ([[0.0, 0.0]], [[1.0, 1.0]], "two vectors with low <= high"),
        ([0.0], [1.0], "those of 1 features; a tree uses feature 1"),
    ],
)
def test_bounds_of_something_else_are_refused(low, high, message):
    with pytest.raises(InvalidTreeError, match=message):
        simplify_one(split(1, 0.5, leaf(0), leaf(1)), low, high)
