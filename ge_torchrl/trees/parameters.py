"""All numbers of a tree as one vector, and a natural step of each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.trees.arrays import FloatArray, TreeArrays


def has_free_weight(tree: TreeArrays) -> NDArray[np.bool_]:
    """Tell which terms of splits have a weight that is a parameter, [K].

    A lone term's weight is none: another one would only scale its threshold.
    """
    n_terms = np.diff(tree.term_start)
    return np.repeat(n_terms > 1, n_terms)


def parameters_of(tree: TreeArrays) -> FloatArray:
    """Return all numbers of a tree, [N], in the order that `DecisionTree.parameters` tells."""
    if tree.value.size == 0 and len(tree.feature) == len(tree.threshold):
        return tree.threshold
    free = tree.weight[has_free_weight(tree)]
    return np.concatenate([tree.threshold, free, tree.value.reshape(-1), tree.leaf_weight.reshape(-1)])


def with_parameters(tree: TreeArrays, numbers: FloatArray) -> TreeArrays:
    """Return the arrays of a tree with other numbers, [N]."""
    if tree.value.size == 0 and len(tree.feature) == len(tree.threshold):
        return tree._replace(threshold=numbers)
    free, weight = has_free_weight(tree), tree.weight.copy()
    ends = np.cumsum([len(tree.threshold), int(free.sum()), tree.value.size])
    threshold, weight[free], value, leaf_weight = np.split(numbers, ends)
    return tree._replace(
        threshold=threshold,
        weight=weight,
        value=value.reshape(tree.value.shape),
        leaf_weight=leaf_weight.reshape(tree.leaf_weight.shape),
    )


def units_of(
    tree: TreeArrays, spread: NDArray[np.float64], action_spread: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Return a natural step of each number of a tree, [N]; see `DecisionTree.parameter_units`."""
    of_term = spread[tree.feature]
    if len(of_term) == 0:
        of_sum = of_term
    else:
        squares = np.square(tree.weight * of_term)
        of_sum = np.sqrt(np.add.reduceat(squares, tree.term_start[:-1]))
        # Where all weights are 0, the first feature is as good as any.
        of_sum = np.where(of_sum > 0, of_sum, of_term[tree.term_start[:-1]])
    of_weight = np.repeat(of_sum, np.diff(tree.term_start)) / of_term
    of_value = np.ones(tree.value.shape[1]) if action_spread is None else action_spread
    of_values = np.broadcast_to(of_value, tree.value.shape).reshape(-1)
    of_leaf_weight = (of_value / spread[tree.leaf_feature][:, np.newaxis]).reshape(-1)
    return np.concatenate([of_sum, of_weight[has_free_weight(tree)], of_values, of_leaf_weight])
