"""Where the mapping writes trees of any kind, and the forest that comes of it."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.ge.rule_tables import Room, RuleTables
from ge_torchrl.trees.arrays import ForestArrays, LeafArrays
from ge_torchrl.trees.forest import Forest

# Room for that many splits of each individual to begin with, and as many terms; the buffer grows where it must.
_LIKELY_SPLITS: Final = 16


class Buffer(NamedTuple):
    """Where the trees of a population are written, as in `ForestArrays`.

    Nobody reads the last column of `children`, nor the last threshold.
    """

    feature: NDArray[np.int32]
    threshold: NDArray[np.float32]
    children: NDArray[np.int32]
    action: NDArray[np.int32]


class Sums(NamedTuple):
    """Where weights and values are written, as in `ForestArrays`, and [D] the order of features in shared sums."""

    term_start: NDArray[np.int64]
    weight: NDArray[np.float32]
    value: NDArray[np.float32]
    leaf_term_start: NDArray[np.int64]
    leaf_feature: NDArray[np.int32]
    leaf_weight: NDArray[np.float32]
    rank: NDArray[np.int32]


def room_for(n_individuals: int, largest: Room, tables: RuleTables) -> tuple[Buffer, Sums | None]:
    """Return empty buffers.

    Args:
        n_individuals: How many trees are written.
        largest: The largest tree that the grammar derives.
        tables: The compiled grammar.

    Returns:
        The buffer, and that of sums, None where the grammar has none.
    """
    n_splits, n_terms = (n_individuals * _LIKELY_SPLITS + room for room in largest)
    n_leaves = n_splits + n_individuals  # A tree of `m` splits has `m + 1` leaves.
    buffer = Buffer(
        feature=np.empty(n_terms, np.int32),
        threshold=np.empty(n_splits + 1, np.float32),
        children=np.empty((2, n_splits + 1), np.int32),
        action=np.empty(n_leaves, np.int32),
    )
    if not tables.has_terms:
        return buffer, None
    n_values = tables.grammar.n_values
    return buffer, Sums(
        term_start=np.empty(n_splits + 1, np.int64),
        weight=np.empty(n_terms, np.float32),
        value=np.empty((n_leaves, n_values), np.float32),
        leaf_term_start=np.empty(n_leaves, np.int64),
        leaf_feature=np.empty(n_terms, np.int32),
        leaf_weight=np.empty((n_terms, n_values), np.float32),
        rank=tables.feature_rank,
    )


def enlarged(buffer: Buffer, sums: Sums | None) -> tuple[Buffer, Sums | None]:
    """Return buffers with twice the room, in which stands what was written."""
    larger = Buffer(*(np.concatenate([old, np.empty_like(old)], axis=-1) for old in buffer))
    if sums is None:
        return larger, None
    doubled = {
        name: np.concatenate([old, np.empty_like(old)])
        for name, old in sums._asdict().items()
        if name != "rank"
    }
    return larger, sums._replace(**doubled)


def forest_of_buffer(buffer: Buffer, sums: Sums | None, starts: NDArray[np.int64]) -> Forest:
    """Return the forest of what was written.

    Args:
        buffer: The trees, one after the other.
        sums: Their weights and values.
        starts: [4, P + 1] where each tree's splits, leaves, terms and terms of leaves begin.
    """
    n_splits, n_leaves, n_terms, n_leaf_terms = starts[:, -1].tolist()
    splits = {
        "split_start": starts[0].copy(),
        "leaf_start": starts[1].copy(),
        "feature": buffer.feature[:n_terms].copy(),
        "threshold": buffer.threshold[:n_splits].copy(),
        "children_left": buffer.children[0, :n_splits].copy(),
        "children_right": buffer.children[1, :n_splits].copy(),
    }
    action = buffer.action[:n_leaves].copy()
    if sums is None:
        return Forest.axis_aligned(**splits, action=action)
    leaves = LeafArrays.of_actions(action)
    if sums.value.shape[1] > 0:
        leaves = LeafArrays(
            action=np.zeros(0, np.int32),
            value=sums.value[:n_leaves].copy(),
            leaf_term_start=np.append(sums.leaf_term_start[:n_leaves], n_leaf_terms),
            leaf_feature=sums.leaf_feature[:n_leaf_terms].copy(),
            leaf_weight=sums.leaf_weight[:n_leaf_terms].copy(),
        )
    return Forest(
        ForestArrays(
            **splits,
            term_start=np.append(sums.term_start[:n_splits], n_terms),
            weight=sums.weight[:n_terms].copy(),
            **leaves._asdict(),
        )
    )
