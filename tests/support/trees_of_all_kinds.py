"""Trees for backends: published ones, and every kind that is decided in a way of its own."""

import numpy as np
from continuous_trees import CONTINUOUS, all_force_kinds
from strategies import observed_trees

from ge_torchrl.environments.kernels.rollouts import SELECT_MAX_SPLITS
from ge_torchrl.environments.spec import describe
from ge_torchrl.trees.tree import DecisionTree

leaf, split = DecisionTree.leaf, DecisionTree.split
DISCRETE = ("CartPole-v1", "Acrobot-v1", "MountainCar-v0")
PUBLISHED = {
    "CartPole-v1": (split(2, 0.0154, split(3, 0.2290, leaf(0), leaf(1)), leaf(1)), 499.968),
    "Acrobot-v1": (
        split(5, -14.2778, leaf(0), split(4, -2.9144, leaf(1), split(5, 0.3094, leaf(0), leaf(2)))),
        -113.992,
    ),
    "MountainCar-v0": (
        split(
            1,
            -0.0005,
            split(0, -1.0361, leaf(2), leaf(0)),
            split(1, 0.0063, split(0, -0.3981, leaf(2), leaf(0)), leaf(2)),
        ),
        -107.93,
    ),
}


def oblique_trees(environment_id, n, seed):
    """Trees as `observed_trees` grows them, most of whose splits are weighted sums that say the same or nearly so."""
    rng = np.random.default_rng([seed, 1])
    n_features = describe(environment_id).n_features

    def oblique(tree, node):
        if node < 0:
            return leaf(int(tree.action[~node]))
        halves = (oblique(tree, int(side[node])) for side in (tree.children_left, tree.children_right))
        feature, threshold = int(tree.feature[node]), float(tree.threshold[node])
        if rng.random() < 0.3:
            return split(feature, threshold, *halves)
        weights = [float(rng.choice([-1.5, 0.5, 1.0, 2.0])), float(rng.normal() * 0.1)]
        terms = [feature, int(rng.integers(n_features))]
        return DecisionTree.weighted_split(terms, weights, threshold * weights[0], *halves)

    return [
        oblique(tree, 0 if tree.num_decision_nodes else ~0)
        for tree in observed_trees(environment_id, n, seed)
    ]


def large_tree(environment_id, seed=0):
    """A tree of more splits than are evaluated bottom-up."""
    parts = observed_trees(environment_id, 60, seed)
    while len(parts) > 1:
        thresholds = np.random.default_rng(seed).normal(size=len(parts)) * 0.05
        pairs = zip(parts[::2], parts[1::2], thresholds, strict=False)
        parts = [split(1, float(threshold), left, right) for left, right, threshold in pairs]
    assert parts[0].num_decision_nodes > SELECT_MAX_SPLITS
    return parts[0]


def all_kinds(environment_id, seed=3):
    """Trees of every way to decide, an oblique one in front of axis-aligned ones and behind them."""
    if environment_id in CONTINUOUS:
        return all_force_kinds(environment_id, seed)
    oblique = oblique_trees(environment_id, 4, seed)
    return [
        *oblique[:2],
        *observed_trees(environment_id, 5, seed),
        large_tree(environment_id),
        leaf(0),
        *oblique[2:],
    ]
