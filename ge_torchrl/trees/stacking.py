"""The arrays of many trees, made from trees and from one another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.arrays import FloatArray, ForestArrays, LeafArrays, TreeArrays
from ge_torchrl.trees.parameters import has_free_weight
from ge_torchrl.trees.rows import gather, starts

_Number = TypeVar("_Number", bound=np.generic)


def stacked(trees: Sequence[TreeArrays]) -> ForestArrays:
    """Return trees end to end.

    Raises:
        InvalidTreeError: Their leaves are not of one kind.
    """
    n_values = _common_width([tree.value for tree in trees], "tree")
    # The empty arrays in front let no trees be stacked too.
    no_ints, no_floats = np.zeros(0, np.int32), np.zeros(0, np.float32)
    n_terms = [np.diff(tree.term_start) for tree in trees]
    action = np.concatenate([no_ints, *(tree.action for tree in trees)])
    if n_values == 0:
        leaves = LeafArrays.of_actions(action)
    else:
        no_values = np.zeros((0, n_values), np.float32)
        leaves = LeafArrays(
            action=action,
            value=np.concatenate([no_values, *(tree.value for tree in trees)]),
            leaf_term_start=starts(np.concatenate([np.diff(tree.leaf_term_start) for tree in trees])),
            leaf_feature=np.concatenate([no_ints, *(tree.leaf_feature for tree in trees)]),
            leaf_weight=np.concatenate([no_values, *(tree.leaf_weight for tree in trees)]),
        )
    return ForestArrays(
        starts([len(tree.threshold) for tree in trees]),
        starts([len(tree.value) for tree in trees]),
        starts(np.concatenate([no_ints, *n_terms])),
        np.concatenate([no_ints, *(tree.feature for tree in trees)]),
        np.concatenate([no_floats, *(tree.weight for tree in trees)]),
        np.concatenate([no_floats, *(tree.threshold for tree in trees)]),
        np.concatenate([no_ints, *(tree.children_left for tree in trees)]),
        np.concatenate([no_ints, *(tree.children_right for tree in trees)]),
        *leaves,
    )


def repeated(tree: TreeArrays, parameters: NDArray[np.float32]) -> ForestArrays:
    """Return copies of a tree with other numbers.

    Args:
        tree: A tree of N parameters.
        parameters: [R, N] float32, finite.
    """
    copies, n_splits, n_leaves = len(parameters), len(tree.threshold), len(tree.value)
    # As in a tree: adding zero makes -0.0 into 0.0.
    numbers = parameters.astype(np.float32) + np.float32(0.0)
    weight = _repeated(tree.weight, copies)
    n_values, first_value = tree.value.shape[1], numbers.shape[1] - tree.value.size - tree.leaf_weight.size
    if first_value > n_splits:
        weight[:, has_free_weight(tree)] = numbers[:, n_splits:first_value]
    action = _repeated(tree.action, copies).reshape(-1)
    if n_values == 0:
        leaves = LeafArrays.of_actions(action)
    else:
        first_leaf_weight = first_value + tree.value.size
        value, leaf_weight = numbers[:, first_value:first_leaf_weight], numbers[:, first_leaf_weight:]
        leaves = LeafArrays(
            action=action,
            value=np.ascontiguousarray(value).reshape(-1, n_values),
            leaf_term_start=_repeated_start(tree.leaf_term_start, copies),
            leaf_feature=_repeated(tree.leaf_feature, copies).reshape(-1),
            leaf_weight=np.ascontiguousarray(leaf_weight).reshape(-1, n_values),
        )
    return ForestArrays(
        np.arange(copies + 1) * n_splits,
        np.arange(copies + 1) * n_leaves,
        _repeated_start(tree.term_start, copies),
        _repeated(tree.feature, copies).reshape(-1),
        weight.reshape(-1),
        np.ascontiguousarray(numbers[:, :n_splits]).reshape(-1),
        _repeated(tree.children_left, copies).reshape(-1),
        _repeated(tree.children_right, copies).reshape(-1),
        *leaves,
    )


def joined_forests(forests: Sequence[ForestArrays]) -> ForestArrays:
    """Return the trees of at least one forest end to end.

    Raises:
        InvalidTreeError: Their leaves are not of one kind. A forest without leaves is of any.
    """
    n_values = _common_width([arrays.value for arrays in forests if len(arrays.value) > 0], "forest")
    n_values = n_values or max(arrays.value.shape[1] for arrays in forests)

    def joined_starts(name: str) -> NDArray[np.int64]:
        return starts(np.concatenate([np.diff(getattr(arrays, name)) for arrays in forests]))

    action = np.concatenate([arrays.action for arrays in forests])
    if n_values == 0:
        leaves = LeafArrays.of_actions(action)
    else:
        with_values = [arrays for arrays in forests if arrays.value.shape[1] == n_values]
        leaves = LeafArrays(
            action=action,
            value=np.concatenate([arrays.value for arrays in with_values]),
            leaf_term_start=joined_starts("leaf_term_start"),
            leaf_feature=np.concatenate([arrays.leaf_feature for arrays in forests]),
            leaf_weight=np.concatenate([arrays.leaf_weight for arrays in with_values]),
        )
    return ForestArrays(
        joined_starts("split_start"),
        joined_starts("leaf_start"),
        joined_starts("term_start"),
        np.concatenate([arrays.feature for arrays in forests]),
        np.concatenate([arrays.weight for arrays in forests]),
        np.concatenate([arrays.threshold for arrays in forests]),
        np.concatenate([arrays.children_left for arrays in forests]),
        np.concatenate([arrays.children_right for arrays in forests]),
        *leaves,
    )


def taken(arrays: ForestArrays, index: ArrayLike) -> ForestArrays:
    """Return some of the trees, [Q] their numbers, in the order asked for."""
    split_start, splits = gather(arrays.split_start, index)
    leaf_start, leaves = gather(arrays.leaf_start, index)
    if len(arrays.feature) > len(arrays.threshold):
        term_start, terms = gather(arrays.term_start, splits)
    else:
        term_start, terms = np.arange(len(splits) + 1), splits
    return ForestArrays(
        split_start,
        leaf_start,
        term_start,
        arrays.feature[terms],
        arrays.weight[terms],
        arrays.threshold[splits],
        arrays.children_left[splits],
        arrays.children_right[splits],
        *leaves_taken(arrays, leaves),
    )


def leaves_taken(arrays: ForestArrays, leaves: NDArray[np.int64]) -> LeafArrays:
    """Return what some leaves answer, [k] their rows, in the order asked for."""
    if arrays.value.shape[1] == 0:
        return LeafArrays.of_actions(arrays.action[leaves])
    leaf_term_start, terms = gather(arrays.leaf_term_start, leaves)
    return LeafArrays(
        action=arrays.action.copy(),
        value=arrays.value[leaves],
        leaf_term_start=leaf_term_start,
        leaf_feature=arrays.leaf_feature[terms],
        leaf_weight=arrays.leaf_weight[terms],
    )


def rows_of(arrays: ForestArrays, index: int) -> TreeArrays:
    """Return one tree, as views where that is possible; it has no leaf where the individual has no tree."""
    first, end = int(arrays.split_start[index]), int(arrays.split_start[index + 1])
    leaves = slice(int(arrays.leaf_start[index]), int(arrays.leaf_start[index + 1]))
    term_start = arrays.term_start[first : end + 1]
    leaf_term_start = arrays.leaf_term_start[leaves.start : leaves.stop + 1]
    terms = slice(term_start[0], term_start[-1])
    leaf_terms = slice(leaf_term_start[0], leaf_term_start[-1])
    return TreeArrays(
        children_left=arrays.children_left[first:end],
        children_right=arrays.children_right[first:end],
        term_start=(term_start - term_start[0]).astype(np.int32),
        feature=arrays.feature[terms],
        weight=arrays.weight[terms],
        threshold=arrays.threshold[first:end],
        action=arrays.action[leaves],
        value=arrays.value[leaves],
        leaf_term_start=(leaf_term_start - leaf_term_start[0]).astype(np.int32),
        leaf_feature=arrays.leaf_feature[leaf_terms],
        leaf_weight=arrays.leaf_weight[leaf_terms],
    )


def _common_width(values: Sequence[FloatArray], owner: str) -> int:
    """Return how many values the leaves of all owners hold, 0 for actions."""
    widths = [value.shape[1] for value in values]
    for place, width in enumerate(widths):
        if width != widths[0]:
            first, other = (f"{n} values each" if n > 0 else "actions" for n in (widths[0], width))
            raise InvalidTreeError(
                f"the trees of a forest are of one kind: their leaves hold actions, or equally many values. Those of "
                f"{owner} 0 hold {first}, those of {owner} {place} hold {other}"
            )
    return widths[0] if widths else 0


def _repeated(array: NDArray[_Number], copies: int) -> NDArray[_Number]:
    """Return [copies, n]; unlike `np.tile`, never a view of what is read-only."""
    return np.repeat(array[np.newaxis], copies, axis=0)


def _repeated_start(start: NDArray[np.int32], copies: int) -> NDArray[np.int64]:
    """Return where items begin in copies end to end, where they begin in one as `start` says."""
    n_rows = int(start[-1])
    return np.append((np.arange(copies)[:, np.newaxis] * n_rows + start[:-1]).reshape(-1), copies * n_rows)
