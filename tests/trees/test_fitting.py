"""A tree that is fitted to examples: it explains what a tree can explain, the most important first."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import trees

from ge_torchrl.trees.fitting import Examples, fit
from ge_torchrl.trees.nodes import Split, forest_of


def fitted(examples, n_splits, features=None):
    if features is None:
        features = range(examples.observations.shape[1])
    return forest_of([fit(examples, features, n_splits)]).tree(0)


def examples_of(observations, actions, weights=None):
    observations = np.float32(observations)
    weights = np.ones(len(observations)) if weights is None else np.float64(weights)
    return Examples(observations, np.int64(actions), weights)


@st.composite
def some_examples(draw, n_actions=3):
    n, n_features = draw(st.integers(1, 30)), draw(st.integers(1, 3))
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    # Few values, so that many observations are equal in a feature.
    observed = rng.integers(-3, 4, (n, n_features)) / 2
    return examples_of(observed, rng.integers(0, n_actions, n), rng.choice([0.0, 0.5, 1.0, 4.0], n))


def impurity(actions, weights):
    """Weight times Gini impurity of each part, written down once more."""
    total = weights.sum()
    if total == 0:
        return 0.0
    return total * (1 - sum((weights[actions == action].sum() / total) ** 2 for action in set(actions)))


def best_by_trying(examples):
    """The least impurity that one split leaves, by trying all of them."""
    observed, actions, weights = examples.observations, examples.actions, examples.weights
    left = [impurity(actions, weights)]
    for feature in range(observed.shape[1]):
        for threshold in np.unique(observed[:, feature]):
            goes = observed[:, feature] < threshold
            left.append(impurity(actions[goes], weights[goes]) + impurity(actions[~goes], weights[~goes]))
    return min(left)


@given(some_examples())
def test_the_first_split_explains_as_much_as_any(examples):
    tree = fitted(examples, 1)
    parts = tree.leaf_of(examples.observations)
    remaining = sum(
        impurity(examples.actions[parts == part], examples.weights[parts == part])
        for part in range(tree.num_leaves)
    )
    assert remaining == pytest.approx(best_by_trying(examples), abs=1e-9)


@given(some_examples(), st.integers(0, 6))
def test_it_is_no_larger_than_asked_and_never_worse_for_a_split_more(examples, n_splits):
    tree, larger = fitted(examples, n_splits), fitted(examples, n_splits + 1)
    assert tree.num_decision_nodes <= n_splits
    # The larger tree splits a leaf of the smaller one.
    assert larger.num_decision_nodes - tree.num_decision_nodes in {0, 1}

    def wrong(tree):
        return examples.weights[tree.decide(examples.observations) != examples.actions].sum()

    assert wrong(larger) <= wrong(tree) + 1e-9


@given(trees(n_features=3, max_leaves=6), st.integers(0, 10**6))
def test_what_a_tree_says_is_learnt_where_every_state_says_something(tree, seed):
    observed = np.random.default_rng(seed).normal(size=(60, 3)).astype(np.float32)
    examples = examples_of(observed, tree.decide(observed))
    np.testing.assert_array_equal(fitted(examples, 59).decide(observed), tree.decide(observed))


def test_thresholds_lie_half_way_and_what_lies_below_goes_left():
    tree = fitted(examples_of([[0.0], [1.0], [2.0], [4.0]], [0, 0, 1, 1]), 5)
    assert (tree.num_decision_nodes, float(tree.threshold[0]), tree.action.tolist()) == (1, 1.5, [0, 1])


def test_between_neighbouring_floats_the_threshold_is_the_higher_one():
    low = np.float32(1.0)
    high = np.nextafter(low, np.float32(2.0))
    tree = fitted(examples_of([[low], [high]], [0, 1]), 1)
    assert tree.decide(np.float32([[low], [high]])).tolist() == [0, 1]


def test_only_the_given_features_are_tested():
    observed = np.random.default_rng(0).normal(size=(100, 3))
    tree = fitted(examples_of(observed, observed[:, 0] > 0), 5, features=[1, 2])
    assert 0 not in tree.feature.tolist()


def test_weights_decide_what_is_explained_first():
    observed = [[0, 0], [0, 1], [1, 0], [1, 1]]
    tree = fitted(examples_of(observed, [0, 1, 1, 0], [1, 1, 9, 0]), 1)
    assert tree.decide(np.float32(observed))[2] == 1
    assert tree.feature.tolist() == [0]


@pytest.mark.parametrize(
    "examples",
    [
        examples_of([[0.0], [1.0]], [2, 2]),
        examples_of([[1.0], [1.0]], [0, 2], [1, 3]),
        examples_of([[0.0], [1.0]], [0, 2], [0, 1]),
    ],
    ids=["one action", "one state", "weight of one action alone"],
)
def test_where_no_split_explains_anything_there_is_none(examples):
    assert fit(examples, [0], 4) == [2]


def test_it_is_quick_enough_for_many_states():
    rng = np.random.default_rng(0)
    observed = rng.normal(size=(16_000, 8)).astype(np.float32)
    nodes = fit(examples_of(observed, rng.integers(0, 4, 16_000)), range(8), 19)
    assert sum(isinstance(node, Split) for node in nodes) == 19
