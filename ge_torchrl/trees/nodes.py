"""A tree as its nodes in depth-first order, where a subtree is a run of nodes: the form in which trees are edited."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from ge_torchrl.trees.arrays import ForestArrays, LeafArrays
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.rows import starts
from ge_torchrl.trees.tree import DecisionTree


class Split(NamedTuple):
    """A split: the terms of its sum, and its threshold."""

    feature: tuple[int, ...]
    weight: tuple[float, ...]
    threshold: float


class Values(NamedTuple):
    """A leaf with values: its constants [A], and the linear terms that are added to them, [q] and [q, A]."""

    value: tuple[float, ...]
    feature: tuple[int, ...] = ()
    weight: tuple[tuple[float, ...], ...] = ()


Leaf: TypeAlias = "int | Values"
"""A leaf: its action, or its values."""

Nodes: TypeAlias = "list[Split | int | Values]"
"""A tree as its nodes, depth first, left before right."""


def nodes_of(tree: DecisionTree) -> Nodes:
    """Return the nodes of a tree."""
    nodes: Nodes = []
    open_nodes = [0 if tree.num_decision_nodes else ~0]
    while open_nodes:
        node = open_nodes.pop()
        if node < 0:
            nodes.append(_leaf_of(tree, ~node))
        else:
            terms = slice(tree.term_start[node], tree.term_start[node + 1])
            nodes.append(
                Split(
                    tuple(tree.feature[terms].tolist()),
                    tuple(tree.weight[terms].tolist()),
                    float(tree.threshold[node]),
                )
            )
            open_nodes += (int(tree.children_right[node]), int(tree.children_left[node]))
    return nodes


def _leaf_of(tree: DecisionTree, leaf: int) -> Leaf:
    if tree.has_actions:
        return int(tree.action[leaf])
    terms = slice(tree.leaf_term_start[leaf], tree.leaf_term_start[leaf + 1])
    return Values(
        tuple(tree.value[leaf].tolist()),
        tuple(tree.leaf_feature[terms].tolist()),
        tuple(map(tuple, tree.leaf_weight[terms].tolist())),
    )


def end_of(nodes: Nodes, node: int) -> int:
    """Return the node behind the subtree of a node."""
    # A split asks for one subtree more, a leaf for one less.
    open_subtrees = 1
    while open_subtrees > 0:
        open_subtrees += 1 if isinstance(nodes[node], Split) else -1
        node += 1
    return node


def without_one_split(nodes: Nodes) -> Iterator[Nodes]:
    """Yield what is left of a tree when a split gives its place to one of its children: two trees for each split."""
    for place, node in enumerate(nodes):
        if isinstance(node, Split):
            middle, end = end_of(nodes, place + 1), end_of(nodes, place)
            yield nodes[:place] + nodes[place + 1 : middle] + nodes[end:]
            yield nodes[:place] + nodes[middle:end] + nodes[end:]


def forest_of(trees: Sequence[Nodes]) -> Forest:
    """Return the forest of trees of one kind, in their order."""
    splits: list[Split] = []
    leaves: list[Leaf] = []
    children: tuple[list[int], list[int]] = ([], [])
    n_splits, n_leaves = [], []
    for nodes in trees:
        first, first_leaf = len(splits), len(leaves)
        # Splits whose right child is still to come; the node behind a split is its left child.
        waiting: list[int] = []
        is_left = False
        for place, node in enumerate(nodes):
            number = len(splits) - first if isinstance(node, Split) else ~(len(leaves) - first_leaf)
            if place > 0:
                if is_left:
                    children[0].append(number)
                else:
                    children[1][waiting.pop()] = number
            is_left = isinstance(node, Split)
            if isinstance(node, Split):
                waiting.append(len(splits))
                splits.append(node)
                children[1].append(0)
            else:
                leaves.append(node)
        n_splits.append(len(splits) - first)
        n_leaves.append(len(leaves) - first_leaf)
    return Forest(
        ForestArrays(
            starts(n_splits),
            starts(n_leaves),
            starts([len(split.feature) for split in splits]),
            np.array([feature for split in splits for feature in split.feature], np.int32),
            np.array([weight for split in splits for weight in split.weight], np.float32),
            np.array([split.threshold for split in splits], np.float32),
            np.array(children[0], np.int32),
            np.array(children[1], np.int32),
            *_leaf_arrays(leaves),
        )
    )


def _leaf_arrays(leaves: Sequence[Leaf]) -> LeafArrays:
    with_values = [leaf for leaf in leaves if isinstance(leaf, Values)]
    if not with_values:
        return LeafArrays.of_actions(np.array(leaves, np.int32))
    n_values = len(with_values[0].value)
    weights = [weights for leaf in with_values for weights in leaf.weight]
    return LeafArrays(
        action=np.zeros(0, np.int32),
        value=np.array([leaf.value for leaf in with_values], np.float32),
        leaf_term_start=starts([len(leaf.feature) for leaf in with_values]),
        leaf_feature=np.array([feature for leaf in with_values for feature in leaf.feature], np.int32),
        leaf_weight=np.array(weights, np.float32).reshape(-1, n_values),
    )
