"""A controller as plain values that a page draws, follows and puts into words."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.report.html.words import formulas_of, rules_of
from ge_torchrl.trees.arrays import visits_of_splits
from ge_torchrl.trees.complexity import complexity
from ge_torchrl.trees.controller import Controller, Names
from ge_torchrl.trees.text import leaf_lines, shortest_decimal, split_text
from ge_torchrl.trees.tree import DecisionTree


def tree_values(controller: Controller, visits: NDArray[np.int64] | None) -> dict[str, Any]:
    """Return a tree for a page: its nodes with their texts, its rule in words, its sums as formulas.

    Args:
        controller: The tree with its names.
        visits: [L] how often its leaves decided in the test; None where nobody counted.
    """
    tree, names = controller.tree, controller.names
    if visits is not None and len(visits) != tree.num_leaves:
        visits = None
    of_splits = None if visits is None else visits_of_splits(tree.arrays, visits)
    return {
        "nodes": tree.num_decision_nodes,
        "depth": tree.depth,
        "complexity": complexity(tree).M,
        "splits": [_split(tree, names, split, of_splits) for split in range(tree.num_decision_nodes)],
        "leaves": [_leaf(tree, names, leaf, visits) for leaf in range(tree.num_leaves)],
        "rules": rules_of(tree, names),
        "formulas": formulas_of(tree, names),
    }


def environment_values(names: Names) -> dict[str, Any]:
    """Return the names of an environment for a page."""
    return {
        "id": names.id,
        "features": [
            {"name": name, "unit": unit} for name, unit in zip(names.features, names.units, strict=True)
        ],
        "actions": list(names.actions),
        "bounds": [[_finite(low), _finite(high)] for low, high in names.action_bounds],
    }


def _split(tree: DecisionTree, names: Names, split: int, visits: NDArray[np.int64] | None) -> dict[str, Any]:
    terms = range(tree.term_start[split], tree.term_start[split + 1])
    return {
        "terms": [[int(tree.feature[term]), shortest_decimal(tree.weight[term])] for term in terms],
        "threshold": shortest_decimal(tree.threshold[split]),
        "left": int(tree.children_left[split]),
        "right": int(tree.children_right[split]),
        "text": split_text(tree, names, split),
        "visits": None if visits is None else int(visits[split]),
    }


def _leaf(tree: DecisionTree, names: Names, leaf: int, visits: NDArray[np.int64] | None) -> dict[str, Any]:
    told: dict[str, Any] = {
        "lines": leaf_lines(tree, names, leaf),
        "visits": None if visits is None else int(visits[leaf]),
    }
    if tree.has_actions:
        return {"action": int(tree.action[leaf]), **told}
    return {
        "value": [shortest_decimal(value) for value in tree.value[leaf]],
        "linear": list(_linear(tree, leaf)),
        **told,
    }


def _linear(tree: DecisionTree, leaf: int) -> Iterator[list[Any]]:
    for term in range(tree.leaf_term_start[leaf], tree.leaf_term_start[leaf + 1]):
        yield [int(tree.leaf_feature[term]), [shortest_decimal(weight) for weight in tree.leaf_weight[term]]]


def _finite(end: float) -> float | None:
    return shortest_decimal(end) if np.isfinite(end) else None
