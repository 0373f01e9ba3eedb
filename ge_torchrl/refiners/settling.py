"""A snapped tree settles on the best constants near by.

Snapping rounds each threshold by itself, but thresholds depend on each other: of a tree whose tests keep a balance, the
nearest constants may be the worst near by.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.tree import DecisionTree


def settle(
    tree: DecisionTree,
    near: Callable[[DecisionTree], NDArray[np.float32]],
    measure: Callable[[Forest], NDArray[np.float64]],
) -> DecisionTree:
    """Move one parameter after the other to a constant near by, for as long as that makes the tree better.

    Each round measures all trees that are one such move away and takes the best of them.

    Args:
        tree: A snapped tree; its structure stays.
        near: Gives the parameters [R, N] of the trees that are one move away.
        measure: Gives the fitness [P] of trees, always on the same episodes.

    Returns:
        The tree than which no move is better.
    """
    moved = near(tree)
    if len(moved) == 0:
        return tree
    fitness = measure(Forest.stack([tree]))[0]
    while len(moved) > 0:
        found = measure(Forest.of_parameters(tree, moved))
        best = int(np.argmax(found))
        if not found[best] > fitness:
            break
        tree, fitness = tree.with_parameters(moved[best]), found[best]
        moved = near(tree)
    return tree
