"""Draws from one soft tree in compiled code: a leaf, then an action or values.

A soft tree is a mixture: the leaf is drawn by the path weights, the action by the leaf's probabilities, or its values
from normal distributions. Going down at random, left with the weight of the left branch, draws from exactly that
mixture at the cost of a single path.
"""

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import inlined
from ge_torchrl.environments.backend import SoftForest
from ge_torchrl.environments.kernels.draws import draw_normal, draw_uniform
from ge_torchrl.environments.kernels.lanes import LANES, OBSERVATION


@inlined
def draw_leaf(
    soft: SoftForest, tree: int, rows: NDArray[np.float64], lane: int, generator: NDArray[np.uint64]
) -> int:
    """Draw a path from the root."""
    node = 0 if soft.feature.shape[1] > 0 else -1
    while node >= 0:
        left, right = int(soft.children_left[tree, node]), int(soft.children_right[tree, node])
        if left == right:
            # A row of padding stands where a tree has no split: nothing is drawn, as if it were not there.
            node = left
            continue
        observed = soft.weight[tree, node, 0] * rows[OBSERVATION + soft.feature[tree, node, 0] * LANES + lane]
        for term in range(1, soft.feature.shape[2]):
            place = OBSERVATION + soft.feature[tree, node, term] * LANES + lane
            observed += soft.weight[tree, node, term] * rows[place]
        # Exactly at the threshold of an infinitely steep split the weight is no number, and no draw is below it.
        distance = np.float64(soft.threshold[tree, node]) - observed
        weight = 1.0 / (1.0 + np.exp(-soft.alpha[tree, node] * distance))
        node = left if draw_uniform(generator) < weight else right
    return ~node


@inlined
def draw_action(soft: SoftForest, tree: int, leaf: int, generator: NDArray[np.uint64]) -> int:
    """Draw an action from a leaf."""
    action, left_over = 0, draw_uniform(generator) - soft.probabilities[tree, leaf, 0]
    # What rounding leaves of a sum of one falls to the last action.
    while left_over >= 0.0 and action < soft.probabilities.shape[2] - 1:
        action += 1
        left_over -= soft.probabilities[tree, leaf, action]
    return action


@inlined
def draw_value(
    soft: SoftForest,
    tree: int,
    leaf: int,
    entry: int,
    rows: NDArray[np.float64],
    lane: int,
    generator: NDArray[np.uint64],
) -> float:
    """Draw an entry of an action from a leaf, around its sum in float64 in the order constant, features."""
    total = soft.mean[tree, leaf, entry]
    for feature in range(soft.leaf_weight.shape[2]):
        weight = soft.leaf_weight[tree, leaf, feature, entry]
        total += weight * rows[OBSERVATION + feature * LANES + lane]
    return float(total + soft.sd[tree, leaf, entry] * draw_normal(generator))
