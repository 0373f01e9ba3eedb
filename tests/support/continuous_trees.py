"""Trees with values for the environments whose action is a force, of every kind that is decided in a way of its own."""

import numpy as np

from ge_torchrl.environments.kernels.rollouts import SELECT_MAX_SUMMED
from ge_torchrl.trees.tree import DecisionTree

CONTINUOUS = ("Pendulum-v1", "MountainCarContinuous-v0")
# Where observations lie, and how far they spread: random splits among them make trees that act.
_VISITED = {
    "Pendulum-v1": ([0.0, 0.0, 0.0], [0.7, 0.7, 4.0]),
    "MountainCarContinuous-v0": ([-0.5, 0.0], [0.3, 0.03]),
}


def values_of(spec, tree, observations):
    """The actions [T, A] float32 that an environment is given for observations."""
    return np.clip(tree.decide(observations), spec.action_low, spec.action_high)


def force_trees(environment_id, n, seed, depth=3, linear=0.7, oblique=0.5):
    """Random trees of one value a leaf, whose leaves and splits are weighted sums as often as is said."""
    middle, spread = _VISITED[environment_id]
    rng = np.random.default_rng([seed, 2])

    def leaf():
        slopes = {}
        if rng.random() < linear:
            features = rng.permutation(len(spread))[: rng.integers(1, len(spread) + 1)]
            slopes = {int(f): [float(rng.normal() / spread[f])] for f in features}
        constant = rng.normal() - sum(slope[0] * middle[f] for f, slope in slopes.items())
        return DecisionTree.value_leaf([float(constant)], slopes)

    def grow(depth):
        if depth == 0 or rng.random() < 0.2:
            return leaf()
        n_terms = int(rng.integers(2, 5)) if rng.random() < oblique else 1
        features = [int(f) for f in rng.integers(len(spread), size=n_terms)]
        weights = [float(rng.normal() / spread[f]) for f in features] if n_terms > 1 else [1.0]
        center = sum(weight * middle[f] for f, weight in zip(features, weights, strict=True))
        threshold = center + rng.normal() * (1.0 if n_terms > 1 else 0.5 * spread[features[0]])
        return DecisionTree.weighted_split(features, weights, threshold, grow(depth - 1), grow(depth - 1))

    return [grow(depth) for _ in range(n)]


def all_force_kinds(environment_id, seed=3):
    """Trees of every way to decide: few and many sums, constants alone, lone leaves."""
    large = DecisionTree.split(0, 0.1, *force_trees(environment_id, 2, seed + 1, depth=7))
    assert large.num_decision_nodes + len(large.feature) + len(large.leaf_feature) > SELECT_MAX_SUMMED
    return [
        *force_trees(environment_id, 4, seed),
        large,
        *force_trees(environment_id, 2, seed, linear=0.0, oblique=0.0),
        DecisionTree.value_leaf([0.5]),
        DecisionTree.value_leaf([-0.1], {1: [20.0]}),
    ]
