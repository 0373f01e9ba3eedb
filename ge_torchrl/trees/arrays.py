"""The arrays of a tree and of many, and their order: splits and leaves depth first, left before right."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.trees.rows import gather

IntArray = NDArray[np.int32]
FloatArray = NDArray[np.float32]


class TreeArrays(NamedTuple):
    """The arrays of `DecisionTree`, which says what each of them means."""

    children_left: IntArray
    children_right: IntArray
    term_start: IntArray
    feature: IntArray
    weight: FloatArray
    threshold: FloatArray
    action: IntArray
    value: FloatArray
    leaf_term_start: IntArray
    leaf_feature: IntArray
    leaf_weight: FloatArray


class ForestArrays(NamedTuple):
    """The arrays of `P` trees end to end, in the form that compiled functions take.

    Tree `p` owns the splits `split_start[p]` to `split_start[p + 1]` and the leaves `leaf_start[p]` to
    `leaf_start[p + 1]`, numbered as in `DecisionTree`; children count from their own tree. The leaves of all trees hold
    actions, or those of all hold equally many values. All arrays are contiguous and writeable, since another memory
    layout would be another compilation of every kernel.

    Attributes:
        split_start: [P + 1] int64.
        leaf_start: [P + 1] int64; an individual without a tree owns no leaf. The last entry is L.
        term_start: [M + 1] int64, where the terms of each split begin among those of all trees.
        feature: [K] int32. Where all trees are axis-aligned, `feature[m]` belongs to split `m`.
        weight: [K] float32.
        threshold: [M] float32.
        children_left: [M] int32, of its own tree: at or above 0 a split, below 0 the leaf `~child`.
        children_right: [M] int32.
        action: [L] int32; [0] where leaves hold values.
        value: [L, A] float32; [L, 0] where leaves hold actions.
        leaf_term_start: [L + 1] int64, where the linear terms of each leaf begin among those of all trees.
        leaf_feature: [Q] int32.
        leaf_weight: [Q, A] float32.
    """

    split_start: NDArray[np.int64]
    leaf_start: NDArray[np.int64]
    term_start: NDArray[np.int64]
    feature: IntArray
    weight: FloatArray
    threshold: FloatArray
    children_left: IntArray
    children_right: IntArray
    action: IntArray
    value: FloatArray
    leaf_term_start: NDArray[np.int64]
    leaf_feature: IntArray
    leaf_weight: FloatArray


class LeafArrays(NamedTuple):
    """The arrays of `ForestArrays` that say what leaves answer."""

    action: IntArray
    value: FloatArray
    leaf_term_start: NDArray[np.int64]
    leaf_feature: IntArray
    leaf_weight: FloatArray

    @classmethod
    def of_actions(cls, action: IntArray) -> LeafArrays:
        """Return leaves that hold actions, [L] int32."""
        n_leaves = len(action)
        return cls(
            action=action,
            value=np.zeros((n_leaves, 0), np.float32),
            leaf_term_start=np.zeros(n_leaves + 1, np.int64),
            leaf_feature=np.zeros(0, np.int32),
            leaf_weight=np.zeros((0, 0), np.float32),
        )


def depth_first(children_left: IntArray, children_right: IntArray, root: int) -> tuple[list[int], list[int]]:
    """Return the splits and the leaves that a child reaches, each before its children, left before right."""
    left, right = children_left.tolist(), children_right.tolist()
    splits: list[int] = []
    leaves: list[int] = []
    open_nodes = [root]
    while open_nodes:
        node = open_nodes.pop()
        if node < 0:
            leaves.append(~node)
        else:
            splits.append(node)
            open_nodes += (right[node], left[node])
    return splits, leaves


def selected(arrays: TreeArrays, splits: Sequence[int], leaves: Sequence[int]) -> TreeArrays:
    """Return the arrays of these splits and leaves alone, numbered in this order.

    Args:
        arrays: A tree's arrays; `children_left` and `children_right` of the splits lead to what is selected.
        splits: Splits in depth-first order.
        leaves: Leaves likewise.
    """
    # One array holds the new number of every child: split `m` at `m`, leaf `~l` from behind.
    number = np.zeros(len(arrays.children_left) + len(arrays.value), np.int32)
    number[np.array(splits, np.int64)] = np.arange(len(splits), dtype=np.int32)
    number[~np.array(leaves, np.int64)] = ~np.arange(len(leaves), dtype=np.int32)
    kept_splits, kept_leaves = np.array(splits, np.int64), np.array(leaves, np.int64)
    term_start, terms = gather(arrays.term_start, kept_splits)
    leaf_term_start, leaf_terms = gather(arrays.leaf_term_start, kept_leaves)
    return TreeArrays(
        children_left=number[arrays.children_left[kept_splits]],
        children_right=number[arrays.children_right[kept_splits]],
        term_start=term_start.astype(np.int32),
        feature=arrays.feature[terms],
        weight=arrays.weight[terms],
        threshold=arrays.threshold[kept_splits],
        action=arrays.action[kept_leaves] if len(arrays.action) > 0 else arrays.action,
        value=arrays.value[kept_leaves],
        leaf_term_start=leaf_term_start.astype(np.int32),
        leaf_feature=arrays.leaf_feature[leaf_terms],
        leaf_weight=arrays.leaf_weight[leaf_terms],
    )


def without_values(
    children_left: IntArray,
    children_right: IntArray,
    feature: IntArray,
    threshold: FloatArray,
    action: IntArray,
) -> TreeArrays:
    """Return the arrays of a tree whose splits compare one feature each and whose leaves hold actions."""
    return TreeArrays(
        children_left=children_left,
        children_right=children_right,
        term_start=np.arange(len(feature) + 1, dtype=np.int32),
        feature=feature,
        weight=np.ones(len(feature), np.float32),
        threshold=threshold,
        action=action,
        value=np.zeros((len(action), 0), np.float32),
        leaf_term_start=np.zeros(len(action) + 1, np.int32),
        leaf_feature=np.zeros(0, np.int32),
        leaf_weight=np.zeros((0, 0), np.float32),
    )


def without_splits(value: FloatArray, leaf_feature: IntArray, leaf_weight: FloatArray) -> TreeArrays:
    """Return the arrays of a lone leaf with values [1, A] and linear terms [Q] with weights [Q, A]."""
    no_ints, no_floats = np.zeros(0, np.int32), np.zeros(0, np.float32)
    return TreeArrays(
        children_left=no_ints,
        children_right=no_ints,
        term_start=np.zeros(1, np.int32),
        feature=no_ints,
        weight=no_floats,
        threshold=no_floats,
        action=no_ints,
        value=value,
        leaf_term_start=np.array([0, len(leaf_feature)], np.int32),
        leaf_feature=leaf_feature,
        leaf_weight=leaf_weight,
    )


def depth_of(tree: TreeArrays) -> int:
    """Return the largest number of splits on a path from the root to a leaf."""
    above = [0] * len(tree.threshold)
    # From the first split to the last, parents come before their children.
    for split, children in enumerate(
        zip(tree.children_left.tolist(), tree.children_right.tolist(), strict=True)
    ):
        for child in children:
            if child >= 0:
                above[child] = above[split] + 1
    return max(above) + 1 if above else 0


def visits_of_splits(tree: TreeArrays, leaf_visits: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return how often each split is visited, [M], from the visits of leaves, [L]."""
    of_leaf, visits = leaf_visits.tolist(), [0] * len(tree.threshold)
    left, right = tree.children_left.tolist(), tree.children_right.tolist()
    # From the last split to the first, children come before their parents.
    for split in range(len(visits) - 1, -1, -1):
        visits[split] = sum(
            visits[child] if child >= 0 else of_leaf[~child] for child in (left[split], right[split])
        )
    return np.array(visits, np.int64)


def is_axis_aligned(arrays: TreeArrays) -> bool:
    """Tell whether every split asks for one feature of weight 1."""
    return len(arrays.feature) == len(arrays.threshold) and bool((arrays.weight == 1).all())


def structure_of(arrays: TreeArrays) -> bytes:
    """Return the bytes of all but the numbers; the arrays must be those of a tree, depth first.

    The left children alone fix the shape of a tree that is numbered depth first. A header makes the bytes of two
    different trees differ: what follows `a` has a length that only one number of splits gives.
    """
    if is_axis_aligned(arrays) and len(arrays.action) > 0:
        return b"".join(
            (b"a", arrays.children_left.tobytes(), arrays.feature.tobytes(), arrays.action.tobytes())
        )
    n_terms = np.diff(arrays.term_start)
    lengths = np.array(
        [len(arrays.threshold), len(arrays.feature), arrays.value.shape[1], len(arrays.leaf_feature)],
        np.int32,
    )
    # The weight of a split's only term is no parameter.
    lone_weights = arrays.weight[np.repeat(n_terms == 1, n_terms)]
    parts = (
        lengths,
        arrays.children_left,
        arrays.term_start,
        arrays.feature,
        lone_weights,
        arrays.action,
        arrays.leaf_term_start,
        arrays.leaf_feature,
    )
    return b"".join((b"g", *(part.tobytes() for part in parts)))


def joined(
    feature: IntArray, weight: FloatArray, threshold: FloatArray, left: TreeArrays, right: TreeArrays
) -> TreeArrays:
    """Return the arrays of the tree with a new root above two trees.

    Args:
        feature: [k] of the root's terms.
        weight: [k] of the root's terms.
        threshold: [1] of the root.
        left: The tree where the root's test is TRUE.
        right: The tree where it is FALSE.
    """
    split_shift = (1, 1 + len(left.threshold))
    leaf_shift = (0, len(left.value))

    def shifted(children: IntArray, side: int) -> IntArray:
        return np.where(children >= 0, children + split_shift[side], children - leaf_shift[side])

    def root_of(tree: TreeArrays) -> IntArray:
        return np.array([0 if len(tree.threshold) else ~0], np.int32)

    def start(first: IntArray, second: IntArray) -> IntArray:
        return np.concatenate([first, first[-1] + second[1:]])

    children = [
        np.concatenate(
            [shifted(root_of((left, right)[side]), side), shifted(of_left, 0), shifted(of_right, 1)],
            dtype=np.int32,
        )
        for side, of_left, of_right in (
            (0, left.children_left, right.children_left),
            (1, left.children_right, right.children_right),
        )
    ]
    root_start = np.array([0, len(feature)], np.int32)
    return TreeArrays(
        children_left=children[0],
        children_right=children[1],
        term_start=start(start(root_start, left.term_start), right.term_start),
        feature=np.concatenate([feature, left.feature, right.feature]),
        weight=np.concatenate([weight, left.weight, right.weight]),
        threshold=np.concatenate([threshold, left.threshold, right.threshold]),
        action=np.concatenate([left.action, right.action]),
        value=np.concatenate([left.value, right.value]),
        leaf_term_start=start(left.leaf_term_start, right.leaf_term_start),
        leaf_feature=np.concatenate([left.leaf_feature, right.leaf_feature]),
        leaf_weight=np.concatenate([left.leaf_weight, right.leaf_weight]),
    )
