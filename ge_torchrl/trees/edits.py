"""Edits of trees: what leads from a tree to its neighbours, which have a node more or less, or another one.

A tree is edited as its nodes in depth-first order, where a subtree is a run of nodes. Mutation of codons edits trees
too, but behind the codon that changed it mostly gives another tree ("ripple"); an edit leaves everything else as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.trees.decision_tree import DecisionTree, FloatArray, IntArray
from ge_torchrl.trees.forest import Forest

# Growing is the likeliest, since the other edits keep trees small. Chosen on MountainCar and Acrobot.
_PROBABILITIES = {"grow": 0.4, "test_anew": 0.3, "drop": 0.1, "relabel": 0.2}
_SECOND_EDIT_PROBABILITY = 0.3


@dataclass(frozen=True, eq=False)
class Nodes:
    """A tree as its nodes, depth first, left before right.

    Attributes:
        feature: [N] int32, `DecisionTree.NO_FEATURE` at leaves.
        threshold: [N] float32, 0 at leaves.
        action: [N] int32, `DecisionTree.NO_ACTION` at decision nodes.
    """

    feature: IntArray
    threshold: FloatArray
    action: IntArray

    @property
    def decisions(self) -> NDArray[np.int64]:
        """[M] the decision nodes."""
        return np.flatnonzero(self.feature >= 0)

    @property
    def leaves(self) -> NDArray[np.int64]:
        """[L] the leaves."""
        return np.flatnonzero(self.feature < 0)

    def end(self, node: int) -> int:
        """Return the node behind the subtree of a node."""
        # A decision node asks for one subtree more, a leaf for one less.
        open_subtrees = np.cumsum(np.where(self.feature[node:] >= 0, 1, -1))
        return node + int(np.argmax(open_subtrees < 0)) + 1

    def __getitem__(self, nodes: slice) -> Nodes:
        return Nodes(self.feature[nodes], self.threshold[nodes], self.action[nodes])

    def __len__(self) -> int:
        return len(self.feature)


@dataclass(frozen=True, eq=False)
class EditedTree:
    """A tree and the states that it saw, from which the tests of its neighbours come.

    Attributes:
        tree: The tree, its nodes numbered depth first.
        observed: [T, D] float32, observations that it acted on.
        leaf: [T] int32, the leaf of each.
    """

    tree: DecisionTree
    observed: FloatArray
    leaf: IntArray

    @classmethod
    def of(cls, tree: DecisionTree, observed: FloatArray) -> EditedTree:
        """Return a tree with the states that it saw."""
        return cls(tree, observed, tree.leaf_of(observed))

    def neighbour(self, features: NDArray[np.int64], n_actions: int, rng: np.random.Generator) -> Nodes:
        """Return a tree one edit away, sometimes two.

        Args:
            features: Features that new decisions may test.
            n_actions: Number of actions, A.
            rng: Source of randomness.
        """
        edits = list(_EDITS)
        nodes = Nodes(self.tree.feature, self.tree.threshold, self.tree.action)
        for edit in range(1 + (rng.random() < _SECOND_EDIT_PROBABILITY)):
            kind = edits[int(np.searchsorted(_CUMULATIVE, rng.random(), side="right"))]
            # Only in the tree itself is it known which states come to a node.
            leaf = self.leaf if edit == 0 else None
            if len(nodes) == 1:
                kind = "grow"
            nodes = _EDITS[kind](_Edit(nodes, self.observed, leaf, features, n_actions, rng))
        return nodes


@dataclass(frozen=True, eq=False)
class _Edit:
    nodes: Nodes
    observed: FloatArray
    leaf: IntArray | None
    features: NDArray[np.int64]
    n_actions: int
    rng: np.random.Generator

    def test_at(self, node: int) -> Nodes:
        """Return a decision node: a random feature, and as threshold a value of it that was seen at this node."""
        feature = int(self.features[self.rng.integers(len(self.features))])
        seen = self.observed[:, feature]
        if self.leaf is not None:
            here = seen[(self.leaf >= node) & (self.leaf < self.nodes.end(node))]
            seen = here if len(here) > 0 else seen
        return _node(feature, float(self.rng.choice(seen)), DecisionTree.NO_ACTION)

    def any_of(self, nodes: NDArray[np.int64]) -> int:
        return int(self.rng.choice(nodes))

    def random_leaf(self) -> Nodes:
        return _node(DecisionTree.NO_FEATURE, 0.0, int(self.rng.integers(self.n_actions)))


def _grow(edit: _Edit) -> Nodes:
    """Put a new decision above a node, mostly a leaf; its other child is a random leaf."""
    nodes, rng = edit.nodes, edit.rng
    at = edit.any_of(np.arange(len(nodes)) if rng.random() < 0.5 else nodes.leaves)
    end = nodes.end(at)
    children = [edit.random_leaf(), nodes[at:end]]
    if rng.random() < 0.5:
        children.reverse()
    return _joined(nodes[:at], edit.test_at(at), *children, nodes[end:])


def _test_anew(edit: _Edit) -> Nodes:
    """Give a decision node another feature and threshold."""
    at = edit.any_of(edit.nodes.decisions)
    return _joined(edit.nodes[:at], edit.test_at(at), edit.nodes[at + 1 :])


def _drop(edit: _Edit) -> Nodes:
    """Put one of a decision node's children in its place."""
    nodes = edit.nodes
    at = edit.any_of(nodes.decisions)
    middle, end = nodes.end(at + 1), nodes.end(at)
    kept = nodes[at + 1 : middle] if edit.rng.random() < 0.5 else nodes[middle:end]
    return _joined(nodes[:at], kept, nodes[end:])


def _relabel(edit: _Edit) -> Nodes:
    """Give a leaf a random action."""
    at = edit.any_of(edit.nodes.leaves)
    return _joined(edit.nodes[:at], edit.random_leaf(), edit.nodes[at + 1 :])


_EDITS: dict[str, Callable[[_Edit], Nodes]] = {
    "grow": _grow,
    "test_anew": _test_anew,
    "drop": _drop,
    "relabel": _relabel,
}
_CUMULATIVE = np.cumsum([_PROBABILITIES[name] for name in _EDITS])[:-1]


def stacked(trees: Sequence[Nodes]) -> Forest:
    """Return trees, each as its nodes in depth-first order, as one forest."""
    return Forest.depth_first(
        [len(tree) for tree in trees],
        np.concatenate([tree.feature for tree in trees]),
        np.concatenate([tree.threshold for tree in trees]),
        np.concatenate([tree.action for tree in trees]),
    )


def _node(feature: int, threshold: float, action: int) -> Nodes:
    return Nodes(
        np.array([feature], np.int32),
        np.array([threshold], np.float32) + np.float32(0.0),
        np.array([action], np.int32),
    )


def _joined(*parts: Nodes) -> Nodes:
    return Nodes(
        np.concatenate([part.feature for part in parts]),
        np.concatenate([part.threshold for part in parts]),
        np.concatenate([part.action for part in parts]),
    )
