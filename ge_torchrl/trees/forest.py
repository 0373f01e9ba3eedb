"""Many trees stacked into flat arrays, for the compiled routes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.compilation import compiled
from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.decision_tree import DecisionTree, FloatArray, IntArray


class ForestArrays(NamedTuple):
    """The arrays of a `Forest`, in the form that compiled functions take."""

    offsets: NDArray[np.int64]
    feature: IntArray
    threshold: FloatArray
    children_left: IntArray
    children_right: IntArray
    action: IntArray


@dataclass(frozen=True, eq=False)
class Forest:
    """`P` trees end to end: tree `p` owns the rows `offsets[p]` to `offsets[p + 1]`.

    Children count from their tree's root. An individual without a tree (an invalid genotype) owns no rows.
    Nothing is checked here: a forest comes from checked trees or from the mapping, whose law is to make valid
    ones.

    Attributes:
        offsets: [P + 1] int64, where each tree begins.
        feature: [M] int32 of all trees, as in `DecisionTree`; the other arrays likewise.
        threshold: [M] float32.
        children_left: [M] int32.
        children_right: [M] int32.
        action: [M] int32.
    """

    offsets: NDArray[np.int64]
    feature: IntArray
    threshold: FloatArray
    children_left: IntArray
    children_right: IntArray
    action: IntArray

    @classmethod
    def stack(cls, trees: Sequence[DecisionTree]) -> Forest:
        """Return the forest of these trees, in their order."""
        sizes = [tree.n_nodes for tree in trees]
        # The empty arrays in front let a forest of no trees be stacked too.
        no_ints, no_floats = np.zeros(0, np.int32), np.zeros(0, np.float32)
        return cls(
            offsets=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
            feature=np.concatenate([no_ints, *(tree.feature for tree in trees)]),
            threshold=np.concatenate([no_floats, *(tree.threshold for tree in trees)]),
            children_left=np.concatenate([no_ints, *(tree.children_left for tree in trees)]),
            children_right=np.concatenate([no_ints, *(tree.children_right for tree in trees)]),
            action=np.concatenate([no_ints, *(tree.action for tree in trees)]),
        )

    @classmethod
    def depth_first(
        cls, sizes: Sequence[int], feature: IntArray, threshold: FloatArray, action: IntArray
    ) -> Forest:
        """Return the forest of trees whose nodes are numbered depth first, left before right.

        Such a numbering determines the children: the left child of a decision node follows it, its right child
        follows the left subtree.

        Args:
            sizes: [P] number of nodes of each tree.
            feature: [M] int32 of all trees, below 0 at leaves.
            threshold: [M] float32.
            action: [M] int32, below 0 at decision nodes.
        """
        offsets = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        children_left, children_right = np.full_like(feature, -1), np.full_like(feature, -1)
        _link_depth_first(offsets, feature, children_left, children_right)
        return cls(offsets, feature, threshold, children_left, children_right, action)

    @classmethod
    def of_thresholds(cls, tree: DecisionTree, thresholds: FloatArray) -> Forest:
        """Return copies of one tree with other thresholds.

        Args:
            tree: The tree, of N nodes.
            thresholds: [P, N] float32, finite; 0 at leaves.
        """
        copies = len(thresholds)
        return cls(
            offsets=np.arange(copies + 1, dtype=np.int64) * tree.n_nodes,
            feature=np.tile(tree.feature, copies),
            # As in a tree: adding zero makes -0.0 into 0.0.
            threshold=thresholds.reshape(-1).astype(np.float32) + np.float32(0.0),
            children_left=np.tile(tree.children_left, copies),
            children_right=np.tile(tree.children_right, copies),
            action=np.tile(tree.action, copies),
        )

    def __len__(self) -> int:
        return len(self.offsets) - 1

    @property
    def sizes(self) -> NDArray[np.int64]:
        """[P] number of nodes of each tree, 0 where there is none."""
        return np.diff(self.offsets)

    @property
    def arrays(self) -> ForestArrays:
        """The arrays for a compiled function."""
        return ForestArrays(
            self.offsets, self.feature, self.threshold, self.children_left, self.children_right, self.action
        )

    def tree(self, index: int) -> DecisionTree:
        """Return one tree, checked.

        Args:
            index: of the tree, 0 to P - 1.

        Raises:
            IndexError: There is no such individual.
            InvalidTreeError: The individual has no tree.
        """
        if not 0 <= index < len(self):
            raise IndexError(f"the forest has individuals 0 to {len(self) - 1}, not {index}")
        rows = slice(self.offsets[index], self.offsets[index + 1])
        if rows.start == rows.stop:
            raise InvalidTreeError(f"individual {index} has no tree: its genotype is invalid")
        return DecisionTree(
            feature=self.feature[rows],
            threshold=self.threshold[rows],
            children_left=self.children_left[rows],
            children_right=self.children_right[rows],
            action=self.action[rows],
        )

    def structure(self, index: int) -> bytes:
        """Return the `DecisionTree.structure` of one tree, which is not checked; empty where there is none."""
        rows = slice(self.offsets[index], self.offsets[index + 1])
        return self.feature[rows].tobytes() + self.action[rows].tobytes()

    def decide(self, tree_index: NDArray[np.int64], observations: NDArray[np.float32]) -> IntArray:
        """Return the action of each observation, every one decided by its own tree.

        Args:
            tree_index: [B] int64, which tree decides; it must have a tree.
            observations: [B, D] float32.

        Returns:
            [B] int32, the actions.
        """
        actions = np.empty(len(tree_index), np.int32)
        _decide(self.arrays, tree_index, observations, actions)
        return actions


@compiled
def _link_depth_first(
    offsets: NDArray[np.int64], feature: IntArray, children_left: IntArray, children_right: IntArray
) -> None:
    """Write the children of decision nodes; those of leaves stay."""
    waiting = np.empty(len(feature), np.int64)
    for tree in range(len(offsets) - 1):
        root, depth = offsets[tree], 0
        for row in range(root, offsets[tree + 1]):
            if row > root and feature[row - 1] < 0:
                depth -= 1
                children_right[waiting[depth]] = row - root
            if feature[row] >= 0:
                children_left[row] = row + 1 - root
                waiting[depth] = row
                depth += 1


@compiled
def _decide(
    forest: ForestArrays,
    tree_index: NDArray[np.int64],
    observations: NDArray[np.float32],
    actions: IntArray,
) -> None:
    for b in range(len(tree_index)):
        root = forest.offsets[tree_index[b]]
        node = root
        while forest.children_left[node] >= 0:
            is_left = observations[b, forest.feature[node]] < forest.threshold[node]
            node = root + (forest.children_left[node] if is_left else forest.children_right[node])
        actions[b] = forest.action[node]
