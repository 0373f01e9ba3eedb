"""Fitting a tree to examples: of all tests of one feature the one that explains most, again and again.

Source: L. Breiman, J. Friedman, R. Olshen and C. Stone, "Classification and regression trees" (1984); here the leaf
whose split explains most is split first, so that a small tree is the best part of a large one.
"""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.trees.arrays import FloatArray
from ge_torchrl.trees.nodes import Nodes, Split

# What rounding alone explains is nothing.
_LEAST: Final = 1e-9


@dataclass(frozen=True, eq=False)
class Examples:
    """Observations, and what was done there.

    Attributes:
        observations: [T, D] float32.
        actions: [T] int64, the action of each.
        weights: [T] float64, what it costs to answer each wrongly; not negative.
    """

    observations: FloatArray
    actions: NDArray[np.int64]
    weights: NDArray[np.float64]

    def take(self, rows: NDArray[np.int64]) -> Examples:
        """Return some of the examples, by row."""
        return Examples(self.observations[rows], self.actions[rows], self.weights[rows])


@dataclass(frozen=True, eq=False)
class _Part:
    """The examples that come to a leaf, and the split that would explain most of them."""

    rows: NDArray[np.int64]
    split: Split
    explained: float


def fit(examples: Examples, features: Sequence[int], n_splits: int) -> Nodes:
    """Return the tree of at most so many splits that explains examples best, split by split.

    A split explains what it takes away of the weighted Gini impurity `w (1 - sum_a p_a^2)`, where `w` is the weight of
    the examples that come there and `p_a` the part of it with action `a`. Thresholds lie half-way between two
    observations. A leaf answers the action with the largest weight there.

    Args:
        examples: One or more.
        features: Which may be tested.
        n_splits: Splits at most; there are fewer where no further one explains anything.
    """
    wanted = np.eye(int(examples.actions.max()) + 1)[examples.actions] * examples.weights[:, np.newaxis]
    parts = {0: _part(examples, wanted, features, np.arange(len(examples.actions)))}
    children: dict[int, tuple[int, int]] = {}
    open_leaves = [(-parts[0].explained, 0)]
    for _ in range(n_splits):
        explained, leaf = heapq.heappop(open_leaves)
        if -explained <= _LEAST * float(examples.weights.sum()):
            break
        part = parts[leaf]
        goes_left = examples.observations[part.rows, part.split.feature[0]] < part.split.threshold
        children[leaf] = len(parts), len(parts) + 1
        for child, rows in zip(children[leaf], (part.rows[goes_left], part.rows[~goes_left]), strict=True):
            parts[child] = _part(examples, wanted, features, rows)
            heapq.heappush(open_leaves, (-parts[child].explained, child))
    nodes: Nodes = []
    todo = [0]
    while todo:
        node = todo.pop()
        if node in children:
            nodes.append(parts[node].split)
            todo += reversed(children[node])
        else:
            nodes.append(int(np.argmax(wanted[parts[node].rows].sum(axis=0))))
    return nodes


def _part(
    examples: Examples, wanted: NDArray[np.float64], features: Sequence[int], rows: NDArray[np.int64]
) -> _Part:
    best = _Part(rows, Split((0,), (1.0,), 0.0), 0.0)
    weights, wanted = examples.weights[rows], wanted[rows]
    total, each = float(weights.sum()), wanted.sum(axis=0)
    if total <= 0 or each.max() >= total:
        return best
    for feature in features:
        observed = examples.observations[rows, feature]
        order = np.argsort(observed, kind="stable")
        ordered = observed[order]
        # Between which two neighbours in this order there is room for a threshold.
        places = np.flatnonzero(ordered[1:] > ordered[:-1])
        if len(places) == 0:
            continue
        left = np.cumsum(wanted[order], axis=0)[places]
        left_total = np.cumsum(weights[order])[places]
        explained = _purity(left, left_total) + _purity(each - left, total - left_total)
        one = int(np.argmax(explained))
        gained = float(explained[one]) - float(np.square(each).sum()) / total
        if gained > best.explained:
            low, high = ordered[places[one]], ordered[places[one] + 1]
            best = _Part(rows, Split((feature,), (1.0,), _between(low, high)), gained)
    return best


def _purity(wanted: NDArray[np.float64], total: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return `sum_a w_a^2 / w`, the weight less the impurity, of each row; 0 where there is no weight."""
    squares: NDArray[np.float64] = np.square(wanted).sum(axis=1)
    return np.divide(squares, total, out=np.zeros_like(squares), where=total > 0)


def _between(low: np.float32, high: np.float32) -> float:
    """Return the float32 half-way between two, or the higher one where there is none between."""
    half_way = np.float32((float(low) + float(high)) / 2)
    # Adding zero makes -0.0 into 0.0, as in a tree.
    return float(half_way if half_way > low else high) + 0.0
