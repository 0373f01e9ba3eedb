import numpy as np
import pytest
from controllers_for_tests import random_controllers
from hypothesis import given, settings
from strategies import any_trees, observed_trees
from trees_of_all_kinds import PUBLISHED

from ge_torchrl.exports.observations import N_OBSERVATIONS, observations_of
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split


@settings(max_examples=50)
@given(any_trees())
def test_they_are_finite_and_the_same_each_time(tree):
    observed = observations_of(tree, 4, 200)
    assert observed.shape == (200, 4)
    assert observed.dtype == np.float32
    assert np.isfinite(observed).all()
    assert np.array_equal(observed, observations_of(tree, 4, 200))


def told_apart(tree):
    """Yield trees one of whose thresholds is the float32 beside, where any observation tells them from the tree.

    One of these is the tree with `<=` in place of `<`.
    """
    open_nodes = [(0 if tree.num_decision_nodes else ~0, {})]
    while open_nodes:
        node, intervals = open_nodes.pop()
        if node < 0:
            continue
        feature, threshold = int(tree.feature[node]), tree.threshold[node]
        low, high = intervals.get(feature, (-np.inf, np.inf))
        before, after = (np.nextafter(threshold, np.float32(end)) for end in (-np.inf, np.inf))
        for other, between in ((before, before), (after, threshold)):
            if low <= between < high:
                numbers = tree.parameters.copy()
                numbers[node] = other
                yield tree.with_parameters(numbers)
        if low < threshold:
            open_nodes.append(
                (int(tree.children_left[node]), {**intervals, feature: (low, min(high, threshold))})
            )
        if threshold < high:
            open_nodes.append(
                (int(tree.children_right[node]), {**intervals, feature: (max(low, threshold), high)})
            )


@pytest.mark.parametrize("environment_id", PUBLISHED)
def test_no_threshold_can_be_off_by_one_float32(environment_id):
    for tree in (PUBLISHED[environment_id][0], *observed_trees(environment_id, 10, seed=4)):
        observed = observations_of(tree, 6)
        leaves = tree.leaf_of(observed)
        for other in told_apart(tree):
            assert (other.leaf_of(observed) != leaves).any()


def test_no_weight_can_be_off_by_a_millionth():
    hit = total = 0
    for controller in random_controllers(20, seed=5, kinds=(("oblique", "action"),)):
        tree = controller.tree
        observed = observations_of(tree, len(controller.names.features))
        leaves = tree.leaf_of(observed)
        for place in range(tree.num_decision_nodes, len(tree.parameters)):
            numbers = tree.parameters.copy()
            numbers[place] *= np.float32(0.999999)
            hit += not np.array_equal(tree.with_parameters(numbers).leaf_of(observed), leaves)
            total += 1
    # Some splits stand where no observation comes, and some terms are too small to matter.
    assert hit > 0.5 * total


def test_a_quarter_lies_on_thresholds_or_one_float32_beside():
    tree, _ = PUBLISHED["CartPole-v1"]
    observed = observations_of(tree, 4)
    assert len(observed) == N_OBSERVATIONS
    at = tree.threshold
    beside = np.stack([at, np.nextafter(at, np.float32(-1)), np.nextafter(at, np.float32(1))])
    is_near = (observed[:, tree.feature][:, np.newaxis] == beside).any(axis=(1, 2))
    assert is_near[: N_OBSERVATIONS // 4].all()
    for place in range(tree.num_decision_nodes):
        for value in beside[:, place]:
            assert (observed[:, tree.feature[place]] == value).sum() > 100


def test_a_lone_leaf_has_no_thresholds():
    assert observations_of(leaf(0), 3, 50).shape == (50, 3)


def test_a_split_whose_weights_are_nothing_is_passed_by():
    tree = DecisionTree.weighted_split(
        [0, 1, 1], [0.0, 1.0, -1.0], 0.5, split(1, 2.0, leaf(0), leaf(1)), leaf(2)
    )
    observed = observations_of(tree, 2)
    assert set(tree.leaf_of(observed).tolist()) == {0, 1}
