import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import float32s, observations, renumbered_trees, trees

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.simplify import (
    merge_equal_leaves,
    prune,
    prune_unvisited,
    simplify_exact,
    simplify_forest,
)

leaf, split = DecisionTree.leaf, DecisionTree.split

LOW = np.float32([-4.8, -np.inf, -0.5, -np.inf])
HIGH = np.float32([4.8, np.inf, 0.5, np.inf])


@st.composite
def bounds(draw, n_features=4):
    ends = st.sampled_from([-np.inf, np.inf]) | float32s()
    pairs = [sorted([draw(ends), draw(ends)]) for _ in range(n_features)]
    low, high = np.float32(pairs).T
    return low, high


def visits_of(tree, rows):
    """Count in plain Python how often the rows visit each node."""
    visits = [0] * tree.n_nodes
    for row in rows:
        node = 0
        visits[node] += 1
        while tree.children_left[node] != -1:
            goes_left = row[tree.feature[node]] < tree.threshold[node]
            node = tree.children_left[node] if goes_left else tree.children_right[node]
            visits[node] += 1
    return visits


def subtree(tree, node):
    if tree.children_left[node] == -1:
        return leaf(int(tree.action[node]))
    return split(
        int(tree.feature[node]),
        float(tree.threshold[node]),
        subtree(tree, tree.children_left[node]),
        subtree(tree, tree.children_right[node]),
    )


def decisions(tree):
    return [int(node) for node in np.flatnonzero(~tree.is_leaf)]


def test_an_unvisited_child_gives_its_parents_place_to_its_sibling():
    tree = split(0, 0.5, split(1, 0.25, leaf(0), leaf(1)), leaf(2))
    assert prune_unvisited(tree, [9, 9, 4, 5, 0]) == split(1, 0.25, leaf(0), leaf(1))
    assert prune_unvisited(tree, [9, 5, 0, 5, 4]) == split(0, 0.5, leaf(1), leaf(2))
    assert prune_unvisited(tree, [9, 9, 9, 0, 0]) == leaf(0)
    assert prune_unvisited(tree, [9, 0, 0, 0, 9]) == leaf(2)
    assert prune_unvisited(tree, [9, 5, 2, 3, 4]) == tree


def test_equal_leaves_merge_until_none_is_left():
    same = split(1, 0.25, leaf(1), split(2, 0.0, leaf(1), leaf(1)))
    assert merge_equal_leaves(same) == leaf(1)
    assert merge_equal_leaves(split(0, 0.5, same, leaf(0))) == split(0, 0.5, leaf(1), leaf(0))


def test_decisions_between_equal_subtrees_are_not_leaves_to_merge():
    half = split(1, 0.25, leaf(0), leaf(1))
    assert merge_equal_leaves(split(0, 0.5, half, half)) == split(0, 0.5, half, half)


def test_pruning_merges_leaves_that_only_visits_made_neighbours():
    tree = split(0, 0.5, leaf(1), split(1, 0.25, leaf(0), leaf(1)))
    assert merge_equal_leaves(tree) == tree
    assert prune(tree, [9, 4, 5, 0, 5]) == leaf(1)


@given(st.data(), renumbered_trees())
def test_a_pruned_tree_acts_as_the_full_one_on_what_was_visited(data, tree):
    rows = data.draw(observations(tree))
    pruned = prune(tree, visits_of(tree, rows))
    assert pruned.decide(rows).tolist() == tree.decide(rows).tolist()
    assert pruned.n_nodes <= tree.n_nodes


@given(st.data(), renumbered_trees())
def test_all_that_prune_unvisited_leaves_is_visited(data, tree):
    rows = data.draw(observations(tree))
    pruned = prune_unvisited(tree, visits_of(tree, rows))
    assert min(visits_of(pruned, rows)) > 0


@given(st.data(), renumbered_trees())
def test_merging_equal_leaves_never_changes_an_action(data, tree):
    rows = data.draw(observations(tree))
    merged = merge_equal_leaves(tree)
    assert merged.decide(rows).tolist() == tree.decide(rows).tolist()
    for node in decisions(merged):
        left, right = merged.children_left[node], merged.children_right[node]
        assert merged.action[left] != merged.action[right] or not merged.is_leaf[left]


@pytest.mark.parametrize(
    ("visits", "message"),
    [
        ([0, 0, 0], "nothing was validated"),
        ([3, 3], "one count for each of 3 nodes"),
        ([[3, 3, 0]], "one count for each of 3 nodes"),
        ([3, 0, 0], "node 0 was visited but neither child"),
    ],
)
def test_visits_of_something_else_are_refused(visits, message):
    with pytest.raises(InvalidTreeError, match=message):
        prune(split(0, 0.5, leaf(0), leaf(1)), visits)


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
def test_exact_simplification_of_known_trees(tree, simplified):
    assert simplify_exact(tree, LOW, HIGH) == simplified


@pytest.mark.parametrize("largest", [np.finfo(np.float32).max, np.inf])
def test_the_largest_float32_is_still_reached(largest):
    tree = split(0, np.finfo(np.float32).max, leaf(0), leaf(1))
    assert simplify_exact(tree, [-1.0], [largest]) == tree
    assert simplify_exact(split(0, 0.0, tree, leaf(1)), [-1.0], [largest]) == split(0, 0.0, leaf(0), leaf(1))


@given(st.data(), renumbered_trees(), bounds())
def test_exact_simplification_never_changes_an_action(data, tree, low_high):
    low, high = low_high
    near = [*low[np.isfinite(low)].tolist(), *high[np.isfinite(high)].tolist()]
    rows = np.clip(data.draw(observations(tree, near=near)), low, high)
    simplified = simplify_exact(tree, low, high)
    assert simplified.decide(rows).tolist() == tree.decide(rows).tolist()
    assert simplified.n_nodes <= tree.n_nodes


@given(renumbered_trees(), bounds())
def test_exact_simplification_is_idempotent(tree, low_high):
    simplified = simplify_exact(tree, *low_high)
    assert simplify_exact(simplified, *low_high) == simplified


@given(renumbered_trees(), bounds())
def test_every_leaf_that_remains_is_reached_by_an_observation_within_the_bounds(tree, low_high):
    low, high = low_high
    simplified = simplify_exact(tree, low, high)
    open_nodes = [(0, low)]
    while open_nodes:
        # If any observation reaches a node, the least one that goes right at every right turn does.
        node, witness = open_nodes.pop()
        if simplified.is_leaf[node]:
            assert (witness <= high).all()
            assert simplified.leaf_of(witness[np.newaxis]).tolist() == [node]
            continue
        raised = witness.copy()
        feature = simplified.feature[node]
        raised[feature] = max(raised[feature], simplified.threshold[node])
        open_nodes += [(simplified.children_left[node], witness), (simplified.children_right[node], raised)]


@given(renumbered_trees(), bounds())
def test_no_decision_between_equal_subtrees_remains(tree, low_high):
    simplified = simplify_exact(tree, *low_high)
    assert simplified == subtree(simplified, 0), "nodes are numbered depth first"
    for node in decisions(simplified):
        left, right = simplified.children_left[node], simplified.children_right[node]
        assert subtree(simplified, left) != subtree(simplified, right)


@given(st.lists(st.none() | renumbered_trees(), max_size=6), bounds())
def test_a_forest_is_simplified_tree_by_tree(individuals, low_high):
    present = Forest.stack([tree for tree in individuals if tree is not None])
    sizes = [0 if tree is None else tree.n_nodes for tree in individuals]
    forest = Forest(
        np.cumsum([0, *sizes]),
        present.feature,
        present.threshold,
        present.children_left,
        present.children_right,
        present.action,
    )
    simplified = simplify_forest(forest, *low_high)
    assert len(simplified) == len(individuals)
    for index, tree in enumerate(individuals):
        if tree is None:
            assert simplified.sizes[index] == 0
        else:
            assert simplified.tree(index) == simplify_exact(tree, *low_high)


@given(trees(), bounds())
def test_simplification_leaves_its_input_as_it_was(tree, low_high):
    low, high = low_high
    forest, kept = Forest.stack([tree]), (low.copy(), high.copy())
    simplify_forest(forest, low, high)
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
        simplify_exact(split(1, 0.5, leaf(0), leaf(1)), low, high)
