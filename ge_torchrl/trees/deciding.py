"""The answers of trees to observations: of one tree in NumPy, of many in a compiled loop."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import compiled, inlined
from ge_torchrl.trees.arrays import FloatArray, ForestArrays, IntArray, TreeArrays, is_axis_aligned


def leaves_of(tree: TreeArrays, depth: int, observed: FloatArray) -> IntArray:
    """Return the leaf that every observation ends in.

    Args:
        tree: A tree's arrays.
        depth: Its depth.
        observed: [B, D] float32.

    Returns:
        [B] int32, numbers of leaves.
    """
    axis_aligned = is_axis_aligned(tree)
    rows = np.arange(len(observed))
    node = np.full(len(observed), 0 if depth > 0 else ~0, np.int32)
    for _ in range(depth):
        # A leaf keeps its observation; what split 0 says of it is not used.
        split = np.maximum(node, 0)
        compared = observed[rows, tree.feature[split]] if axis_aligned else _sums(tree, observed, rows, split)
        child = np.where(
            compared < tree.threshold[split], tree.children_left[split], tree.children_right[split]
        )
        node = np.where(node < 0, node, child)
    return ~node


def _sums(
    tree: TreeArrays, observed: FloatArray, rows: NDArray[np.int64], split: IntArray
) -> NDArray[np.float64]:
    """Return the sum of each row at its split, [B], in float64 and in the order of the terms."""
    sums = np.zeros(len(rows))
    first, end = tree.term_start[split], tree.term_start[split + 1]
    with np.errstate(over="ignore", invalid="ignore"):
        for place in range(int((end - first).max(initial=0))):
            has_term = first + place < end
            term = np.where(has_term, first + place, 0)
            product = tree.weight[term] * observed[rows, tree.feature[term]].astype(np.float64)
            sums += np.where(has_term, product, 0.0)
    return sums


def answers(tree: TreeArrays, leaf: IntArray, observed: FloatArray) -> NDArray[Any]:
    """Return what leaves answer to observations.

    Args:
        tree: A tree's arrays.
        leaf: [B] the leaf of each observation.
        observed: [B, D] float32.

    Returns:
        [B] int32, actions, or [B, A] float32, values; a value is summed in float64 in the order of its terms.
    """
    if len(tree.action) > 0:
        return tree.action[leaf]
    first, n_terms = tree.leaf_term_start[leaf], np.diff(tree.leaf_term_start)[leaf]
    values = tree.value[leaf].astype(np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        for place in range(int(n_terms.max(initial=0))):
            rows = np.flatnonzero(n_terms > place)
            term = first[rows] + place
            features = observed[rows, tree.leaf_feature[term]].astype(np.float64)
            values[rows] += tree.leaf_weight[term] * features[:, np.newaxis]
        return values.astype(np.float32)


@compiled
def decide_axis_aligned(
    forest: ForestArrays, tree_index: NDArray[np.int64], observations: FloatArray, actions: IntArray
) -> None:
    """Write the action of each observation, every one decided by its own tree of a forest: one feature a split."""
    for b in range(len(tree_index)):
        p = tree_index[b]
        first, leaf = forest.split_start[p], forest.leaf_start[p]
        node = 0 if forest.split_start[p + 1] > first else -1
        while node >= 0:
            m = first + node
            is_left = observations[b, forest.feature[m]] < forest.threshold[m]
            node = forest.children_left[m] if is_left else forest.children_right[m]
        actions[b] = forest.action[leaf + ~node]


@compiled
def decide_weighted(
    forest: ForestArrays, tree_index: NDArray[np.int64], observations: FloatArray, actions: IntArray
) -> None:
    """Write the action of each observation, every one decided by its own tree of a forest: sums in term order."""
    for b in range(len(tree_index)):
        actions[b] = forest.action[_leaf_by_sums(forest, tree_index[b], observations, b)]


@compiled
def answer_values(
    forest: ForestArrays, tree_index: NDArray[np.int64], observations: FloatArray, values: FloatArray
) -> None:
    """Write the values for each observation, [B, A], every one decided by its own tree: sums in term order."""
    for b in range(len(tree_index)):
        leaf = _leaf_by_sums(forest, tree_index[b], observations, b)
        for column in range(values.shape[1]):
            total = np.float64(forest.value[leaf, column])
            for q in range(forest.leaf_term_start[leaf], forest.leaf_term_start[leaf + 1]):
                observed = np.float64(observations[b, forest.leaf_feature[q]])
                total += np.float64(forest.leaf_weight[q, column]) * observed
            values[b, column] = np.float32(total)


@inlined
def _leaf_by_sums(forest: ForestArrays, p: int, observations: FloatArray, b: int) -> int:
    """Return the row among all leaves where tree `p` ends with observation `b`."""
    first = forest.split_start[p]
    node = 0 if forest.split_start[p + 1] > first else -1
    while node >= 0:
        m = first + node
        total = 0.0
        for k in range(forest.term_start[m], forest.term_start[m + 1]):
            total += np.float64(forest.weight[k]) * np.float64(observations[b, forest.feature[k]])
        node = forest.children_left[m] if total < forest.threshold[m] else forest.children_right[m]
    return int(forest.leaf_start[p] + ~node)
