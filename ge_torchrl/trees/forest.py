"""Many trees in one bundle of arrays: what mapping, simplification, edits and compiled kernels read and write."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ge_torchrl.errors import InvalidTreeError
from ge_torchrl.trees.arrays import (
    FloatArray,
    ForestArrays,
    IntArray,
    LeafArrays,
    TreeArrays,
    structure_of,
)
from ge_torchrl.trees.deciding import answer_values, decide_axis_aligned, decide_weighted
from ge_torchrl.trees.stacking import joined_forests, repeated, rows_of, stacked, taken
from ge_torchrl.trees.tree import DecisionTree

__all__ = ["Forest", "ForestArrays", "LeafArrays"]


@dataclass(frozen=True, eq=False)
class Forest:
    """`P` individuals, each with a tree or, where a genotype is invalid, without one.

    Nothing is checked here: a forest comes from checked trees, or from a mapping whose law is to make valid ones,
    depth first. Nobody writes to the arrays of a forest.

    Attributes:
        arrays: The arrays of all trees.
    """

    arrays: ForestArrays

    @classmethod
    def stack(cls, trees: Sequence[DecisionTree]) -> Forest:
        """Return the forest of these trees, in their order.

        Raises:
            InvalidTreeError: The leaves of one tree hold actions, those of another values, or more values.
        """
        return cls(stacked([tree.arrays for tree in trees]))

    @classmethod
    def axis_aligned(
        cls,
        split_start: NDArray[np.int64],
        leaf_start: NDArray[np.int64],
        feature: IntArray,
        threshold: FloatArray,
        children_left: IntArray,
        children_right: IntArray,
        action: IntArray,
    ) -> Forest:
        """Return the forest of trees of actions whose splits compare one feature each; see `ForestArrays`."""
        n_splits = len(feature)
        return cls(
            ForestArrays(
                split_start,
                leaf_start,
                np.arange(n_splits + 1),
                feature,
                np.ones(n_splits, np.float32),
                threshold,
                children_left,
                children_right,
                *LeafArrays.of_actions(action),
            )
        )

    @classmethod
    def of_parameters(cls, tree: DecisionTree, parameters: NDArray[np.float32]) -> Forest:
        """Return copies of one tree with other numbers.

        Args:
            tree: A tree of N parameters.
            parameters: [R, N] float32, finite, as in `DecisionTree.parameters`.

        Raises:
            InvalidTreeError: The tree has another number of parameters.
        """
        if parameters.ndim != 2 or parameters.shape[1] != len(tree.parameters):
            raise InvalidTreeError(
                f"copies of this tree need [R, {len(tree.parameters)}] parameters; "
                f"{list(parameters.shape)} were given"
            )
        return cls(repeated(tree.arrays, parameters))

    @classmethod
    def concatenate(cls, forests: Sequence[Forest]) -> Forest:
        """Return the individuals of all forests, in their order.

        Raises:
            InvalidTreeError: The leaves of one forest hold actions, those of another values, or more values.
        """
        return cls(joined_forests([forest.arrays for forest in forests])) if forests else _NO_TREES

    def take(self, index: ArrayLike) -> Forest:
        """Return some individuals, in the order asked for.

        Args:
            index: [Q] their numbers, each as often as it is wanted.
        """
        return Forest(taken(self.arrays, index))

    def __len__(self) -> int:
        return len(self.arrays.split_start) - 1

    @cached_property
    def valid(self) -> NDArray[np.bool_]:
        """[P] bool, where an individual has a tree."""
        return np.diff(self.arrays.leaf_start) > 0

    @cached_property
    def num_decision_nodes(self) -> NDArray[np.int64]:
        """[P] int64, number of splits of each tree, 0 where there is none."""
        return np.diff(self.arrays.split_start)

    @property
    def n_values(self) -> int:
        """How many values each leaf holds, A; 0 where leaves hold actions."""
        return int(self.arrays.value.shape[1])

    @property
    def has_actions(self) -> bool:
        """Whether leaves hold actions; if not, they hold values."""
        return self.n_values == 0

    @cached_property
    def is_axis_aligned(self) -> bool:
        """Whether every split of every tree compares one feature, of weight 1: kernels are quicker then."""
        arrays = self.arrays
        return len(arrays.feature) == len(arrays.threshold) and bool((arrays.weight == 1).all())

    def tree(self, index: int) -> DecisionTree:
        """Return one tree.

        Args:
            index: Number of the individual, 0 to P - 1.

        Raises:
            IndexError: There is no such individual.
            InvalidTreeError: The individual has no tree.
        """
        rows = self._rows(index)
        if len(rows.value) == 0:
            raise InvalidTreeError(f"individual {index} has no tree: its genotype is invalid")
        return DecisionTree.unchecked(TreeArrays._make(array.copy() for array in rows))

    def trees(self) -> list[DecisionTree]:
        """Return all trees; every individual must have one."""
        return [self.tree(index) for index in range(len(self))]

    def structure(self, index: int) -> bytes:
        """Return the `DecisionTree.structure` of one tree; empty where there is none."""
        rows = self._rows(index)
        return structure_of(rows) if len(rows.value) > 0 else b""

    def _rows(self, index: int) -> TreeArrays:
        if not 0 <= index < len(self):
            raise IndexError(f"the forest has individuals 0 to {len(self) - 1}, not {index}")
        return rows_of(self.arrays, index)

    def decide(self, tree_index: NDArray[np.int64], observations: NDArray[np.float32]) -> NDArray[Any]:
        """Return the answer to each observation, every one decided by its own tree.

        Args:
            tree_index: [B] int64, which tree decides; it must have a tree.
            observations: [B, D] float32.

        Returns:
            [B] int32, the actions; [B, A] float32, the values, where leaves hold values.
        """
        observed = np.ascontiguousarray(observations, np.float32)
        if not self.has_actions:
            values = np.empty((len(tree_index), self.n_values), np.float32)
            answer_values(self.arrays, tree_index, observed, values)
            return values
        actions = np.empty(len(tree_index), np.int32)
        decide = decide_axis_aligned if self.is_axis_aligned else decide_weighted
        decide(self.arrays, tree_index, observed, actions)
        return actions


_NO_TREES = Forest.stack([])
