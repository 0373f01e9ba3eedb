"""Hypothesis strategies of decision trees, shared by the tests of all folders."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from numpy.typing import NDArray

from ge_torchrl.trees.tree import DecisionTree

# Few and close values make trees whose splits meet at the same threshold, where most errors would be.
COMMON_THRESHOLDS = [
    np.float32(value).item() for value in (-1.0, -0.5, -0.1, 0.0, 1e-45, 0.1, 1.0, 3.4028235e38)
]


def float32s() -> st.SearchStrategy[float]:
    """Finite float32 values, the common ones often."""
    return st.sampled_from(COMMON_THRESHOLDS) | st.floats(width=32, allow_nan=False, allow_infinity=False)


def trees(
    n_features: int = 4,
    n_actions: int = 3,
    *,
    max_leaves: int = 12,
    thresholds: st.SearchStrategy[float] | None = None,
) -> st.SearchStrategy[DecisionTree]:
    """Trees of 1 to `max_leaves` leaves with float32 thresholds, axis-aligned, with actions."""
    leaves = st.integers(0, n_actions - 1).map(DecisionTree.leaf)
    return st.recursive(
        leaves,
        lambda children: st.builds(
            DecisionTree.split,
            st.integers(0, n_features - 1),
            float32s() if thresholds is None else thresholds,
            children,
            children,
        ),
        max_leaves=max_leaves,
    )


def weighted_trees(
    n_features: int = 4, n_actions: int = 3, *, max_leaves: int = 8
) -> st.SearchStrategy[DecisionTree]:
    """Trees of actions whose splits sum 1 to 3 weighted features; some trees are axis-aligned."""
    leaves = st.integers(0, n_actions - 1).map(DecisionTree.leaf)
    plain = trees(n_features, n_actions, max_leaves=4)
    return plain | _above(leaves, n_features, max_leaves, float32s(), oblique=True)


def value_trees(
    n_features: int = 4,
    n_values: int = 2,
    *,
    oblique: bool = True,
    linear: bool = True,
    max_leaves: int = 8,
    numbers: st.SearchStrategy[float] | None = None,
) -> st.SearchStrategy[DecisionTree]:
    """Trees whose leaves hold values, one for each entry of a Box action.

    Args:
        n_features: Features that splits and leaves use.
        n_values: Entries of an action, A.
        oblique: Whether splits sum 1 to 3 weighted features; if not, they compare one.
        linear: Whether leaves may have up to two linear terms; if not, they hold constants.
        max_leaves: Leaves of a tree.
        numbers: What all its numbers are drawn from; any float32 unless given.
    """
    floats = float32s() if numbers is None else numbers
    row = st.lists(floats, min_size=n_values, max_size=n_values)
    terms = st.dictionaries(st.integers(0, n_features - 1), row, max_size=2 if linear else 0)
    leaves = st.builds(DecisionTree.value_leaf, row, terms)
    return _above(leaves, n_features, max_leaves, floats, oblique=oblique)


def any_trees(n_features: int = 4) -> st.SearchStrategy[DecisionTree]:
    """Trees of every kind."""
    return trees_of_one_kind(n_features).flatmap(lambda of_kind: of_kind)


def trees_of_one_kind(n_features: int = 4) -> st.SearchStrategy[st.SearchStrategy[DecisionTree]]:
    """Strategies, each of trees that one forest may hold: all with actions, or all with 1, 2 or 3 values."""
    kinds = [trees(n_features), weighted_trees(n_features)]
    return st.sampled_from([*kinds, *(value_trees(n_features, n_values) for n_values in (1, 2, 3))])


def _above(
    leaves: st.SearchStrategy[DecisionTree],
    n_features: int,
    max_leaves: int,
    numbers: st.SearchStrategy[float],
    *,
    oblique: bool,
) -> st.SearchStrategy[DecisionTree]:
    weights = numbers if oblique else st.just(1.0)
    terms = st.lists(
        st.tuples(st.integers(0, n_features - 1), weights), min_size=1, max_size=3 if oblique else 1
    )

    def above(terms, threshold, left, right):
        return DecisionTree.weighted_split(*zip(*terms, strict=True), threshold, left, right)

    return st.recursive(
        leaves, lambda halves: st.builds(above, terms, numbers, halves, halves), max_leaves=max_leaves
    )


@st.composite
def observations(
    draw: st.DrawFn, tree: DecisionTree, n_features: int = 4, *, max_rows: int = 8, near: Sequence[float] = ()
) -> NDArray[np.float32]:
    """[B, D] float32 observations, often at a threshold (or a value of `near`) or one float32 beside it."""
    at = np.concatenate([tree.threshold, np.float32(near)])
    with np.errstate(over="ignore"):
        beside = [np.nextafter(at, np.float32(end)) for end in (-np.inf, np.inf)]
    special = np.concatenate([at, *beside, np.float32([0.0, -0.0])]).tolist()
    entries = st.sampled_from(special) | st.floats(width=32, allow_nan=False)
    return draw(npst.arrays(np.float32, (draw(st.integers(1, max_rows)), n_features), elements=entries))


# The observations that episodes visit, roughly: random thresholds within them make trees that act.
_VISITED = {
    "CartPole-v1": ([1.0, 1.0, 0.1, 1.0], 2),
    "Acrobot-v1": ([1.0, 1.0, 1.0, 1.0, 3.0, 5.0], 3),
    "MountainCar-v0": ([0.5, 0.01], 3),
}


def observed_trees(environment_id, n, seed):
    """Return `n` random trees of depth up to 4 whose thresholds lie among visited observations."""
    spread, n_actions = _VISITED[environment_id]
    rng = np.random.default_rng(seed)

    def grow(depth):
        if depth == 0 or rng.random() < 0.2:
            return DecisionTree.leaf(int(rng.integers(n_actions)))
        feature = int(rng.integers(len(spread)))
        offset = -0.5 if (environment_id, feature) == ("MountainCar-v0", 0) else 0.0
        return DecisionTree.split(
            feature, offset + rng.normal() * spread[feature] * 0.5, grow(depth - 1), grow(depth - 1)
        )

    return [grow(4) for _ in range(n)]
