"""Hypothesis strategies of decision trees, shared by the tests of all folders."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from numpy.typing import NDArray

from ge_torchrl.trees.decision_tree import DecisionTree

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
    """Trees of 1 to `max_leaves` leaves with float32 thresholds, nodes numbered depth first."""
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


@st.composite
def renumbered_trees(draw: st.DrawFn, n_features: int = 4, n_actions: int = 3) -> DecisionTree:
    """Trees whose nodes behind the root are numbered in any order."""
    tree = draw(trees(n_features, n_actions))
    order = np.array([0, *draw(st.permutations(range(1, tree.n_nodes)))])
    # The entry behind the last node is what NO_CHILD, -1, reads.
    number = np.append(np.argsort(order), DecisionTree.NO_CHILD)
    return DecisionTree(
        feature=tree.feature[order],
        threshold=tree.threshold[order],
        children_left=number[tree.children_left[order]],
        children_right=number[tree.children_right[order]],
        action=tree.action[order],
    )


@st.composite
def observations(
    draw: st.DrawFn, tree: DecisionTree, n_features: int = 4, *, max_rows: int = 8, near: Sequence[float] = ()
) -> NDArray[np.float32]:
    """[B, D] float32 observations, often at a threshold (or a value of `near`) or one float32 beside it."""
    at = np.concatenate([tree.threshold[~tree.is_leaf], np.float32(near)])
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
