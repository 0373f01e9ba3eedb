"""A tree's neighbours are trees, and each edit changes one thing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import any_trees, trees_of_one_kind

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees import edits
from ge_torchrl.trees.edits import Neighbourhood, Split, forest_of
from ge_torchrl.trees.nodes import end_of
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
TREE = split(0, 0.5, split(1, -1.0, leaf(0), leaf(1)), leaf(2))
# Seen at the inner decision node, nodes 1 to 3, are the states with a first feature below 0.5.
OBSERVED = np.array([[0.0, -2.0], [0.25, 3.0], [9.0, 7.0]], np.float32)


def assembled(nodes):
    return forest_of([nodes]).tree(0)


def edited(kind, seed, tree=TREE, observed=OBSERVED):
    """Return what one kind of edit makes of a tree."""
    of = Neighbourhood(tree, observed)
    rng = np.random.default_rng(seed)
    return assembled(edits.EDITS[kind](edits.Edit(of._nodes, of._observed, of._leaf_start, [0, 1], 3, rng)))


def all_edited(kind):
    return {edited(kind, seed) for seed in range(300)}


@given(any_trees(n_features=2), st.booleans(), st.booleans(), st.integers(0, 2**32))
def test_every_neighbour_is_a_tree(tree, oblique, linear, seed):
    rng = np.random.default_rng(seed)
    observed = rng.normal(size=(20, 2)).astype(np.float32)
    neighbour = assembled(
        Neighbourhood(tree, observed, oblique=oblique, linear=linear).draw(np.arange(2), 3, rng)
    )
    assert neighbour == DecisionTree(*neighbour.arrays)
    assert neighbour.value.shape[1] == tree.value.shape[1]
    before = tree.num_decision_nodes
    assert abs(neighbour.num_decision_nodes - before) <= 2 * max(1, before)
    assert neighbour.action.max(initial=0) < 3
    assert max(neighbour.feature.max(initial=0), neighbour.leaf_feature.max(initial=0)) < 2
    if not oblique:
        assert np.diff(neighbour.term_start).max(initial=1) <= np.diff(tree.term_start).max(initial=1)
    if not linear:
        assert np.diff(neighbour.leaf_term_start).max() <= np.diff(tree.leaf_term_start).max()


@given(trees_of_one_kind().flatmap(lambda kind: st.lists(kind, max_size=5)))
def test_nodes_and_trees_are_the_same(trees):
    observed = np.zeros((1, 4), np.float32)
    assert forest_of([Neighbourhood(tree, observed)._nodes for tree in trees]).trees() == trees


def test_a_lone_leaf_can_only_grow():
    of = Neighbourhood(leaf(1), OBSERVED)
    streams = (np.random.default_rng(seed) for seed in range(50))
    sizes = [assembled(of.draw(np.arange(2), 3, rng)).num_decision_nodes for rng in streams]
    # A second edit may take back what the first one did.
    assert sizes.count(1) > 30


@pytest.mark.parametrize(
    ("node", "end"), [(0, 5), (1, 4), (2, 3), (3, 4), (4, 5)], ids=["root", "inner", "leaf", "leaf2", "last"]
)
def test_the_end_of_a_subtree(node, end):
    assert end_of(Neighbourhood(TREE, OBSERVED)._nodes, node) == end


def test_dropping_a_decision_keeps_one_of_its_children():
    assert all_edited("drop") == {
        split(1, -1.0, leaf(0), leaf(1)),
        leaf(2),
        split(0, 0.5, leaf(0), leaf(2)),
        split(0, 0.5, leaf(1), leaf(2)),
    }


def test_relabelling_changes_the_action_of_one_leaf():
    expected = set()
    for actions in ((a, 1, 2) for a in range(3)):
        expected.add(split(0, 0.5, split(1, -1.0, leaf(actions[0]), leaf(1)), leaf(2)))
    for action in range(3):
        expected.add(split(0, 0.5, split(1, -1.0, leaf(0), leaf(action)), leaf(2)))
        expected.add(split(0, 0.5, split(1, -1.0, leaf(0), leaf(1)), leaf(action)))
    assert all_edited("relabel") == expected


def test_a_new_test_takes_a_value_that_was_seen_at_its_node():
    at_root = {(f, float(value)) for f in range(2) for value in OBSERVED[:, f]}
    at_inner = {(f, float(value)) for f in range(2) for value in OBSERVED[:2, f]}
    found = all_edited("test_anew")
    roots = {(int(t.feature[0]), float(t.threshold[0])) for t in found if t.threshold[1] == -1.0}
    inners = {(int(t.feature[1]), float(t.threshold[1])) for t in found if t.threshold[0] == 0.5}
    assert roots - {(0, 0.5)} == at_root
    assert inners - {(1, -1.0)} == at_inner
    assert {t.num_decision_nodes for t in found} == {2}


def grown(subtree, seen):
    """Return all that a new decision and a new leaf above a subtree make of it, with thresholds that were seen."""
    return {
        split(feature, float(value), *children)
        for feature in range(2)
        for value in seen[:, feature]
        for action in range(3)
        for children in ((leaf(action), subtree), (subtree, leaf(action)))
    }


def test_growing_puts_a_decision_and_a_leaf_above_a_node_with_a_threshold_seen_there():
    inner = split(1, -1.0, leaf(0), leaf(1))
    expected = grown(TREE, OBSERVED)
    expected |= {split(0, 0.5, above, leaf(2)) for above in grown(inner, OBSERVED[:2])}
    expected |= {
        split(0, 0.5, split(1, -1.0, above, leaf(1)), leaf(2)) for above in grown(leaf(0), OBSERVED[:1])
    }
    expected |= {
        split(0, 0.5, split(1, -1.0, leaf(0), above), leaf(2)) for above in grown(leaf(1), OBSERVED[1:2])
    }
    expected |= {split(0, 0.5, inner, above) for above in grown(leaf(2), OBSERVED[2:])}
    # New decisions stand mostly above leaves, so the root's many possibilities need many draws.
    assert {edited("grow", seed) for seed in range(4000)} == expected


def test_a_lone_leaf_grows_into_a_decision():
    assert {edited("grow", seed, leaf(1)) for seed in range(400)} == grown(leaf(1), OBSERVED)


@pytest.fixture
def noted(monkeypatch):
    """The kind of every edit, and whether it knew which states come to a node."""
    notes = []

    def noting(kind, apply):
        def edit(of):
            notes.append((kind, of.leaf_start is not None))
            return apply(of)

        return edit

    monkeypatch.setattr(edits, "EDITS", {kind: noting(kind, apply) for kind, apply in edits.EDITS.items()})
    return notes


def neighbours(n, tree=TREE):
    of, rng = Neighbourhood(tree, OBSERVED), np.random.default_rng(0)
    return [of.draw(np.arange(2), 3, rng) for _ in range(n)]


def test_only_the_first_edit_knows_what_was_seen_at_a_node(noted):
    n = 1000
    for _ in range(n):
        before = len(noted)
        neighbours(1)
        assert [knows for _, knows in noted[before:]] in ([True], [True, False])
    neighbours(n)
    assert len(noted) > n


def test_kinds_come_as_often_as_they_should_and_a_second_edit_now_and_then(noted):
    n = 4000
    neighbours(n)
    # Within four standard deviations.
    assert abs(len(noted) - n - 0.3 * n) <= 4 * np.sqrt(n * 0.3 * 0.7)
    first = [kind for kind, knows in noted if knows]
    for kind, share in (("grow", 0.4), ("test_anew", 0.3), ("drop", 0.1), ("relabel", 0.2)):
        assert abs(first.count(kind) - share * n) <= 4 * np.sqrt(n * share * (1 - share))


def test_where_nothing_was_seen_any_state_gives_the_threshold():
    unseen = np.array([[9.0, 7.0]], np.float32)
    found = {edited("test_anew", seed, observed=unseen) for seed in range(60)}
    assert {float(t.threshold[1]) for t in found if t.threshold[0] == 0.5} == {7.0, 9.0}


def test_new_splits_test_only_the_features_that_are_allowed():
    for seed in range(100):
        nodes = Neighbourhood(leaf(0), OBSERVED).draw(np.array([1]), 3, np.random.default_rng(seed))
        assert {split.feature for split in nodes if isinstance(split, Split)} <= {(1,)}


def test_thresholds_are_finite_whatever_was_seen():
    observed = np.array([[np.inf, np.nan], [-np.inf, -0.0]], np.float32)
    found = {float(edited("grow", seed, leaf(0), observed).threshold[0]) for seed in range(60)}
    largest = float(np.finfo(np.float32).max)
    assert found == {largest, -largest, 0.0}
    zeros = {edited("grow", seed, leaf(0), observed[1:, 1:].repeat(2, axis=1)) for seed in range(60)}
    assert not any(np.signbit(tree.threshold).any() for tree in zeros)


def test_a_tree_without_states_or_with_other_bounds_has_no_neighbours():
    with pytest.raises(InvalidTreeError, match=r"at least one state, .* saw 0 states"):
        Neighbourhood(leaf(0), OBSERVED[:0])
    with pytest.raises(InvalidTreeError, match="there are 1 bounds for 2 values"):
        Neighbourhood(DecisionTree.value_leaf([1.0, 2.0]), OBSERVED, action_bounds=[(0.0, 1.0)])


@given(trees_of_one_kind().flatmap(lambda kind: st.tuples(kind, kind)), st.integers(0, 2**32))
def test_a_crossing_is_a_tree_with_a_subtree_of_the_other(trees, seed):
    observed = np.zeros((1, 4), np.float32)
    one, other = (Neighbourhood(tree, observed) for tree in trees)
    nodes = one.crossed_with(other, np.random.default_rng(seed))
    crossed = assembled(nodes)
    assert crossed == DecisionTree(*crossed.arrays)
    of_one, of_other = one._nodes, other._nodes
    assert any(
        nodes == [*of_one[:at], *of_other[of : end_of(of_other, of)], *of_one[end_of(of_one, at) :]]
        for at in range(len(of_one))
        for of in range(len(of_other))
    )
