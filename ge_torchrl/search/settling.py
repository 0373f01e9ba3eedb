"""A snapped tree settles on the best constants near by.

Snapping rounds each threshold by itself, but thresholds depend on each other: of a tree whose tests keep a balance, the
nearest constants may be the worst near by.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from ge_torchrl.ge.grammar import Grammar
from ge_torchrl.search.fitness import Measurement
from ge_torchrl.trees.decision_tree import DecisionTree
from ge_torchrl.trees.forest import Forest

# So many constants away, in both directions.
_STRIDES = (-4, -2, -1, 1, 2, 4)


def settle(
    tree: DecisionTree, grammar: Grammar, measure: Callable[[Forest], Measurement]
) -> tuple[DecisionTree, int]:
    """Move one threshold after the other along the grammar's constants, for as long as that makes the tree better.

    Each round measures all trees that are one such move away and takes the best of them.

    Args:
        tree: A tree of the grammar's constants; its structure stays.
        grammar: The grammar.
        measure: Measures trees, always on the same episodes.

    Returns:
        The tree than which no move is better, and the environment steps taken.
    """
    measured = measure(Forest.stack([tree]))
    fitness, env_steps = measured.fitness[0], measured.env_steps
    while moved := list(_moved(tree, grammar)):
        measured = measure(Forest.stack(moved))
        env_steps += measured.env_steps
        best = int(np.argmax(measured.fitness))
        if not measured.fitness[best] > fitness:
            break
        tree, fitness = moved[best], measured.fitness[best]
    return tree, env_steps


def _moved(tree: DecisionTree, grammar: Grammar) -> Iterator[DecisionTree]:
    """Yield the trees that differ in one threshold, by a few constants."""
    for node in np.flatnonzero(~tree.is_leaf):
        for constants in grammar.constants[int(tree.feature[node])]:
            index = constants.find(float(tree.threshold[node]))
            if index is None:
                continue
            for stride in _STRIDES:
                if 0 <= index + stride < constants.count:
                    threshold = tree.threshold.copy()
                    threshold[node] = constants.value(index + stride)
                    yield replace(tree, threshold=threshold)
