"""Edits of trees: what leads from a tree to its neighbours, which have a split more or less, or another one.

A tree is edited as its nodes in depth-first order, where a subtree is a run of nodes. Mutation of codons edits trees
too, but behind the codon that changed it mostly gives another tree ("ripple"); an edit leaves everything else as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.arrays import FloatArray, ForestArrays, LeafArrays
from ge_torchrl.trees.forest import Forest
from ge_torchrl.trees.rows import starts
from ge_torchrl.trees.tree import DecisionTree

# Growing is the likeliest, since the other edits keep trees small. Chosen on MountainCar and Acrobot.
_PROBABILITIES = {"grow": 0.4, "test_anew": 0.3, "drop": 0.1, "relabel": 0.2}
_SECOND_EDIT_PROBABILITY = 0.3


class Split(NamedTuple):
    """A split among the nodes of an edited tree."""

    feature: tuple[int, ...]
    weight: tuple[float, ...]
    threshold: float


Nodes: TypeAlias = "list[Split | int]"
"""A tree as its nodes, depth first, left before right; a leaf is its action."""


class Neighbourhood:
    """A tree and the states that it saw, from which the tests of its neighbours come.

    Args:
        tree: The tree; its leaves hold actions.
        observed: [T, D] float32, at least one observation that it acted on. What is infinite counts as the largest
            float32, what is NaN as 0, since a threshold is finite.

    Raises:
        InvalidTreeError: The leaves hold values, or nothing was observed.
    """

    def __init__(self, tree: DecisionTree, observed: FloatArray) -> None:
        if not tree.has_actions or len(observed) == 0:
            raise InvalidTreeError(
                "neighbours are those of a tree whose leaves hold actions and which saw at least one state; "
                f"this one holds {len(tree.action)} actions and saw {len(observed)} states"
            )
        leaf = tree.leaf_of(observed)
        order = np.argsort(leaf, kind="stable")
        self.tree = tree
        self._nodes = _nodes_of(tree)
        # By leaf, so that what came to a subtree is a run of rows.
        self._observed = np.nan_to_num(np.asarray(observed, np.float32))[order]
        self._leaf_start = starts(np.bincount(leaf, minlength=tree.num_leaves)).tolist()

    def draw(
        self, features: Sequence[int] | NDArray[np.int64], n_actions: int, rng: np.random.Generator
    ) -> Nodes:
        """Return a tree one edit away, sometimes two; `forest_of` makes a forest of what was drawn.

        Args:
            features: Features that new splits may test.
            n_actions: Number of actions, A.
            rng: Source of randomness.
        """
        nodes = self._nodes
        for number in range(1 + (rng.random() < _SECOND_EDIT_PROBABILITY)):
            # Only in the tree itself is it known which states come to a node.
            leaf_start = self._leaf_start if number == 0 else None
            kind = "grow" if len(nodes) == 1 else _kind(rng.random())
            nodes = _EDITS[kind](_Edit(nodes, self._observed, leaf_start, features, n_actions, rng))
        return nodes


def forest_of(drawn: Sequence[Nodes]) -> Forest:
    """Return the forest of trees that were drawn, in their order."""
    splits: list[Split] = []
    actions: list[int] = []
    children: tuple[list[int], list[int]] = ([], [])
    n_splits, n_leaves = [], []
    for nodes in drawn:
        first, first_leaf = len(splits), len(actions)
        # Splits whose right child is still to come; the node behind a split is its left child.
        waiting: list[int] = []
        is_left = False
        for place, node in enumerate(nodes):
            number = len(splits) - first if isinstance(node, Split) else ~(len(actions) - first_leaf)
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
                actions.append(node)
        n_splits.append(len(splits) - first)
        n_leaves.append(len(actions) - first_leaf)
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
            *LeafArrays.of_actions(np.array(actions, np.int32)),
        )
    )


def _nodes_of(tree: DecisionTree) -> Nodes:
    nodes: Nodes = []
    open_nodes = [0 if tree.num_decision_nodes else ~0]
    while open_nodes:
        node = open_nodes.pop()
        if node < 0:
            nodes.append(int(tree.action[~node]))
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


def _end(nodes: Nodes, node: int) -> int:
    """Return the node behind the subtree of a node."""
    # A split asks for one subtree more, a leaf for one less.
    open_subtrees = 1
    while open_subtrees > 0:
        open_subtrees += 1 if isinstance(nodes[node], Split) else -1
        node += 1
    return node


@dataclass(frozen=True, slots=True)
class _Edit:
    nodes: Nodes
    observed: FloatArray
    leaf_start: list[int] | None
    features: Sequence[int] | NDArray[np.int64]
    n_actions: int
    rng: np.random.Generator

    def any_of(self, n: int) -> int:
        """Return one of the numbers 0 to n - 1; much quicker than `rng.integers` one by one."""
        return int(self.rng.random() * n)

    def test_at(self, node: int) -> Split:
        """Return a split: a random feature, and as threshold a value of it that was seen at this node."""
        feature = int(self.features[self.any_of(len(self.features))])
        first, end = 0, len(self.observed)
        if self.leaf_start is not None:
            before = sum(not isinstance(other, Split) for other in self.nodes[:node])
            leaves = (_end(self.nodes, node) - node + 1) // 2
            here = self.leaf_start[before], self.leaf_start[before + leaves]
            first, end = here if here[0] < here[1] else (first, end)
        seen = float(self.observed[first + self.any_of(end - first), feature])
        # Adding zero makes -0.0 into 0.0, as in a tree.
        return Split((feature,), (1.0,), seen + 0.0)

    def a_split(self) -> int:
        splits = [node for node, of in enumerate(self.nodes) if isinstance(of, Split)]
        return splits[self.any_of(len(splits))]

    def a_leaf(self) -> int:
        leaves = [node for node, of in enumerate(self.nodes) if not isinstance(of, Split)]
        return leaves[self.any_of(len(leaves))]


def _grow(edit: _Edit) -> Nodes:
    """Put a new split above a node, mostly a leaf; its other child is a random leaf."""
    nodes = edit.nodes
    at = edit.any_of(len(nodes)) if edit.rng.random() < 0.5 else edit.a_leaf()
    end = _end(nodes, at)
    leaf = edit.any_of(edit.n_actions)
    halves = [leaf, *nodes[at:end]] if edit.rng.random() < 0.5 else [*nodes[at:end], leaf]
    return [*nodes[:at], edit.test_at(at), *halves, *nodes[end:]]


def _test_anew(edit: _Edit) -> Nodes:
    """Give a split another feature and threshold."""
    at = edit.a_split()
    return [*edit.nodes[:at], edit.test_at(at), *edit.nodes[at + 1 :]]


def _drop(edit: _Edit) -> Nodes:
    """Put one of a split's children in its place."""
    nodes, at = edit.nodes, edit.a_split()
    middle = _end(nodes, at + 1)
    end = _end(nodes, middle)
    kept = nodes[at + 1 : middle] if edit.rng.random() < 0.5 else nodes[middle:end]
    return [*nodes[:at], *kept, *nodes[end:]]


def _relabel(edit: _Edit) -> Nodes:
    """Give a leaf a random action."""
    at = edit.a_leaf()
    return [*edit.nodes[:at], edit.any_of(edit.n_actions), *edit.nodes[at + 1 :]]


_EDITS: dict[str, Callable[[_Edit], Nodes]] = {
    "grow": _grow,
    "test_anew": _test_anew,
    "drop": _drop,
    "relabel": _relabel,
}


def _kind(uniform: float) -> str:
    """Return the kind of edit that a number from 0 to 1 chooses."""
    for kind, probability in _PROBABILITIES.items():
        uniform -= probability
        if uniform < 0:
            return kind
    return "relabel"
