"""Where the mapping writes trees of any kind, and the forest that comes of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.trees.arrays import ForestArrays, LeafArrays
from ge_torchrl.trees.forest import Forest


def forest_of_buffer(buffer: Buffer, starts: NDArray[np.int64]) -> Forest:
    """Return the forest of what was written.

    Args:
        buffer: The trees, one after the other.
        starts: [4, P + 1] where each tree's splits, leaves, terms and terms of leaves begin.
    """
    n_splits, n_leaves, n_terms, n_leaf_terms = starts[:, -1].tolist()
    if buffer.value.shape[1] == 0:
        leaves = LeafArrays.of_actions(buffer.action[:n_leaves].copy())
    else:
        leaves = LeafArrays(
            action=np.zeros(0, np.int32),
            value=buffer.value[:n_leaves].copy(),
            leaf_term_start=np.append(buffer.leaf_term_start[:n_leaves], n_leaf_terms),
            leaf_feature=buffer.leaf_feature[:n_leaf_terms].copy(),
            leaf_weight=buffer.leaf_weight[:n_leaf_terms].copy(),
        )
    return Forest(
        ForestArrays(
            starts[0].copy(),
            starts[1].copy(),
            np.append(buffer.term_start[:n_splits], n_terms),
            buffer.feature[:n_terms].copy(),
            buffer.weight[:n_terms].copy(),
            buffer.threshold[:n_splits].copy(),
            buffer.children[0, :n_splits].copy(),
            buffer.children[1, :n_splits].copy(),
            *leaves,
        )
    )


class Buffer(NamedTuple):
    """Where the trees of a population are written, as in `ForestArrays`.

    Nobody reads the last column of `children`, nor the last threshold.
    """

    term_start: NDArray[np.int64]
    feature: NDArray[np.int32]
    weight: NDArray[np.float32]
    threshold: NDArray[np.float32]
    children: NDArray[np.int32]
    action: NDArray[np.int32]
    value: NDArray[np.float32]
    leaf_term_start: NDArray[np.int64]
    leaf_feature: NDArray[np.int32]
    leaf_weight: NDArray[np.float32]


def room_for(n_splits: int, n_terms: int, n_individuals: int, n_values: int) -> Buffer:
    """Return an empty buffer for so many splits and terms, and the leaves of so many trees."""
    n_leaves = n_splits + n_individuals  # A tree of `m` splits has `m + 1` leaves.
    return Buffer(
        term_start=np.empty(n_splits, np.int64),
        feature=np.empty(n_terms, np.int32),
        weight=np.empty(n_terms, np.float32),
        threshold=np.empty(n_splits + 1, np.float32),
        children=np.empty((2, n_splits + 1), np.int32),
        action=np.empty(n_leaves, np.int32),
        value=np.empty((n_leaves, n_values), np.float32),
        leaf_term_start=np.empty(n_leaves, np.int64),
        leaf_feature=np.empty(n_terms if n_values > 0 else 0, np.int32),
        leaf_weight=np.empty((n_terms if n_values > 0 else 0, n_values), np.float32),
    )


def enlarged(buffer: Buffer, n_individuals: int) -> Buffer:
    """Return a buffer with twice the room, in which stands what was written."""
    larger = room_for(
        2 * len(buffer.term_start), 2 * len(buffer.feature), n_individuals, buffer.value.shape[1]
    )
    for name, old in buffer._asdict().items():
        getattr(larger, name)[tuple(slice(length) for length in old.shape)] = old
    return larger
