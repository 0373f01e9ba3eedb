"""Many trees stacked into flat arrays, for the compiled routes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ge_torchrl.trees.decision_tree import DecisionTree, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Forest:
    """`P` trees end to end; tree `p` owns the rows `offsets[p]` to `offsets[p + 1]`, children count from its root.

    An individual without a tree (an invalid genotype) owns no rows. Nothing is checked here: a forest comes from
    checked trees or from the mapping, whose law is to make valid ones.

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
        return cls(
            offsets=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
            feature=np.concatenate([tree.feature for tree in trees]),
            threshold=np.concatenate([tree.threshold for tree in trees]),
            children_left=np.concatenate([tree.children_left for tree in trees]),
            children_right=np.concatenate([tree.children_right for tree in trees]),
            action=np.concatenate([tree.action for tree in trees]),
        )

    def __len__(self) -> int:
        return len(self.offsets) - 1

    @property
    def sizes(self) -> NDArray[np.int64]:
        """[P] number of nodes of each tree, 0 where there is none."""
        return np.diff(self.offsets)

    def tree(self, index: int) -> DecisionTree:
        """Return one tree, checked.

        Raises:
            InvalidTreeError: The individual has no tree.
        """
        rows = slice(self.offsets[index], self.offsets[index + 1])
        return DecisionTree(
            feature=self.feature[rows],
            threshold=self.threshold[rows],
            children_left=self.children_left[rows],
            children_right=self.children_right[rows],
            action=self.action[rows],
        )
